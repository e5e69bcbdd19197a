"""The baseline on a measured motion: its restoring force, its hysteretic force, and how they depend on its
parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hystid.compiled import CompiledModel, Motion
from hystid.diagnosis.model.fading import fading_states, fast_samples, steps_for
from hystid.errors import NumericalError
from hystid.modelcode import ModelCode
from hystid.numeric import Array
from hystid.rig.terms import Model, Reading, check_starts, check_values, reading_of, real_parameters

_MASS = "m"


@dataclass(frozen=True)
class Held:
    """A motion x [m], v [m/s] of shape (n,) that the states of a law are held to; dt [s].

    ready: the same as a compiled model takes it, by its steps per sample.
    """

    x: Array = field(repr=False)
    v: Array = field(repr=False)
    dt: float
    ready: dict[int, Motion] = field(repr=False, default_factory=dict)

    @cached_property
    def fast(self) -> tuple[Array, Array, float]:
        """Some samples, where the motion is fast."""
        some = fast_samples(self.v)
        return self.x[some], self.v[some], self.dt


@dataclass(frozen=True)
class Baseline:
    """An oscillator m a + R = F with states x and v clamped to the measured motion.

    nominal: parameter values as given. free: names that the refit may move. linear: those in which R is linear.
    units: parameter name -> unit. has_h: the model has a hysteretic force f_h that is not zero.
    reading: where R and the mass stand in the model.
    lowest, highest: values that the model allows. weighed: the mass may be off by what weighing and sensors leave.
    stated: names of the parameters that somebody has given; the others begin at what the recordings suggest.
    """

    name: str
    model: Model = field(repr=False)
    nominal: Mapping[str, float]
    free: tuple[str, ...]
    linear: tuple[str, ...]
    units: Mapping[str, str]
    positive: frozenset[str]
    has_h: bool
    lowest: Mapping[str, float] = field(default_factory=dict)
    highest: Mapping[str, float] = field(default_factory=dict)
    weighed: bool = True
    reading: Reading = field(default=Reading(("x", "v"), "R", "", _MASS))
    stated: frozenset[str] = frozenset()

    @property
    def mass(self) -> float:
        """Nominal mass [kg]; 0 for rigs without inertia."""
        return float(self.nominal.get(_MASS, 0.0))

    @property
    def memoryless(self) -> bool:
        """Whether R follows from x and v alone."""
        return set(self.model.code.states) <= {*self.reading.states}

    def reads_x(self) -> bool:
        """Whether the law depends on the displacement, wherever its free parameters go; one with memory does."""
        if not self.memoryless:
            return True
        _, x, v = _probe(1e-3)
        for factor, lift in ((1.0, 0.0), (1.3, 0.1)):
            values = {k: u * factor + (lift if k in self.free else 0.0) for k, u in self.nominal.items()}
            values |= {k: u for k, u in self.nominal.items() if k not in self.free}
            try:
                there, here = (self.force(at, v, 1e-3, values)[0] for at in (x, np.zeros_like(x)))
            except NumericalError:
                return True
            if not np.allclose(there, here, rtol=0, atol=1e-9 * float(np.max(np.abs(here))) + 1e-300):
                return True
        return False

    @property
    def shapes(self) -> tuple[str, ...]:
        """Free parameters in which R is not linear."""
        return tuple(name for name in self.free if name not in self.linear and name != _MASS)

    def held(self, x: Array, v: Array, dt: float) -> Held:
        """A motion for many evaluations of the law."""
        return Held(x, v, dt)

    @cached_property
    def _fading(self) -> dict[str, str]:
        return fading_states(self.model, self.reading, self.settings(self.nominal))

    def steps(self, motion: Held, settings: Mapping[str, float]) -> int:
        """Runge-Kutta steps per sample that the inner states need along a motion."""
        return steps_for(self.model, self.reading, self._fading, motion.fast, settings) if self._fading else 1

    def forces(self, motions: Sequence[Held], values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """``force`` along several motions at once, which costs half where the law has inner states."""
        return self.forces_at(motions, [values])[0]

    def forces_at(
        self, motions: Sequence[Held], each: Sequence[Mapping[str, float]]
    ) -> list[list[tuple[Array, Array]]]:
        """``forces`` at each of several values of the parameters, in one run."""
        if not isinstance(self.model, CompiledModel):
            return [[self.force(m.x, m.v, m.dt, values) for m in motions] for values in each]
        settings = [known for known in map(self.settings, each) for _ in motions]
        ready = [self._ready(self.model, m, known) for m, known in zip([*motions] * len(each), settings, strict=True)]
        found = self.model.follow(ready, settings, self._asked())
        pairs = [self._forces(out, known) for out, known in zip(found, settings, strict=True)]
        return [pairs[i : i + len(motions)] for i in range(0, len(pairs), len(motions))]

    def _ready(self, model: CompiledModel, motion: Held, settings: Mapping[str, float]) -> Motion:
        """A motion as the model takes it, in the steps that it needs there."""
        steps = self.steps(motion, settings)
        if steps not in motion.ready:
            states, (_, inputs) = self.reading.motion(motion.x, motion.v), self.reading.asked(len(motion.x))
            motion.ready[steps] = model.motion(states, inputs, motion.dt, substeps=steps)
        return motion.ready[steps]

    def force(self, x: Array, v: Array, dt: float, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Restoring force R and hysteretic force h [N] along a motion, shape (n,) each."""
        settings, (_, inputs) = self.settings(values), self.reading.asked(len(x))
        motion, steps = self.reading.motion(x, v), self.steps(self.held(x, v, dt), settings)
        found = self.model.clamp(motion, inputs, dt, parameters=settings, outputs=self._asked(), substeps=steps)
        return self._forces(found, settings)

    def _asked(self) -> tuple[str, ...]:
        name, _ = self.reading.asked(0)
        return (name, "f_h") if self.has_h else (name,)

    def _forces(self, found: Mapping[str, Array], settings: Mapping[str, float]) -> tuple[Array, Array]:
        name, _ = self.reading.asked(0)
        R = self.reading.factor(settings) * found[name]
        return R, found["f_h"] if self.has_h else np.zeros_like(R)

    def settings(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values under the model's own names; without inertia the model's own acceleration means nothing."""
        found = {name: value for name, value in values.items() if name != _MASS}
        if _MASS in values and self.reading.mass:
            found[self.reading.mass] = values[_MASS] or 1.0
        return found


def baseline_of(
    name: str,
    code: ModelCode,
    given: Mapping[str, float],
    fixed: frozenset[str] = frozenset(),
    *,
    weighed: bool = False,
    length: float = 1e-3,
    model: Model | None = None,
) -> Baseline:
    """Check that a compiled model is an oscillator and sort its parameters. Raises UsageError where it is not one.

    weighed: the mass is held, but for what weighing leaves.
    length: size of the displacement [m] at which linearity in a parameter is tested.
    model: what runs the code, where it is not to be compiled here (an FMU).
    """
    compiled: Model = CompiledModel(code) if model is None else model
    reading = reading_of(name, compiled, given)
    inner = reading.inner
    parameters = {_MASS if v.name == reading.mass else v.name: v for v in real_parameters(code)}
    given = {_MASS if key == reading.mass else key: value for key, value in given.items()}
    check_values(name, given, {**parameters, **({_MASS: None} if inner else {})})
    limits = {key: variable.limits for key, variable in parameters.items()}
    lowest, highest = ({key: pair[k] for key, pair in limits.items() if np.isfinite(pair[k])} for k in (0, 1))
    nominal = {
        key: float(np.clip(given.get(key, variable.start or 0.0), *limits[key])) for key, variable in parameters.items()
    }
    if inner:
        nominal[_MASS] = float(given.get(_MASS, inner))
    if model is None and nominal.get(_MASS):
        check_starts(name, compiled.code)
    still = bool(inner) or weighed or nominal.get(_MASS, 0.0) == 0.0
    held = fixed | ({_MASS} if still else frozenset()) | (reading.heavy - {reading.mass})
    free = tuple(key for key in nominal if key not in held)
    bare = Baseline(
        name, compiled, nominal, free, (), {key: v.unit for key, v in parameters.items()},
        frozenset(key for key, v in parameters.items() if nominal[key] > 0 and (v.min is None or v.min >= 0)),
        "f_h" in {v.name for v in code.variables}, lowest, highest, weighed or bool(inner), reading,
    )  # fmt: skip
    bare = replace(bare, has_h=bare.has_h and _has_hysteresis(bare, length))
    linear = tuple(key for key in free if key != _MASS and _is_linear(bare, key, length))
    return replace(bare, linear=linear)


def _probe(size: float) -> tuple[Array, Array, Array]:
    """Time, displacement [m] of a size, and velocity of a motion with several frequencies."""
    t = np.linspace(0.0, 1.0, 301)
    size = 0.6 * size  # the sum below reaches 1.7 of it
    x = size * np.sin(9 * t) * (0.4 + t) + 0.3 * size * np.cos(31 * t)
    return t, x, np.gradient(x, t)


def _has_hysteresis(baseline: Baseline, size: float) -> bool:
    t, x, v = _probe(size)
    try:
        return bool(np.any(baseline.force(x, v, t[1], baseline.nominal)[1]))
    except NumericalError:
        return True


def _is_linear(baseline: Baseline, key: str, size: float) -> bool:
    """Whether R changes with the parameter by the same column, wherever the parameters stand."""
    t, x, v = _probe(size)
    base = dict(baseline.nominal)
    moved = {name: value * 1.3 for name, value in base.items()}
    step = base[key] or 1.0

    def column(at: Mapping[str, float], factor: float) -> Array:
        high = baseline.force(x, v, t[1], {**at, key: at[key] + factor * step})[0]
        return (high - baseline.force(x, v, t[1], dict(at))[0]) / factor

    try:
        first = column(base, 1.0)
        scale = float(np.max(np.abs(first))) + 1e-300
        others = [column(at, factor) for at, factor in ((base, -0.5), (moved, 2.0))]
    except NumericalError:  # a law that has no answer beyond some value is not linear in it
        return False
    return all(np.allclose(other, first, atol=1e-7 * scale) for other in others)
