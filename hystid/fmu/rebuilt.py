"""A rebuilt FMU in place of an older one: the reference stays the older one's, and what changed is said."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from hystid.errors import FmuError, NumericalError, listed
from hystid.fmu.build import read_zip, write_zip
from hystid.fmu.door import open_fmu, read_entry
from hystid.fmu.reference import FOLDER
from hystid.fmu.regress import RegressionResult, regress
from hystid.modelcode import Variable

_ASKED = ("unit", "type", "causality", "variability", "min", "max")
_MOST_NAMES = 6  # variables that are named in one line


def has_reference(path: Path) -> bool:
    """Whether an FMU is there that carries a reference result of its own; a damaged file has none."""
    if not (path.is_file() and zipfile.is_zipfile(path)):
        return False
    try:
        return read_entry(path, f"{FOLDER}/fmi-ls-manifest.xml") is not None
    except FmuError:
        return False


def with_reference_of(old: Path, new: Path, out: Path) -> tuple[str, ...]:
    """Write the new FMU to ``out``, with the reference of the old one inside; old and out may be the same file.

    Gives what changed in lines: variables, start values, and signals of the reference that differ now.
    """
    changes = tuple(_changed_variables(old, new))  # refuses an old file that unpacks without an end
    content = {name: data for name, data in read_zip(new).items() if not _is_reference(name)}
    content |= {name: data for name, data in read_zip(old).items() if _is_reference(name)}
    write_zip(new, content)
    answers = tuple(_changed_answers(new))
    write_zip(out, content)
    return (*changes, *answers)


def _is_reference(name: str) -> bool:
    """Whether an entry stays the older FMU's; the parameter set beside the reference is the newer one's."""
    return name.startswith(f"{FOLDER}/") and not name.endswith(".ssv")


def _changed_variables(old: Path, new: Path) -> Iterator[str]:
    then, now = _variables(old), _variables(new)
    for word, names in (("gone", then.keys() - now.keys()), ("new", now.keys() - then.keys())):
        if names:
            yield f"{word}: {listed(sorted(names), _MOST_NAMES)}"
    both = [(then[name], now[name]) for name in now if name in then]
    starts = [
        f"{a.name} {a.start:.6g} -> {b.start:.6g} {b.unit}".rstrip()
        for a, b in both
        if a.start != b.start and a.start is not None and b.start is not None
    ]
    if starts:
        yield f"start values: {listed(starts, _MOST_NAMES)}"
    for attribute in _ASKED:
        changed = [(a.name, getattr(a, attribute), getattr(b, attribute)) for a, b in both]
        different = [f"{name} {was or 'none'} -> {now or 'none'}" for name, was, now in changed if was != now]
        if different:
            yield f"{attribute}: {listed(different, _MOST_NAMES)}"


def _variables(path: Path) -> Mapping[str, Variable]:
    return {v.name: v for v in open_fmu(path).model.variables}


def _changed_answers(new: Path) -> Iterator[str]:
    try:
        result: RegressionResult = regress(new)
    except (FmuError, NumericalError) as error:  # a stiffer model may have no answer at the old steps
        yield str(error)
        return
    if not result.passed:
        yield from (line.strip() for line in result.summary().splitlines()[1:])
