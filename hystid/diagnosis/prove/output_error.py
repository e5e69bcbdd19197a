"""Output-error fit: parameters from the force balance, moved so that the free run meets the measured displacement.

The balance judges every sample by itself, so that small biases of the regressors add up in a free run. Here the whole
run is compared. The last quarter of every recording is kept back: what does not help there is not taken.

A loop of its own beside ``leastsquares``: steps are relative to where the unknowns stand and limited in size, and the
search ends when the derivatives promise too little, or when so many samples have been simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.compiled import CompiledModel, Motion
from hystid.diagnosis.fit.hypothesis import Hypothesis, Unknown, get, put
from hystid.diagnosis.model.freerun import (
    SUBSTEPS,
    diverges,
    driven,
    free_run,
    may_be_steady,
    run_from,
    runs_from,
    start_of,
)
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

Settings = Callable[[Hypothesis], Mapping[str, float]]
WORK = 1_500_000  # samples that may be simulated: two seconds, counted so that the result is the same on any machine
_FITTED = 0.75  # share of each recording that is fitted; the last part decides
_FIT_WORTH = 0.8  # error on that part, over that before, above which the parameters of the balance are kept
_HOPEFUL = 0.8  # sum of squares over that at the start, above which nothing that counts can be reached: 0.8^2 counts
_QUIET = 1.5  # error of the free run in units of the noise of x below which nothing is left to fit
_LOST = 0.7  # error of the free run beyond which the run tells nothing about the parameters
_EXACT = 0.01  # error of the integration, units of the noise of x: it averages out as noise does, over 10,000 samples
_STEP = 1e-4  # step of difference quotients in scaled unknowns
_CHAIN = 0.1  # scale of a delay [samples] and of a mass error
_REACH = 0.5  # largest move of a scaled unknown in one step
_ROUNDS = 12
_LEAST_STEPS = 4  # steps for which there must be work
_LAST_FALL = 1e-3  # fall of the sum of squares by which a step ends the search
_SHORTEST_RECORDING = 1000  # samples per recording below which an output-error fit is no longer worth its name
_BLOCKS = 40  # of all recordings, for the standard errors: each must be long against the memory of the residual


@dataclass(frozen=True)
class Improved:
    """Outcome. before, after: error of the free run on the samples that were kept back, NRMSE.

    covariance: of the unknowns, shape (unknowns, unknowns), of the logarithm where an unknown is fitted so, else in its
    own unit; NaN in rows and columns of unknowns that could not move. The residual of a free run is an oscillation, not
    white noise: the errors follow from sums over blocks of samples (batch means), and the start states are allowed for.
    """

    hypothesis: Hypothesis
    before: float
    after: float
    covariance: Array = field(repr=False)


@dataclass(frozen=True)
class _Track:
    """One recording as it is fitted: displacement, its scale, samples that are run, passes, start state, steps of
    integration per sample."""

    part: Part
    target: Array
    scale: float
    rows: int
    periods: int
    start: Mapping[str, float]
    substeps: int = SUBSTEPS
    forces: dict[float, Motion] = field(default_factory=dict, repr=False)  # by their delay

    def force(self, model: CompiledModel, delay: float) -> Motion:
        """What drives the model."""
        if delay not in self.forces:
            self.forces.clear()
            self.forces[delay] = driven(
                model, self.part, delay, periods=self.periods, rows=self.rows, substeps=self.substeps
            )
        return self.forces[delay]

    def misfit(self, run: Array) -> Array | None:
        """Simulated less measured displacement over its scale, shape (rows,); None where the run diverges."""
        x = run[-self.rows :]
        return None if diverges(x, self.part) else (x - self.target[: self.rows]) / self.scale

    def split(self, misfit: Array) -> tuple[Array, Array]:
        """What is fitted and what is kept back."""
        kept = int(_FITTED * len(misfit))
        return misfit[:kept], misfit[kept:]


def output_error_fit(
    model: CompiledModel,
    start: Hypothesis,
    unknowns: Sequence[Unknown],
    parts: Sequence[Part],
    settings: Settings,
    work: int = WORK,
) -> Improved | None:
    """Levenberg-Marquardt on the displacement in free run, None where it does not clearly help on samples kept back.

    model: the extended model. settings: its parameters at a hypothesis. unknowns: what the force balance fitted; every
    recording has its own start state besides. work: samples that may be simulated; recordings are shortened (to no less
    than 1000 samples) so that a few steps fit in. Both errors are those of runs from the measured start states.
    """
    whole = _tracks(model, start, parts, settings)
    tracks = _shortened(whole, len(unknowns), work)
    if not tracks or not unknowns:
        return None
    search = _Search(model, unknowns, settings)
    tracks = search.in_long_steps(start, tracks)
    first = search.errors(start, tracks)
    if first is None or not _worth_trying(first, tracks):
        return None
    found = search.run(start, tracks, work)
    if found is None:
        return None
    end, begun = found
    last = search.errors(end, tracks)
    if last is None or not np.mean(last) < _FIT_WORTH * np.mean(first):
        return None
    return Improved(end, float(np.mean(first)), float(np.mean(last)), search.covariance(end, begun))


def _tracks(model: CompiledModel, start: Hypothesis, parts: Sequence[Part], settings: Settings) -> list[_Track]:
    """The recordings, each begun in the way in which it runs closer; none where one of them diverges or lacks x."""
    found = []
    for part in parts:
        if "x" not in part.measured:
            return []
        target = part.measured["x"]
        values = settings(start)
        plain = run_from(model, part, values, start.delay)
        best = free_run(model, part, values, start.delay) if may_be_steady(model, part) else plain
        if best is None or plain is None:
            return []
        periods = 1 if np.array_equal(best, plain) else 2
        at = {} if periods == 2 else start_of(model, part)
        scale = float(np.std(target)) or 1.0
        found.append(_Track(part, target, scale, len(part), periods, at))
    return found


def _shortened(tracks: Sequence[_Track], count: int, work: int) -> list[_Track]:
    """Tracks of a length that leaves work for at least four steps; none where that is too short."""
    share = work / max(_LEAST_STEPS * _cost(tracks, count), 1)
    if share >= 1.0:
        return list(tracks)
    if any(track.periods > 1 for track in tracks):  # half a period does not close on itself
        return []
    made = [replace(track, rows=int(share * track.rows), forces={}) for track in tracks]
    return made if min(track.rows for track in made) >= _SHORTEST_RECORDING else []


def _cost(tracks: Sequence[_Track], count: int) -> int:
    """Samples that one step simulates: derivatives by the unknowns and the start states, and two trials."""
    return sum(track.rows * track.periods * (count + len(track.start) + 2) for track in tracks)


def _worth_trying(errors: Sequence[float], tracks: Sequence[_Track]) -> bool:
    noise = [track.part.noise["x"] / track.scale for track in tracks]
    return max(errors) < _LOST and any(e > _QUIET * n for e, n in zip(errors, noise, strict=True))


@dataclass(frozen=True)
class _Search:
    """The model and what may move."""

    model: CompiledModel
    moved: Sequence[Unknown]
    settings: Settings

    def errors(self, at: Hypothesis, tracks: Sequence[_Track]) -> list[float] | None:
        """Error on the samples kept back, per recording."""
        misfits = self._misfits(at, tracks)
        if misfits is None:
            return None
        kept = [track.split(misfit)[1] for track, misfit in zip(tracks, misfits, strict=True)]
        return [float(np.sqrt(np.mean(values**2))) for values in kept]

    def in_long_steps(self, at: Hypothesis, tracks: Sequence[_Track]) -> list[_Track]:
        """The tracks in the fewest steps per sample that change nothing."""
        exact = self._misfits(at, tracks)
        if exact is None:
            return list(tracks)
        allowed = [_EXACT * track.part.noise["x"] / track.scale for track in tracks]
        for substeps in range(1, SUBSTEPS):
            made = [replace(track, substeps=substeps, forces={}) for track in tracks]
            found = self._misfits(at, made)
            if found is None:
                continue
            if all(np.mean((b - a) ** 2) < most**2 for a, b, most in zip(exact, found, allowed, strict=True)):
                return made
        return list(tracks)

    def covariance(self, at: Hypothesis, tracks: Sequence[_Track]) -> Array:
        """See ``Improved``; all NaN where the end cannot be differentiated."""
        count = len(self.moved)
        rows = self._rows(at, tracks)
        jacobian = None if rows is None else self._jacobian(at, tracks, rows)
        if rows is None or jacobian is None:
            return np.full((count, count), np.nan)
        sizes = [1.0 if u.log else _CHAIN if u.key[0] == "chain" else abs(get(at, u.key)) for u in self.moved]
        found = _sandwich(jacobian, rows, [int(_FITTED * track.rows) for track in tracks])[:count, :count]
        return np.asarray(found * np.outer(sizes, sizes))

    def run(self, at: Hypothesis, tracks: Sequence[_Track], work: int) -> tuple[Hypothesis, Sequence[_Track]] | None:
        """Parameters that make the fitted samples agree best, and the tracks with their start states; None where the
        derivatives promise too little to be worth the way."""
        rows = self._rows(at, tracks)
        damping = 1e-3
        first = float(rows @ rows) if rows is not None else 0.0
        for _ in range(min(_ROUNDS, work // _cost(tracks, len(self.moved)))):
            jacobian = None if rows is None else self._jacobian(at, tracks, rows)
            if rows is None or jacobian is None:
                break
            cost = float(rows @ rows)
            if _attainable(jacobian, rows) > _HOPEFUL * first:
                return None
            for _ in range(5):
                there, others = self._moved(at, tracks, _solved(jacobian, rows, damping))
                tried = self._rows(there, others)
                if tried is not None and float(tried @ tried) < cost:
                    break
                damping *= 10.0
            else:
                break
            at, tracks, rows, damping = there, others, tried, max(damping / 10.0, 1e-9)
            if rows is not None and float(rows @ rows) > (1 - _LAST_FALL) * cost:
                break
        return at, tracks

    def _misfits(self, at: Hypothesis, tracks: Sequence[_Track]) -> list[Array] | None:
        return self._all_misfits([(at, track) for track in tracks])

    def _all_misfits(self, wanted: Sequence[tuple[Hypothesis, _Track]]) -> list[Array] | None:
        """Misfit of every track at its hypothesis, from runs side by side; None where one of them diverges."""
        settings = [{**self.settings(at), **track.start} for at, track in wanted]
        runs = runs_from(self.model, [track.force(self.model, at.delay) for at, track in wanted], settings)
        if runs is None:
            return None
        misfits = [track.misfit(run) for (_, track), run in zip(wanted, runs, strict=True)]
        found = [misfit for misfit in misfits if misfit is not None]
        return found if len(found) == len(misfits) else None

    def _rows(self, at: Hypothesis, tracks: Sequence[_Track]) -> Array | None:
        misfits = self._misfits(at, tracks)
        if misfits is None:
            return None
        return np.concatenate([track.split(misfit)[0] for track, misfit in zip(tracks, misfits, strict=True)])

    def _jacobian(self, at: Hypothesis, tracks: Sequence[_Track], rows: Array) -> Array | None:
        """Difference quotients; a start state needs a run of its own recording alone."""
        count = len(self.moved)
        owners = [i for i, track in enumerate(tracks) for _ in track.start]
        edges = np.cumsum([0, *(int(_FITTED * track.rows) for track in tracks)])
        wanted, places = [], []  # runs, and the column and recording that each belongs to
        for i, step in enumerate(_STEP * np.eye(count + len(owners))):
            there, others = self._moved(at, tracks, step)
            for k in range(len(tracks)) if i < count else (owners[i - count],):
                wanted.append((there, others[k]))
                places.append((i, k))
        found = self._all_misfits(wanted)
        if found is None:
            return None
        columns = np.zeros((count + len(owners), len(rows)))
        for (i, k), (_, track), misfit in zip(places, wanted, found, strict=True):
            part = slice(edges[k], edges[k + 1])
            columns[i, part] = (track.split(misfit)[0] - rows[part]) / _STEP
        return columns.T

    def _moved(self, at: Hypothesis, tracks: Sequence[_Track], step: Array) -> tuple[Hypothesis, list[_Track]]:
        """Unknowns moved by scaled steps: relative to their own size, start states to the size of the motion."""
        changes = {}
        for unknown, move in zip(self.moved, step, strict=False):
            value = get(at, unknown.key)
            size = _CHAIN if unknown.key[0] == "chain" else abs(value)
            target = value * np.exp(move) if unknown.log else value + move * size
            changes[unknown.key] = float(np.clip(target, unknown.low, unknown.high))
        others, used = [], len(self.moved)
        for track in tracks:
            sizes = {name: _size(track.part, name) for name in track.start}
            start = {
                name: track.start[name] + float(step[used + i]) * size for i, (name, size) in enumerate(sizes.items())
            }
            used += len(sizes)
            others.append(replace(track, start=start))
        return put(at, changes), others


def _size(part: Part, name: str) -> float:
    """Scale of a start state: that of the displacement or of the velocity."""
    velocity = name.removesuffix("_start").rpartition(".")[2] == "v"
    return float(np.std(part.v if velocity else part.x)) or 1.0


def _solved(jacobian: Array, rows: Array, damping: float) -> Array:
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    normal = scaled.T @ scaled
    normal[np.diag_indices_from(normal)] += damping
    return np.asarray(np.clip(-np.linalg.solve(normal, scaled.T @ rows) / scale, -_REACH, _REACH))


def _attainable(jacobian: Array, rows: Array) -> float:
    """Sum of squares that a full step would leave if the run were linear in its unknowns."""
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(scale > 0, scale, 1.0)
    right = scaled.T @ rows
    return float(rows @ rows - right @ np.linalg.pinv(scaled.T @ scaled, rcond=1e-12) @ right)


def _sandwich(jacobian: Array, rows: Array, lengths: Sequence[int]) -> Array:
    """Covariance of least squares whose residual is correlated over less than a block; NaN for columns that vanish."""
    scale = np.linalg.norm(jacobian, axis=0)
    alive = scale > 0
    scaled = jacobian[:, alive] / scale[alive]
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
    scores = np.split(scaled * rows[:, None], np.cumsum(lengths)[:-1])
    each = max(2, _BLOCKS // len(lengths))
    sums = np.array([np.sum(block, axis=0) for part in scores for block in np.array_split(part, each)])
    freedom = len(sums) / max(1, len(sums) - int(np.sum(alive)))  # the scores add up to zero at the optimum
    found = np.full((len(scale), len(scale)), np.nan)
    found[np.ix_(alive, alive)] = freedom * bread @ (sums.T @ sums) @ bread / np.outer(scale[alive], scale[alive])
    return found
