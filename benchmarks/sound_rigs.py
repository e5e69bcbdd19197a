"""Sound linear rigs, each channel with a noise of its own: is anything said to be missing?

    python -m benchmarks.sound_rigs --seed S --cases N [--channels v a va] [--done smoothed interpolated]

Rigs, forces and motion are those of the proof (``benchmarks.proof``), whose decks draw one noise level for all
channels and nearly always have x. Here any of x, v and a are recorded, and each channel and the force have 26 to 80 dB
of noise, or in one case of five none, and 16 or 24 bit or no steps. ``--done``: the first of them is what a user made
of it, by a moving mean or another smoothing filter, or by interpolation between every second to fifth sample. Prints
each case that is not calm, and the counts.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d
from scipy.signal import savgol_filter

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


DONE = {"smoothed": smoothed, "interpolated": interpolated}


def sound_rig(seed: int, channels: str = "", done: str = "") -> Case:
    """A linear rig. channels: "" for any. done: what a user did to the first of them, "" for nothing."""
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
        if done and name == recorded[0]:
            columns[name] = DONE[done](y, rng)
            continue
        step = 4 * np.max(np.abs(y)) / 2**bits
        columns[name] = np.round(y / step) * step if bits else y
    words = f"{kind}, {recorded} {done}, {', '.join(levels) or 'no noise'}, {bits} bit, {len(motion.t)} samples"
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
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.cases)
    for done in given.done:
        ask(sound_rig(seed, channels, done) for channels in given.channels for seed in seeds)


if __name__ == "__main__":
    main()
