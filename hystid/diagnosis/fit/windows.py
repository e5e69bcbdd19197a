"""Effects that act for a part of the time: where the window is, and effects that are let act in it.

A refit over everything spreads such an effect over the whole recording. ``windowscan`` finds law and window together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, lru_cache
from types import MappingProxyType

import numpy as np

from hystid.compiled import CompiledModel
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.modelica import compile_model
from hystid.numeric import Array

WINDOW = "HystId.Components.TimeWindow"
LEAST_OUT = 0.2  # share of the rows outside of windows, at least
_NEVER = (2e9, 2.1e9, 1.0)  # s: a window that no recording reaches
_ALIKE_WINDOWS = 0.05  # of the longest recording: windows that differ by less may be one
_RAMP = 0.02  # of the longest recording, as a start
_SEEN = 2.0  # noise levels beyond which the force of an effect is seen in a sample
_AS_GOOD = 0.003  # rise of the mean square that is none
_EDGE, _RAMP_ERRORS = 0.25, 2.0  # share of a window that its ramp may take, less this many standard errors
_SHOWN_OUTSIDE = 0.1  # mean square that the effect would have outside if it acted there, over that inside


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
    def meanings(self) -> dict[str, str]:
        """What each parameter is, times of the window among them."""
        return {**super().meanings, **{v.name: v.description for v in self.shapes}}

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

    def forces_at(self, signals: Sequence[Signals], each: Sequence[Mapping[str, float]]) -> list[list[Array]]:
        """``forces`` at each of several values of the parameters."""
        plain = self.inner.forces_at(signals, [self.law_values(at) for at in each])
        return [self.switched(forces, signals, at) for forces, at in zip(plain, each, strict=True)]

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

    def grid(self, scales: Scales, near: Mapping[str, float] = MappingProxyType({})) -> list[dict[str, float]]:
        """Starting points of the effect itself, in the window as it was found."""
        return [{**point, **self.near} for point in self.inner.grid(scales, near)]


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
    times = []
    for name in near:
        time, number = declared[name.rstrip("0123456789").rstrip("_")], name.rpartition("_")[2]
        where = f", in recording {number}" if number.isdigit() else ""
        times.append(replace(time, name=name, description=f"{time.description}{where}"))
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


def shared(problem: Problem, hypothesis: Hypothesis) -> Hypothesis | None:
    """The hypothesis with one window for all recordings in the place of their own; None where these differ.

    A recording that ends before a window closes, or opens, says nothing about the time at which it does.
    """
    term = hypothesis.terms[-1]
    effect = term.effect
    if not isinstance(effect, Windowed) or effect.owners is None or len(problem.parts) < 2:
        return None
    ends = [float(part.t[-1]) for part in problem.parts]
    times = {i: effect.times(term.values, i) for i in effect.owners}
    apart = _ALIKE_WINDOWS * max(ends)
    on = [begin for begin, _, _ in times.values()]
    off = [end for i, (_, end, _) in times.items() if end < ends[i] - apart]
    begin, end = float(np.median(on)), float(np.median(off)) if off else max(ends)
    agree = all(abs(there - begin) < apart for there in on) and all(abs(there - end) < apart for there in off)
    late = all(end > there - apart for i, there in enumerate(ends) if i in times and times[i][1] >= there - apart)
    if not agree or not late or any(there > begin + apart for i, there in enumerate(ends) if i not in times):
        return None
    near = dict(zip(_time_window()[1], (begin, end, next(iter(times.values()))[2]), strict=True))
    made = Term(_windowed(effect.inner, near, None), {**term.law.values, **near})
    return hypothesis.exchanged(-1, made)


def in_window_of(effect: Effect, term: Term) -> Effect:
    """Another effect, let act when a term acts; itself where that is all the time."""
    here = term.effect
    if not isinstance(here, Windowed):
        return effect
    return _windowed(effect, {name: term.values[name] for name in here.near}, here.owners)


def window_names(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters that are times of a window, none where the effect acts all the time."""
    return tuple(effect.near) if isinstance(effect, Windowed) else ()


def window_text(problem: Problem, term: Term) -> str:
    """A clause about the window of an effect, empty where it acts all the time."""
    effect = term.effect
    if not isinstance(effect, Windowed):
        return ""
    whole = whole_recordings(problem, term)
    if effect.owners is not None and len(effect.owners) > 1:
        if len(whole) == len(effect.owners) < len(problem.parts):
            return f", all the time in {' and '.join(problem.parts[owner].name for owner in whole)}, and in no other"
        return f", in a window of time of its own in {len(effect.owners)} of the recordings"
    owner, only = (0, " only") if effect.owners is None else (effect.owners[0], "")
    begin, end, _ = effect.times(term.values, owner)
    last = lasting(problem, term).get(effect.names(owner)[1])
    return "" if whole else f", from {begin:.3g} s to " + (f"{end:.3g} s{only}" if last is None else "the end")


def whole_recordings(problem: Problem, term: Term) -> list[int]:
    """Numbers of the recordings that a window of their own takes as a whole; [] for an effect without such windows."""
    effect, found = term.effect, list[int]()
    if isinstance(effect, Windowed):
        for owner in effect.owners or ():
            begin, end, _ = effect.times(term.values, owner)
            length = float(problem.parts[owner].t[-1])
            found += [owner] if min(end, length) - max(begin, 0.0) > (1 - _ALIKE_WINDOWS) * length else []
    return found


def lasting(problem: Problem, term: Term) -> dict[str, float]:
    """Beginnings and ends [s] of recordings by the names of the parameters that open a window only before them, or
    close it only after: no recording tells where."""
    effect, ends = term.effect, [float(part.t[-1]) for part in problem.parts]
    if not isinstance(effect, Windowed):
        return {}
    last = {0: max(ends)} if effect.owners is None else {owner: ends[owner] for owner in effect.owners}
    found = dict[str, float]()
    whole = whole_recordings(problem, term)
    for owner, end in last.items():
        opens, closes, ramp = effect.names(owner)
        found |= {closes: end} if term.values[closes] > end else {}
        found |= {opens: 0.0, closes: end, ramp: term.values[ramp]} if owner in whole else {}
    return found


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
    """The fit with every window opened and closed in the middle of what the recordings leave open, or at once where it
    takes the whole of each."""
    here = fitted.hypothesis
    terms = []
    for term in here.terms:
        middle = {name: sum(pair) / 2 for name, pair in edges(problem, here, term).items()}
        whole = whole_recordings(problem, term)
        if isinstance(term.effect, Windowed) and tuple(whole) == term.effect.owners:
            for owner in whole:
                on, off, ramp = term.effect.names(owner)
                middle |= {on: 0.0, off: 2 * float(problem.parts[owner].t[-1]), ramp: problem.parts[0].dt}
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
        opened = term.values[off] - term.values[on]
        surely = term.values[ramp] - _RAMP_ERRORS * float(np.nan_to_num(fitted.stderr((str(index), ramp))))
        widths.append(surely / opened if opened > 0 else np.inf)  # one that closed on itself has none
    return max(widths) < _EDGE


def is_off_outside(problem: Problem, fitted: Fit, floor: float, slack: float) -> bool:
    """Whether the last effect would have been seen outside of its window, had it acted there: else the window says
    nothing but that the motion was small. It is seen where it is a part of what it is inside, or where it is more than
    the fit leaves there beyond the noise, and than is open about the noise. floor, slack: mean squares of the noise,
    and of what is open about it."""
    hypothesis = fitted.hypothesis
    term, signals = hypothesis.terms[-1], problem.signals(hypothesis)
    effect = term.effect
    if not isinstance(effect, Windowed):
        return False
    law = term.law
    forces = law.effect.forces(signals, law.values)
    gates = [_gate(len(s.x), s.dt, effect.times(term.values, s.index)) for s in signals]
    gate, force = np.concatenate(gates), np.concatenate(forces)
    within, beyond = force[gate > 0.5] ** 2, force[gate == 0] ** 2
    if not len(within) or len(beyond) < LEAST_OUT * (len(within) + len(beyond)):
        return False
    if float(np.mean(beyond)) > _SHOWN_OUTSIDE * float(np.mean(within)):
        return True
    closed = np.concatenate([problem.reduce.plain(i, shut) for i, shut in enumerate(gates)]) == 0
    seen, left = (float(np.mean(rows[closed] ** 2)) for rows in (problem.reduce(forces), fitted.residual))
    return seen > slack + max(left - floor, 0.0)
