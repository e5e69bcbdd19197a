"""Is each slip of a label named, and is nothing said about sound recordings?

    python -m benchmarks.slips [../shared/data] [--show] [--sound-only | --slips-only | --commands]

Twenty slips on ten recordings: five rigs simulated here, five of other laboratories. A slip that the channels of a
recording cannot show (no second channel with that quantity, no mass to weigh the force by) is counted apart, where
the examination of the sound recording says so beforehand. Then every sound recording: each rig under each force and
noise, and every file of the data. ``--commands`` runs each slip through every command instead, as a user would.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfilt

from hystid.compiled import CompiledModel
from hystid.consistency import Examination, examine
from hystid.consistency.kinematics import motion, spectrum
from hystid.errors import HystidError
from hystid.excitation import parse
from hystid.modelica import compile_model
from hystid.processing import add_noise
from hystid.recording import Array, Recording, read

_STEP, _EVERY = 1e-4, 10  # s of simulation, samples kept: 1 kHz
_SHIFT = 12  # samples by which a clock is off at least, and a twentieth of the main period
RIGS = {
    "Linear": {"m": 2.5, "B": 30.0, "Kl": 4e4},
    "Jenkins": {"m": 1.0, "B": 10.0, "Kl": 1e4},
    "BoucWen": {"m": 2.0, "B": 10.0, "Kl": 5e4},
    "BilinearStiffness": {"m": 1.0, "B": 10.0, "Kl": 1e3},
    "LuGre": {"m": 4.0, "B": 10.0, "Kl": 1e4},
    "Dahl": {"m": 1.0, "B": 10.0, "Kl": 1e4},
    "Iwan": {"m": 1.0, "B": 5.0, "Kl": 2e4},
    "MicroSlip": {"m": 3.0, "B": 10.0, "Kl": 1e4},
}
FORCES = ("multisine:2-80Hz@40Nrms,6s", "chirp:1-60Hz@60N,8s", "multisine:1-25Hz@60Nrms,8s", "harmonic:12Hz@80N,3s")
SNR = (30.0, 45.0, 60.0)
SIMULATED = (("Linear", 0, 40.0), ("Jenkins", 1, 45.0), ("BoucWen", 0, 50.0), ("BilinearStiffness", 1, 40.0),
             ("LuGre", 0, 45.0))  # fmt: skip
# Recording, moving mass as its source states it (0: the force is the restoring force; none of them weighs it).
MEASURED = (
    ("emps/emps_estimation", 95.1),
    ("brfd_friction_backlash/brfd2023_0.5Hz30lbtension1amplitude", 0.0),
    ("mr_damper_dyke/mr_damper_dyke_ranran50", 0.0),
    ("mr_damper_utfpr/mr_damper_0V", 0.0),
    ("servo_pendulum_bam/xl330_sin_sin_kp200", 0.0068),
)
# What the sources say is not as the header says; a finding there is right, and none is a miss.
STATED = {
    "servo_pendulum_bam": "v is the servo's own estimate, a little late",
    "mr_damper_dyke": "v was computed from x by the source",
}
_LBF, _INCH, _FOOT, _G = 4.4482216, 0.0254, 0.3048, 9.80665


@dataclass(frozen=True)
class Slip:
    """A slip: what it makes of a recording and of the mass, and how an answer has to name it.

    rule and channels: of the finding. unit: the right unit, as the repair must say. needs: channels without which it
    cannot be made. mass: factor on the mass given.
    """

    name: str
    make: Callable[[Recording], Recording]
    rule: str
    channels: frozenset[str]
    unit: str = ""
    needs: str = ""
    mass: float = 1.0

    def names(self, found: Examination) -> bool:
        """Whether a finding names this slip, with the unit that the numbers are in."""
        return any(self._is_named(item.slip, item.channel, item.sentence, item.repair) for item in found.findings)

    def listed(self, found: Examination) -> bool:
        """Whether a finding lists the right unit, beside units that these data do not tell from it."""
        units = (f.sentence.partition("it looks like ")[2].split(" or ") for f in found.findings if f.slip == self.rule)
        several = any("or else" in f.sentence for f in found.findings)
        return any(self.unit.partition("=")[2] in listed for listed in units if several or len(listed) > 1)

    def undecided(self, told: Mapping[str, str]) -> bool:
        """Whether it was said of the recording, as it should be, that this slip would not show."""
        text = " ".join(told.get(name, "") for name in self.channels)
        if self.rule == "wrong_mass" or "t" in self.channels:
            return "whether the mass is in g" in text or "whether t is in ms" in text
        unit = self.unit.partition("=")[2] or self.unit
        return (
            bool(re.search(rf"[ ,]{re.escape(unit)}(,| does)", text)) if unit else self.rule == "lag" and "lag" in text
        )

    def _is_named(self, rule: str, channel: str, sentence: str, repair: object) -> bool:
        told = set(channel.split(" and "))
        either = any(f"{one} or " in sentence or f" or {one}" in sentence for one in self.channels)
        if rule != self.rule or not (told & self.channels if len(self.channels) == 1 else told == self.channels):
            return rule == self.rule == "swapped_sign" and either
        return not self.unit or self.unit in str(repair) + sentence


def _times(channel: str, factor: float) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, **{channel: factor * np.asarray(getattr(r, channel))})


def _main(r: Recording, channel: str) -> float:
    """Frequency of the strongest motion of a channel [Hz]."""
    held = spectrum(motion(r)[channel], r.dt)
    return float(held.omega[int(np.argmax(held.density))]) / (2 * math.pi)


def _late(r: Recording) -> Recording:
    assert r.F is not None
    period = 1.0 / (_main(r, next(iter(motion(r)))) * r.dt)
    shift = max(_SHIFT, round(0.05 * period))
    held = {name: values[:-shift] if name != "F" else values[shift:] for name, values in _all(r).items()}
    return replace(r, t=r.t[:-shift], extra={}, **held)


def _all(r: Recording) -> dict[str, Array]:
    return {name: np.asarray(getattr(r, name)) for name in "Fxva" if getattr(r, name) is not None}


def _ac_coupled(r: Recording) -> Recording:
    """A first-order high-pass at half the frequency of the strongest displacement."""
    corner = 0.5 * _main(r, "x")
    return replace(r, a=sosfilt(butter(1, corner, "high", fs=r.sample_rate, output="sos"), r.a))


def _integrated(r: Recording) -> Recording:
    """Velocity as the running sum of an acceleration whose offset wanders: a slow wave of a fifth of its size."""
    n = len(r)
    walk = np.cumsum(np.random.default_rng(5).standard_normal(n))
    walk -= np.linspace(walk[0], walk[-1], n)
    smooth = np.convolve(walk, np.ones(n // 20) / (n // 20), mode="same")
    return replace(r, v=r.v + 0.2 * np.std(r.v) / np.std(smooth) * smooth)


def _filtered(r: Recording) -> Recording:
    """A second-order low-pass at twice the frequency of the strongest motion."""
    last = list(motion(r))[-1]
    return replace(r, x=sosfilt(butter(2, 2 * _main(r, last), fs=r.sample_rate, output="sos"), r.x))


def _exchanged(a: str, b: str) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, **{a: getattr(r, b), b: getattr(r, a)})


def _labels_exchanged(a: str, b: str, sizes: Mapping[str, tuple[str, float]]) -> Callable[[Recording], Recording]:
    """The numbers of each column under name and unit of the other. sizes: unit of a label, and what it is in SI."""

    def made(r: Recording) -> Recording:
        held = {one: np.asarray(getattr(r, other)) / sizes[other][1] * sizes[one][1] for one, other in ((a, b), (b, a))}
        return replace(r, **held, units={**r.units, **{name: sizes[name][0] for name in (a, b)}})

    return made


def slips(rotational: bool = False) -> list[Slip]:
    """The slips, in the units of a linear or of a rotational rig."""
    labels = {"F": ("N", 1.0), "x": ("mm", 1e-3), "a": ("g", _G)}
    if rotational:
        labels = {"F": ("N.m", 1.0), "x": ("deg", math.pi / 180), "a": ("rev/s2", 2 * math.pi)}
    units = [("a", "g", _G), ("a", "ft/s2", _FOOT), ("a", "mm/s2", 1e-3), ("x", "mm", 1e-3), ("x", "in", _INCH),
             ("F", "kN", 1e3), ("F", "lbf", _LBF)]  # fmt: skip
    if rotational:
        units = [("a", "deg/s2", math.pi / 180), ("a", "rev/s2", 2 * math.pi), ("a", "mrad/s2", 1e-3),
                 ("x", "deg", math.pi / 180), ("x", "rev", 2 * math.pi), ("F", "N.mm", 1e-3),
                 ("F", "lbf*ft", _LBF * _FOOT)]  # fmt: skip
    made = [Slip(f"{c} in {u}", _times(c, 1 / size), "wrong_unit", frozenset(c), f"{c}={u}", c) for c, u, size in units]
    made += [
        Slip("t in ms", lambda r: replace(r, t=1e3 * r.t), "wrong_unit", frozenset("t"), "ms", "t"),
        Slip("t in samples", lambda r: replace(r, t=np.arange(float(len(r)))), "wrong_unit", frozenset("t"), "", "t"),
    ]
    made += [Slip(f"{c} reversed", _times(c, -1.0), "swapped_sign", frozenset(c), needs=c) for c in "Fxva"]
    made += [
        Slip("x and a swapped", _exchanged("x", "a"), "swapped_channels", frozenset("xa"), needs="xa"),
        Slip("F and x swapped", _exchanged("F", "x"), "swapped_channels", frozenset("Fx"), needs="Fx"),
        Slip("F late", _late, "lag", frozenset("F"), needs="F"),
        Slip("a AC-coupled", _ac_coupled, "filtered", frozenset("a"), needs="a"),
        Slip("v with drift", _integrated, "drift", frozenset("v"), needs="v"),
        Slip("x filtered", _filtered, "filtered", frozenset("x"), needs="x"),
    ]
    for pair in ("xa", "Fx"):
        change = _labels_exchanged(*pair, labels)
        made.append(
            Slip(f"labels of {' and '.join(pair)} swapped", change, "swapped_channels", frozenset(pair), needs=pair)
        )
    grams = 1e4 if rotational else 1e3
    return [*made, Slip("mass in g", lambda r: r, "wrong_mass", frozenset("m"), mass=grams)]


def simulated(name: str, force: str, snr: float, seed: int = 0) -> Recording:
    """One rig under one force, all channels with noise of their own."""
    code = CompiledModel(compile_model(f"HystId.Oscillators.{name}"))
    push = parse(force).force(_STEP, seed)
    found = code.simulate({"F": push}, _STEP, parameters=RIGS[name], outputs=("x", "v", "a"))
    t = _STEP * np.arange(len(push))[::_EVERY]
    plain = Recording(f"{name} {force} {snr:g} dB", t, push[::_EVERY], *(found[k][::_EVERY] for k in "xva"))
    return add_noise(plain, snr, seed)


def ten(data: Path) -> Iterator[tuple[Recording, float]]:
    """The recordings that slips are made on, with the mass given."""
    for name, force, snr in SIMULATED:
        yield simulated(name, FORCES[force], snr), RIGS[name]["m"]
    for name, mass in MEASURED:
        if (data / f"{name}.csv").exists():
            yield read(data / f"{name}.csv"), mass


def sound(data: Path) -> Iterator[tuple[Recording, float | None, str]]:
    """Recordings with right labels, the mass, and what is known to be wrong with them.

    96 simulated ones, and every file of the data that has a force.
    """
    for seed, (name, force, snr) in enumerate(product(RIGS, FORCES, SNR)):
        yield simulated(name, force, snr, seed + 1), RIGS[name]["m"], ""
    masses = dict(MEASURED)
    for path in sorted(data.glob("*/*.csv")):
        try:
            found = read(path)
        except HystidError as error:
            print(f"not read: {path.name}: {str(error)[:90]}")
            continue
        yield found, masses.get(f"{path.parent.name}/{path.stem}"), STATED.get(path.parent.name, "")


def _makes_sense(slip: Slip, recording: Recording, mass: float) -> bool:
    others = {"v with drift": 2, "x filtered": 2, "v reversed": 2}  # motion channels, without which nothing is wrong
    there = all(c == "t" or getattr(recording, c) is not None for c in slip.needs)
    return there and len(motion(recording)) >= others.get(slip.name, 1) and (slip.mass == 1.0 or mass > 0)


def measure(data: Path, show: bool) -> None:
    """Print how often each slip is named."""
    rows: dict[int, list[int]] = {}
    titles: dict[int, str] = {}
    for recording, mass in ten(data):
        plain = examine([recording], mass).examined[0].undecided
        for k, slip in enumerate(slips(recording.rotational)):
            titles.setdefault(k, slip.name)
            row = rows.setdefault(k, [0, 0, 0, 0])
            if not _makes_sense(slip, recording, mass):
                continue
            found = examine([slip.make(recording)], mass * slip.mass)
            listed = slip.listed(found)
            named = listed or slip.names(found)
            if not named and slip.undecided(plain):  # said beforehand, of the recording as it should be
                row[2] += 1
                continue
            row[0] += named
            row[1] += 1
            row[3] += listed
            if show and not named:
                said = "; ".join(f"{f.slip} {f.channel}: {f.sentence}" for f in found.findings) or "nothing"
                print(f"missed: {slip.name} on {recording.name}: {said[:220]}")
    print("| slip | named | with other units | said beforehand not to show |\n|---|---|---|---|")
    for k, (named, all_, blind, listed) in rows.items():
        print(f"| {titles[k]} | {named} of {all_} | {listed or ''} | {blind or ''} |")
    named, all_, blind, listed = (sum(row[i] for row in rows.values()) for i in range(4))
    print(f"named: {named} of {all_} ({100 * named / all_:.1f} %), and of all {all_ + blind}: "
          f"{100 * named / (all_ + blind):.1f} %; {listed} of them beside units that the data do not tell from it; "
          f"{blind} more are said beforehand not to show")  # fmt: skip


def warnings(data: Path) -> None:
    """Print what is said about sound recordings."""
    count, said, refused, stated, rightly = 0, 0, 0, 0, 0
    for recording, mass, known in sound(data):
        found = examine([recording], mass)
        for item in found.findings:
            print(f"said{' (so the source, too: ' + known + ')' if known else ''}: {item.severity}: {str(item)[:200]}")
        if known:
            stated, rightly = stated + 1, rightly + bool(found.findings)
        else:
            count, said, refused = count + 1, said + bool(found.findings), refused + bool(found.refusals)
    print(f"sound recordings: {count}; with any finding {said} ({100 * said / count:.1f} %), refused {refused}")
    print(f"recordings whose source states a flaw of v: {stated}, found in {rightly}")


def main() -> None:
    """Run both."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", nargs="?", type=Path, default=Path("../shared/data"))
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--sound-only", action="store_true")
    parser.add_argument("--slips-only", action="store_true")
    parser.add_argument("--commands", action="store_true", help="every command on files with each slip")
    given = parser.parse_args()
    if given.commands:
        from benchmarks.slips_in_commands import measure_commands

        measure_commands(given.show)
        return
    if not given.sound_only:
        measure(given.data, given.show)
    if not given.slips_only:
        warnings(given.data)


if __name__ == "__main__":
    main()
