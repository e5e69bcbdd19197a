"""The two ways of training: the published one, and the refined one that starts from it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid import processing
from hystid.identification import data
from hystid.identification.dissipation import dissipating
from hystid.identification.levels import apart_between_levels
from hystid.identification.prediction import drift, predict
from hystid.leastsquares import Rule
from hystid.networks import FurtherInput, Lag, Member, TwoNetworkModel
from hystid.networks.ensemble import Samples, TrainedPair, best, refine_ensemble, side_by_side, train_ensemble, train_on
from hystid.networks.joint import Sequences, Trajectory
from hystid.networks.level import Level
from hystid.networks.normal_equations import Precision
from hystid.networks.training import draw
from hystid.recording import Array, Recording, own_mass
from hystid.smoothing.noise import noise_level
from hystid.smoothing.smoother import CHANNELS, smooth
from hystid.turning_points import TurningPoints

_FIRST_ITERATIONS = 60  # of a refined training by itself: enough to rank the starts, the rest is done in simulation
_HEAT = 60  # iterations in simulation of every start, on a share of the samples: then their order hardly changes
_HEAT_SHARE = 0.2
_LAST_ITERATIONS = 600  # in simulation, of the best sixth: the best still gain after 400
_RUN = 200_000  # samples of all recordings that each start is run on: bounds what a million of them cost
_BRANCH = 8  # samples that are fitted in the time that the memory needs for one branch
_FEEDING = 40  # in simulation, of those that are averaged, on cycles that feed energy in: they are near what is wanted
_PATIENCE = 25  # iterations without a lower validation error in simulation: left-out branches make that error uneven
_PROGRESS = 5e-4  # of the training error in 20 iterations in simulation: trainings that gain less are at their end
_COMPARABLE = 1.5  # times the least error: members above that would spoil the average
_HOPELESS = 3.0  # times the least validation error: starts above that are not run in closed loop
_FEW_BRANCHES = 100  # of them 15 for validation: too few to tell the best tenth of the starts from the best third
_MODEL_ERROR = 3e-3  # of a recording's force: what a good model misses anyhow, however low the noise


@dataclass(frozen=True)
class Recipe:
    """From a recording to its x, v, R: joint smoothing where wanted, then ``processing.prepare``."""

    band: processing.Band | None
    decimate: int
    mass: float
    smoothing: bool

    def apply(self, recording: Recording) -> Recording:
        """The recording with x, v, a, R derived and reduced as stated."""
        ready = smoothed(recording) if self.smoothing else recording
        mass = own_mass(recording, self.mass)
        return processing.prepare(ready, band=self.band, decimate=self.decimate, mass=mass)


def smoothed(recording: Recording) -> Recording:
    """The recording with x, v and a of one motion; F is untouched, R = F - m a has to be formed anew.

    Uses the channels that were measured, each weighted by its own noise. A recording without x, or whose time only
    numbers the samples, or shorter than 64 samples is returned as it is: an integrated motion drifts.
    """
    measured = {name: recording.channel(name) for name in CHANNELS if recording.direct(name)}
    if "x" not in measured or recording.quasi_static or len(recording) < 64:
        return recording
    noise = {name: noise_level(values) for name, values in measured.items()}
    motion = smooth(measured, noise, recording.dt)
    sources = ", ".join(measured)
    levels = ", ".join(f"{level:.3g} {recording.unit(name)} on {name}" for name, level in noise.items())
    return replace(
        recording,
        **{name: getattr(motion, name) for name in CHANNELS},
        R=recording.R if recording.direct("R") else None,
        origin={**recording.origin, **dict.fromkeys(CHANNELS, f"joint smoothing of {sources}")},
        notes=(*recording.notes, f"x, v, a smoothed jointly from {sources} (noise {levels})"),
    )


@dataclass(frozen=True, eq=False)
class Trained:
    """Outcome of one way of training: every start, the chosen ones (best first), the samples they were trained on.

    unseen: samples of all recordings, one after the other, that were not trained on; None where that is not known.
    """

    starts: Sequence[TrainedPair]
    chosen: Sequence[TrainedPair]
    samples: Samples
    notes: tuple[str, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)
    unseen: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Plan:
    """How to train: see the arguments of ``identify``."""

    mass: float
    layers: tuple[int, ...]
    ensemble: int
    seed: int
    rule: Rule
    precision: Precision
    samples: int
    workers: int | None
    device: str | None = None
    inputs: tuple[FurtherInput, ...] = ()
    lags: tuple[Lag, ...] = ()
    level: Level | None = None

    def published(self, recordings: Sequence[Recording]) -> Trained:
        """Each network by itself, measured force at the turning points; the best tenth of the starts is averaged."""
        drawn = data.samples(recordings, TurningPoints(), self.inputs, self.lags, self.level).subset(
            self.samples, self.seed
        )
        starts = self._starts(drawn, self.rule)
        return Trained(starts, best(starts, self._tenth), drawn, self._shortfall(starts), {"method": "published"})

    def refined(self, recordings: Sequence[Recording]) -> Trained:
        """As ``published``, shorter; then all starts go on in simulation, the best sixth of them to the end.

        Averaged is a tenth of all starts, those that do best both by validation error and by running the training
        recordings in closed loop. Errors in simulation are weighted by what each recording
        can be fitted to: its noise and a share of its own force. Unweighted, the loudest one alone would decide.
        """
        memory = TurningPoints()
        drawn = data.samples(recordings, memory, self.inputs, self.lags, self.level).subset(self.samples, self.seed)
        first = replace(self.rule, max_iterations=min(_FIRST_ITERATIONS, self.rule.max_iterations))
        starts = self._starts(drawn, first)
        motions = data.motions(recordings, self.inputs, self.lags, self.level)
        sequences = Sequences.of(motions, memory, self._weights(recordings, motions), len(self.inputs))
        sequences, kept = sequences.thinned(self.samples // _BRANCH)
        unseen, left_out = ~kept, sequences.unseen(self.seed)
        unseen[kept] = False if left_out is None else left_out
        sequences = sequences.pick(draw(len(sequences.x), self.samples, self.seed))
        patient = replace(self.rule, max_fails=max(_PATIENCE, self.rule.max_fails), progress=_PROGRESS)
        finished: Sequence[TrainedPair] = starts
        simulated: dict[int, TrainedPair] = {}
        shortfall = self._shortfall(starts)
        for count, share, rule in (
            (len(starts), _HEAT_SHARE, replace(patient, max_iterations=_HEAT)),
            (max(self._tenth, round(len(starts) / 6)), 1.0, replace(patient, max_iterations=_LAST_ITERATIONS)),
        ):
            leaders = best(finished, count)
            finished = refine_ensemble(leaders, sequences, seed=self.seed, rule=rule, share=share, workers=self.workers)
            simulated |= {start.number: start for start in finished}
            if len(finished) < len(leaders):
                told = f"interrupted: {len(finished)} of {len(leaders)} trainings in simulation had finished"
                shortfall = (*shortfall, told)
        everything = [simulated.get(start.number, start) for start in starts]
        chosen = self._steadiest(list(simulated.values()), recordings, len(sequences.x0))
        if not self.mass:  # with a mass, drift in closed loop has chosen; what still feeds energy in is told
            chosen = self._dissipating(chosen, sequences, recordings, replace(patient, max_iterations=_FEEDING))
        return Trained(everything, chosen, drawn, shortfall, {"method": "refined"}, unseen if unseen.any() else None)

    def _dissipating(
        self, chosen: Sequence[TrainedPair], sequences: Sequences, recordings: Sequence[Recording], rule: Rule
    ) -> list[TrainedPair]:
        """The chosen starts, trained on where they feed energy into closed cycles (``dissipation``)."""
        limits, rate = data.limits_of(recordings, self.inputs), max(r.sample_rate for r in recordings)
        split = sequences.split(self.seed)
        parts = sequences.pick(split["train"]), sequences.pick(split["validation"])

        def sequences_of(motions: Sequence[Recording], weights: Sequence[Array]) -> Sequences:
            moved = data.motions(motions, self.inputs, self.lags, self.level)
            return Sequences.of(moved, TurningPoints(), weights, len(self.inputs))

        def job(start: TrainedPair) -> Callable[[threading.Event], TrainedPair]:
            def run(stop: threading.Event) -> TrainedPair:
                member = dissipating(
                    start.member, lambda m: self.model([m], rate, limits), recordings, parts, sequences_of, rule
                )
                return replace(start, member=member)

            return run

        return side_by_side("dissipation", [job(start) for start in chosen], self.workers)[0]

    def _steadiest(
        self, starts: Sequence[TrainedPair], recordings: Sequence[Recording], branches: int
    ) -> list[TrainedPair]:
        """The starts to be averaged, best first: at most a tenth, none much worse than the best.

        Judged by validation error and, where there is a mass, drift in closed loop: a close force and a close run.
        Where there is none, and few branches or further inputs, the validation error alone says little: then the best
        third. It says nothing about inputs between the levels trained: there, of twice as many, those that agree best.
        """
        ranked = best(starts, len(starts))
        if not self.mass and (branches < _FEW_BRANCHES or self.inputs):
            count = max(self._tenth, round(len(starts) / 3))
            pool = ranked[: 2 * count]
            model = self.model([start.member for start in pool], recordings[0].sample_rate)
            apart = apart_between_levels(model, recordings)
            if apart is None:
                return ranked[:count]
            return [pool[k] for k in sorted(np.argsort(apart, kind="stable")[:count])]
        if not self.mass:
            return [start for start in ranked[: self._tenth] if start.error <= _COMPARABLE * ranked[0].error]

        runs = data.beginnings(recordings, max(_RUN, self.samples))

        def median_drift(*members: TrainedPair) -> float:
            model = self.model([start.member for start in members], recordings[0].sample_rate)
            return float(np.median([drift(predict(model, recording)) for recording in runs]))

        hopeful = [start for start in ranked if start.error <= _HOPELESS * ranked[0].error]
        drifts = {start.number: median_drift(start) for start in hopeful}
        marks = {start.number: start.error * drifts[start.number] for start in hopeful}
        steady = sorted(hopeful, key=lambda start: marks[start.number])[: self._tenth]
        chosen = [start for start in steady if marks[start.number] <= _COMPARABLE**2 * marks[steady[0].number]]
        if median_drift(*chosen) > 2 * max(drifts[start.number] for start in chosen):
            return chosen[:1]  # without a spring the mean of two forces that balance need not balance
        return chosen

    def model(
        self, members: Sequence[Member], sample_rate: float, limits: Mapping[str, tuple[float, float]] | None = None
    ) -> TwoNetworkModel:
        """Trained members as one model; limits: its training range."""
        return TwoNetworkModel(
            tuple(members), self.mass, sample_rate, limits or {}, inputs=self.inputs, lags=self.lags, level=self.level
        )

    def _weights(self, recordings: Sequence[Recording], motions: Sequence[Trajectory]) -> list[Array]:
        """Weights of the errors of each recording's samples, in the units of the motions' force."""
        weights = weights_of([recording.channel("R") for recording in recordings])
        spread = [np.ones(len(m.x)) if self.level is None else self.level.spread(m.further) for m in motions]
        mean = np.mean(np.concatenate(spread))
        return [weight * part / mean for weight, part in zip(weights, spread, strict=True)]

    @property
    def _tenth(self) -> int:
        return max(1, round(self.ensemble / 10))

    def _starts(self, drawn: Samples, rule: Rule) -> list[TrainedPair]:
        what = drawn, self.layers, self.ensemble
        if self.device is not None:
            return train_on(self.device, *what, seed=self.seed, rule=rule)
        return train_ensemble(*what, seed=self.seed, rule=rule, precision=self.precision, workers=self.workers)

    def _shortfall(self, starts: Sequence[TrainedPair]) -> tuple[str, ...]:
        if len(starts) == self.ensemble:
            return ()
        return (f"interrupted: {len(starts)} of {self.ensemble} trainings had finished",)


def weights_of(forces: Sequence[Array]) -> Array:
    """Weight of the errors of each recording's R: inverse of its attainable error, 1 in the mean square."""
    attainable = np.array([np.hypot(noise_level(R), _MODEL_ERROR * np.std(R)) for R in forces])
    weights = 1 / attainable
    return np.asarray(weights / np.sqrt(np.mean(weights**2)))
