"""The Python door: names at the top, quick import, examples that run, results that show and save themselves."""

from __future__ import annotations

import doctest
import inspect
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hystid
from hystid.errors import UsageError
from hystid.recording import Recording

FUNCTIONS = [name for name in hystid.__all__ if inspect.isfunction(getattr(hystid, name))]
EXAMPLES: dict[str, Callable[..., Any]] = {
    **{name: getattr(hystid, name) for name in FUNCTIONS if name != "read_all"},  # as ``read``
    "study.grid": hystid.study.grid,
    "study.mass": hystid.study.mass,
}


def test_the_names_at_the_top() -> None:
    promised = {"read", "prepare", "simulate", "identify", "validate", "diagnose", "build", "regress", "demo"}
    assert promised | {"study"} <= set(hystid.__all__)
    assert set(hystid.__all__) <= set(dir(hystid))
    assert hystid.__version__ == version("hystid")
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = hystid.nonsense  # type: ignore[attr-defined]


def test_names_stay_functions_after_their_modules_are_imported() -> None:
    """``import hystid.fmu.regress`` must not put a module where the function was."""
    for name in ("hystid.fmu.regress", "hystid.diagnosis.diagnose", "hystid.virtual_experiment", "hystid.building"):
        import_module(name)
    assert all(callable(getattr(hystid, name)) for name in FUNCTIONS)


def test_the_import_loads_nothing_heavy_and_types_are_declared() -> None:
    """A count of modules, not a time: 0.2 s is what NumPy alone takes on a slow machine."""
    code = "import sys; import hystid; print(*sorted({'numpy', 'scipy', 'torch', 'plotly', 'fmpy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
    assert Path(hystid.__file__).with_name("py.typed").exists()


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_every_public_function_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    function = EXAMPLES[name]
    # The example of ``demo`` is not run here: tests/test_demo.py runs a small one.
    found = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    assert found and found[0].examples, f"{name} has no example"
    said: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcome = doctest.DocTestRunner(verbose=False).run(found[0], out=said.append)
    assert outcome.failed == 0, "".join(said)


@pytest.fixture(scope="module")
def recording() -> Recording:
    t = np.arange(2000) * 1e-3
    x = 1e-3 * np.sin(2 * np.pi * 5 * t)
    v = 1e-3 * 2 * np.pi * 5 * np.cos(2 * np.pi * 5 * t)
    return Recording("tone <b>", t, F=1e4 * x + 3 * np.sign(v), x=x, v=v)


def test_a_recording_shows_and_saves_itself(recording: Recording, tmp_path: Path) -> None:
    assert "2000 samples at 1000 Hz" in recording.summary()
    assert "tone &lt;b&gt;" in recording._repr_html_()
    assert recording.plot().layout.xaxis.title.text == "Time t [s]"
    assert "Force F over displacement" in recording.plots()
    with pytest.raises(UsageError, match="the figures are: Force F; Displacement x"):
        recording.plot("nonsense")
    again = hystid.read(recording.save(tmp_path / "tone.csv"))
    assert np.array_equal(again.channel("F"), recording.channel("F"))


def test_a_saved_diagnosis_is_what_a_run_writes(tmp_path: Path) -> None:
    rig = hystid.build("HystId.Oscillators.Jenkins", tmp_path / "rig.fmu")
    sweep = hystid.simulate(rig, "chirp:1-40Hz@40N,2s", dt=1e-3, noise_snr=40)
    answer = hystid.diagnose(sweep, model="HystId.Oscillators.Linear", parameters={"m": 1.0}, out=tmp_path / "run")
    folder = replace(answer, folder=None).save(tmp_path / "saved")  # as of a diagnosis that named no folder
    written = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"extended.mo", "extended.fmu"} <= written <= {path.name for path in folder.iterdir()}
    assert (folder / "diagnosis.json").read_text() == (tmp_path / "run" / "diagnosis.json").read_text()
    assert answer.summary().startswith(answer.verdict.replace("_", " "))
    assert answer.plot().data
    assert answer.verdict.capitalize().replace("_", " ") in answer._repr_html_()


def test_a_regression_shows_and_saves_itself(tmp_path: Path) -> None:
    old = hystid.build("HystId.Oscillators.Linear", tmp_path / "old.fmu", parameters={"m": 1.0})
    new = hystid.build("HystId.Oscillators.Linear", tmp_path / "new.fmu", parameters={"m": 1.5})
    outcome = hystid.regress(new, reference=Path(old))
    assert "new.fmu: differs" in outcome.summary() and "signals differ" in outcome._repr_html_()
    folder = outcome.save(tmp_path / "shown")
    assert {"regression.json", "report.html"} <= {path.name for path in folder.iterdir()}
    assert "hystid.regress(...)" in (folder / "report.html").read_text()
    assert set(outcome.plots()) == {"x", "v", "a", "R"}
    assert outcome.plot("v").layout.yaxis.title.text.startswith("v [")
    assert not outcome.as_dict()["passed"] and outcome.as_dict()["signals"][0]["unit"]
