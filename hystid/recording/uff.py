"""Universal File Format, data set 58 (extra ``uff``): the exchange format of modal test systems."""

from __future__ import annotations

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
    return [_table(path, responses)]


def _table(path: Path, responses: list[dict[str, Any]]) -> RawTable:
    columns: dict[str, Column] = {}
    time = np.asarray(responses[0]["x"], dtype=np.float64)
    for number, response in enumerate(responses, start=1):
        name, unit = _QUANTITIES.get(int(response.get("ordinate_spec_data_type", 0)), (f"channel_{number}", ""))
        label = str(response.get("ordinate_axis_units_lab", "")).strip().strip("\0")
        name = name if name not in columns else f"{name}_{number}"
        stated = label if label and label.upper() != "NONE" else unit
        values = np.asarray(response["data"])
        if np.any(np.imag(values)):
            raise RecordingError(f"{path.name}: {name} holds complex numbers; export the measured values, not spectra")
        columns[name] = Column(name, stated or None, np.real(values).astype(np.float64))
        if apart := clocks_apart(time, np.asarray(response["x"], dtype=np.float64)):
            raise RecordingError(f"{path.name}: {name} {apart} that of {next(iter(columns))}; export one test per file")
    if any(column.values.size != time.size for column in columns.values()):
        raise RecordingError(f"{path.name}: its time responses differ in length; export one test per file")
    return RawTable(path.name, (Column("t", "s", time), *columns.values()), path.stem)
