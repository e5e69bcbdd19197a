"""What is given hostile inputs: kind -> a file suffix and the call that reads such a file."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"


@dataclass(frozen=True)
class Target:
    """suffix: of the file that the input becomes. call: what reads it; it may raise HystidError, and nothing else."""

    suffix: str
    call: Callable[[Path], object]


def _recording(path: Path) -> object:
    from hystid.recording import read

    return read(path)


def _unit(path: Path) -> object:
    from hystid.units import exponents, is_modelica

    text = path.read_bytes().decode(errors="replace")
    return is_modelica(text), exponents(text)


def _parameters(path: Path) -> object:
    from hystid.cli.options import parameter_file
    from hystid.diagnosis.prepare.given import given_parameters

    parameter_file(path)
    return given_parameters(path)


def _fmu(path: Path) -> object:
    from hystid.fmu.door import open_fmu

    return open_fmu(path).model


def _description(path: Path) -> object:
    archive = path.with_suffix(".fmu")
    archive.write_bytes(_with_description(path.read_bytes()))
    return _fmu(archive)


def _with_description(text: bytes) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as new:
        for name, content in _others().items():
            new.writestr(name, content)
        new.writestr("modelDescription.xml", text)
    return made.getvalue()


@cache
def _others() -> dict[str, bytes]:
    with zipfile.ZipFile(CORPUS / "fmu" / "oscillator.fmu") as old:
        return {name: old.read(name) for name in old.namelist() if name != "modelDescription.xml"}


def _network(path: Path) -> object:
    from hystid.surrogate import model_code

    return model_code(path)


def _modelica(path: Path) -> object:
    from hystid.modelica import compile_model

    return compile_model(str(path))


TARGETS = {
    "csv": Target(".csv", _recording),
    "mat": Target(".mat", _recording),
    "hdf5": Target(".h5", _recording),
    "uff": Target(".uff", _recording),
    "tdms": Target(".tdms", _recording),
    "mdf": Target(".mf4", _recording),
    "parquet": Target(".parquet", _recording),
    "unit": Target(".txt", _unit),
    "parameters": Target(".json", _parameters),
    "fmu": Target(".fmu", _fmu),
    "description": Target(".xml", _description),
    "onnx": Target(".onnx", _network),
    "modelica": Target(".mo", _modelica),
}
