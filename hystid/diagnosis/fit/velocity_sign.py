"""What nobody knows of a law where the velocity changes its sign: friction turns there, and holds what stands still."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.stats import norm

from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

Law = Callable[[Sequence[Array]], list[Array]]  # force per part [N] at other velocities [m/s] beside the displacements
_TURN = 0.05  # share of the peak speed over which a contact may turn
_ROUND = 12**-0.5  # share of a jump that the shape of a turn leaves open, where the law has its own turn (uniform)
_FILTERED = 0.3  # share of a jump that filters of the recording chain leave open in the samples beside it
_AT_ONCE = 1e-6  # share of the peak speed over which a jump is one
_NODES = 5  # of a Gauss-Hermite quadrature over a normal distribution
_TINY = 1e-100  # velocity error of what is known exactly [m/s]


def bends(law: Law, parts: Sequence[Part]) -> tuple[list[Array], list[Array]]:
    """What the bend of a law without memory leaves open [N]: over some of the largest speed, and over one sample,
    either way.

    Where such a law jumps with the sign of the velocity, a real contact turns over a finite speed: the force near the
    jump says little. A law that turns over a speed of its own is fitted to what there is. Filters of the recording
    chain round and ring over the samples beside a jump, and beside any turn shorter than a sample.
    """
    fastest, here = _fastest(parts), law([part.v for part in parts])

    def bend(shifts: Sequence[Array | float]) -> list[Array]:
        back, forth = (law([p.v + way * s for p, s in zip(parts, shifts, strict=True)]) for way in (-1, 1))
        return [np.abs(b + f - 2 * a) for a, b, f in zip(here, back, forth, strict=True)]

    falling, rising = (_steady(law, parts, way * _AT_ONCE * fastest) for way in (-1, 1))
    jump = max(float(np.max(np.abs(r - f))) for r, f in zip(rising, falling, strict=True))
    slow, quick = bend([_TURN * fastest] * len(parts)), bend([p.a * p.dt for p in parts])
    sharp = jump > 0.5 * max(float(np.max(b)) for b in slow)
    return [(1.0 if sharp else _ROUND) * s for s in slow], [_FILTERED * q for q in quick]


def unsure(law: Law, parts: Sequence[Part]) -> list[Array]:
    """Standard deviation [N] that the error of the velocity leaves to a law without memory where it bends.

    A few draws of the noise miss most of the samples beside a turn of slow motion, whose side nobody knows. So the
    whole velocity is moved by its error, by the nodes of a Gauss-Hermite quadrature. A contact that may stand still
    holds any force between those of sliding either way. What is linear in the velocity is a damper, and no bend.
    """
    error, fastest = [part.velocity_error() for part in parts], _fastest(parts)
    hardest = float(max(np.max(np.abs(part.a)) for part in parts))
    points, shares = hermegauss(_NODES)
    turned = [law([p.v + node * e for p, e in zip(parts, error, strict=True)]) for node in points]
    sliding = [_steady(law, parts, side * _TURN * fastest) for side in (-2, -1, 1, 2)]
    weights, nodes = shares[:, None] / np.sum(shares), points[:, None]
    found = []
    for i, (part, e) in enumerate(zip(parts, error, strict=True)):
        further, back, forth, beyond = (forces[i] for forces in sliding)
        damper = ((beyond - forth) + (back - further)) / (2 * _TURN * fastest)
        bent = np.array([forces[i] for forces in turned]) - damper * nodes * e
        variance = np.sum(weights * (bent - np.sum(weights * bent, axis=0)) ** 2, axis=0)
        jump = (forth - back) - (beyond - forth) - (back - further)
        rests = _standing_still(part, e, fastest, hardest)
        found.append(np.sqrt(variance + rests * jump**2 / 4))  # the most that forces between them vary (Popoviciu)
    return found


def turns_at_once(transition: float, parts: Sequence[Part]) -> bool:
    """Whether a law turns over so little speed [m/s] as a contact does: one that takes more says what holds there."""
    return transition < longest_turn(parts)


def longest_turn(parts: Sequence[Part]) -> float:
    """Largest speed [m/s] over which a contact turns."""
    return _TURN * _fastest(parts)


def _standing_still(part: Part, error: Array, fastest: float, hardest: float) -> Array:
    """Probability of standing still, (n,), as likely as not before, against any velocity and acceleration up to the
    largest: what turns round has no velocity for an instant, but its largest acceleration."""
    errors = np.maximum(error, _TINY), np.maximum(part.acceleration_error(), _TINY)
    still = norm.pdf(part.v, scale=errors[0]) * norm.pdf(part.a, scale=errors[1])
    return np.asarray(still / (still + 0.25 / (fastest * hardest)))


def _fastest(parts: Sequence[Part]) -> float:
    return float(max(np.max(np.abs(part.v)) for part in parts))


def _steady(law: Law, parts: Sequence[Part], speed: float) -> list[Array]:
    return law([np.full_like(part.v, speed) for part in parts])
