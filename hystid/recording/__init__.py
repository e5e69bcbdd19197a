"""Recordings: the type, readers (CSV, MAT, HDF5, UFF, TDMS), the writer, and the checks at the door."""

from hystid.recording.columns import with_column, with_columns
from hystid.recording.loading import Source, Sources, loaded
from hystid.recording.problems import Problem, report
from hystid.recording.reading import read, read_all
from hystid.recording.types import CHANNELS, Array, Recording, write_csv

__all__ = [
    "CHANNELS", "Array", "Problem", "Recording", "Source", "Sources", "loaded", "read", "read_all", "report",
    "with_column", "with_columns", "write_csv",
]  # fmt: skip
