"""Where a mismatch acts: in displacement, speed, time, amplitude; even or odd; conservative or dissipative.

A named effect is located by its own force: refitting moves the residual to where the effect is not. Without a name, by
the level of the residual above the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from hystid.diagnosis.fit.hypothesis import Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.windows import window_text
from hystid.diagnosis.model.effects import Signals
from hystid.diagnosis.prepare.chain import turns
from hystid.diagnosis.tell.result import Where
from hystid.numeric import Array, stretches

_ACTIVE = 0.3  # share of the 99 % quantile of the force above which an effect counts as acting
_BINS = 24
_NO_FORCE = 0.08  # share of the largest force that counts as none
_ALWAYS = 0.9  # share of the samples: the rest is where a force changes its sign
_TAKEN = 0.9  # share of the hysteretic force that slack takes away


def where_term(problem: Problem, term: Term, signals: Sequence[Signals]) -> Where:
    """Location of a named effect from its own force."""
    forces = [term.effect.force(s, term.values) for s in signals]
    even = _even_share(term, signals, forces)
    x = np.concatenate([s.x for s in signals])
    begins = _begins(term, x)
    place = _place(begins, x) if begins else _extent(term, forces, signals)
    acting = [part.name for part, force in zip(problem.parts, forces, strict=True) if np.any(force)]
    alone = f", in {acting[0]} only" if len(acting) == 1 < len(forces) else ""
    text = f"acts {place}{alone}{window_text(problem, term)}"
    return replace(_where(problem, forces, even, text), begins=begins)


def where_unknown(problem: Problem, residuals: Sequence[Array], noise: float) -> Where:
    """Location and laws of a mismatch that has no name."""
    smooth = [np.convolve(r, np.ones(9) / 9, mode="same") for r in residuals]
    x, v = (np.concatenate([getattr(p, name) for p in problem.parts]) for name in ("x", "v"))
    even, conservative = _map_symmetry(x, v, np.concatenate(smooth))
    amplitude = [float(np.sqrt(2) * np.std(p.x)) for p in problem.parts]
    level = [float(np.sqrt(max(float(np.mean(r**2)) - noise**2, 0.0))) for r in residuals]
    law = _power_law(amplitude, level)
    parts = [
        "even in x and v" if even > 0.6 else "odd in x and v" if even < 0.4 else "of mixed symmetry",
        "mostly conservative"
        if conservative > 0.6
        else "mostly dissipative"
        if conservative < 0.4
        else "of both kinds",
        f"growing with the power {law:.1f} of the amplitude" if np.isfinite(law) else "of unclear amplitude law",
        _rate(problem, smooth),
    ]
    return _where(problem, smooth, even, "a force " + ", ".join(parts))


def _where(problem: Problem, forces: Sequence[Array], even: float, text: str) -> Where:
    top = float(np.quantile(np.abs(np.concatenate(forces)), 0.99)) or 1.0
    x, v = (np.concatenate([getattr(p, name) for p in problem.parts]) for name in ("x", "v"))
    active = np.abs(np.concatenate(forces)) > _ACTIVE * top
    spans = {p.name: _spans(p.t, f, top) for p, f in zip(problem.parts, forces, strict=True)}
    order = sorted(spans, key=lambda name: -_level(problem, forces, name))
    return Where(
        text, _range(x[active]), _range(v[active]), {name: spans[name] for name in order},
        {p.name: float(np.sqrt(np.mean(f**2))) for p, f in zip(problem.parts, forces, strict=True)},
        _harmonics(even),
    )  # fmt: skip


def _level(problem: Problem, forces: Sequence[Array], name: str) -> float:
    return next(float(np.mean(f**2)) for p, f in zip(problem.parts, forces, strict=True) if p.name == name)


def _range(values: Array) -> tuple[float, float]:
    if not len(values):
        return 0.0, 0.0
    low, high = np.quantile(values, [0.01, 0.99])
    return float(low), float(high)


def _spans(t: Array, force: Array, top: float) -> list[tuple[float, float]]:
    """Time intervals in which the local level of the force is visible; gaps below 2 % of the record are closed."""
    width = max(5, len(t) // 50)
    level = np.sqrt(np.convolve(force**2, np.ones(width) / width, mode="same"))
    high = level > 0.15 * top
    spans: list[tuple[float, float]] = []
    for first, last in stretches(high):
        begin, end = float(t[first]), float(t[last - 1])
        if spans and begin - spans[-1][1] < 0.02 * t[-1]:
            spans[-1] = (spans[-1][0], end)
        else:
            spans.append((begin, end))
    return spans


def _even_share(term: Term, signals: Sequence[Signals], forces: Sequence[Array]) -> float:
    """Share of the even part, f(x, v) = f(-x, -v), in the mean square of the force."""
    mirrored = [Signals(-s.x, -s.v, -s.a, -s.h, s.dt, s.index) for s in signals]
    other = [term.effect.force(s, term.values) for s in mirrored]
    even = np.concatenate([(a + b) / 2 for a, b in zip(forces, other, strict=True)])
    total = float(np.mean(np.concatenate(forces) ** 2))
    return float(np.mean(even**2)) / total if total > 0 else 0.0


def _harmonics(even: float) -> str:
    if even > 0.9:
        return "even harmonics and a mean"
    return "odd harmonics" if even < 0.1 else f"even ({100 * even:.0f} % of the power) and odd harmonics"


def _extent(term: Term, forces: Sequence[Array], signals: Sequence[Signals]) -> str:
    """How much of the time a law without a gap acts, and how much slack it leaves at a reversal."""
    force = np.concatenate(forces)
    share = float(np.mean(np.abs(force) > 0.05 * np.max(np.abs(force)))) if np.any(force) else 0.0
    slack = _slack(forces, signals) if term.effect.uses_h else 0.0
    free = f", {1e3 * slack:.2g} mm of next to no force at each reversal" if slack else ""
    return f"all the time{free}" if share > _ALWAYS else f"in {100 * share:.0f} % of the samples{free}"


def _place(begins: Sequence[float], x: Array) -> str:
    """Where a law acts that begins at these displacements, and in how many of the samples."""
    reached = np.any([x < at if np.signbit(at) else x > at for at in begins], axis=0)
    sides = [f"x {'<' if np.signbit(at) else '>'} {1e3 * at:.4g} mm" for at in reversed(begins)]
    both = len(begins) == 2 and begins[0] == -begins[1]
    place = f"|x| > {1e3 * begins[1]:.4g} mm" if both else " and ".join(sides)
    return f"at {place}, in {100 * float(np.mean(reached)):.1f} % of the samples"


def _begins(term: Term, x: Array) -> tuple[float, ...]:
    """Displacements [m] beyond which a law with a gap acts, the lower one first: of one on both sides where its force
    begins, which may be farther on one of them; () where it has no gap."""
    said = term.effect.semantics
    if said.threshold not in term.values:
        return ()
    gap, side = term.values[said.threshold], term.values.get(said.switch, 0.0)
    if side:
        return (float(np.sign(side)) * gap,)
    at = np.linspace(gap, max(float(np.max(np.abs(x))), gap), len(x))
    still, found = np.zeros_like(at), []
    for sign in (-1.0, 1.0):
        force = term.effect.force(Signals(sign * at, still, still, still, 1.0), term.values)
        first = int(np.argmax(force != 0))
        found.append(sign * (gap if first <= 1 else float(at[first])))
    return tuple(found)


def _slack(forces: Sequence[Array], signals: Sequence[Signals]) -> float:
    """Path at each reversal over which an effect leaves next to nothing of the hysteretic force [m]; 0 where none."""
    paths = []
    for force, s in zip(forces, signals, strict=True):
        left = np.abs(s.h + force)
        top = float(np.max(left))
        free = left < _NO_FORCE * top if np.any(s.h) and np.any(force * s.h < -_TAKEN * s.h**2) else np.zeros(0, bool)
        at = turns(s.x, 0.05) if np.any(free) else []
        step = np.abs(np.diff(s.x, prepend=s.x[:1]))
        paths += [float(np.sum(step[first:last][free[first:last]])) for first, last in pairwise(at)]
    return float(np.median(paths)) if paths else 0.0


def _map_symmetry(x: Array, v: Array, r: Array) -> tuple[float, float]:
    """Shares of the even part and of the conservative part (even in v) in a map of the residual over (x, v)."""
    edges = [np.linspace(-np.max(np.abs(u)), np.max(np.abs(u)) * (1 + 1e-9), _BINS + 1) for u in (x, v)]
    place = [np.clip(np.digitize(u, e) - 1, 0, _BINS - 1) for u, e in zip((x, v), edges, strict=True)]
    count, total = np.zeros((_BINS, _BINS)), np.zeros((_BINS, _BINS))
    np.add.at(count, (place[0], place[1]), 1.0)
    np.add.at(total, (place[0], place[1]), r)
    cell = total / np.maximum(count, 1.0)
    good = (count > 20) & (count[::-1, ::-1] > 20)
    even = (cell + cell[::-1, ::-1]) / 2
    power = float(np.sum(cell[good] ** 2)) or 1.0
    flip = (count > 20) & (count[:, ::-1] > 20)
    conservative = (cell + cell[:, ::-1]) / 2
    flip_power = float(np.sum(cell[flip] ** 2)) or 1.0
    return float(np.sum(even[good] ** 2)) / power, float(np.sum(conservative[flip] ** 2)) / flip_power


def _power_law(amplitude: Sequence[float], level: Sequence[float]) -> float:
    """Slope of log level over log amplitude, NaN where the amplitudes do not differ enough."""
    if len(amplitude) < 2 or max(amplitude) < 1.3 * min(amplitude) or min(level) <= 0:
        return float("nan")
    return float(np.polyfit(np.log(amplitude), np.log(level), 1)[0])


def _rate(problem: Problem, residuals: Sequence[Array]) -> str:
    """Whether the residual is louder in fast than in slow motion of the same size."""
    x, v = (np.abs(np.concatenate([getattr(p, name) for p in problem.parts])) for name in ("x", "v"))
    r = np.concatenate(residuals)
    middle = (x > np.quantile(x, 0.3)) & (x < np.quantile(x, 0.9))
    low, high = np.quantile(v[middle], (0.3, 0.7)) if np.any(middle) else (0.0, 0.0)
    slow, fast = r[middle & (v < low)], r[middle & (v > high)]
    told = len(slow) and len(fast)  # what mostly rests has no speeds to compare
    ratio = float(np.std(fast) / max(np.std(slow), 1e-300)) if told else 1.0
    return (
        "stronger in fast motion"
        if ratio > 1.5
        else "stronger in slow motion"
        if ratio < 0.67
        else "not rate dependent"
    )


def score(force: Array, noise: float) -> Array:
    """How strongly something acts at each sample: its force in units of the noise."""
    return np.asarray(np.abs(force) / noise)


def unknown_score(residual: Array, noise: float) -> Array:
    """Local level of the residual in units of the noise, for a mismatch without a name."""
    power = np.convolve(residual**2, np.ones(41) / 41, mode="same")
    return np.asarray(np.sqrt(np.maximum(power / noise**2, 0.0)))
