"""Modelica text that the program writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from hystid.modelica_text import class_texts, modifiers, with_class


def test_modifiers_of_components_stand_in_their_parentheses() -> None:
    settings = {"m": "2", "gap.k": "1", "gap.stop.c": "3", "gap.d": "4"}
    assert ", ".join(modifiers(settings)) == "m = 2, gap(k = 1, d = 4, stop(c = 3))"


def test_modifiers_of_elements_stand_together() -> None:
    settings = {"k[1]": "1", "k[2]": "2", "w[1,1]": "3", "w[1,2]": "4"}
    settings |= {f"s[{i}].c[{j}]": f"{i}{j}" for i in (1, 2) for j in (1, 2)}
    assert modifiers(settings) == ["k = {1, 2}", "w = {{3, 4}}", "s(c = {{11, 12}, {21, 22}})"]


@pytest.mark.parametrize(
    ("text", "name"), [("model A end A;", "A"), ("model Extended end Extended;\nmodel A end A;", "Extended")]
)
def test_a_file_alone_stands_for_its_only_model_or_what_a_diagnosis_wrote(tmp_path: Path, text: str, name: str) -> None:
    path = tmp_path / "a.mo"
    path.write_text(text)
    assert with_class(str(path)) == f"{path}:{name}" and with_class(f"{path}:B") == f"{path}:B"


@pytest.mark.parametrize("before", ["", "// within reach;\n", "/* of\nall */ "])
@pytest.mark.parametrize("clause", ["", "within;\n", "within A.B;\n"])
def test_a_class_loses_its_within_clause_and_nothing_else(before: str, clause: str) -> None:
    body = 'model M "is\nwithin a range;\n"\nend M;'
    assert class_texts(f"{before}{clause}{body}\n") == before + body
