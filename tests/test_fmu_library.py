"""fmus/: the library's models still answer as their reference tables say, and their pages are those of the models."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest

from hystid.fmu import build_model, regress

FMUS = Path(__file__).parents[1] / "fmus"
_SPEC = importlib.util.spec_from_file_location("fmus_make", FMUS / "make.py")
assert _SPEC and _SPEC.loader
make = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(make)


def test_every_oscillator_has_a_folder():
    assert sorted(path.name for path in FMUS.iterdir() if path.is_dir() and path.name[0].isupper()) == make.models()


@pytest.mark.parametrize("model", make.models())
def test_the_model_answers_as_its_reference_says(tmp_path, model):
    """Seven digits are kept; the tube is a thousandth of each signal's range."""
    path = build_model(f"HystId.Oscillators.{model}", tmp_path / f"{model}.fmu").path
    for end in ("in", "out"):
        shutil.copy(FMUS / model / f"{model}_{end}.csv", tmp_path)
    result = regress(path)
    assert result.passed and len(result.signals) == 4, result.summary()


@pytest.mark.parametrize("model", make.models())
def test_the_page_is_that_of_the_model(model):
    assert (FMUS / model / "README.md").read_text(encoding="utf-8") == make.readme(model), "run python fmus/make.py"
