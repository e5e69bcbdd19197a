"""Files of an identification: models and identification.json, written beside and renamed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hystid.files import atomic, write_json
from hystid.identification.result import Identification


def write(result: Identification, folder: Path) -> Identification:
    """Write surrogate.onnx, surrogate.fmu, oscillator.fmu (where there is a mass), hybrid.mo and hybrid.fmu (where
    one is offered) and identification.json.

    Returns the result with ``files`` filled in. identification.json comes last: where it stands, all is whole.
    """
    from hystid.fmu import build
    from hystid.identification.hybrid.package import OSCILLATOR
    from hystid.modelica import compile_model
    from hystid.networks import onnx
    from hystid.surrogate import oscillator_code, surrogate_code

    folder.mkdir(parents=True, exist_ok=True)
    files = {"onnx": folder / "surrogate.onnx", "surrogate": folder / "surrogate.fmu"}
    onnx.write(result.model, files["onnx"])
    build(surrogate_code(files["onnx"]), files["surrogate"])
    if result.model.mass:
        files["oscillator"] = folder / "oscillator.fmu"
        build(oscillator_code(files["onnx"]), files["oscillator"])
    if result.hybrid and result.hybrid.offered:
        files |= {"hybrid_package": folder / "hybrid.mo", "hybrid": folder / "hybrid.fmu"}
        with atomic(files["hybrid_package"]) as beside:
            beside.write_text(result.hybrid.text, encoding="utf-8")
        build(compile_model(f"{files['hybrid_package']}:{OSCILLATOR}"), files["hybrid"])
    written = replace(result, files=files)
    write_json(folder / "identification.json", written.as_dict())
    return written
