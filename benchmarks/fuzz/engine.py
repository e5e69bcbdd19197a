"""Inputs of one kind, in a process of its own: ``python -m benchmarks.fuzz.engine KIND --inputs N --seed S -o FOLDER``.

atheris makes them where it is installed, led by the lines of hystid that an input reaches; else bytes of the corpus are
changed at random. What is neither an answer nor one sentence is kept in FOLDER: the input, and the traceback.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import struct
import sys
import tempfile
import traceback
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

COUNTS = struct.Struct("<QQQ")  # inputs, tracebacks, files outside
_LONGEST = 1 << 16  # bytes of an input
_ODD = (b"", b"\0", b"nan", b"1e999", b"-1", b"\xff" * 4, b"../", b"(", b"9" * 30, b"\x1b[2J", b"\n" * 20)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_MOVES = {"os.rename": 1, "os.link": 1, "os.symlink": 1, "os.mkdir": 0, "os.remove": 0, "os.rmdir": 0}


class Watch:
    """One input after another, and what came of it. counts: kept in a file, for a crash leaves nothing else."""

    def __init__(self, kind: str, out: Path) -> None:
        from benchmarks.fuzz.targets import TARGETS

        self.target, self.kind, self.out = TARGETS[kind], kind, out
        self.inputs = self.tracebacks = self.outside = 0
        self.known: set[str] = set()
        self.written: list[str] = []
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        self.beside = self.folder / "in" / f"input{self.target.suffix}"
        self.beside.parent.mkdir()
        tempfile.tempdir = str(self.folder / "in")  # what hystid puts into the place for temporary files is no find
        self.allowed = (str(self.folder), str(out), os.environ["HYSTID_CACHE"], "/dev/")
        self.file = os.open(out / f"{kind}.counts", os.O_RDWR | os.O_CREAT)
        sys.addaudithook(self._audit)

    def _audit(self, event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[2], int) and given[2] & _WRITES:
            self._check(given[0])
        elif event in _MOVES and given[-1] == -1:  # beside a folder that is open: shutil removes folders in this way
            self._check(given[_MOVES[event]])

    def _check(self, path: object) -> None:
        if isinstance(path, str | bytes | os.PathLike):
            place = os.path.abspath(os.fsdecode(path))  # noqa: PTH100  # Path would open files of its own
            if not place.startswith(self.allowed) and not place.endswith((".pyc", ".counts")) and ".pyc." not in place:
                self.written.append(place)

    def one(self, data: bytes) -> None:
        """Try an input."""
        from hystid.errors import HystidError

        self.beside.write_bytes(data)
        (self.out / f"{self.kind}.last").write_bytes(data)
        self.written.clear()
        try:
            self.target.call(self.beside)
        except HystidError as error:
            if "\x1b" in str(error) or len(str(error)) > 4000:
                self._keep(data, f"message: {error!r}")
        except Exception:  # anything but our own errors is what is sought
            self._keep(data, traceback.format_exc())
        if self.written:
            self.outside += 1
            self._keep(data, "written outside: " + ", ".join(self.written))
        self.inputs += 1
        os.pwrite(self.file, COUNTS.pack(self.inputs, self.tracebacks, self.outside), 0)

    def _keep(self, data: bytes, what: str) -> None:
        self.tracebacks += not what.startswith("written outside")
        places = [line for line in what.splitlines() if line.startswith("  File")]
        if (sign := places[-1] if places else what[:80]) not in self.known:
            self.known.add(sign)
            name = f"{self.kind}-{len(self.known)}"
            (self.out / f"{name}{self.target.suffix}").write_bytes(data)
            (self.out / f"{name}.log").write_text(what, errors="replace")


def changed(seeds: list[bytes], dice: random.Random) -> bytes:
    """A seed with some bytes changed, cut out, doubled or taken from another one."""
    data = bytearray(dice.choice(seeds))
    for _ in range(dice.choice((1, 1, 2, 4, 16))):
        at, length = dice.randrange(len(data) + 1), dice.choice((1, 1, 2, 4, 30))
        way = dice.randrange(6)
        if way == 0:
            data[at : at + length] = dice.randbytes(length)
        elif way == 1:
            del data[at : at + length]
        elif way == 2:
            data[at:at] = data[at : at + length] * dice.choice((1, 1, 50))
        elif way == 3 and at < len(data):
            data[at] ^= 1 << dice.randrange(8)
        elif way == 4:
            other = dice.choice(seeds)
            first = dice.randrange(len(other) + 1)
            data[at : at + length] = other[first : first + length]
        else:
            data[at : at + length] = dice.choice(_ODD)
    return bytes(data[:_LONGEST])


def plain(watch: Watch, seeds: list[bytes], inputs: int, seed: int) -> None:
    """The seeds, and then changed ones."""
    dice = random.Random(seed)
    for k in range(inputs):
        watch.one(seeds[k] if k < len(seeds) else changed(seeds, dice))


def led(watch: Watch, corpus: Path, inputs: int, seed: int, found: Path) -> None:
    """As atheris makes them. Does not return: libFuzzer ends the process."""
    import atheris

    options = [
        f"-runs={inputs}", f"-seed={seed}", f"-max_len={_LONGEST}", "-timeout=120", "-rss_limit_mb=8192",
        "-verbosity=0", f"-artifact_prefix={watch.out}/{watch.kind}-",
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options, str(found), str(corpus)], watch.one)
    atheris.Fuzz()


@contextlib.contextmanager
def _instrumented(by_atheris: bool) -> Iterator[None]:
    if not by_atheris:
        yield
        return
    import atheris

    with atheris.instrument_imports(include=["hystid"], enable_loader_override=False):
        yield


def main() -> None:
    """Arguments are those of the module's text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("kind")
    parser.add_argument("--inputs", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    by_atheris = not given.plain and find_spec("atheris") is not None
    with _instrumented(by_atheris):
        import hystid.cli.options
        import hystid.diagnosis.prepare.given
        import hystid.fmu.door
        import hystid.modelica
        import hystid.recording.reading
        import hystid.surrogate
        import hystid.units  # noqa: F401  # imported so that their lines are counted
    from benchmarks.fuzz.targets import CORPUS

    out = given.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("HYSTID_CACHE", str(out / "cache"))
    watch = Watch(given.kind, out)
    try:
        if by_atheris:
            found = out / f"{given.kind}.corpus"
            found.mkdir(exist_ok=True)
            led(watch, CORPUS / given.kind, given.inputs, given.seed, found)
        else:
            seeds = [path.read_bytes() for path in sorted((CORPUS / given.kind).iterdir())]
            plain(watch, seeds, given.inputs, given.seed)
    finally:
        shutil.rmtree(watch.folder, ignore_errors=True)


if __name__ == "__main__":
    main()
