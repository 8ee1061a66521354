"""I/O of the hand, paths in files, logs, calibration, scenes and buttons."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, VarType, variant
from support.cell import Cell

NUMBERS = ARRAY | VarType.R8
P = "P(330, 120, 300, 180, 0, 180, 5)"


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


def exact(cell: Cell, name: str, parameter: Any) -> tuple[int, Any]:
    got = variant(cell.robot.execute(name, variant(parameter)))
    return got.type, got.value


# --- I/O of the hand --------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.104 SetHandIO", "5.2.28.105 GetHandIO")
def test_points_of_the_hand(cell):
    assert cell.execute("SetHandIO", [48, 8, 4]) is None
    assert exact(cell, "GetHandIO", [48, 4]) == (VarType.I4, 8)
    assert [cell.controller.get_variable(f"IO{point}", "").get_value().plain for point in range(48, 53)] == [
        False, False, False, True, False,
    ]  # fmt: skip
    cell.execute("SetHandIO", [64, 0xA5, 8])
    assert cell.controller.get_variable("IOB64", "").get_value().plain & 0xFF == 0xA5
    assert cell.execute("GetHandIO", [65, 3]) == 2
    for given in ([47, 0, 1], [48, 0, 0], [71, 0, 2], [48, 0, 33], [48, 0], [128, 1, 1]):
        assert cell.code_of(lambda given=given: cell.execute("SetHandIO", given)) != 0


# --- paths ------------------------------------------------------------------------------------------------------------


@pytest.mark.guide(
    "5.2.28.68 AddPathPoint", "5.2.28.69 ClrPathPoint", "5.2.28.70 GetPathPoint", "5.2.28.72 GetPathPointCount"
)
def test_points_of_a_path(cell):
    assert exact(cell, "GetPathPointCount", 1) == (VarType.I4, 0)
    for pose in (P, "J(0, 45, 90, 0, 45, 0)", "T(330, 120, 300, 0, 1, 0, 0, 0, -1, 5)"):
        assert cell.execute("AddPathPoint", [1, pose]) is None
    assert cell.execute("GetPathPointCount", 1) == 3
    assert exact(cell, "GetPathPoint", [1, 1]) == (NUMBERS, [330.0, 120.0, 300.0, 180.0, 0.0, 180.0, 5.0])
    assert cell.execute("GetPathPoint", [1, 2])[:3] == pytest.approx([364.16, 0, 278.5355], abs=1e-3)
    assert cell.execute("GetPathPoint", [1, 3]) == pytest.approx(cell.execute("GetPathPoint", [1, 1]))
    for given in ([1, 0], [1, 4], [0, 1], [21, 1], 1):
        assert cell.code_of(lambda given=given: cell.execute("GetPathPoint", given)) != 0
    assert cell.execute("ClrPathPoint", 1) is None
    assert cell.execute("GetPathPointCount", 1) == 0
    assert cell.code_of(lambda: cell.execute("AddPathPoint", [21, P])) == hresult.E_INVALIDARG


@pytest.mark.guide("5.2.28.71 LoadPathPoint")
@pytest.mark.field("3.2")
def test_a_path_in_the_storage(cell):
    for y in (0, 50, 100):
        cell.execute("AddPathPoint", [2, f"P(330, {y}, 300, 180, 0, 180, 5)"])
    cell.rc8.workspace.save_path(2)
    cell.execute("ClrPathPoint", 2)
    cell.execute("AddPathPoint", [2, P])
    assert cell.execute("LoadPathPoint", 2) is None
    assert [cell.execute("GetPathPoint", [2, point])[1] for point in (1, 2, 3)] == [0, 50, 100]
    assert cell.execute("GetPathPointCount", 2) == 3
    assert cell.code(cell.move(4, "2")) == 0
    assert cell.execute("CurPos")[1] == pytest.approx(100, abs=0.1)
    assert cell.code_of(lambda: cell.execute("LoadPathPoint", 3)) == hresult.FILE_NOT_FOUND
    assert cell.execute("GetPathPointCount", 3) == 0
    cell.rc8.state.files.write("Path4.csv", b"1,2,3\r\n")
    assert cell.code_of(lambda: cell.execute("LoadPathPoint", 4)) == hresult.E_INVALIDARG


# --- logs -------------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.109 GetCtrlLogMaxTime", "5.2.28.110 SetCtrlLogMaxTime")
@pytest.mark.guide("5.2.28.111 GetCtrlLogInterval", "5.2.28.112 SetCtrlLogInterval")
def test_duration_and_interval_of_the_control_log(cell):
    assert exact(cell, "GetCtrlLogMaxTime", None) == (VarType.I4, 100)
    assert exact(cell, "GetCtrlLogInterval", None) == (VarType.I4, 8)
    assert cell.execute("SetCtrlLogMaxTime", 1) is None
    assert cell.execute("SetCtrlLogInterval", 40) is None
    assert (cell.execute("GetCtrlLogMaxTime"), cell.execute("GetCtrlLogInterval")) == (1, 40)
    cell.execute("StartLog")
    cell.trace(50)
    cell.execute("StopLog")
    assert cell.execute("GetLogCount") == 10  # one in five cycles
    assert cell.execute("GetLogRecord", 1)[36] - cell.execute("GetLogRecord", 0)[36] == 5
    for name, value in (("MaxTime", 0), ("MaxTime", 601), ("Interval", 4), ("Interval", 12), ("Interval", 2000)):
        assert cell.code_of(lambda name=name, value=value: cell.execute(f"SetCtrlLog{name}", value)) != 0


@pytest.mark.guide("5.2.28.106 StartServoLog", "5.2.28.107 ClearServoLog", "5.2.28.108 StopServoLog")
def test_the_servo_log_is_written_to_a_file(cell):
    cell.execute("StartServoLog")
    cell.trace(4)
    cell.execute("ClearServoLog")
    cell.move(1, "J(20, 45, 90, 0, 45, 0)", "NEXT")
    joints = cell.trace(30)
    assert cell.execute("StopServoLog") is None
    cell.trace(30)
    text = cell.controller.get_file("ServoLog.csv", "").get_value()
    rows = list(csv.reader(io.StringIO(variant(cell.run(getattr(text, "run", lambda: text)())).value)))
    assert rows[0][:3] == ["cycle", "J1 command", "J1 encoder"]
    assert len(rows) == 31
    assert [float(row[1]) for row in rows[1:]] == [each[0] for each in joints]


# --- calibration, scenes, buttons -------------------------------------------------------------------------------------


@pytest.mark.field("3.2")
def test_calibration(cell):
    with pytest.raises(Exception, match="81501001"):
        cell.rc8.workspace.lose_calibration()
    cell.execute("Motor", 0)
    cell.rc8.workspace.lose_calibration()
    assert not cell.controller.execute("SysState", variant(None)) >> 17 & 1
    assert cell.code_of(lambda: cell.execute("Motor", 1)) == hresult.ENCODER_REFERENCE_LOST
    calibration = cell.robot.execute("AutoCal", variant(None))
    assert not calibration.done()
    assert cell.cycles(calibration) >= 100
    assert cell.controller.execute("SysState", variant(None)) >> 17 & 1
    cell.execute("Motor", 1)
    assert cell.arm.motor.on


@pytest.mark.field("3.2")
def test_scenes(cell):
    """As a published program for the RC9 sends them, with an empty text as the parameter."""
    assert exact(cell, "CurScene", "") == exact(cell, "CurSubScene", "") == (VarType.I4, 1)
    assert cell.execute("SceneInfo", [1, 1]) == ["", -1, -1, -1]
    cell.rc8.workspace.scene(2, 3, name="packing", tool=4, work=5, speed=30)
    assert exact(cell, "SceneInfo", [2, 3])[0] == VARIANT_ARRAY
    assert cell.execute("SceneInfo", [2, 3]) == ["packing", 4, 5, 30]
    assert cell.execute("ChangeScene", [2, 3]) is None
    assert (cell.execute("CurScene"), cell.execute("CurSubScene")) == (2, 3)
    assert (cell.execute("CurTool"), cell.execute("CurWork"), cell.execute("CurExtSpd")) == (4, 5, 30)
    assert cell.code_of(lambda: cell.execute("ChangeScene", [2, 2])) == hresult.VALUE_OUT_OF_RANGE
    for number, sub, options in (
        (0, 1, {}),
        (1, 256, {}),
        (1, 2, {"tool": 64}),
        (1, 2, {"speed": 0}),
        (1, 2, {"work": 8}),
    ):
        with pytest.raises(ValueError):
            cell.rc8.workspace.scene(number, sub, **options)


@pytest.mark.field("3.2")
def test_buttons_of_the_arm(cell):
    """As a published COBOTTA program sends it, with a blank behind the name."""
    assert exact(cell, "GetMechaButtonState ", 0) == (VarType.I4, 0)
    cell.rc8.workspace.press(0)
    assert [cell.execute("GetMechaButtonState", button) for button in range(3)] == [1, 0, 0]
    assert cell.execute("ClearMechaButtonState", 0) is None
    assert cell.execute("GetMechaButtonState", 0) == 0
    for button in (3, -1):
        assert cell.code_of(lambda button=button: cell.execute("GetMechaButtonState", button)) != 0
        with pytest.raises(ValueError):
            cell.rc8.workspace.press(button)


def test_the_workspace_reports_its_state(cell):
    cell.rc8.workspace.place("plate", (364.0, 0.0, 280.0, 0, 0, 0), stiffness=2.0)
    cell.rc8.workspace.press(2)
    status = cell.rc8.workspace.status()
    assert status["surfaces"] == ["plate"]
    assert status["force"][2] == pytest.approx(-2.93, abs=0.01)
    assert status["buttons"] == [False, False, True]
    assert status["calibrated"] is True
