"""Modelica text through the compiler and the shell into another importer, FMI 2 and 3, both kinds of solver."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from hystid.fmu import build_model

MODEL = Path(__file__).parent / "models" / "Assertions.mo"


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_an_assertion_of_level_error_stops_the_run(fmi, kind, tmp_path):
    fmu = build_model(f"{MODEL}:Assertions", tmp_path / "a.fmu", fmi=fmi).path
    ramp = np.array([(0.0, 0.0), (1.0, 2.0)], dtype=[("time", float), ("u", float)])
    said: list[str] = []
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(
            str(fmu),
            fmi_type=kind,
            stop_time=1.0,
            output_interval=0.01,
            input=ramp,
            logger=lambda *a: said.append(str(a)),
        )
    assert any("u is far above its limit" in text for text in said)
