"""Levenberg-Marquardt for many networks of one structure at a time, in torch, for a GPU.

The loop is that of ``leastsquares``; the sums lie on the device. On a processor the compiled kernel is several times
faster; here the batch fills a GPU instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.errors import UsageError, first_line
from hystid.leastsquares import Rule, minimise
from hystid.networks.normal_equations import parameter_count, unflatten
from hystid.networks.training import Data, Training, stages
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
        self._sums: Any = None
        self.length = max(64, _CHUNK // (self.count * len(target)))

    def _layers(self, w: Any) -> list[tuple[Any, Any]]:
        return [(weights, bias[..., None]) for weights, bias in unflatten(w, self.sizes)]

    def _forward(self, layers: list[tuple[Any, Any]], part: slice) -> tuple[list[Any], Any]:
        acts = [self.inputs[:, :, part]]
        for weights, bias in layers[:-1]:
            acts.append((weights @ acts[-1] + bias).tanh())
        weights, bias = layers[-1]
        return acts, (weights @ acts[-1] + bias)[:, 0] - self.target[:, part]

    def squares(self, w: Array) -> Array:
        """Sums of squared residuals, shape (E,)."""
        layers = self._layers(self._here(w))
        return np.asarray(sum((self._forward(layers, part)[1] ** 2).sum(1) for part in self._parts()).cpu().numpy())

    def build(self, w: Array) -> Array:
        """As ``squares``; J'J (E, P, P) and J'e (E, P) stay on the device."""
        sums = 0
        for part in self._parts():
            rows = self._rows(self._here(w), part)
            sums = sums + rows @ rows.transpose(1, 2)
        self._sums = sums
        return np.asarray(sums[:, -1, -1].cpu().numpy())  # type: ignore[index]

    def diagonal(self) -> Array:
        return np.asarray(self._sums[:, :-1, :-1].diagonal(dim1=1, dim2=2).cpu().numpy())

    def gradient(self) -> Array:
        return np.asarray(self._sums[:, -1, :-1].cpu().numpy())

    def solve(self, damping: Array) -> tuple[Array, NDArray[np.bool_]]:
        torch = _torch()
        matrix = self._sums[:, :-1, :-1] + torch.diag_embed(self._here(damping))
        factor, failed = torch.linalg.cholesky_ex(matrix)
        step = torch.cholesky_solve(self._sums[:, -1, :-1, None], factor)[:, :, 0]
        definite = (failed == 0).cpu().numpy()
        return np.where(definite[:, None], step.cpu().numpy(), 0.0), definite

    def _here(self, values: Array) -> Any:
        return _torch().as_tensor(values, dtype=self.target.dtype, device=self.target.device)

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
        raise UsageError(f"device {device!r} cannot be used: {first_line(error)}") from None
    sizes = (len(data[0].inputs.gain), *hidden, 1)
    fit, check, test = (_Batch(sizes, *_tensors(data, name, w)) for name in ("train", "validation", "test"))
    results: list[Training] = []
    for count, limited in stages(fit.samples, w.shape[1], rule):
        part = _Batch(sizes, fit.inputs[..., :count], fit.target[..., :count])
        ended = [Training(**vars(found)) for found in minimise(part, check, starts, limited)]
        results = [stage.after(earlier) for stage, earlier in zip(ended, results, strict=True)] if results else ended
        starts = np.stack([training.w for training in results])
    errors = test.squares(starts) / max(test.samples, 1)
    return [replace(training, test=float(error)) for training, error in zip(results, errors, strict=True)]


def _tensors(data: Sequence[Data], name: str, like: Any) -> tuple[Any, Any]:
    columns = zip(*(part.parts[name] for part in data), strict=True)
    inputs, target = (_torch().tensor(np.stack(column), dtype=like.dtype, device=like.device) for column in columns)
    return inputs, target
