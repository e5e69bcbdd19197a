"""Law and networks fitted together: one sum of squares, lowered in turns, the law first.

The law has the first word: it is fitted to the whole force. Networks are trained on what it leaves, and their force
counts with the share that branches confirm which they have not seen. Then the law is fitted to the force less that, and
the networks go on from where they were, until such a turn no longer lowers the error on the unseen branches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.comparison import nrmse
from hystid.compiled import CompiledModel
from hystid.errors import NumericalError
from hystid.identification import data
from hystid.identification.hybrid.law import Law
from hystid.identification.hybrid.package import OSCILLATOR, STARTS, package_text
from hystid.identification.hybrid.result import Hybrid, HybridComparison
from hystid.identification.inputs import columns_of
from hystid.identification.leftout import LeftOut
from hystid.identification.methods import Plan, Trained, weights_of
from hystid.identification.prediction import Prediction, respond, spread_of
from hystid.identification.result import Comparison
from hystid.modelica_text import compile_text
from hystid.networks import FurtherInput, TwoNetworkModel
from hystid.networks.ensemble import refine_ensemble
from hystid.networks.joint import Sequences
from hystid.networks.training import draw
from hystid.networks.trust import Tail
from hystid.recording import Array, Recording, own_mass
from hystid.rig.terms import starts_of
from hystid.turning_points import TurningPoints

_SMALLEST = (4,)  # hidden neurons of the networks that are tried before those of the asked size
_BLOCKS = 20  # of the unseen samples: their errors say how far chance alone moves the mean
_TURNS = 3
_GAIN = 0.99  # of the unseen error: a turn that lowers it by less is the last
_MORE_ITERATIONS = 100  # of the networks in each turn after the first


@dataclass(frozen=True, eq=False)
class _State:
    """Law and networks at one turn. error: weighted mean square on unseen samples."""

    values: Mapping[str, float]
    trained: Trained
    model: TwoNetworkModel
    share: float
    error: float
    layers: tuple[int, ...]


def combine(
    law: Law, plan: Plan, comparisons: Sequence[Comparison], limits: Mapping[str, tuple[float, float]]
) -> Hybrid:
    """The hybrid of a law and networks, compared with each alone on every recording.

    comparisons: of the networks alone; those with role "training" are fitted to. limits: training range of the signals.
    Raises NumericalError where the law has no answer along a recording.
    """
    used = [item.recording for item in comparisons if item.role == "training"]
    work = _Work(law, replace(plan, mass=0.0, level=None), used, limits)
    alone, state = work.run()
    text = package_text(law, state.values, state.model, state.share)
    both = CompiledModel(compile_text(text, OSCILLATOR)) if plan.mass else None
    pairs = []
    for item in comparisons:
        record = item.recording
        physics = law.forces([record], alone)[0]
        R_physics = law.forces([record], state.values)[0]
        left, each = respond(state.model, replace(record, R=record.channel("R") - R_physics))
        R = R_physics + state.share * left
        lone = Prediction(physics, nrmse(physics, record.channel("R")))
        joint = Prediction(R, nrmse(R, record.channel("R")), spread=spread_of(state.model, record, each))
        if both is not None:
            own = law.settings(record)
            lone = _with_run(lone, law, None, record, {**alone, **own}, law.inputs)
            joint = _with_run(joint, law, both, record, {f"law.{k}": u for k, u in own.items()}, plan.inputs)
        pairs.append(HybridComparison(record, item.role, lone, item.network, joint, R_physics))
    return Hybrid(
        law.name, alone, state.values, law.units, state.model, state.share, state.layers, text, pairs,
        (*law.notes(state.values),),
    )  # fmt: skip


class _Work:
    """The turns of one fit."""

    def __init__(
        self, law: Law, plan: Plan, used: Sequence[Recording], limits: Mapping[str, tuple[float, float]]
    ) -> None:
        self.law, self.plan, self.used, self.limits = law, plan, used, limits
        self.force = [record.channel("R") for record in used]
        each = weights_of(self.force)
        self.weights = [np.full(len(R), weight) for R, weight in zip(self.force, each, strict=True)]

    def run(self) -> tuple[dict[str, float], _State]:
        """Parameters of the law alone, and the last turn that lowered the unseen error."""
        alone = self.law.fit(self.used, self.force, self.weights, self.plan.seed)
        state = self._first(alone)
        for _ in range(_TURNS - 1):
            following = self._turn(state)
            if not following.error < _GAIN * state.error:
                break
            state = following
        return alone, replace(state, model=self._trusted(state))

    def _first(self, values: Mapping[str, float]) -> _State:
        """Networks as small as the unseen branches allow: larger ones only for a gain beyond its standard error."""
        left = self._left(values)
        best: tuple[_State, Array] | None = None
        for layers in dict.fromkeys([_SMALLEST, self.plan.layers]):
            plan = replace(self.plan, layers=layers)
            state, errors = self._judged(values, plan.refined(left), plan, left)
            if best is None or _clearly_less(errors, best[1]):
                best = state, errors
        assert best is not None
        return best[0]

    def _turn(self, state: _State) -> _State:
        """The law to the force less the networks', then the networks to what the law leaves."""
        left = self._left(state.values)
        networks = [state.share * respond(state.model, record)[0] for record in left]
        forces = [R - part for R, part in zip(self.force, networks, strict=True)]
        values = self.law.refit(self.used, forces, self.weights, state.values)
        left = self._left(values)
        plan = replace(self.plan, layers=state.layers)
        motions = data.motions(left, plan.inputs, plan.lags)
        sequences = Sequences.of(motions, TurningPoints(), self.weights, len(plan.inputs))
        sequences = sequences.pick(draw(len(sequences.x), plan.samples, plan.seed))
        rule = replace(plan.rule, max_iterations=_MORE_ITERATIONS)
        chosen = refine_ensemble(state.trained.chosen, sequences, seed=plan.seed, rule=rule, workers=plan.workers)
        return self._judged(values, replace(state.trained, chosen=chosen), plan, left)[0]

    def _left(self, values: Mapping[str, float]) -> list[Recording]:
        """The recordings with what the law leaves in the place of their force."""
        forces = self.law.forces(self.used, values)
        return [replace(record, R=record.channel("R") - R) for record, R in zip(self.used, forces, strict=True)]

    def _judged(
        self, values: Mapping[str, float], trained: Trained, plan: Plan, left: Sequence[Recording]
    ) -> tuple[_State, Array]:
        """The share of the networks that unseen branches confirm, and the unseen error, in blocks."""
        limits = {name: span for name, span in self.limits.items() if name != "R"}
        members = [start.member for start in trained.chosen]
        model = replace(plan.model(members, max(r.sample_rate for r in left), limits), tail=Tail(0.0, 0.0))
        residual = np.concatenate(
            [weight * record.channel("R") for weight, record in zip(self.weights, left, strict=True)]
        )
        answer = np.concatenate([weight * respond(model, r)[0] for weight, r in zip(self.weights, left, strict=True)])
        at = slice(None) if trained.unseen is None else trained.unseen
        residual, answer = residual[at], answer[at]
        power = float(answer @ answer)
        share = float(np.clip(answer @ residual / power, 0.0, 1.0)) if power else 0.0
        squares = (residual - share * answer) ** 2
        blocks = np.array([block.mean() for block in np.array_split(squares, _BLOCKS)])
        return _State(values, trained, model, share, float(squares.mean()), plan.layers), blocks

    def _trusted(self, state: _State) -> TwoNetworkModel:
        """The networks with the spread of the error of R."""
        judge = LeftOut(self._left(state.values), self.plan.inputs, self.plan.seed)
        return replace(state.model, spread=judge.spread(state.model, state.trained.unseen, state.share))


def _clearly_less(errors: Array, others: Array) -> bool:
    """Whether errors in blocks are less than others by more than the standard error of the difference."""
    gain = others - errors
    return bool(gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)))


def _with_run(
    prediction: Prediction,
    law: Law,
    both: CompiledModel | None,
    recording: Recording,
    values: Mapping[str, float],
    inputs: Sequence[FurtherInput],
) -> Prediction:
    """The prediction with the free run under the recording's force, from its first displacement and velocity.

    both: the oscillator of law and networks; None for the law by itself. values: parameters. inputs: those beside F.
    """
    model, rate = (law.model, law.reading.acceleration) if both is None else (both, "a")
    starts = starts_of(model.code) if both is None else STARTS
    begin = {name: float(recording.channel(channel)[0]) for name, channel in zip(starts, "xv", strict=True)}
    force = recording.channel("F")
    driven = {"F": force} | columns_of(recording, inputs)
    try:
        run = model.simulate(driven, recording.dt, parameters={**values, **begin}, outputs=("x", rate))
    except NumericalError as error:
        return replace(prediction, diverged=str(error))
    return prediction.with_run(recording, {"x": run["x"], "R": force - own_mass(recording, law.mass) * run[rate]})
