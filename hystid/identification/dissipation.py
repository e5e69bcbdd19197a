"""Dissipation of a model over closed cycles: probed, enforced in training, and made up for by a damper where it lacks.

A network knows nothing of energy. Where it feeds in a little at some small amplitude, a free decay never ends, however
small its error on recordings (passivity; Willems, 1972). Recordings hardly show such cycles. So a trained pair is asked
about decays that settle on cycles of many amplitudes, places, frequencies and inputs. Cycles that feed energy in become
training data: their own force, with the damper that they lack. The mean of pairs that dissipate dissipates too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.comparison import loop_energy
from hystid.leastsquares import Rule
from hystid.networks import Member, TwoNetworkModel
from hystid.networks.joint import Sequences, train_beside
from hystid.recording import Array, Recording

_AMPLITUDES = (0.003, 0.01, 0.03, 0.1, 0.3, 0.6, 0.95)  # of half the range of x
_PLACES = (0.0, -0.5, 0.5)  # of half the range of x, where the cycle fits in
_PACES = (0.5, 1.0, 2.0)  # of the recordings' mean frequencies, up to the range of v
_SPEED = 0.95  # of the range of v
_LEVELS = (0.5, 0.0, 1.0)  # of the ranges of the further inputs
_SAMPLES = 80  # per cycle: tanh networks of a few neurons are smooth on this scale
_DECAY = 0.4  # of the amplitude, from one cycle to the next, on the way to the last two
_ROUNDS = 4  # cycles that were well may feed after training on others
LEAST = 1e-3  # of pi A F: no device with friction loses less, and a lossless one hardly notices


@dataclass(frozen=True, eq=False)
class Decay:
    """A decay that settles on a harmonic cycle of an amplitude [m], shape (n,) each: x [m], v [m/s], R [N] of a model;
    two cycles of it at the end. frequency [rad/s]; inputs: by name, held."""

    amplitude: float
    frequency: float
    x: Array
    v: Array
    R: Array
    inputs: dict[str, float]

    @property
    def energy(self) -> float:
        """Taken out in the last cycle [J]."""
        return loop_energy(self.x[-_SAMPLES - 1 :], self.R[-_SAMPLES - 1 :])

    @property
    def force(self) -> float:
        """Half the swing of R in the last cycle [N]."""
        return float(np.ptp(self.R[-_SAMPLES - 1 :])) / 2

    @property
    def loss(self) -> float:
        """Energy over pi times amplitude times force: 1 for a force in phase with v, below 0 where energy is fed in."""
        return self.energy / (np.pi * self.amplitude * self.force) if self.force else 0.0

    @property
    def damper(self) -> float:
        """Damping [N.s/m] that the cycle lacks, 0 where it lacks none."""
        lacking = LEAST * np.pi * self.amplitude * self.force - self.energy
        return max(0.0, lacking / (np.pi * self.frequency * self.amplitude**2))

    @property
    def settled(self) -> Array:
        """Which samples lie in the last two cycles, shape (n,)."""
        return np.asarray(np.arange(len(self.x)) >= len(self.x) - 2 * _SAMPLES)

    def recording(self, model: TwoNetworkModel) -> Recording:
        """The motion with the force as it should be: that of the model and of the damper that it lacks."""
        t = np.arange(len(self.x), dtype=np.float64) * float(2 * np.pi / (self.frequency * _SAMPLES))
        R = self.R + np.where(self.settled, self.damper * self.v, 0.0)
        R[0] = _relaxed(model)
        extra = {port.column: np.full(len(t), self.inputs[port.name]) for port in model.inputs}
        return Recording(
            "cycle", t, x=self.x, v=self.v, R=R, extra=extra, units={p.column: p.unit for p in model.inputs}
        )


def dissipating(
    member: Member,
    model_of: Callable[[Member], TwoNetworkModel],
    recordings: Sequence[Recording],
    parts: tuple[Sequences, Sequences],
    sequences_of: Callable[[Sequence[Recording], Sequence[Array]], Sequences],
    rule: Rule,
) -> Member:
    """The pair, trained on until every cycle takes energy out, at most for a few rounds.

    model_of: a pair as a model with its training range. parts: data for training and for validation. sequences_of:
    recordings as data, with weights of their samples. A cycle's errors count relative to the swing of its own force:
    small cycles are those that feed.
    """
    asked: set[int] = set()
    for _ in range(_ROUNDS):
        model = model_of(member)
        found = cycles(model, recordings)
        lacking = {k for k, cycle in enumerate(found) if cycle.damper > 0 and cycle.force > 0}
        if not lacking:
            break
        asked |= lacking
        wanted = [found[k] for k in sorted(asked) if found[k].force > 0]
        weights = [cycle.settled / cycle.force for cycle in wanted]
        member = train_beside(member, parts, sequences_of([cycle.recording(model) for cycle in wanted], weights), rule)
    return member


def cycles(model: TwoNetworkModel, recordings: Sequence[Recording]) -> list[Decay]:
    """The model on cycles within its training range, at the paces of the recordings."""
    (low, high), (back, forth) = (model.training_range[name] for name in ("x", "v"))
    half, fastest = (high - low) / 2, _SPEED * min(-back, forth)
    levels = _LEVELS if model.inputs else _LEVELS[:1]
    found = []
    for place in _PLACES:
        for amplitude in (share * half for share in _AMPLITUDES if abs(place) + share <= 1):
            for w in paces(recordings):
                if amplitude * w <= fastest:
                    centre = (low + high) / 2 + place * half
                    found += [_cycle(model, centre, amplitude, w, level) for level in levels]
    return found


def feeding(model: TwoNetworkModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """A sentence on cycles that still feed energy in, none where there are none."""
    asked = cycles(model, recordings)
    found = [cycle for cycle in asked if cycle.loss < 0]
    if not found:
        return ()
    worst = min(found, key=lambda cycle: cycle.loss)
    unit = "rad" if model.metadata.get("rotational") else "m"
    return (
        f"{len(found)} of {len(asked)} harmonic cycles within the training range feed energy in, most at an amplitude "
        f"of {worst.amplitude:.3g} {unit} and {worst.frequency / (2 * np.pi):.3g} Hz: a free decay may not end there; "
        "record such motions too, or train more starts",
    )


def paces(recordings: Sequence[Recording]) -> list[float]:
    """Mean angular frequencies [rad/s] of the recordings' displacement and velocity, and slower and faster ones."""
    means = []
    for recording in recordings:
        x, v = recording.channel("x"), recording.channel("v")
        means += [float(np.std(v) / np.std(x)), float(np.std(np.diff(v)) / recording.dt / np.std(v))]
    return sorted({pace * w for pace in _PACES for w in (min(means), max(means))})


def _relaxed(model: TwoNetworkModel) -> float:
    return 0.5 * sum(model.training_range["R"])


def _cycle(model: TwoNetworkModel, centre: float, amplitude: float, w: float, level: float) -> Decay:
    low, high = model.training_range["x"]
    most = 0.95 * min(high - centre, centre - low)
    count = max(0, int(np.ceil(np.log(amplitude / most) / np.log(_DECAY)))) if amplitude < most else 0
    phase = 2 * np.pi * np.arange((count + 2) * _SAMPLES + 1) / _SAMPLES
    size = np.maximum(amplitude, most * _DECAY ** (phase / (2 * np.pi))) if count else np.full(len(phase), amplitude)
    x = centre + size * np.sin(phase)
    v = np.gradient(x, 2 * np.pi / _SAMPLES) * w
    v[-2 * _SAMPLES - 1 :] = amplitude * w * np.cos(phase[-2 * _SAMPLES - 1 :])
    v = np.clip(v, *model.training_range["v"])  # the decay itself may be too fast for the range; the cycle is not
    values = {
        p.name: (1 - level) * model.training_range[p.name][0] + level * model.training_range[p.name][1]
        for p in model.inputs
    }
    start = model.initial_state(_relaxed(model), {"x": float(x[0]), "v": float(v[0])} | values)
    paced = replace(model, sample_rate=w * _SAMPLES / (2 * np.pi))
    R, _ = paced.response(x, v, start, {name: np.full(len(x), value) for name, value in values.items()})
    return Decay(amplitude, w, x, v, R, values)
