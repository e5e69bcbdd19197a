"""Does the force belong to the motion: its sign, its clock, and the mass that it moves.

m a + R = F with a law-free R: any curve of the displacement, a force that grows with the velocity and one that takes
its sign. Mass and damping are not negative: that decides about the sign. For the clock and for the mass, R may also be
any curve of the way since the last turn, so that a hysteresis is not read as a delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hystid.consistency.force_columns import FEWEST, REST, ForceColumns, columns_of
from hystid.consistency.kinematics import motion
from hystid.recording import Array, Recording

_ROWS = 4000  # rows of the least squares
_BLOCKS = 8  # of the recording, each left out once for the standard error of the mass
_NEAR_SHIFTS = (-1, 0, 1)  # samples by which channels of one logger may differ, that are scanned one after the other
_FURTHEST = 20_000  # samples that two clocks may be apart
_ALIKE_SHIFTS = 1.3  # times the smallest unexplained share: up to there the smaller shift, for a sine repeats itself
_PERIODS = 4  # of the motion, over which its energy is averaged
_TENTH = 0.1  # of the force, by which a mass would change it
_NOISY = 0.2  # of an acceleration: twice what sensors of 20 dB leave
EXPLAINED = 0.5  # of the power of the force that laws explain, from which it belongs to the motion
GIVEN = 0.25  # of ln(mass): a weighed mass moves with fixtures, cables and a third of its springs
_WEIGHED = 0.37  # of a weighed mass: four standard deviations of what fixtures and springs add to its logarithm
SIGMAS_SIGN = 1.96  # standard errors of a quantity, from which its sign is known (95 %)
SIGMAS_FORCE = (
    5.0  # of a lag: fewer than between channels of the motion, for the power that is left has to drop as well
)
_FOURFOLD = 4.0  # drop of the unexplained power by a shift, a half of its size: a law may look late, but not so late


def off_weighing(ratio: float, error: float) -> float:
    """Standard errors by which a mass that a force shows is off a weighed one. ratio: of the two; error: of its
    logarithm, from the test."""
    return abs(math.log(ratio)) / math.hypot(GIVEN, error)


@dataclass(frozen=True)
class Force:
    """What the force says.

    share: of its variance that a passive structure with that sign explains; reversed_share: of the reversed force.
    mass, mass_error: apparent moving mass [kg]; infinite error where the test does not show it.
    power: mean of F v over the product of their rms (positive: the structure takes energy up).
    stiffness: slope of F over x [N/m]; correlation of the two. lag [s]: how much later the force is, with its error;
    free_share and free_lag_share: what any law explains before and after that shift; lag_share, lag_reversed: a
    passive one after it. samples: number of independent samples that tell the sign, from the correlation time of what
    is left. law: relative error of the mass from laws that the free ones do not follow. weight [1/kg]: what a mass adds
    to the force that no law makes, over the rms of the force; 0 where noise may add as much. shown: share of the force
    that laws explain without any mass, where the acceleration tells of it. hidden_lag [s]: shifts of the force that
    leave less than fourfold of what the best one leaves: a law that looks late may be behind them. source: channel that
    the acceleration is taken from.
    """

    share: float
    reversed_share: float
    mass: float
    mass_error: float
    power: float
    stiffness: float
    correlation: float
    lag: float
    lag_error: float
    free_share: float
    free_lag_share: float
    lag_share: float
    lag_reversed: float
    samples: float
    law: float
    weight: float
    hidden_lag: float
    shown: float
    source: str

    @property
    def mass_ratio_error(self) -> float:
        """Standard error of ln(mass), of chance and of laws; infinite where the test does not show the mass."""
        if not np.isfinite(self.mass_error) or not self.mass:
            return np.inf
        return float(np.hypot(self.mass_error / abs(self.mass), self.law))

    @property
    def power_known(self) -> float:
        """Size of ``power`` from which its sign is known."""
        return float(SIGMAS_SIGN / np.sqrt(max(self.samples, 1.0)))

    @property
    def moves_mass(self) -> bool:
        """Whether it shows that it moves a mass."""
        return self.mass > 0 and self.mass_ratio_error < 1 / SIGMAS_SIGN

    def is_of(self, mass: float, most: float = SIGMAS_SIGN) -> bool:
        """Whether it shows a mass within ``most`` standard errors of a weighed one."""
        error = self.mass_ratio_error
        return self.mass > 0 and math.isfinite(error) and off_weighing(self.mass / mass, error) < most

    def denies(self, mass: float) -> bool:
        """Whether a mass would show in the force, and next to none does.

        Next to none: less than a weighed one can be off. To show: a tenth of the force, and six standard errors, both
        of chance and of what laws leave (that the acceleration absorbs as much as they leave is two of them). Where a
        structure swings by itself, inertia and restoring force cancel, and no law takes a small force well; a force
        that brakes the motion there is the exciter's own law, and not that of a structure without a mass.
        """
        if self.power < -self.power_known:
            return False
        if not np.isfinite(self.mass_error) or min(self.free_share, self.shown) < EXPLAINED:
            return False
        lacking = mass - abs(self.mass)
        left = max(1.0 - self.free_share, 0.0) ** 0.5
        shows = lacking * self.weight > max(_TENTH, 3.0 * left) and lacking > 6.0 * self.mass_error
        return abs(self.mass) < _WEIGHED * mass and shows


def examine_force(recording: Recording, *, placed: bool = False) -> Force | None:
    """The force of one recording against its motion; None where the force is zero or the motion does not move.

    placed: the mass beside dampers that follow the place as well. Near a resonance these are most of the force, and
    elsewhere they take from the mass what tells it.
    """
    columns = columns_of(recording)
    if columns is None:
        return None
    limit = min(len(columns.F) // 4, _FURTHEST)
    fit = _Fit(columns, limit)
    now, flipped = (max(fit.passive(k, sign) for k in _NEAR_SHIFTS) for sign in (1.0, -1.0))
    shift = fit.best_shift()
    there, back = (max(fit.passive(shift + k, s) for k in _NEAR_SHIFTS if abs(shift + k) <= limit) for s in (1.0, -1.0))
    first = 0 if recording.quasi_static else _settled(columns)
    if first:
        now, flipped = _passive_from(columns, first, 0)
        there, back = _passive_from(columns, first, shift)
    still = recording.quasi_static or first == len(columns.F)
    mass, error, law, weight, shown = _mass(columns_of(recording, curved=True) or columns, still, placed)
    left = _left(columns)
    F, v, x = columns.F - np.mean(columns.F), columns.signed[:, 1], columns.x - np.mean(columns.x)
    lag, lag_error = _fine(columns, fit, shift)
    size = max(float(np.sqrt((F @ F) * (x @ x))), 1e-300)
    power = float(F @ v) / max(float(np.sqrt((F @ F) * (v @ v))), 1e-300)
    return Force(
        now, flipped, mass, error, power, float(F @ x) / max(float(x @ x), 1e-300), float(F @ x) / size,
        lag * recording.dt, lag_error * recording.dt, fit.freely(0), fit.freely(shift), there, back,
        (1 - first / len(F)) * len(left) / max(_memory(left), 1.0), law, weight,
        fit.hidden(shift) * recording.dt, shown, list(motion(recording))[-1],
    )  # fmt: skip


def is_late(recording: Recording, force: Force) -> bool:
    """Whether the force comes clearly later or earlier than its motion, by the same time all through the recording."""
    if recording.quasi_static or not math.isfinite(force.lag_error):
        return False
    clear = abs(force.lag) > 1.5 * recording.dt and abs(force.lag) > SIGMAS_FORCE * force.lag_error
    if force.power > force.power_known and force.share > max(force.reversed_share, force.lag_share):
        return False  # what drives the motion as it stands is not moved to where it would have to be reversed as well
    before, after = max(force.share, force.reversed_share), max(force.lag_share, force.lag_reversed)
    passive = (1 - before) > _FOURFOLD * (1 - after)
    return clear and (passive or (1 - force.free_share) > _FOURFOLD * (1 - force.free_lag_share))


def _settled(columns: ForceColumns) -> int:
    """First sample from which on the motion has no more energy than at the end, 0 where it begins at rest; the number
    of samples where it dies away to the end.

    Before, the structure gives out what it had stored: a decay whose exciter drags along has a negative power and the
    right sign.
    """
    v, x = columns.signed[:, 1], columns.x
    turn = float(np.sqrt(np.sum(np.diff(v) ** 2) / max(float(v @ v), 1e-300)))  # radians per sample
    window = int(np.clip(_PERIODS * 2 * np.pi / max(turn, 1e-9), 2, len(v) // 2))
    mean, square = (np.convolve(u, np.full(window, 1.0 / window), mode="valid") for u in (v, v**2))
    energy = square - mean**2  # the zero of a sensor is no motion
    first = max(window // (8 * _PERIODS), 1)  # an eighth of a period
    away = np.mean(x[:first]) - np.mean(x[-window:])  # what is let go has its energy in the spring
    begun = max(
        float(np.mean((v[:first] - np.mean(v)) ** 2)) / max(float(np.max(v**2)), 1e-300),
        float(away**2) / max(float(np.max((x - np.mean(x[-window:])) ** 2)), 1e-300),
    )
    if begun < REST:
        return 0
    falls = bool(np.all(np.diff(energy[::-1][::window]) >= 0))
    dies_away = falls and energy[-1] < 0.5 * energy[0]  # it has given out more than it still has
    return len(v) if dies_away else int(np.argmax(energy <= energy[-1]))


def _passive_from(columns: ForceColumns, first: int, shift: int) -> tuple[float, float]:
    """Shares that a passive structure explains of the force, and of the reversed one, from a sample on.

    Both are alike where too little is left to tell: few samples, or less than half of the power of the force.
    """
    later = columns.part(slice(first, None))
    limit = abs(shift) + 1
    if len(later.F) < FEWEST + 2 * limit or not np.ptp(later.F):
        return 0.0, 0.0
    fit = _Fit(later, limit)
    now, flipped = (max(fit.passive(shift + k, sign) for k in _NEAR_SHIFTS) for sign in (1.0, -1.0))
    left, right = np.split((columns.F - np.mean(columns.F)) ** 2, [first])
    tells = np.sum(right) > EXPLAINED * (np.sum(left) + np.sum(right))
    return (now, flipped) if tells else (max(now, flipped),) * 2


class _Fit:
    """Least squares of the shifted force on the columns, at any shift for the cost of a small system.

    The columns stay where they are; the force is moved, and nothing is known of it outside of the recording.
    """

    def __init__(self, columns: ForceColumns, limit: int) -> None:
        table = np.concatenate([columns.signed, columns.free, columns.memory], axis=1)
        table = table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300)
        self.limit, n = limit, len(columns.F)
        force = columns.F - np.mean(columns.F)
        self.total = max(float(force @ force), 1e-300)
        size = 1 << int(np.ceil(np.log2(n + limit + 1)))
        spectra = np.fft.rfft(force, size)[:, None] * np.conj(np.fft.rfft(table, size, axis=0))
        cross = np.fft.irfft(spectra, size, axis=0)
        self.cross = np.concatenate([cross[-limit:], cross[: limit + 1]]) if limit else cross[:1]
        gram = table.T @ table + 1e-9 * n * np.eye(table.shape[1])
        values, vectors = np.linalg.eigh(gram)
        self.everything = vectors / np.sqrt(np.maximum(values, 1e-9 * n))
        self.free = slice(3, 3 + columns.free.shape[1])
        self.inverse = np.linalg.inv(gram[self.free, self.free])
        self.taken = self.inverse @ gram[self.free, :3]  # of the signed columns by the curve of the displacement
        values, vectors = np.linalg.eigh(gram[:3, :3] - gram[:3, self.free] @ self.taken)
        self.root = vectors * np.sqrt(np.maximum(values, 1e-9 * n))  # root root' is what is left of the signed columns

    def passive(self, shift: int, sign: float = 1.0) -> float:
        """Share of the variance of the force that a passive structure explains, after a shift and with a sign."""
        from scipy.optimize import nnls

        row = sign * self.cross[shift + self.limit]
        free = row[self.free]
        reduced = np.linalg.solve(self.root, row[:3] - self.taken.T @ free)
        left = float(nnls(self.root.T, reduced)[1]) ** 2
        return (float(free @ self.inverse @ free) + float(reduced @ reduced) - left) / self.total

    def freely(self, shift: int) -> float:
        """Share that any law explains, with a memory of the last turn and with signs as they come."""
        return float(np.sum((self.cross[shift + self.limit] @ self.everything) ** 2)) / self.total

    def hidden(self, shift: int) -> int:
        """Samples by which the force can be moved from a shift before four times as much is left unexplained."""
        shares = np.sum((self.cross @ self.everything) ** 2, axis=1) / self.total
        worse = np.flatnonzero(1.0 - shares > _FOURFOLD * (1.0 - shares[shift + self.limit]))
        return int(np.min(np.abs(worse - self.limit - shift))) if worse.size else self.limit

    def best_shift(self) -> int:
        """The shift [samples] at which any law explains most; the smallest of those that do nearly as well.

        A sine repeats itself, and what is left of a smooth force hardly changes from sample to sample.
        """
        shares = np.sum((self.cross @ self.everything) ** 2, axis=1) / self.total
        alike = np.flatnonzero(1.0 - shares <= _ALIKE_SHIFTS * (1.0 - float(np.max(shares))) + 1e-3)
        at = int(alike[np.argmin(np.abs(alike - self.limit))])
        while 0 < at < len(shares) - 1 and (step := int(np.argmax(shares[at - 1 : at + 2])) - 1):
            at += step
        return at - self.limit


def _fine(columns: ForceColumns, fit: _Fit, shift: int) -> tuple[float, float]:
    """Best shift between samples by a parabola, and its standard error from quarters of the recording.

    A blow lies in one of them: the error then follows from what is left of the force, and from how steep that is.
    """
    sign = 1.0 if fit.passive(shift) >= fit.passive(shift, -1.0) else -1.0
    found = []
    for part in np.array_split(np.arange(len(columns.F)), 4):
        one = columns.part(slice(part[0], part[-1] + 1))
        reach = min(abs(shift) + 8, len(part) // 3)
        if len(part) >= FEWEST and np.ptp(one.F) > 0.1 * np.ptp(columns.F) and reach > abs(shift):
            own = _Fit(one, reach)
            near = [k for k in range(shift - 8, shift + 9) if abs(k) <= reach]
            found.append(near[int(np.argmax([own.passive(k, sign) for k in near]))])
    error = float(np.std(found, ddof=1) / np.sqrt(len(found))) if len(found) > 2 else _of_one_blow(columns, fit, shift)
    if abs(shift) >= fit.limit:
        return float(shift), max(error, 0.5)
    three = [fit.freely(shift + k) for k in (-1, 0, 1)]
    bend = three[0] - 2 * three[1] + three[2]
    between = 0.5 * (three[0] - three[2]) / bend if bend < 0 else 0.0
    return shift + float(np.clip(between, -0.5, 0.5)), max(error, 0.1)


def _of_one_blow(columns: ForceColumns, fit: _Fit, shift: int) -> float:
    steep = float(np.sum(np.diff(columns.F) ** 2))
    left = (1.0 - fit.freely(shift)) * fit.total / len(columns.F) * _memory(_left(columns))
    return float(np.sqrt(max(left, 0.0) / steep)) if steep > 0 else np.inf


def _table(columns: ForceColumns) -> tuple[Array, Array]:
    """Rows of all columns, each of rms 1, and of the force, thinned."""
    step = max(1, len(columns.F) // _ROWS)
    table = np.concatenate([columns.signed, columns.free, columns.memory], axis=1)[::step]
    return table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300), columns.F[::step]


def _left(columns: ForceColumns) -> Array:
    table, force = _table(columns)
    return np.asarray(force - table @ np.linalg.lstsq(table, force, rcond=None)[0])


def _memory(left: Array) -> float:
    """Correlation time [rows] of a series."""
    plain = left - np.mean(left)
    size = 1 << int(np.ceil(np.log2(2 * len(plain))))
    found = np.fft.irfft(np.abs(np.fft.rfft(plain, size)) ** 2, size)[: len(plain) // 2]
    if found[0] <= 0:
        return 1.0
    rho = found / found[0]
    end = int(np.argmax(rho < 0.1)) or len(rho)
    return 1.0 + 2.0 * float(np.sum(np.abs(rho[1:end])))


def _mass(columns: ForceColumns, quasi_static: bool, placed: bool) -> tuple[float, float, float, float, float]:
    """Apparent mass with a free law beside it, its standard error (one block left out at a time), the relative error
    that laws of another form can make, and ``weight`` and ``shown`` of the answer.

    placed: with dampers that follow the place, as ``examine_force``. What no free law explains is there for the
    acceleration to absorb as well: that it absorbed no more than what it left is taken as the limit of 95 %, two
    standard errors.
    """
    if quasi_static:
        return np.nan, np.inf, np.inf, 0.0, 0.0
    table, force = _table(columns)
    step = max(1, len(columns.F) // _ROWS)
    if placed:
        x, v = (column[::step] / max(float(np.std(column)), 1e-300) for column in (columns.x, columns.signed[:, 1]))
        table = np.concatenate([table, np.stack([x * v, np.abs(x) * v], axis=1)], axis=1)
    size = float(np.sqrt(np.mean(columns.signed[::step, 0] ** 2)))
    others = table[:, 1:]
    alone = table[:, 0] - others @ np.linalg.lstsq(others, table[:, 0], rcond=None)[0]
    # blocks of one share of what tells the mass: of a blow, one of equal length would hold all of it
    told = np.cumsum(alone**2) / max(float(alone @ alone), 1e-300)
    blocks = np.split(np.arange(len(force)), np.searchsorted(told, np.arange(1, _BLOCKS) / _BLOCKS))
    fit = np.linalg.lstsq(table, force, rcond=None)[0]
    left_out = [
        float(np.linalg.lstsq(np.delete(table, rows, axis=0), np.delete(force, rows), rcond=None)[0][0]) / size
        for rows in blocks
    ]
    error = float(np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((np.array(left_out) - np.mean(left_out)) ** 2)))
    absorbed = float(np.std(force - table @ fit) / max(float(np.std(alone)), 1e-300))
    own = float(np.std(alone))
    drawn = columns.noise[::step] / size
    loud = 2.0 * float(np.std(drawn - others @ np.linalg.lstsq(others, drawn, rcond=None)[0]))
    weight = size * own / max(float(np.std(force)), 1e-300) if own > _NOISY else 0.0
    if own <= loud:  # noise has no mass
        error, weight = np.inf, 0.0
    left = force - others @ np.linalg.lstsq(others, force, rcond=None)[0]
    shown = 1.0 - float(alone**2 @ left**2) / max(float(alone**2 @ (force - np.mean(force)) ** 2), 1e-300)
    return float(fit[0]) / size, error, 0.5 * absorbed / max(abs(float(fit[0])), 1e-300), weight, shown
