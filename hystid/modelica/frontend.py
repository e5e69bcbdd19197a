"""The one place that knows the front end: Modelica text in, ``FlatModel`` out.

rumoca parses, resolves inheritance, components and connections, and checks types; its "flat" dictionary is turned into
our own types here. Versions other than the pinned ones are refused, because the dictionary has no contract.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from hystid.errors import ModelicaError
from hystid.modelica.adapter import Adapter
from hystid.modelica.annotations import description_of, experiment_of
from hystid.modelica.diagnostics import broken_down, explain, located_syntax_error
from hystid.modelica.expr import Num
from hystid.modelica.flat import FlatModel
from hystid.modelica.sources import Source, declaration, read

_WRAPPER = "HystidStructure"


def flatten(
    name: str,
    files: Sequence[Source],
    library: Sequence[Source],
    roots: Sequence[Path],
    structure: Mapping[str, float],
) -> FlatModel:
    """The flat model of class ``name``.

    files: texts given by the user. roots: folders of directory packages. library: every file below them, whose text
    need not be what stands on the disk.
    structure: values of parameters that decide sizes or which equations exist.
    Raises ModelicaError with file and line.
    """
    dictionary = _load(name, files, library, roots, structure)
    flat = Adapter(name, (*files, *library)).model(dictionary)
    if any(relation["indices"] for relation in dictionary["instance_relations"].values()):

        def names(changed: Mapping[str, float]) -> frozenset[str]:
            return frozenset(_load(name, files, library, roots, {**structure, **changed})["variables"])

        flat = _with_sizes_of_components(flat, names)
    declared = declaration(name, (*files, *library))
    return replace(flat, description=description_of(declared), experiment=experiment_of(declared))


def _with_sizes_of_components(flat: FlatModel, names: Callable[[Mapping[str, float]], frozenset[str]]) -> FlatModel:
    """Marks the parameters that decide sizes of component arrays, which the front end does not report.

    names(changed) gives the names of the variables with other values of such parameters: they show which matter.
    """
    now = frozenset(v.name for v in flat.variables)
    other = {
        v.name: v.binding.value == 0 if v.type == "Boolean" else v.binding.value + 1
        for v in flat.variables
        if v.variability == "parameter" and v.type != "Real" and not (v.structural or v.final or "[" in v.name)
        if isinstance(v.binding, Num)
    }

    def matters(changed: Mapping[str, float]) -> bool:
        try:
            return names(changed) != now
        except ModelicaError:
            return True  # another value does not even make a model

    if not other or not matters(other):
        return flat
    sizes = {name for name, value in other.items() if matters({name: value})}
    return replace(
        flat, variables=tuple(replace(v, structural=v.structural or v.name in sizes) for v in flat.variables)
    )


def _load(
    name: str, files: Sequence[Source], library: Sequence[Source], roots: Sequence[Path], structure: Mapping[str, float]
) -> dict[str, Any]:
    rumoca = _front_end()
    with _one_root(roots, library) as root, _private_cache(), _quiet():
        return _flat_dictionary(rumoca, name, files, library, root, structure)


@contextmanager
def _one_root(packages: Sequence[Path], library: Sequence[Source]) -> Iterator[Path]:
    """A folder that holds the packages: the front end takes one, and reads everything in it.

    The library alone lies in such a folder; else the texts are written into one, so that what happens to lie beside a
    user's package is not read.
    """
    folder = packages[0].parent  # paths in the library are relative to it
    texts = {folder / source.path: source.text for source in library}
    if len(packages) == 1 and all(text == read(path).text for path, text in texts.items()):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="hystid-") as stage:
        for package in packages:
            for path in package.rglob("*.mo"):
                copy = Path(stage, package.name) / path.relative_to(package)
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_text(texts.get(path, read(path).text), encoding="utf-8")
        yield Path(stage)


_environment = threading.Lock()


@contextmanager
def _private_cache() -> Iterator[None]:
    """The front end keeps every file that it ever parsed in the user's cache folder, without end; here it may not.

    Parsing the library anew costs some 30 ms.
    """
    with _environment, tempfile.TemporaryDirectory(prefix="hystid-") as folder:
        before = os.environ.get("XDG_CACHE_HOME")
        os.environ["XDG_CACHE_HOME"] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ["XDG_CACHE_HOME"]
            else:
                os.environ["XDG_CACHE_HOME"] = before


@contextmanager
def _quiet() -> Iterator[None]:
    """A breakdown inside the front end prints its own picture to the process's stderr; the user gets our sentence."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as away:
        before = os.dup(2)
        os.dup2(away.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)


def _flat_dictionary(
    rumoca: Any,
    name: str,
    files: Sequence[Source],
    library: Sequence[Source],
    root: Path,
    structure: Mapping[str, float],
) -> dict[str, Any]:
    session = rumoca.Session(roots=[str(root)])
    # names of folders that do not exist: the front end would read what lies beside a real file
    named = {f"hystid-{number}/{source.path.name}": source for number, source in enumerate(files)}
    wrapper = _wrapper(name, structure)
    try:
        for path, source in named.items():
            _retain(rumoca, session, source.text, path)
        model = session.loads(wrapper, model=_WRAPPER, filename=f"hystid/{_WRAPPER}.mo")
        dictionary: dict[str, Any] = model.to_dict("flat")
    except rumoca.RumocaError as error:
        located_syntax_error(rumoca.validate_source, files, library)
        message = str(error)
        for path, source in named.items():
            message = message.replace(path, str(source.path))
        raise explain(message, name, files, library) from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # what a breakdown inside the front end raises; it has no base
            raise
        raise broken_down(str(error), name, (*files, *library)) from None
    return dictionary


def _retain(rumoca: Any, session: Any, text: str, path: str) -> None:
    """Adds a file to the session. Compiling it is not wanted here; what is wrong with it shows at the final load."""
    try:
        session.loads(text, model=_WRAPPER, filename=path)
    except rumoca.RumocaError:
        return
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise


def _wrapper(name: str, structure: Mapping[str, float]) -> str:
    """A class that extends the wanted one, so that files, packages and structural values take one way in."""
    values = ", ".join(f"{key} = {_literal(value)}" for key, value in structure.items())
    return f"model {_WRAPPER}\n  extends {name}{f'({values})' if values else ''};\nend {_WRAPPER};\n"


def _literal(value: float) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _front_end() -> Any:
    try:
        import rumoca
    except ImportError:
        raise ModelicaError(
            "compiling Modelica text needs the front end 'rumoca': pip install 'rumoca>=0.10,<0.11' "
            "(models of the HystId library build without it)"
        ) from None
    version = metadata.version("rumoca")
    if not version.startswith("0.10."):
        raise ModelicaError(f"front end rumoca {version} is not supported: pip install 'rumoca>=0.10,<0.11'")
    return rumoca
