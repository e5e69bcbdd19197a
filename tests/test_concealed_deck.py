"""A small deck of concealed cases through the diagnosis, graded as the benchmark does it, and the lab case.

The cases are plain ones (34 dB, one effect that is well visible after the refit): each has to be answered right. How
the diagnosis does on hard and doubtful cases is measured by ``make concealed``, not asserted here.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmarks.concealed.deck import CaseSpec
from benchmarks.concealed.generate import generate
from benchmarks.concealed.grade import Grade, area_under_curve, contract_problems, grade
from hystid.diagnosis import diagnose

DECK = (
    CaseSpec("null", (), "linear", "linear"),
    CaseSpec("null", (), "boucwen", "boucwen"),
    CaseSpec("single", ("quadratic_stiffness",), "linear", "linear"),
    CaseSpec("single", ("channel_delay",), "linear", "linear"),
    CaseSpec("stranger", ("parametric_excitation",), "linear", "linear"),
    CaseSpec("wrong_baseline", (), "boucwen", "linear"),
)


def answered(spec: CaseSpec, folder: Path) -> tuple[Grade, dict[str, object]]:
    (case,) = generate(folder, 271828, [spec])
    handed, out = json.loads((case / "case.json").read_text()), folder / "out"
    diagnose(
        [case / name for name in handed["recordings"]],
        model=handed["model"],
        parameters=case / "parameters.json",
        holdout=[case / name for name in handed["holdout"]],
        out=out,
    )
    answer = json.loads((out / "diagnosis.json").read_text())
    truth = json.loads((folder / "sealed" / f"{case.name}.json").read_text())
    return grade(case.name, truth, answer, out, folder / "sealed"), answer


@pytest.mark.parametrize("spec", DECK, ids=lambda s: "-".join((s.group, *s.ids, s.family)))
def test_plain_case_is_answered_right(spec: CaseSpec, tmp_path: Path) -> None:
    graded, answer = answered(spec, tmp_path)
    assert contract_problems(answer) == []
    assert not graded.wrong_name
    assert graded.false_alarm in (False, None)
    assert graded.class_right in (True, None)
    assert graded.unknown_right in (True, None)


def test_lab_case_is_found_and_predicted(tmp_path: Path) -> None:
    """The loss of contact by name and place, and free runs on unseen harmonics within 10 % of the oracle's."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    try:
        import lab_case
    finally:
        sys.path.pop(0)
    seen, unseen = lab_case.record()
    out = tmp_path / "out"
    diagnose(seen, model=lab_case.BELIEVED, parameters=lab_case.NOMINAL, holdout=unseen, out=out)
    answer = json.loads((out / "diagnosis.json").read_text())
    assert [f["effect"] for f in answer["findings"]] == ["contact_loss"]
    # 34 dB of noise on 50,000 samples: the fit scatters by less than 1 %; 3 % leaves room for another platform
    assert answer["findings"][0]["parameters"]["gap"]["value"] == pytest.approx(1.2e-3, rel=0.03)
    oracle = lab_case.oracle_errors(unseen)
    for entry in answer["fit"]["holdout"]:
        assert entry["before"] > 4 * oracle[entry["name"]]
        assert entry["after"] < 1.1 * oracle[entry["name"]]


def test_area_under_curve_of_known_orders() -> None:
    import numpy as np

    score = np.array([0.1, 0.4, 0.35, 0.8])
    assert area_under_curve(score, np.array([False, False, True, True])) == 0.75  # three of four pairs in order
    assert area_under_curve(np.zeros(4), np.array([False, True, False, True])) == 0.5
