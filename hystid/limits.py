"""What a file of unknown origin may cost. Each limit has a name; an environment variable of that name raises it."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from hystid.errors import UsageError


@dataclass(frozen=True)
class Limit:
    """A budget. name: of the environment variable; unit: "" for a plain number."""

    name: str
    usual: float
    unit: str
    bounds: str

    @property
    def value(self) -> float:
        """What holds now. Raises UsageError where the environment variable is no positive number."""
        text = os.environ.get(self.name)
        if text is None:
            return self.usual
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if not value > 0:
            raise UsageError(f"{self.name}={text}: a positive number is needed")
        return value

    def __str__(self) -> str:
        return f"{self.value:g}{f' {self.unit}' if self.unit else ''} ({self.name} raises this)"


# Set by what they cost, with room above what tools write: 32 MB of description are some 100,000 variables and take ten
# seconds to read; 512 MB fit into the memory of any machine that has its temporary folder there.
FMU_DESCRIPTION = Limit("HYSTID_FMU_DESCRIPTION_MB", 32, "MB", "modelDescription.xml")
FMU_UNPACKED = Limit("HYSTID_FMU_UNPACKED_MB", 512, "MB", "all entries of an FMU, unpacked")
FMU_ENTRIES = Limit("HYSTID_FMU_ENTRIES", 10_000, "", "entries of an FMU")
FMU_ELEMENTS = Limit("HYSTID_FMU_ELEMENTS", 1_000_000, "", "numbers in the variables of an FMU, arrays included")
# A call of a model takes micro- to milliseconds; nobody waits half a minute for one without thinking it hangs.
CHILD_SECONDS = Limit("HYSTID_CHILD_SECONDS", 30, "s", "one call into a foreign FMU, or one file of a binary format")
CHILD_MEMORY = Limit("HYSTID_CHILD_MEMORY_MB", 8192, "MB", "memory of a foreign FMU, or of a reader of binary files")
# The largest model within the other limits compiles in a fraction of this; passes that take longer grow without end.
COMPILE_SECONDS = Limit("HYSTID_COMPILE_SECONDS", 60, "s", "computing time of one compilation, without the C compiler")

_T = TypeVar("_T")
_STACK = 256 << 20  # bytes, of which only what is used is taken
_DEPTH = 20_000  # Python calls: expressions nested some 5,000 deep
_LOOK = 0.25  # s between looks at the clock, at most
_ONE_AT_A_TIME = threading.RLock()  # stack size and depth of recursion belong to the whole process


class OutOfTime(BaseException):
    """Work took longer than it may. No ``except Exception`` on its way holds it up."""


def bounded(work: Callable[[], _T]) -> _T:
    """The work done on a large stack, since passes over expressions recurse as deep as these are nested.

    Raises OutOfTime after COMPILE_SECONDS of computing (time that another process has the processor does not count),
    and what the work raises, RecursionError among it. Within bounded work this is a plain call.
    """
    if getattr(_inside, "yes", False):
        return work()
    done: Future[_T] = Future()
    before = sys.getrecursionlimit()
    thread = threading.Thread(target=_do, args=(work, done), daemon=True)
    with _ONE_AT_A_TIME:
        stack = threading.stack_size(_STACK)
        try:
            sys.setrecursionlimit(max(before, _DEPTH))
            thread.start()
        finally:
            threading.stack_size(stack)
    try:
        return _waited(done, thread, COMPILE_SECONDS.value)
    finally:
        sys.setrecursionlimit(before)


_inside = threading.local()


def _do(work: Callable[[], _T], done: Future[_T]) -> None:
    with suppress(OutOfTime):  # one that comes before the work begins, or after it is done
        _inside.yes = True
        try:
            done.set_result(work())
        except BaseException as error:  # told where the result is asked for
            done.set_exception(error)


def _waited(done: Future[_T], thread: threading.Thread, seconds: float) -> _T:
    begin, look = time.monotonic(), min(_LOOK, seconds)
    try:
        while not wait_for([done], look).done:
            if not thread.is_alive() and not done.done():
                raise OutOfTime
            if thread.is_alive() and _computed(thread, begin) > seconds:
                _stop(thread)
                seconds += COMPILE_SECONDS.value  # what catches it has as long again to put things away
    except BaseException:  # Ctrl-C
        _stop(thread)
        raise
    return done.result()


def _stop(thread: threading.Thread) -> None:
    assert thread.ident is not None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(OutOfTime))


def _computed(thread: threading.Thread, begin: float) -> float:
    """Seconds of processor time of a thread; those since it began where the system does not tell."""
    assert thread.ident is not None
    if hasattr(time, "pthread_getcpuclockid"):
        with suppress(OSError):
            return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))
    return time.monotonic() - begin
