"""Modelica text that the program writes."""

from __future__ import annotations

import pytest

from hystid.modelica_text import class_texts, modifiers


def test_modifiers_of_components_stand_in_their_parentheses() -> None:
    settings = {"m": "2", "gap.k": "1", "gap.stop.c": "3", "gap.d": "4"}
    assert ", ".join(modifiers(settings)) == "m = 2, gap(k = 1, d = 4, stop(c = 3))"


@pytest.mark.parametrize("before", ["", "// within reach;\n", "/* of\nall */ "])
@pytest.mark.parametrize("clause", ["", "within;\n", "within A.B;\n"])
def test_a_class_loses_its_within_clause_and_nothing_else(before: str, clause: str) -> None:
    body = 'model M "is\nwithin a range;\n"\nend M;'
    assert class_texts(f"{before}{clause}{body}\n") == before + body
