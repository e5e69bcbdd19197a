"""The lab case: a rig that conceals a loss of contact, and a stick-slip model that knows nothing of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hystid.comparison import harmonics, nrmse
from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.model.effects import effect_id
from hystid.excitation import parse
from hystid.fmu import Driver, build_model
from hystid.identification import Identification, identify
from hystid.processing import add_noise, with_restoring_force
from hystid.recording import Array, Recording, write_csv
from hystid.simulation import force_of, simulate
from hystid.virtual_experiment.reference_study import Size
from hystid.virtual_experiment.targets import Check

RIG = "HystId.Examples.LabRig"
BELIEVED = "HystId.Oscillators.Jenkins"
# Given to the diagnosis: the mass as weighed, everything else wrong by up to 20 %.
NOMINAL = {"m": 1.0, "B": 12.0, "Kl": 0.9e4, "Ks": 5.6e4, "fc": 33.0}
NOISE_DB = 34.0
_STEP = 2e-5  # s, of the simulation: the rig's response branches, and only an accurate force stays on one branch
_EVERY = 20  # recorded at 2.5 kHz
CHIRPS = tuple(f"chirp:0-100Hz@{level}N,5s" for level in (20, 35, 50, 65))
TESTS = tuple(f"harmonic:{f}Hz@{level}N,2s" for f in (20, 30, 40, 50) for level in (80, 90))
CONCEALED, _ = effect_id("HystId.Effects.ContactLoss__Friction")  # the one in the rig


@dataclass(frozen=True, eq=False)
class UnseenTest:
    """One held-out test. recorded: with noise, R = F - m a. Motions x [m] and forces R [N] on its grid, shape (n,).

    All are driven by the recorded force. refitted: the stick-slip model after its own refit; extended: extended.fmu;
    oracle: the rig's own equations; network: the surrogate, None where it diverged.
    """

    frequency: float
    recorded: Recording
    refitted: Recording
    extended: Recording
    oracle: Recording
    network: Recording | None

    def error(self, which: str) -> float:
        """Free-run NRMSE of x against the recording (fraction); infinite where there is no answer."""
        found = getattr(self, which)
        return nrmse(found.channel("x"), self.recorded.channel("x")) if found is not None else np.inf

    def even_db(self, which: str) -> float:
        """Even harmonics of R over the second half, in dB re the fundamental; NaN where there is no answer."""
        found = getattr(self, which)
        if found is None:
            return float("nan")
        R = found.channel("R")
        return harmonics(R[R.size // 2 :], found.dt, self.frequency).even_level_db


@dataclass(frozen=True, eq=False)
class LabCase:
    """Results of part 2."""

    folder: Path
    tests: tuple[UnseenTest, ...]
    network: Identification
    diagnosis: Diagnosis

    @property
    def named(self) -> bool:
        """Whether the concealed effect heads the findings."""
        findings = self.diagnosis.findings
        return bool(findings) and findings[0].effect == CONCEALED

    def ratios(self) -> Array:
        """Free-run error of the extended model over the oracle's, of each unseen test."""
        return np.array([test.error("extended") / test.error("oracle") for test in self.tests])

    @property
    def checks(self) -> tuple[Check, ...]:
        """Targets of the lab case."""
        part = "lab case"
        gap = next((f.threshold.value for f in self.diagnosis.findings if f.threshold is not None), np.nan)
        even = max(abs(test.even_db("extended") - test.even_db("recorded")) for test in self.tests)
        return (
            Check(part, "concealed loss of contact is named first", float(self.named), 1, "yes", least=True),
            Check(part, "displacement at which contact is lost, off by", 100 * abs(gap / 1.2e-3 - 1), 5.0, "%"),
            Check(
                part,
                "unseen free run over that of the rig's own equations, worst ratio",
                float(self.ratios().max()),
                1.10,
            ),
            Check(part, "even harmonics of R on unseen tests, worst difference", even, 3.0, "dB"),
        )


def lab_case(out: Path, size: Size) -> LabCase:
    """Record the rig, train a surrogate on it, diagnose the stick-slip model, and try all on unseen tests."""
    build_model(RIG, out / "rig.fmu")
    build_model(BELIEVED, out / "believed.fmu")
    rig = Driver(out / "rig.fmu")
    chirps = tuple(_record(rig, text, seed, out / "recordings") for seed, text in enumerate(CHIRPS))
    unseen = [_record(rig, text, 100 + seed, out / "recordings") for seed, text in enumerate(TESTS)]
    network = identify(
        chirps, mass=NOMINAL["m"], layers=(5, 5), ensemble=size.lab_starts, seed=size.seed, holdout=unseen
    )
    found = diagnose(chirps, model=BELIEVED, parameters=NOMINAL, holdout=unseen, out=out)
    found.report(out / "report.html", f"hystid diagnose recordings/chirp_*.csv --model {BELIEVED}")
    return LabCase(out, _tried(out, unseen, network, found), network, found)


def _record(rig: Driver, text: str, seed: int, folder: Path) -> Recording:
    """One test on the rig, sampled at 2.5 kHz, with noise; written as CSV."""
    answer = simulate(rig, force_of(text, _STEP))
    F, x, v, a = (answer.channel(name)[::_EVERY] for name in ("F", "x", "v", "a"))
    measured = dict.fromkeys(("F", "x", "v", "a"), "measured")  # by the virtual rig's sensors
    sampled = Recording(text, answer.t[::_EVERY], F=F, x=x, v=v, a=a, origin=measured, notes=answer.notes)
    recording = add_noise(sampled, NOISE_DB, seed)
    kind, _, rest = text.partition(":")
    name = f"{kind}_{rest.partition(',')[0].replace('@', '_')}"
    write_csv(recording, folder / f"{name}.csv")
    return replace(recording, name=name)


def _tried(out: Path, unseen: Sequence[Recording], network: Identification, found: Diagnosis) -> tuple[UnseenTest, ...]:
    believed, rig = Driver(out / "believed.fmu"), Driver(out / "rig.fmu")
    extended = Driver(out / "extended.fmu") if (out / "extended.fmu").exists() else None
    refit = {name: value.value for name, value in found.refit.items()}
    learned = {c.recording.name: c.network.free_run for c in network.comparisons}
    tests = []
    for text, recording in zip(TESTS, unseen, strict=True):
        force = Recording(recording.name, recording.t, F=recording.channel("F"))
        refitted = simulate(believed, force, parameters=refit)
        run = learned[recording.name]
        tests.append(
            UnseenTest(
                parse(text).low,
                with_restoring_force(recording, NOMINAL["m"]),
                refitted,
                simulate(extended, force) if extended else refitted,
                simulate(rig, force),
                None if run is None else replace(recording, x=run["x"], v=run["v"], a=run["a"], R=run["R"]),
            )
        )
    return tuple(tests)
