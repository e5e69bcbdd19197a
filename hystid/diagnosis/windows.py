"""Effects that act for a part of the time: where the window is, and effects that are let act in it.

A refit over everything spreads such an effect over the whole recording. Outside the right window the baseline alone
reaches the noise; that is how the window is found, before any law is thought of.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from hystid.compiled import CompiledModel
from hystid.diagnosis.blocks import Effect, Scales, Signals
from hystid.diagnosis.fitting import Fit, Hypothesis, Problem, Term, fit
from hystid.diagnosis.parts import Part
from hystid.modelica import compile_model

Array = NDArray[np.float64]
WINDOW = "HystId.Components.TimeWindow"
_BLOCKS = 40  # blocks of the longest recording between which a window may begin and end
_LEAST_OUT, _LEAST_IN = 0.2, 0.06  # shares of the rows outside and inside a window
_FLAT = (0.02, 0.03)  # mean square, and share of the excess, that may be left outside
_CONTRAST = 0.5  # excess per row inside a window, over the mean excess of a refit without one, at least
_TELLING = 2.0  # excess inside a window over that outside that makes it worth a closer look
_RAMP = 0.02  # of the longest recording, as a start
_SEEN = 2.0  # noise levels beyond which the force of an effect is seen in a sample
_AS_GOOD = 0.003  # rise of the mean square that is none
_SHOWN = 0.1  # mean square that the effect would have outside if it acted there, over that inside


@dataclass(frozen=True)
class Window:
    """Interval of time [s] from the start of every recording."""

    begin: float
    end: float


@dataclass(frozen=True)
class Windowed(Effect):
    """An effect times a window of time; ``inner`` is the effect itself, ``near`` the window as a start."""

    inner: Effect = field(default_factory=lambda: Effect("", "", "", None))
    near: Mapping[str, float] = field(default_factory=dict)

    def forces(self, signals: Sequence[Signals], parameters: Mapping[str, float]) -> list[Array]:
        """Force f [N] over several recordings."""
        law = {name: value for name, value in parameters.items() if name not in self.near}
        times = tuple(float(parameters[name]) for name in self.near)
        found = self.inner.forces(signals, law)
        return [force * _gate(len(force), s.dt, times) for force, s in zip(found, signals, strict=True)]

    def grid(self, scales: Scales) -> list[dict[str, float]]:
        """Starting points of the effect itself, in the window as it was found."""
        return [{**point, **self.near} for point in self.inner.grid(scales)]


@cache
def _time_window() -> tuple[CompiledModel, tuple[str, ...]]:
    code = compile_model(WINDOW)
    return CompiledModel(code), tuple(v.name for v in code.variables if v.causality == "parameter")


@lru_cache(maxsize=64)
def _gate(samples: int, dt: float, times: tuple[float, ...]) -> Array:
    model, names = _time_window()
    run = model.simulate({}, dt, parameters=dict(zip(names, times, strict=True)), outputs=("y",), rows=samples)
    return run["y"]


def windowed(effect: Effect, window: Window) -> Windowed:
    """The effect, let act in a window whose beginning, end and ramps are fitted like its own parameters."""
    model, names = _time_window()
    times = [v for v in model.code.variables if v.name in names]
    ramp = _RAMP * window.end
    near = dict(zip(names, (window.begin, window.end, ramp), strict=True))
    own = {item.name: getattr(effect, item.name) for item in fields(Effect)}
    own |= {"shapes": (*effect.shapes, *times), "units": {**effect.units, **{v.name: v.unit for v in times}}}
    return Windowed(**own, inner=effect, near=near)


def unwindowed(term: Term) -> Term:
    """The same law, acting all the time."""
    if not isinstance(term.effect, Windowed):
        return term
    return Term(term.effect.inner, {k: value for k, value in term.values.items() if k not in term.effect.near})


def window_names(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters that are times of a window, none where the effect acts all the time."""
    return tuple(effect.near) if isinstance(effect, Windowed) else ()


def windows_of(problem: Problem, before: Fit, floor: float) -> Iterator[tuple[Window, Fit]]:
    """Windows outside of which the baseline alone reaches the noise, each with the baseline as fitted outside.

    The refit is linear in its parameters here, so that every window costs one small system of equations. Where that is
    too coarse, the baseline is fitted outside of the most telling window, also from the nominal values, and everything
    is compared once more.
    """
    found = _windows(problem, before)
    sound = _shortest(found, before, floor)
    seen = {sound}
    if sound is not None:
        yield sound, fitted_outside(problem, before.hypothesis, sound)
    telling = min(found, key=lambda split: split.misfit, default=None)
    if telling is None or telling.inside - floor < _TELLING * (telling.outside - floor):
        return
    nominal = replace(before.hypothesis, values={**before.hypothesis.values, **problem.baseline.nominal})
    fits = [fitted_outside(problem, start, telling.window) for start in (before.hypothesis, nominal)]
    for again in fits:
        other = _shortest(_windows(problem, again), before, floor)
        if other is not None and other not in seen:
            seen.add(other)
            yield other, fitted_outside(problem, again.hypothesis, other)


@dataclass(frozen=True)
class _Split:
    """A window with its share of the rows, and the mean squares outside and inside it."""

    window: Window
    share: float
    outside: float
    inside: float

    @property
    def misfit(self) -> float:
        """Twice the negative logarithm of the likelihood per row, noise of one level outside and another inside."""
        return (1 - self.share) * float(np.log(self.outside)) + self.share * float(np.log(self.inside))


def _windows(problem: Problem, fitted: Fit) -> list[_Split]:
    """All windows between blocks of time that leave enough outside and inside."""
    jacobian = problem.jacobian(fitted.hypothesis, fitted.unknowns)
    norms = np.linalg.norm(jacobian, axis=0)
    times = np.concatenate([problem.reduce.plain(i, part.t) for i, part in enumerate(problem.parts)])
    span = max(float(part.t[-1]) for part in problem.parts)
    place = np.minimum((times / span * _BLOCKS).astype(int), _BLOCKS - 1)
    sums = _Sums(jacobian / np.where(norms > 0, norms, 1.0), fitted.residual, place)
    found = []
    for first in range(_BLOCKS):
        for last in range(first + 1, _BLOCKS + 1):
            share = sums.share(first, last)
            if _LEAST_IN <= share <= 1 - _LEAST_OUT:
                window = Window(first / _BLOCKS * span, last / _BLOCKS * span)
                found.append(_Split(window, share, *sums.split(first, last)))
    return found


def _shortest(found: Sequence[_Split], before: Fit, floor: float) -> Window | None:
    excess = before.chi2 - floor
    flat = floor + _FLAT[0] + _FLAT[1] * excess
    sound = [s for s in found if s.outside < flat and s.inside - floor > (1 + _CONTRAST) * excess]
    return min(sound, key=lambda s: (s.share, s.outside)).window if sound else None


class _Sums:
    """Normal equations of the refit per block of time, accumulated."""

    def __init__(self, jacobian: Array, residual: Array, place: NDArray[np.int64]) -> None:
        count = jacobian.shape[1]
        self._normal = np.zeros((_BLOCKS + 1, count, count))
        self._right = np.zeros((_BLOCKS + 1, count))
        self._square, self._rows = np.zeros(_BLOCKS + 1), np.zeros(_BLOCKS + 1)
        for block in range(_BLOCKS):
            here = place == block
            rows, rest = jacobian[here], residual[here]
            self._normal[block + 1] = self._normal[block] + rows.T @ rows
            self._right[block + 1] = self._right[block] + rows.T @ rest
            self._square[block + 1] = self._square[block] + rest @ rest
            self._rows[block + 1] = self._rows[block] + len(rest)

    def share(self, first: int, last: int) -> float:
        """Share of the rows in blocks first .. last - 1."""
        return float((self._rows[last] - self._rows[first]) / self._rows[-1])

    def split(self, first: int, last: int) -> tuple[float, float]:
        """Mean squares outside and inside, when the baseline is fitted outside."""
        normal, right, square, rows = (
            sums[last] - sums[first] for sums in (self._normal, self._right, self._square, self._rows)
        )
        around = self._normal[-1] - normal
        around[np.diag_indices_from(around)] += 1e-9
        step = np.linalg.solve(around, self._right[-1] - right)
        inside = square - 2 * step @ right + step @ normal @ step
        whole = self._square[-1] - 2 * step @ self._right[-1] + step @ self._normal[-1] @ step
        return float((whole - inside) / (self._rows[-1] - rows)), float(inside / rows)


def fitted_outside(problem: Problem, start: Hypothesis, window: Window) -> Fit:
    """The baseline as fitted outside of the window, judged on everything. Raises NumericalError as ``fit`` does."""
    parts = [_without(part, window) for part in problem.parts]
    here = fit(problem.of(parts), start).hypothesis
    rows = problem.rows(here)
    return Fit(here, rows, float(np.mean(rows**2)), problem.unknowns(here))


def _without(part: Part, window: Window) -> Part:
    outside = (part.t < window.begin) | (part.t > window.end)
    return replace(part, valid=outside if part.valid is None else np.logical_and(outside, part.valid))


def edges(problem: Problem, hypothesis: Hypothesis, term: Term) -> dict[str, tuple[float, float]]:
    """Between which times [s] the window may open, and close: from one time at which the effect acts, or would have
    been seen, to the next. Impacts, for example, say nothing in between."""
    if not isinstance(term.effect, Windowed):
        return {}
    law, (on, off, _) = unwindowed(term), term.effect.near
    begin, end = (float(term.values[name]) for name in (on, off))
    seen: list[Array] = []
    for signals, part in zip(problem.signals(hypothesis), problem.parts, strict=True):
        force = np.abs(law.effect.force(signals, law.values))
        seen.append(part.t[force > _SEEN * part.balance_noise(problem.baseline.mass)])
    times = np.sort(np.concatenate([*seen, [0.0, max(float(part.t[-1]) for part in problem.parts)]]))
    inner = times[(times > begin) & (times < end)]
    if not len(inner):
        return {}
    return {
        on: (float(times[times <= begin][-1]), float(inner[0])),
        off: (float(inner[-1]), float(times[times >= end][0])),
    }


def settled(problem: Problem, fitted: Fit) -> Fit:
    """The fit with every window opened and closed in the middle of what the recordings leave open."""
    here = fitted.hypothesis
    terms = []
    for term in here.terms:
        middle = {name: sum(pair) / 2 for name, pair in edges(problem, here, term).items()}
        terms.append(replace(term, values={**term.values, **middle}))
    there = replace(here, terms=tuple(terms))
    rows = problem.rows(there)
    chi2 = fitted.chi2 * float(rows @ rows) / fitted.rss
    return replace(fitted, hypothesis=there, residual=rows, chi2=chi2) if chi2 < fitted.chi2 + _AS_GOOD else fitted


def is_off_outside(term: Term, signals: Sequence[Signals]) -> bool:
    """Whether the effect would have been seen outside of its window, had it acted there: else the window says
    nothing but that the motion was small."""
    if not isinstance(term.effect, Windowed):
        return False
    law = unwindowed(term)
    times = tuple(float(term.values[name]) for name in term.effect.near)
    inside, outside = [], []
    for s in signals:
        gate = _gate(len(s.x), s.dt, times)
        power = law.effect.force(s, law.values) ** 2
        inside.append(power[gate > 0.5])
        outside.append(power[gate == 0])
    within, beyond = np.concatenate(inside), np.concatenate(outside)
    if not len(within) or len(beyond) < _LEAST_OUT * (len(within) + len(beyond)):
        return False
    return float(np.mean(beyond)) > _SHOWN * float(np.mean(within))
