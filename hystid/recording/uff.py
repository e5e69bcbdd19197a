"""Universal File Format, data set 58 (extra ``uff``): the exchange format of modal test systems."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from hystid.errors import RecordingError
from hystid.recording.table import Column, RawTable, clocks_apart

# Specific data types of data set 58's ordinate and the SI unit that the format prescribes for unlabelled data
_QUANTITIES = {8: ("x", "m"), 11: ("v", "m/s"), 12: ("a", "m/s2"), 13: ("F", "N")}
_TIME_RESPONSE = (0, 1)  # function types: general, time response


def read_uff(path: Path) -> list[RawTable]:
    """One test: the time responses in the file, evenly spaced, each on the channel that its ordinate type states.

    Several responses of one type keep the type's channel for the first and become extra columns after that.
    Raises RecordingError where there are none, or no universal file.
    """
    import pyuff

    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # pyuff raises plain Exception, IndexError, ValueError ... on broken files
        raise RecordingError(f"{path.name}: this is not a readable universal file ({error})") from None
    sets = sets if isinstance(sets, list) else [sets]
    responses = [item for item in sets if item.get("type") == 58 and item.get("func_type") in _TIME_RESPONSE]
    if not responses:
        raise RecordingError(
            f"{path.name}: it holds no time response (data set 58); export time histories, not spectra"
        )
    return [_table(path, responses, _sizes(path, sets))]


def _sizes(path: Path, sets: list[dict[str, Any]]) -> dict[str, float]:
    """How many units of the file are one m and one N, by data set 164. Without it, and by its code 1, they are SI."""
    stated = next((item for item in sets if item.get("type") == 164 and item.get("units_code") != 1), {})
    sizes = {name: float(stated.get(name, 1.0)) for name in ("length", "force")}
    for name, size in sizes.items():
        if not 0 < size < math.inf:
            found = f"data set 164 gives a {name} of {size:g} units"
            raise RecordingError(f"{path.name}: {found}; write the units of the file there, or leave the data set out")
    return sizes


def _table(path: Path, responses: list[dict[str, Any]], sizes: dict[str, float]) -> RawTable:
    columns: dict[str, Column] = {}
    time = np.asarray(responses[0]["x"], dtype=np.float64)
    for number, response in enumerate(responses, start=1):
        name, unit = _QUANTITIES.get(int(response.get("ordinate_spec_data_type", 0)), (f"channel_{number}", ""))
        label = str(response.get("ordinate_axis_units_lab", "")).strip().strip("\0")
        name = name if name not in columns else f"{name}_{number}"
        labelled = bool(label) and label.upper() != "NONE"
        values = np.asarray(response["data"])
        if np.any(np.imag(values)):
            raise RecordingError(f"{path.name}: {name} holds complex numbers; export the measured values, not spectra")
        size = 1.0 if labelled or not unit else sizes["force" if unit == "N" else "length"]
        columns[name] = Column(name, (label if labelled else unit) or None, np.real(values).astype(np.float64) / size)
        if apart := clocks_apart(time, np.asarray(response["x"], dtype=np.float64)):
            raise RecordingError(f"{path.name}: {name} {apart} that of {next(iter(columns))}; export one test per file")
    if any(column.values.size != time.size for column in columns.values()):
        raise RecordingError(f"{path.name}: its time responses differ in length; export one test per file")
    return RawTable(path.name, (Column("t", "s", time), *columns.values()), path.stem)
