"""One criterion: from fits to probabilities.

Every answer is a hypothesis: nothing is missing; a set of effects is; something is that no law here describes. All are
compared by one marginal likelihood with two variances, that of the noise and that of the model error.

The model error of a law is no noise. It repeats wherever the motion comes back to the same state, so that it has as
many independent values as there are different states: M, counted in the phase plane. Rows of unit noise, n of them,
hold n / M values of the noise for each value of the model error. With a mean square c of the misfit above the noise,
the variance of one of the M averages is S = 1 + n / M (c + e^2), where e is the error that the preparation itself
leaves, and the likelihood with the model error at its best is S^(-M/2). Where noise rules this is the usual likelihood
ratio, where the model error rules it is the ratio of the misfits to the power M / 2, whatever the number of samples.

A name is earned by form: a right law leaves what textbook laws leave on structures, a share of the misfit with a
half-Cauchy distribution (``FORM``; Gelman 2006): it may leave nothing at all, and now and then much. So a law is the
more probable the less it leaves, down to nothing. Of a law that is in no catalogue the best of the effects imitates any
share, small or large; and each further effect of a set any share of what the others left.
docs/decisions.md lists the constants.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import chi2, norm
from scipy.stats import t as student

from hystid.diagnosis.fit.curves import CELLS, CURVE, cells
from hystid.diagnosis.fit.hypothesis import Fit, is_mass
from hystid.diagnosis.fit.problem import Problem
from hystid.numeric import Array
from hystid.smoothing.noise import noise_error

ACCURACY = 0.002  # of the force: what smoothing, interpolation and integration leave (measured without noise)
SOUND = 0.005  # of the force: model error of a structure from which nothing is missing (matched sensors: 0.5 %)
FORM = 0.1  # scale (median) of the model error of a right law, over the misfit it explains (amplitudes)
EXACT = 0.02  # the same of a fault of a channel, which is a gain, a delay or a polynomial and nothing else
PRIOR: dict[str | int, float] = {
    "nothing": 0.5,
    "unknown": 0.1,
    1: 0.3,
    2: 0.07,
    3: 0.02,
    "window": 0.05,
}  # before any data are seen
_THIN = 1e-9  # width of an interval of shares whose probability rounding leaves
_VISITED = 0.001  # of the rows: a cell that holds fewer says nothing
ZERO = 0.02  # of the standard deviation of a channel: how far sensors are off their zero after they were set
NOMINAL = math.log(2)  # scale of the logarithm by which a structure differs from parameters that somebody has given
_NO_MORE = 0.01  # of its nominal value, below which a parameter is nought
_BY_CHANCE = 0.05  # probability at which draws of the noise, and its means over states, count as agreeing by chance
DOUBT = 0.05  # probability of something unknown from which another reading of the recordings is tried
MENTION = 1 / 10**0.5  # odds against a rival that are not worth more than a bare mention (Jeffreys 1961)
CHANCE = 1e-3  # probability below which a hypothesis is not looked at more closely
NAME = 0.5  # probability from which a name is told: a wrong name costs as much as a right one gains


@dataclass(frozen=True)
class FittedSet:
    """A set of effects as fitted. names: ids, strongest first, none for the baseline alone. size: parameters.

    windowed: acts for a part of the time. exact: no form to be wrong, as a fault of a channel. laws: members that have
    a form and are forces of their own: what weakens or pinches the hysteresis is none.
    floor: mean square that noise alone leaves; NaN where it is not known yet. constant: the name that is a constant
    force, "" for none; zero: probability that it is the zero of a sensor and no force. counting: names without those
    of members that do not count, for which it then speaks against its rivals; None where all of them do.
    """

    names: tuple[str, ...]
    size: int
    fit: Fit = field(repr=False)
    windowed: bool = False
    exact: bool = False
    floor: float = float("nan")
    unseen: float = 0.0
    constant: str = ""
    zero: float = 0.0
    laws: int = 1
    counting: frozenset[str] | None = None

    @property
    def numbers(self) -> int:
        """Real parameters of the named effects: a side that is chosen is none."""
        return self.size - sum(len(t.effect.choices) for t in self.fit.hypothesis.terms if t.effect.id in self.names)


@dataclass(frozen=True)
class Candidate:
    """A set of effects with its probability and the share of the misfit above the noise that it explains."""

    names: tuple[str, ...]
    probability: float
    explained: float
    hypothesis: FittedSet = field(repr=False)


@dataclass(frozen=True)
class Posterior:
    """Probabilities that add up to 1: nothing missing, an unknown law, and the candidates (most probable first).

    zero: the baseline with the zero of a sensor, where that is what is most likely.
    """

    nothing: float
    unknown: float
    candidates: tuple[Candidate, ...] = ()
    zero: FittedSet | None = field(default=None, repr=False)

    @property
    def something(self) -> float:
        """Probability that something is missing."""
        return 1.0 - self.nothing

    @property
    def likely(self) -> list[FittedSet]:
        """Hypotheses that are worth a closer look, most probable first."""
        return [c.hypothesis for c in self.candidates if c.probability > CHANCE]

    def of(self, names: Sequence[str]) -> float:
        """Probability that at least one of some ids is among what is missing."""
        return sum(c.probability for c in self.candidates if set(c.names) & set(names))


class Criterion:
    """The likelihood of hypotheses about one problem.

    ids: number of effects that are tried, each as probable as any other. level: mean square by which the noise differs
    from what the channels show above the motion.
    """

    level = 0.0

    def __init__(self, problem: Problem, baseline: Fit, ids: int) -> None:
        self.problem, self.baseline, self.ids = problem, baseline, max(ids, 1)
        self.rows = len(baseline.residual)
        self.states = effective_states(problem)
        mass = baseline.hypothesis.mass()
        force = problem.reduce([part.F for part in problem.parts])
        restoring = problem.reduce([part.F - mass * part.inertia for part in problem.parts])
        self.force = float(max(np.mean(force**2), np.mean(restoring**2)))
        self._told = np.flatnonzero(problem.reduce.told())
        self._added = self._added_by(baseline)
        self._open = problem.reduce.left_open(baseline.residual)
        self.floor = problem.reduce.level + self._open + float(np.mean(self._added))
        self.each = self.rows / self.states  # rows per independent value of the model error
        self._by_chance = float(chi2.ppf(1 - _BY_CHANCE, self.states))
        self._place = _places([problem])[0][self._told]
        self._bias = self._standing(problem.bias_rows(baseline.hypothesis))

    def at(self, level: float) -> Criterion:
        """The same where the noise is of another level: what a law leaves counts against the noise that there is."""
        made = copy(self)
        made.level = level
        return made

    @property
    def least(self) -> float:
        """Variance of an average where nothing but noise and the error of the preparation is left."""
        return 1.0 + max(self.level, 0.0) + self.each * self.accuracy

    @property
    def accuracy(self) -> float:
        """Mean square that the error of the preparation leaves."""
        return ACCURACY**2 * self.force

    def misfit(self, fit: Fit, floor: float) -> float:
        """Mean square above the noise, and above what nobody knows of where a law stands: leaving less of that than the
        baseline gains nothing. floor: of the noise; NaN for that of the baseline."""
        less = max(self._open - self.problem.reduce.left_open(fit.residual), 0.0)
        known = floor if np.isfinite(floor) else self.floor
        # Noise that a law is said to add, as far as it is there at the level that noise has.
        known = min(known, max(fit.chi2 + less - self.level, self.floor))
        return max(fit.chi2 + less - known - self.level, self.standing(fit, known))

    def standing(self, fit: Fit, known: float) -> float:
        """Mean square of what stands in the means over the states that the motion visits, beyond what noise leaves of
        it, and the bias of the smoother: noise averages out there, however loud it is said to be. -inf where it is
        none, as far as noise can tell.
        """
        noise = (known + max(self.level, 0.0)) / self.rows
        stands = self._standing(fit.residual) - self._bias
        return stands - self.states * noise if stands > self._by_chance * noise else -math.inf

    def _standing(self, rows: Array) -> float:
        sums = np.bincount(self._place, rows[self._told], CELLS**2)
        counts = np.maximum(np.bincount(self._place, minlength=CELLS**2), 1)
        return float(np.sum(sums**2 / counts)) / self.rows

    def _added_by(self, fit: Fit, draws: int = 0) -> Array:
        """What noise of the motion, one value per draw of it, and the bias of the smoother add to the mean square."""
        bias = float(np.sum(self.problem.bias_rows(fit.hypothesis)[self._told] ** 2)) / self.rows
        return self.problem.noise_added(fit.hypothesis, draws) + bias

    def floor_of(self, fit: Fit) -> float:
        """Mean square that noise alone leaves of a fit: as much more than of the baseline as draws of the noise agree
        on (Student's t, shrunk by the garrote of Breiman 1995), so that no limit parts two fits of one law.
        """
        more = self._added_by(fit, len(self._added)) - self._added
        mean, error = float(np.mean(more)), float(np.std(more, ddof=1)) / np.sqrt(len(more))
        by_chance = float(student.ppf(1 - 0.5 * _BY_CHANCE, len(more) - 1)) * error
        return self.floor + mean * max(1.0 - (by_chance / mean) ** 2, 0.0) if mean else self.floor

    def variance(self, misfit: float) -> float:
        """Variance of one of the averages."""
        return self.least + self.each * max(misfit, 0.0)

    def likelihood(self, misfit: float) -> float:
        """Logarithm of the likelihood, up to a constant."""
        return -0.5 * self.states * float(np.log(self.variance(misfit)))

    def penalty(self, size: int, effects: int, misfit: float) -> float:
        """What a hypothesis pays for its parameters (Schwarz 1978, with the samples that count as independent), and for
        being one of many."""
        return 0.5 * size * self.samples(misfit) + effects * float(np.log(self.ids))

    def samples(self, misfit: float) -> float:
        """Logarithm of the number of samples that count as independent."""
        return float(np.log(max(self.states, self.rows / self.variance(misfit))))

    def departure(self, fit: Fit) -> float:
        """What a fit pays for parameters of the baseline far from those that were given (a Cauchy distribution of the
        logarithm, ``NOMINAL``), beyond what the recordings leave open: a wrong law drags the baseline along. The mass
        that an added one leaves is such a parameter: what was weighed does not vanish."""
        base, cost = self.problem.baseline, 0.0
        stated = [name for name in base.free if name in base.stated]
        found = [(base.nominal[name], fit.hypothesis.values[name], ("base", name)) for name in stated]
        for i, term in enumerate(fit.hypothesis.terms):
            if is_mass(term.effect):
                name = term.effect.semantics.mass
                found.append((base.mass, base.mass + term.values[name], (str(i), name)))
        for given, value, key in found:
            if given != 0:
                open_ = 2 * float(np.nan_to_num(fit.stderr(key)))
                near = value + float(np.clip(given - value, -open_, open_))
                cost += math.log1p((math.log(max(near / given, _NO_MORE)) / NOMINAL) ** 2)
        return cost

    def prior(self, effects: int, *, windowed: bool = False) -> float:
        """Logarithm of the probability, before any data, that so many effects are missing."""
        return float(np.log(PRIOR["window"] if windowed else PRIOR.get(effects, PRIOR[3] / self.ids)))

    def is_settled(self, misfit: float, formed: float) -> bool:
        """Whether no more is left than right laws leave by their form: a further effect would have to take nearly all.

        formed: misfit that is left to laws with a form.
        """
        return misfit < FORM**2 * formed or self.is_reached(misfit)

    def is_reached(self, misfit: float) -> bool:
        """Whether noise, and the error of the preparation, are all that is left."""
        return self.likelihood(0.0) - self.likelihood(misfit - self.slack) < self.price(1, 0.0)

    def price(self, size: int, misfit: float) -> float:
        """What a further effect of so many parameters must gain."""
        return self.penalty(size, 1, misfit) + self.prior(1) - self.prior(2)

    def noise_of(self, rows: int) -> float:
        """Mean square that so many rows of noise reach by chance in one case of twenty."""
        return self.floor * float(chi2.ppf(1 - _BY_CHANCE, rows)) / rows

    def is_more_than_sound(self, misfit: float) -> bool:
        """Whether a misfit is beyond the noise, as well as that is known, and the model error of a sound structure."""
        return misfit > self.slack + SOUND**2 * self.force

    def doubt(self, misfit: float, standing: float) -> float:
        """What it costs that a misfit is that of a sound structure (half-normal, ``SOUND``) and of noise whose level is
        off (normal, ``noise_error``), in the cheapest shares. standing: part of it in which noise averages out."""
        misfit, sound = max(misfit, 0.0), SOUND**2 * self.force
        open_, level = self.slack, max(self.level, 0.0)
        noise = float(np.clip(open_**2 / (2 * sound) - level, 0.0, misfit - max(standing, 0.0)))
        return 0.5 * ((misfit - noise) / sound + noise * (noise + 2 * level) / open_**2)

    @property
    def slack(self) -> float:
        """Mean square that a wrong noise level feigns."""
        samples = sum(len(part) for part in self.problem.parts)
        return noise_error(samples) * (self.floor + max(self.level, 0.0))

    def form(self, misfit: float, whole: float, *, exact: bool = False, laws: int = 1) -> float:
        """Logarithm of the density of what right laws leave, as a share of the misfit, over that of what so many laws
        leave of an unknown one: each of them any share of what the others left.

        What the noise level leaves open counts as left: a small misfit says little about forms.
        """
        open_ = self.slack + ACCURACY**2 * self.force
        left = max(misfit, 0.0) / (max(whole, 0.0) + open_)
        least = min(left, 1.0 - _THIN)
        most = min(max(left + open_ / (max(whole, 0.0) + open_), least + _THIN), 1.0)
        scale = EXACT if exact else FORM
        right = (math.atan(math.sqrt(most) / scale) - math.atan(math.sqrt(least) / scale)) / math.atan(1 / scale)
        by_chance = max(_product(most, laws) - _product(least, laws), most - least)
        return math.log(right / by_chance)

    @property
    def usual(self) -> float:
        """Share of the misfit that a right law leaves by its form with the probability that a normal variable is below
        one standard deviation."""
        return float((FORM * np.tan(norm.cdf(1.0) * np.arctan(1 / FORM))) ** 2)

    def is_worth_a_name(self, misfit: float, without: float, formed: float) -> bool:
        """Whether one member of a set explains what the others leave as a law does, rather than their form.

        Of what their form may leave, a law must show that it takes more than any curve would, by the odds against a
        further one.
        """
        return without > self.usual * formed or self.form(misfit, without) > np.log(PRIOR[1] / PRIOR[2])

    def is_no_form(self, misfit: float, without: float, size: int, curves: Sequence[float]) -> bool:
        """Whether a member of a set explains what no wrong form of the others does. Such forms cost nothing: that a
        right law is off by as much is what ``FORM`` says.

        curves: what they take of the mean square that is left without the member. size: parameters of the member.
        """
        least = max(without - max(curves, default=0.0), 0.0)
        return self.likelihood(misfit) - self.likelihood(least) > self.price(size, misfit)

    def with_level(self, found: Sequence[FittedSet], reached: float) -> Criterion:
        """The same at the level of the noise: what the best hypothesis leaves, as far as the noise may be off, or all
        of it where that is noise alone (reached; infinite where not).

        Noise that a law is said to add counts as left: as far as the noise may be off, it gives no law a lead.
        """
        least = min(self.misfit(h.fit, np.fmin(h.floor, self.floor)) for h in found) if found else np.inf
        best = min(self.misfit(self.baseline, self.floor), least)
        return self.at(best if best < 0 else max(min(best, self.slack), reached if np.isfinite(reached) else 0.0))

    def posterior(self, found: Sequence[FittedSet], *, is_noise: bool, curves: Sequence[float] = ()) -> Posterior:
        """Probabilities of the hypotheses.

        curves: what forces without a law explain of the mean square (``lawfree``). is_noise: the baseline leaves
        noise, whatever its level.
        """
        whole = self.misfit(self.baseline, self.floor)
        idle, found = [h for h in found if h.counting], [h for h in found if not h.counting]
        misfits, far = [self.misfit(h.fit, h.floor) for h in found], self.departure(self.baseline)
        plain = [self._plain(h, m) for h, m in zip(found, misfits, strict=True)]
        moved = [self.departure(h.fit) for h in found]
        doubt = 0.0 if is_noise else -self.doubt(whole, self.standing(self.baseline, self.floor))
        doubt = -math.inf if self.problem.is_held else doubt
        nothing = float(np.log(PRIOR["nothing"])) + self.likelihood(whole) + doubt - far
        # What contradicts a law does not contradict that something else is missing.
        spared = [p - min(h.unseen, 0.0) for h, p in zip(found, plain, strict=True)]
        free = [self.likelihood(m) - 0.5 * CURVE * self.samples(m) for m in (whole - gain for gain in curves)]
        unknown = max([self.likelihood(whole), *spared, *free]) + float(np.log(PRIOR["unknown"])) - min([far, *moved])
        unknown += float(np.log(-np.expm1(min(doubt, -1e-12))))
        scores = np.array([
            nothing, unknown, *(self._score(h, m, whole) - d for h, m, d in zip(found, misfits, moved, strict=True)),
        ])  # fmt: skip
        highest = float(np.max(scores))
        weights = np.exp(scores - highest)
        rows = sorted(_split(found, misfits, weights[2:]), key=lambda row: -row[3])
        zero = next((h for names, h, _, _ in rows[:1] if not names), None)
        merged: dict[frozenset[str], Candidate] = {}
        for names, h, m, w in rows:
            if not names:
                weights[0] += w
            elif frozenset(names) not in merged:
                merged[frozenset(names)] = Candidate(names, w, _explained(m, whole), h)
        for h, score in self._best_of_each(idle, whole):
            _share(merged, h, score - highest)
        listed = sorted(merged.values(), key=lambda c: -c.probability)
        total = float(weights[0] + weights[1] + sum(c.probability for c in listed))
        return Posterior(
            float(weights[0]) / total,
            float(weights[1]) / total,
            tuple(replace(c, probability=c.probability / total) for c in listed),
            zero if zero is not None and weights[0] > 0.5 * total else None,
        )

    def _plain(self, h: FittedSet, misfit: float) -> float:
        """Logarithm of the likelihood of a hypothesis, its parameters paid for."""
        return self.likelihood(misfit) + h.unseen - self.penalty(h.size, len(h.names), misfit)

    def _score(self, h: FittedSet, misfit: float, whole: float) -> float:
        """Logarithm of the probability of a hypothesis, up to a constant, what its baseline departs by not paid for."""
        form = self.form(misfit, whole, exact=h.exact, laws=h.laws)
        return self._plain(h, misfit) + form + self.prior(len(h.names), windowed=h.windowed)

    def _best_of_each(self, found: Sequence[FittedSet], whole: float) -> Iterator[tuple[FittedSet, float]]:
        """The most probable hypothesis of each set of names, with the logarithm of its probability."""
        best: dict[frozenset[str], tuple[FittedSet, float]] = {}
        for h in found:
            score = self._score(h, self.misfit(h.fit, h.floor), whole) - self.departure(h.fit)
            names = frozenset(h.names)
            if names not in best or score > best[names][1]:
                best[names] = h, score
        yield from best.values()

    def gain(self, one: FittedSet, other: FittedSet) -> float:
        """Logarithm of the likelihood of one hypothesis over that of another, parameters not counted."""
        return self.likelihood(self.misfit(one.fit, one.floor)) - self.likelihood(self.misfit(other.fit, other.floor))

    def predicts_else(self, one: FittedSet, other: FittedSet) -> bool:
        """Whether the predictions of two hypotheses differ by more than noise and the model error of a right law."""
        apart = float(np.mean((one.fit.residual - other.fit.residual) ** 2))
        explained = float(np.mean((self.baseline.residual - other.fit.residual) ** 2))
        return apart > FORM * explained + self.least / self.each


def _share(merged: dict[frozenset[str], Candidate], idle: FittedSet, score: float) -> None:
    """Let a set with a member that does not count take its part of the probability of sets that have another one
    instead, for what is left of it. score: logarithm of its weight."""
    left = idle.counting
    if left is None or left not in merged:
        return
    for names, rival in list(merged.items()):
        if left < names and len(names) == len(left) + 1 and rival.probability > 0:
            part = rival.probability * float(expit(score - math.log(rival.probability)))
            merged[left] = replace(merged[left], probability=merged[left].probability + part)
            merged[names] = replace(rival, probability=rival.probability - part)


def _explained(misfit: float, whole: float) -> float:
    """Share of a misfit that is explained where so much is left."""
    return float(np.clip(1.0 - misfit / whole, 0.0, 1.0)) if whole > 0 else 0.0


def _product(share: float, factors: int) -> float:
    """Probability that a product of uniform shares is below a share."""
    share = min(max(share, 1e-300), 1.0)
    return share * sum((-math.log(share)) ** k / math.factorial(k) for k in range(factors))


def leaves_noise(problem: Problem, fit: Fit) -> bool:
    """Whether noise, and the error of the preparation, are all that a fit of the baseline leaves."""
    criterion = Criterion(problem, fit, 1)
    return criterion.is_reached(criterion.misfit(fit, criterion.floor))


def variance_of_states(problem: Problem, fit: Fit) -> float:
    """Variance of an average over one state of the motion, in units of the noise, with what a fit leaves: in such
    averages, or beyond what a wrong noise level feigns."""
    criterion = Criterion(problem, fit, 1)
    stands = criterion.standing(fit, criterion.floor)
    return 1.0 + criterion.each * max(stands, criterion.misfit(fit, criterion.floor) - criterion.slack, 0.0)


def zero_probability(share: float) -> float:
    """Probability that a constant force is the zero of a sensor: how far sensors are off (half-normal, ``ZERO``)
    against a preload of any size up to that of the motion.

    share: displacement that the force holds, over the standard deviation of the displacement.
    """
    odds = 2 * float(norm.pdf(share, scale=ZERO))
    return odds / (1 + odds) if share < 1 else 0.0


def _split(
    found: Sequence[FittedSet], misfits: Sequence[float], weights: Array
) -> Iterator[tuple[tuple[str, ...], FittedSet, float, float]]:
    """Names, hypothesis, misfit and weight; what may be the zero of a sensor counts for both."""
    for h, m, w in zip(found, misfits, weights, strict=True):
        if h.zero:
            yield tuple(name for name in h.names if name != h.constant), h, m, float(w) * h.zero
        yield h.names, h, m, float(w) * (1 - h.zero)


def visited(problems: Sequence[Problem]) -> list[NDArray[np.bool_]]:
    """Cells of one phase plane of all problems in which each of them has at least a thousandth of its rows.

    A recording that is given twice, or goes on in the same way, visits no further state.
    """
    return [np.bincount(place, minlength=CELLS**2) > _VISITED * len(place) for place in _places(problems)]


def _places(problems: Sequence[Problem]) -> list[NDArray[np.int64]]:
    """Number of the cell of each row, in one phase plane of all problems."""
    pairs = [
        [
            np.concatenate([p.reduce.plain(i, getattr(part, name)) for i, part in enumerate(p.parts)])
            for name in ("x", "v")
        ]
        for p in problems
    ]
    ends = np.cumsum([len(x) for x, _ in pairs])[:-1]
    return np.split(cells(*(np.concatenate(columns) for columns in zip(*pairs, strict=True))), ends)


def effective_states(problem: Problem) -> float:
    """Number of states that the motion visits."""
    return float(np.count_nonzero(visited([problem])[0]))
