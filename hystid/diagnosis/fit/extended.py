"""The diagnosed model as readable Modelica: the baseline, extended by the named effects with their fitted values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Literal

from hystid.compiled import CompiledModel
from hystid.diagnosis.fit.hypothesis import Hypothesis, Term, is_source
from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.fit.windows import WINDOW, for_recording, window_names
from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.errors import UsageError
from hystid.files import text_of
from hystid.modelica import flat_model
from hystid.modelica.expr import Num
from hystid.modelica_text import EXTENDED, class_texts, compile_text, has_class, modifiers, with_class
from hystid.rig.terms import is_fmu
from hystid.rotation import turned_unit

_WINDOW = "Window"  # ending of the instance that lets an effect act for a part of the time


Kind = Literal["extends", "wraps", "fmu"]


@dataclass(frozen=True)
class Skeleton:
    """The baseline as the written model uses it.

    kind: "extends" a class with a place for effects, "wraps" any other class as a component whose force is F less the
    effects, "fmu": only the effects are written. mass: name of its parameter, "" where the mass is ``inner_mass`` [kg].
    text: the file of a user's class, so that the written file is complete in itself. has_h: it has hysteresis.
    turns: its units are those of a rig that turns.
    """

    name: str
    kind: Kind = "extends"
    mass: str = "m"
    inner_mass: float = 0.0
    text: str = ""
    has_h: bool = True
    turns: bool = False


def extensible(model: str) -> str:
    """A baseline with its class. Raises UsageError where the class that is written could not stand beside it."""
    named = with_class(model)
    file, _, _ = named.rpartition(":")
    if file.endswith(".mo") and Path(file).is_file() and has_class(text_of(Path(file), UsageError), EXTENDED):
        raise UsageError(f"{file}: {EXTENDED} is what this diagnosis writes as well: give that class another name")
    return named


def skeleton_of(baseline: Baseline) -> Skeleton:
    """What the written model is built around."""
    file, _, _ = baseline.name.rpartition(":")
    text = Path(file).read_text(encoding="utf-8") if file.endswith(".mo") else ""
    kind: Kind = "fmu" if is_fmu(baseline.name) else "extends" if _takes_effects(baseline.name) else "wraps"
    turns = baseline.model.code.variable("F").unit == "N.m"
    return Skeleton(baseline.name, kind, baseline.reading.mass, baseline.reading.inner, text, baseline.has_h, turns)


def _takes_effects(name: str) -> bool:
    """Whether a class has a place for further forces, and nothing stands there yet: it would be overwritten."""
    return any(v.name == "f_effects" and v.binding == Num(0.0) for v in flat_model(name).variables)


def compiled_with(baseline: Skeleton, hypothesis: Hypothesis) -> CompiledModel | None:
    """The baseline with the effects of a hypothesis, whose parameters are ``settings_of``; None where it has none, or
    the baseline is a binary that cannot be extended."""
    terms = [t for t in for_recording(hypothesis).terms if not isinstance(t.effect, ChannelEffect)]
    if baseline.kind == "fmu" or not terms:
        return None
    refit, *laws = (
        {name: Value(float(value), nan, "") for name, value in values.items()}
        for values in (hypothesis.parameters(), *(term.values for term in terms))
    )
    text = extended_model(baseline, refit, list(zip(terms, laws, strict=True)), own=own_texts(terms))
    return CompiledModel(compile_text(text, EXTENDED))


def own_texts(terms: Iterable[Term]) -> dict[str, str]:
    """Texts of blocks that are not of the library, by class name: the file must be complete in itself."""
    places = [term.effect.class_name.rpartition(":") for term in terms]
    return {name: Path(file).read_text(encoding="utf-8") for file, _, name in places if file}


def extended_model(
    baseline: Skeleton,
    refit: Mapping[str, Value],
    terms: Sequence[tuple[Term, Mapping[str, Value]]],
    remarks: Sequence[str] = (),
    own: Mapping[str, str] | None = None,
) -> str:
    """Text of the Modelica class ``Extended``: the baseline as refitted, with the effects.

    refit: baseline parameters. terms: effects with their values and standard errors. remarks: sentences for the head,
    such as faults of the recording, which are no part of a model. own: texts of the user's blocks by class name.
    """
    names = _instance_names([term for term, _ in terms])
    forces = {name: _force(name, term) for name, (term, _) in zip(names, terms, strict=True)}
    sums = " + ".join(forces.values())
    head, ports, equations = _frame(baseline, refit, sums)
    lines = [*(f"// {remark}" for remark in remarks), f'model {EXTENDED} "{_title(baseline.name, terms)}"', *head]
    lines += [f"  // {name}: {_with_error(value)}" for name, value in refit.items()]
    for name, (term, values) in zip(names, terms, strict=True):
        times = window_names(term.effect)
        law = {key: value for key, value in values.items() if key not in times}
        lines += _instance(_class(term.effect.class_name), name, law)
        if times:
            lines += _instance(WINDOW, name + _WINDOW, {key: values[key] for key in times})
    sources = [] if baseline.has_h else [n for n, (t, _) in zip(names, terms, strict=True) if is_source(t.effect)]
    for name in names:
        hysteresis = " + ".join(forces[source] for source in sources) if name not in sources else ""
        equations += [
            f"  {name}.{port} = {hysteresis if port == 'h' and hysteresis else signal};" for port, signal in ports
        ]
    lines += ["equation", *equations] if equations else []
    texts = dict.fromkeys((baseline.text, *(own or {}).values()))  # a file may hold several of the blocks
    blocks = [class_texts(text) for text in texts if text]
    return "\n".join([*lines, f"end {EXTENDED};", *blocks]) + "\n"


def _instance(kind: str, name: str, values: Mapping[str, Value]) -> list[str]:
    settings = [f"{key} = {_number(value.value)}" for key, value in values.items()]
    told = [f"  // {name}.{key}: {_with_error(value)}" for key, value in values.items()]
    return [f"  {kind} {name}(", *_joined(settings, "    "), "  );", *told]


def _force(name: str, term: Term) -> str:
    return f"{name}{_WINDOW}.y*{name}.f" if window_names(term.effect) else f"{name}.f"


def settings_of(baseline: Skeleton, hypothesis: Hypothesis) -> dict[str, float]:
    """Parameters of the class ``Extended`` at a hypothesis without faults of the force channel, by name."""
    prefix = "rig." if baseline.kind == "wraps" else ""
    found = {f"{prefix}{name}": value for name, value in hypothesis.values.items() if name != "m"}
    if "m" in hypothesis.values and baseline.mass:
        found[f"{prefix}{baseline.mass}"] = hypothesis.mass()
    terms = [term for term in hypothesis.terms if not isinstance(term.effect, ChannelEffect)]
    for name, term in zip(_instance_names(terms), terms, strict=True):
        times = window_names(term.effect)
        found |= {f"{name}{_WINDOW if key in times else ''}.{key}": value for key, value in term.values.items()}
    return found


def _frame(baseline: Skeleton, refit: Mapping[str, Value], sums: str) -> tuple[list[str], Ports, list[str]]:
    """Declarations, what the ports of an effect are joined to, and equations, for each kind of baseline."""
    if baseline.kind == "extends":
        changes = modifiers({name: _number(value.value) for name, value in refit.items()})
        changes += [f"f_effects = {sums}"] if sums else []
        return [f"  extends {_class(baseline.name)}(", *_joined(changes, "    "), "  );"], _PORTS, []
    if baseline.kind == "fmu":
        told = "  // The FMU is a closed binary that Modelica cannot extend: connect F_rig to its input F."
        return [told, *_SIGNALS], _PORTS, [f"  f = {sums or 0};", "  F_rig = F - f;"]
    named = {baseline.mass if name == "m" else name: value for name, value in refit.items()}
    changes = modifiers({name: _number(value.value) for name, value in named.items() if name})
    mass = f"rig.{baseline.mass}" if baseline.mass else _number(baseline.inner_mass)
    lever, ports = ("radius*", [f"radius*{name}" for name in "xva"]) if baseline.turns else ("", [*"xva"])
    signals = [_UNIT.sub(lambda unit: turned_unit(unit[0]), line) for line in _RIG] if lever else _RIG
    head = [*signals, *([_RADIUS] if lever and sums else []), f"  {_class(baseline.name)} rig("]
    head += [*_joined(changes, "    "), "  );"]
    effects = f" - {lever}({sums})" if sums else ""
    equations = [f"  rig.F = F{effects};", "  x = rig.x;", "  v = rig.v;", "  a = der(rig.v);", f"  {mass}*a + R = F;"]
    held = ("h", f"rig.f_h{'/radius' if lever else ''}" if baseline.has_h else "0")
    return head, (*zip("xva", ports, strict=True), held), equations


Ports = tuple[tuple[str, str], ...]
_SIGNALS = (
    '  input Real F(unit = "N") "Excitation";',
    '  input Real x(unit = "m") "Displacement";',
    '  input Real v(unit = "m/s") "Velocity";',
    '  input Real a(unit = "m/s2") "Acceleration";',
    '  input Real f_h(unit = "N") "Hysteretic force of the FMU, 0 where it shows none";',
    '  output Real f(unit = "N") "Force that the FMU lacks";',
    '  output Real F_rig(unit = "N") "What the FMU gets: the excitation less the force that it lacks";',
)
_RIG = (
    '  input Real F(unit = "N") "Excitation";',
    '  output Real x(unit = "m") "Displacement";',
    '  output Real v(unit = "m/s") "Velocity";',
    '  output Real a(unit = "m/s2") "Acceleration";',
    '  output Real R(unit = "N") "Restoring force";',
)
_RADIUS = '  constant Real radius(unit = "m") = 1 "Where the effects act: their laws are of lengths and forces";'
_UNIT = re.compile(r'(?<=unit = ")[^"]+')
_PORTS: Ports = (("x", "x"), ("v", "v"), ("a", "a"), ("h", "f_h"))


def _title(baseline: str, terms: Sequence[tuple[Term, Mapping[str, Value]]]) -> str:
    found = " and ".join(term.effect.id.replace("_", " ") for term, _ in terms)
    short = _class(baseline).removesuffix(".fmu").rpartition(".")[2]
    return f"{short} oscillator as fitted" + (f", with {found}" if found else "")


def _class(name: str) -> str:
    return Path(name).name if name.endswith(".fmu") else name.rpartition(":")[2]


def _instance_names(terms: Sequence[Term]) -> list[str]:
    names: list[str] = []
    for term in terms:
        first, *rest = term.effect.id.split("_")
        base = first + "".join(word.capitalize() for word in rest)
        name, k = base, 2
        while name in names:
            name, k = f"{base}{k}", k + 1
        names.append(name)
    return names


def _joined(settings: Sequence[str], indent: str) -> list[str]:
    return [f"{indent}{text}{',' if i < len(settings) - 1 else ''}" for i, text in enumerate(settings)]


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e6 else f"{value:.9g}"


def _with_error(value: Value) -> str:
    error = f"standard error {value.stderr:.2g}" if isfinite(value.stderr) and value.stderr > 0 else "not fitted"
    return f"{value.value:.6g} {value.unit}".strip() + f", {error}"
