"""kill -9 at random moments: ``python -m benchmarks.kills --kills 200 -o build/kills``.

Each command runs in a process of its own, forked from this one, and is killed at a random moment of the time that it
takes. After each kill every file that can be seen is whole. In the end the command runs through, gives what it gave
without a kill, and leaves nothing of the killed ones. Times and dates are no part of a result.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
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
    """What came of the kills of one command. early, late: kills before it wrote anything, and after it was through."""

    command: str
    kills: int = 0
    late: int = 0
    half_written: int = 0
    other_results: int = 0
    left_behind: int = 0

    def __str__(self) -> str:
        return (
            f"| `{self.command}` | {self.kills} | {self.late} | {self.half_written} | {self.other_results} | "
            f"{self.left_behind} |"
        )


def forked(text: str) -> int:
    """Start a command of hystid; its process."""
    sys.stdout.flush()
    child = os.fork()
    if child:
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
            return rows.endswith("\n") and len({line.count(",") for line in rows.splitlines()}) == 1
        elif path.suffix == ".onnx":
            from hystid.networks.onnx import load

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
    """Kill a command so many times, and compare what it gives then with what it gives alone."""
    found = Found(name)
    text, alone, out = COMMANDS[name], place / "alone", place / "out"
    for folder in (alone, out):
        folder.mkdir(parents=True)
        if name == "regress --update":
            forked_to_end(f"build rig.mo -o {folder}/rig.fmu")
    begin = time.monotonic()
    whole = ended(forked(text.format(alone)), longest)
    lasted = time.monotonic() - begin
    if whole not in (0, 1, None):
        raise RuntimeError(f"{text}: exit code {whole}")
    for _ in range(kills):
        if name == "build":  # the next one starts with an empty cache, and compiles again
            os.environ["HYSTID_CACHE"] = str(place / f"cache{dice.randrange(4)}")
        process = forked(text.format(out))
        found.late += ended(process, dice.uniform(0, lasted)) is not None
        found.kills += 1
        found.half_written += bool(broken(out))
    again = ended(forked(text.format(out)), max(longest, 10 * lasted))
    if whole is not None:
        found.other_results = int(again != whole or result(alone) != result(out))
    found.left_behind = len([path for path in place.rglob(".*") if path.name != ".hystid"])
    return found


def forked_to_end(text: str) -> None:
    """A command that is not killed. Raises RuntimeError where it fails."""
    if (code := ended(forked(text), 600)) != 0:
        raise RuntimeError(f"{text}: exit code {code}")


def killed_workers(kills: int, place: Path, dice: random.Random) -> Found:
    """A study on a Dask cluster of two workers, one of which is killed again and again, and started anew."""
    name = "study on Dask, worker killed"
    found = Found(name)
    forked_to_end(COMMANDS["study"].format(place / "alone"))
    environment = {**os.environ, "PYTHONWARNINGS": "ignore"}
    dask = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--port",
        _SCHEDULER.rpartition(":")[2],
        "--no-dashboard",
    ]
    scheduler = subprocess.Popen(dask, stderr=subprocess.DEVNULL, env=environment)
    work = [sys.executable, "-m", "distributed.cli.dask_worker", _SCHEDULER, "--nthreads", "1", "--no-nanny"]
    work.append("--no-dashboard")
    workers = [subprocess.Popen(work, stderr=subprocess.DEVNULL, env=environment) for _ in range(2)]
    try:
        while found.kills < kills:
            study = forked(COMMANDS[name].format(place / "out", scheduler=_SCHEDULER))
            while found.kills < kills and ended_yet(study) is None:
                time.sleep(dice.uniform(1, 6))
                workers[0].kill()
                workers[0].wait()
                found.kills += 1
                found.half_written += bool(broken(place / "out"))
                workers = [workers[1], subprocess.Popen(work, stderr=subprocess.DEVNULL, env=environment)]
            if ended(study, 300) == 0:
                found.other_results += result(place / "alone") != result(place / "out")
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()
    found.left_behind = len([path for path in place.rglob(".*") if path.name != ".hystid"])
    return found


def ended_yet(process: int) -> int | None:
    """Whether a process is over, without taking note of it."""
    return None if os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None else 0


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
    parser.add_argument("--longest", type=float, default=300, help="s of a longer command in which it is killed")
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
    print("| command | kills | of which after its end | half-written | other results | left behind |")
    print("|---|---|---|---|---|---|")
    bad = 0
    for name in given.commands:
        n, dice = max(round(given.kills * SHARES[name] / sum(SHARES.values())), 1), random.Random(given.seed)
        place = here / re.sub(r"\W+", "-", name)
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
