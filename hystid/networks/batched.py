"""Levenberg-Marquardt for many networks of one structure at a time, in torch: on a GPU, or where there is no compiler.

The rule is that of ``training``; each network has its own mu, accepts its own steps and stops for its own reason. On a
processor the compiled kernel is several times faster; here the batch fills a GPU instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hystid.errors import UsageError
from hystid.networks.normal_equations import parameter_count
from hystid.networks.training import Data, Reason, Rule, Training, stages
from hystid.recording import Array

_CHUNK = 2_000_000  # elements of one chunk of the Jacobian, all networks together


def _torch() -> Any:
    try:
        import torch
    except ImportError:
        raise UsageError("training on a torch device needs torch: install hystid[train]") from None
    return torch


class _Batch:
    """Sums of squares and normal equations of E networks on inputs (E, features, N) and targets (E, N)."""

    def __init__(self, sizes: Sequence[int], inputs: Any, target: Any) -> None:
        self.sizes, self.inputs, self.target = tuple(sizes), inputs, target
        self.samples, self.count = target.shape[1], parameter_count(sizes)
        self.length = max(64, _CHUNK // (self.count * len(target)))

    def _layers(self, w: Any) -> list[tuple[Any, Any]]:
        layers, at = [], 0
        for ni, no in pairwise(self.sizes):
            end = at + ni * no
            layers.append((w[:, at:end].reshape(-1, no, ni), w[:, end : end + no, None]))
            at = end + no
        return layers

    def _forward(self, layers: list[tuple[Any, Any]], part: slice) -> tuple[list[Any], Any]:
        acts = [self.inputs[:, :, part]]
        for weights, bias in layers[:-1]:
            acts.append((weights @ acts[-1] + bias).tanh())
        weights, bias = layers[-1]
        return acts, (weights @ acts[-1] + bias)[:, 0] - self.target[:, part]

    def squares(self, w: Any) -> Any:
        """Sums of squared residuals, shape (E,)."""
        layers = self._layers(w)
        return sum((self._forward(layers, part)[1] ** 2).sum(1) for part in self._parts())

    def build(self, w: Any) -> tuple[Any, Any, Any]:
        """Sums of squares (E,), J'J (E, P, P) and J'e (E, P)."""
        sums = 0
        for part in self._parts():
            rows = self._rows(w, part)
            sums = sums + rows @ rows.transpose(1, 2)
        return sums[:, -1, -1], sums[:, :-1, :-1], sums[:, -1, :-1]  # type: ignore[index]

    def _rows(self, w: Any, part: slice) -> Any:
        torch, layers = _torch(), self._layers(w)
        acts, residual = self._forward(layers, part)
        delta, rows = torch.ones_like(residual)[:, None], [residual[:, None]]
        for (weights, _), below in zip(reversed(layers), reversed(acts), strict=True):
            products = (delta[:, :, None] * below[:, None]).reshape(len(w), -1, residual.shape[1])
            rows[:0] = [products, delta]
            delta = (weights.transpose(1, 2) @ delta) * (1 - below * below)
        return torch.cat(rows, 1)

    def _parts(self) -> list[slice]:
        return [slice(k, k + self.length) for k in range(0, self.samples, self.length)]


@dataclass
class _Progress:
    """State of all networks: w (E, P), mu (E,), and per network its history, best iterate and reason."""

    w: Any
    mu: Any
    train: list[list[float]]
    validation: list[list[float]]
    best: Any
    best_at: list[int]
    reason: list[Reason | None]

    @property
    def running(self) -> list[int]:
        return [k for k, reason in enumerate(self.reason) if reason is None]


def train_batch(
    data: Sequence[Data], hidden: Sequence[int], starts: Array, *, rule: Rule, device: str = "cpu"
) -> list[Training]:
    """Train E networks, one for each data set and row of ``starts``, shape (E, P); answers as ``training.train`` gives.

    The data sets must have the same split sizes. device: a torch device such as "cuda" or "cpu"; float64.
    Raises UsageError where torch or the device is not there.
    """
    torch = _torch()
    try:
        w = torch.tensor(np.asarray(starts), dtype=torch.float64, device=device)
    except (RuntimeError, AssertionError) as error:
        raise UsageError(f"device {device!r} cannot be used: {str(error).splitlines()[0]}") from None
    sizes = (len(data[0].inputs.gain), *hidden, 1)
    fit, check, test = (_Batch(sizes, *_tensors(data, name, w)) for name in ("train", "validation", "test"))
    results: list[Training] = []
    for count, limited in stages(fit.samples, w.shape[1], rule):
        part = _Batch(sizes, fit.inputs[..., :count], fit.target[..., :count])
        state = _start(part, check, w, limited)
        for iteration in range(1, limited.max_iterations + 1):
            if not state.running:
                break
            _iterate(part, check, state, iteration, limited)
        w, ended = state.best, _trainings(state, (test.squares(state.best) / max(test.samples, 1)).tolist())
        results = [stage.after(earlier) for stage, earlier in zip(ended, results, strict=True)] if results else ended
    return results


def _trainings(state: _Progress, test: list[float]) -> list[Training]:
    return [
        Training(best, reason or "iterations", at, np.array(train), np.array(validation), error)
        for best, reason, at, train, validation, error in zip(
            state.best.cpu().numpy(), state.reason, state.best_at, state.train, state.validation, test, strict=True
        )
    ]


def _tensors(data: Sequence[Data], name: str, like: Any) -> tuple[Any, Any]:
    columns = zip(*(part.parts[name] for part in data), strict=True)
    inputs, target = (_torch().tensor(np.stack(column), dtype=like.dtype, device=like.device) for column in columns)
    return inputs, target


def _start(fit: _Batch, check: _Batch, w: Any, rule: Rule) -> _Progress:
    train = [[value] for value in (fit.squares(w) / fit.samples).tolist()]
    validation = [[value] for value in (check.squares(w) / check.samples).tolist()]
    mu = w.new_full((len(w),), rule.mu)
    return _Progress(w, mu, train, validation, w.clone(), [0] * len(w), [None] * len(w))


def _iterate(fit: _Batch, check: _Batch, state: _Progress, iteration: int, rule: Rule) -> None:
    """One iteration of every network that still runs; the others are carried along unchanged."""
    before, normal, gradient = fit.build(state.w)
    flat = 2 * gradient.norm(dim=1) / fit.samples < rule.min_gradient
    for k in state.running:
        if flat[k]:
            state.reason[k] = "gradient"
    moved, errors = _accept(fit, state, before, normal, gradient, rule)
    validation = (check.squares(state.w) / check.samples).tolist()
    for k in state.running:
        if not moved[k]:
            state.reason[k] = "damping"
            continue
        state.train[k].append(errors[k] / fit.samples)
        state.validation[k].append(validation[k])
        if validation[k] < state.validation[k][state.best_at[k]]:
            state.best_at[k] = iteration
            state.best[k] = state.w[k]
        state.reason[k] = _finished(state.train[k], iteration - state.best_at[k], rule)


def _finished(train: list[float], fails: int, rule: Rule) -> Reason | None:
    if fails >= rule.max_fails:
        return "validation"
    if len(train) > rule.window and train[-1] > (1 - rule.progress) * train[-1 - rule.window]:
        return "stalled"
    return None


def _accept(
    fit: _Batch, state: _Progress, before: Any, normal: Any, gradient: Any, rule: Rule
) -> tuple[list[bool], list[float]]:
    """Raise each network's mu until its step lowers its error, or mu passes its limit. Changes state.w and state.mu."""
    torch = _torch()
    scale = torch.full_like(gradient, float(fit.samples))
    if rule.scaling == "columns":
        scale = normal.diagonal(dim1=1, dim2=2)
        scale = scale + 1e-12 * scale.amax(1, keepdim=True)
    waiting = torch.tensor([reason is None for reason in state.reason], device=state.w.device)
    moved, errors = torch.zeros_like(waiting), before.clone()
    while bool((waiting & (state.mu <= rule.mu_max)).any()):
        factor, failed = torch.linalg.cholesky_ex(normal + torch.diag_embed(state.mu[:, None] * scale))
        step = torch.cholesky_solve(gradient[:, :, None], factor)[:, :, 0]
        usable = waiting & (failed == 0) & (state.mu <= rule.mu_max)
        trial = torch.where(usable[:, None], state.w - step, state.w)
        error = fit.squares(trial)
        better = usable & (error < before)
        state.w = torch.where(better[:, None], trial, state.w)
        errors = torch.where(better, error, errors)
        lowered = (state.mu * rule.down).clamp_min(1e-20)
        raised = torch.where(waiting, state.mu * rule.up, state.mu)
        state.mu = torch.where(better, lowered, raised)
        moved, waiting = moved | better, waiting & ~better
    return moved.tolist(), errors.tolist()
