"""The baseline on a measured motion: its restoring force, its hysteretic force, and how they depend on its
parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np

from hystid.compiled import CompiledModel, Motion
from hystid.diagnosis.model.adapters import Model, Reading, own_mass, reading_of
from hystid.errors import NumericalError, UsageError
from hystid.modelcode import ModelCode, Variable
from hystid.modelica_text import array_of
from hystid.numeric import Array

_MASS = "m"


@dataclass(frozen=True)
class Held:
    """A motion x [m], v [m/s] of shape (n,) that the states of a law are held to; dt [s].

    ready: the same as a compiled model takes it; None where the law is read in another way.
    """

    x: Array = field(repr=False)
    v: Array = field(repr=False)
    dt: float
    ready: Motion | None = field(repr=False, default=None)


@dataclass(frozen=True)
class Baseline:
    """An oscillator m a + R = F with states x and v clamped to the measured motion.

    nominal: parameter values as given. free: names that the refit may move. linear: those in which R is linear.
    units: parameter name -> unit. has_h: the model has a hysteretic force f_h that is not zero.
    reading: where R and the mass stand in the model. inner_mass: mass of a model without a parameter for it [kg].
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
    reading: Reading = field(default=Reading("R", "", _MASS))
    inner_mass: float = 0.0
    stated: frozenset[str] = frozenset()

    @property
    def mass(self) -> float:
        """Nominal mass [kg]; 0 for rigs without inertia."""
        return float(self.nominal.get(_MASS, 0.0))

    @property
    def memoryless(self) -> bool:
        """Whether R follows from x and v alone."""
        return set(self.model.code.states) <= {"x", "v"}

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
        """A motion made ready for many evaluations of the law."""
        compiled = self.model if isinstance(self.model, CompiledModel) and self.reading.force else None
        return Held(x, v, dt, compiled.motion({"x": x, "v": v}, {}, dt) if compiled else None)

    def forces(self, motions: Sequence[Held], values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """``force`` along several motions at once, which costs half where the law has inner states."""
        return self.forces_at(motions, [values])[0]

    def forces_at(
        self, motions: Sequence[Held], each: Sequence[Mapping[str, float]]
    ) -> list[list[tuple[Array, Array]]]:
        """``forces`` at each of several values of the parameters, in one run."""
        ready = [m.ready for m in motions if m.ready is not None]
        if len(ready) < len(motions) or not isinstance(self.model, CompiledModel):
            return [[self.force(m.x, m.v, m.dt, values) for m in motions] for values in each]
        names = ("R", "f_h") if self.has_h else ("R",)
        settings = [known for known in map(self.settings, each) for _ in ready]
        found = self.model.follow(ready * len(each), settings, names)
        pairs = [(out["R"], out["f_h"] if self.has_h else np.zeros_like(out["R"])) for out in found]
        return [pairs[i : i + len(ready)] for i in range(0, len(pairs), len(ready))]

    def force(self, x: Array, v: Array, dt: float, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Restoring force R and hysteretic force h [N] along a motion, shape (n,) each."""
        settings = self.settings(values)
        if not self.reading.force:
            rate = self.reading.acceleration
            found = self.model.clamp(
                {"x": x, "v": v}, {"F": np.zeros_like(x)}, dt, parameters=settings, outputs=(rate,)
            )
            inertia = self.inner_mass or settings[self.reading.mass]
            return -inertia * found[rate], np.zeros_like(x)
        names = ("R", "f_h") if self.has_h else ("R",)
        found = self.model.clamp({"x": x, "v": v}, {}, dt, parameters=settings, outputs=names)
        return found["R"], found["f_h"] if self.has_h else np.zeros_like(x)

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
    reading = reading_of(name, code)
    inner = 0.0 if reading.force or reading.mass else own_mass(name, compiled, reading)
    parameters = {_MASS if v.name == reading.mass else v.name: v for v in real_parameters(code)}
    given = {_MASS if key == reading.mass else key: value for key, value in given.items()}
    _check_names(name, given, [*parameters, *([_MASS] if inner else [])])
    lowest = {key: float(variable.min) for key, variable in parameters.items() if variable.min is not None}
    highest = {key: float(variable.max) for key, variable in parameters.items() if variable.max is not None}
    for key, value in given.items():
        low, high = lowest.get(key, -np.inf), highest.get(key, np.inf)
        if not low <= value <= high:
            raise UsageError(f"{name}: parameter {key} = {value:g} is outside its range [{low:g}, {high:g}]")
    nominal = {
        key: min(max(float(given.get(key, variable.start or 0.0)), lowest.get(key, -np.inf)), highest.get(key, np.inf))
        for key, variable in parameters.items()
    }
    if inner:
        nominal[_MASS] = float(given.get(_MASS, inner))
    if model is None and nominal.get(_MASS):
        _check_start(name, compiled.code)
    still = bool(inner) or weighed or nominal.get(_MASS, 0.0) == 0.0
    held = fixed | ({_MASS} if still else frozenset())
    free = tuple(key for key in nominal if key not in held)
    bare = Baseline(
        name, compiled, nominal, free, (), {key: v.unit for key, v in parameters.items()},
        frozenset(key for key, v in parameters.items() if _is_positive(v, nominal[key])),
        "f_h" in {v.name for v in code.variables}, lowest, highest, weighed or bool(inner), reading, inner,
    )  # fmt: skip
    bare = replace(bare, has_h=bare.has_h and _has_hysteresis(bare, length))
    linear = tuple(key for key in free if key != _MASS and _is_linear(bare, key, length))
    return replace(bare, linear=linear)


def real_parameters(code: ModelCode) -> list[Variable]:
    """What a fit may move: start values and sizes of arrays are not among them."""
    real = [v for v in code.variables if v.causality == "parameter" and v.type == "Real"]
    return [v for v in real if not _is_start(v.name, code.states)]


def _is_start(name: str, states: Sequence[str]) -> bool:
    """Whether a parameter says where a state begins: "x_start", also of a component; "k_start" is a stiffness."""
    whole = array_of(name)
    begins = whole.removesuffix("_start")
    return begins != whole and (begins in map(array_of, states) or begins.rpartition(".")[2] in ("x", "v"))


def _check_names(name: str, given: Iterable[str], parameters: Iterable[str]) -> None:
    known = sorted(parameters)
    for key in sorted(set(given) - set(known)):
        near = get_close_matches(key, known, 1, 0.5) or [k for k in known if k.lower() == key.lower()]
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        raise UsageError(f"{name} has no parameter '{key}'{hint}; it has {', '.join(known)}")


def _check_start(name: str, code: ModelCode) -> None:
    """Free runs begin where a recording does: refuses a model that computes where it begins from something else."""
    known = {v.name: v for v in code.variables}
    for state in ("x", "v"):
        if known[state].initial == "calculated" and f"{state}_start" not in known:
            raise UsageError(
                f"{name}: the start of {state} is computed, so that no recording can set it: write "
                f"{state}(start = {state}_start, fixed = true), with the parameter {state}_start"
            )


def _is_positive(variable: Variable, value: float) -> bool:
    return value > 0 and (variable.min is None or variable.min >= 0)


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
