"""Free decays: nobody recorded a force because there was none. m a + R = 0 is as good a balance as any.

Without a force nothing has a scale: a structure of twice the mass and twice the stiffness decays alike. The mass is
taken as 1, and every force and parameter is one per unit of mass, unless the mass was given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import find_peaks

from hystid.diagnosis.prepare.refused import NotDiagnosable
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import is_noise_free, noise_level

PER_MASS = (
    "free decay: the force is known to be zero, and the mass is taken as 1 as nobody gave it: all forces and "
    "parameters are per unit of mass (N/kg; a stiffness in 1/s2, a damping in 1/s)"
)
_PERIODS = 4  # of the motion, over which its size is measured
_PLATEAU = 0.97  # share of the largest size at which a driven motion still is: a decay begins below it
_FALLEN = 0.7  # share of the first size below which a motion has decayed at all
_THIRD, _SHORTEST = 1 / 3, 400  # fall of the motion over one piece, and its samples: twice what a diagnosis needs
_RISEN, _CLEAR = 1.5, 5.0  # times the smallest size so far, and times the noise, from which it was pushed again
_SWINGS, _SHALLOW = 4, 0.02  # reversals of two periods, and share of the range below which one is none
_GONE = 0.01  # share of the first size below which a motion is creep, or rounding
MODEL_ERROR = 5e-4  # share of a channel that integration and interpolation leave (66 dB); besides, a force of zero is
# known no better than what the noise of the motion makes of it: sensors drift below the motion


class NoDecay(NotDiagnosable):
    """A recording without a force whose motion does not die away; the message says so."""


@dataclass(frozen=True)
class Released:
    """Recordings whose force is known, and whether nothing sets a scale, so that the mass is 1."""

    tests: list[Recording]
    unscaled: bool
    notes: tuple[str, ...]


def is_free(test: Recording) -> bool:
    """Whether a recording has no force, or one that is zero all through."""
    return test.F is None or not np.any(test.F)


def released(tests: Sequence[Recording], mass: float | None, *, held: bool = False) -> Released:
    """Recordings without a force, cut to their free decay, with a force that is zero but for the error of a model.

    What does not die away is left out, and told, where others show a force, or are ``held`` out. mass [kg]: as given;
    None for 1 where no recording has a force. Raises NoDecay.
    """
    unscaled = mass is None and all(is_free(test) for test in tests)
    driven = not all(is_free(test) for test in tests)  # these know the zero of x; friction may hold it off its zero
    made: list[Recording] = []
    told = [PER_MASS] if unscaled else []
    for i, test in enumerate(tests):
        try:
            made += _decay(test, mass or 1.0, i, driven) if is_free(test) else [test]
        except NoDecay as refused:
            if not (driven or held):
                raise
            told.append(f"left out: {refused}")
    return Released(made, unscaled, tuple(told))


def _decay(test: Recording, mass: float, seed: int, driven: bool) -> list[Recording]:
    """The part of a recording in which the motion dies away, in pieces over each of which it falls to a third.

    Pieces, because the motion is smoothed and weighed by one level of noise against one size of the motion each.
    """
    name, values = next(iter(test.channels("xva").items()))
    power = np.abs(np.fft.rfft((values - np.mean(values)) * np.hanning(len(values)))) ** 2
    power = power * np.arange(len(power)) ** (0 if name == "a" else 2)  # creep to a place of rest is no oscillation
    line = int(np.argmax(power[1:])) + 1
    omega, noise = 2 * np.pi * line / (len(values) * test.dt), noise_level(values)
    window = int(np.clip(_PERIODS * len(values) / line, 16, len(values) // 4))
    count = len(values) // window
    size = np.std(values[: count * window].reshape(count, window), axis=1)
    last = int(np.flatnonzero(size >= _PLATEAU * np.max(size))[-1])
    first = last + 1 if last else 0  # a recording that begins with its largest motion begins with the decay
    falling = size[first:]
    if len(falling) < 2 or np.min(falling) > _FALLEN * size[last]:
        raise _driven(test, "does not die away")
    if _swings(values[first * window :], noise) < _SWINGS:
        raise _driven(test, f"does not swing (fewer than {_SWINGS} reversals)")
    least = np.minimum.accumulate(falling)
    gone = falling < max(_CLEAR * noise, _GONE * falling[0])
    ends = np.flatnonzero(gone | (falling > _RISEN * least))  # gone, or pushed again
    end = int(ends[0]) if len(ends) else len(falling)
    edges = [0]
    for k in range(1, end):
        long = (k - edges[-1]) * window >= _SHORTEST and (end - k) * window >= _SHORTEST
        if long and falling[k] < _THIRD * falling[edges[-1]]:
            edges.append(k)
    places = [(first + k) * window for k in (*edges, max(end, edges[-1] + 1))]
    zero = float(np.mean(values[-window:])) if name == "x" and not driven else 0.0  # it rests where no force is
    told = (
        f"{test.name}: free decay, the force is zero; used from {test.t[places[0]]:.4g} s to "
        f"{test.t[min(places[-1], len(test) - 1)]:.4g} s, where the motion dies away"
        + (f", in {len(edges)} pieces" if len(edges) > 1 else "")
    )
    made, quiet = [], is_noise_free(values)
    for number, (begin, stop) in enumerate(pairwise(places)):
        piece = test.part(slice(begin, stop))
        piece = with_noise(piece, seed + number) if quiet else piece
        level = float(np.hypot(MODEL_ERROR * np.std(values[begin:stop]), noise))
        draw = np.random.default_rng((seed, number)).standard_normal(len(piece))
        force = mass * omega ** (2 - "xva".index(name)) * level * draw
        x = None if piece.x is None else piece.x - zero
        title = f"{test.name}-{number + 1}" if len(edges) > 1 else test.name
        made.append(replace(piece, name=title, F=force, x=x, notes=(told, *test.notes) if not number else ()))
    return made


def _driven(test: Recording, why: str) -> NoDecay:
    return NoDecay(
        f"{test.name} has no force, and its motion {why}: it was driven by a force that nobody recorded; record F, or "
        "give the free decay alone"
    )


def _swings(values: Array, noise: float) -> int:
    """Number of reversals: what is moved there and back, and then rests, is no structure that was let go."""
    deep = max(_CLEAR * noise, _SHALLOW * float(np.ptp(values)))
    return sum(len(find_peaks(side, prominence=deep)[0]) for side in (values, -values))


def with_noise(test: Recording, seed: int) -> Recording:
    """A simulated recording gets noise of the size of what integration leaves, which would be named as physics else."""
    rng = np.random.default_rng(seed)
    noisy = {
        k: u + MODEL_ERROR * float(np.std(u)) * rng.standard_normal(len(u)) for k, u in test.channels("Fxva").items()
    }
    note = f"{test.name} holds no noise: white noise of {100 * MODEL_ERROR:g} % of each channel is added"
    return test.with_channels(noisy, note)
