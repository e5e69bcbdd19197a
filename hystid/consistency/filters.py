"""Which filter, or which lag, stands between two channels of one motion: one response, several forms compared.

A lag, an AC-coupled sensor and the low-pass of an amplifier all turn the phase; each does so with a course of its own
over frequency, and two of them change the size as well. So the forms are fitted to the complex response, and compared
by their likelihood, not one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hystid.consistency.kinematics import ORDER, RESPONSE_ERROR, Pair, median, motion
from hystid.consistency.spectra import Bands, compare
from hystid.recording import Array, Recording

Complex = NDArray[np.complex128]
_ERRORS = RESPONSE_ERROR / 2.0 ** np.arange(4)  # what chains may leave, the worst first
_PRIOR = math.log(100.0)  # one channel in a hundred has a filter inside the band of the test
_SURE_ODDS = math.log(1e3)  # odds beyond: a note on a sound recording costs trust in all others
MATTERS = 0.01  # share of the power of the motion: a tenth of its size
_FEIGNED = 0.1  # share of the work taken up that a phase may feign: no test states a damping closer
_FEWEST_BANDS = 5  # bands with motion: a form has two unknowns, in size and phase each
_BEYOND = 10.0  # corner outside of the motion, as a factor: beyond, a first-order filter turns by less than a tenth
_TAILS = 3.0  # degrees of freedom of the errors of a band, the fewest with a variance


@dataclass(frozen=True)
class Form:
    """What stands between two channels.

    side: "low" (loses low frequencies) or "high" (loses high ones). channel: whose filter it is. corner [rad/s] at 3 dB
    (6 dB for a filter without phase). gain, sign: of the pair in the band that the filter passes. odds: ln of the odds
    against a plain or late response.
    """

    side: str
    channel: str
    corner: float
    gain: float
    sign: float
    odds: float


def filtered(recording: Recording, p: Pair, inertia: float = 0.0) -> Form | None:
    """The filter between two channels, None where a plain or a late response does as well.

    inertia [s2/m]: mass over that share of F which does work; 0 where nobody knows it.
    """
    channels = motion(recording)
    order = ORDER[p.high] - ORDER[p.low]
    found = compare(channels[p.low], channels[p.high], order, recording.dt)
    at = found.seen
    if np.count_nonzero(at) < _FEWEST_BANDS:
        return None
    plain, made = -math.inf, []
    for sign in (1.0, -1.0):  # a filter turns the phase by more than a quarter of a period: what looks reversed may not
        held = _Held(found, at, sign)
        plain = max(plain, float(held.likelihood(np.ones_like(held.response))), held.late(p.lag))
        made += [(*held.best(side, channel, shape), held, sign) for side, channel, shape in _forms(p, held.omega)]
    best, answer, corner, (side, channel), held, sign = max(made, key=lambda item: item[0])
    odds = best - plain - _PRIOR - 0.5 * math.log(len(held.omega))
    if odds < _SURE_ODDS:
        return None
    size = float(np.std(channels[p.high]))
    # near a resonance a spring bears as much as the inertia: a turned phase of x or a feigns work, and that of v none
    feigned = inertia * held.damping(answer, size, ORDER["a"] - ORDER[p.high]) if channel in "xa" else 0.0
    if not held.matters(answer, order) and feigned < _FEIGNED:
        return None
    return Form(side, channel, corner, held.gain(answer), sign, odds)


def _butterworth(order: int, s: Complex) -> Complex:
    """Denominator of Butterworth's filters of order 1, 2 and 4."""
    if order == 1:
        return np.asarray(1.0 + s)
    if order == 2:
        return np.asarray(1.0 + math.sqrt(2.0) * s + s**2)
    return np.asarray((1.0 + 0.76537 * s + s**2) * (1.0 + 1.84776 * s + s**2))


def _passes(side: str, order: int, both: bool, omega: Array) -> Callable[[Array], Complex]:
    """Responses of a filter, shape (corners, bands), over its corners; both: run both ways, so without a phase."""

    def made(corners: Array) -> Complex:
        s: Complex = np.asarray(1j * omega / corners[:, None], dtype=np.complex128)
        answer = (s**order if side == "low" else 1.0) / _butterworth(order, s)
        return np.asarray(np.abs(answer) ** 2 + 0j if both else answer)

    return made


def _forms(p: Pair, omega: Array) -> list[tuple[str, str, Callable[[Array], Complex]]]:
    """(side that is lost, channel, response of the pair over the corner)."""
    found = []
    for side, (order, both) in product(("low", "high"), ((1, False), (2, False), (4, False), (2, True), (4, True))):
        shape = _passes(side, order, both, omega)
        found.append((side, p.high, shape))
        found.append((side, p.low, _inverse(shape)))
    return found


def _inverse(shape: Callable[[Array], Complex]) -> Callable[[Array], Complex]:
    return lambda corners: np.asarray(1.0 / shape(corners))


class _Held:
    """The response of a pair in its bands, and how likely a form makes it."""

    def __init__(self, found: Bands, at: NDArray[np.bool_], sign: float) -> None:
        self.omega, self.response = found.omega[at], found.response[at] * sign
        # what a chain leaves beside noise is not known: each form is judged with what suits it, at most the largest
        self.weights = 1.0 / (found.variance[at] + _ERRORS[:, None] ** 2)
        # which channel holds the noise is not known: the size lies anywhere between the estimates blind to either
        between = np.log(found.coherence[at]) ** 2 / 12.0
        self.size_weights = 1.0 / (found.variance[at] + _ERRORS[:, None] ** 2 + between)
        self.low, self.high = found.low[at], found.high[at]

    def likelihood(self, forms: Complex) -> Array:
        """ln of the likelihood with the best gain, under errors with heavy tails: a band may hold what leaked in.

        forms: shape (..., bands); the answer has shape (...,).
        """
        size = np.log(np.abs(self.response)) - np.log(np.maximum(np.abs(forms), 1e-12))
        phase = np.angle(self.response * np.conj(forms))
        found = []
        for weight, size_weight in zip(self.weights, self.size_weights, strict=True):
            left = size_weight * (size - median(size, size_weight)[..., None]) ** 2 + weight * phase**2
            spread = 0.5 * float(np.sum(np.log(weight) + np.log(size_weight)))
            found.append(spread - 0.5 * (_TAILS + 2.0) * np.sum(np.log1p(left / _TAILS), axis=-1))
        return np.asarray(np.max(found, axis=0))

    def gain(self, form: Complex) -> float:
        """Size of the response where the form is 1."""
        size = np.log(np.abs(self.response)) - np.log(np.maximum(np.abs(form), 1e-12))
        return float(np.exp(median(size, self.size_weights[0])))

    def late(self, lag: float) -> float:
        """The same of the best lag, near one and near none."""
        step = math.pi / float(self.omega[-1])
        tried = np.concatenate([lag + step * np.linspace(-1, 1, 81), step * np.linspace(-1, 1, 81)])
        return float(np.max(self.likelihood(np.exp(-1j * self.omega * tried[:, None]))))

    def best(
        self, side: str, channel: str, shape: Callable[[Array], Complex]
    ) -> tuple[float, Complex, float, tuple[str, str]]:
        """Likelihood, response and corner of one form at its best corner, and what it is."""
        # What it passes has to be seen; its corner need not: the phase of an AC coupling reaches ten times as far.
        lowest, highest = self.omega[0], self.omega[-1]
        lowest, highest = (lowest / _BEYOND, highest) if side == "low" else (lowest, highest * _BEYOND)
        corners = np.geomspace(lowest, highest, 60)
        k = int(np.argmax(self.likelihood(shape(corners))))
        finer = np.geomspace(corners[max(k - 1, 0)], corners[min(k + 1, 59)], 15)
        answers = shape(finer)
        scores = self.likelihood(answers)
        at = int(np.argmax(scores))
        return float(scores[at]), answers[at], float(finer[at]), (side, channel)

    def damping(self, form: Complex, size: float, order: int) -> float:
        """Work that the turned phase of an acceleration feigns, over the rms of v [m/s2]. size: rms of the higher
        channel, of which the acceleration is the derivative of an order."""
        share = self.high * self.omega ** (2 * order)
        rms = size * math.sqrt(float(np.sum(share)) / float(np.sum(self.high)))
        share = share / float(np.sum(share))
        speed = math.sqrt(float(np.sum(share / self.omega**2)))
        return rms * abs(float(np.sum(share * form.imag / self.omega))) / speed

    def matters(self, form: Complex, order: int) -> bool:
        """Whether the form changes a hundredth of the power, as acceleration or as slow motion."""
        damage = np.abs(1.0 - np.where(np.abs(form) > 1.0, 1.0 / form, form)) ** 2
        power = np.maximum(self.low, self.high)
        return any(
            float(np.sum(damage * w)) > MATTERS * float(np.sum(w)) for w in (power, power / self.omega ** (2 * order))
        )
