"""Hysteresis that wears, or is pinched as by slack: effects that act on the force of another effect.

Where the baseline has no hysteresis of its own, such a structure is hysteretic friction and up to two effects that read
its force. Alone, each of them explains nothing or the wrong thing; the family is therefore fitted as one.

A further effect must take much of what is left of the force. Pinching changes the shape of the loops more than the
force: it is also accepted where it takes little, if it gives the branches between reversals the shape that was measured
(see ``branches``) and no spring fits as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hystid.diagnosis.blocks import Effect
from hystid.diagnosis.branches import Branches, branches, misfits
from hystid.diagnosis.fitting import Fit, Problem, is_source
from hystid.diagnosis.search import scan, try_fit, try_term

PINCHING = "pinching"
MUCH = 0.4  # share of the mean square that each further effect must take, where that is visible at all:
_VISIBLE = 0.025  # share of the excess
EXPLAINED = 0.8  # share of the excess that the family must explain
_COMPANIONS = frozenset({"cyclic_degradation", PINCHING})
_SPRINGS = frozenset({"cubic_stiffness", "quadratic_stiffness", "bilinear_stiffness", "two_sided_stop", "backlash"})
_MOST = 3  # effects together
_FORMS, _NEAR = 4, 1.5  # forms of friction that are followed, and their mean square over that of the best one
_CANDIDATES, _COMPARED = 5, 2  # forms of further effects that are tried, and that are fitted long
_SHORT, _LONG = 10, 40  # iterations for the comparison, and for the best
_BLOCKS, _GAINING = 12, 0.75  # of these blocks of rows, or of branches that rise, the share in which it must help
_MOSTLY = 0.6  # the same share of blocks where the branches show the effect besides
_REGION = 2 / 3  # of the stroke, or of the force, that a pinched region may take: a tenth of it is left at the ends
_TIE = 0.03  # share of the mean square below which the claim with fewer parameters wins
_LITTLE = 0.05  # share of the mean square that pinching must take where the branches show it
_SHAPE = 1 / 3  # share of the mean square misfit of the branches that it must take there
_RISE = 0.1  # of the stiffness along a branch, over its mean, that is a shape: mean of all branches
_FEWEST = 6  # branches that can show a shape
_CLOSE = 1.15  # mean square over the least within which lines are told apart by the branches


@dataclass(frozen=True)
class Link:
    """One more effect: fit with everything so far, and ids that explain as much."""

    effect: Effect
    fit: Fit = field(repr=False)
    tied: tuple[str, ...] = ()


def family(problem: Problem, before: Fit, library: Sequence[Effect], floor: float) -> list[Link]:
    """Hysteretic friction and the effects on it, in the order of strength; empty where there is no such family."""
    if problem.baseline.has_h or not any(_is_reader(effect) for effect in library):
        return []
    excess = before.chi2 - floor
    search = _Search(problem, library, branches(problem, before), _VISIBLE * excess)
    long = [line for start in search.starts(before) if len(line := search.line(start)) > 1]
    if not long:
        return []
    least = min(line[-1].fit.chi2 for line in long)
    near = [line for line in long if line[-1].fit.chi2 < _CLOSE * least]
    best = min(near, key=lambda line: (search.misfit(line[-1].fit), line[-1].fit.chi2))
    return best if before.chi2 - best[-1].fit.chi2 > EXPLAINED * excess else []


@dataclass(frozen=True)
class _Search:
    """What lines of effects are grown on.

    measured: shape of the branches; visible: fall of the mean square below which an effect must be seen in them.
    """

    problem: Problem
    library: Sequence[Effect]
    measured: Sequence[Branches]
    visible: float

    def starts(self, before: Fit) -> list[Link]:
        """The best forms of hysteretic friction."""
        sources = [effect for effect in self.library if is_source(effect)]
        found = [(c.effect, try_term(self.problem, before, c.term, _LONG)) for c in scan(self.problem, before, sources)]
        fits = [Link(effect, made) for effect, made in found if made is not None]
        least = min((link.fit.chi2 for link in fits), default=0.0)
        near = [link for link in fits if link.fit.chi2 < _NEAR * least]
        return sorted(near, key=lambda link: link.fit.chi2)[:_FORMS]

    def line(self, start: Link) -> list[Link]:
        """A form of friction, and the effects that follow it."""
        line = [start]
        while len(line) < _MOST and (link := self._next(line)) is not None:
            line.append(link)
        return line

    def misfit(self, fit: Fit) -> float:
        """Mean square misfit of the branches; 0 where there are too few."""
        found = misfits(self.problem, fit, self.measured)
        return float(np.mean(found**2)) if len(found) >= _FEWEST else 0.0

    def _next(self, line: Sequence[Link]) -> Link | None:
        """The effect that takes most of the rest, or else pinching in another form that the branches show."""
        end = line[-1].fit
        used = {link.effect.id for link in line}
        readers = [effect for effect in self.library if _is_reader(effect) and effect.id not in used]
        candidates = scan(self.problem, end, readers)[:_CANDIDATES]
        found = [(c.effect, try_term(self.problem, end, c.term, _SHORT)) for c in candidates]
        fits = sorted(((e, f) for e, f in found if f is not None), key=lambda item: item[1].chi2)
        fits = [(e, f) for i, (e, f) in enumerate(fits) if i < _COMPARED or (e.id == PINCHING and self._rises(end))]
        fits = [(e, again) for e, f in fits if (again := try_fit(self.problem, f.hypothesis, _LONG)) is not None]
        if not fits:
            return None
        least = min(f.chi2 for _, f in fits)
        near = [(e, f) for e, f in fits if f.chi2 < (1 + _TIE) * least]
        first = min(near, key=lambda item: (item[0].size, item[1].chi2))
        if self._takes_much(end, first[1]):
            return Link(*first, tuple(dict.fromkeys(e.id for e, _ in near if e.id != first[0].id)))
        shown = [(e, f) for e, f in fits if e.id == PINCHING and self._is_shown(end, f)]
        return Link(*min(shown, key=lambda item: item[1].chi2)) if shown else None

    def _takes_much(self, end: Fit, fit: Fit) -> bool:
        """Whether the last effect of a fit takes much of the rest, everywhere."""
        much = end.chi2 - fit.chi2 > max(self.visible, MUCH * end.chi2)
        return much and self._is_sound(end, fit)

    def _rises(self, end: Fit) -> bool:
        """Whether the stiffness rises along the measured branches, and not along those of a fit."""
        found = misfits(self.problem, end, self.measured)
        return len(found) >= _FEWEST and float(np.mean(found)) > _RISE

    def _is_shown(self, end: Fit, fit: Fit) -> bool:
        """Whether pinching, the last effect of a fit, gives most of the branches that rise the measured shape."""
        if not self._rises(end) or fit.chi2 > (1 - _LITTLE) * end.chi2:
            return False
        before, after = (misfits(self.problem, one, self.measured) for one in (end, fit))
        rising = before > _RISE
        closer = float(np.mean(np.abs(after[rising]) < before[rising]))
        shaped = closer >= _GAINING and float(after @ after) < (1 - _SHAPE) * float(before @ before)
        return shaped and self._is_sound(end, fit, _MOSTLY)

    def _is_sound(self, end: Fit, fit: Fit, share: float = _GAINING) -> bool:
        """Whether the last effect helps in a share of all blocks, and is no pinching without a region or that a spring
        feigns."""
        if not helps_everywhere(end, fit, share):
            return False
        return fit.hypothesis.terms[-1].effect.id != PINCHING or (
            self._is_local(fit) and not self._is_feigned(end, fit)
        )

    def _is_feigned(self, end: Fit, fit: Fit) -> bool:
        """Whether a spring does as well as pinching, in the force and in the shape of the branches."""
        springs = scan(self.problem, end, [effect for effect in self.library if effect.id in _SPRINGS])[:2]
        rivals = [made for c in springs if (made := try_term(self.problem, end, c.term, _LONG)) is not None]
        as_good = [rival for rival in rivals if rival.chi2 < (1 + _TIE) * fit.chi2]
        return any(self.misfit(rival) <= self.misfit(fit) for rival in as_good)

    def _is_local(self, fit: Fit) -> bool:
        """Whether a pinched region is a region: not most of the stroke, or of the hysteretic force."""
        term = fit.hypothesis.terms[-1]
        signals = self.problem.signals(fit.hypothesis)
        tops = {
            "m": max(float(np.max(np.abs(s.x))) for s in signals),
            "N": max(float(np.max(np.abs(s.h))) for s in signals),
            "1": 1.0,
        }
        widths = [(term.values[s.name], tops[s.unit]) for s in term.effect.shapes if s.unit in tops]
        return all(width < _REGION * top for width, top in widths)


def _is_reader(effect: Effect) -> bool:
    """Whether an effect acts on the force of hysteretic friction."""
    return effect.uses_h and effect.id in _COMPANIONS


def helps_everywhere(before: Fit, after: Fit, share: float = _GAINING) -> bool:
    """Whether the residual falls in a share of all parts of the recordings, not in a few."""
    pairs = zip(np.array_split(before.residual, _BLOCKS), np.array_split(after.residual, _BLOCKS), strict=True)
    return float(np.mean([float(b @ b) > float(a @ a) for b, a in pairs])) >= share
