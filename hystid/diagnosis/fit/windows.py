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
from hystid.diagnosis.fit.problem import Fit, Hypothesis, Problem, Term, standing
from hystid.diagnosis.fit.search import try_fit
from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.diagnosis.prepare.segments import Part
from hystid.modelica import compile_model

Array = NDArray[np.float64]
WINDOW = "HystId.Components.TimeWindow"
_BLOCKS = 40  # blocks of the longest recording between which a window may begin and end
_LEAST_OUT, _LEAST_IN = 0.2, 0.06  # shares of the rows outside and inside a window
_FLAT = (0.02, 0.03)  # mean square, and share of the excess, that may be left outside
_CONTRAST = 0.5  # excess per row inside a window, over the mean excess of a refit without one, at least
_TELLING = 2.0  # excess inside a window over that outside that makes it worth a closer look
_NEVER = (2e9, 2.1e9, 1.0)  # s: a window that no recording reaches
_BY_CHANCE = 4.0  # standard deviations of the mean square of noise in a block, of which there are a hundred or two
_ROUNDS = 8  # of marking the blocks in which something acts
_RAMP = 0.02  # of the longest recording, as a start
_SEEN = 2.0  # noise levels beyond which the force of an effect is seen in a sample
_AS_GOOD = 0.003  # rise of the mean square that is none
_EDGE, _SURE = 0.25, 2.0  # share of a window that its ramp may take, less this many standard errors
_SHOWN = 0.1  # mean square that the effect would have outside if it acted there, over that inside


@dataclass(frozen=True)
class Window:
    """Interval of time [s] from the start of every recording."""

    begin: float
    end: float


Windows = Mapping[int, Window]  # window of each recording by its number; recordings that are not there have none


@dataclass(frozen=True)
class Windowed(Effect):
    """An effect times a window of time; ``inner`` is the effect itself, ``near`` the window as a start.

    owners: numbers of the recordings that have a window of their own (t_on_1, t_off_1, ...), the effect being absent in
    the others; None where one window holds for all.
    """

    inner: Effect = field(default_factory=lambda: Effect("", "", "", None))
    near: Mapping[str, float] = field(default_factory=dict)
    owners: tuple[int, ...] | None = None

    @property
    def lasts(self) -> bool:
        """No: a window is looked into once."""
        return False

    @property
    def law(self) -> Effect:
        """The effect that is switched on and off."""
        return self.inner

    def law_values(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """All parameters but the times of the window."""
        return {name: value for name, value in parameters.items() if name not in self.near}

    def switched(
        self, forces: Sequence[Array], signals: Sequence[Signals], parameters: Mapping[str, float]
    ) -> list[Array]:
        """Forces where the window is open."""
        gates = [_gate(len(f), s.dt, self.times(parameters, s.index)) for f, s in zip(forces, signals, strict=True)]
        return [force * gate for force, gate in zip(forces, gates, strict=True)]

    def forces(self, signals: Sequence[Signals], parameters: Mapping[str, float]) -> list[Array]:
        """Force f [N] over several recordings."""
        return self.switched(self.inner.forces(signals, self.law_values(parameters)), signals, parameters)

    def times(self, parameters: Mapping[str, float], index: int) -> tuple[float, ...]:
        """Beginning, end and ramp [s] in a recording; a window that never opens where it has none."""
        names = self.names(index)
        return tuple(float(parameters[name]) for name in names) if names else _NEVER

    def names(self, index: int) -> tuple[str, ...]:
        """Names of the three parameters in a recording, none where it has no window."""
        _, (on, off, ramp) = _time_window()
        if self.owners is None:
            return on, off, ramp
        return (f"{on}_{index + 1}", f"{off}_{index + 1}", ramp) if index in self.owners else ()

    def grid(self, scales: Scales) -> list[dict[str, float]]:
        """Starting points of the effect itself, in the window as it was found."""
        return [{**point, **self.near} for point in self.inner.grid(scales)]


@cache
def _time_window() -> tuple[CompiledModel, tuple[str, ...]]:
    code = compile_model(WINDOW)
    return CompiledModel(code), tuple(v.name for v in code.variables if v.causality == "parameter")


@lru_cache(maxsize=16)
def _gate(samples: int, dt: float, times: tuple[float, ...]) -> Array:
    model, names = _time_window()
    run = model.simulate({}, dt, parameters=dict(zip(names, times, strict=True)), outputs=("y",), rows=samples)
    return run["y"]


def windowed(effect: Effect, windows: Window | Windows) -> Windowed:
    """The effect, let act in a window whose beginning, end and ramps are fitted like its own parameters."""
    _, (on, off, ramp) = _time_window()
    if isinstance(windows, Window):
        owners, near = None, {on: windows.begin, off: windows.end, ramp: _RAMP * windows.end}
    else:
        owners = tuple(sorted(windows))
        near = {f"{on}_{i + 1}": windows[i].begin for i in owners} | {f"{off}_{i + 1}": windows[i].end for i in owners}
        near[ramp] = _RAMP * max(window.end for window in windows.values())
    return _windowed(effect, near, owners)


def _windowed(effect: Effect, near: Mapping[str, float], owners: tuple[int, ...] | None) -> Windowed:
    model, names = _time_window()
    declared = {v.name: v for v in model.code.variables if v.name in names}
    times = [replace(declared[name.rstrip("0123456789").rstrip("_")], name=name) for name in near]
    own = {item.name: getattr(effect, item.name) for item in fields(Effect)}
    own |= {"shapes": (*effect.shapes, *times), "units": {**effect.units, **{v.name: v.unit for v in times}}}
    return Windowed(**own, inner=effect, near=near, owners=owners)


def has_windows(hypothesis: Hypothesis) -> bool:
    """Whether an effect acts for a part of the time."""
    return any(isinstance(term.effect, Windowed) for term in hypothesis.terms)


def has_own_windows(hypothesis: Hypothesis) -> bool:
    """Whether an effect has a window of its own in each recording."""
    return any(isinstance(term.effect, Windowed) and term.effect.owners is not None for term in hypothesis.terms)


def widest(term: Term) -> int:
    """Number of the recording with the longest window."""
    effect = term.effect
    assert isinstance(effect, Windowed)
    lengths = {i: effect.times(term.values, i)[1] - effect.times(term.values, i)[0] for i in effect.owners or (0,)}
    return max(lengths, key=lambda i: lengths[i])


def for_recording(hypothesis: Hypothesis, index: int | None = None) -> Hypothesis:
    """The hypothesis as it stands in one recording, every window one for all; None: where the window is longest."""
    return replace(hypothesis, terms=tuple(term_for(term, index) for term in hypothesis.terms))


def term_for(term: Term, index: int | None = None) -> Term:
    """The same for one term."""
    effect = term.effect
    if not isinstance(effect, Windowed) or effect.owners is None:
        return term
    times = effect.times(term.values, widest(term) if index is None else index)
    near = dict(zip(_time_window()[1], times, strict=True))
    law = term.law
    return Term(_windowed(effect.inner, near, None), {**law.values, **near})


def in_window_of(effect: Effect, term: Term) -> Effect:
    """Another effect, let act when a term acts; itself where that is all the time."""
    here = term.effect
    if not isinstance(here, Windowed):
        return effect
    return _windowed(effect, {name: term.values[name] for name in here.near}, here.owners)


def window_names(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters that are times of a window, none where the effect acts all the time."""
    return tuple(effect.near) if isinstance(effect, Windowed) else ()


def window_text(term: Term) -> str:
    """A clause about the window of an effect, empty where it acts all the time."""
    effect = term.effect
    if not isinstance(effect, Windowed):
        return ""
    if effect.owners is None:
        begin, end, _ = effect.times(term.values, 0)
        return f", from {begin:.3g} s to {end:.3g} s only"
    return f", in a window of time of its own in {len(effect.owners)} of the recordings"


def windows_of(problem: Problem, before: Fit, floor: float) -> Iterator[tuple[Window | Windows, Fit]]:
    """Windows outside of which the baseline alone reaches the noise, each with the baseline as fitted outside.

    The refit is linear in its parameters here, so that every window costs one small system of equations. Where that is
    too coarse, the baseline is fitted outside of the most telling window, also from the nominal values, and everything
    is compared once more. In the end, windows that differ from recording to recording. None where time was not
    measured.
    """
    for windows, start in _proposed(problem, before, floor) if problem.timed else ():
        fitted = fitted_outside(problem, start, windows)
        if fitted is not None:
            yield windows, fitted


def _proposed(problem: Problem, before: Fit, floor: float) -> Iterator[tuple[Window | Windows, Hypothesis]]:
    """Windows, and where to begin the fit outside of them."""
    here = before.hypothesis
    found = _windows(problem, before)
    seen: set[Window] = set()
    sound = _shortest(found, before, floor)
    if sound is not None:
        seen.add(sound)
        yield sound, here
    telling = min(found, key=lambda split: split.misfit, default=None)
    if telling is not None and telling.inside - floor > _TELLING * (telling.outside - floor):
        for start in (here, replace(here, values={**here.values, **problem.baseline.nominal})):
            again = fitted_outside(problem, start, telling.window)
            other = _shortest(_windows(problem, again), before, floor) if again is not None else None
            if again is not None and other is not None and other not in seen:
                seen.add(other)
                yield other, again.hypothesis
    several = _own_windows(problem, before, floor)
    if several:
        yield several, here


def _own_windows(problem: Problem, before: Fit, floor: float) -> Windows | None:
    """A window of its own in each recording, or none: stretches that stand out, found again while the baseline is
    fitted to the rest; None where that leads to nothing."""
    excess = before.chi2 - floor
    if len(problem.parts) < 2:
        return None
    jacobian, times, spans = _scaled(problem, before), _row_times(problem), [float(p.t[-1]) for p in problem.parts]
    blocks = [np.minimum((t / span * _BLOCKS).astype(int), _BLOCKS - 1) for t, span in zip(times, spans, strict=True)]
    place = np.concatenate([b + i * _BLOCKS for i, b in enumerate(blocks)])
    rows = np.bincount(place, minlength=len(spans) * _BLOCKS)
    rest, marked = before.residual, np.zeros(len(rows), dtype=bool)
    bar = floor + np.maximum(0.5 * excess, _BY_CHANCE * floor * np.sqrt(2 / np.maximum(rows, 1)))
    for _ in range(_ROUNDS):
        level = np.bincount(place, weights=rest**2, minlength=len(rows)) / np.maximum(rows, 1)
        now = np.concatenate([_hull(on) for on in (level > bar).reshape(-1, _BLOCKS)])
        outside = ~now[place]
        if np.mean(outside) < _LEAST_OUT or np.mean(outside) > 1 - _LEAST_IN / 2:
            return None
        step = np.linalg.lstsq(jacobian[outside], before.residual[outside], rcond=1e-9)[0]
        rest = before.residual - jacobian @ step
        if np.array_equal(now, marked):
            break
        marked = now
    flat = float(np.mean(rest[outside] ** 2)) < floor + _FLAT[0] + _FLAT[1] * excess
    if not flat or float(np.mean(rest[~outside] ** 2)) - floor < (1 + _CONTRAST) * excess:
        return None
    found = {}
    for i, (on, span) in enumerate(zip(marked.reshape(-1, _BLOCKS), spans, strict=True)):
        if np.any(on):
            first, last = np.flatnonzero(on)[[0, -1]]
            found[i] = Window(first / _BLOCKS * span, (last + 1) / _BLOCKS * span)
    return found


def _hull(on: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """From the first to the last block that stands out; none where that is a single one among quiet ones."""
    where = np.flatnonzero(on)
    found = np.zeros(len(on), dtype=bool)
    if len(where) > 1:
        found[where[0] : where[-1] + 1] = True
    return found


def _scaled(problem: Problem, fitted: Fit) -> Array:
    jacobian = problem.jacobian(fitted.hypothesis, fitted.unknowns)
    norms = np.linalg.norm(jacobian, axis=0)
    return np.asarray(jacobian / np.where(norms > 0, norms, 1.0))


def _row_times(problem: Problem) -> list[Array]:
    return [problem.reduce.plain(i, part.t) for i, part in enumerate(problem.parts)]


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
        outside, inside = (float(np.log(max(level, 1e-300))) for level in (self.outside, self.inside))
        return (1 - self.share) * outside + self.share * inside


def _windows(problem: Problem, fitted: Fit) -> list[_Split]:
    """All windows between blocks of time that leave enough outside and inside."""
    times = np.concatenate(_row_times(problem))
    span = max(float(part.t[-1]) for part in problem.parts)
    place = np.minimum((times / span * _BLOCKS).astype(int), _BLOCKS - 1)
    sums = _Sums(_scaled(problem, fitted), fitted.residual, place)
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


def fitted_outside(problem: Problem, start: Hypothesis, windows: Window | Windows) -> Fit | None:
    """The baseline as fitted outside of the windows, judged on everything; None where that has no finite answer."""
    each = dict.fromkeys(range(len(problem.parts)), windows) if isinstance(windows, Window) else windows
    parts = [_without(part, each[i]) if i in each else part for i, part in enumerate(problem.parts)]
    made = try_fit(problem.of(parts), start, 25)
    if made is None:
        return None
    return standing(problem, made.hypothesis)


def _without(part: Part, window: Window) -> Part:
    outside = (part.t < window.begin) | (part.t > window.end)
    return replace(part, valid=outside if part.valid is None else np.logical_and(outside, part.valid))


def edges(problem: Problem, hypothesis: Hypothesis, term: Term) -> dict[str, tuple[float, float]]:
    """Between which times [s] windows may open, and close: from one time at which the effect acts, or would have
    been seen, to the next. Impacts, for example, say nothing in between."""
    effect = term.effect
    if not isinstance(effect, Windowed):
        return {}
    law = term.law
    forces = law.effect.forces(problem.signals(hypothesis), law.values)
    noise = [part.balance_noise(problem.baseline.mass) for part in problem.parts]
    pairs = zip(problem.parts, forces, noise, strict=True)
    seen = [part.t[np.abs(force) > _SEEN * level] for part, force, level in pairs]
    if effect.owners is None:
        end = max(float(part.t[-1]) for part in problem.parts)
        return _between(np.concatenate(seen), end, effect.names(0), term)
    found: dict[str, tuple[float, float]] = {}
    for i in effect.owners:
        found |= _between(seen[i], float(problem.parts[i].t[-1]), effect.names(i), term)
    return found


def _between(seen: Array, end: float, names: Sequence[str], term: Term) -> dict[str, tuple[float, float]]:
    on, off = names[0], names[1]
    times = np.sort(np.concatenate([seen, [0.0, end]]))
    opens, closes = float(term.values[on]), float(term.values[off])
    inner = times[(times > opens) & (times < closes)]
    if not len(inner):
        return {}
    before, after = times[times <= opens], times[times >= closes]
    return {
        on: (float(before[-1]) if len(before) else 0.0, float(inner[0])),
        off: (float(inner[-1]), float(after[0]) if len(after) else end),
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


def has_edges(fitted: Fit) -> bool:
    """Whether the windows of the last effect open and close at once, against the time that they are open. What comes
    or goes over most of it, and is seen to, is wear or drift, and no law of the library that is switched on and off."""
    index, term = len(fitted.hypothesis.terms) - 1, fitted.hypothesis.terms[-1]
    effect = term.effect
    if not isinstance(effect, Windowed):
        return False
    widths = []
    for recording in effect.owners or (0,):
        on, off, ramp = effect.names(recording)
        surely = term.values[ramp] - _SURE * float(np.nan_to_num(fitted.stderr((str(index), ramp))))
        widths.append(surely / (term.values[off] - term.values[on]))
    return max(widths) < _EDGE


def is_off_outside(term: Term, signals: Sequence[Signals]) -> bool:
    """Whether the effect would have been seen outside of its window, had it acted there: else the window says
    nothing but that the motion was small."""
    effect = term.effect
    if not isinstance(effect, Windowed):
        return False
    law = term.law
    inside, outside = [], []
    for s, force in zip(signals, law.effect.forces(signals, law.values), strict=True):
        gate = _gate(len(s.x), s.dt, effect.times(term.values, s.index))
        inside.append(force[gate > 0.5] ** 2)
        outside.append(force[gate == 0] ** 2)
    within, beyond = np.concatenate(inside), np.concatenate(outside)
    if not len(within) or len(beyond) < _LEAST_OUT * (len(within) + len(beyond)):
        return False
    return float(np.mean(beyond)) > _SHOWN * float(np.mean(within))
