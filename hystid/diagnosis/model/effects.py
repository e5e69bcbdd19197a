"""Candidate effects: Modelica blocks, and what a fit must know of their parameters.

Nothing about an effect is written here. Of its parameters, those in which f is linear are amplitudes (found by a
numeric test); the others are shapes, whose range follows from the unit and the recordings. What cannot be computed
the block declares (``semantics``). A new effect is a new ``.mo`` file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from types import MappingProxyType

import numpy as np

from hystid.compiled import CompiledModel, Interpolation, Motion
from hystid.diagnosis.model.semantics import Semantics
from hystid.errors import NumericalError, UsageError
from hystid.modelcode import ModelCode, Variable
from hystid.numeric import Array

_INPUTS = frozenset("xvah")
_SUBSTEPS = 24  # most steps per sample: a memory shorter than a 24th of the path per sample is friction without memory
_TURNS = 0.5  # radians per step of an inner state: Runge and Kutta's method is off by 0.5**5 / 120 in each
_SHORT = (0.003, 0.012)  # shares of the stroke over which friction may build up, below those of its distribution
# Resonances are sought from the lower of these shares: of the lowest, and of the highest frequency that is excited,
_BELOW = (0.7, 0.35)
_SLOWEST = 0.1  # but not below this share of the highest
_ASIDE = 1 / 3  # of the range on either side, from where shapes that may have either sign begin too
_ACROSS = 13  # starts over the range of such shapes, in fine steps
_STARTS_APART = 0.08  # relative distance of such starts: a resonance is 0.1 wide at the damping ratio that is tried
_LEAD = (0.01, 0.05, 0.2, 1.0)  # of the time in which the quickest motion turns by a radian: least time, and starts
_MOST_CHOICES = 20  # values of an Integer parameter: each is a grid of its own, which costs a scan
_PROBE = 2001  # samples of the signal on which linearity is tested


@dataclass(frozen=True)
class Signals:
    """What an effect sees in one recording: x, v, a, h, shape (n,) each, SI units; dt [s]; number of the recording.

    ready: the same, h apart, as compiled models have taken it already.
    """

    x: Array
    v: Array
    a: Array
    h: Array
    dt: float
    index: int = 0
    ready: dict[tuple[CompiledModel, int], Motion] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def path(self) -> float:
        """Longest way between two samples [m]."""
        return float(np.max(np.abs(self.v))) * self.dt


@dataclass(frozen=True)
class Scales:
    """Sizes that occur in the recordings, from which shape parameters take their ranges.

    x, v: sorted absolute displacements and speeds; h: sorted absolute force; span: longest recording [s]; dt [s];
    band: lowest and highest frequency of the motion [Hz]; path: longest travelled path [m].
    """

    x: Array
    v: Array
    h: Array
    span: float
    dt: float
    band: tuple[float, float]
    path: float

    @property
    def quickest(self) -> float:
        """Time in which the quickest motion turns by a radian [s]."""
        return 1 / (2 * np.pi * self.band[1])


@dataclass(frozen=True)
class Effect:
    """One form of one candidate effect.

    id: snake case, form: "" or what follows the double underscore. amplitudes: names in which f is linear. shapes: the
    other continuous parameters. choices: integer parameters and their values. lowest, highest: least and largest
    values that the block allows. remembers: has inner states. uses_h: depends on the hysteretic force; per_h: in
    proportion, at each sample.
    semantics: what the block declares of itself.
    """

    id: str
    form: str
    class_name: str
    model: CompiledModel | None = field(repr=False)
    amplitudes: tuple[str, ...] = ()
    shapes: tuple[Variable, ...] = ()
    choices: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    lowest: Mapping[str, float] = field(default_factory=dict)
    highest: Mapping[str, float] = field(default_factory=dict)
    remembers: bool = False
    uses_h: bool = False
    per_h: bool = False
    semantics: Semantics = field(default=Semantics(), repr=False)

    @property
    def size(self) -> int:
        """Number of parameters that a fit moves or chooses."""
        return len(self.amplitudes) + len(self.shapes) + len(self.choices)

    @cached_property
    def reads(self) -> frozenset[str]:
        """Inputs that the force depends on, by its equations; all that occur in any of them where the block has
        events."""
        if self.model is None:
            return _INPUTS
        if self.model.code.n_indicators or self.model.code.has_memory:
            return _INPUTS - {*self.model.code.unread}
        known = self.model.code.dependencies
        found, new = set[str](), {"f"}
        while new:
            found |= new
            new = {name for item in new for name in known.get(item, known.get(f"der({item})", ()))} - found
        return _INPUTS & found

    @property
    def turns(self) -> bool:
        """Whether the force turns at once with the sign of the velocity, over a transition that the block declares."""
        return bool(self.semantics.transition) and not self.remembers and not self.uses_h

    @property
    def needs_clock(self) -> bool:
        """Whether the force depends on the time itself: where time only numbers the samples, such a law means nothing.

        A law that reads rates is another matter: they have no scale there, but their sign holds."""
        known = self.model.code.dependencies if self.model is not None else {}
        return any("time" in names for names in known.values())

    @property
    def is_over_time(self) -> bool:
        """Whether the law changes along with the time, or the path: it is never windowed."""
        return self.semantics.lasting

    def is_path(self, shape: Variable) -> bool:
        """Whether a shape is a travelled path, not a displacement."""
        return shape.name == self.semantics.path

    def bounds(self, shape: Variable, scales: Scales) -> tuple[float, float]:
        """Range in which a shape can be told from its limits, given the recordings."""
        if self.is_path(shape):
            return 0.02 * scales.path, 3.0 * scales.path
        if self._is_lead(shape):
            return _LEAD[0] * scales.quickest, 1 / (2 * np.pi * scales.band[0])
        low, high = shape_bounds(shape, scales)
        if self.needs_clock and shape.unit == "s" and shape in self.law.shapes:
            low = min(max(low, 1 / scales.band[0]), high)  # what is over in a period is how a recording begins
        return low, high

    def _is_lead(self, shape: Variable) -> bool:
        """Whether a shape is a time in a law without memory: it weighs the velocity against the displacement."""
        own = shape.unit == "s" and shape in self.law.shapes  # and no time of a window
        return own and not self.remembers and not self.needs_clock

    def _starts(self, shape: Variable, scales: Scales, *, fine: bool) -> Array:
        if self.is_path(shape):
            return np.geomspace(0.1, 1.0, 3) * scales.path
        if self._is_lead(shape):
            return np.array(_LEAD[1:]) * scales.quickest
        return np.unique(np.clip(shape_values(shape, scales, fine=fine), *self.bounds(shape, scales)))

    @property
    def lasts(self) -> bool:
        """Whether the force follows from the motion alone: the same at a grid point in every scan."""
        return "h" not in self.reads

    @property
    def law(self) -> Effect:
        """What costs an evaluation of a block: the effect itself, but for one that is switched on and off."""
        return self

    def law_values(self, parameters: Mapping[str, float]) -> Mapping[str, float]:
        """Parameters of ``law``."""
        return parameters

    def switched(
        self, forces: Sequence[Array], signals: Sequence[Signals], parameters: Mapping[str, float]
    ) -> Sequence[Array]:
        """Forces of the effect from those of its law."""
        return forces

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """Force f [N] over one recording, shape (n,)."""
        return self.forces([signals], parameters)[0]

    def forces(self, signals: Sequence[Signals], parameters: Mapping[str, float]) -> list[Array]:
        """``force`` over several recordings at once, which costs half."""
        if self.model is None:
            return [self.force(s, parameters) for s in signals]
        motions = [self._motion(self.model, s, self._substeps(s, parameters)) for s in signals]
        return [found["f"] for found in self.model.follow(motions, parameters, ("f",))]

    @property
    def meanings(self) -> dict[str, str]:
        """What each parameter is, as the block says."""
        return {v.name: v.description for v in self.model.code.variables} if self.model is not None else {}

    def is_possible(self, parameters: Mapping[str, float]) -> bool:
        """Whether such parameters may be those of what the effect stands for."""
        return True

    def of_noise(self, level: float, parameters: Mapping[str, float], like: Signals) -> Array:
        """Standard deviation of what white noise of a level [N] on the force channel does through the effect [N],
        shape (n,): nothing, but for faults of that channel."""
        return np.zeros(len(like.x))

    def forces_at(self, signals: Sequence[Signals], each: Sequence[Mapping[str, float]]) -> list[list[Array]]:
        """``forces`` at each of several values of the parameters, in one run; NaN where they have no finite answer."""
        if self.model is None:
            return [self.forces(signals, at) for at in each]
        motions = [self._motion(self.model, s, self._substeps(s, at)) for at in each for s in signals]
        try:
            found = self.model.follow(motions, [at for at in each for _ in signals], ("f",))
        except NumericalError:
            if len(each) == 1:
                return [[np.full_like(s.x, np.nan) for s in signals]]
            return [forces for at in each for forces in self.forces_at(signals, [at])]
        flat = [outputs["f"] for outputs in found]
        return [flat[i : i + len(signals)] for i in range(0, len(flat), len(signals))]

    def _motion(self, model: CompiledModel, signals: Signals, substeps: int) -> Motion:
        """What the block reads of one recording."""
        known = signals.ready.get((model, substeps))
        if known is None:
            inputs = {name: getattr(signals, name) for name in sorted(self.reads) or ["x"]}
            between: Interpolation = "cubic" if self.remembers else "linear"  # without a memory only samples count
            known = model.motion({}, inputs, signals.dt, interpolation=between, substeps=substeps)
            if "h" not in inputs:
                signals.ready[model, substeps] = known
        return known

    @cached_property
    def _steep(self) -> dict[str, str]:
        """Units of the shapes on which the derivatives of inner states depend."""
        known = self.model.code.dependencies if self.model is not None else {}
        steep = {name for item, names in known.items() if item.startswith("der(") for name in names}
        return {shape.name: shape.unit for shape in self.shapes if shape.name in steep}

    def _substeps(self, signals: Signals, parameters: Mapping[str, float]) -> int:
        """Steps per sample with which a memory over a short path or time stays stable, and a resonance."""
        known = [(parameters.get(name, 0.0), unit) for name, unit in self._steep.items()]
        steps = [signals.path / size for size, unit in known if unit == "m" and size > 0]
        steps += [signals.dt / size / _TURNS for size, unit in known if unit == "s" and size > 0]
        steps += [2 * np.pi * size * signals.dt / _TURNS for size, unit in known if unit == "Hz"]
        return int(np.clip(np.ceil(max(steps, default=1.0)), 1, _SUBSTEPS))

    def units_at(self, shapes: Mapping[str, float]) -> list[dict[str, float]]:
        """Parameters with one of the amplitudes at 1 and the others at 0, for each in turn."""
        zero = dict.fromkeys(self.amplitudes, 0.0)
        return [{**shapes, **zero, name: 1.0} for name in self.amplitudes]

    def grid(self, scales: Scales, near: Mapping[str, float] = MappingProxyType({})) -> list[dict[str, float]]:
        """Starting points for the shapes and choices: the first shape in fine steps, the others coarsely.

        near: values of shapes and choices, by name, that are known; the first other shape is in fine steps then."""
        open_ = [shape for shape in self.shapes if shape.name not in near]
        axes = {shape.name: self._starts(shape, scales, fine=shape is open_[0]) for shape in open_}
        for shape in open_[:1]:
            if (
                self.remembers and shape.unit == "m" and not self.is_path(shape)
            ):  # memories are often far below the stroke
                axes[shape.name] = np.concatenate([np.array(_SHORT) * scales.x[-1], axes[shape.name]])
        values: dict[str, Sequence[float]] = {name: list(map(float, axis)) for name, axis in axes.items()}
        values |= {name: list(map(float, choice)) for name, choice in self.choices.items()}
        values |= {
            name: [near[name]] for name in (*(shape.name for shape in self.shapes), *self.choices) if name in near
        }
        return [dict(zip(values, map(float, point), strict=True)) for point in product(*values.values())]


def effect_id(class_name: str) -> tuple[str, str]:
    """Id and form of a block: ``MyLaw__Hertz`` -> ("my_law", "Hertz")."""
    name, _, form = class_name.rpartition(":")[2].rpartition(".")[2].partition("__")
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(), form


def effect_of(class_name: str, code: ModelCode) -> Effect:
    """Classify the parameters of a compiled block. Raises UsageError when the block is not an effect."""
    inputs = {variable.name for variable in code.variables if variable.causality == "input"}
    if not any(variable.name == "f" and variable.causality == "output" for variable in code.variables):
        raise UsageError(f"{class_name}: an effect has an output f [N]; extend HystId.Interfaces.PartialEffect")
    if inputs - {"x", "v", "a", "h"}:
        raise UsageError(f"{class_name}: an effect has the inputs x, v, a, h; it has {', '.join(sorted(inputs))}")
    ident, form = effect_id(class_name)
    parameters = [variable for variable in code.variables if variable.causality == "parameter"]
    wide = [v.name for v in parameters if v.type == "Integer" and _values(v) > _MOST_CHOICES]
    if wide:
        raise UsageError(
            f"{class_name}: {wide[0]}, an Integer, is tried at each value between its min and max, at most "
            f"{_MOST_CHOICES} of them: set them closer, leave one out to keep its value, or make it Real"
        )
    choices = {
        variable.name: tuple(range(int(variable.min), int(variable.max) + 1))
        for variable in parameters
        if variable.type == "Integer" and variable.min is not None and variable.max is not None
    }
    reals = [variable for variable in parameters if variable.type == "Real"]
    bare = Effect(ident, form, class_name, CompiledModel(code))
    linear = _linear(bare, [variable.name for variable in reals], {v.name: float(v.start or 0.0) for v in parameters})
    try:
        reads = _reads_h(bare, linear), _is_per_h(bare, linear)
    except NumericalError as failed:
        raise UsageError(
            f"{class_name}: with its own values f is not finite along a motion of some millimetres ({failed}); let f "
            "have a value for every motion"
        ) from failed
    return Effect(
        ident, form, class_name, bare.model, linear,
        tuple(variable for variable in reals if variable.name not in linear), choices,
        {variable.name: variable.unit for variable in parameters},
        {variable.name: float(variable.min) for variable in reals if variable.min is not None},
        {variable.name: float(variable.max) for variable in reals if variable.max is not None}, bool(code.states),
        *reads,
    )  # fmt: skip


def _values(variable: Variable) -> float:
    """Number of values of an Integer that are tried."""
    return variable.max - variable.min + 1 if variable.min is not None and variable.max is not None else 0


def _probe() -> Signals:
    """A motion with several frequencies, turning points and a hysteretic force."""
    t = np.linspace(0.0, 1.0, _PROBE)
    x = 2.5e-3 * np.sin(5 * t) + 1e-4 * np.cos(37 * t) - 1e-4
    v = np.gradient(x, t)
    return Signals(x, v, np.gradient(v, t), 3.0 * np.tanh(400 * v) + 5000 * x, float(t[1] - t[0]))


def _linear(effect: Effect, names: Sequence[str], start: Mapping[str, float]) -> tuple[str, ...]:
    """The largest set of parameters, taken greedily, in which f is jointly linear (and zero at zero)."""
    signals = _probe()
    chosen: list[str] = []
    for name in names:
        trial = [*chosen, name]
        try:
            linear = _is_linear(effect, signals, trial, start)
        except NumericalError:  # a width of zero, for example
            continue
        chosen = trial if linear else chosen
    return tuple(chosen)


def _is_linear(effect: Effect, signals: Signals, trial: Sequence[str], start: Mapping[str, float]) -> bool:
    base = {**start, **dict.fromkeys(trial, 0.0)}
    alone = [effect.force(signals, {**base, item: 1.0 + 0.5 * i}) for i, item in enumerate(trial)]
    together = effect.force(signals, {**base, **{item: 2.0 + i for i, item in enumerate(trial)}})
    size = float(np.max(np.abs(together)))
    nothing = float(np.max(np.abs(effect.force(signals, base))))
    return size > 0.0 and nothing <= 1e-9 * size and np.allclose(together, 2 * np.sum(alone, axis=0), atol=1e-9 * size)


def _reads_h(effect: Effect, linear: Sequence[str]) -> bool:
    signals = _probe()
    other = Signals(signals.x, signals.v, signals.a, 0.5 * signals.h + 1.0, signals.dt)
    ones = dict.fromkeys(linear, 1.0)
    return not np.array_equal(effect.force(signals, ones), effect.force(other, ones))


def _is_per_h(effect: Effect, linear: Sequence[str]) -> bool:
    signals, ones = _probe(), dict.fromkeys(linear, 1.0)
    found = effect.force(signals, ones)
    unit = effect.force(replace(signals, h=np.ones_like(signals.h)), ones)
    return np.allclose(found, signals.h * unit, rtol=0, atol=1e-9 * float(np.max(np.abs(found))))


# Of the peak speed: one sample in ten thousand of a sine is slower. Friction that may turn no quicker than a thousandth
# gets help from laws that fall with speed, and takes their name.
_SMALLEST = {"m/s": 1e-4}


def shape_bounds(shape: Variable, scales: Scales) -> tuple[float, float]:
    """Range in which a shape can be told from its limits, given the recordings."""
    tops = {"m": scales.x[-1], "m/s": scales.v[-1], "N": scales.h[-1], "J": 3 * scales.h[-1] * scales.path}
    if shape.unit in tops:
        return _SMALLEST.get(shape.unit, 1e-3) * float(tops[shape.unit]), 1.5 * float(tops[shape.unit])
    if shape.unit == "s":
        return min(2.0 * scales.dt, 0.5 * scales.quickest), 5.0 * scales.span
    if shape.unit == "Hz":
        return 0.5 * scales.band[0], 2.0 * scales.band[1]
    low = shape.min if shape.min is not None else 0.0
    high = shape.max if shape.max is not None else 10.0 * max(abs(shape.start or 0.0), 1.0)
    return float(low), float(high)


def shape_values(shape: Variable, scales: Scales, *, fine: bool) -> Array:
    """Starting values for one shape, by its unit."""
    low, high = shape_bounds(shape, scales)
    if shape.unit == "m":
        shares = (0.05, 0.15, 0.35, 0.55, 0.75, 0.88, 0.95, 0.985) if fine else (0.05, 0.3, 0.8)
        return np.array([scales.x[int(share * (len(scales.x) - 1))] for share in shares])
    if shape.unit == "m/s":
        speeds = (0.01, 0.03, 0.1, 0.3, 0.8) if fine else (0.01, 0.06, 0.3)
        return np.asarray(np.array(speeds) * scales.v[int(0.8 * (len(scales.v) - 1))])
    if shape.unit == "N":
        return np.quantile(scales.h, (0.3, 0.6, 0.85))
    if shape.unit == "J":
        return np.geomspace(0.02, 0.5, 3) * high / 3
    if shape.unit == "s":
        return np.geomspace(max(min(4 * scales.dt, scales.quickest), 0.02 / scales.band[1]), scales.span / 2, 8)
    if shape.unit == "Hz":
        slow = min(_BELOW[0] * scales.band[0], _BELOW[1] * scales.band[1])
        first, last = max(low, slow, _SLOWEST * scales.band[1]), 0.85 * high
        return np.geomspace(first, last, int(np.log(last / first) / _STARTS_APART) + 2 if fine else 6)
    start = shape.start if shape.start is not None else 0.5 * (low + high)
    if low < 0 < high:  # of either sign: what is even at 0 says nothing of what it is beside it
        aside = np.linspace(-1, 1, _ACROSS) if fine else np.array([-_ASIDE, _ASIDE])
        return np.unique([np.clip(start, low, high), *(aside * np.where(aside < 0, -low, high))])
    return np.unique(np.clip([start, *((0.3 * low + 0.7 * high,) if fine else ())], low, high))
