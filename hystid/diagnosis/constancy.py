"""Are the parameters of a named law parameters: the same in every recording, and at small and large motion?

A law of the wrong form, fitted to everything at once, strikes an average. Recording by recording, or at other
amplitudes, it would have other values, and the residual says so to first order without another fit: the columns of its
parameters, each restricted to a part of the rows, still explain something.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hystid.diagnosis.fitting import Fit, Problem
from hystid.diagnosis.parts import Part
from hystid.diagnosis.search import Complement, complement
from hystid.diagnosis.sensors import ChannelEffect

Array = NDArray[np.float64]
_LEVELS, _MOST = 3, 8  # groups of rows by the amplitude of the motion, and by recordings at most
_INDEPENDENT = 1e-3  # singular value of columns of unit length, below which a direction is one that is fitted already
_VISIBLE = 0.01  # fall of the mean square below which noise and the form of a right law may vary a parameter,
_SHARE = 0.04  # and that over what the effects explain: right laws in another form than the library's reach 0.03


def are_constant(problem: Problem, before: Fit, fitted: Fit) -> bool:
    """Whether the parameters of every effect of a fit are the same in all recordings, and at all amplitudes."""
    return variation(problem, fitted) < max(_VISIBLE, _SHARE * (before.chi2 - fitted.chi2))


def variation(problem: Problem, fitted: Fit) -> float:
    """Largest fall of the mean square, beyond that by noise, where the parameters of one effect may differ between
    recordings or between levels of amplitude. Faults of a channel differ by nature and are left out."""
    hypothesis = fitted.hypothesis
    unknowns = problem.unknowns(hypothesis)
    jacobian = problem.jacobian(hypothesis, unknowns)
    rows = problem.rows(hypothesis)
    outside = complement(problem, replace(fitted, unknowns=unknowns))
    found = 0.0
    for groups in (_recordings(problem), _levels(problem)):
        for index, term in enumerate(hypothesis.terms):
            own = [k for k, unknown in enumerate(unknowns) if unknown.key[0] == str(index)]
            if own and not isinstance(term.effect, ChannelEffect):
                split = np.concatenate([jacobian[:, own] * (groups == g)[:, None] for g in np.unique(groups)], axis=1)
                found = max(found, _gain(split, outside, rows))
    return found


def _gain(columns: Array, outside: Complement, rows: Array) -> float:
    """Fall of the mean square by columns beyond those that are fitted, less that by as many columns of noise."""
    norms = np.linalg.norm(columns, axis=0)
    if not np.any(norms > 0):
        return 0.0
    rest = outside(columns[:, norms > 0] / norms[norms > 0])
    left, size, _ = np.linalg.svd(rest, full_matrices=False)
    free = left[:, size > _INDEPENDENT]
    return float((np.sum((free.T @ rows) ** 2) - free.shape[1]) / len(rows))


def _recordings(problem: Problem) -> NDArray[np.int64]:
    """Number of the recording of each row; of the group of recordings where there are many."""
    count = len(problem.parts)
    groups = min(count, _MOST)
    lengths = [len(problem.reduce.plain(i, part.t)) for i, part in enumerate(problem.parts)]
    return np.repeat(np.arange(count) * groups // count, lengths)


def _levels(problem: Problem) -> NDArray[np.int64]:
    """Level of amplitude of each row: equal counts, from small to large."""
    height = np.concatenate([problem.reduce.plain(i, _envelope(part)) for i, part in enumerate(problem.parts)])
    return np.asarray(np.digitize(height, np.quantile(height, np.arange(1, _LEVELS) / _LEVELS)))


def _envelope(part: Part) -> Array:
    """Largest displacement within a mean period of the motion [m]."""
    x = part.x - np.mean(part.x)
    power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    cycles = float(np.arange(len(power)) @ power) / (float(np.sum(power)) or 1.0)
    return np.asarray(maximum_filter1d(np.abs(x), int(max(5, len(x) / max(cycles, 1.0)))))
