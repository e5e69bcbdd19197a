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
from hystid.diagnosis.prepare.given import given_parameters
from hystid.errors import HystidError, UsageError
from hystid.recording import read
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


@pytest.mark.parametrize("text", ["1" + "0" * 400, "-" + "9" * 3000, "9" * 5000, "1e999", "[" * 20_000, "NaN", '"x"'])
def test_parameters_of_any_size_are_one_sentence(tmp_path: Path, text: str) -> None:
    """Whole numbers of JSON have any number of digits; one of 400 was no number for NumPy, and a traceback."""
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
