"""The command line: helps, exits, messages, shared options."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hystid.cli.groups import ReadingOptions
from hystid.cli.options import layer_sizes, numbers, pairs, parameter_file
from hystid.cli.run import run, spread
from hystid.errors import UsageError
from hystid.recording import Recording, write_csv

COMMANDS = [
    "build",
    "simulate",
    "identify",
    "validate",
    "diagnose",
    "study grid",
    "study mass",
    "demo",
    "regress",
    "cache",
]


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_every_command_explains_itself_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*command.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert "Usage: hystid" in text
    if command:
        assert f"\n    hystid {command}" in text


def test_every_option_is_described(capsys: pytest.CaptureFixture[str]) -> None:
    for command in COMMANDS:
        run([*command.split(), "--help"])
        lines = capsys.readouterr().out.partition("Options:")[2].splitlines()
        for line in lines:
            if line.startswith("  -"):
                described = len(line.split("  ")) > 2 or not line.strip().endswith(")")
                assert described and len(line) > 24, f"{command}: {line}"


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("build test.csv -o m.fmu", "test.csv: a model is needed here"),
        ("diagnose test.csv --model test.csv -o out", "test.csv: a model is needed here"),
        ("build HystId.Oscillators.Linear --set k=3 -o m.fmu", "has no parameter 'k'; it has B, Kl, m"),
        ("build net.onnx --target c --fmi 3 -o net.c", "--fmi: only FMUs have it"),
        ("build net.onnx --target c --set k=3 -o net.c", "--set: only FMUs have it"),
        ("build net.onnx --real float -o net.fmu", "--real float: FMUs hold double numbers"),
        ("simulate m.fmu --force test.csv --dt 0.01 -o answer.csv", "--dt 0.01: test.csv is a recording"),
        ("check test.csv -o ", "-o '': the name is empty"),
    ],
)
def test_what_would_be_misread_or_ignored_is_refused(
    command: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    wave = np.sin(0.1 * np.arange(400.0))
    write_csv(Recording("test", 1e-3 * np.arange(400.0), F=1e3 * wave, x=1e-3 * wave), tmp_path / "test.csv")
    assert run(command.split(" ")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line and [path.name for path in tmp_path.iterdir()] == ["test.csv"]


def test_the_version_and_no_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("hystid ")
    assert run([]) == 0
    assert "Commands:" in capsys.readouterr().out


def test_python_dash_m_starts_without_heavy_imports() -> None:
    code = (
        "import sys; from hystid.cli import run as r; r.run(['--help']); r.run(['diagnose', '--help']);"
        "heavy = {'torch', 'scipy', 'pint', 'numpy', 'plotly', 'onnx', 'casadi', 'rumoca', 'fmpy'} & set(sys.modules);"
        "sys.exit(', '.join(sorted(heavy)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole = subprocess.run([sys.executable, "-m", "hystid", "--version"], capture_output=True, text=True, check=True)
    assert whole.stdout.startswith("hystid ")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nonsense"], "No such command 'nonsense'"),
        (["simulate"], "Missing argument 'FMU'"),
        (
            ["identify", "a.csv", "--mass", "heavy", "-o", "d"],
            "--mass heavy: 'heavy' is no number",
        ),
        (["identify", "a.csv", "--mas", "1", "-o", "d"], "--mass"),
        (["identify", "missing.csv", "--mass", "1", "-o", "d"], "missing.csv: there is no such file"),
        (["study"], ""),
    ],
)
def test_misuse_is_one_line_with_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    message = capsys.readouterr().err
    assert says in message
    assert len(message.splitlines()) <= 1
    assert "Traceback" not in message


def test_an_interrupted_command_says_what_is_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(path: Path) -> None:
        raise KeyboardInterrupt

    import hystid.simulation

    monkeypatch.setattr(hystid.simulation, "force_of", lambda *_: interrupted(Path()))
    assert run(["simulate", "a.fmu", "--force", "harmonic:20Hz@80N,2s", "-o", "a.csv"]) == 130
    assert "kept" in capsys.readouterr().err


def test_a_defect_is_one_line_and_a_traceback_only_on_demand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import hystid.simulation

    def broken(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(hystid.simulation, "force_of", broken)
    arguments = ["simulate", "a.fmu", "--force", "harmonic:20Hz@80N,2s", "-o", "a.csv"]
    assert run(arguments) == 1
    assert "internal error (ZeroDivisionError: by nothing)" in capsys.readouterr().err
    monkeypatch.setenv("HYSTID_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        run(arguments)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("diagnose a b --holdout h g --model M", "diagnose a b --holdout h --holdout g --model M"),
        ("diagnose --holdout h a b --model M", "diagnose --holdout h a b --model M"),
        ("build M --set a=1 b=-2 -o x.fmu", "build M --set a=1 --set b=-2 -o x.fmu"),
        ("diagnose --resample a b --effects x.mo y.mo", "diagnose --resample a b --effects x.mo --effects y.mo"),
        (
            "validate s --force harmonic:1Hz@1N,1s harmonic:2Hz@1N,1s r",
            "validate s --force harmonic:1Hz@1N,1s --force harmonic:2Hz@1N,1s r",
        ),
    ],
)
def test_options_take_several_values_where_they_cannot_be_mistaken(given: str, meant: str) -> None:
    assert spread(given.split()) == meant.split()


def test_texts_of_options() -> None:
    assert numbers("--set", ["Ks=2e5", "m = 4.2", "stiff=false"]) == {"Ks": 2e5, "m": 4.2, "stiff": 0}
    assert pairs("--channel", ["F=Load cell"]) == {"F": "Load cell"}
    assert layer_sizes("5,5") == layer_sizes("5-5") == (5, 5)


@pytest.mark.parametrize("text", ["Ks", "=3", "Ks=", "Ks=abc", "Ks=inf"])
def test_wrong_parameter_texts(text: str) -> None:
    with pytest.raises(UsageError, match="--set"):
        numbers("--set", [text])


def test_a_parameter_given_twice_is_refused() -> None:
    with pytest.raises(UsageError, match="given twice: 1 and 2"):
        numbers("--set", ["a=1", "a=2"])


@pytest.mark.parametrize("text", ["", "5,x", "0,5", "-5", "5,,5"])
def test_wrong_layers(text: str) -> None:
    with pytest.raises(UsageError, match="as 5,5"):
        layer_sizes(text)


def test_parameter_files(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    content = {"m": 4.2, "Ks": {"value": 2e5, "fixed": True}}
    path.write_text(json.dumps(content))
    assert parameter_file(path) == content
    for text in ("[1]", "{", '{"m": "heavy"}', '{"m": null}'):
        path.write_text(text)
        with pytest.raises(UsageError, match=r"p\.json"):
            parameter_file(path)
    with pytest.raises(UsageError, match=r"--set m=4\.2$"):
        parameter_file(Path("m=4.2"))


def test_warnings_of_recordings_reach_the_user(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(200) * 1e-3
    late = t + np.where(np.arange(200) >= 20, 0.3, 0.0)
    x = 1e-3 * np.sin(60 * t)
    write_csv(Recording("gap", late, F=5e4 * x + 2 * np.cos(60 * t), x=x), tmp_path / "gap.csv")
    ReadingOptions().load([tmp_path / "gap.csv"])
    assert "hystid: warning: gap.csv" in capsys.readouterr().err


def test_a_model_that_explains_nothing_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A force of noise beside a motion that knows nothing of it."""
    t = np.arange(2000) * 1e-3
    force = np.random.default_rng(1).standard_normal(len(t))
    write_csv(Recording("noise", t, F=force, x=1e-3 * np.sin(44 * t)), tmp_path / "noise.csv")
    options = ["--mass", "0", "--ensemble", "1", "--layers", "3", "-o", str(tmp_path / "out")]
    assert run(["identify", str(tmp_path / "noise.csv"), *options]) == 1
    assert "this model is of no use: the force is as unexplained" in capsys.readouterr().out
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "This model is of no use" in report
    assert json.loads((tmp_path / "out" / "identification.json").read_text())["failure"]
