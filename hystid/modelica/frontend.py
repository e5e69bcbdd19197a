"""The one place that knows the front end: Modelica text in, ``FlatModel`` out.

rumoca parses, resolves inheritance, components and connections, and checks types; its "flat" dictionary is turned into
our own types here. Versions other than the pinned ones are refused, because the dictionary has no contract.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from hystid.errors import ModelicaError
from hystid.modelica.adapter import Adapter
from hystid.modelica.annotations import description_of, experiment_of
from hystid.modelica.diagnostics import explain, located_syntax_error
from hystid.modelica.flat import FlatModel
from hystid.modelica.sources import Source, declaration

_WRAPPER = "HystidStructure"


def flatten(
    name: str,
    files: Sequence[Source],
    library: Sequence[Source],
    roots: Sequence[Path],
    structure: Mapping[str, float],
) -> FlatModel:
    """The flat model of class ``name``.

    files: texts given by the user. library: every file below ``roots``, the folders above directory packages.
    structure: values of parameters that decide sizes or which equations exist.
    Raises ModelicaError with file and line.
    """
    dictionary = _load(name, files, library, roots, structure)
    flat = Adapter(name, (*files, *library)).model(dictionary)
    declared = declaration(name, (*files, *library))
    return replace(flat, description=description_of(declared), experiment=experiment_of(declared))


def _load(
    name: str, files: Sequence[Source], library: Sequence[Source], roots: Sequence[Path], structure: Mapping[str, float]
) -> dict[str, Any]:
    rumoca = _front_end()
    session = rumoca.Session(roots=[str(r) for r in roots])
    wrapper = _wrapper(name, structure)
    texts = [(s.text, str(s.path)) for s in files] + [(wrapper, f"{_WRAPPER}.mo")]
    try:
        for text, path in texts[:-1]:
            _retain(rumoca, session, text, path)
        model = session.loads(wrapper, model=_WRAPPER, filename=texts[-1][1])
        dictionary: dict[str, Any] = model.to_dict("flat")
    except rumoca.RumocaError as error:
        located_syntax_error(rumoca.validate_source, files, library)
        raise explain(str(error), name, files, library) from None
    return dictionary


def _retain(rumoca: Any, session: Any, text: str, path: str) -> None:
    """Adds a file to the session. Compiling it is not wanted here; what is wrong with it shows at the final load."""
    try:
        session.loads(text, model=_WRAPPER, filename=path)
    except rumoca.RumocaError:
        return


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
