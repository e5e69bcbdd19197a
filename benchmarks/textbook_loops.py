"""Specimens with one textbook effect each in slow cyclic tests, where nothing has a mass: is it named?

    python -m benchmarks.textbook_loops --seed S --cases N [--kind coulomb play ...]

A testing machine prescribes x as in ``benchmarks.sound_loops``; F is that of a spring, a damper with 3 to 10 % of its
force, and one effect that its user does not know, as in ``benchmarks.textbook_rigs``, or none. Each channel has 34 dB
of noise to none. Prints each case that is not right, and the counts, in the words of ``benchmarks.textbook_rigs``.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.sound_loops import prescribed
from benchmarks.textbook_rigs import KINDS as OF_RIGS
from benchmarks.textbook_rigs import Kind, Law, Rig, ask
from hystid.numeric import Array
from hystid.recording import Recording

_OVER = 8  # steps of the simulation per sample
_SNR = (34, 40, 46, 60, 80, np.inf)  # dB


def _play(r: Rig) -> tuple[int, Law]:
    gap = 0.3 * r.s * r.X
    return 0, lambda y, t: (r.k * (max(y[0] - gap, 0.0) + min(y[0] + gap, 0.0)), ())


KINDS = {
    **{
        name: kind
        for name, kind in OF_RIGS.items()
        if (kind.law or not kind.right) and name not in ("absorber", "parametric")
    },
    "play": Kind(("backlash", "two_sided_stop"), ("cubic_stiffness",), _play),
    "fades": Kind(("stiffness_drift",), ("cyclic_degradation",)),
    "creeps": Kind(("force_drift",), ("preload",)),
}


def followed(law: tuple[int, Law], t: Array, x: Array, v: Array) -> Array:
    """Force of a law at every second of the times t, (n,), by Runge and Kutta's method; x, v: (2 n - 1,)."""
    states, of = law
    y, h, force = np.zeros(states), float(t[2] - t[0]), []

    def rates(y: Array, i: int) -> Array:
        return np.array(of((x[i], v[i], *y), t[i])[1])

    for i in range(0, len(t), 2):
        force.append(of((x[i], v[i], *y), t[i])[0])
        if states and i + 2 < len(t):
            k1 = rates(y, i)
            k2 = rates(y + 0.5 * h * k1, i + 1)
            k3 = rates(y + 0.5 * h * k2, i + 1)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + h * k3, i + 2))
    return np.array(force)


def textbook_loop(seed: int, name: str) -> tuple[Recording, dict[str, float], str]:
    """A recording with one effect, what its user believes, and the case in words."""
    rng = np.random.default_rng([seed, 123])
    shape, half_steps, x = prescribed(rng)
    if shape == "random":  # its filter swings out at either end
        ends = 2 * _OVER * (len(x) // (20 * _OVER))
        half_steps, x = half_steps[ends:-ends] - half_steps[ends], x[ends:-ends]
    t = half_steps * 10 ** rng.uniform(-4, 0)  # of a sample [s]
    size, stiffness = 10 ** rng.uniform(-4, -1.5), 10 ** rng.uniform(3, 8)
    x = size * (x - np.mean(x)) / np.max(np.abs(x - np.mean(x)))
    v = np.gradient(x, t)
    w = float(np.max(np.abs(v))) / size
    rig = Rig(0.0, stiffness / w * rng.uniform(0.03, 0.1), stiffness, w, size, rng.uniform(0.5, 1.5))
    law = KINDS[name].law
    force = followed(law(rig), t, x, v) if law else np.zeros(len(t[::2]))
    t, x, v = t[::2], x[::2], v[::2]
    force = force + rig.k * x + rig.c * v
    if name == "fades":
        force -= 0.3 * rig.s * rig.k * x * t / t[-1]
    elif name == "creeps":
        force += 0.2 * rig.s * rig.k * rig.X * t / t[-1]
    columns, levels = {}, []
    for channel, y in (("x", x[::_OVER]), ("F", force[::_OVER])):
        snr = float(rng.choice(_SNR))
        columns[channel] = y + 10 ** (-snr / 20) * np.std(y) * rng.standard_normal(len(y))
        levels.append(f"{channel} {snr:.0f} dB")
    damper = float(rng.choice([0.0, rig.c * rng.uniform(0.8, 1.25)]))
    believed = {"m": 0.0, "B": damper, "Kl": stiffness * rng.uniform(0.93, 1.07)}
    words = f"{shape}, {', '.join(levels)}, {len(columns['x'])} samples"
    return Recording(f"{name} {seed}", t[::_OVER], **columns), believed, words


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the first case")
    parser.add_argument("--cases", type=int, required=True, help="of each kind")
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=list(KINDS))
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.cases)
    ask((KINDS[name], f"{name} {seed}", textbook_loop(seed, name)) for name in given.kind for seed in seeds)


if __name__ == "__main__":
    main()
