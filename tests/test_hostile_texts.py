"""Texts of files and options that hang, or are accepted and fail later: units, and what ``--accept`` forgives."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hystid.cli.options import parameter_file
from hystid.cli.run import run
from hystid.diagnosis.prepare.given import given_parameters
from hystid.errors import HystidError, UsageError
from hystid.recording import read, text
from hystid.recording.problems import RULES
from hystid.units import is_modelica, parse

ENDLESS = ["9**9**9", "9^9^9", "(9**9)**9", "9**-9**9", "9**(9**(9**9))", "kg^9^9^9", "m**999", "9e999 m", "a" * 70_000]
ENDLESS += ["m" * 70_000, "Gm99.Gm99", "kg99999999999", "m*" * 40_000 + "m", "(" * 70_000, "99999999**999 m"]


def test_units_end() -> None:
    """In a process with a limit: before, the first of these computed for hours."""
    code = (
        "import sys\nfrom hystid.units import parse, is_modelica\nfrom hystid.errors import UsageError\n"
        "for text in sys.stdin.read().split(chr(10)):\n"
        "    is_modelica(text)\n"
        "    try: parse(text)\n"
        "    except UsageError as error: print(len(str(error)) < 200)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], input="\n".join(ENDLESS), capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.split() == ["True"] * len(ENDLESS)


@settings(deadline=None)
@given(st.one_of(st.text(max_size=80), st.text("9mkgN.*^/()-+ e1", max_size=30)))
def test_any_text_is_a_unit_or_refused(text: str) -> None:
    is_modelica(text)
    try:
        unit = parse(text)
    except UsageError:
        return
    assert 0 < unit.factor < math.inf and math.isfinite(unit.offset)


@pytest.mark.parametrize(
    "text", ["1" + "0" * 400, "-" + "9" * 3000, "9" * 5000, "1e999", "[" * 20_000, "NaN", '"x"', '1, "m": 2']
)
def test_parameters_of_any_size_are_one_sentence(tmp_path: Path, text: str) -> None:
    """Whole numbers of JSON have any number of digits; one of 400 was no number for NumPy, and a traceback. Of two
    values of one name the last one was taken."""
    path = tmp_path / "p.json"
    path.write_text(f'{{"m": {text}}}')
    for reads in (given_parameters, parameter_file):
        with pytest.raises(UsageError, match=r"p\.json"):
            reads(path)


_ROWS = [f"{k / 100},{math.sin(k / 5)},{math.sin(k / 5 - 0.1)}" for k in range(60)]
_ALL = "\n".join(["t [s],F [N],x [m]", *_ROWS])
BAD = {
    "no clock": "\n".join(["F [N],x [m]", *(row.partition(",")[2] for row in _ROWS)]),
    "no force": "\n".join(["t [s],x [m]", *(row.rpartition(",")[0] for row in _ROWS)]),
    "one sample": "\n".join(["t [s],F [N],x [m]", _ROWS[0]]),
    "a clock with a gap": _ALL.replace("0.2,", "nan,"),
    "a clock that stands": "\n".join(["t [s],F [N],x [m]", *["0,1,2"] * 40]),
    "a clock that runs back": "\n".join(["t [s],F [N],x [m]", *reversed(_ROWS)]),
    "a word": _ALL.replace("0.1,", "0.1q,"),
    "another unit": _ALL.replace("F [N]", "F [mm]"),
    "a sample of 1e308": _ALL.replace(_ROWS[30], "0.3,1e308,-1e308"),
}


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_whatever_is_accepted_a_file_is_read_or_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(BAD[kind])
    for number in (0, 1, 2, len(RULES)):
        for accepted in itertools.combinations(RULES, number):
            try:
                read(path, accept=accepted)
            except HystidError as error:
                assert str(error).startswith("bad.csv")


def _table(t: str = "{0}e-3", size: float = 1.0, n: int = 400) -> list[str]:
    return [f"{t.format(k)},{size * math.sin(k / 5):.9g},{size * math.sin(k / 5 - 0.1):.9g}" for k in range(n)]


_HEAD = "t [s],F [N],x [mm]"
EXTREME = {
    "one line of 25 million cells": f"{_HEAD}\n{'1,' * 25_000_000}",
    "a name of 70,000 letters": "\n".join([_HEAD.replace("F", "F" + "q" * 70_000), *_table()]),
    "a name of 10,000 blanks": "\n".join([_HEAD.replace("F", "F" + " " * 10_000 + "q"), *_table()]),
    "numbers whose squares vanish": "\n".join([_HEAD, *_table(size=1e-300)]),
    "steps of 1e-300 s": "\n".join([_HEAD, *_table("{0}e-300")]),
    "steps of 1e300 s": "\n".join([_HEAD, *_table("{0}e300", n=100)]),
    "a force of NaN": "\n".join([_HEAD, *(f"{row.split(',')[0]},nan,{row.split(',')[2]}" for row in _table())]),
}


@pytest.mark.parametrize("kind", EXTREME)
def test_extremes_are_taken_or_refused_in_short_words(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """They ended in internal errors, in minutes of work, or in a warning of 70,000 letters."""
    path = tmp_path / "extreme.csv"
    path.write_text(EXTREME[kind])
    assert run(["check", str(path)]) == (0 if "name" in kind else 2)
    said = capsys.readouterr().err
    assert len(said) < 2000 and "internal" not in said


def test_few_of_many_comments_are_searched_for_a_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million of them took half a minute."""
    searched: list[str] = []
    monkeypatch.setattr(text, "announced", lambda line: searched.append(line))
    path = tmp_path / "notes.csv"
    path.write_text("#\n" * 50_000 + f"# {'x' * 100_000}\n" + "\n".join([_HEAD, *_table()]))
    assert len(read(path)) == 400
    assert 0 < len(searched) <= 2000 and max(map(len, searched)) <= 1000


def test_a_preamble_with_odd_dates_is_read(tmp_path: Path) -> None:
    """A date with a digit too many looks like a number with marks of thousands (found by fuzzing)."""
    rows = [f"{k / 1000};{math.sin(k / 5)};{math.sin(k / 5 - 0.1)}".replace(".", ",") for k in range(300)]
    path = tmp_path / "odd.csv"
    path.write_text("\n".join(["Logger 7;v2", "Datum;23.111.2026", "", "Zeit;Kraft;Weg", "s;kN;mm", *rows]))
    assert len(read(path)) == 300
