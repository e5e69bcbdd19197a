"""Sound specimens in slow cyclic tests, where nothing has a mass: is anything said to be missing?

    python -m benchmarks.sound_loops --seed S --cases N [--damped]

A testing machine prescribes x: sines, two tones, triangles that turn within a fiftieth of a period, or a random walk,
of constant, growing or stepped amplitude. F is that of a specimen of the proof (``benchmarks.proof``): Linear, Jenkins,
BoucWen or Iwan. x and F have 30 to 75 dB of noise each, in two cases of five in part as 1/f, in one of three behind a
filter of the recorder, and 12, 16 or 24 bit or no steps. With --damped a damper has 1 to 30 % of the force of the
spring. Prints each case that is not calm, and the counts.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.proof.chain import noise
from benchmarks.proof.effects import Rng
from benchmarks.proof.motion import Array, follow
from benchmarks.proof.rig import draw_rig, nominal
from benchmarks.sound_rigs import Case, ask
from hystid.recording import Recording

MODELS = ("Linear", "Jenkins", "BoucWen", "Iwan")
_LOUDEST, _QUIETEST = 30.0, 75.0  # dB
_OVER, _MOST = 8, 12_000  # steps of the simulation per sample, and samples
_TURN = 0.02  # of a period


def prescribed(rng: Rng) -> tuple[str, Array, Array]:
    """Kind, half steps of the time in samples, and a displacement of peak 1, (n,) each."""
    cycles, samples = int(rng.integers(4, 25)), int(10 ** rng.uniform(1.7, 2.9))
    t = np.arange(2 * _OVER * (min(cycles * samples, _MOST) - 1) + 1) / (2 * _OVER)
    turns, kind = t / samples, str(rng.choice(["sine", "two tones", "triangle", "random"]))
    envelope = str(rng.choice(["constant", "growing", "stepped"]))
    if kind == "random":
        low_pass = butter(3, 1 / (_OVER * samples), output="sos")
        x = sosfiltfilt(low_pass, rng.standard_normal(len(t)))
        return kind, t, (x - x[0]) / np.max(np.abs(x - x[0]))
    if kind == "sine":
        x = np.sin(2 * np.pi * turns)
    elif kind == "two tones":
        x = np.sin(2 * np.pi * turns) + 0.4 * np.sin(2 * np.pi * rng.uniform(2.2, 3.7) * turns)
    else:
        width = max(3, int(2 * _OVER * samples * _TURN))
        window = np.hanning(width + 2)[1:-1] / np.sum(np.hanning(width + 2))
        sharp = 1 - np.abs((turns + 0.75) % 1 * 4 - 2)
        x = np.convolve(np.pad(sharp, (width // 2, width - 1 - width // 2), "edge"), window, "valid")
    if envelope == "growing" or (envelope == "stepped" and kind == "two tones"):
        x = x * (0.2 + 0.8 * turns / turns[-1])
    elif envelope == "stepped":
        x = x * np.ceil((np.floor(turns) + 1) / cycles * 4 - 1e-9) / 4
    return f"{kind}, {envelope}", t, x / np.max(np.abs(x))


def sound_loop(seed: int, *, damped: bool = False) -> Case:
    """A specimen of any of ``MODELS``; ``damped`` with a damper."""
    rng = np.random.default_rng(seed)
    model = str(rng.choice(MODELS))
    rig = draw_rig(model, rng)
    kind, t, shape = prescribed(rng)
    dt = 10 ** rng.uniform(-4, 0)  # of a sample [s]
    step = dt * (t[1] - t[0])
    x = rig.X * rng.uniform(0.9, 1.0) * shape
    v = np.gradient(x, step)
    damper = 10 ** rng.uniform(-2, -0.5) * rig.parameters["Kl"] * np.std(x) / np.std(v) if damped else 0.0
    motion = follow(rig.terms(B=damper), 0.0, 2 * step, x, v, np.gradient(v, step)).every(_OVER)
    pink = rng.uniform(0, 0.6) if rng.random() < 0.4 else 0.0
    filtered = rng.uniform(0.3, 0.45) if rng.random() < 1 / 3 else 0.0
    bits = int(rng.choice([0, 12, 16, 24]))
    columns, levels = {}, []
    for name in "xF":
        y, snr = getattr(motion, name), rng.uniform(_LOUDEST, _QUIETEST)
        y = y + 10 ** (-snr / 20) * np.std(y) * noise(len(y), pink, rng, filtered)
        lsb = 2.5 * np.max(np.abs(y)) / 2**bits
        columns[name] = np.round(y / lsb) * lsb if bits else y
        levels.append(f"{name} {snr:.0f} dB")
    believed = nominal(rig, rng, far=rng.random() < 0.3) | {"m": 0.0, "B": damper * 0.9}
    believed |= {"N": 8} if model == "Iwan" else {}
    words = f"{model}, {kind}, {', '.join(levels)}, 1/f {pink:.2f}, corner {filtered:.2f}, {bits} bit, {len(y)} samples"
    return Recording(f"loop {seed}", motion.t, **columns), f"HystId.Oscillators.{model}", believed, words


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the first case")
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--damped", action="store_true", help="with a damper")
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.cases)
    ask(sound_loop(seed, damped=given.damped) for seed in seeds)


if __name__ == "__main__":
    main()
