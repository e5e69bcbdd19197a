"""MATLAB files: version 5 through scipy, version 7.3 (an HDF5 file) through h5py."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.exceptions import ComplexWarning

from hystid.errors import RecordingError
from hystid.recording.hdf5 import hdf5_tree, is_hdf5
from hystid.recording.table import RawTable
from hystid.recording.tree import tables_of

_HINT = "save plain variables or a struct, as: t, F, x and units = struct('t','s','F','N','x','mm')"


def read_mat(path: Path) -> list[RawTable]:
    """Tests in a .mat file: plain variables, a struct, or a struct array with one element per test.

    Raises RecordingError when it is no MATLAB file or holds none of these.
    """
    tree = hdf5_tree(path) if is_hdf5(path) else _version_5(path)
    found = tables_of(tree, path.name, path.stem)
    if not found:
        held = ", ".join(sorted(tree)) or "nothing"
        raise RecordingError(f"{path.name}: no test was found among the variables ({held}); {_HINT}")
    return found


def _version_5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", ComplexWarning)
            variables = loadmat(path, simplify_cells=True, mat_dtype=True)
        if told:  # types as MATLAB had them lose the imaginary part; as they are stored, they keep it
            variables = loadmat(path, simplify_cells=True)
    except Exception as error:  # scipy raises ValueError, TypeError, IndexError, struct.error ... on broken files
        raise RecordingError(f"{path.name}: this is not a readable MATLAB file ({error}); {_HINT}") from None
    opaque = [name for name, item in variables.items() if isinstance(item, MatlabOpaque)]
    if opaque or "None" in variables:
        raise RecordingError(
            f"{path.name}: it holds a MATLAB table, timeseries or other object, which cannot be read outside MATLAB;"
            " save table2struct(T,'ToScalar',true) instead"
        )
    return {name: _plain(item) for name, item in variables.items() if not name.startswith("__")}


def _plain(item: Any) -> Any:
    if isinstance(item, dict):
        return {key: _plain(value) for key, value in item.items()}
    if isinstance(item, np.ndarray) and item.dtype == object:
        return [_plain(value) for value in item.ravel()]
    if isinstance(item, list):
        return [_plain(value) for value in item]
    return item
