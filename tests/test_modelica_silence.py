"""Relations on which nothing depends make no event, and nothing else changes by that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.modelica import compile_model
from hystid.modelica.causalise import causalise
from hystid.modelica.compile import flat_model
from hystid.modelica.expr import Op

HEAD = """
model M
  input Real u;
  output Real y;
protected
  Real z(start = 0, fixed = true);
  Boolean b;
equation
  y = z;
"""


def silent(model: str) -> list[bool]:
    """Of each relation, in the order of the text: whether its indicator may rest."""
    relations = causalise(flat_model(model), {}).relations
    return [any(isinstance(i, Op) and i.name == "if" for i in relation.indicators) for relation in relations]


@pytest.mark.parametrize(
    ("equations", "expected"),
    [
        ("b = z > 1 and u > 0; der(z) = if b then 0 else u;", [True, False]),  # not asked for while u <= 0
        ("b = u > 0 and z > 1; der(z) = if b then 0 else u;", [True, False]),  # of two the first rests
        ("b = z > 1 or u > 0; der(z) = if b then 0 else u;", [True, False]),
        ("b = if u > 0 then z > 1 else z > 2; der(z) = if b then 0 else u;", [False, True, True]),
        ("b = z > 1; der(z) = if b and u > 0 then 0 else u;", [False, False]),  # b itself can be seen
        # z > 1 is asked for elsewhere as well
        ("b = z > 1 and u > 0; der(z) = if b then 0 else if z > 1 then 0.5*u else u;", [False, True]),
        ("b = (z > 1 and u > 0) or (z < -1 and u < 0); der(z) = if b then 0 else u;", [True, False, True, False]),
        ("b = not (z > 1 and u > 0); der(z) = if b then u else 0;", [True, False]),
        ("b = (z > 1 and u > 0) and u < 2; der(z) = if b then 0 else u;", [True, False, False]),
    ],
)
def test_what_may_rest(tmp_path: Path, equations: str, expected: list[bool]) -> None:
    place = tmp_path / "m.mo"
    place.write_text(HEAD + equations + "\nend M;\n")
    assert silent(f"{place}:M") == expected


def test_the_sliders_of_an_iwan_joint_rest_while_the_motion_is_away_from_their_limits() -> None:
    assert sum(silent("HystId.Oscillators.Iwan")) == 16  # two limits of eight sliders; the sign of v is heard always


@pytest.mark.parametrize("condition", ["z >= 1 and u > 0", "u > 0 and z >= 1", "if u > 0 then z >= 1 else false"])
def test_the_answer_does_not_depend_on_which_relation_rests(tmp_path: Path, condition: str) -> None:
    """A one-sided elastic slider under a rate u: z follows u but for 1, where it stays; exact in steps of the path."""
    place = tmp_path / "m.mo"
    place.write_text(HEAD + f"b = {condition}; der(z) = if b then 0 else u;\nend M;\n")
    t = np.arange(4001) * 1e-3
    u = 3 * np.cos(5 * t) + 2 * np.cos(11.3 * t)
    found = CompiledModel(compile_model(f"{place}:M")).simulate({"u": u}, 1e-3, outputs=["y"], interpolation="linear")
    fine = 20  # the input is linear between samples: its integral is exact by the trapezoidal rule on a finer grid
    between = np.interp(np.arange(4000 * fine + 1) / fine, np.arange(4001), u)
    steps = 0.5 * (between[1:] + between[:-1]) * 1e-3 / fine
    z, expected = 0.0, [0.0]
    for k, step in enumerate(steps):
        z = min(z + step, 1.0)
        if k % fine == fine - 1:
            expected.append(z)
    # the oracle turns at its grid points: half a step of 5e-5 s near a reversal, where u changes by 100 per second
    np.testing.assert_allclose(found["y"], expected, atol=2e-7)
