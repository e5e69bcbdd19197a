"""The effects that are tried: all of ``HystId.Effects``, and the user's own blocks; compiled once, then cached.

The cache holds the generated C and what was found out about the parameters, under a hash of everything that decides
them.
"""

from __future__ import annotations

import hashlib
import pickle
import re
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

from hystid.compiled import CompiledModel
from hystid.diagnosis.blocks import Effect, effect_of
from hystid.errors import UsageError
from hystid.files import atomic
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.modelica.sources import library_folder
from hystid.progress import track
from hystid.toolchain import cache_folder

_PACKAGE = "HystId.Effects"
_BLOCK = re.compile(r"^\s*(?:block|model)\s+([A-Za-z_]\w*)", re.MULTILINE)


def load_effects(own: Sequence[Path] = ()) -> list[Effect]:
    """All effects of the library, and those of the user's ``.mo`` files (one or more blocks each).

    Raises ModelicaError where a block does not compile, UsageError where it is not an effect.
    """
    names = [f"{_PACKAGE}.{path.stem}" for path in sorted((library_folder() / "HystId" / "Effects").glob("*.mo"))]
    names = [name for name in names if not name.endswith(".package")]
    names += [name for path in own for name in _own_blocks(path)]
    found = []
    with track("effects", len(names)) as step:
        for name in names:
            found.append(_effect(name))
            step(text=name.rpartition(".")[2])
    return found


def _own_blocks(path: Path) -> list[str]:
    if not path.is_file():
        raise UsageError(f"--effects {path}: there is no such file")
    blocks = _BLOCK.findall(path.read_text(encoding="utf-8"))
    if not blocks:
        raise UsageError(
            f"--effects {path}: no block was found; write one that extends HystId.Interfaces.PartialEffect"
        )
    return [f"{path}:{block}" for block in blocks]


@cache
def _effect(name: str) -> Effect:
    place = cache_folder() / f"effect_{_digest(name)}.pickle"
    if place.exists():
        kept: tuple[Effect, ModelCode] = pickle.loads(place.read_bytes())
        bare, code = kept
        if set(vars(bare)) == {item.name for item in fields(Effect)}:  # written by this version of the class
            return _with_model(bare, code)
    code = compile_model(name)
    made = effect_of(name, code)
    with atomic(place) as beside:
        beside.write_bytes(pickle.dumps((_with_model(made, None), code)))
    return made


def _with_model(effect: Effect, code: ModelCode | None) -> Effect:
    return replace(effect, model=CompiledModel(code) if code else None)


def _digest(name: str) -> str:
    """Hash of the block, the interfaces, and the code that compiles and classifies."""
    here = Path(__file__).parent
    files = [here / "blocks.py", here / "library.py", *sorted((here.parent / "modelica").glob("*.py"))]
    files += sorted((library_folder() / "HystId" / "Interfaces").glob("*.mo"))
    file, _, _ = name.rpartition(":")
    files.append(Path(file) if file else library_folder() / "HystId" / "Effects" / f"{name.rpartition('.')[2]}.mo")
    digest = hashlib.sha256(name.encode())
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:32]
