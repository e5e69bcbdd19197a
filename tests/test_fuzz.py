"""A short run of ``make fuzz``: every kind, from seeds that are fixed; docs/reliability.md reports the long one."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.fuzz import engine, orders  # noqa: E402  (beside the package, not in it)
from benchmarks.fuzz.targets import CORPUS, TARGETS  # noqa: E402  (the same)

# Inputs of each kind: seconds for all of them together. Modelica is left to the long run, a second for each input.
SHORT = {"unit": 300, "parameters": 200, "csv": 100, "mat": 30, "hdf5": 30, "uff": 30, "tdms": 30, "mdf": 30,
         "parquet": 30, "fmu": 60, "description": 60, "onnx": 40}  # fmt: skip
PACKAGES = {"hdf5": "h5py", "uff": "pyuff", "tdms": "nptdms", "mdf": "asammdf", "parquet": "pyarrow"}


@pytest.mark.parametrize("kind", SHORT)
def test_inputs_are_answered_or_refused(tmp_path: Path, kind: str) -> None:
    command = [sys.executable, "-m", "benchmarks.fuzz.engine", kind, "--plain", "--inputs", str(SHORT[kind])]
    if kind in PACKAGES:
        pytest.importorskip(PACKAGES[kind], reason=f"needs the extra {kind}")
    done = subprocess.run([*command, "--seed", "11", "-o", tmp_path], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    tried, tracebacks, outside = engine.COUNTS.unpack((tmp_path / f"{kind}.counts").read_bytes())
    assert tried == SHORT[kind]
    assert (tracebacks, outside) == (0, 0), [path.read_text() for path in tmp_path.glob("*.log")]


def test_every_kind_has_a_corpus_that_is_accepted(tmp_path: Path) -> None:
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    for kind in ("unit", "csv", "fmu", "description", "onnx"):
        seed = min((CORPUS / kind).iterdir())
        path = shutil.copy(seed, tmp_path / f"seed{TARGETS[kind].suffix}")
        TARGETS[kind].call(Path(path))


def test_writing_outside_and_tracebacks_would_be_seen(tmp_path: Path) -> None:
    """The watch itself: in a process of its own, for its hook stays."""
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom benchmarks.fuzz import engine, targets\n"
        "out = Path(sys.argv[1]); os.environ['HYSTID_CACHE'] = str(out / 'cache')\n"
        "def wrong(path):\n    Path(sys.argv[2]).write_text('x'); raise KeyError(3)\n"
        "targets.TARGETS['unit'] = targets.Target('.txt', wrong)\n"
        "watch = engine.Watch('unit', out); watch.one(b'a'); print(watch.inputs, watch.tracebacks, watch.outside)\n"
    )
    out = tmp_path / "out"
    out.mkdir()
    command = [sys.executable, "-c", code, out, tmp_path / "elsewhere.txt"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ})
    assert done.stdout.split() == ["1", "1", "1"], done.stderr
    assert len(list(out.glob("unit-*.log"))) == 2


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
@pytest.mark.parametrize(("model", "version"), [("Duhem (BoucWen)", 2), ("network (identified force)", 3)])
def test_calls_in_any_order_break_nothing(tmp_path: Path, model: str, version: int) -> None:
    made = orders.program(orders.code_of(orders.MODELS[model]), version, tmp_path / "made", orders.MEMORY)
    found = orders.orders(made, 77_000, 3_000)
    assert (found.inputs, found.crashes, found.hangs) == (3_000, 0, 0), found.failures
    assert found.calls > 20 * found.inputs


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
@pytest.mark.parametrize("version", [2, 3])
def test_a_ball_that_comes_to_rest_ends_its_run_with_the_reason(tmp_path: Path, version: int) -> None:
    """100,000 steps of 1e-4 s go past the accumulation of its impacts; up to there every step succeeds."""
    rest = math.sqrt(2 / 9.81) * (1 + 2 * 0.8 / (1 - 0.8))  # s; restitution 0.8: a geometric series of free flights
    made = orders.program(orders.code_of(orders.MODELS["events (BouncingBall)"]), version, tmp_path, orders.PLAIN)
    before, beyond = (
        subprocess.run(made.command("steps", 1, n), capture_output=True, text=True)
        for n in (int(rest / 1e-4) - 1, 100_000)  # 13 impacts within one step begin at most 1.06 steps before the rest
    )
    assert (before.returncode, before.stderr) == (0, "")
    assert beyond.returncode == 2
    found = re.search(r"Zeno: events accumulate at t = ([0-9.]+) s", beyond.stderr)
    assert found and abs(float(found[1]) - rest) < 2e-4, beyond.stderr
