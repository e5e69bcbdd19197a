"""A user's rig with its excitation and its measured displacement named from outside."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from hystid.errors import UsageError
from hystid.files import text_of, write_text
from hystid.modelica.reach import only_class
from hystid.modelica_text import class_texts

CLASS = "Measured"
_NAME = re.compile(r"[A-Za-z_]\w*(?:\[\d+\])?(?:\.[A-Za-z_]\w*(?:\[\d+\])?)*")


def wired(model: str, signals: Mapping[str, str], folder: Path) -> str:
    """``folder``/measured.mo with a class that is the rig and has F and x, and how ``diagnose`` takes it.

    model: "rig.mo:Rig", or a full name that MODELICAPATH leads to. signals: "F" -> an input of the class, or one of a
    component that nothing is connected to ("shaker.f"); "x" -> the variable that the sensor shows, as the position of a
    flange ("mass.flange_b.s"). One of both may be left out where the class has it. Raises UsageError, ModelicaError.
    """
    wrong = [name for name in signals if name not in ("F", "x")]
    if wrong:
        raise UsageError(
            f"--signal {wrong[0]}: name F, the excitation, or x, the measured displacement; v and a follow"
        )
    for name, variable in signals.items():
        if not _NAME.fullmatch(variable):
            raise UsageError(f"--signal {name}={variable}: write a variable of the model, as mass.flange_b.s")
    file, name, text = _taken(model)
    if re.search(rf"\b(?:model|block|class|package)\s+{CLASS}\b", text):
        raise UsageError(f"{file}: the name {CLASS} is taken by --signal: give the class another one")
    made = _class(name, signals)
    path = folder / "measured.mo"
    write_text(path, f"{class_texts(text)}\n\n{made}" if text else made)
    return f"{path}:{CLASS}"


def _taken(model: str) -> tuple[Path, str, str]:
    """File, class and text of a model; no text for one that is found by its full name."""
    found = re.fullmatch(r"(.*\.mo)(?::([\w.]+))?", model)
    if not found:
        if re.fullmatch(r"[A-Za-z_][\w.]*", model) and not model.endswith(".fmu"):
            return Path(), model, ""
        raise UsageError(f"--signal names variables of a model in Modelica, which {model} is not")
    file = Path(found[1])
    if file.name == "package.mo":
        raise UsageError(
            f"{file} is a part of a folder: put the folder above it into MODELICAPATH, and give a full name"
        )
    name = found[2] or only_class(file)
    text = text_of(file, UsageError)
    within = re.match(r"(?:\s|//[^\n]*\n)*within\s+([\w.]+)\s*;", text)
    return file, name.removeprefix(f"{within[1]}.") if within else name, text


def _class(name: str, signals: Mapping[str, str]) -> str:
    """The rig as a base class, so that its parameters keep their names. An input of its own cannot be set there: such
    a rig is a component, and its parameters stand one level deeper."""
    force, place = signals.get("F", ""), signals.get("x", "")
    as_part = bool(force) and "." not in force
    front = "rig." if as_part else ""
    lines = [f'model {CLASS} "{name} with its excitation and its measured displacement named"']
    lines += [f"  {name} rig;" if as_part else f"  extends {name};"]
    equations = []
    if force:
        lines += [f'  input Real F "Excitation, {force}";']
        equations += [f"  {front}{force} = F;"]
    if place or as_part:
        lines += [
            f'  output Real x(start = 0, fixed = true) "Displacement, {place or "x"}";',
            '  output Real v(start = 0, fixed = true) "Velocity";',
            '  output Real a "Acceleration";',
        ]
        equations += [f"  x = {front}{place or 'x'};", "  v = der(x);", "  a = der(v);"]
    return "\n".join([*lines, "equation", *equations, f"end {CLASS};", ""])
