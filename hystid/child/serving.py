"""The work of a child: requests in, answers and signs of life out."""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from hystid import errors
from hystid.child.frames import encoded, receive, write
from hystid.limits import FMU_UNPACKED

_log = logging.getLogger("hystid")
BEAT = 1.0  # s between two signs of life
_MESSAGES = 1000  # of one request that are passed on

_answers: IO[bytes] | None = None
_sending = threading.Lock()
_beats = 0


def is_child() -> bool:
    """Whether this process was started by ``Child``."""
    return _answers is not None


def beat() -> None:
    """A sign of life from work that takes long. It is counted, and told once a second: steps take microseconds."""
    global _beats
    _beats += 1


class _Told(logging.Handler):
    """Sends messages on, so many for one request: more tell nothing new, and bury what was said first."""

    left = _MESSAGES

    def emit(self, record: logging.LogRecord) -> None:
        self.left -= 1
        if self.left >= 0:
            text = record.getMessage() if self.left else "further messages of this call are left out"
            _tell({"log": record.levelno, "text": text})


def _tell(value: Mapping[str, Any]) -> None:
    assert _answers is not None
    with _sending:
        write(_answers, encoded(value))


def serve(memory: int) -> None:
    """Answer requests until there are no more. Standard output belongs to the code that is called from here on."""
    global _answers
    questions = os.fdopen(os.dup(0), "rb", buffering=0)
    _answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    _limit(memory)
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()
    told = _Told()
    _log.addHandler(told)
    _log.propagate = False
    while True:
        try:
            request = receive(questions, 1 << 40, 1 << 40)
        except (EOFError, OSError):
            _leave()
        told.left = _MESSAGES
        _tell(_answered(request))


def _answered(request: Mapping[str, Any]) -> dict[str, Any]:
    try:
        module, _, name = request["call"].partition(":")
        return {"answer": getattr(importlib.import_module(module), name)(**request["arguments"])}
    except Exception as error:  # whatever it is, it is told over there
        text = str(error).strip()
        known = isinstance(error, errors.HystidError)
        return {"error": type(error).__name__, "text": text if known else " ".join(text.split())[:500]}


def _limit(memory: int) -> None:
    try:
        import resource
    except ImportError:
        return
    try:  # what Python and its libraries have set aside by now does not count
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except (OSError, ValueError):
        taken = 0
    file = int(FMU_UNPACKED.value) << 20  # a log without end fills the disk; Python takes the signal for an error
    limits = ((resource.RLIMIT_AS, memory + taken), (resource.RLIMIT_CORE, 0), (resource.RLIMIT_FSIZE, file))
    for kind, size in limits:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (size, size))


def _watch(parent: int) -> None:
    """Pass on that the work goes on; end where the process that asks has been killed, whatever is being computed."""
    told = _beats
    while os.getppid() == parent:
        time.sleep(BEAT)
        if _beats != told:
            told = _beats
            with contextlib.suppress(OSError):
                _tell({"alive": True})
    _leave()


def _leave() -> None:
    """End, with what the code here has started."""
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(0)
