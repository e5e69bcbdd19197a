"""The side that asks: a process that is started, asked, watched and ended."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hystid import errors
from hystid.child.frames import encoded, receive, write
from hystid.child.serving import BEAT
from hystid.limits import CHILD_MEMORY, CHILD_RUN_SECONDS, CHILD_SECONDS, kill

_log = logging.getLogger("hystid")
_START = """import json, sys
sys.path[:] = json.loads(sys.argv[1])
from hystid.child.serving import serve
serve(int(sys.argv[2]))"""
_SHARE = 10  # a busy machine stretches the time between signs of life by so much; threads of a library are no load
_GRACE = 0.25  # s between looks at whether it still runs
_KEPT_OUTPUT = 4096  # bytes of what a child printed
_ATTEMPTS = 200  # to see it end, 10 ms apart
_SIGN = "HYSTID_CHILD_SIGN"  # a variable by which it, and whatever it starts, is known
_JSON = 64 << 20  # bytes of JSON in an answer
_FATES = {"SIGSEGV": "crashed (segmentation fault)", "SIGBUS": "crashed (bus error)", "SIGABRT": "aborted",
          "SIGFPE": "crashed (arithmetic error)", "SIGILL": "crashed (illegal instruction)",
          "SIGSYS": "crashed (bad system call)"}  # fmt: skip


class ChildError(Exception):
    """Why there is no answer, as what follows a subject: "crashed (segmentation fault)"."""


class _Ended(ChildError):
    """The process is over."""


class Child:
    """A process that is started with the first request, and ends with this object.

    folder: where it works; files that the code over there leaves lie there.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._running: _Process | None = None
        self._lock = threading.Lock()

    def ask(self, function: str, /, patience: float = 1.0, **arguments: Any) -> Any:
        """Call "module:function" over there; arguments and result are numbers, texts, arrays, lists and mappings.

        patience: factor on the time that may pass without a sign of life (``beat``); however many come, the whole
        request has a limit of its own. Raises ChildError, and the errors
        of hystid that the function raises.
        """
        request = {"call": function, "arguments": arguments}
        with self._lock:
            used = self._running is not None
            try:
                return self._asked(request, patience * CHILD_SECONDS.value)
            except _Ended:
                if not used:
                    raise
                # an earlier request may have left it damaged: only what ends a new one is to blame
                return self._asked(request, patience * CHILD_SECONDS.value)

    def _asked(self, request: Mapping[str, Any], seconds: float) -> Any:
        if self._running is None:
            self._running = _Process(self._folder)
            weakref.finalize(self, self._running.end)
        try:
            return self._running.ask(request, seconds)
        except ChildError as fate:
            if isinstance(fate, _Ended) or not self._running.lives():
                self._running = None
            raise
        except errors.HystidError:
            raise
        except BaseException:  # Ctrl-C
            self.close()
            raise

    def close(self) -> None:
        """End the process."""
        if self._running is not None:
            self._running.end()
            self._running = None


class _Process:
    def __init__(self, folder: Path | None) -> None:
        self._memory = _memory()
        self._sign = os.urandom(16).hex()
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        places = json.dumps([str(Path(place).resolve()) for place in sys.path])
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-c", _START, places, str(self._memory)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder, bufsize=0,
            env={**os.environ, **threads, _SIGN: self._sign}, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._questions, self._answers, self._printed = (
            self._process.stdin, self._process.stdout, self._process.stderr
        )  # fmt: skip
        self._told: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._last_words: deque[bytes] = deque(maxlen=4)
        self._peak = 0
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._drain, self._listen)]
        for thread in self._threads:
            thread.start()

    def lives(self) -> bool:
        """Whether it still runs."""
        return not self._over()

    def ask(self, request: Mapping[str, Any], seconds: float) -> Any:
        """One request and its answer."""
        until = time.monotonic() + CHILD_RUN_SECONDS.value
        sender = threading.Thread(target=self._put, args=(encoded(request),), daemon=True)
        self._threads[2:] = [sender]
        sender.start()  # beside, for it may have stopped to read
        while True:
            told = self._next(seconds, until)
            if told is None:
                raise _Ended(self._fate())
            if "log" in told:
                _log.log(told["log"], "%s", errors.printable(str(told["text"])))
            elif "error" in told:
                raise self._error(str(told["error"]), str(told["text"]))
            elif "answer" in told:
                return told["answer"]

    def _put(self, blocks: Sequence[memoryview]) -> None:
        with contextlib.suppress(OSError, ValueError):
            write(self._questions, blocks)

    def _next(self, seconds: float, until: float) -> Any:
        """What it tells next, None where its process is over."""
        begin, waited = time.monotonic(), self._waited()
        while time.monotonic() < until:
            over = self._over()
            with contextlib.suppress(queue.Empty):
                return self._told.get(timeout=_GRACE if over else min(_GRACE, seconds))
            if over:  # what it has started keeps its pipes open
                return None
            if time.monotonic() - begin > seconds + min(self._waited() - waited, (_SHARE - 1) * seconds):
                self.end()
                raise ChildError(
                    f"gave no answer within {seconds:g} s and was stopped ({CHILD_SECONDS.name} raises this)"
                )
        self.end()
        raise ChildError(f"was not done after {CHILD_RUN_SECONDS} and was stopped")

    def _waited(self) -> float:
        """Seconds that it has waited for a processor: on a machine that is busy nothing hangs, it takes longer."""
        try:
            return float(Path(f"/proc/{self._process.pid}/schedstat").read_text().split()[1]) * 1e-9
        except (OSError, ValueError, IndexError):
            return 0.0

    def _over(self) -> bool:
        """Whether the process has ended; its exit code stays to be read."""
        if self._process.returncode is not None:
            return True
        if not hasattr(os, "waitid"):
            return self._process.poll() is not None
        try:
            return os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        except ChildProcessError:
            return True

    def _error(self, kind: str, text: str) -> Exception:
        found = getattr(errors, kind, None)
        if isinstance(found, type) and issubclass(found, errors.HystidError):
            return found(*text.split("\n"))
        if kind == "MemoryError":
            return ChildError(self._too_large())
        return ChildError(f"failed ({kind}: {text})" if text else f"failed ({kind})")

    def end(self) -> None:
        """Kill it, and what it has started."""
        kill(self._process)
        self._reap()
        self._close()

    def _close(self) -> None:
        for place in Path("/proc").glob("[0-9]*/environ"):  # what has left the session: a daemon keeps its pipes open
            with contextlib.suppress(OSError):
                if f"{_SIGN}={self._sign}".encode() in place.read_bytes():
                    os.kill(int(place.parent.name), signal.SIGKILL)
        for thread in self._threads:
            thread.join(BEAT)
        if not any(thread.is_alive() for thread in self._threads):
            for file in (self._questions, self._answers, self._printed):
                file.close()

    def _reap(self) -> int:
        """Exit code of the process, which is over or about to be; it keeps how much memory was used."""
        if not hasattr(os, "wait4"):
            return self._process.wait()
        for attempt in range(_ATTEMPTS):
            if self._process.returncode is not None:
                break
            with contextlib.suppress(ChildProcessError):
                found, status, usage = os.wait4(self._process.pid, os.WNOHANG)
                if found:
                    self._process.returncode = os.waitstatus_to_exitcode(status)
                    self._peak = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
                    break
            if attempt == _ATTEMPTS // 2:
                kill(self._process)  # it has closed its pipes and goes on
            time.sleep(0.01)
        return self._process.wait()

    def _fate(self) -> str:
        code = self._reap()
        kill(self._process)  # what it has started
        self._close()
        printed = b"".join(self._last_words)[-_KEPT_OUTPUT:].decode(errors="replace")
        if self._peak > self._memory / 2 or "bad_alloc" in printed or "MemoryError" in printed:
            return self._too_large()
        if code >= 0:
            fate = f"ended the process with exit code {code} instead of answering"
        else:
            name = signal.Signals(-code).name if -code in {item.value for item in signal.Signals} else f"signal {-code}"
            fate = _FATES.get(name, f"was ended by {name}")
        last = next((line for line in reversed(printed.splitlines()) if line.strip()), "")
        return f"{fate}; the last that it printed was '{errors.printable(last, 200)}'" if last else fate

    def _too_large(self) -> str:
        return (
            f"needs more than {self._memory >> 20} MB of memory ({CHILD_MEMORY.name} raises this where there is more)"
        )

    def _listen(self) -> None:
        try:
            while True:
                self._told.put(receive(self._answers, _JSON, self._memory))
        except (OSError, ValueError, EOFError, KeyError, TypeError, IndexError, MemoryError, RecursionError):
            # where it did not end, it wrote nonsense between the answers; Popen.kill would reap it unseen
            kill(self._process)
            self._told.put(None)

    def _drain(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while block := self._printed.read(_KEPT_OUTPUT):
                self._last_words.append(block)


def _memory() -> int:
    """Bytes that a child may have: never the last quarter of the machine's memory."""
    wanted = int(CHILD_MEMORY.value * (1 << 20))
    if not hasattr(os, "sysconf"):
        return wanted
    return min(wanted, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4)
