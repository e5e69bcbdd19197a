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


class HystidError(Exception):
    """Base of everything that hystid raises on purpose; ``str(error)`` is the sentence a user reads."""

    exit_code = 1


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
