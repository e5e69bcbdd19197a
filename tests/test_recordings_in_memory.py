"""Recordings that a program made of arrays keep the rules of those that are read from files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hystid import check, diagnose, identify, prepare, read, regress, simulate, study, validate
from hystid.diagnosis.prepare.given import given_parameters
from hystid.errors import HystidError
from hystid.recording import Recording

N = 400
T = np.arange(N) / 500.0
X = 1e-3 * np.sin(30 * T)
F = 1e3 * X
LINEAR = "HystId.Oscillators.Linear"

ENTRIES: dict[str, Callable[[Any], object]] = {
    "check": lambda source: check([source], mass=0.0),
    "diagnose": lambda source: diagnose([source], model=LINEAR, parameters={"m": 0}),
    "identify": lambda source: identify([source], mass=0.0, ensemble=1),
    "prepare": prepare,
}


def holed(values: np.ndarray) -> np.ndarray:
    """Without its eighth sample."""
    return np.where(np.arange(N) == 7, np.nan, values)


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"F": F[:5]}, "channel F has 5 samples, and t has 400"),
        ({"F": holed(F)}, "channel F: 1 samples are no numbers, the first is sample 7"),
        ({"F": F[:, None]}, "channel F: one row of samples is needed, found shape (400, 1)"),
        ({"F": F + 1j}, "channel F: real numbers are needed, found complex128"),
        ({"x": X.astype(str)}, "channel x: real numbers are needed"),
        ({"t": T[::-1]}, "time does not increase at sample 1"),
        ({"t": T**2 + T}, "steps off a uniform grid"),
        ({"t": T[:5], "F": F[:5], "x": X[:5]}, "at least 16 samples are needed, found 5"),
        ({"t": None}, "at least 16 samples are needed, found 0"),
        ({"extra": {"u_mr": T[:3]}}, "channel u_mr has 3 samples"),
    ],
)
def test_columns_that_are_no_recording_are_refused_in_a_sentence(entry: str, columns: dict, told: str) -> None:
    with pytest.raises(HystidError) as refused:
        ENTRIES[entry](Recording("mine", **{"t": T, "F": F, "x": X, **columns}))
    assert told in str(refused.value)
    assert str(refused.value).startswith("mine")


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("source", [5, {"t": T}, None, np.stack([T, F, X])])
def test_what_is_neither_file_nor_recording_is_refused(entry: str, source: object) -> None:
    with pytest.raises(HystidError, match=r"hystid\.Recording\(name, t"):
        ENTRIES[entry](source)


def test_a_mass_is_a_number() -> None:
    made = Recording("mine", T, F=F, x=X)
    with pytest.raises(HystidError, match="mass must be a number"):
        check([made], mass="2")  # type: ignore[arg-type]  # as a user would write it
    with pytest.raises(HystidError, match="mass must be a number"):
        identify([made], mass="2")  # type: ignore[arg-type]  # the same


WRONG_TYPES: dict[str, tuple[Callable[[Any], object], Any]] = {
    "a recording is a file, and this is of type int": (read, 3),
    "an FMU is a file, and this is of type int": (regress, 3),
    "an FMU is a file, and this is of type NoneType": (lambda fmu: simulate(fmu, "harmonic:5Hz@1N,1s"), None),
    "parameters: parameters are an object of name: value, not a list": (
        lambda given: diagnose([Recording("mine", T, F=F, x=X)], model=LINEAR, parameters=given),
        [2.5],
    ),
    r"layers must be .*found '5,5'": (lambda layers: identify("no.csv", mass=0.0, layers=layers), "5,5"),
    "layers must be .*found 5": (lambda layers: identify("no.csv", mass=0.0, layers=layers), 5),
    "band '5-50Hz': two frequencies": (lambda band: prepare(Recording("mine", T, F=F, x=X), band=band), "5-50Hz"),
    "is of type ndarray": (lambda table: diagnose(table, model=LINEAR), np.stack([T, F, X])),
    "--dt a: a time step": (lambda dt: simulate("no.fmu", "harmonic:5Hz@1N,1s", dt=dt), "a"),
}


@pytest.mark.parametrize("said", WRONG_TYPES)
def test_what_is_no_path_and_no_number_is_told_in_a_sentence(said: str) -> None:
    call, given = WRONG_TYPES[said]
    with pytest.raises(HystidError, match=said):
        call(given)


class Labelled:
    """A column with labels of its own, as in a data frame: -1 is none of them."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = dict(enumerate(values))

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, label: int) -> float:
        return self.values[label]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(list(self.values.values()), dtype)


MASKED = np.ma.masked_less(X, -0.9e-3)
KINDS: dict[str, Callable[[Any], Any]] = {
    "list": list,
    "column of a data frame": lambda values: Labelled(values),
    "single precision": np.float32,
    "read only": lambda values: np.broadcast_to(values, (N,)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_columns_may_be_of_any_kind_that_holds_numbers(kind: str) -> None:
    made = Recording("mine", KINDS[kind](T), F=KINDS[kind](F), x=KINDS[kind](X), extra={"u_mr": KINDS[kind](X)})
    for values in (made.t, made.F, made.x, made.extra["u_mr"]):
        assert isinstance(values, np.ndarray)
        assert values.dtype == np.float64
    assert "400 samples at 500 Hz" in made.summary()
    np.testing.assert_allclose(made.x, X, rtol=1e-6)  # single precision holds seven digits
    assert not check([made], mass=0.0).refusals


def test_masked_samples_are_no_numbers() -> None:
    with pytest.raises(HystidError, match=f"{MASKED.mask.sum()} samples are no numbers"):
        check([Recording("mine", T, F=F, x=MASKED)], mass=0.0)


def test_numbers_of_numpy_are_parameters() -> None:
    given = given_parameters({"m": np.float32(2.5), "n": np.int64(3)})
    assert given.values == {"m": 2.5, "n": 3.0}


TOGETHER: dict[str, Callable[..., object]] = {
    "diagnose": lambda used, unseen: diagnose(used, model=LINEAR, parameters={"m": 0}, holdout=unseen),
    "identify": lambda used, unseen: identify(used, mass=0.0, ensemble=1, holdout=unseen),
    "study": lambda used, unseen: study.grid(used, holdout=unseen, mass=0.0, out=Path("study")),
}
ONCE = Recording("once", T, F=F, x=X)
TWICE = Recording("twice", T, F=2 * F, x=2 * X)


@pytest.mark.parametrize("entry", TOGETHER)
def test_one_test_counts_once(entry: str) -> None:
    with pytest.raises(HystidError, match="again has the same samples as once"):
        TOGETHER[entry]([ONCE, replace(ONCE, name="again")], [TWICE])
    with pytest.raises(HystidError, match=r"again is held out and used \(once has the same samples\)"):
        TOGETHER[entry]([ONCE], [replace(ONCE, name="again")])


@pytest.mark.parametrize("entry", TOGETHER)
def test_rigs_that_turn_and_that_do_not_are_two(entry: str) -> None:
    with pytest.raises(HystidError, match="the rig turns in twice"):
        TOGETHER[entry]([ONCE], [replace(TWICE, rotational=True)])


def test_a_surrogate_is_compared_with_its_own_kind_of_rig(tmp_path: Path) -> None:
    model = identify([ONCE, TWICE], mass=0.0, ensemble=1, method="published", workers=1).save(tmp_path / "model")
    for file in ("surrogate.fmu", "surrogate.onnx"):
        assert validate(model / file, ONCE).figures("force_nrmse").size == 1
        with pytest.raises(HystidError, match="once is of a rig that turns"):
            validate(model / file, replace(ONCE, rotational=True))


@pytest.mark.parametrize("n", [0, 1])
def test_a_summary_of_next_to_no_samples_is_refused_in_a_sentence(n: int) -> None:
    with pytest.raises(HystidError, match=f"short: at least two samples are needed for a time step, found {n}"):
        Recording("short", np.zeros(n), F=np.zeros(n), x=np.zeros(n)).summary()


@pytest.mark.parametrize("option", ["units", "sensitivity", "names"])
def test_a_wish_that_is_no_text_is_refused(option: str, tmp_path: Path) -> None:
    Recording("test", T, F=F, x=X).save(tmp_path / "test.csv")
    with pytest.raises(HystidError, match=f"{option}: that of x must be a text, found 3"):
        read(tmp_path / "test.csv", **{option: {"x": 3}})
