"""Sound linear rigs, each channel with a noise of its own: is anything said to be missing?

    python -m benchmarks.sound_rigs --seed S --cases N [--channels v a va] [--done smoothed interpolated] [--all]

Rigs, forces and motion are those of the proof (``benchmarks.proof``), whose decks draw one noise level for all
channels and nearly always have x. Here any of x, v and a are recorded, and each channel and the force have 26 to 80 dB
of noise, or in one case of five none, and 16 or 24 bit or no steps. ``--done``: the first of them is what a user made
of it, by a moving mean or another smoothing filter, by interpolation between every second to fifth sample, by a
low-pass filter, by a high-pass filter or a straight line that was taken off, by three or four digits, or by a taper;
``--all``: every channel is, and the force. Prints each case that is not calm, and the counts.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, gaussian_filter1d
from scipy.signal import butter, detrend, lfilter, savgol_filter, sosfiltfilt
from scipy.signal.windows import tukey

from benchmarks.proof.chain import MOTION
from benchmarks.proof.decoys import CALM
from benchmarks.proof.excitation import FORCES, force
from benchmarks.proof.motion import drive
from benchmarks.proof.rig import draw_rig, nominal
from hystid import diagnose
from hystid.errors import HystidError
from hystid.numeric import Array
from hystid.recording import Recording

Case = tuple[Recording, str, dict[str, float], str]  # with its model, what its user believes, and what it is, in words
_LOUDEST, _QUIETEST = 26.0, 80.0  # dB
_NOISE_FREE = 0.2  # share of the cases
_FINE = 8  # steps of the simulation per sample at least
_TOP = 3.0  # highest frequency of the force over the natural one


def smoothed(y: Array, rng: np.random.Generator) -> Array:
    """What a user smoothed."""
    window, order = rng.choice([3, 5, 7, 9, 11]), int(rng.choice([0, 2, 4]))
    kind = str(rng.choice(["mean", "hann", "savgol"]))
    if kind == "savgol":
        return np.asarray(savgol_filter(y, max(window, order + 3), order))
    kernel = np.ones(window) if kind == "mean" else np.hanning(window + 2)[1:-1]
    return np.asarray(convolve1d(y, kernel / np.sum(kernel)))


def interpolated(y: Array, rng: np.random.Generator) -> Array:
    """What a user interpolated between every second to fifth sample: on a line, from the fourth on on a spline too."""
    step, at = int(rng.integers(2, 6)), np.arange(len(y))
    known = at[::step]
    return np.interp(at, known, y[::step]) if step < 4 or rng.random() < 0.5 else CubicSpline(known, y[::step])(at)


def low_passed(y: Array, rng: np.random.Generator) -> Array:
    """What a user filtered by a Gaussian, by an exponential mean, or forward and backward by a Butterworth filter."""
    kind = str(rng.choice(["gauss", "exponential", "butterworth"]))
    if kind == "gauss":
        return np.asarray(gaussian_filter1d(y, rng.uniform(0.7, 3.0)))
    if kind == "exponential":
        new = rng.uniform(0.3, 0.8)
        return np.asarray(lfilter([new], [1.0, new - 1.0], y, zi=[(1.0 - new) * y[0]])[0])
    order, corner = int(rng.integers(2, 5)), rng.uniform(0.25, 0.7)
    return np.asarray(sosfiltfilt(butter(order, corner, output="sos"), y))


def no_slow(y: Array, rng: np.random.Generator) -> Array:
    """What a user took a straight line off, or high-passed forward and backward below four periods of the recording."""
    if rng.random() < 0.5:
        return np.asarray(detrend(y))
    return np.asarray(sosfiltfilt(butter(2, rng.uniform(2.0, 8.0) / len(y), "highpass", output="sos"), y))


def few_digits(y: Array, rng: np.random.Generator) -> Array:
    """What was written with three or four digits."""
    digits = int(rng.integers(3, 5))
    return np.array([float(f"{value:.{digits - 1}e}") for value in y])


def tapered(y: Array, rng: np.random.Generator) -> Array:
    """What a user brought to zero at both ends, over a twentieth to a fifth of it."""
    return np.asarray(y * tukey(len(y), rng.uniform(0.1, 0.4)))


DONE = {
    "smoothed": smoothed,
    "interpolated": interpolated,
    "low_passed": low_passed,
    "no_slow": no_slow,
    "few_digits": few_digits,
    "tapered": tapered,
}


def sound_rig(seed: int, channels: str = "", done: str = "", *, to_all: bool = False) -> Case:
    """A linear rig. channels: "" for any. done: what a user did to the first of them, or to all channels, "" for
    nothing."""
    rng = np.random.default_rng(seed)
    rig = draw_rig("Linear", rng)
    rate, periods = rng.uniform(25, 80) * rig.f0, rng.uniform(15, 150)
    t = np.arange(0.0, periods / rig.f0, 0.5 / (_FINE * rate))  # half steps
    kind = str(rng.choice(FORCES))
    shape = force(kind, t, rig.f0, _TOP * rig.f0, rng)
    shape = shape[: 2 * ((len(shape) - 1) // 2) + 1]
    unit = drive(rig.terms(), rig.mass, 2 * t[1], shape)
    motion = drive(rig.terms(), rig.mass, 2 * t[1], shape * rig.X / np.max(np.abs(unit.x))).every(_FINE)
    recorded = channels or str(rng.choice(MOTION))
    noise_free, bits = rng.random() < _NOISE_FREE, int(rng.choice([0, 16, 24]))
    columns, levels = {}, []
    for name in ("F", *recorded):
        y, snr = getattr(motion, name), rng.uniform(_LOUDEST, _QUIETEST)
        if not noise_free:
            y = y + 10 ** (-snr / 20) * np.std(y) * rng.standard_normal(len(y))
            levels.append(f"{name} {snr:.0f} dB")
        if done and (to_all or name == recorded[0]):
            columns[name] = DONE[done](y, np.random.default_rng(seed) if to_all else rng)
            continue
        step = 4 * np.max(np.abs(y)) / 2**bits
        columns[name] = np.round(y / step) * step if bits else y
    what = f"{done}{' all' * to_all}, {', '.join(levels) or 'no noise'}, {bits} bit"
    words = f"{kind}, {recorded} {what}, {len(motion.t)} samples"
    believed = nominal(rig, rng, far=False)
    return Recording(f"rig {seed}", motion.t, **columns), "HystId.Oscillators.Linear", believed, words


def ask(cases: Iterable[Case]) -> None:
    """Diagnose each case; prints those that are not calm, and the counts."""
    counts: Counter[str] = Counter()
    for recording, model, believed, words in cases:
        try:
            found = diagnose(recording, model=model, parameters=believed)
        except HystidError as error:
            said, verdict = str(error), "refused"
        else:
            said = ", ".join(f"{f.effect} {f.confidence:.2f}" for f in found.findings) or found.headline
            verdict = "refused" if found.verdict == "not_applicable" else found.verdict
        calm = verdict in CALM
        counts["calm" if calm else verdict] += 1
        if not calm:
            print(f"{recording.name} ({words}): {verdict}: {said}", flush=True)
    print(", ".join(f"{verdict}: {count}" for verdict, count in sorted(counts.items())))


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the first case")
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--channels", nargs="*", choices=MOTION, default=[""], help="each case with each of these")
    parser.add_argument("--done", nargs="*", choices=DONE, default=[""], help="what a user did to the first of them")
    parser.add_argument("--all", action="store_true", help="it was done to every channel, and to the force")
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.cases)
    for done in given.done:
        ask(sound_rig(seed, channels, done, to_all=given.all) for channels in given.channels for seed in seeds)


if __name__ == "__main__":
    main()
