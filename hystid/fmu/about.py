"""Who made a model, and under which terms: what the description of an FMU says beside the model itself."""

from __future__ import annotations

from dataclasses import dataclass, fields

from hystid.errors import UsageError


@dataclass(frozen=True)
class About:
    """Texts of the description, "" where nothing is said. version is that of the model, as "1.2.0"."""

    author: str = ""
    version: str = ""
    license: str = ""
    copyright: str = ""

    def __post_init__(self) -> None:
        for name, text in self.attributes().items():
            if not text.isprintable():
                raise UsageError(f"the {name} of an FMU must be one line of plain text, not {text!r}")

    def attributes(self) -> dict[str, str]:
        """Attributes of the description, in both versions of FMI."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: text for name, text in found.items() if text}
