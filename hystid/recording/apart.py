"""Binary formats are read in a process of its own: their libraries crash on damaged files, or set aside what these say.

One process serves all files; after a crash the next file starts another.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hystid.child import Child, ChildError
from hystid.errors import RecordingError
from hystid.recording.table import Column, RawTable


@dataclass(frozen=True)
class Format:
    """module: below hystid.recording, with the function ``read_<module>``. package: what reads it; extra: of hystid."""

    name: str
    module: str
    package: str
    extra: str = ""


_HDF5 = Format("HDF5", "hdf5", "h5py", "hdf5")
_UNIVERSAL = Format("universal", "uff", "pyuff", "uff")
_MDF = Format("MDF", "mdf", "asammdf", "mdf")
_PARQUET = Format("Parquet", "parquet", "pyarrow", "parquet")
BINARY = {
    ".mat": Format("MATLAB", "mat", "scipy"),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".uff": _UNIVERSAL,
    ".unv": _UNIVERSAL,
    ".tdms": Format("TDMS", "tdms", "nptdms", "tdms"),
    ".mf4": _MDF,
    ".mdf": _MDF,
    ".parquet": _PARQUET,
    ".pq": _PARQUET,
}
_SLOW = 100e6  # bytes of a file that a slow disk gives in half of the usual time
_reader = Child()


def read_apart(path: Path) -> list[RawTable]:
    """The tables of a file of a binary format. Raises RecordingError with one sentence, whatever the file holds."""
    form = BINARY[path.suffix.lower()]
    if not _is_installed(form.package):
        raise RecordingError(
            f"{path.name}: reading {form.name} files needs the extra: pip install 'hystid[{form.extra}]'"
        )
    try:
        patience = 1.0 + path.stat().st_size / _SLOW
        found = _reader.ask("hystid.recording.apart:tables_there", patience, path=str(path.absolute()))
    except ChildError as fate:
        raise RecordingError(f"{path.name}: this is not a readable {form.name} file (its reader {fate})") from None
    return [_table(item) for item in found]


def _is_installed(package: str) -> bool:
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


def tables_there(path: str) -> list[dict[str, Any]]:
    """What the process is asked: the tables as mappings."""
    module = BINARY[Path(path).suffix.lower()].module
    tables = getattr(import_module(f"hystid.recording.{module}"), f"read_{module}")(Path(path))
    return [vars(table) | {"columns": [vars(column) for column in table.columns]} for table in tables]


def _table(item: Mapping[str, Any]) -> RawTable:
    return RawTable(**{**item, "columns": tuple(Column(**column) for column in item["columns"])})
