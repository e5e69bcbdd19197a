"""Tables in time, by the names that the Modelica Standard Library gives them: their jumps are events of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model

FILES = {
    "Tab/package": "package Tab end Tab;",
    "Tab/Types": """within Tab;
package Types
  type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments);
  type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
  type TimeEvents = enumeration(Always, AtDiscontinuities, NoTimeEvents);
  class ExternalCombiTimeTable
    extends ExternalObject;
    function constructor
      input String tableName; input String fileName; input Real table[:, :]; input Real startTime;
      input Integer columns[:]; input Smoothness smoothness; input Extrapolation extrapolation;
      input Real shiftTime = 0.0; input TimeEvents timeEvents = TimeEvents.Always;
      output ExternalCombiTimeTable made;
    external "C" made = ModelicaStandardTables_CombiTimeTable_init3(fileName, tableName, table, startTime, columns);
    end constructor;
    function destructor
      input ExternalCombiTimeTable made;
    external "C" ModelicaStandardTables_CombiTimeTable_close(made);
    end destructor;
  end ExternalCombiTimeTable;
  class ExternalCombiTable1D
    extends ExternalObject;
    function constructor
      input String tableName; input String fileName; input Real table[:, :]; input Integer columns[:];
      input Smoothness smoothness; input Extrapolation extrapolation = Extrapolation.LastTwoPoints;
      output ExternalCombiTable1D made;
    external "C" made = ModelicaStandardTables_CombiTable1D_init(tableName, fileName, table, columns);
    end constructor;
    function destructor
      input ExternalCombiTable1D made;
    external "C" ModelicaStandardTables_CombiTable1D_close(made);
    end destructor;
  end ExternalCombiTable1D;
end Types;""",
    "Tab/Tables": """within Tab;
package Tables
  package Internal
    function getTimeTableValue
      input Tab.Types.ExternalCombiTimeTable tableID; input Integer icol; input Real timeIn; input Real nextTimeEvent;
      input Real pre_nextTimeEvent; output Real y;
    external "C" y = ModelicaStandardTables_CombiTimeTable_getValue(tableID, icol, timeIn, nextTimeEvent);
    end getTimeTableValue;
    function getNextTimeEvent
      input Tab.Types.ExternalCombiTimeTable tableID; input Real timeIn; output Real nextTimeEvent;
    external "C" nextTimeEvent = ModelicaStandardTables_CombiTimeTable_nextTimeEvent(tableID, timeIn);
    end getNextTimeEvent;
    function getTable1DValue
      input Tab.Types.ExternalCombiTable1D tableID; input Integer icol; input Real u; output Real y;
    external "C" y = ModelicaStandardTables_CombiTable1D_getValue(tableID, icol, u);
    end getTable1DValue;
  end Internal;
  model Table
    parameter Boolean tableOnFile = false;
    parameter String tableName = "NoName", fileName = "NoName";
    parameter Integer nHeaderLines = 0;
    parameter String delimiter = ",";
    parameter Real table[:, :] = fill(0.0, 0, 2);
    final parameter Tab.Types.ExternalCombiTable1D tableID = Tab.Types.ExternalCombiTable1D(
      if tableOnFile then tableName else "NoName", if tableOnFile then fileName else "NoName", table, {2},
      Tab.Types.Smoothness.LinearSegments);
    Real u = time, y = Tables.Internal.getTable1DValue(tableID, 1, u);
  end Table;
  model TimeTable
    parameter Real table[:, :], startTime = 0, shiftTime = 0;
    parameter Tab.Types.Smoothness smoothness = Tab.Types.Smoothness.ConstantSegments;
    parameter Tab.Types.Extrapolation extrapolation = Tab.Types.Extrapolation.Periodic;
    parameter Tab.Types.TimeEvents timeEvents = Tab.Types.TimeEvents.Always;
    final parameter Tab.Types.ExternalCombiTimeTable tableID = Tab.Types.ExternalCombiTimeTable(
      "NoName", "NoName", table, startTime, {2}, smoothness, extrapolation, shiftTime, timeEvents);
    discrete Real next(start = 0, fixed = true);
    Real y = Tables.Internal.getTimeTableValue(tableID, 1, time, next, pre(next));
  equation
    when {time >= pre(next), initial()} then
      next = Tables.Internal.getNextTimeEvent(tableID, time);
    end when;
  end TimeTable;
end Tables;""",
}
LOSSES = np.array([[0, 1], [0.36, 10], [0.6, 1]])


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """The folder of a package with tables."""
    for name, text in FILES.items():
        path = tmp_path / f"{name}.mo"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path / "Tab"


@pytest.fixture
def area(library: Path, tmp_path: Path) -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """area(modifiers, dt, rows): times, values and their integral, of a table with these modifiers."""

    def run(modifiers: str, dt: float, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        table = ", ".join(modifiers.split(", "))
        (tmp_path / "A.mo").write_text(
            f"model A Tab.Tables.TimeTable t({table}); Real x(start = 0, fixed = true); equation der(x) = t.y; end A;"
        )
        model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[library]))
        got = model.simulate({}, dt, rows=rows, outputs=["t.y", "x"])
        return dt * np.arange(rows), got["t.y"], got["x"]

    return run


def _area_of_losses(t: np.ndarray, period: float = 0.6) -> np.ndarray:
    whole, rest = np.divmod(t + 1e-12, period)
    return whole * (0.36 * 1 + 0.24 * 10) + np.minimum(rest, 0.36) + 10 * np.clip(rest - 0.36, 0, None)


@pytest.mark.parametrize("dt", [0.06, 0.12, 0.6, 0.05, 0.7])
def test_what_repeats_is_integrated_to_rounding_whatever_the_step(area, dt: float) -> None:
    t, y, x = area("table = [0, 1; 0.36, 10; 0.6, 1]", dt, 50)
    np.testing.assert_allclose(x, _area_of_losses(t), rtol=1e-9, atol=1e-9)
    away = np.abs((t % 0.6)[:, None] - np.array([0, 0.36, 0.6])).min(1) > 1e-6
    np.testing.assert_array_equal(y[away], np.where(t[away] % 0.6 < 0.36, 1, 10))


def test_after_a_jump_the_new_value_is_shown(area) -> None:
    _, y, _ = area("table = [0, 1; 0.36, 10; 0.6, 1]", 0.12, 26)
    np.testing.assert_array_equal(y, np.tile([1, 1, 1, 10, 10], 6)[:26])


def test_a_saw_falls_at_its_period(area) -> None:
    t, _, x = area("table = [0, 0; 0.5, 1], smoothness = Tab.Types.Smoothness.LinearSegments", 0.1, 41)
    whole, rest = np.divmod(t + 1e-12, 0.5)
    np.testing.assert_allclose(x, whole * 0.25 + rest**2, atol=1e-9)


def test_a_table_begins_late_and_holds_its_last_value(area) -> None:
    modifiers = (
        "table = [0, 1; 0.3, 3; 0.3, 5; 1, 5], startTime = 0.25, shiftTime = 0.25, "
        "smoothness = Tab.Types.Smoothness.LinearSegments, extrapolation = Tab.Types.Extrapolation.HoldLastPoint"
    )
    t, y, x = area(modifiers, 0.05, 41)
    s = t - 0.25
    wanted = np.where(s < -1e-9, 0, np.where(s < 0.3 - 1e-9, 1 + s * 2 / 0.3, 5))
    np.testing.assert_allclose(y, wanted, atol=1e-9)
    rising = np.clip(s, 0, 0.3)
    np.testing.assert_allclose(x, rising + rising**2 / 0.3 + 5 * np.clip(s - 0.3, 0, None), atol=1e-9)


def test_tables_of_two_kinds_stand_in_one_model(library: Path, tmp_path: Path) -> None:
    (tmp_path / "A.mo").write_text(
        "model A Tab.Tables.TimeTable a(table = [0, 1; 0.5, 2; 1, 2]); Tab.Tables.Table b(table = [0, 0; 1, 4]); end A;"
    )
    model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[library]))
    got = model.simulate({}, 0.2, rows=4, outputs=["a.y", "b.y"])
    np.testing.assert_array_equal(got["a.y"], [1, 1, 1, 2])
    np.testing.assert_allclose(got["b.y"], [0, 0.8, 1.6, 2.4], rtol=1e-12)


# -- tables on files

POINTS = np.array([[0, 1], [0.5, 3], [1, -2.5]])
TEXT = """#1
double other(1, 2)  # not this one
7 7
double tab(3, 2)
0 1
0.5, 3   # a comment
1; -2.5
"""


def _of_file(library: Path, tmp_path: Path, modifiers: str) -> np.ndarray:
    (tmp_path / "A.mo").write_text(f"model A\n  Tab.Tables.Table t(tableOnFile = true, {modifiers});\nend A;")
    model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[library]))
    return model.simulate({}, 0.25, rows=5, outputs=["t.y"])["t.y"]


@pytest.mark.parametrize(
    "modifiers",
    [
        'tableName = "tab", fileName = "points.txt"',
        'tableName = "tab", fileName = Modelica.Utilities.Files.loadResource("modelica://Mine/Tables/points.txt")',
        'tableName = "tab", fileName = "points.mat"',
        'tableName = "any", fileName = "points.csv", nHeaderLines = 1, delimiter = ";"',
    ],
)
def test_a_table_on_a_file_is_read_when_the_model_is_built(library: Path, tmp_path: Path, modifiers: str) -> None:
    (tmp_path / "points.txt").write_text(TEXT)
    (tmp_path / "Tables").mkdir()
    (tmp_path / "Tables" / "points.txt").write_text(TEXT)
    savemat(tmp_path / "points.mat", {"tab": POINTS, "other": np.ones((2, 2))})
    np.savetxt(tmp_path / "points.csv", POINTS, delimiter=";", header="t;y", comments="")
    got = _of_file(library, tmp_path, modifiers)
    np.testing.assert_allclose(got, np.interp(0.25 * np.arange(5), *POINTS.T), atol=1e-12)


@pytest.mark.parametrize(
    ("modifiers", "words"),
    [
        ('tableName = "tab", fileName = "nowhere.txt"', "nowhere.txt, is neither beside the model nor in this folder"),
        ('tableName = "lost", fileName = "points.txt"', "points.txt holds no table named lost"),
        ('tableName = "tab", fileName = "short.txt"', "tab has 3 numbers, not 3 x 2"),
        ('tableName = "tab", fileName = "words.txt"', "cannot be read as a table: could not convert"),
        ('tableName = "tab", fileName = "points.mat"', "cannot be read as a table"),
        ('tableName = "tab"', "write fileName"),
    ],
)
def test_a_file_that_holds_no_such_table_is_told(library: Path, tmp_path: Path, modifiers: str, words: str) -> None:
    (tmp_path / "points.txt").write_text(TEXT)
    (tmp_path / "short.txt").write_text("#1\ndouble tab(3, 2)\n0 1 2\n")
    (tmp_path / "words.txt").write_text("#1\ndouble tab(1, 2)\n0 one\n")
    (tmp_path / "points.mat").write_text("no such file")
    with pytest.raises(ModelicaError, match=r"A\.mo:2: ") as told:
        _of_file(library, tmp_path, modifiers)
    assert words in str(told.value)
