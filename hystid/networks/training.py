"""Levenberg-Marquardt training of one tanh network, with early stopping.

A rule is data: how the damping is formed and how its factor mu moves. One loop serves all rules.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hystid.errors import NumericalError, UsageError
from hystid.networks.network import Network
from hystid.networks.normal_equations import NormalEquations, Precision, normal_equations, parameter_count, unflatten
from hystid.recording import Array

Mode = Literal["trainlm", "fast"]
Reason = Literal["validation", "iterations", "damping", "gradient", "stalled", "interrupted"]

REASONS: dict[Reason, str] = {
    "validation": "the validation error had not fallen for the allowed number of iterations",
    "iterations": "the iteration limit was reached",
    "damping": "no step lowers the training error any more (mu above its limit)",
    "gradient": "the gradient vanished",
    "stalled": "the training error fell by less than the stated fraction",
    "interrupted": "the training was interrupted",
}


@dataclass(frozen=True)
class Rule:
    """Damping of J'J. scaling "mean": mu N I (mu damps J'J / N, as MATLAB's trainlm has it); "columns": mu diag(J'J).

    After a step that lowers the error mu is multiplied by ``down``, after one that does not by ``up``.
    The training ends as stalled when ``window`` iterations together lower the training error by less than ``progress``
    (a fraction; 0 never).
    draft: share of the training samples that the first three quarters of the iterations see, 0 for all of them from the
    start. Far from the minimum a few samples per weight give the direction as well; the answer is always one of all
    samples. At least ten samples per weight are taken; where that is above half of the samples, or there are fewer than
    10,000, which are soon trained on anyhow, there is no draft.
    """

    scaling: Literal["mean", "columns"]
    mu: float
    up: float = 10.0
    down: float = 0.1
    mu_max: float = 1e10
    max_iterations: int = 1000
    max_fails: int = 6
    min_gradient: float = 1e-7
    progress: float = 0.0
    window: int = 20
    draft: float = 0.0


# "fast" is Marquardt's own scaling (1963): about a quarter of trainlm's iterations on hysteresis data.
RULES: dict[Mode, Rule] = {
    "trainlm": Rule("mean", 1e-3),
    "fast": Rule("columns", 1.0, max_iterations=200, progress=2e-3, draft=0.2),
}

_DRAFT_FROM = 10_000
_DRAFT_FAILS = 20  # few samples make the validation error uneven, and the stage after the draft judges anew


def rule_of(mode: Mode) -> Rule:
    """The rule of a named mode."""
    if mode not in RULES:
        raise UsageError(f"mode must be one of {', '.join(RULES)}, found {mode!r}")
    return RULES[mode]


@dataclass(frozen=True, eq=False)
class Training:
    """Outcome of one training. Errors are mean squares in units of the scaled target ([-1, 1]).

    w: parameters with the least validation error, shape (P,); iteration: where they were met.
    train, validation: error before the first and after each iteration, shape (iterations + 1,).
    """

    w: Array
    reason: Reason
    iteration: int
    train: Array
    validation: Array
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


def split_indices(count: int, seed: int, fractions: tuple[float, float] = (0.70, 0.15)) -> dict[str, NDArray[np.intp]]:
    """Random parts "train", "validation" and, with the rest, "test" of ``count`` samples."""
    order = np.random.default_rng(seed).permutation(count)
    ends = [round(sum(fractions[: k + 1]) * count) for k in range(2)]
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
    def split(inputs: Array, target: Array, seed: int, fractions: tuple[float, float] = (0.70, 0.15)) -> Data:
        """Random split; inputs of shape (features, samples), target of shape (samples,). The rest is the test part."""
        scaling, goal = Scaling.of(inputs), Scaling.of(target[None])
        indices = split_indices(len(target), seed, fractions)
        scaled, wanted = scaling.apply(inputs), goal.apply(target[None])[0]
        parts = {name: (scaled[:, pick], wanted[pick]) for name, pick in indices.items()}
        return Data(parts, scaling, goal)

    def network(self, w: Array, hidden: Sequence[int]) -> Network:
        """The trained network on physical units."""
        sizes = (len(self.inputs.gain), *hidden, 1)
        layers = tuple((weights.copy(), bias.copy()) for weights, bias in unflatten(np.asarray(w), sizes))
        return Network(
            layers, self.inputs.offset, self.inputs.gain, float(self.target.offset[0]), float(1 / self.target.gain[0])
        )


def initial_weights(sizes: Sequence[int], rng: np.random.Generator) -> Array:
    """Nguyen-Widrow (1990): active regions of the hidden neurons spread over [-1, 1]; small random output layer."""
    w = np.empty(parameter_count(sizes))
    *hidden, (weights, bias) = unflatten(w, sizes)
    for inner, shift in hidden:
        neurons, inputs = inner.shape
        reach = 0.7 * neurons ** (1 / inputs)
        inner[:] = rng.uniform(-1, 1, inner.shape)
        inner *= reach / np.linalg.norm(inner, axis=1, keepdims=True)
        spread = np.linspace(-1, 1, neurons) if neurons > 1 else np.zeros(1)
        shift[:] = reach * spread * np.where(rng.uniform(-1, 1, neurons) < 0, -1, 1)
    weights[:] = rng.uniform(-0.5, 0.5, weights.shape)
    bias[:] = rng.uniform(-0.5, 0.5, bias.shape)
    return w


def train(
    data: Data,
    hidden: Sequence[int],
    w: Array,
    *,
    rule: Rule = RULES["trainlm"],
    precision: Precision = "float64",
    stop: threading.Event | None = None,
) -> Training:
    """Train from the parameters w. stop: ends the training after the iteration in which it is set."""
    sizes = (len(data.inputs.gain), *hidden, 1)
    parts = {name: normal_equations(sizes, *part, precision) for name, part in data.parts.items() if len(part[1])}
    result = None
    for count, limited in stages(parts["train"].samples, len(w), rule):
        inputs, target = (rows[..., :count] for rows in data.parts["train"])
        fit = (
            parts["train"]
            if count == len(data.parts["train"][1])
            else normal_equations(sizes, inputs, target, precision)
        )
        stage = minimise(fit, parts["validation"], result.w if result else w, limited, stop)
        result = stage.after(result) if result else stage
    assert result is not None
    test = parts["test"].squares(result.w) / parts["test"].samples if "test" in parts else float("nan")
    return Training(result.w, result.reason, result.iteration, result.train, result.validation, test)


def stages(samples: int, weights: int, rule: Rule) -> list[tuple[int, Rule]]:
    """Stages of a training: how many of the samples, from the first on, each sees, and its own rule."""
    count = max(round(rule.draft * samples), 10 * weights)
    last = max(1, rule.max_iterations // 4)
    if not rule.draft or 2 * count > samples or samples < _DRAFT_FROM or last == rule.max_iterations:
        return [(samples, rule)]
    first = replace(rule, max_iterations=rule.max_iterations - last, max_fails=max(rule.max_fails, _DRAFT_FAILS))
    return [(count, first), (samples, replace(rule, max_iterations=last))]


def minimise(
    fit: NormalEquations, check: NormalEquations, w: Array, rule: Rule, stop: threading.Event | None = None
) -> Training:
    """Lower the error of ``fit`` from w; the answer is the iterate with the least error of ``check``."""
    best, best_at, reason = w, 0, "iterations"
    train = [fit.squares(w) / fit.samples]
    validation = [check.squares(w) / check.samples]
    if not np.isfinite(train[0]):
        raise NumericalError("the network's error is not finite at its starting weights: is there a NaN in the data?")
    mu = rule.mu
    for iteration in range(1, rule.max_iterations + 1):
        moved, mu, error = _step(fit, w, mu, rule)
        if moved is None:
            reason = "damping" if mu > rule.mu_max else "gradient"
            break
        w = moved
        train.append(error / fit.samples)
        validation.append(check.squares(w) / check.samples)
        if validation[-1] < validation[best_at]:
            best, best_at = w, iteration
        if iteration - best_at >= rule.max_fails:
            reason = "validation"
            break
        if len(train) > rule.window and train[-1] > (1 - rule.progress) * train[-1 - rule.window]:
            reason = "stalled"
            break
        if stop is not None and stop.is_set():
            reason = "interrupted"
            break
    return Training(best, reason, best_at, np.array(train), np.array(validation))  # type: ignore[arg-type]


def _step(fit: NormalEquations, w: Array, mu: float, rule: Rule) -> tuple[Array | None, float, float]:
    """One accepted step: new parameters, next mu, their error. None: the gradient vanished or mu passed its limit."""
    before = fit.build(w)
    gradient, count = fit.gradient(), fit.samples
    if 2 * np.linalg.norm(gradient) / count < rule.min_gradient:
        return None, mu, before
    if rule.scaling == "mean":
        scale = np.full(len(w), float(count))
    else:  # a column of zeros (a saturated neuron) still needs a little damping
        scale = fit.diagonal()
        scale += 1e-12 * scale.max()
    while mu <= rule.mu_max:
        step = fit.solve(mu * scale)
        if step is not None:
            error = fit.squares(w - step)
            if error < before:
                return w - step, max(mu * rule.down, 1e-20), error
        mu *= rule.up
    return None, mu, before
