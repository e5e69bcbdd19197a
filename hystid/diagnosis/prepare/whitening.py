"""Filters that make the noise of the balance white, and what they disturb beside ends and gaps.

Noise is not white where the acceleration had to be derived, where noise of the displacement is loud in the force of a
slow test, where the displacement had to be integrated, and where sensors have 1/f noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hystid.diagnosis.prepare.differences import FIRST, SECOND
from hystid.diagnosis.prepare.filtering import filtered, quick_length
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array, Flags
from hystid.smoothing.noise import steps
from hystid.smoothing.smoother import BELOW

_DECAY = 10.0  # radians at the corner of a whitening filter after which nothing is left of an end (exp(-7))


@dataclass(frozen=True)
class Filter:
    """A filter of one part that keeps what is not valid from the rows beside it.

    response: of the whole filter, None for none. valid: samples that it leaves valid, None for all of them.
    image: samples by which a column is continued before the first valid one, its mirror image, as at its end.
    Where slow noise is whitened as well, the filter has two steps, with straight lines over what is not valid in
    between: the first reaches a few samples far, None for none, the second as far as slow noise does.
    gap: these samples; before, after: those on either side of their gaps; share: how near they are to the latter.
    """

    response: Array | None
    valid: Flags | None
    image: NDArray[np.int64]
    first: Array | None
    second: Array | None
    gap: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    share: Array

    @classmethod
    def of(cls, part: Part, response: Array | None, mass: float) -> Filter:
        """That of a part."""
        local, spreads = _local(part, response, mass)
        valid, begun = _clean(part.valid, local), 0 if part.valid is None else int(np.argmax(part.valid))
        image = np.pad(np.arange(begun, len(part)), (begun, 0), "symmetric")[:begun]
        none = np.zeros(0, np.int64)
        if not spreads or response is None or valid is None or np.all(valid) or not np.any(valid):
            return cls(response, valid, image, None, response, none, none, none, np.zeros(0))
        known, gap = np.flatnonzero(valid), np.flatnonzero(~valid)
        place = np.searchsorted(known, gap)
        before, after = known[np.maximum(place - 1, 0)], known[np.minimum(place, len(known) - 1)]
        share = (gap - before) / np.maximum(after - before, 1)
        second = response if local is None else response / local
        return cls(response, valid, image, local, second, gap, before, after, share)

    def __call__(self, column: Array) -> Array:
        """A column, (n,) or several (k, n), after all steps."""
        if len(self.image):
            column = np.concatenate([column[..., self.image], column[..., len(self.image) :]], axis=-1)
        if self.first is not None:
            column = filtered(column, self.first)
        column = self.over(column)
        return column if self.second is None else filtered(column, self.second)

    def over(self, column: Array) -> Array:
        """Columns with straight lines over the gaps; they begin and end as they do beside a gap there."""
        if not len(self.gap):
            return column
        made = np.array(column)
        made[..., self.gap] = (1 - self.share) * column[..., self.before] + self.share * column[..., self.after]
        return made


def _local(part: Part, response: Array | None, mass: float) -> tuple[Array | None, bool]:
    """The step of a filter that takes the noise of a derivative, None for none, and whether there is another one, which
    spreads what is not valid far. That noise cancels over time: it must stay whole until it is filtered."""
    spreads = response is not None and (bool(part.lowest) or any(part.colour) or "x" in part.noise)
    if response is None or not _is_derived(part, mass):
        return None, spreads
    omega = np.pi * np.arange(len(response)) / (len(response) - 1)
    noise = mass * _derived_noise(part, omega) / part.noise["F"]
    return np.asarray(1 / np.sqrt(1 + noise**2)), spreads


def _clean(valid: Flags | None, local: Array | None) -> Flags | None:
    """Samples that a local filter keeps from what is not valid, unless it leaves hardly any."""
    if valid is None or local is None:
        return valid
    corner = (
        max(int(np.argmax(local < 0.7)), 1) * np.pi / (len(local) - 1)
    )  # a derivative hides no noise at the very end
    reach = int(min(_DECAY / corner, len(valid)))
    clean = np.asarray(maximum_filter1d((~valid).astype(np.int8), 2 * reach + 1, mode="nearest") == 0)
    return clean if 2 * np.count_nonzero(clean) > np.count_nonzero(valid) else valid


def _derived_noise(part: Part, omega: Array) -> Array:
    """Noise of an acceleration that was derived, over angular frequencies [rad per sample], (n,) [m/s2]."""
    weights, name = (SECOND, "x") if part.inertia_order == 2 else (FIRST, "v")
    return _response(weights, omega) / part.dt**part.inertia_order * part.noise[name]


def louder_balance(part: Part, mass: float) -> Array | None:
    """Noise of the whitened balance over its level, (n,), where it is louder for a while; None elsewhere."""
    if not part.louder:
        return None
    name = ("a", "v", "x")[part.inertia_order]
    if part.inertia_order:
        power = (mass * _derived_noise(part, np.linspace(0, np.pi, 257)) / part.noise["F"]) ** 2
        share = float(np.mean(1 / (1 + power)))  # of the force in what is white
    else:
        share = (part.noise["F"] / part.balance_noise(mass)) ** 2
    ones = np.ones(len(part))
    squares = share * part.louder.get("F", ones) ** 2 + (1 - share) * part.louder.get(name, ones) ** 2
    return np.asarray(np.sqrt(squares))


def _is_derived(part: Part, mass: float) -> bool:
    """Whether the balance holds an acceleration that was not measured."""
    return part.inertia_order > 0 and mass != 0.0


def whitening(part: Part, mass: float, slopes: tuple[float, float]) -> Array | None:
    """Frequency response that makes the noise of the balance white; None where it is white already.

    slopes: see ``slopes_of_force``. At a resonance noise of the motion cancels between inertia and restoring force.
    This is left alone: it would take a filter that rings.
    """
    whitens_x, coloured = _whitens_x(part, mass, slopes), any(part.colour)
    if not whitens_x and not part.lowest and not coloured:
        return None
    n = 2 * quick_length(len(part))
    omega = 2 * np.pi * np.arange(n // 2 + 1) / n
    power = np.ones_like(omega)
    if _is_derived(part, mass):
        power += (mass * _derived_noise(part, omega) / part.noise["F"]) ** 2
    if whitens_x:
        power += _restoring(part, mass, slopes, omega)
    if part.lowest:
        turn = omega**2 + (BELOW["v" if "v" in part.noise else "a"] * part.first) ** 2
        drift = part.noise["v"] * part.dt / np.sqrt(turn) if "v" in part.noise else part.noise["a"] * part.dt**2 / turn
        power += (slopes[0] * drift / part.balance_noise(mass)) ** 2
    if coloured:
        power /= colouring(part) ** 2
    if not part.lowest:
        return np.asarray(1.0 / np.sqrt(power))
    high = (omega / part.first) ** 8
    return np.asarray(np.sqrt(high / (1.0 + high) / power))


def _restoring(part: Part, mass: float, slopes: tuple[float, float], omega: Array) -> Array:
    """Power that noise of the displacement makes through the restoring force over that of the balance, at angular
    frequencies [rad per sample]; 0 where the displacement was not measured.

    Without a mass the stiffness alone counts: a slope over the velocity may be that of dry friction, which noise does
    not move while it slides."""
    if "x" not in part.noise:
        return np.zeros_like(omega)
    error = np.interp(omega, np.linspace(0, np.pi, len(part.error_of_x)), part.error_of_x)
    damper = slopes[1] if _is_derived(part, mass) else 0.0
    return np.asarray((np.hypot(slopes[0], damper * omega / part.dt) * error / part.balance_noise(mass)) ** 2)


def _whitens_x(part: Part, mass: float, slopes: tuple[float, float]) -> bool:
    """Whether the noise of the displacement is whitened as well: where the acceleration was derived, and where nothing
    has a mass and it is louder through the stiffness than that of the force. Beside an acceleration that was measured
    it cancels in part, as the smoother makes one motion of both; and the error of a channel with coarse steps stays
    the same over a step, and is not white."""
    if mass:
        return _is_derived(part, mass)
    if "x" not in part.measured or steps(part.measured["x"]) is not None:
        return False
    omega = np.linspace(0, np.pi, len(part.error_of_x))
    return bool(np.max(_restoring(part, mass, slopes, omega)) > 1)


def followed(part: Part, response: Array | None, mass: float, slopes: tuple[float, float]) -> Array:
    """Power of ``_restoring`` after whitening, at equal steps of the frequency from 0 to half of the sample rate."""
    if response is None or not _whitens_x(part, mass, slopes):
        return np.zeros(2)
    white = response / colouring(part) if any(part.colour) else response
    return np.asarray(_restoring(part, mass, slopes, np.linspace(0, np.pi, len(response))) * white**2)


def colouring(part: Part) -> Array:
    """Frequency response that makes its noise white.

    1/f noise goes on below the lowest line, as long as the zero of the sensors is old: its density there, over the
    width of a line, stands in the mean.
    """
    n = 2 * quick_length(len(part))
    cycles = np.maximum(np.arange(n // 2 + 1), 1) / n
    power = 1 + part.colour[0] / cycles + part.colour[1] / cycles**2
    power[0] += part.colour[0] * n * max(np.log(max(part.since, part.dt) / (n * part.dt)) - 1, 0)
    return np.asarray(1 / np.sqrt(power))


def longest_trim(samples: int) -> int:
    """Samples of which no rows are made at either end of a recording, at most."""
    return samples // 8


def trim(part: Part, response: Array | None) -> int:
    """Samples at either end that derivation and whitening disturb: what happens at an end decays with the corners.

    Where the acceleration alone was measured, so do place and speed at the end, which nobody knows.
    """
    samples, first = len(part), part.first * (1.0 if "v" in part.noise else BELOW["a"])
    least, most = max(len(FIRST) // 2 + 1, samples // 200), longest_trim(samples)
    if response is None:
        return least
    high = np.flatnonzero(response > 0.7 * np.max(response))[-1] * np.pi / (len(response) - 1)
    slow = min(high, first) if first else high
    return int(np.clip(_DECAY / slow, least, most)) if slow > 0 else most


def slopes_of_force(parts: Sequence[Part], mass: float) -> tuple[float, float]:
    """Slopes of the restoring force over the displacement [N/m] and the velocity [N.s/m], for the size of what errors
    of these do. A constant force has none, and dry friction one at its turning points alone."""
    force = np.concatenate([part.F - mass * part.a for part in parts])
    motion = np.stack([np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "v")])
    size = np.std(motion, axis=1)
    known = size > 0
    columns = [*(motion[known] / size[known, None]), np.sign(motion[1]), np.ones(len(force))]
    found = np.zeros(2)
    found[known] = np.linalg.lstsq(np.stack(columns, axis=1), force, rcond=None)[0][:-2] / size[known]
    return float(found[0]), float(found[1])


def _response(weights: Array, omega: Array) -> Array:
    shift = np.arange(len(weights)) - len(weights) // 2
    return np.asarray(np.abs(np.exp(1j * np.outer(omega, shift)) @ weights))
