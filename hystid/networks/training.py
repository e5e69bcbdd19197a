"""Training of one tanh network by Levenberg-Marquardt, with early stopping; its data and starting weights."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hystid.errors import UsageError
from hystid.leastsquares import Descent, Rule, minimise
from hystid.networks.normal_equations import (
    CompiledNormal,
    KernelSums,
    One,
    Precision,
    layers_of,
    parameter_count,
    unflatten,
)
from hystid.networks.perceptron import Network
from hystid.recording import Array

Mode = Literal["trainlm", "fast"]

# "fast" is Marquardt's own scaling (1963): about a quarter of trainlm's iterations on hysteresis data.
RULES: dict[Mode, Rule] = {
    "trainlm": Rule("mean", 1e-3),
    "fast": Rule("columns", 1.0, max_iterations=200, progress=2e-3, draft=0.2),
}

_DRAFT_FROM = 10_000
_DRAFT_FAILS = 20  # few samples make the validation error uneven, and the stage after the draft judges anew


def rule_of(mode: Mode) -> Rule:
    """The rule of a named mode. Raises UsageError for another name."""
    if mode not in RULES:
        raise UsageError(f"mode must be one of {', '.join(RULES)}, found {mode!r}")
    return RULES[mode]


@dataclass(frozen=True, eq=False)
class Training(Descent):
    """Outcome of one training. Errors are mean squares in units of the scaled target ([-1, 1]).

    test: error on the samples that were neither trained nor validated on; NaN where there are none.
    """

    test: float = float("nan")

    @property
    def best(self) -> float:
        """Least validation error."""
        return float(self.validation.min())

    def after(self, earlier: Training) -> Training:
        """This training and the one whose answer it started from as one."""
        kept = earlier.iteration + 1
        train, validation = (
            np.concatenate([getattr(earlier, name)[:kept], getattr(self, name)[1:]]) for name in ("train", "validation")
        )
        return replace(self, iteration=earlier.iteration + self.iteration, train=train, validation=validation)


@dataclass(frozen=True, eq=False)
class Scaling:
    """Offsets and gains that map each row of data to [-1, 1] and back (gain = 2 / width; 1 for a constant row)."""

    offset: Array
    gain: Array

    @staticmethod
    def of(rows: Array) -> Scaling:
        """Scaling of data of shape (rows, samples)."""
        low, high = rows.min(axis=1), rows.max(axis=1)
        width = high - low
        return Scaling((low + high) / 2, 2 / np.where(width > 0, width, 2.0))

    def apply(self, rows: Array) -> Array:
        """Scaled rows."""
        return np.asarray((rows - self.offset[:, None]) * self.gain[:, None])


def split_indices(count: int, seed: int) -> dict[str, NDArray[np.intp]]:
    """Random parts "train", "validation" and, with the rest, "test" of ``count`` samples: 70, 15 and 15 %."""
    order = np.random.default_rng(seed).permutation(count)
    ends = [round(0.70 * count), round((0.70 + 0.15) * count)]
    return dict(zip(("train", "validation", "test"), np.split(order, ends), strict=True))


def draw(total: int, count: int, seed: int) -> NDArray[np.intp]:
    """At most ``count`` of ``total`` sample numbers, drawn without replacement, ascending."""
    if total <= count:
        return np.arange(total)
    return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))


@dataclass(frozen=True, eq=False)
class Data:
    """Scaled samples of one regression, split at random: parts "train", "validation", "test" -> (inputs, target)."""

    parts: dict[str, tuple[Array, Array]]
    inputs: Scaling
    target: Scaling

    @staticmethod
    def split(inputs: Array, target: Array, seed: int) -> Data:
        """Random split; inputs of shape (features, samples), target of shape (samples,)."""
        scaling, goal = Scaling.of(inputs), Scaling.of(target[None])
        indices = split_indices(len(target), seed)
        scaled, wanted = scaling.apply(inputs), goal.apply(target[None])[0]
        parts = {name: (scaled[:, pick], wanted[pick]) for name, pick in indices.items()}
        return Data(parts, scaling, goal)

    def network(self, w: Array, hidden: Sequence[int]) -> Network:
        """The trained network on physical units."""
        sizes = (len(self.inputs.gain), *hidden, 1)
        return Network(
            layers_of(np.asarray(w), sizes),
            self.inputs.offset,
            self.inputs.gain,
            float(self.target.offset[0]),
            float(1 / self.target.gain[0]),
        )


def initial_weights(sizes: Sequence[int], rng: np.random.Generator, quiet: slice = slice(0, 0)) -> Array:
    """Nguyen-Widrow (1990): active regions of the hidden neurons spread over [-1, 1]; small random output layer.

    quiet: inputs that start without effect. An input of a few levels only, as a tension set per test, could be met by
    any curve through them; from weights of zero training finds one that hardly bends in between.
    """
    w = np.empty(parameter_count(sizes))
    *hidden, (weights, bias) = unflatten(w, sizes)
    for inner, shift in hidden:
        neurons, inputs = inner.shape
        reach = 0.7 * neurons ** (1 / inputs)
        inner[:] = rng.uniform(-1, 1, inner.shape)
        inner *= reach / np.linalg.norm(inner, axis=1, keepdims=True)
        spread = np.linspace(-1, 1, neurons) if neurons > 1 else np.zeros(1)
        shift[:] = reach * spread * np.where(rng.uniform(-1, 1, neurons) < 0, -1, 1)
    hidden[0][0][:, quiet] = 0.0
    weights[:] = rng.uniform(-0.5, 0.5, weights.shape)
    bias[:] = rng.uniform(-0.5, 0.5, bias.shape)
    return w


_SIMPLE = 1e-4  # of the scaled target's power: what a weight of 1 on a further input has to earn


def simplicity(sizes: Sequence[int], further: slice, samples: int) -> Array | None:
    """Prior on the weights of further inputs in the first layer, for ``CompiledNormal``; None where there are none.

    An input of a few levels only, as a tension set per test, can be met by any curve through them. Of all that fit, the
    prior prefers the least effect. It weighs little beside data: a weight of 1 costs as much as an error of 1 %.
    """
    if further.stop <= further.start:
        return None
    prior = np.zeros(parameter_count(sizes))
    unflatten(prior, sizes)[0][0][:, further] = _SIMPLE * samples
    return prior


def train(
    data: Data,
    hidden: Sequence[int],
    w: Array,
    *,
    rule: Rule = RULES["trainlm"],
    precision: Precision = "float64",
    further: slice = slice(0, 0),
    stop: threading.Event | None = None,
) -> Training:
    """Train from the parameters w. stop: ends the training after the iteration in which it is set.

    further: inputs whose effect is held small (``simplicity``).
    """
    sizes = (len(data.inputs.gain), *hidden, 1)
    parts = {
        name: CompiledNormal(sizes, *part, precision, simplicity(sizes, further, len(part[1])))
        for name, part in data.parts.items()
        if len(part[1])
    }
    result = None
    for count, limited in stages(parts["train"].samples, len(w), rule):
        inputs, target = (rows[..., :count] for rows in data.parts["train"])
        fit = (
            parts["train"]
            if count == len(data.parts["train"][1])
            else CompiledNormal(sizes, inputs, target, precision, simplicity(sizes, further, count))
        )
        stage = descend(fit, parts["validation"], result.w if result else w, limited, stop)
        result = stage.after(result) if result else stage
    assert result is not None
    test = parts["test"].squares(result.w) / parts["test"].samples if "test" in parts else float("nan")
    return replace(result, test=test)


def stages(samples: int, weights: int, rule: Rule) -> list[tuple[int, Rule]]:
    """Stages of a training: how many of the samples, from the first on, each sees, and its own rule."""
    count = max(round(rule.draft * samples), 10 * weights)
    last = max(1, rule.max_iterations // 4)
    if not rule.draft or 2 * count > samples or samples < _DRAFT_FROM or last == rule.max_iterations:
        return [(samples, rule)]
    first = replace(rule, max_iterations=rule.max_iterations - last, max_fails=max(rule.max_fails, _DRAFT_FAILS))
    return [(count, first), (samples, replace(rule, max_iterations=last))]


def descend(fit: KernelSums, check: KernelSums, w: Array, rule: Rule, stop: threading.Event | None = None) -> Training:
    """Lower the error of ``fit`` from w; the answer is the iterate with the least error of ``check``."""
    (found,) = minimise(One(fit), One(check), w[None], rule, stop.is_set if stop else lambda: False)
    return Training(**vars(found))
