"""The demo at reduced size: every part runs, every file is there, the targets are judged and not assumed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from hystid.virtual_experiment import Check, Outcome, Size, demo


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return demo(tmp_path_factory.mktemp("demo"), Size(starts=3, lab_starts=2, samples=15_000))


def values(outcome: Outcome) -> dict[str, float]:
    return {check.what: check.value for check in outcome.checks}


def test_everything_is_written(outcome: Outcome) -> None:
    expected = [
        "jenkins.fmu", "recordings/chirp_105N.csv", "identification/surrogate.fmu", "identification/surrogate.onnx",
        "identification/oscillator.fmu", "identification/report.html", "validation/report.html",
        "validation/validation.json", "lab/rig.fmu", "lab/diagnosis.json", "lab/extended.mo", "lab/extended.fmu",
        "lab/report.html", "report.html", "demo.json",
    ]  # fmt: skip
    missing = [name for name in expected if not (outcome.folder / name).exists()]
    assert not missing


def test_three_starts_learn_the_loop_roughly(outcome: Outcome) -> None:
    """With a tenth of the starts and a third of the samples the figures are about twice those of the full demo."""
    found = values(outcome)
    assert found["force NRMSE, worst"] < 12
    assert found["free-run displacement NRMSE, worst"] < 25


def test_the_concealed_loss_of_contact_is_found_where_it_is(outcome: Outcome) -> None:
    found = values(outcome)
    assert found["concealed loss of contact is named first"] == 1
    assert found["displacement at which contact is lost, off by"] < 5
    assert found["even harmonics of R on unseen tests, worst difference"] < 3


def test_the_page_tells_the_story_in_order(outcome: Outcome) -> None:
    text = (outcome.folder / "report.html").read_text(encoding="utf-8")
    places = [text.index(f">{number}  ") for number in range(1, 6)]
    assert places == sorted(places)
    assert len(text) < 15e6
    assert "contact loss" in text
    for name in ("identification/report.html", "validation/report.html", "lab/report.html"):
        assert f'href="{name}"' in text


def test_the_summary_says_what_was_missed(outcome: Outcome) -> None:
    written = json.loads((outcome.folder / "demo.json").read_text())
    assert written["passed"] == outcome.passed == all(check.passed for check in outcome.checks)
    assert outcome.summary().count("MISSED") == sum(not check.passed for check in outcome.checks)


def test_a_target_is_missed_by_nan_and_met_on_the_limit() -> None:
    assert Check("p", "w", 3.0, 3.0).passed
    assert not Check("p", "w", math.nan, 3.0).passed
    assert not Check("p", "w", 0.0, 1.0, least=True).passed
    assert not Outcome(Path(), (Check("p", "w", 4.0, 3.0, "%"),)).passed
