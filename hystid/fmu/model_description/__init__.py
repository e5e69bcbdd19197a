"""``modelDescription.xml`` for FMI 2.0 and FMI 3.0, from one description of the model."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from hystid.fmu.about import About
from hystid.fmu.interface import Interface
from hystid.fmu.model_description import fmi2, fmi3
from hystid.fmu.model_description.common import text_of

__all__ = ["model_description"]

_NOTHING = About()


def model_description(
    model: Interface, version: int, *, generated: datetime, sources: Sequence[str], about: About = _NOTHING
) -> str:
    """XML text. version: 2 or 3. generated: time in UTC. sources: names of the C files below ``sources/``."""
    root = fmi2.describe(model, generated, sources) if version == 2 else fmi3.describe(model, generated)
    for name, text in about.attributes().items():
        root.set(name, text)
    return text_of(root)
