"""The exceptions of hystid: one sentence each, saying where, which rule, and what to do.

HystidError
├── UsageError          an argument is wrong                                  -> exit code 2
├── RecordingError      a recording cannot be used (file, channel, sample)    -> exit code 2
├── ModelicaError       Modelica text is refused (file, line, construct)      -> exit code 2
├── NetworkError        an ONNX file is refused (node, operator)              -> exit code 2
├── FmuError            an FMU is refused, or a call into it failed           -> exit code 2
├── ToolchainError      no C compiler, or it failed                           -> exit code 1
└── NumericalError      a computation has no finite, converged answer         -> exit code 1
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

_LONGEST_WORD = 300  # characters: more than any path that people type
_LONGEST_LINE = 2000  # a screen full
_SPACES = ("Zs", "Zl", "Zp")


def printable(text: str, most: int = _LONGEST_LINE) -> str:
    """Text from a file as one line that can be shown: what does not print is escaped, the middle of too much is cut.

    A terminal obeys control characters, a page mixes up letters that run from right to left, and neither can write half
    a surrogate pair.
    """
    cut = text if len(text) <= most else f"{text[: most * 2 // 3]}[...]{text[len(text) - most // 4 :]}"
    return "".join(_shown(letter) for letter in cut)


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    if unicodedata.category(letter) in _SPACES:
        return " "
    return letter.encode("unicode_escape").decode("ascii")


def sentence(text: str) -> str:
    """Text for a message: ``printable``, and long names are cut."""
    return printable(re.sub(rf"\S{{{_LONGEST_WORD},}}", lambda word: printable(word[0], 120), text))


def reason(error: OSError) -> str:
    """What the system says, as part of a sentence: "permission denied"."""
    return (error.strerror or str(error)).lower()


def first_line(error: Exception, most: int = _LONGEST_LINE) -> str:
    """What went wrong, of a message of many lines; at most so many characters."""
    return next((line.strip()[:most] for line in str(error).splitlines() if line.strip()), type(error).__name__)


def listed(names: Sequence[str], most: int) -> str:
    """Names for a sentence, so many of them: "a, b and 3 more"."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def counted(n: int, what: str) -> str:
    """A number of things: "1 case", "2 cases"."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


class HystidError(Exception):
    """Base of everything that hystid raises on purpose; ``str(error)`` is the sentence a user reads, or one a line.

    Whatever names and texts of files it quotes, it prints: see ``printable``.
    """

    exit_code = 1

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(sentence(item) if isinstance(item, str) else item for item in arguments))

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))


class UsageError(HystidError):
    """An argument is wrong: names the argument, the rule, what was found, what to do."""

    exit_code = 2


class RecordingError(HystidError):
    """A recording cannot be used: names file, channel and sample."""

    exit_code = 2


class ModelicaError(HystidError):
    """Modelica text is refused: names file, line and construct, and the way around it."""

    exit_code = 2


class NetworkError(HystidError):
    """An ONNX file is refused: names the node and the operator."""

    exit_code = 2


class FmuError(HystidError):
    """An FMU is refused, or one of its functions returned an error."""

    exit_code = 2


class ToolchainError(HystidError):
    """No C compiler was found, or it refused generated code."""


class NumericalError(HystidError):
    """A computation has no finite, converged answer: says which, where, and what to try."""
