"""The two ways of training: the published one, and the refined one that starts from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from hystid import processing
from hystid.identification import data
from hystid.identification.denoise import smooth
from hystid.networks.ensemble import Samples, Start, best, draw, refine_ensemble, train_ensemble
from hystid.networks.joint import Sequences
from hystid.networks.normal_equations import Precision
from hystid.networks.training import Rule
from hystid.recording import Recording
from hystid.turning_points import TurningPoints

_FIRST_ITERATIONS = 60  # of a refined training by itself: enough to rank the starts, the rest is done in simulation
_PATIENCE = 25  # iterations without a lower validation error in simulation: left-out branches make that error uneven


@dataclass(frozen=True)
class Recipe:
    """From a recording to its x, v, R: joint smoothing where wanted, then ``processing.prepare``."""

    band: processing.Band | None
    decimate: int
    mass: float
    smoothing: bool

    def apply(self, recording: Recording) -> Recording:
        """The recording with x, v, a, R derived and reduced as stated."""
        ready = smooth(recording) if self.smoothing else recording
        return processing.prepare(ready, band=self.band, decimate=self.decimate, mass=self.mass)


@dataclass(frozen=True, eq=False)
class Trained:
    """Outcome of one way of training: every start, the chosen ones (best first), the samples they were trained on."""

    starts: Sequence[Start]
    chosen: Sequence[Start]
    samples: Samples
    notes: tuple[str, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """How to train: see the arguments of ``identify``."""

    layers: tuple[int, ...]
    ensemble: int
    seed: int
    rule: Rule
    precision: Precision
    samples: int
    workers: int | None
    device: str | None = None

    def published(self, recordings: Sequence[Recording]) -> Trained:
        """Each network by itself, measured force at the turning points; the best tenth of the starts is averaged."""
        drawn = data.samples(recordings, TurningPoints()).subset(self.samples, self.seed)
        starts = self._starts(drawn, self.rule)
        return Trained(starts, best(starts, self._tenth), drawn, self._shortfall(starts), {"method": "published"})

    def refined(self, recordings: Sequence[Recording]) -> Trained:
        """As ``published``, shorter; then the best third goes on in simulation, and of that the best are averaged."""
        rule = TurningPoints()
        drawn = data.samples(recordings, rule).subset(self.samples, self.seed)
        first = replace(self.rule, max_iterations=min(_FIRST_ITERATIONS, self.rule.max_iterations))
        starts = self._starts(drawn, first)
        sequences = Sequences.of([(r.channel("x"), r.channel("v"), r.channel("R")) for r in recordings], rule)
        sequences = sequences.pick(draw(len(sequences.x), self.samples, self.seed))
        leaders = best(starts, max(self._tenth, round(len(starts) / 3)))
        patient = replace(self.rule, max_fails=max(_PATIENCE, self.rule.max_fails))
        finished = refine_ensemble(leaders, sequences, seed=self.seed, rule=patient, workers=self.workers)
        refined = {start.number: start for start in finished}
        everything = [refined.get(start.number, start) for start in starts]
        chosen = best(finished, self._tenth)
        return Trained(everything, chosen, drawn, self._shortfall(starts), {"method": "refined"})

    @property
    def _tenth(self) -> int:
        return max(1, round(self.ensemble / 10))

    def _starts(self, drawn: Samples, rule: Rule) -> list[Start]:
        return train_ensemble(
            drawn,
            self.layers,
            self.ensemble,
            seed=self.seed,
            rule=rule,
            precision=self.precision,
            workers=self.workers,
            device=self.device,
        )

    def _shortfall(self, starts: Sequence[Start]) -> tuple[str, ...]:
        if len(starts) == self.ensemble:
            return ()
        return (f"interrupted: {len(starts)} of {self.ensemble} trainings had finished",)
