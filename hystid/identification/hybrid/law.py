"""The physical part of a hybrid: a Modelica oscillator, its force along measured motions, and its fit to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from hystid.compiled import CompiledModel
from hystid.errors import NumericalError, UsageError
from hystid.files import text_of
from hystid.identification.inputs import columns_of
from hystid.modelica import compile_model
from hystid.modelica_text import with_class
from hystid.networks import FurtherInput
from hystid.recording import Array, Recording, own_mass
from hystid.rig.starts import is_of_the_library, scaled, sizes_of
from hystid.rig.terms import Reading, check_starts, is_fmu, reading_of, real_parameters
from hystid.units import exponents

_STARTS = 8  # of the fit: the values of the class and others beside them; a law with friction has local minima
_WIDE = 4.0  # times and parts of the values of the class: how far the other starts lie from it
_FIRST_STEPS = 8  # evaluations with which each start shows where it goes
_LAST_STEPS = 60
_SAME_MASS = 1e-4  # of a mass, as six figures of it tell
_REFUSED = 1e3  # times the force: error where a law has no answer at some values, so that the fit turns back


@dataclass(frozen=True)
class Law:
    """A rig m a + R = F in Modelica: class ``name`` in ``text`` ("" for a class of the library).

    reading: where R and the mass stand in it. nominal: free parameters and their values in the class. mass [kg].
    inputs: those of the networks that it has as well.
    """

    name: str
    text: str
    model: CompiledModel = field(repr=False)
    reading: Reading
    nominal: Mapping[str, float]
    units: Mapping[str, str]
    limits: Mapping[str, tuple[float, float]]
    mass: float
    inputs: tuple[FurtherInput, ...] = ()

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a fit may move."""
        return tuple(self.nominal)

    def forces(self, recordings: Sequence[Recording], values: Mapping[str, float]) -> list[Array]:
        """R [N] along the motion of each recording, shape (n,) each. Raises NumericalError."""
        return [self._follow(recording, values, ())["R"] for recording in recordings]

    def settings(self, recording: Recording) -> dict[str, float]:
        """The mass of a recording, by the name of its parameter."""
        return {self.reading.mass: own_mass(recording, self.mass)} if self.reading.mass else {}

    def beside(self, recordings: Sequence[Recording], inputs: Sequence[FurtherInput]) -> Law:
        """The law with inputs that recordings have. Raises UsageError for a mass that it cannot have."""
        for recording in recordings if self.reading.inner else ():
            if not np.isclose(mass := own_mass(recording, self.mass), self.reading.inner, rtol=_SAME_MASS, atol=0):
                raise UsageError(
                    f"--model {self.name}: its mass is {self.reading.inner:.6g} kg, which follows from its equations, "
                    f"and that of {recording.name} is {mass:g} kg: correct it, or make the mass one parameter"
                )
        known = {v.name: v.unit for v in self.model.code.variables if v.causality == "input"}
        shared = tuple(port for port in inputs if port.name in known)
        for port in shared:
            unit = known[port.name]
            if unit and exponents(unit) != exponents(port.unit):
                raise UsageError(
                    f"--model {self.name}: its input {port.name} is in {unit}, and that of the recordings in "
                    f"{port.unit}: declare it in {port.unit}"
                )
        return replace(self, inputs=shared)

    def notes(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Sentences on inputs that nobody recorded, and on parameters that the fit has left on a limit of the class."""
        recorded = {"F", *(port.name for port in self.inputs)}
        others = [v for v in self.model.code.variables if v.causality == "input" and v.name not in recorded]
        return (
            *(f"{self.name}: {v.name} stays at {v.start or 0:g} {v.unit}, as no --input names it" for v in others),
            *(
                f"{self.name}: {name} = {value:.4g} {self.units[name]} lies on the limit of the class"
                for name, value in values.items()
                if value in self.limits[name] or np.isclose(value, self.limits[name], rtol=1e-6, atol=0).any()
            ),
        )

    def fit(
        self, recordings: Sequence[Recording], forces: Sequence[Array], weights: Sequence[Array], seed: int
    ) -> dict[str, float]:
        """Parameters of least squares of weight (force - R) over all recordings; forces, weights: shape (n,) each.

        From the values of the class and from others beside them, drawn with the seed; the best is followed to the end.
        """
        problem = _Problem(self, recordings, forces, weights)
        rng = np.random.default_rng(seed)
        given = np.array([*self._begin(recordings, forces).values()])
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
        motion = self.reading.motion(recording.channel("x"), recording.channel("v"))
        name, inputs = self.reading.asked(len(recording))
        inputs, settings = inputs | columns_of(recording, self.inputs), {**values, **self.settings(recording)}
        found = self.model.clamp(
            motion, inputs, recording.dt, parameters=settings, outputs=(name,), sensitivities=sensitivities
        )
        factor = self.reading.factor(settings)
        return {key.replace(f"d {name}/", "d R/") if key != name else "R": factor * u for key, u in found.items()}

    def _begin(self, recordings: Sequence[Recording], forces: Sequence[Array]) -> dict[str, float]:
        """Where a fit begins: at the values of the class, of one of the library at its size in the recordings."""
        if not is_of_the_library(self.name):
            return dict(self.nominal)
        x, v = (np.concatenate([recording.channel(name) for recording in recordings]) for name in ("x", "v"))
        sizes = sizes_of((x, v, np.zeros_like(x)), np.concatenate(forces), 0.0, inertial=False)
        return {**self.nominal, **{k: u for k, u in scaled(self.model.code, {}, sizes).items() if k in self.nominal}}


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


def law_of(model: str, mass: float) -> Law:
    """The rig that a class of the library ("HystId.Oscillators.Jenkins") or a file ("rig.mo:Rig") is.

    A file alone stands for its only model, or for the class Extended, and a folder for what ``diagnose`` wrote there.
    mass [kg]: 0 leaves that of the class. Raises UsageError where it is no rig, ModelicaError for other errors in it.
    """
    named = with_class(model)
    if is_fmu(named):
        raise UsageError(f"--model {model}: physics is fitted and written with the networks: give its Modelica class")
    compiled = CompiledModel(compile_model(named))
    reading = reading_of(named, compiled, {})
    check_starts(named, compiled.code)
    free = {v.name: v for v in real_parameters(compiled.code) if v.name not in reading.heavy}
    own = reading.inner or (compiled.code.variable(reading.mass).start if reading.mass else 0.0)
    path, _, name = named.rpartition(":")
    return Law(
        name,
        text_of(Path(path), UsageError) if path else "",
        compiled,
        reading,
        {key: float(v.start or 0.0) for key, v in free.items()},
        {key: v.unit for key, v in free.items()},
        {key: v.limits for key, v in free.items()},
        mass or float(own or 0.0),
    )
