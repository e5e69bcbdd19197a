"""Writing a recording as CSV: SI units, full precision, provenance in comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hystid.files import atomic
from hystid.recording.types import CHANNELS, Recording


def write_csv(recording: Recording, path: str | Path, *, comments: tuple[str, ...] = ()) -> None:
    """Write ``t`` and every channel that is there, then the extra columns, atomically.

    Numbers are written with 17 significant digits, so that reading gives the same float64 values back for every
    channel. comments, the recording's notes and the origin of derived channels stand in lines that start with "#".
    """
    present = {name: getattr(recording, name) for name in CHANNELS if getattr(recording, name) is not None}
    time = "t_pseudo" if recording.quasi_static else "t"
    headers = [f"{time} [s]", *(f"{name} [{recording.unit(name)}]" for name in present), *_extra_headers(recording)]
    columns = [recording.t, *present.values(), *recording.extra.values()]
    derived = [f"{name}: {text}" for name, text in recording.origin.items() if text != "measured"]
    lines = [recording.name, *comments, *recording.notes, *derived]
    with atomic(Path(path)) as beside, beside.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {part}\n" for text in lines for part in text.splitlines())
        file.write(",".join(headers) + "\n")
        np.savetxt(file, np.column_stack(columns), fmt="%.17g", delimiter=",")


def _extra_headers(recording: Recording) -> list[str]:
    return [f"{name} [{recording.units[name]}]" if name in recording.units else name for name in recording.extra]
