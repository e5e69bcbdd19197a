"""hystid: Modelica/FMI co-simulation for structures that slide, stick, open and close.

    import hystid

    sweep = hystid.read("sweep.csv")                        # t, F, x, v, a in SI units
    why = hystid.diagnose([sweep], model="HystId.Oscillators.Jenkins", parameters={"m": 4.2})
    print(why.summary())
    why.plot()                                              # a plotly figure
    why.save("why")                                         # diagnosis.json, models, report.html

m a + R = F, SI units throughout; R opposes motion as a spring does. Names load when they are first used, so that
``import hystid`` is quick. What is wrong with an input is raised as a ``HystidError`` with one clear sentence.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hystid import study
    from hystid.building import build
    from hystid.consistency import check
    from hystid.diagnosis import Diagnosis, diagnose  # type: ignore[no-redef]  # its module has the same name
    from hystid.errors import HystidError
    from hystid.fmu import BuildResult, Driver, RegressionResult, regress  # type: ignore[no-redef]  # its module has the same name
    from hystid.identification import Identification, identify
    from hystid.processing import prepare
    from hystid.recording import Recording, read, read_all
    from hystid.simulation import simulate
    from hystid.validation import Validation, validate
    from hystid.virtual_experiment import demo

    __version__: str

_HOMES = {
    "BuildResult": "hystid.fmu",
    "Diagnosis": "hystid.diagnosis",
    "Driver": "hystid.fmu",
    "HystidError": "hystid.errors",
    "Identification": "hystid.identification",
    "Recording": "hystid.recording",
    "RegressionResult": "hystid.fmu",
    "Validation": "hystid.validation",
    "build": "hystid.building",
    "check": "hystid.consistency",
    "demo": "hystid.virtual_experiment",
    "diagnose": "hystid.diagnosis",
    "identify": "hystid.identification",
    "prepare": "hystid.processing",
    "read": "hystid.recording",
    "read_all": "hystid.recording",
    "regress": "hystid.fmu",
    "simulate": "hystid.simulation",
    "validate": "hystid.validation",
}

__all__ = [
    "BuildResult",
    "Diagnosis",
    "Driver",
    "HystidError",
    "Identification",
    "Recording",
    "RegressionResult",
    "Validation",
    "__version__",
    "build",
    "check",
    "demo",
    "diagnose",
    "identify",
    "prepare",
    "read",
    "read_all",
    "regress",
    "simulate",
    "study",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("hystid")
    elif name == "study":
        value = import_module("hystid.study")
    elif name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module 'hystid' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
