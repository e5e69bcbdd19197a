"""The flat model: one Modelica class with its inheritance, components and connections resolved, still with arrays.

The JSON form carries ``SCHEMA``; the flat models of the library are shipped in it: building one needs no front end.
An expression in JSON is a number, a string (a variable), {"text": ...}, or a list: operation, then arguments.
Beside the operations of ``expr``: "[]" subscripts an array, ":" is a whole dimension, "{}" builds an array, "range"
is start, step, end, "for" is a comprehension (body, then name and range in turn), "call NAME" calls a function.
"""

from __future__ import annotations

import json
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from hystid.errors import ModelicaError
from hystid.modelcode import BuiltInText, Enumeration, Experiment
from hystid.modelica.expr import Expr, Num, Op, Ref, Text

SCHEMA = 1


@dataclass(frozen=True)
class Place:
    """Where something stands: file name and line (from 1)."""

    file: str = ""
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file

    @property
    def short(self) -> str:
        """File name and line, the same wherever the file lies."""
        name = self.file.replace("\\", "/").rsplit("/", 1)[-1]
        return f"{name}:{self.line}" if self.line else name


@dataclass(frozen=True)
class FlatVariable:
    """A declared variable, maybe an array. Expressions of attributes and binding are None where absent."""

    name: str
    type: Literal["Real", "Integer", "Boolean"]
    variability: Literal["constant", "parameter", "discrete", "continuous"]
    causality: Literal["input", "output", "local"]
    dims: tuple[int, ...] = ()
    start: Expr | None = None
    fixed: bool | None = None
    min: Expr | None = None
    max: Expr | None = None
    nominal: Expr | None = None
    unit: str = ""
    description: str = ""
    binding: Expr | None = None
    final: bool = False
    protected: bool = False
    structural: bool = False
    enumeration: Enumeration | None = None
    place: Place = Place()
    preferred: bool = False  # as a state, by its author
    evaluate: bool = False  # its author lets the value be used when equations are sorted
    shown: str = ""  # unit in which its author reads it


@dataclass(frozen=True)
class Equation:
    """residual = 0; written by its author as left = right when the residual is a difference."""

    residual: Expr
    place: Place


@dataclass(frozen=True)
class Action:
    """What a when-clause does: assign or reinit ``target``, or check a condition.

    kind "assign" and "reinit": value is the right-hand side. kind "assert": value is the condition, message and level
    ("error" or "warning") say what to report. guard: condition of an if around it inside the when-clause, or None.
    """

    kind: Literal["assign", "reinit", "assert"]
    target: str
    value: Expr
    place: Place
    guard: Expr | None = None
    message: Expr | None = None
    level: str = "error"


@dataclass(frozen=True)
class Branch:
    """One ``when`` or ``elsewhen``; several conditions fire when any of them becomes true."""

    conditions: tuple[Expr, ...]
    actions: tuple[Action, ...]
    place: Place


@dataclass(frozen=True)
class When:
    """A when-clause: its branches in order of priority."""

    branches: tuple[Branch, ...]


@dataclass(frozen=True)
class Assertion:
    """A condition that must hold; level "error" or "warning"."""

    condition: Expr
    message: Expr
    level: str
    place: Place


@dataclass(frozen=True)
class FunctionVariable:
    """Input, output or local of a function; dims holds -1 for a size that the call decides.

    fields: of a record, its variables by their names in the function ("z.re").
    """

    name: str
    type: str
    dims: tuple[Expr, ...] = ()
    default: Expr | None = None
    fields: tuple[FunctionVariable, ...] = ()


@dataclass(frozen=True)
class Statement:
    """kind "assign": targets := value. "if": branches (condition, statements), last condition Num(1) for else.

    "for": name runs over value in the body of branches[0]. In algorithm sections of models also "when": branches
    (conditions, statements); "assert": value, its message in targets, its level in name; "reinit": name := value.
    In functions "assert" is dropped by the front end.
    """

    kind: Literal["assign", "if", "for", "when", "assert", "reinit"]
    place: Place
    targets: tuple[Expr | None, ...] = ()
    value: Expr | None = None
    branches: tuple[tuple[Expr, tuple[Statement, ...]], ...] = ()
    name: str = ""


@dataclass(frozen=True)
class Function:
    """A pure Modelica function with an algorithm; of an external one the name alone is known."""

    name: str
    inputs: tuple[FunctionVariable, ...]
    outputs: tuple[FunctionVariable, ...]
    locals: tuple[FunctionVariable, ...]
    body: tuple[Statement, ...]
    place: Place = Place()
    external: bool = False


@dataclass(frozen=True)
class Section:
    """An initial algorithm, whose values hold at the start, or an algorithm of the model."""

    statements: tuple[Statement, ...]
    place: Place = Place()


@dataclass(frozen=True)
class FlatModel:
    """See the module's text; experiment comes from the class's annotation."""

    name: str
    description: str
    variables: tuple[FlatVariable, ...]
    equations: tuple[Equation, ...]
    initial: tuple[Equation, ...] = ()
    whens: tuple[When, ...] = ()
    assertions: tuple[Assertion, ...] = ()
    functions: tuple[Function, ...] = ()
    sections: tuple[Section, ...] = ()
    experiment: Experiment = field(default_factory=Experiment)
    texts: tuple[BuiltInText, ...] = ()
    algorithms: tuple[Section, ...] = ()


_CLASSES: dict[str, type] = {
    c.__name__: c
    for c in (
        Place, FlatVariable, Equation, Action, Branch, When, Assertion, FunctionVariable, Statement, Function,
        Section, FlatModel, Experiment, Enumeration, BuiltInText,
    )
}  # fmt: skip


def to_json(model: FlatModel) -> str:
    """JSON text: deterministic, one item of each list of the model per line, so that a difference reads well."""
    plain = _encode(model)
    lines = ["{", f' "schema": {SCHEMA},']
    for key, value in plain.items():
        if isinstance(value, list) and key != "class":
            body = ",\n  ".join(json.dumps(item, ensure_ascii=False) for item in value)
            lines.append(f" {json.dumps(key)}: [\n  {body}\n ]," if value else f" {json.dumps(key)}: [],")
        else:
            lines.append(f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)},")
    lines[-1] = lines[-1].removesuffix(",")
    return "\n".join([*lines, "}", ""])


def from_json(text: str, origin: Path | str = "flat model") -> FlatModel:
    """The model in a JSON text. Raises ModelicaError when the schema is another one."""
    plain = json.loads(text)
    found = plain.pop("schema", None)
    if found != SCHEMA:
        raise ModelicaError(
            f"{origin}: flat model of schema {found}, this hystid reads schema {SCHEMA}; "
            "write it again with 'python -m hystid.modelica.library'"
        )
    model = _decode(plain)
    assert isinstance(model, FlatModel)
    return model


def _encode(value: Any) -> Any:
    if isinstance(value, Num):
        return value.value
    if isinstance(value, Ref):
        return value.name
    if isinstance(value, Text):
        return {"text": value.value}
    if isinstance(value, Op):
        return [value.name, *(_encode(a) for a in value.args)]
    if isinstance(value, tuple):
        return {"items": [_encode(v) for v in value]} if not _plain_tuple(value) else [_encode(v) for v in value]
    if type(value).__name__ in _CLASSES:
        return {"class": type(value).__name__} | {
            f.name: _encode(getattr(value, f.name)) for f in fields(value) if getattr(value, f.name) != _default(f)
        }
    return value


def _default(f: Field[Any]) -> Any:
    return f.default if f.default_factory is MISSING else f.default_factory()


def _plain_tuple(value: tuple[Any, ...]) -> bool:
    """Tuples of dataclasses are lists of objects, which no expression is."""
    return bool(value) and all(type(v).__name__ in _CLASSES for v in value)


def _decode(value: Any) -> Any:
    if isinstance(value, dict):
        if "text" in value and len(value) == 1:
            return Text(value["text"])
        if "items" in value and len(value) == 1:
            return tuple(_decode(v) for v in value["items"])
        if value["class"] == "Experiment":
            return Experiment(**{k: v for k, v in value.items() if k != "class"})
        return _CLASSES[value["class"]](**{k: _field(k, v) for k, v in value.items() if k != "class"})
    if isinstance(value, list):
        if value and isinstance(value[0], dict) and "class" in value[0]:
            return tuple(_decode(v) for v in value)
        return Op(value[0], tuple(_decode(v) for v in value[1:]))
    if isinstance(value, str):
        return Ref(value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Num(float(value))
    return value


_PLAIN_FIELDS = frozenset(
    {
        "name", "type", "variability", "causality", "fixed", "unit", "description", "final", "protected", "structural",
        "preferred", "evaluate", "shown", "external", "file", "line", "kind", "level", "content",
    }
)  # fmt: skip


def _field(name: str, value: Any) -> Any:
    if name in _PLAIN_FIELDS or (name == "target" and isinstance(value, str)):
        return value
    if name == "items":
        return tuple(value["items"])
    if name == "dims":
        items = value["items"] if isinstance(value, dict) else value
        return tuple(v if isinstance(v, int) else _decode(v) for v in items)
    return _decode(value)
