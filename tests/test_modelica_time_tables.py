"""Tables in time, by the names that the Modelica Standard Library gives them: their jumps are events of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
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
  end Internal;
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
def area(tmp_path: Path) -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """area(modifiers, dt, rows): times, values and their integral, of a table with these modifiers."""
    for name, text in FILES.items():
        path = tmp_path / f"{name}.mo"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)

    def run(modifiers: str, dt: float, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        table = ", ".join(modifiers.split(", "))
        (tmp_path / "A.mo").write_text(
            f"model A Tab.Tables.TimeTable t({table}); Real x(start = 0, fixed = true); equation der(x) = t.y; end A;"
        )
        model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[tmp_path / "Tab"]))
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
