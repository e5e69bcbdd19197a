"""Hysteresis that wears, or is pinched as by slack: effects that act on the force of another effect.

Where the baseline has no hysteresis of its own, such a structure is hysteretic friction and up to two effects that read
its force. Alone, each of them explains nothing or the wrong thing; the family is therefore fitted as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hystid.diagnosis.blocks import Effect
from hystid.diagnosis.fitting import Fit, Problem, is_source
from hystid.diagnosis.search import scan, try_fit, try_term

MUCH = 0.4  # share of the mean square that each further effect must take
EXPLAINED = 0.8  # share of the excess that the family must explain
_COMPANIONS = frozenset({"cyclic_degradation", "pinching"})
_MOST = 3  # effects together
_FORMS, _NEAR = 3, 1.5  # forms of friction that are followed, and their mean square over that of the best one
_CANDIDATES = 4  # further effects that are compared
_SHORT, _LONG = 10, 40  # iterations for the comparison, and for the best
_BLOCKS, _GAINING = 12, 0.75  # of these blocks of rows, the share in which a further effect must help
_REGION = 0.6  # share of the stroke, or of the force, that a pinched region may take
_TIE = 0.03  # share of the mean square below which the claim with fewer parameters wins


@dataclass(frozen=True)
class Link:
    """One more effect: fit with everything so far, and ids that explain as much."""

    effect: Effect
    fit: Fit = field(repr=False)
    tied: tuple[str, ...] = ()


def family(problem: Problem, before: Fit, library: Sequence[Effect], floor: float) -> list[Link]:
    """Hysteretic friction and the effects on it, in the order of strength; empty where there is no such family."""
    readers = [effect for effect in library if effect.uses_h and effect.id in _COMPANIONS]
    if problem.baseline.has_h or not readers:
        return []
    lines = []
    for start in _starts(problem, before, library):
        line = [start]
        while len(line) < _MOST and (link := _next(problem, line, readers)) is not None:
            line.append(link)
        lines.append(line)
    long = [line for line in lines if len(line) > 1]
    if not long:
        return []
    best = min(long, key=lambda line: line[-1].fit.chi2)
    explained = (before.chi2 - best[-1].fit.chi2) / max(before.chi2 - floor, 1e-300)
    return best if explained > EXPLAINED else []


def _starts(problem: Problem, before: Fit, library: Sequence[Effect]) -> list[Link]:
    """The best forms of hysteretic friction."""
    sources = [effect for effect in library if is_source(effect)]
    found = [(c.effect, try_term(problem, before, c.term, _LONG)) for c in scan(problem, before, sources)]
    fits = [Link(effect, made) for effect, made in found if made is not None]
    least = min((link.fit.chi2 for link in fits), default=0.0)
    near = [link for link in fits if link.fit.chi2 < _NEAR * least]
    return sorted(near, key=lambda link: link.fit.chi2)[:_FORMS]


def _next(problem: Problem, line: Sequence[Link], readers: Sequence[Effect]) -> Link | None:
    """The effect that takes most of the rest; None where none takes much of it, everywhere."""
    end = line[-1].fit
    used = {link.effect.id for link in line}
    candidates = scan(problem, end, [effect for effect in readers if effect.id not in used])[:_CANDIDATES]
    found = [(c.effect, try_term(problem, end, c.term, _SHORT)) for c in candidates]
    fits = sorted(((e, f) for e, f in found if f is not None), key=lambda item: item[1].chi2)[:2]
    fits = [(e, again) for e, f in fits if (again := try_fit(problem, f.hypothesis, _LONG)) is not None]
    if not fits:
        return None
    least = min(f.chi2 for _, f in fits)
    near = [(e, f) for e, f in fits if f.chi2 < (1 + _TIE) * least]
    effect, fit = min(near, key=lambda item: (item[0].size, item[1].chi2))
    if fit.chi2 > (1 - MUCH) * end.chi2 or not helps_everywhere(end, fit) or not _is_local(problem, fit):
        return None
    return Link(effect, fit, tuple(dict.fromkeys(e.id for e, _ in near if e.id != effect.id)))


def _is_local(problem: Problem, fit: Fit) -> bool:
    """Whether a pinched region is a region: not wider than most of the stroke, or of the hysteretic force."""
    term = fit.hypothesis.terms[-1]
    signals = problem.signals(fit.hypothesis)
    tops = {
        "m": max(float(np.max(np.abs(s.x))) for s in signals),
        "N": max(float(np.max(np.abs(s.h))) for s in signals),
    }
    widths = [(term.values[s.name], tops[s.unit]) for s in term.effect.shapes if s.unit in tops]
    return term.effect.remembers or all(width < _REGION * top for width, top in widths)


def helps_everywhere(before: Fit, after: Fit) -> bool:
    """Whether the residual falls in most parts of the recordings, not in a few."""
    pairs = zip(np.array_split(before.residual, _BLOCKS), np.array_split(after.residual, _BLOCKS), strict=True)
    return float(np.mean([float(b @ b) > float(a @ a) for b, a in pairs])) >= _GAINING
