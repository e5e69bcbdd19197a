"""Free decays: nobody recorded a force because there was none. m a + R = 0 is as good a balance as any.

Without a force nothing has a scale: a structure of twice the mass and twice the stiffness decays alike. The mass is
taken as 1, and every force and parameter is one per unit of mass, unless the mass was given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import find_peaks

from hystid.diagnosis.prepare.refused import SHORTEST, NotDiagnosable
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import is_noise_free, noise_level

PER_MASS = (
    "free decay: the force is known to be zero, and the mass is taken as 1 as nobody gave it: all forces and "
    "parameters are per unit of mass (N/kg; a stiffness in 1/s2, a damping in 1/s)"
)
_PERIODS = 2  # of the motion, over which its size is measured
_PLATEAU = 0.97  # share of the largest size at which a driven motion still is: a decay begins below it
_PARTS = 8  # such a stretch is an eighth of a decay, which else falls by more in it: the eighth root of 0.7 is 0.956
_FALLEN = 0.7  # share of the first size below which a motion has decayed at all
_DRIVEN = "{}: it was driven by a force that nobody recorded; record F, or give the free decay alone"
_QUICK = f"dies away within {{}} samples: at least {SHORTEST} are needed; record it at a higher rate"
_DEEP = 1 / 3  # share of the first size below which a motion has died away, though its peaks rise now and then
_RISEN, _CLEAR_PUSH = 1.5, 5.0  # times the smallest size so far, and times the noise, from which it was pushed again
_SWINGS, _SHALLOW = 4, 0.02  # reversals of two periods, and share of the range below which one is none
_CHANCE = 0.1  # probability that white noise reaches any line of a spectrum (half as many lines as samples): 1 in 20
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

    What does not die away is left out, and told, where others can be used, or it is ``held`` out. mass [kg]: as given;
    None for 1 where no recording has a force; those that are held out set no scale. Raises NoDecay.
    """
    unscaled = mass is None and not held and all(is_free(test) for test in tests)
    driven = not all(is_free(test) for test in tests)  # these know the zero of x; friction may hold it off its zero
    made, refusals = list[Recording](), list[NoDecay]()
    told = [PER_MASS] if unscaled else []
    for i, test in enumerate(tests):
        try:
            made += _decays(test, mass or 1.0, i, driven) if is_free(test) else [test]
        except NoDecay as refused:
            refusals.append(refused)
    if refusals and not (made or held):
        raise refusals[0]
    told += [f"left out: {refused}" for refused in refusals]
    return Released(made, unscaled, tuple(told))


def _decays(test: Recording, mass: float, seed: int, driven: bool) -> list[Recording]:
    """The parts of a recording in which the motion dies away: one for each time that it was let go. Raises NoDecay."""
    name, values = next(iter(test.channels("xva").items()))
    noise = noise_level(values)
    line = _line(values, noise, 0 if name == "a" else 2)
    window = int(np.clip(_PERIODS * len(values) / line, 16, len(values) // 4))
    places, why = _places(values, window, noise)
    if not places:
        raise NoDecay(f"{test.name} has no force, and its motion {why}")
    if name == "x":  # the others do not show where it is held, and say at rest how far they drift
        places = [slice(p.start, p.start + _stopped(values[p], noise)) for p in places]
    zero = float(np.mean(values[-window:])) if name == "x" and not driven else 0.0  # it rests where no force is
    omega, quiet = 2 * np.pi * line / (len(values) * test.dt), is_noise_free(values)
    stretches = " and ".join(f"{test.t[p.start]:.4g} to {test.t[min(p.stop, len(test) - 1)]:.4g} s" for p in places)
    told = f"{test.name}: free decay, the force is zero; used from {stretches}, where the motion dies away"
    made = []
    for number, place in enumerate(places):
        piece = test.part(place)
        piece = with_noise(piece, seed + number) if quiet else piece
        level = float(np.hypot(MODEL_ERROR * np.std(values[place]), noise))
        draw = np.random.default_rng((seed, number)).standard_normal(len(piece))
        force = mass * omega ** (2 - "xva".index(name)) * level * draw
        x = None if piece.x is None else piece.x - zero
        title = f"{test.name}-{number + 1}" if len(places) > 1 else test.name
        made.append(replace(piece, name=title, F=force, x=x, notes=(told, *test.notes) if not number else ()))
    return made


def _places(values: Array, window: int, noise: float) -> tuple[list[slice], str]:
    """Samples in which a channel dies away, one stretch after the other, and why there are none."""
    count = len(values) // window
    size = np.std(values[: count * window].reshape(count, window), axis=1)
    found, why = list[slice](), _DRIVEN.format("does not die away")
    seen = size > max(_CLEAR_PUSH * noise, _GONE * np.max(size))
    last = int(np.flatnonzero(size >= _PLATEAU * np.max(size))[-1])
    while last < count:
        first = last + 1 if last else 0  # a recording that begins with its largest motion begins with the decay
        falling = size[first:]
        gone = np.flatnonzero(falling < max(_CLEAR_PUSH * noise, _GONE * size[last]))
        pushed = np.flatnonzero(falling > _RISEN * np.minimum.accumulate(falling)) - 1  # it may begin a window before
        end = int(min([*gone[:1], *pushed[:1], len(falling)]))
        if last and end in pushed[:1] and end - np.argmin(falling[: end + 1]) > 1:  # no blow is so slow
            return [], _DRIVEN.format("dies away and swells")
        done = first + end
        fell = float(np.min(size[first : done + 1], initial=np.inf) / size[last])
        first += _after_steady(size[first:done])
        done = max(done, first + 1)
        place = slice(first * window if first else _let_go(values[:window], noise), done * window)
        dies = fell < _DEEP or (fell < _FALLEN and _only_falls(values[place], noise))  # what is driven falls as well
        if dies and _swings(values[place.start :], noise) < _SWINGS:
            why = _DRIVEN.format(f"does not swing (fewer than {_SWINGS} reversals)")
        elif dies and place.stop - place.start >= SHORTEST:
            found.append(place)
        elif dies and end in gone[:1]:
            why = _QUICK.format(place.stop - place.start)
        last = done + int(np.argmax([*seen[done:], True]))
        while last + 1 < count and size[last + 1] > size[last]:
            last += 1
    return found, why


def _let_go(values: Array, noise: float) -> int:
    """Sample from which the first motion of a recording is free: the first one, or half a period after its largest
    value where something rested before: a blow is over then."""
    eighth = len(values) // (8 * _PERIODS)
    if np.any(np.abs(values[:eighth] - values[0]) > _CLEAR_PUSH * noise):
        return 0
    most = int(np.argmax(np.abs(values - values[0])))
    return min(most + 4 * eighth, len(values) - 1)


def _stopped(values: Array, noise: float) -> int:
    """Number of samples until a motion stops. Dry friction ends it at once, off its zero, and then holds any force: no
    law of the motion says which."""
    rest = np.median(values[-len(values) // (8 * _PERIODS) :])
    return int(np.max(np.flatnonzero(np.abs(values - rest) > _CLEAR_PUSH * noise), initial=-1)) + 1


def _after_steady(size: Array) -> int:
    """Number of windows up to the last stretch in which a motion does not fall: it is driven there."""
    long = max(len(size) // _PARTS, 2)
    runs = np.lib.stride_tricks.sliding_window_view(size, long) if len(size) >= long else np.zeros((0, long))
    steady = np.flatnonzero(np.min(runs, axis=1) > _PLATEAU * np.max(runs, axis=1))
    return int(steady[-1]) + long if len(steady) else 0


def _line(values: Array, noise: float, order: int) -> int:
    """Number of periods of the oscillation in a recording. order: power of the frequency by which what is slow counts
    less: creep to a place of rest is no oscillation.

    Without a taper: a motion that dies away is loudest at its beginning. Lines that white noise reaches are none.
    """
    power = np.abs(np.fft.rfft(values - np.mean(values))) ** 2
    chance = len(values) * noise**2 * np.log(len(values) / _CHANCE)
    beyond = np.maximum(power - chance, 0.0) * np.arange(len(power), dtype=float) ** order
    return int(np.argmax(beyond[1:])) + 1


def _swings(values: Array, noise: float) -> int:
    """Number of reversals: what is moved there and back, and then rests, is no structure that was let go."""
    return sum(map(len, _peaks(values, noise)))


def _only_falls(values: Array, noise: float) -> bool:
    """Whether no peak is higher than the one before on the same side, as of one mass that nothing drives."""
    return all(bool(np.all(np.diff(peaks) < _CLEAR_PUSH * noise)) for peaks in _peaks(values, noise))


def _peaks(values: Array, noise: float) -> list[Array]:
    """Heights of the peaks of either side, one after the other."""
    deep = max(_CLEAR_PUSH * noise, _SHALLOW * float(np.ptp(values)))
    return [side[find_peaks(side, prominence=deep)[0]] for side in (values, -values)]


def with_noise(test: Recording, seed: int) -> Recording:
    """A simulated recording gets noise of the size of what integration leaves, which would be named as physics else."""
    rng = np.random.default_rng(seed)
    noisy = {
        k: u + MODEL_ERROR * float(np.std(u)) * rng.standard_normal(len(u)) for k, u in test.channels("Fxva").items()
    }
    note = f"{test.name} holds no noise: white noise of {100 * MODEL_ERROR:g} % of each channel is added"
    return test.with_channels(noisy, note)
