"""Names: ONNX allows any text, C and FMI importers do not."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field

LONGEST = 60


def identifier(text: str) -> str:
    """ASCII letters, digits and underscores only, not starting with a digit; accents are dropped, the rest becomes '_'.

    Empty text gives "unnamed". Not unique by itself: see ``Names``.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    plain = re.sub(r"\W+", "_", plain, flags=re.ASCII).strip("_")[:LONGEST] or "unnamed"
    return "_" + plain if plain[0].isdigit() else plain


def readable(text: str) -> str:
    """Text for a C comment or a description: one line, no control characters, nothing that ends a comment."""
    one_line = "".join(c if c.isprintable() else " " for c in text)
    return one_line.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "?")[:200]


@dataclass
class Names:
    """Hands out identifiers, each once."""

    taken: set[str] = field(default_factory=set)

    def unique(self, text: str) -> str:
        """An identifier made of ``text``, with a number behind it where it is already taken."""
        base = identifier(text)
        name, number = base, 1
        while name.lower() in self.taken:  # some importers ignore case
            number += 1
            name = f"{base}_{number}"
        self.taken.add(name.lower())
        return name
