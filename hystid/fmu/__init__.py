"""FMUs: built from any ``ModelCode``, opened and driven whoever built them, and replayed against their reference."""

from __future__ import annotations

from hystid.fmu.build import BuildResult, build

__all__ = ["BuildResult", "build"]
