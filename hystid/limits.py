"""What a file of unknown origin may cost. Each limit has a name; an environment variable of that name raises it."""

from __future__ import annotations

import contextvars
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from hystid.errors import HystidError, UsageError


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
# Who runs a model for longer than an hour knows that it takes long.
CHILD_RUN_SECONDS = Limit("HYSTID_CHILD_RUN_SECONDS", 3600, "s", "one run of a foreign FMU, whatever life it shows")
CHILD_MEMORY = Limit("HYSTID_CHILD_MEMORY_MB", 8192, "MB", "memory of a foreign FMU, or of a reader of binary files")
# The largest models of the tests compile in a tenth of this; what takes longer grows without end.
COMPILE_SECONDS = Limit("HYSTID_COMPILE_SECONDS", 120, "s", "computing time of one compilation, C compiler included")
# 64 MB of tables and arrays of a network, or 2 million operations of a Modelica model, which take some 20 s.
COMPILE_ELEMENTS = Limit("HYSTID_COMPILE_ELEMENTS", 8_000_000, "elements", "what one compilation writes out")

# 20 million samples are a file of 2 GB, which takes minutes to write.
FORCE_SAMPLES = Limit("HYSTID_FORCE_SAMPLES", 20_000_000, "samples", "a force given in words")
TRAININGS = 10_000  # starts that one command may ask for: with the fastest, an hour

_T = TypeVar("_T")
_STACK = 256 << 20  # bytes, of which only what is used is taken
_DEPTH = 20_000  # Python calls: expressions nested some 5,000 deep
_LOOK = 0.25  # s between looks at the clock, at least
_IDLE = 10  # times the limit on the clock of the wall: what then has not computed that long waits for nothing
_ONE_AT_A_TIME = threading.RLock()  # stack size and depth of recursion belong to the whole process


def check_whole(name: str, value: int, low: int, high: int | None = None) -> None:
    """Raise UsageError unless low <= value <= high. name: as the user knows it, such as "--seed"."""
    if int(value) != value or value < low or (high is not None and value > high):
        needed = f"of at least {low}" if high is None else f"from {low} to {high}"
        raise UsageError(f"{name} {value}: a whole number {needed} is needed")


class OutOfTime(BaseException):
    """Work took longer than it may. No ``except Exception`` on its way holds it up."""


class _Compilation:
    """What one compilation has spent: computing time of its thread and of the processes that it started, elements."""

    def __init__(self, times: int) -> None:
        self.seconds = COMPILE_SECONDS.value * times
        self.elements = COMPILE_ELEMENTS.value
        self.thread: threading.Thread | None = None
        self._begin = time.monotonic()
        self._running: list[subprocess.Popen[Any]] = []
        self._ended = 0.0  # seconds of processes that are over
        self._is_stopped = False
        self._lock = threading.Lock()

    def left(self) -> float:
        """Seconds until the time may be spent, below 0 when it is."""
        return min(self.seconds - self._computed(), self._begin + _IDLE * self.seconds - time.monotonic())

    def _computed(self) -> float:
        with self._lock:
            others = self._ended + sum(map(_of_group, self._running))
        return others + _of_thread(self.thread, self._begin)

    def stop(self) -> None:
        """End its processes, and then the thread, which may wait for one of them."""
        if self.thread is not None and self.thread.ident is not None:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.thread.ident), ctypes.py_object(OutOfTime))
        with self._lock:
            self._is_stopped = True
            for process in self._running:
                kill(process)

    def begin(self, process: subprocess.Popen[Any]) -> None:
        with self._lock:
            if not self._is_stopped:
                self._running.append(process)
                _bound(process, self.seconds)
                return
        _reaped(process)
        raise OutOfTime

    def end(self, process: subprocess.Popen[Any]) -> None:
        with self._lock:
            self._running.remove(process)
            self._ended += _reaped(process)


_current: contextvars.ContextVar[_Compilation | None] = contextvars.ContextVar("compilation", default=None)


def compiled(name: str, work: Callable[[], _T], error: type[HystidError], times: int = 1) -> _T:
    """``bounded`` work on a model of this name; the end of its time raises the error, in one sentence."""
    try:
        return bounded(work, times)
    except OutOfTime:
        raise error(
            f"{name}: compiling takes more than {COMPILE_SECONDS}: make the model smaller; in Modelica, shorten its "
            "longest expressions, or name parts of them as variables"
        ) from None


def bounded(work: Callable[[], _T], times: int = 1) -> _T:
    """The work done on a large stack, since passes over expressions recurse as deep as these are nested.

    Raises OutOfTime after ``times`` COMPILE_SECONDS of computing, that of processes in ``counted`` included (time that
    others have the processor does not count), and what the work raises, RecursionError among it. Within bounded work
    this is a plain call: a compilation has one deadline, however many stages it has.
    """
    if _current.get() is not None:
        return work()
    done: Future[_T] = Future()
    before = sys.getrecursionlimit()
    compilation = _Compilation(times)
    context = contextvars.copy_context()
    context.run(_current.set, compilation)
    thread = threading.Thread(target=context.run, args=(_do, work, done), daemon=True)
    with _ONE_AT_A_TIME:
        stack = threading.stack_size(_STACK)
        try:
            sys.setrecursionlimit(max(before, _DEPTH))
            thread.start()
            compilation.thread = thread
        finally:
            threading.stack_size(stack)
    try:
        return _waited(done, compilation)
    finally:
        sys.setrecursionlimit(before)


@contextmanager
def counted(process: subprocess.Popen[Any]) -> Iterator[None]:
    """A process, the first of a session of its own: what it computes counts for the compilation under way, it ends when
    that one's time is over, and at the latest here.
    """
    compilation = _current.get()
    if compilation is not None:
        compilation.begin(process)
    try:
        yield
    finally:
        if compilation is not None:
            compilation.end(process)
        else:
            _reaped(process)


def wait_until_over(process: subprocess.Popen[Any]) -> None:
    """Return when a process has ended; its exit code is there when ``counted`` is left."""
    if hasattr(os, "waitid"):
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    else:
        process.wait()


def room_for(elements: int) -> bool:
    """Count elements that the compilation under way is about to write out; False where they are too many."""
    compilation = _current.get()
    if compilation is None:
        return elements <= COMPILE_ELEMENTS.value
    compilation.elements -= elements
    return compilation.elements >= 0


def _do(work: Callable[[], _T], done: Future[_T]) -> None:
    with suppress(OutOfTime):  # one that comes before the work begins, or after it is done
        try:
            done.set_result(work())
        except BaseException as error:  # told where the result is asked for
            done.set_exception(error)


def _waited(done: Future[_T], compilation: _Compilation) -> _T:
    thread = compilation.thread
    assert thread is not None
    soon, allowed = min(_LOOK, compilation.seconds), compilation.seconds
    look = soon
    try:
        while not wait_for([done], look).done:
            if not thread.is_alive() and not done.done():
                raise OutOfTime
            left = compilation.left() if thread.is_alive() else 0.0
            look = max(soon, left / 8)  # a look costs 15 ms, and no compilation keeps eight processors busy
            if left < 0:
                compilation.stop()
                compilation.seconds += allowed  # what catches it has as long again to put things away
    except BaseException:  # Ctrl-C
        compilation.stop()
        raise
    return done.result()


def _of_thread(thread: threading.Thread | None, begin: float) -> float:
    """Seconds of processor time of a thread; those since it began where the system does not tell."""
    if thread is not None and thread.ident is not None and hasattr(time, "pthread_getcpuclockid"):
        with suppress(OSError):
            return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))
    return time.monotonic() - begin


def _of_group(process: subprocess.Popen[Any]) -> float:
    """Seconds of processor time of a process and of those that it has started; 0 where the system does not tell."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            fields = place.read_text(errors="replace").rpartition(")")[2].split()
            if int(fields[2]) == process.pid:
                ticks += sum(map(int, fields[11:15]))  # its own, and those of what it has waited for
    return ticks / os.sysconf("SC_CLK_TCK") if ticks else 0.0


def _bound(process: subprocess.Popen[Any], seconds: float) -> None:
    """Let it end by itself after so much computing: where this process is killed, nobody else ends it."""
    if sys.platform == "linux":
        import resource

        with suppress(OSError, ValueError):
            resource.prlimit(process.pid, resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))


def kill(process: subprocess.Popen[Any]) -> None:
    """End a process, the first of a session of its own, and what it has started."""
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def _reaped(process: subprocess.Popen[Any]) -> float:
    """End a process, set its exit code, and return the seconds that it computed."""
    if process.returncode is not None:
        return 0.0
    kill(process)
    if not hasattr(os, "wait4"):
        process.wait()
        return 0.0
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except ChildProcessError:
        process.wait()
        return 0.0
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime
