"""Joint least squares over baseline, nuisances and effects, in the force domain.

The unknowns of a hypothesis are the free parameters of the baseline, small corrections that every rig needs (a delay
below a sample, a mass error), and amplitudes and shapes of the effects; ``descent`` moves them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hystid.compiled import CompiledModel, Motion
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term, Unknown, get, is_mass, is_source, put
from hystid.diagnosis.fit.scanned import Columns, Scanned
from hystid.diagnosis.fit.slopes import Slope, are_near, step_at
from hystid.diagnosis.fit.velocity_sign import Law, bends, turns_at_once, unsure
from hystid.diagnosis.model.baseline import Baseline, Held
from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.diagnosis.model.memory import Memory
from hystid.diagnosis.prepare.differences import interpolated
from hystid.diagnosis.prepare.draws import ENOUGH, Draw
from hystid.diagnosis.prepare.faults import CALIBRATION
from hystid.diagnosis.prepare.reduction import Reduction
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError
from hystid.numeric import Array

_Row = TypeVar("_Row", bound=np.generic)
DELAY_LIMIT = 0.5  # samples: force held or sampled a little late; more is a fault
LATE_LIMIT = 8.0  # samples
_DRAWS, _MOST_DRAWS = 12, 48  # of the noise, from which their scatter is known, and that are made at most
_SLOPES, _FEWEST_POINTS = 50_000_000, 2  # bytes of such derivatives that are remembered, and points at least
_KEPT_BYTES = (40_000_000, 24_000_000, 16_000_000)  # bytes that are remembered: laws, forces of effects, rows per unit
_TINY = 1e-100  # amplitude below which a force says nothing of its unit


class Problem:
    """The recordings, the baseline and the reduction; evaluates hypotheses and their derivatives."""

    def __init__(self, parts: Sequence[Part], baseline: Baseline, scales: Scales) -> None:
        self.parts = tuple(parts)
        self.baseline = baseline
        self.scales = scales
        self.reduce = Reduction(parts, baseline.mass)
        self._ready: list[dict[tuple[CompiledModel, int], Motion]] = [{} for _ in self.parts]  # motions for the effects
        self._held = [self._hold(p, p.x, p.v) for p in self.parts]
        self._laws, self._forces, self._per_unit = (Memory(most) for most in _KEPT_BYTES)
        self._last: tuple[Hypothesis, list[Array]] | None = None
        self._added: tuple[Hypothesis | None, Array]
        self.weighed_by: tuple[Hypothesis, ...] = ()  # fits by which rows were weighed down
        self._refit: Hypothesis | None = None  # and the one by which those were in which the smoother is biased
        self._slopes: list[tuple[tuple[float, ...], dict[str, Slope]]] = []
        self.work = 0  # rows of residuals that were evaluated: what a search has cost, on any machine
        self._units = self._linear_columns()
        self._reduce_anew()

    @property
    def timed(self) -> bool:
        """Whether time was measured in all recordings: else no law of time, drift or window can be told."""
        return all(part.timed for part in self.parts)

    @property
    def sees_x(self) -> bool:
        """Whether the displacement is known in all recordings, so that laws of it can be told."""
        return all(part.sees_x for part in self.parts)

    @property
    def unforced(self) -> bool:
        """Whether no recording has a force, as it is known to be zero."""
        return not any(part.forced for part in self.parts)

    @property
    def is_held(self) -> bool:
        """Whether rest counts, which does only where a force swings in it: something holds the structure then."""
        return any(p.rest is not None and p.valid is not None and bool(np.any(p.rest & p.valid)) for p in self.parts)

    def _reduce_anew(self) -> None:
        """Rows of what is reduced once and for all; to be called when the reduction has changed."""
        self._unit_rows = {name: self.reduce(columns) for name, columns in self._units.items()}
        self._acceleration = self.reduce([part.a for part in self.parts])
        self._slopes, self._added = [], (None, np.zeros(0))
        self._per_unit.clear()
        self.forget_columns()

    def _hold(self, part: Part, x: Array, v: Array) -> Held:
        """A motion of a part made ready for the law, with its past."""
        return self.baseline.held(*part.led_in(x, v), part.dt)

    def _follow(self, held: Sequence[Held], values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """R and h of the baseline along motions of the parts, without their past."""
        return self._follow_at(held, [values])[0]

    def _follow_at(self, held: Sequence[Held], each: Sequence[Mapping[str, float]]) -> list[list[tuple[Array, Array]]]:
        """The same at each of several values, in one run."""
        return [
            [(R[part.past :], h[part.past :]) for part, (R, h) in zip(self.parts, found, strict=True)]
            for found in self.baseline.forces_at(held, each)
        ]

    def law(self, values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """R and h of the baseline per part. Linear parameters cost nothing; the last shapes are remembered."""
        change = [(name, values[name] - self.baseline.nominal[name]) for name in self.baseline.linear]
        return [
            (R + sum(step * self._units[name][i] for name, step in change), h)
            for i, (R, h) in enumerate(self._law_at(values))
        ]

    def _law_at(self, values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """R and h with the shapes of the law as given and its linear parameters at their nominal values."""
        shapes = {name: values[name] for name in self.baseline.shapes}

        def made() -> tuple[Array, ...]:
            pairs = self._follow(self._held, {**self.baseline.nominal, **shapes})
            return tuple(array for pair in pairs for array in pair)

        flat = self._laws.get(tuple(shapes.values()), made)
        return list(zip(flat[::2], flat[1::2], strict=True))

    def signals(self, hypothesis: Hypothesis) -> list[Signals]:
        """What the effects see. Where the baseline has no hysteresis, h is that of the effects that bring one."""
        found = [
            Signals(p.x, p.v, p.a, h, p.dt, i, self._ready[i])
            for i, (p, (_, h)) in enumerate(zip(self.parts, self._law_at(hypothesis.values), strict=True))
        ]
        return self._with_h(found, hypothesis.terms)

    def _with_h(self, signals: list[Signals], terms: Sequence[Term]) -> list[Signals]:
        added = [term.effect.forces(signals, term.values) for term in self._sources(terms)]
        return [replace(s, h=sum((f[i] for f in added), s.h)) for i, s in enumerate(signals)] if added else signals

    def _sources(self, terms: Sequence[Term]) -> list[Term]:
        """The effects whose force is the hysteretic force of a baseline without one."""
        return [] if self.baseline.has_h else [term for term in terms if is_source(term.effect)]

    def _force(self, hypothesis: Hypothesis, term: Term, signals: Sequence[Signals]) -> Sequence[Array]:
        """Force of an effect per part; term: one of the hypothesis, or that with other values. That of its law is
        remembered.

        signals: those of the hypothesis.
        """
        law, seen = term.law, tuple[object, ...]()
        if law.effect.per_h:
            return term.effect.switched(self._law_force(law, signals), signals, term.values)
        if "h" in law.effect.reads:
            shapes = tuple(hypothesis.values[name] for name in self.baseline.shapes)
            seen = (shapes, *(source.key for source in self._sources(hypothesis.terms)))
        forces = self._forces.get((*law.key, seen), lambda: tuple(law.effect.forces(signals, law.values)))
        return term.effect.switched(forces, signals, term.values)

    def _law_force(self, law: Term, signals: Sequence[Signals]) -> Sequence[Array]:
        """Force of an effect that acts all the time; where it is proportional to h, that per unit of h is remembered.

        signals: motion of the parts, whatever h is.
        """

        def per_unit() -> tuple[Array, ...]:
            return tuple(law.effect.forces([replace(s, h=np.ones_like(s.h)) for s in signals], law.values))

        if not law.effect.per_h:
            return law.effect.forces(signals, law.values)
        units = self._forces.get((*law.key, "per unit of h"), per_unit)
        return [s.h * unit for s, unit in zip(signals, units, strict=True)]

    def _unit(self, hypothesis: Hypothesis, term: Term, name: str, signals: Sequence[Signals]) -> list[Array]:
        """Force of an effect per unit of one of its amplitudes."""
        value = term.values[name]
        if len(term.effect.amplitudes) == 1 and abs(value) > _TINY:
            return [f / value for f in self._force(hypothesis, term, signals)]
        only = {**term.values, **dict.fromkeys(term.effect.amplitudes, 0.0), name: 1.0}
        return list(self._force(hypothesis, Term(term.effect, only), signals))

    def columns(self, effect: Effect, grid: Sequence[Mapping[str, float]], signals: Sequence[Signals]) -> Columns:
        """What an effect adds to the rows at points of its shapes; that of the last scans is remembered."""
        return self._scanned.columns(effect, grid, signals)

    def forget_columns(self) -> None:
        """Free what is remembered of scans."""
        self._scanned = Scanned(self.parts, self.reduce)

    def predicted(self, hypothesis: Hypothesis) -> list[Array]:
        """R and the effects, without inertia, per part [N]. That of the last hypothesis is remembered."""
        if self._last is None or self._last[0] is not hypothesis:
            self._last = hypothesis, self._predicted(hypothesis)
        return self._last[1]

    def _predicted(self, hypothesis: Hypothesis) -> list[Array]:
        forces = [R for R, _ in self.law(hypothesis.values)]
        if hypothesis.terms:
            signals = self.signals(hypothesis)
            for term in hypothesis.terms:
                forces = [f + g for f, g in zip(forces, self._force(hypothesis, term, signals), strict=True)]
        return forces

    def balance(self, hypothesis: Hypothesis) -> list[Array]:
        """Measured minus predicted force per sample and part [N], with the delay of the force channel taken out.

        What is believed beside the nominal mass acts on the smoothed acceleration: a mass that is fitted to a noisy one
        comes out too small, as that lowers the noise as well.
        """
        change = hypothesis.mass() - self.baseline.mass
        return [
            self.force_at(i, hypothesis.delay, force + hypothesis.mass() * part.a)
            - self.baseline.mass * part.inertia
            - change * part.a
            - force
            for i, (part, force) in enumerate(zip(self.parts, self.predicted(hypothesis), strict=True))
        ]

    def balance_shown(self, hypothesis: Hypothesis) -> list[Array]:
        """The balance for people [N]: with the smoothed acceleration where it was derived, whose noise hides the rest.

        A fit whitens that noise instead, which no eye does. Slow forces, where no channel shows slow motion, are left
        out.
        """
        mass = hypothesis.mass()
        shown = [
            self.force_at(i, hypothesis.delay, force + mass * part.a) - mass * part.shown_acceleration - force
            for i, (part, force) in enumerate(zip(self.parts, self.predicted(hypothesis), strict=True))
        ]
        return [one - part.slow(one) if part.lowest else one for part, one in zip(self.parts, shown, strict=True)]

    def force_at(self, index: int, delay: float, predicted: Array) -> Array:
        """Measured force, moved earlier by a number of samples of the first recording, of which the predicted force
        moves and the noise stays: noise that moves against that of the motion would show a delay by chance."""
        if delay == 0.0:
            return self.parts[index].F
        return self.parts[index].F + predicted - interpolated(predicted, -delay * self.parts[index].pace)

    def floor(self, fitted: Fit) -> float:
        """Mean square that noise alone leaves of a fit: that of the balance, and what noise of the motion makes of the
        force.

        Both come from the same channels, so that they may cancel in part: what is added is the mean square of the two
        together less that of the balance.
        """
        known = self.reduce.level + self.reduce.left_open(fitted.residual)
        return known + float(np.mean(self.noise_added(fitted.hypothesis)))

    def noise_added(self, hypothesis: Hypothesis, draws: int = 0) -> Array:
        """What noise of the motion adds to the mean square that noise leaves, one value per draw of it, beyond what the
        whitening takes it for; rows that are weighed down for it, or in which a law may stand anywhere, hold that
        already.

        draws: how many; 0: as many as tell their mean twice as well as noise tells its own mean square.
        """
        known_of, found = self._added
        if known_of is hypothesis and len(found) == (draws or len(found)):
            return found
        added, told = np.zeros(0), self.reduce.told()
        known, enough = self.reduce.followed * float(np.mean(told)), 0.5 * np.sqrt(2 / self.reduce.count)
        for draw, forces in enumerate(self.moved(hypothesis, draws or _MOST_DRAWS)):
            pairs = zip(forces, self.parts, strict=True)
            moved, balance = self.reduce([np.stack([u, self.baseline.mass * p.jitter[draw][3]]) for u, p in pairs])
            added = np.append(added, np.mean(moved * (moved + 2 * balance) * told) - known)
            if not draws and draw + 1 >= _DRAWS and np.std(added, ddof=1) < enough * np.sqrt(draw + 1):
                break
        self._added = hypothesis, added
        return added

    def moved(self, hypothesis: Hypothesis, draws: int = ENOUGH) -> Iterator[list[Array]]:
        """What draws of the regressors' noise make of the force at every sample, per draw and part [N]; zeros where the
        law has no answer there, as at the edge of what it allows."""
        here = self.predicted(hypothesis)
        return (self._moved(hypothesis, draw, here) for draw in range(draws))

    def _moved(self, hypothesis: Hypothesis, draw: int, here: list[Array]) -> list[Array]:
        change = hypothesis.mass() - self.baseline.mass
        try:
            there = self._shaken(hypothesis, [part.jitter[draw] for part in self.parts])
        except NumericalError:
            return [np.zeros_like(a) for a in here]
        moved = [b - a + change * p.jitter[draw][2] for p, a, b in zip(self.parts, here, there, strict=True)]
        signals = self.signals(hypothesis) if hypothesis.terms else []
        for term in hypothesis.terms:
            own = [
                term.effect.of_noise(part.noise["F"], term.values, like)
                for part, like in zip(self.parts, signals, strict=True)
            ]
            moved = [force + more for force, more in zip(moved, own, strict=True)]
        return moved

    def distrust(self, *hypotheses: Hypothesis, refit: Hypothesis | None = None) -> bool:
        """Weigh down rows in which a law jumps, or the smoother is biased; true where there are such rows.

        hypotheses: the fit, and others that a law may have jumped in where the fit was led astray. refit: without the
        law that is missing, where the fit is one with it: the bias gives no law a lead.
        """
        self.weighed_by, self._refit = hypotheses, refit
        self.reduce.trust()
        movements, filtered, sides = [self.reduce(u) for u in self.moved(hypotheses[0])], np.zeros(1), np.zeros(1)
        plain = refit or hypotheses[0]
        biased = np.zeros(1) if plain.terms else self.reduce.biased(self._bias(plain), self.rows(plain))
        if self.baseline.memoryless:
            found = [bends(partial(self._law_along, h.values), self.parts) for h in hypotheses]
            # Their sign changes with that of v: blocks would lose it.
            slow, quick = (
                np.maximum.reduce([self.reduce(forces) for forces in one]) for one in zip(*found, strict=True)
            )
            movements, filtered = [*movements, slow], quick
        if self.baseline.memoryless or self._turning_terms(hypotheses[0]):
            sides = self.reduce.spread(unsure(self._turning(hypotheses[0]), self.parts))
        self.reduce.distrust(movements, np.hypot(filtered, biased), sides)
        self._reduce_anew()
        return self.reduce.weighs

    def _law_along(self, values: Mapping[str, float], velocities: Sequence[Array]) -> list[Array]:
        """R of the baseline per part [N], with other velocities beside the displacements."""
        moved = [self._hold(part, part.x, v) for part, v in zip(self.parts, velocities, strict=True)]
        return [R for R, _ in self._follow(moved, values)]

    def _turning_terms(self, hypothesis: Hypothesis) -> list[Term]:
        turning = (term for term in hypothesis.terms if term.effect.turns)
        return [t for t in turning if turns_at_once(t.values[t.effect.semantics.transition], self.parts)]

    def _turning(self, hypothesis: Hypothesis) -> Law:
        """What of a hypothesis may turn at once with the sign of the velocity, as a function of the velocities."""
        here, terms = self.signals(hypothesis), self._turning_terms(hypothesis)

        def law(velocities: Sequence[Array]) -> list[Array]:
            along = self._law_along(hypothesis.values, velocities) if self.baseline.memoryless else []
            seen = [Signals(s.x, v, s.a, s.h, s.dt, s.index) for s, v in zip(here, velocities, strict=True)]
            forces = [*([along] if along else []), *(term.effect.forces(seen, term.values) for term in terms)]
            return [np.sum(one, axis=0) for one in zip(*forces, strict=True)]

        return law

    def bias_rows(self, hypothesis: Hypothesis) -> Array:
        """What the bias of the smoother does to the force: weighted rows, (rows,)."""
        return self.reduce(self._bias(hypothesis))

    def _bias(self, hypothesis: Hypothesis) -> list[Array]:
        here = self.predicted(hypothesis)
        try:
            there = self._shaken(hypothesis, [part.jitter.bias for part in self.parts])
        except NumericalError:
            return [np.zeros_like(force) for force in here]
        return [moved - force for force, moved in zip(here, there, strict=True)]

    def _shaken(self, hypothesis: Hypothesis, errors: Sequence[Draw]) -> list[Array]:
        moved = []
        for part, (dx, dv, da, _) in zip(self.parts, errors, strict=True):
            moved.append((part.x + dx, part.v + dv, part.a + da, part.dt))
        held = [self._hold(p, x, v) for p, (x, v, _, _) in zip(self.parts, moved, strict=True)]
        laws = self._follow(held, hypothesis.values)
        seen = [Signals(x, v, a, h, dt, i) for i, ((x, v, a, dt), (_, h)) in enumerate(zip(moved, laws, strict=True))]
        seen, forces = self._with_h(seen, hypothesis.terms), [R for R, _ in laws]
        for term in hypothesis.terms:
            forces = [f + g for f, g in zip(forces, term.effect.forces(seen, term.values), strict=True)]
        return forces

    def row_counts(self) -> list[int]:
        """Number of rows of each part."""
        return [len(self.reduce.plain(i, part.x)) for i, part in enumerate(self.parts)]

    def by_part(self, rows: NDArray[_Row]) -> list[NDArray[_Row]]:
        """Rows of all parts, split into those of each."""
        return np.split(rows, np.cumsum(self.row_counts())[:-1])

    def of(self, parts: Sequence[Part]) -> Problem:
        """The same problem on other recordings."""
        return Problem(parts, self.baseline, self.scales)

    def weighed(self, parts: Sequence[Part]) -> Problem:
        """The same problem on other parts, with the rows weighed down in which the same fits jump there."""
        made = self.of(parts)
        if self.weighed_by:
            made.distrust(*self.weighed_by, refit=self._refit)
        return made

    def elsewhere(self, parts: Sequence[Part]) -> Problem:
        """The same problem on recordings that no fit sees. Where a law jumps, nobody knows there either on which side
        it stands."""
        made = self.of(parts)
        if self.weighed_by and made.reduce.count:
            refit = self._refit.elsewhere() if self._refit else None
            made.distrust(*(hypothesis.elsewhere() for hypothesis in self.weighed_by), refit=refit)
        return made

    def with_noise_again(self, draw: int, sign: float) -> Problem:
        """The same problem with the noise of the motion added once more (a draw of it, of either sign)."""
        moved = [
            replace(
                part, x=part.x + sign * dx, v=part.v + sign * dv, a=part.a + sign * da, inertia=part.inertia + sign * di
            )
            for part, (dx, dv, da, di) in ((part, part.jitter[draw]) for part in self.parts)
        ]
        return self._along(moved)

    def with_zeros(self, zeros: Array) -> Problem:
        """The same problem with the displacement of each part off its zero by less: by these [m]."""
        return self._along([part.with_zero(zero) for part, zero in zip(self.parts, zeros, strict=True)])

    def _along(self, moved: Sequence[Part]) -> Problem:
        made = self.of(moved)
        made.reduce = self.reduce
        made._reduce_anew()
        return made

    def rows(self, hypothesis: Hypothesis) -> Array:
        """Weighted residual rows."""
        rows = self.reduce(self.balance(hypothesis))
        self.work += len(rows)
        return rows

    def unknowns(self, hypothesis: Hypothesis, *, most: bool = False) -> tuple[Unknown, ...]:
        """What is fitted for a hypothesis. most: amplitudes have the largest values that their blocks allow."""
        base = self.baseline
        found = [self._base_unknown(name) for name in base.free]
        if base.mass:
            limit = LATE_LIMIT if hypothesis.late else DELAY_LIMIT
            found.append(Unknown(("chain", "delay"), low=-limit, high=limit))
            if base.weighed and not any(is_mass(term.effect) for term in hypothesis.terms):
                found.append(Unknown(("chain", "mass_error"), low=-CALIBRATION, high=CALIBRATION, linear=True))
        for i, term in enumerate(hypothesis.terms):
            lowest = dict(term.effect.lowest)
            if is_mass(term.effect):  # what moves in the end has a mass
                lowest |= {term.effect.semantics.mass: -base.mass}
            highest = term.effect.highest if most else {}
            found += [
                Unknown((str(i), n), low=lowest.get(n, -np.inf), high=highest.get(n, np.inf), linear=True)
                for n in term.effect.amplitudes
            ]
            for shape in term.effect.shapes:
                low, high = term.effect.bounds(shape, self.scales)
                found.append(Unknown((str(i), shape.name), low > 0, low, high))
        return tuple(found)

    def jacobian(self, hypothesis: Hypothesis, unknowns: Iterable[Unknown]) -> Array:
        """Derivative of the predicted rows by each unknown (by its logarithm where it is fitted so); (rows,
        unknowns)."""
        here = self.predicted(hypothesis)
        signals = self.signals(hypothesis)
        listed, rows, columns = list(unknowns), dict[int, Array](), dict[int, list[Array]]()
        slopes = self._law_slopes(hypothesis.values) if self._moves_law(listed) else {}
        for i, unknown in enumerate(listed):
            known = self._known_rows(hypothesis, unknown, signals, slopes)
            if known is None:
                columns[i] = self._column(hypothesis, unknown, here, signals)
            else:
                rows[i] = known
        rows.update(zip(columns, self.reduce.several(list(columns.values())), strict=True))
        made = np.empty((len(listed), len(self._acceleration)))
        for i, unknown in enumerate(listed):
            np.multiply(rows[i], get(hypothesis, unknown.key) if unknown.log else 1.0, out=made[i])
        return made.T

    def _moves_law(self, unknowns: Sequence[Unknown]) -> bool:
        return any(kind == "base" and name in self.baseline.shapes for kind, name in (u.key for u in unknowns))

    def _known_rows(
        self, hypothesis: Hypothesis, unknown: Unknown, signals: list[Signals], slopes: Mapping[str, Slope]
    ) -> Array | None:
        """Rows of a column that are known without its samples; None where they are not."""
        kind, name = unknown.key
        if unknown.key == ("base", "m"):
            return self._acceleration * (1 + hypothesis.mass_error)
        if unknown.key == ("chain", "mass_error"):
            return self._acceleration * hypothesis.values["m"]
        if kind == "base":
            linear = name in self.baseline.linear
            return self._unit_rows[name] if linear else self._law_rows(hypothesis, name, signals, slopes[name])
        if unknown.linear and kind != "chain" and not self._is_read(hypothesis, int(kind)):
            term = hypothesis.terms[int(kind)]
            if term.effect.law.lasts:
                shapes = {n: value for n, value in term.values.items() if n not in term.effect.amplitudes}
                key = (*Term(term.effect, shapes).key, name)
                made = lambda: (self.reduce(self._unit(hypothesis, term, name, signals)),)  # noqa: E731
                return self._per_unit.get(key, made)[0]
        return None

    def _column(
        self, hypothesis: Hypothesis, unknown: Unknown, here: list[Array], signals: list[Signals]
    ) -> list[Array]:
        kind, name = unknown.key
        if unknown.key == ("chain", "delay"):
            mass = hypothesis.mass()
            return [-p.pace * np.gradient(mass * p.a + f) for p, f in zip(self.parts, here, strict=True)]
        if self._is_read(hypothesis, int(kind)):
            return self._source_column(hypothesis, unknown, here)
        if unknown.linear:
            return self._unit(hypothesis, hypothesis.terms[int(kind)], name, signals)
        return self._shape_column(hypothesis, unknown, signals)

    def _is_read(self, hypothesis: Hypothesis, index: int) -> bool:
        """Whether other effects read the force of this one."""
        others = (term for i, term in enumerate(hypothesis.terms) if i != index)
        source = not self.baseline.has_h and is_source(hypothesis.terms[index].effect)
        return source and any(term.effect.uses_h for term in others)

    def _source_column(self, hypothesis: Hypothesis, unknown: Unknown, here: list[Array]) -> list[Array]:
        """Derivative by a parameter of an effect that others read: directly, and through them."""
        value = get(hypothesis, unknown.key)
        step = step_at(value, unknown.high)
        there = self.predicted(put(hypothesis, {unknown.key: value + step}))
        return [(moved - force) / step for moved, force in zip(there, here, strict=True)]

    def _shape_column(self, hypothesis: Hypothesis, unknown: Unknown, signals: list[Signals]) -> list[Array]:
        value = get(hypothesis, unknown.key)
        step = step_at(value, unknown.high)
        term = hypothesis.terms[int(unknown.key[0])]
        there = self._force(hypothesis, replace(term, values={**term.values, unknown.key[1]: value + step}), signals)
        return [(g - f) / step for f, g in zip(self._force(hypothesis, term, signals), there, strict=True)]

    def _law_rows(self, hypothesis: Hypothesis, name: str, signals: list[Signals], slope: Slope) -> Array:
        """Rows of the derivative by a parameter of the law: directly, and through the effects that read its force."""
        rows, step = slope.rows, step_at(hypothesis.values[name])
        for term in hypothesis.terms:
            if term.effect.uses_h:
                moved = [replace(s, h=s.h + step * dh) for s, dh in zip(signals, slope.h, strict=True)]
                here = self._force(hypothesis, term, signals)
                there = term.effect.switched(self._law_force(term.law, moved), moved, term.values)
                rows = rows + self.reduce([(g - f) / step for f, g in zip(here, there, strict=True)])
        return rows

    def _law_slopes(self, values: Mapping[str, float]) -> dict[str, Slope]:
        """Derivatives by each shape of the law, from a point at most a few per cent away: steps are checked by their
        cost."""
        shapes = tuple(values[name] for name in self.baseline.shapes)
        for known, slopes in self._slopes:
            if are_near(known, shapes):
                return slopes
        here = self._law_at(values)
        at = {**self.baseline.nominal, **dict(zip(self.baseline.shapes, shapes, strict=True))}
        steps = {name: step_at(values[name]) for name in self.baseline.shapes}
        there = self._follow_at(self._held, [{**at, name: at[name] + step} for name, step in steps.items()])
        moved = [
            [((R1 - R0) / step, (h1 - h0) / step) for (R0, h0), (R1, h1) in zip(here, pairs, strict=True)]
            for step, pairs in zip(steps.values(), there, strict=True)
        ]
        rows = self.reduce.several([[R for R, _ in parts] for parts in moved])
        made = {n: Slope(r, [h for _, h in parts]) for n, r, parts in zip(steps, rows, moved, strict=True)}
        size = sum(slope.nbytes for slope in made.values())
        most = max(_FEWEST_POINTS, _SLOPES // max(size, 1))  # many fits begin at the same point
        self._slopes = [(shapes, made), *self._slopes[: most - 1]]
        return made

    def renew(self, hypothesis: Hypothesis) -> bool:
        """Have derivatives of the law computed at this very point next time; False where those in use are.

        Beside a corner of the law those of a point near by may lead nowhere.
        """
        shapes = tuple(hypothesis.values[name] for name in self.baseline.shapes)
        near = [known for known, _ in self._slopes if are_near(known, shapes)]
        if not near or near[0] == shapes:
            return False
        self._slopes = [entry for entry in self._slopes if entry[0] not in near]
        return True

    def _base_unknown(self, name: str) -> Unknown:
        positive = name in self.baseline.positive
        linear = name in self.baseline.linear or name == "m"
        low = max(0.0 if positive else -np.inf, self.baseline.lowest.get(name, -np.inf))
        high = self.baseline.highest.get(name, np.inf)
        return Unknown(("base", name), positive and not linear, low, high, linear=linear)

    def _linear_columns(self) -> dict[str, list[Array]]:
        units = {}
        base = self.baseline
        if base.linear:
            start = self._follow(self._held, base.nominal)
            for name in base.linear:
                step = base.nominal[name] or 1.0
                moved = self._follow(self._held, {**base.nominal, name: base.nominal[name] + step})
                units[name] = [(there - here) / step for (here, _), (there, _) in zip(start, moved, strict=True)]
        return units


def standing(problem: Problem, hypothesis: Hypothesis) -> Fit:
    """A hypothesis as it stands, not fitted: its rows and their mean square, without a covariance."""
    rows = problem.rows(hypothesis)
    return Fit(hypothesis, rows, float(np.mean(rows**2)), problem.unknowns(hypothesis))
