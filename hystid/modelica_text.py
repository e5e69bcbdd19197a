"""Modelica text that this program writes: modifiers, classes inside other text, and models compiled from a text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from hystid.errors import UsageError
from hystid.files import scratch, text_of
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.modelica.reach import only_class

EXTENDED = "Extended"  # class that a diagnosis writes
_WITHIN = re.compile(r"\A((?:\s|//[^\n]*\n|/\*.*?\*/)*)within\b[^;]*;\s*", re.DOTALL)  # comments may stand before it
_SUBSCRIPTS = re.compile(r"\[([\d,]+)\]")


def modifiers(settings: Mapping[str, str]) -> list[str]:
    """Modifiers by dotted name as Modelica writes them: {"gap.k": "1"} as ``gap(k = 1)``. Elements of an array stand
    together: {"k[1]": "1", "k[2]": "2"} as ``k = {1, 2}``, and so do those of an array of components."""
    whole: dict[str, dict[tuple[int, ...], str]] = {}
    for name, value in settings.items():
        place = tuple(int(i) for found in _SUBSCRIPTS.findall(name) for i in found.split(","))
        whole.setdefault(array_of(name), {})[place] = value
    return _nested({name: _array(elements) for name, elements in whole.items()})


def array_of(name: str) -> str:
    """Name without its subscripts: "s.k" of "s[2].k[1]"."""
    return _SUBSCRIPTS.sub("", name)


def _array(elements: Mapping[tuple[int, ...], str]) -> str:
    """Values by subscripts, all of them there, as ``{{1, 2}, {3, 4}}``; a scalar as it is."""
    if () in elements:
        return elements[()]
    rows: dict[int, dict[tuple[int, ...], str]] = {}
    for (first, *rest), value in sorted(elements.items()):
        rows.setdefault(first, {})[tuple(rest)] = value
    return f"{{{', '.join(map(_array, rows.values()))}}}"


def _nested(settings: Mapping[str, str]) -> list[str]:
    own = [f"{name} = {value}" for name, value in settings.items() if "." not in name]
    inside: dict[str, dict[str, str]] = {}
    for name, value in settings.items():
        component, _, rest = name.partition(".")
        if rest:
            inside.setdefault(component, {})[rest] = value
    return own + [f"{component}({', '.join(_nested(rest))})" for component, rest in inside.items()]


def class_texts(text: str) -> str:
    """Classes of a file as they stand inside other text: without a ``within`` clause."""
    return _WITHIN.sub(r"\1", text).strip()


def with_class(model: str) -> str:
    """A model with its class: a file alone stands for its only model, or for Extended, as ``diagnose`` writes it, and a
    folder for the file extended.mo that it wrote there.

    Raises UsageError, ModelicaError where a file holds none or several, or a folder none."""
    if (written := Path(model, "extended.mo")).is_file():
        model = str(written)
    elif Path(model).is_dir():
        told = f"{model}: this folder holds no extended.mo, as diagnose writes it"
        raise UsageError(f"{told}: write a class such as HystId.Oscillators.Jenkins, or file.mo:Class")
    if not model.endswith(".mo") or not Path(model).is_file():
        return model
    return f"{model}:{EXTENDED if has_class(text_of(Path(model), UsageError), EXTENDED) else only_class(Path(model))}"


def has_class(text: str, name: str) -> bool:
    """Whether a text declares a model of a name at its top, as this program writes it."""
    return bool(re.search(rf"^model {name}\b", text, re.MULTILINE))


def compile_text(text: str, name: str) -> ModelCode:
    """The model of a class in a text, by its full name."""
    with scratch() as folder:
        file = folder / "model.mo"
        file.write_text(text, encoding="utf-8")
        return compile_model(f"{file}:{name}")
