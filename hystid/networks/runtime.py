"""ONNX Runtime as a second opinion: whether a surrogate's ONNX file computes what our own code computes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from hystid.errors import NetworkError, first_line
from hystid.numeric import Array

_SAMPLES = 64
_AGREED = 1e-6  # of the greatest force: the two sum in different orders, and the memory feeds roundings back


def check(
    content: bytes,
    path: Path,
    training_range: Mapping[str, tuple[float, float]],
    state: Sequence[float],
    ours: Callable[[Mapping[str, Array]], Array],
) -> str:
    """Compare forces on a motion through the training range; "", or why ONNX Runtime cannot run the file.

    content: of the file at path, which messages name. state: before the first sample. ours: R of each sample from the
    inputs besides the state, shape (n,) each. Raises NetworkError where the forces differ.
    """
    import onnxruntime  # takes 0.1 s and memory that writing an FMU need not spend

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = 1, 3
    theirs, memory = np.empty(_SAMPLES), np.array([state])
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        names = [port.name for port in session.get_inputs() if port.name != "state"]
        signals = _motion(names, training_range)
        for k in range(_SAMPLES):
            sample = {name: values[k : k + 1] for name, values in signals.items()}
            (theirs[k],), memory = session.run(["R", "state_next"], {**sample, "state": memory})
    except Exception as error:  # of several types, where an operator or its version is missing
        return first_line(error, 160)
    expected = ours(signals)
    apart = np.abs(theirs - expected)
    if not apart.max() <= _AGREED * max(np.abs(expected).max(), np.abs(theirs).max()):
        k = int(np.argmax(apart))
        raise NetworkError(
            f"{path}: ONNX Runtime computes R = {theirs[k]:.9g} where this program computes {expected[k]:.9g}; "
            "please report this as an error of the program"
        )
    return ""


def _motion(names: Sequence[str], training_range: Mapping[str, tuple[float, float]]) -> dict[str, Array]:
    """Inputs that go through their training ranges, each with a frequency of its own."""
    found = {}
    for number, name in enumerate(names):
        low, high = training_range.get(name, (-1.0, 1.0))
        angle = (0.37 + 0.11 * number) * np.arange(_SAMPLES) + number
        found[name] = low + (high - low) * (0.5 + 0.5 * np.sin(angle))
    return found
