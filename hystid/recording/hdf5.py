"""HDF5 files, and MATLAB's version 7.3 files, which are HDF5 with conventions of their own (extra ``hdf5``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hystid.errors import RecordingError
from hystid.recording.names import decoded
from hystid.recording.table import RawTable
from hystid.recording.tree import Vector, refuse_scale, tables_of

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def is_hdf5(path: Path) -> bool:
    """Whether the file has HDF5's signature at one of the places where it may stand (MATLAB puts it at 512)."""
    with path.open("rb") as file:
        for offset in (0, 512, 1024, 2048):
            file.seek(offset)
            if file.read(8) == _SIGNATURE:
                return True
    return False


def read_hdf5(path: Path) -> list[RawTable]:
    """Tests in an HDF5 file: datasets named like channels, in the root or in one group per test.

    The unit is the dataset's attribute ``unit`` or ``units``; a group's attribute ``fs`` or ``dt`` gives the time axis.
    Raises RecordingError where there are none, or no HDF5 file.
    """
    found = tables_of(hdf5_tree(path), path.name, path.stem)
    if not found:
        raise RecordingError(
            f"{path.name}: no group holds datasets named t, F and x; name them so and give each an attribute 'unit'"
        )
    return found


def hdf5_tree(path: Path) -> dict[str, Any]:
    """Groups as mappings, datasets as ``Vector``, MATLAB's texts and references resolved. Raises RecordingError."""
    try:
        import h5py
    except ImportError:
        raise RecordingError(f"{path.name}: reading HDF5 needs the extra: pip install 'hystid[hdf5]'") from None
    try:
        with h5py.File(path, "r") as file:
            return dict(_group(file, file))
    except OSError as error:
        raise RecordingError(f"{path.name}: this is not a readable HDF5 file ({error})") from None


def _group(group: Any, file: Any) -> dict[str, Any]:
    scalars = {key: _plain(value) for key, value in group.attrs.items() if not key.startswith("MATLAB")}
    members = {key: _node(group[key], file) for key in group if not key.startswith("#") and _is_within(group, key)}
    return _struct_array({**scalars, **members})


def _is_within(group: Any, key: str) -> bool:
    """Whether a member lies in this file: links to other files are not followed."""
    import h5py

    return isinstance(group.get(key, getlink=True), h5py.HardLink | h5py.SoftLink)


def _node(item: Any, file: Any) -> Any:
    if hasattr(item, "items"):
        return _group(item, file)
    if item.external or item.is_virtual:
        raise RecordingError(
            f"{Path(file.filename).name}: '{item.name}' takes its values from other files; copy them in"
        )
    if item.dtype.kind == "O":
        return [_referred(entry, file) for entry in np.asarray(item[()], dtype=object).ravel()]
    values = item[()]
    if _plain(item.attrs.get("MATLAB_class")) == "char":
        return "".join(chr(int(code)) for code in np.asarray(values).ravel(order="F"))
    if isinstance(values, np.ndarray) and values.size > max(values.shape, default=1):
        return values  # a matrix
    if np.asarray(values).dtype.kind in "fiub":
        stated = {key.casefold(): value for key, value in item.attrs.items()}
        unit = stated.get("unit", stated.get("units"))
        for key, value in item.attrs.items():
            refuse_scale(Path(file.filename).name, item.name.rpartition("/")[2], key, value)
        counts = np.asarray(values).dtype.kind in "iu"
        return Vector(np.asarray(values, dtype=np.float64).ravel(), None if unit is None else str(_plain(unit)), counts)
    return _plain(values)


def _referred(entry: Any, file: Any) -> Any:
    try:
        return _node(file[entry], file)
    except (TypeError, ValueError, KeyError, AttributeError):  # a text or a null reference
        return _plain(entry)


def _struct_array(members: dict[str, Any]) -> dict[str, Any]:
    """MATLAB stores a struct array as one list per field; turn it into one mapping per element."""
    lists = {key: item for key, item in members.items() if isinstance(item, list)}
    lengths = {len(item) for item in lists.values()}
    if len(lists) < 2 or len(lengths) != 1:
        return members
    rest = {key: item for key, item in members.items() if key not in lists}
    elements = [{key: item[k] for key, item in lists.items()} for k in range(lengths.pop())]
    return {**rest, "tests": elements}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return decoded(value)
    if isinstance(value, np.ndarray) and value.size == 1:
        return _plain(value.ravel()[0])
    return value.item() if isinstance(value, np.generic) else value
