"""FMUs: built from any ``ModelCode``, opened and driven whoever built them, and replayed against their reference."""

from __future__ import annotations

from hystid.fmu.about import About
from hystid.fmu.build import BuildResult, build
from hystid.fmu.closed_loop import write_rig
from hystid.fmu.driver import Driver
from hystid.fmu.from_modelica import build_model
from hystid.fmu.from_network import build_network
from hystid.fmu.regress import RegressionResult, regress
from hystid.fmu.ssp import Connection, write_ssp

__all__ = [
    "About",
    "BuildResult",
    "Connection",
    "Driver",
    "RegressionResult",
    "build",
    "build_model",
    "build_network",
    "regress",
    "write_rig",
    "write_ssp",
]
