"""Modelica text that this program writes: modifiers, classes inside other text, and models compiled from a text."""

from __future__ import annotations

import re
from collections.abc import Mapping

from hystid.files import scratch
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

_WITHIN = re.compile(r"\A((?:\s|//[^\n]*\n|/\*.*?\*/)*)within\b[^;]*;\s*", re.DOTALL)  # comments may stand before it


def modifiers(settings: Mapping[str, str]) -> list[str]:
    """Modifiers by dotted name as Modelica writes them: {"gap.k": "1"} as ``gap(k = 1)``."""
    own = [f"{name} = {value}" for name, value in settings.items() if "." not in name]
    inside: dict[str, dict[str, str]] = {}
    for name, value in settings.items():
        component, _, rest = name.partition(".")
        if rest:
            inside.setdefault(component, {})[rest] = value
    return own + [f"{component}({', '.join(modifiers(rest))})" for component, rest in inside.items()]


def class_texts(text: str) -> str:
    """Classes of a file as they stand inside other text: without a ``within`` clause."""
    return _WITHIN.sub(r"\1", text).strip()


def compile_text(text: str, name: str) -> ModelCode:
    """The model of a class in a text, by its full name."""
    with scratch() as folder:
        file = folder / "model.mo"
        file.write_text(text, encoding="utf-8")
        return compile_model(f"{file}:{name}")
