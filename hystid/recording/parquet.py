"""Parquet files, by ``pyarrow``: one test per file; units in the column's name or in its metadata under "unit"."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hystid.errors import RecordingError
from hystid.recording.names import decoded, split_header
from hystid.recording.table import Column, RawTable, clock_seconds


def read_parquet(path: Path) -> list[RawTable]:
    """The table of a Parquet file. Raises RecordingError where the file is none."""
    from pyarrow import ArrowException
    from pyarrow.parquet import ParquetFile
    from pyarrow.types import is_decimal

    try:
        with ParquetFile(path) as file:
            table = file.read()
    except (ArrowException, OSError) as error:
        raise RecordingError(f"{path.name}: this is no Parquet file that can be read ({error})") from None
    columns = []
    for field, values in zip(table.schema, table.columns, strict=True):
        name, unit = split_header(field.name)
        told = {decoded(key).casefold(): decoded(value) for key, value in (field.metadata or {}).items()}
        stated = told.get("unit") or told.get("units") or unit
        array = (values.cast("float64") if is_decimal(field.type) else values).to_numpy()
        if (stamps := clock_seconds(array)) is not None:
            array, stated = stamps, "s"
        if array.dtype.kind in "fiub":
            counts = array.dtype.kind in "iu"
            columns.append(Column(name, stated, np.ascontiguousarray(array, dtype=np.float64), counts))
    if not columns:
        names = ", ".join(table.schema.names) or "none"
        raise RecordingError(f"{path.name}: no column holds numbers (the columns are {names}); store them as numbers")
    return [RawTable(path.name, tuple(columns), path.stem)]
