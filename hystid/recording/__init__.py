"""Recordings: the type, readers (CSV, MAT, HDF5, UFF, TDMS), the writer, and the checks at the door."""

from hystid.recording.types import CHANNELS, Array, Recording

__all__ = ["CHANNELS", "Array", "Recording"]
