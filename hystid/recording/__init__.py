"""Recordings: the type, readers (CSV, MAT, HDF5, UFF, TDMS), the writer, and the checks at the door."""

from hystid.numeric import Array
from hystid.recording.columns import mass_texts, own_mass, with_column, with_columns, with_masses
from hystid.recording.loading import Source, Sources, loaded
from hystid.recording.problems import RecordingProblem, report
from hystid.recording.reading import read, read_all
from hystid.recording.together import check_together
from hystid.recording.types import CHANNELS, Recording, write_csv

__all__ = [
    "CHANNELS", "Array", "Recording", "RecordingProblem", "Source", "Sources", "check_together", "loaded", "mass_texts",
    "own_mass", "read", "read_all", "report", "with_column", "with_columns", "with_masses", "write_csv",
]  # fmt: skip
