"""The effects that are tried: all of ``HystId.Effects``, and the user's own blocks; compiled once, then cached.

The cache holds the generated C and what was found out about the parameters, under a hash of everything that decides
them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

from hystid import cache as store
from hystid.compiled import CompiledModel
from hystid.diagnosis.model.catalogue import with_laws
from hystid.diagnosis.model.effects import Effect, effect_of
from hystid.diagnosis.model.semantics import KEYWORD, semantics_of
from hystid.errors import UsageError
from hystid.files import text_of
from hystid.modelcode import Variable, code_data, code_of
from hystid.modelica import compile_model
from hystid.modelica.reach import names_of_models
from hystid.modelica.sources import library_folder
from hystid.modelica.vendor import vendor_annotation
from hystid.progress import track

_PACKAGE = "HystId.Effects"


def load_effects(own: Sequence[Path] = ()) -> list[Effect]:
    """All effects of the library, and those of the user's ``.mo`` files (one or more blocks each).

    Raises ModelicaError where a block does not compile, UsageError where it is not an effect.
    """
    names = [f"{_PACKAGE}.{path.stem}" for path in sorted((library_folder() / "HystId" / "Effects").glob("*.mo"))]
    names = [name for name in names if not name.endswith(".package")]
    names += [name for path in dict.fromkeys(own) for name in _own_blocks(path)]
    found = []
    with track("effects", len(names)) as step:
        for name in names:
            found.append(_effect(name, _digest(name)))
            step(text=name.rpartition(".")[2])
    _check_apart(found)
    return with_laws(found)


def _check_apart(effects: Sequence[Effect]) -> None:
    """Raises UsageError where two blocks are one form of one law: the one would be told in the words of the other."""
    known: dict[tuple[str, str], str] = {}
    for effect in effects:
        other = known.setdefault((effect.id, effect.form), effect.class_name)
        if other is not effect.class_name:
            name = effect.class_name.rpartition(":")[2].rpartition(".")[2]
            raise UsageError(
                f"--effects {effect.class_name}: there is {other} already: give the block another name, as My{name}; "
                f"another form of that law is {name.partition('__')[0]}__Form"
            )


def _own_blocks(path: Path) -> list[str]:
    text_of(path, UsageError)  # a file that cannot be read is refused in the words of an option
    blocks = names_of_models(path)
    if not blocks:
        raise UsageError(
            f"--effects {path}: no block was found; write one that extends HystId.Interfaces.PartialEffect"
        )
    return [f"{path}:{block}" for block in blocks]


@cache
def _effect(name: str, digest: str) -> Effect:
    """A block, as it is in a file with this digest, with what it declares of itself."""
    made = _compiled(name, digest)
    assert made.model is not None
    said = semantics_of(vendor_annotation(name, KEYWORD), made.model.code.variables, made.amplitudes)
    return replace(made, semantics=said)


def _compiled(name: str, digest: str) -> Effect:
    entry = f"{digest}.json"
    place = store.find(entry)
    if place is not None:
        return _restored(json.loads(place.read_bytes()))
    code = compile_model(name)
    made = effect_of(name, code)
    facts = {item.name: getattr(made, item.name) for item in fields(made) if item.name not in ("model", "semantics")}
    kept = {"effect": {**facts, "shapes": [asdict(shape) for shape in made.shapes]}, "code": code_data(code)}
    store.keep_bytes(entry, json.dumps(kept).encode())
    return made


def _restored(kept: Mapping[str, Any]) -> Effect:
    facts = {**kept["effect"], "shapes": [Variable(**shape) for shape in kept["effect"]["shapes"]]}
    facts["choices"] = {name: tuple(values) for name, values in facts["choices"].items()}
    listed: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in facts.items()}
    return Effect(model=CompiledModel(code_of(kept["code"])), **listed)


def _digest(name: str) -> str:
    """Hash of the block, and of what all blocks share."""
    file, _, _ = name.rpartition(":")
    block = Path(file) if file else library_folder() / "HystId" / "Effects" / f"{name.rpartition('.')[2]}.mo"
    return hashlib.sha256(name.encode() + _shared() + block.read_bytes()).hexdigest()[:32]


@cache
def _shared() -> bytes:
    """Hash of the interfaces, and of the code that compiles and classifies."""
    here = Path(__file__).parent
    package = here.parents[1]
    files = [here / "effects.py", here / "library.py", package / "modelcode.py"]
    files += sorted((package / "modelica").glob("*.py"))
    files += sorted((library_folder() / "HystId" / "Interfaces").glob("*.mo"))
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    return digest.digest()
