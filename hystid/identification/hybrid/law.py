"""The physical part of a hybrid: a Modelica oscillator, its force along measured motions, and its fit to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from hystid.compiled import CompiledModel
from hystid.errors import NumericalError, UsageError
from hystid.files import text_of
from hystid.modelcode import Variable
from hystid.modelica import compile_model
from hystid.modelica_text import with_class
from hystid.recording import Array, Recording

_MASSES = ("m", "mass", "M")
_STARTS = 8  # of the fit: the values of the class and others beside them; a law with friction has local minima
_WIDE = 4.0  # times and parts of the values of the class: how far the other starts lie from it
_FIRST_STEPS = 8  # evaluations with which each start shows where it goes
_LAST_STEPS = 60
_REFUSED = 1e3  # times the force: error where a law has no answer at some values, so that the fit turns back


@dataclass(frozen=True)
class Law:
    """An oscillator m a + R = F in Modelica: class ``name`` in ``text`` ("" for a class of the library).

    nominal: free parameters and their values in the class. mass: name of the parameter that is the mass, "" for none.
    """

    name: str
    text: str
    model: CompiledModel = field(repr=False)
    nominal: Mapping[str, float]
    units: Mapping[str, str]
    limits: Mapping[str, tuple[float, float]]
    mass: str

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a fit may move."""
        return tuple(self.nominal)

    def forces(self, recordings: Sequence[Recording], values: Mapping[str, float]) -> list[Array]:
        """R [N] along the motion of each recording, shape (n,) each. Raises NumericalError."""
        return [self._follow(recording, values, ())["R"] for recording in recordings]

    def notes(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Sentences on parameters that the fit has left on a limit of the class."""
        return tuple(
            f"{self.name}: {name} = {value:.4g} {self.units[name]} lies on the limit of the class"
            for name, value in values.items()
            if value in self.limits[name] or np.isclose(value, self.limits[name], rtol=1e-6, atol=0).any()
        )

    def fit(
        self, recordings: Sequence[Recording], forces: Sequence[Array], weights: Sequence[Array], seed: int
    ) -> dict[str, float]:
        """Parameters of least squares of weight (force - R) over all recordings; forces, weights: shape (n,) each.

        From the values of the class and from others beside them, drawn with the seed; the best is followed to the end.
        """
        problem = _Problem(self, recordings, forces, weights)
        rng = np.random.default_rng(seed)
        given = np.array([*self.nominal.values()])
        ends = []
        for k in range(_STARTS if len(given) else 0):
            begin = given * (np.exp(rng.uniform(-np.log(_WIDE), np.log(_WIDE), len(given))) if k else 1.0)
            ends.append(problem.descend(begin, _FIRST_STEPS))
        if not ends:
            return {}
        best = min(ends, key=lambda end: end[1])
        found, cost = problem.descend(best[0], _LAST_STEPS)
        if not np.isfinite(cost):
            raise NumericalError(f"{self.name}: the law has no answer along the recordings, wherever its fit began")
        return dict(zip(self.free, map(float, found), strict=True))

    def refit(
        self,
        recordings: Sequence[Recording],
        forces: Sequence[Array],
        weights: Sequence[Array],
        values: Mapping[str, float],
    ) -> dict[str, float]:
        """As ``fit``, from given values alone."""
        found, _ = _Problem(self, recordings, forces, weights).descend(
            np.array([values[name] for name in self.free]), _LAST_STEPS
        )
        return dict(zip(self.free, map(float, found), strict=True))

    def _follow(
        self, recording: Recording, values: Mapping[str, float], sensitivities: Sequence[str]
    ) -> dict[str, Array]:
        motion = {name: recording.channel(name) for name in ("x", "v")}
        return self.model.clamp(
            motion, {}, recording.dt, parameters=dict(values), outputs=("R",), sensitivities=sensitivities
        )


class _Problem:
    """Weighted errors of the law along recordings and their derivatives, for scipy."""

    def __init__(
        self, law: Law, recordings: Sequence[Recording], forces: Sequence[Array], weights: Sequence[Array]
    ) -> None:
        self.law, self.recordings = law, recordings
        self.force, self.weight = np.concatenate(forces), np.concatenate(weights)
        self.refused = np.full(len(self.force), _REFUSED * float(np.max(np.abs(self.weight * self.force))))
        bounds = np.array([law.limits[name] for name in law.free]).reshape(-1, 2)
        self.low, self.high = bounds[:, 0], bounds[:, 1]
        self.kept: tuple[bytes, Array, Array] | None = None

    def descend(self, begin: Array, steps: int) -> tuple[Array, float]:
        """Parameters and sum of squares after at most so many evaluations; infinite where the start has no answer."""
        if not len(begin):
            return begin, 0.0
        inside = np.clip(begin, self.low, self.high)
        if self._at(inside)[0] is self.refused:
            return inside, np.inf
        found = least_squares(
            self._errors,
            inside,
            jac=self._slopes,
            bounds=(self.low, self.high),
            x_scale=np.where(inside != 0, np.abs(inside), 1.0),
            max_nfev=steps,
        )
        return np.asarray(found.x), float(found.cost)

    def _errors(self, point: Array) -> Array:
        return self._at(point)[0]

    def _slopes(self, point: Array) -> Array:
        return self._at(point)[1]

    def _at(self, point: Array) -> tuple[Array, Array]:
        key = point.tobytes()
        if self.kept is None or self.kept[0] != key:
            self.kept = (key, *self._evaluate(dict(zip(self.law.free, map(float, point), strict=True))))
        return self.kept[1], self.kept[2]

    def _evaluate(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        names = self.law.free
        try:
            found = [self.law._follow(recording, values, names) for recording in self.recordings]
        except NumericalError:
            return self.refused, np.zeros((len(self.force), len(names)))
        R = np.concatenate([out["R"] for out in found])
        slopes = np.stack([np.concatenate([out[f"d R/d {name}"] for out in found]) for name in names], axis=1)
        return self.weight * (R - self.force), self.weight[:, None] * slopes


def law_of(model: str) -> Law:
    """The oscillator that a class of the library ("HystId.Oscillators.Jenkins") or a file ("rig.mo:Rig") is.

    A file alone stands for its only model, or for the class Extended, as ``diagnose`` writes it.
    Raises UsageError where it is no oscillator, ModelicaError where it does not compile.
    """
    named = with_class(model)
    code = compile_model(named)
    variables = {v.name: v for v in code.variables}
    force = variables.get("F")
    if force is None or force.causality != "input" or not {"x", "v"} <= set(code.states) or "R" not in variables:
        raise UsageError(
            f"--model {model}: physics for a network is one mass under a force, with the input F, the states x and v "
            "and the restoring force R; extend HystId.Interfaces.PartialOscillator"
        )
    mass = next((name for name in _MASSES if name in variables), "")
    free = [v for v in code.variables if _is_free(v) and v.name != mass]
    path, _, name = named.rpartition(":")
    return Law(
        name,
        text_of(Path(path), UsageError) if path else "",
        CompiledModel(code),
        {v.name: float(v.start or 0.0) for v in free},
        {v.name: v.unit for v in free},
        {v.name: (_number(v.min, -np.inf), _number(v.max, np.inf)) for v in free},
        mass,
    )


def _is_free(v: Variable) -> bool:
    """Whether a fit may move it: a Real parameter that acts after the start."""
    return v.causality == "parameter" and v.type == "Real" and v.variability == "tunable" and "_start" not in v.name


def _number(limit: float | None, without: float) -> float:
    return without if limit is None else float(limit)
