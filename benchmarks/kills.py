"""kill -9 at random moments: ``python -m benchmarks.kills --kills 200 -o build/kills``.

Each command runs in a process of its own, forked from this one, and is killed at a random moment of the time that it
takes. After each kill every file that can be seen is whole. After a few kills the command runs through, gives what it
gives without a kill, and leaves nothing of the killed ones. Times and dates are no part of a result.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

COMMANDS = {
    "build": "build rig.mo -o {}/rig.fmu",
    "identify": "identify one.csv two.csv --mass 1 --layers 3 --ensemble 2 --method published --workers 1 -o {}",
    "study": "a study {}",
    "study on Dask, worker killed": "a study {} {scheduler}",
    "diagnose": "diagnose one.csv two.csv --model HystId.Oscillators.Linear --set m=1 -o {}",
    "regress --update": "regress {}/rig.fmu --update",
    "demo": "demo -o {}",
}
SHARES = {"build": 40, "identify": 40, "study": 40, "study on Dask, worker killed": 10, "diagnose": 25,
          "regress --update": 40, "demo": 5}  # fmt: skip
_TIMES = re.compile(r"second|time|cpu|duration|date|created|path|folder|files")
_ROUND = 8  # kills before a command runs through
_SCHEDULER = "tcp://127.0.0.1:8797"
_RIG = """model Rig
  parameter Real k = 100;
  Real x(start = 0.1, fixed = true), v(start = 0, fixed = true);
  output Real y = x;
equation
  der(x) = v;
  der(v) = -k*x - (if v > 0 then 0.1 else -0.1);
  annotation(experiment(StopTime = 1, Interval = 1e-3));
end Rig;
"""


@dataclass
class Found:
    """What came of the kills of one command.

    kills: of a command at work. late: it had ended before its kill. compared: results after kills, other_results: those
    that are not what the command gives alone.
    """

    command: str
    kills: int = 0
    late: int = 0
    half_written: int = 0
    compared: int = 0
    other_results: int = 0
    left_behind: int = 0

    def __str__(self) -> str:
        return (
            f"| `{self.command}` | {self.kills} | {self.late} | {self.half_written} | {self.compared} | "
            f"{self.other_results} | {self.left_behind} |"
        )


def forked(text: str) -> int:
    """Start a command of hystid; its process."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        with contextlib.suppress(OSError):  # the child has done it already, or is over
            os.setpgid(child, child)  # here as well, for it may be killed before it does
        return child
    os.setpgid(0, 0)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    from hystid.cli.run import run

    code = 99
    with contextlib.suppress(BaseException):
        code = small_study(*text.split()[2:]) if text.startswith("a study") else run(text.split())
    os._exit(code)


def small_study(out: str, scheduler: str | None = None) -> int:
    """What ``hystid study grid`` does, for two structures in place of a hundred."""
    from hystid import study

    found = study.grid(
        [Path("one.csv")], holdout=[Path("two.csv")], mass=1.0, out=Path(out), structures=[(2,), (3,)], starts=4,
        workers=1, scheduler=scheduler,
    )  # fmt: skip
    found.save(out)
    return 0


def ended(process: int, after: float) -> int | None:
    """The exit code of a process, None where it had to be killed after so many seconds."""
    until = time.monotonic() + after
    while time.monotonic() < until:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(min(0.01, max(until - time.monotonic(), 0)))
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def broken(folder: Path) -> list[str]:
    """Files below a folder that a reader would take and that are not whole."""
    return [str(path) for path in _seen(folder) if not _is_whole(path)]


def told(files: list[str]) -> bool:
    """Print the files that are not whole, with their sizes, and say whether there are any."""
    for name in files:
        path = Path(name)
        print(f"not whole: {name} ({path.stat().st_size if path.exists() else 'gone'})", file=sys.stderr, flush=True)
    return bool(files)


def _seen(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if path.is_file() and not hidden:
            yield path


def _is_whole(path: Path) -> bool:
    try:
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix in (".fmu", ".ssp", ".npz"):
            with zipfile.ZipFile(path) as archive:
                return archive.testzip() is None
        elif path.suffix == ".html":
            return path.read_text().rstrip().endswith("</html>")
        elif path.suffix == ".csv":
            rows = path.read_text()
            lines = [line for line in rows.splitlines() if not line.startswith("#")]  # what is told above has commas
            return rows.endswith("\n") and len({line.count(",") for line in lines}) == 1
        elif path.suffix == ".onnx":
            from hystid.networks.onnx_reading import load

            load(path)
    except Exception:  # whatever a reader says of it, it is not whole
        return False
    return path.stat().st_size > 0


def result(folder: Path) -> dict[str, object]:
    """What a command wrote, times and dates apart."""
    found: dict[str, object] = {}
    for path in _seen(folder):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".json":
            found[name] = _timeless(json.loads(path.read_text()))
        elif path.suffix == ".npz":
            with np.load(path) as stored:
                found[name] = {key: stored[key].tobytes().hex() for key in stored.files if key != "rest"}
        elif path.suffix == ".csv":
            found[name] = path.read_text()
        elif path.suffix in (".fmu", ".onnx", ".mo"):
            found[name] = path.read_bytes().hex()[:64] if path.suffix == ".mo" else "there"
        else:
            found[name] = "there"
    return found


def _timeless(value: object) -> object:
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if not _TIMES.search(str(key).lower())}
    return [_timeless(item) for item in value] if isinstance(value, list) else value


def killed(name: str, kills: int, place: Path, dice: random.Random, longest: float) -> Found:
    """Kill a command so many times, and compare what it gives after every few kills with what it gives alone.

    A command that has ended before its kill is not counted as a kill, and is compared too. A study and a cache go on
    where they were killed, so that a folder is used for a few kills and then cleared.
    """
    found = Found(name)
    text, alone, out = COMMANDS[name], place / "alone", place / "out"
    _fresh(name, alone)
    begin = time.monotonic()
    whole = ended(forked(text.format(alone)), longest)
    lasted = time.monotonic() - begin
    if whole not in (0, 1):
        raise RuntimeError(f"{text}: exit code {whole} after {lasted:.0f} s")
    while found.kills < kills:
        _fresh(name, out)
        for k in range(min(_ROUND, kills - found.kills)):
            begin = time.monotonic()
            again = ended(forked(text.format(out)), dice.uniform(0, lasted))
            found.half_written += told(broken(out))
            if again is not None:
                found.late += 1
                if not k:  # later ones go on where others were killed
                    lasted = (lasted + time.monotonic() - begin) / 2
                break
            found.kills += 1
        else:
            again = ended(forked(text.format(out)), max(longest, 10 * lasted))
        found.compared += 1
        found.other_results += again != whole or result(alone) != result(out)
        found.left_behind += len([path for path in place.rglob(".*") if path.name != ".hystid"])
        if found.late > 10 * kills:
            raise RuntimeError(f"{text}: it always ends before it is killed")
    return found


def _fresh(name: str, folder: Path) -> None:
    """An empty folder, with what the command needs there."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if name == "regress --update":
        forked_to_end(f"build rig.mo -o {folder}/rig.fmu")
    if name == "build":  # with an empty cache it compiles again
        cache = folder.parent / "cache"
        shutil.rmtree(cache, ignore_errors=True)
        os.environ["HYSTID_CACHE"] = str(cache)


def forked_to_end(text: str) -> None:
    """A command that is not killed. Raises RuntimeError where it fails."""
    if (code := ended(forked(text), 600)) != 0:
        raise RuntimeError(f"{text}: exit code {code}")


def killed_workers(kills: int, place: Path, dice: random.Random) -> Found:
    """Studies on a Dask cluster of two workers, one of which is killed again and again, and started anew.

    Each study has a folder of its own; the first one is not disturbed, and says how long a study lasts.
    """
    name = "study on Dask, worker killed"
    found, alone, out = Found(name), place / "alone", place / "out"
    _fresh(name, alone)
    forked_to_end(COMMANDS["study"].format(alone))
    environment = {**os.environ, "PYTHONWARNINGS": "ignore"}
    port = _SCHEDULER.rpartition(":")[2]
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", port, "--no-dashboard"]
    scheduler = subprocess.Popen(dask, stderr=subprocess.DEVNULL, env=environment)
    work = [sys.executable, "-m", "distributed.cli.dask_worker", _SCHEDULER, "--nthreads", "1", "--no-nanny"]
    work.append("--no-dashboard")
    workers = [subprocess.Popen(work, stderr=subprocess.DEVNULL, env=environment) for _ in range(2)]
    try:
        lasted = 0.0
        while found.kills < kills:
            _fresh(name, out)
            begin = time.monotonic()
            study = forked(COMMANDS[name].format(out, scheduler=_SCHEDULER))
            while lasted and found.kills < kills:
                time.sleep(dice.uniform(0, lasted))
                if ended_yet(study):
                    found.late += 1
                    break
                workers[0].kill()
                workers[0].wait()
                found.kills += 1
                found.half_written += told(broken(out))
                workers = [workers[1], subprocess.Popen(work, stderr=subprocess.DEVNULL, env=environment)]
            code = ended(study, 300)
            lasted = lasted or time.monotonic() - begin
            found.compared += 1
            found.other_results += code != 0 or result(alone) != result(out)
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()
    found.left_behind = len([path for path in place.rglob(".*") if path.name != ".hystid"])
    return found


def ended_yet(process: int) -> bool:
    """Whether a process is over, without taking note of it."""
    return os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def inputs() -> None:
    """The model and the recordings, in this folder."""
    Path("rig.mo").write_text(_RIG)
    forked_to_end("build HystId.Oscillators.Jenkins -o jenkins.fmu")
    for number, name in enumerate(("one", "two")):
        force = f"--force chirp:1-20Hz@{20 + 30 * number}N,1s --dt 2e-3 --noise-snr 40 --seed {number}"
        forked_to_end(f"simulate jenkins.fmu {force} -o {name}.csv")


def main() -> int:
    """Arguments are those of the module's text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="*", default=list(SHARES))
    parser.add_argument("--longest", type=float, default=900, help="s after which a command has failed")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/kills"))
    given = parser.parse_args()
    given.out.mkdir(parents=True)
    os.chdir(given.out)
    here = Path.cwd()
    (here / "temporary").mkdir()
    os.environ.update(HYSTID_CACHE=str(here / "cache"), SOURCE_DATE_EPOCH="1700000000", TMPDIR=str(here / "temporary"))
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    tempfile.tempdir = None
    import hystid.cli.commands
    import hystid.diagnosis
    import hystid.fmu
    import hystid.identification
    import hystid.modelica
    import hystid.recording
    import hystid.report.page
    import hystid.study  # noqa: F401  (imported once, so that kills meet the work and not the imports)

    inputs()
    print("| command | kills | ended before | half-written | compared | other results | left behind |")
    print("|---|---|---|---|---|---|---|")
    bad = 0
    for name in given.commands:
        n, dice = max(round(given.kills * SHARES[name] / sum(SHARES.values())), 1), random.Random(given.seed)
        place = here / re.sub(r"\W+", "-", name)
        os.environ["HYSTID_CACHE"] = str(here / "cache")
        by_worker = "Dask" in name
        found = killed_workers(n, place, dice) if by_worker else killed(name, n, place, dice, given.longest)
        print(found, flush=True)
        bad += found.half_written + found.other_results + found.left_behind
    forked_to_end("build rig.mo -o last.fmu")
    remains = len([path for path in (here / "temporary").iterdir() if not path.name.startswith("dask")])
    print(f"{remains} files of killed processes in the temporary folder after one more command")
    return 1 if bad or remains else 0


if __name__ == "__main__":
    sys.exit(main())
