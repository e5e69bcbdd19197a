"""Classes that a user's text names and that are nowhere: mistyped, of a library not given, or of another version."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from hystid.errors import ModelicaError
from hystid.modelica.lookup import ClassNode, Tree, imported_by
from hystid.modelica.reach import classes, reached
from hystid.modelica.sources import Source, near, search_path

_OURS = (
    "of the Modelica Standard Library only Units.SI, Constants, Math and Blocks.Interfaces are here: "
    "name the folder that holds the whole with --library, or in MODELICAPATH"
)
_NAMED = re.compile(
    r"(?:(?<=[;\n\s])|^)(?P<base>extends\s+)?(?P<name>Modelica(?:\.[A-Za-z_]\w*)+)"
    r"(?(base)|(?:\s*\[[^\]]*\])?\s+(?!annotation\b)[A-Za-z_]\w*\s*[\[(;=\"])"
)
_VERSION = re.compile(r'(?<![\w.])version\s*=\s*"([^"]+)"')
_USES = re.compile(r'\buses\s*\([^)]*?\bModelica\s*\(\s*version\s*=\s*"([^"]+)"')


def refuse_absent_model(name: str, tree: Tree, files: Sequence[Source], libraries: Sequence[Path]) -> None:
    """Raises where the class to compile is nowhere, with near names; with what is missing where that is clear."""
    last = name.rsplit(".", 1)[-1]
    is_unread = any(classes(source) is None and last in source.classes() for source in files)  # what is wrong is told
    if tree.find(name) is not None or is_unread:
        return
    where = ", ".join([*(str(f.path) for f in files), *map(str, libraries)]) or "the library HystId"
    raise ModelicaError(f"{where}: there is no class '{name}'{_advice(name, tree, ours=_is_ours(name, tree))}")


def refuse_absent_classes(model: str, tree: Tree, files: Sequence[Source]) -> None:
    """Raises ModelicaError, with what is missing, for classes of the standard library that components and base classes
    of the user's files name and that are nowhere, as far as the model may use them."""
    for source, used in reached(model, files).items():
        for found in _NAMED.finditer(source.plain):
            name, at = found["name"], found.start("name")
            own = used is None or any(c.start <= at < c.end for c in used if not c.short)
            if own and tree.find(name) is None:
                raise _absent(name, source, at, tree)


def refuse_absent_imports(tree: Tree) -> None:
    """Raises ModelicaError where what a cut tree needs is imported from what is nowhere, or may be: ``P.*``."""
    for node in (n for root in tree.given for n in _around(root)):
        for clause, name, full in ((c, *item) for c in node.import_clauses for item in imported_by(c).items()):
            if (name.startswith("*") or (node, name) in tree.imported) and not tree.names(full):
                raise _absent(full, node.source, clause.start(), tree)


def _around(node: ClassNode) -> Iterator[ClassNode]:
    """The class and those nested in it that stand around what is needed."""
    if node.need:
        yield node
        for child in node.nested:
            yield from _around(child)


def _absent(name: str, source: Source, at: int, tree: Tree) -> ModelicaError:
    said = _versions(source, tree) or _advice(name, tree, _is_ours(name, tree))
    return ModelicaError(f"{source.place(at)}: there is no class '{name}'{said}")


def _is_ours(name: str, tree: Tree) -> bool:
    """Whether it would be in the standard library, of which there is our small part only."""
    return name.split(".")[0] == "Modelica" and _version(tree) is None


def _version(tree: Tree) -> str | None:
    """Of the standard library, where the whole is there."""
    top = tree.top("Modelica")
    found = _VERSION.search(top.source.text) if top is not None else None
    return found[1] if found else None


def _advice(name: str, tree: Tree, ours: bool) -> str:
    return (f"; {_OURS}" if ours else near(name, tree.names_beside(name))) + _no_folders()


def _no_folders() -> str:
    """What MODELICAPATH names in vain: other tools pass over it as well, but here it may be the reason."""
    missing = [str(folder) for folder in search_path() if not folder.is_dir()]
    return f"; MODELICAPATH names {', '.join(missing)}, where there is no folder" if missing else ""


def _versions(source: Source, tree: Tree) -> str:
    """Where the text says that it is written for another version than the one that is there."""
    wanted, there = _USES.search(source.text), _version(tree)
    if not wanted or there is None or _first(wanted[1]) == _first(there):
        return ""
    return (
        f" in version {there} of the Modelica Standard Library, and the text is written for {wanted[1]} (annotation "
        "uses): give that version as the library, or convert the text"
    )


def _first(version: str) -> str:
    return next(iter(_numbers(version)), version)


def _numbers(version: str) -> Iterator[str]:
    return (m.group() for m in re.finditer(r"\d+", version))
