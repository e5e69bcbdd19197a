"""What an effect says of itself: the annotation ``__HystId_effect(...)`` of its block.

Nothing about an effect stands in Python. What cannot be computed from its equations is declared in its block:
how it is called, which of its parameters is a threshold, a switch or a transition, what recordings must have to show
it, which other law it becomes at an end of its parameters, and which it is equal to. Everything is optional: a block
that says nothing is tried like any other. docs/guide-modelica.md lists the words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NoReturn

from hystid.errors import ModelicaError
from hystid.modelcode import Variable
from hystid.modelica.sources import near
from hystid.modelica.vendor import AnnotationRecord, Entry, Name

KEYWORD = "__HystId_effect"
NEEDS = ("time", "speeds", "reversals", "mass")
MEASURES = ("", "stroke", "speed", "resolution")
FITS = ("refused", "renamed", "equivalent")
# Parameter with a meaning -> unit that it must have, and whether it is a shape (an amplitude otherwise).
_UNITS = {"threshold": "m", "width": "m", "path": "m", "transition": "m/s", "mass": "kg"}


@dataclass(frozen=True)
class End:
    """An end of a parameter at which the block is another law.

    law: id of that law, "" where the baseline has it. of: the parameter. The end is reached from ``above`` or up to
    ``below``, in units of ``per``, a measure of the motion or another parameter; at the "top" or "bottom" of the range
    that is tried (``at``); or where the force of the parameter outweighs that of another one (``over``), with ``below``
    only where the parameter is less; or where the block never acts both ways (``one_sided``). unless: "hysteresis" for
    a model that has some. fit: such a fit is "refused", is "renamed", or is "equivalent" to the other law.
    """

    law: str
    of: str
    above: float | None = None
    below: float | None = None
    at: str = ""
    over: str = ""
    one_sided: bool = False
    per: str = ""
    unless: str = ""
    fit: str = "refused"


@dataclass(frozen=True)
class Alike:
    """Another law that no recording of this kind tells from this one. title: display name of the two together.

    provided: "" always; "constant": where the force of the other one is constant in each recording. unless: id of a law
    beside which the two differ.
    """

    law: str
    provided: str = ""
    unless: str = ""
    title: str = ""


@dataclass(frozen=True)
class Telling:
    """The experiment that tells an effect from another one. steered: it needs control of the motion."""

    law: str
    experiment: str
    steered: bool = True


@dataclass(frozen=True)
class Semantics:
    """What a block declares. threshold, width, path, transition, mass, switch: names of parameters, "" where none.

    title: display name. family: display name of several effects that cannot be told apart. sentence: for people.
    experiment: what would show the effect; steered: it needs control of the motion. needs: what recordings or model
    must have. lasting: never for a part of the time. hysteretic: brings the force h where the baseline has none.
    """

    title: str = ""
    family: str = ""
    sentence: str = ""
    experiment: str = ""
    steered: bool = True
    threshold: str = ""
    width: str = ""
    path: str = ""
    transition: str = ""
    mass: str = ""
    switch: str = ""
    lasting: bool = False
    hysteretic: bool = False
    needs: tuple[str, ...] = ()
    becomes: tuple[End, ...] = ()
    alike: tuple[Alike, ...] = ()
    tells: tuple[Telling, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)


# What holds for all forms of a law, and is stated once, in the block without a double underscore.
OF_THE_LAW = ("family", "experiment", "steered", "lasting", "hysteretic", "needs", "alike", "tells")
_RECORDS = {"becomes": ("End", End), "alike": ("Alike", Alike), "tells": ("Telling", Telling)}
_WORDS = tuple(item.name for item in fields(Semantics) if item.name != "places")


def semantics_of(
    record: AnnotationRecord | None, variables: Sequence[Variable], amplitudes: Sequence[str]
) -> Semantics:
    """What an annotation declares, checked against the parameters of its block. Raises ModelicaError."""
    if record is None:
        return Semantics()
    parameters = {v.name: v for v in variables if v.causality == "parameter"}
    found: dict[str, Any] = {}
    for key, entry in record.entries.items():
        if key not in _WORDS:
            _refuse(entry, f"{KEYWORD} has no '{key}'{near(key, _WORDS)} It knows {', '.join(_WORDS)}")
        found[key] = _value(key, entry, parameters)
    for key in _UNITS:
        if key in found:
            _check_unit(key, record.entries[key], parameters[found[key]], amplitudes)
    if "switch" in found:
        v = parameters[found["switch"]]
        if v.type != "Integer" or v.min is None or v.max is None:
            _refuse(record.entries["switch"], f"switch = {v.name}: a switch is an Integer parameter with min and max")
    places = {key: entry.place for key, entry in record.entries.items()}
    return Semantics(**found, places=places)


def _refuse(entry: Entry | AnnotationRecord, why: str) -> NoReturn:
    raise ModelicaError(f"{entry.place}: {why}")


def _value(key: str, entry: Entry, parameters: Mapping[str, Variable]) -> Any:
    if key in _RECORDS:
        return tuple(_record(key, entry, item, parameters) for item in _list(key, entry))
    if key == "needs":
        return tuple(_one_of("needs", entry, item, NEEDS) for item in _list(key, entry))
    if key in _UNITS or key == "switch":
        return _parameter(key, entry, parameters)
    return _plain(key, entry, bool if key in ("lasting", "hysteretic", "steered") else str)


def _list(key: str, entry: Entry) -> list[Any]:
    if not isinstance(entry.value, list):
        _refuse(entry, f"{key} is a list in braces: {key} = {{...}}")
    return entry.value


def _one_of(key: str, entry: Entry, value: Any, known: Sequence[str]) -> str:
    if value not in known:
        _refuse(entry, f"{key} knows {', '.join(repr(word) for word in known if word)}, not {value!r}")
    return str(value)


def _parameter(key: str, entry: Entry, parameters: Mapping[str, Variable]) -> str:
    if not isinstance(entry.value, Name):
        _refuse(entry, f"{key} is the name of a parameter, without quotes")
    name = entry.value.text
    if name not in parameters:
        _refuse(entry, f"{key} = {name}: the block has no parameter of that name{near(name, parameters)}")
    return name


def _plain(key: str, entry: Entry, kind: type) -> Any:
    if type(entry.value) is not kind:
        what = {str: "a string in quotes", bool: "true or false", float: "a number"}[kind]
        _refuse(entry, f"{key} is {what}")
    return entry.value


def _check_unit(key: str, entry: Entry, v: Variable, amplitudes: Sequence[str]) -> None:
    if v.unit != _UNITS[key]:
        _refuse(entry, f"{key} = {v.name}: its unit is {_UNITS[key]}, that of {v.name} is {v.unit or '1'}")
    if (v.name in amplitudes) != (key == "mass"):
        kind = "a parameter in which f is linear" if key == "mass" else "no parameter in which f is linear"
        _refuse(entry, f"{key} = {v.name}: it is {kind}")


def _record(key: str, entry: Entry, item: Any, parameters: Mapping[str, Variable]) -> Any:
    name, kind = _RECORDS[key]
    if not isinstance(item, AnnotationRecord) or item.name != name:
        _refuse(entry, f"{key} is a list of {name}(...)")
    words = [word.name for word in fields(kind)]
    found: dict[str, Any] = {}
    for word, one in item.entries.items():
        if word not in words:
            _refuse(one, f"{name} has no '{word}'{near(word, words)} It knows {', '.join(words)}")
        if word in ("of", "over") or (word == "per" and isinstance(one.value, Name)):
            found[word] = _parameter(word, one, parameters)
        elif word in ("above", "below"):
            found[word] = _plain(word, one, float)
        else:
            found[word] = _plain(word, one, bool if word in ("steered", "one_sided") else str)
    for word in ("law", *{"becomes": ("of",), "tells": ("experiment",)}.get(key, ())):
        if word not in found:
            _refuse(item, f"{name} must say '{word}'")
    if key == "becomes":
        _check_end(item, End(**found), parameters)
    if key == "alike":
        _one_of("provided", item.entries.get("provided", entry), found.get("provided", ""), ("", "constant"))
    return kind(**found)


def _check_end(item: AnnotationRecord, end: End, parameters: Mapping[str, Variable]) -> None:
    said = [end.above is not None, end.below is not None and not end.over, bool(end.at), bool(end.over), end.one_sided]
    if sum(said) != 1:
        _refuse(item, "End says one of above, below, at, over and one_sided")
    known = {"per": (*MEASURES, *parameters), "fit": FITS, "at": ("", "top", "bottom"), "unless": ("", "hysteresis")}
    for word, options in known.items():
        _one_of(word, item.entries.get(word, Entry("", item.place)), getattr(end, word), options)
