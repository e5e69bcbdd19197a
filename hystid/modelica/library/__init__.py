"""Flat models of the Modelica library, shipped so that building one of its models needs no front end.

``python -m hystid.modelica.library`` writes them again from ``modelica/HystId``. ``index.json`` holds for each a digest
of the Modelica text that it may depend on: after an edit of that text it is passed over until written again, so that
an edit always takes effect.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from hystid.modelica.flat import SCHEMA, FlatModel, from_json
from hystid.modelica.sources import Source, library_folder, read_tree

FOLDER = Path(__file__).parent
_INDEX = FOLDER / "index.json"
PACKAGES = ("Oscillators", "Forces", "Effects", "Components", "Examples")


@lru_cache(maxsize=1)
def library_sources() -> tuple[Source, ...]:
    """Every file of the library; paths are relative to the folder that holds HystId."""
    folder = library_folder()
    return tuple(Source(s.path.relative_to(folder), s.text) for s in read_tree(folder / "HystId"))


def shipped(name: str) -> FlatModel | None:
    """The stored flat model of a library class; None where there is none, or its Modelica text was edited since."""
    stored = _stored_digests().get(name)  # asked first: a name of another kind is no file name
    path = FOLDER / f"{name}.json"
    if stored is None or not path.is_file() or stored != digest(name):
        return None
    return from_json(path.read_text(encoding="utf-8"), path.name)


@lru_cache(maxsize=1)
def _stored_digests() -> dict[str, str]:
    index = json.loads(_INDEX.read_text(encoding="utf-8")) if _INDEX.is_file() else {}
    return dict(index["digests"]) if index.get("schema") == SCHEMA else {}


def digest(name: str) -> str:
    """SHA-256 over the files that a library class may depend on: those named in its file, those named in these, ..."""
    files = {s.path.with_suffix("").as_posix().replace("/", "."): s for s in library_sources()}
    needed, waiting = set(), [name]
    while waiting:
        current = waiting.pop()
        if current in needed or current not in files:
            continue
        needed.add(current)
        words = set(re.findall(r"[A-Za-z_]\w*", files[current].plain))
        waiting += [other for other in files if other.rsplit(".", 1)[-1] in words]
    found = hashlib.sha256()
    for other in sorted(needed):
        found.update(f"{other}\0{files[other].text}\0".encode())
    for other in sorted(n for n in files if n.endswith(".package")):  # constants may stand there, texts do not matter
        found.update(f"{other}\0{files[other].plain.split()}\0".encode())
    return found.hexdigest()


def library_models() -> list[str]:
    """Full names of the models and blocks of the library that can be compiled, in order of their files."""
    return list(_models())


def _models() -> Iterator[str]:
    for source in library_sources():
        parts = source.path.with_suffix("").parts
        if len(parts) == 3 and parts[1] in PACKAGES and _is_model(source, parts[2]):
            yield ".".join(parts)


def _is_model(source: Source, short: str) -> bool:
    return re.search(rf"(?<!partial )\b(?:model|block)\s+{short}\b", source.plain) is not None
