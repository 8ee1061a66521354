"""Frames with attributes, areas that trigger, and virtual fences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.cell import Cell

NUMBERS = ARRAY | VarType.R8
HOME = [364.15999, 0.0, 278.53553, 180.0, 0.0, 180.0, 5.0]


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


def exact(cell: Cell, name: str, parameter: Any) -> tuple[int, Any]:
    got = variant(cell.robot.execute(name, variant(parameter)))
    return got.type, got.value


def line(cell: Cell, x: float, y: float, z: float, option: str = "") -> Any:
    return cell.run(cell.move(2, f"@E P({x}, {y}, {z}, 180, 0, 180, 5)", option), 60.0)


def io(cell: Cell, point: int) -> bool:
    return cell.controller.get_variable(f"IO{point}", "").get_value().plain


def p(cell: Cell, index: int) -> list[float]:
    return cell.controller.get_variable(f"P{index}", "").get_value().plain


# --- tool, work, base -------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.54 CurTool", "5.2.28.57 CurWork")
def test_the_current_tool_and_work_are_numbers(cell):
    assert exact(cell, "CurTool", None) == exact(cell, "CurWork", None) == (VarType.I4, 0)
    cell.robot.change("Tool3")
    cell.robot.change("Work2")
    assert (cell.execute("CurTool"), cell.execute("CurWork")) == (3, 2)


@pytest.mark.guide("5.2.28.55 GetToolDef", "5.2.28.56 SetToolDef")
def test_a_tool_has_six_numbers(cell):
    assert exact(cell, "GetToolDef", 1) == (NUMBERS, [0.0] * 6)
    assert cell.execute("SetToolDef", [1, "P(1, 2, 3, 10, 20, 30, 7)"]) is None
    assert exact(cell, "GetToolDef", 1) == (NUMBERS, [1.0, 2.0, 3.0, 10.0, 20.0, 30.0])
    assert (
        cell.code_of(lambda: cell.execute("SetToolDef", [0, "P(1, 2, 3, 4, 5, 6)"])) == hresult.TOOL_NUMBER_OUT_OF_RANGE
    )


@pytest.mark.guide("5.2.28.58 GetWorkDef", "5.2.28.59 SetWorkDef", "5.2.28.60 WorkAttribute")
def test_a_work_has_an_attribute(cell):
    assert exact(cell, "GetWorkDef", 1) == (NUMBERS, [0.0] * 7)
    cell.execute("SetWorkDef", [1, "P(1, 2, 3, 10, 20, 30)", 1])
    assert exact(cell, "GetWorkDef", 1) == (NUMBERS, [1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 1.0])
    assert exact(cell, "WorkAttribute", 1) == (VarType.I4, 1)
    cell.execute("SetWorkDef", [1, "P(1, 2, 3, 10, 20, 30)"])
    assert cell.execute("WorkAttribute", 1) == 0
    assert (
        cell.code_of(lambda: cell.execute("SetWorkDef", [1, "P(1, 2, 3, 10, 20, 30)", 2])) == hresult.VALUE_OUT_OF_RANGE
    )
    assert cell.code_of(lambda: cell.execute("WorkAttribute", 8)) == hresult.WORK_NUMBER_OUT_OF_RANGE


def test_with_a_fixed_tool_poses_are_those_of_the_tool_seen_from_the_workpiece(cell):
    cell.execute("SetWorkDef", [1, "P(400, 0, 300, 0, 0, 0)", 1])
    cell.robot.change("Work1")
    seen = cell.execute("CurPos")
    tip, fixed = cell.tip, cell.arm.space.works.matrix(1)
    assert seen[:3] == pytest.approx((np.linalg.inv(tip) @ fixed)[:3, 3].tolist())
    assert cell.execute("P2J", f"P({', '.join(map(str, seen))})")[:6] == pytest.approx([0, 45, 90, 0, 45, 0], abs=1e-6)
    cell.run(cell.move(1, f"@E P({seen[0] + 10}, {', '.join(map(str, seen[1:]))})"))
    assert cell.execute("CurPos")[:6] == pytest.approx([seen[0] + 10, *seen[1:6]], abs=1e-6)
    moved = np.linalg.inv(tip) @ cell.tip  # the workpiece has moved by -10 mm along its own X axis
    assert moved[:3, 3] == pytest.approx([-10, 0, 0], abs=1e-6)


@pytest.mark.guide("5.2.28.98 SetBaseDef", "5.2.28.103 GetBaseDef")
@pytest.mark.field("3.2")
def test_a_base_moves_the_arm_in_the_world(cell):
    assert exact(cell, "GetBaseDef", 0) == (NUMBERS, [0.0] * 7)
    cell.execute("SetBaseDef", [0, "P(100, 0, 500, 0, 0, 90)"])
    assert exact(cell, "GetBaseDef", 0) == (NUMBERS, [100.0, 0.0, 500.0, 0.0, 0.0, 90.0, 0.0])
    assert cell.execute("CurPos")[:3] == pytest.approx([100, HOME[0], HOME[2] + 500], abs=1e-3)
    x, y, z = cell.execute("CurPos")[:3]
    before = cell.arm.queue.joints
    cell.run(cell.move(1, f"@E P({x}, {y}, {z - 20}, {', '.join(map(str, cell.execute('CurPos')[3:]))})"))
    assert cell.execute("CurPos")[2] == pytest.approx(z - 20)
    assert cell.arm.queue.joints != before
    pose = "P(10, 20, 30, 0, 0, 0, 5)"  # conversions between types have no frame
    assert cell.execute("T2P", f"T({', '.join(map(str, cell.execute('P2T', pose)))})")[:3] == pytest.approx(
        [10, 20, 30]
    )
    assert cell.code_of(lambda: cell.execute("SetBaseDef", [8, "P(0, 0, 0, 0, 0, 0)"])) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.field("3.2")
def test_a_position_in_another_work(cell):
    """As a published drawing program sends it: the name in its spelling, the result as the argument of SetWorkDef."""
    cell.execute("SetWorkDef", [1, "P(300, 50, 10, 0, 0, 90)"])
    got = cell.execute("ConvertPoswork", ["P(73,10,0,0,0,0)", 1, 0])
    assert got == pytest.approx([290, 123, 10, 0, 0, 90, -1])
    cell.execute("SetWorkDef", [2, "P(" + str(got)[1:-1] + ")"])
    assert cell.execute("GetWorkDef", 2)[:6] == pytest.approx(got[:6])
    assert cell.execute("ConvertPosWork", [f"P({str(got)[1:-1]})", 0, 1]) == pytest.approx(
        [73, 10, 0, 0, 0, 0, -1], abs=1e-9
    )


# --- areas ------------------------------------------------------------------------------------------------------------


def define(cell: Cell, *more: Any, number: int = 3) -> None:
    cell.execute("SetAreaDef", [number, "P(364, 100, 250, 0, 0, 0)", "V(60, 40, 80)", 130, 7, *more])


@pytest.mark.guide("5.2.28.61 GetAreaDef", "5.2.28.62 SetAreaDef", "5.2.28.65 AreaSize")
@pytest.mark.field("3.2")
def test_the_definition_of_an_area(cell):
    assert exact(cell, "GetAreaDef", 3) == (NUMBERS, [*[0.0] * 9, -1.0, -1.0, *[0.0] * 23])
    define(cell, 1)
    assert cell.execute("GetAreaDef", 3)[:12] == [364, 100, 250, 0, 0, 0, 60, 40, 80, 130, 7, 1]
    assert exact(cell, "AreaSize", 3) == (NUMBERS, [60.0, 40.0, 80.0])
    full = [1.0, 2, 3, 4, 5, 6, 7, 8, 9, 131, 8, 0, 16, 10, 20, 30, 2, *range(16), 1]
    cell.execute("SetAreaDef", [3, full])
    assert cell.execute("GetAreaDef", 3) == full
    cell.execute("SetAreaDef", [3, full[:11]])  # what is left out stays
    assert cell.execute("GetAreaDef", 3) == full
    for given in (
        [3, full[:10]], [3, [*full, 1]], [32, full], [-1, full], [3, [*full[:6], -1, *full[7:]]], [3, "P(1, 2, 3, 4, 5, 6)"],
        [3, [*full[:9], 600, *full[10:]]], [3, [*full[:10], 600, *full[11:]]], [3, [*full[:11], 2]], [3, [1e9, *full[1:]]],
    ):  # fmt: skip
        assert cell.code_of(lambda given=given: cell.execute("SetAreaDef", given)) != 0, given
    assert cell.execute("GetAreaDef", 3) == full


@pytest.mark.guide("5.2.28.63 SetArea", "5.2.28.64 ResetArea", "5.2.28.66 GetAreaEnabled", "5.2.28.67 SetAreaEnabled")
def test_an_area_sets_its_point_and_stores_the_position(cell):
    define(cell)
    line(cell, 364, 100, 278)
    assert not io(cell, 130)  # not watched yet
    line(cell, 364, 0, 278)
    assert exact(cell, "GetAreaEnabled", 3) == (VarType.BOOL, False)
    assert cell.execute("SetArea", 3) is None
    assert exact(cell, "GetAreaEnabled", 3) == (VarType.BOOL, True)
    line(cell, 364, 70, 278)
    assert not io(cell, 130)
    line(cell, 364, 100, 278)
    assert io(cell, 130)
    assert p(cell, 7)[:3] == pytest.approx([364, 80, 278], abs=3)  # where the tip has entered
    line(cell, 364, 130, 278)
    assert not io(cell, 130)
    cell.execute("SetAreaEnabled", [3, False])
    assert cell.execute("GetAreaEnabled", 3) is False
    line(cell, 364, 100, 278)
    assert not io(cell, 130)
    cell.execute("SetAreaEnabled", [3, True])  # the tip is inside already
    cell.clock.advance(PERIOD)
    assert io(cell, 130)
    assert cell.execute("ResetArea", 3) is None
    assert not io(cell, 130)
    assert not cell.rc8.state.faults.code


@pytest.mark.guide("5.3.2 robot Area*")
def test_the_variable_of_an_area(cell):
    variable = cell.robot.get_variable("area3", "")
    define(cell)
    got = variable.get_value()
    assert (got.type, got.value) == (NUMBERS, cell.execute("GetAreaDef", 3))
    cell.robot.get_variable("Area[3]", "").put_value(variant([*got.value[:9], 131.0, 8.0]))
    assert cell.execute("GetAreaDef", 3)[9:11] == [131, 8]
    assert cell.code_of(lambda: variable.put_value(variant([1.0] * 10))) == hresult.E_INVALIDARG
    assert cell.code_of(cell.robot.get_variable("Area32", "").get_value) == hresult.VALUE_OUT_OF_RANGE
    assert "Area*" in cell.robot.get_variable_names("")
    assert cell.code_of(lambda: cell.robot.get_variable("Area", "")) == hresult.E_CAO_OBJECT_NOTFOUND


def test_a_position_variable_that_was_deleted_is_an_error_of_the_controller(cell, caplog):
    """The write happens in a cycle, for which no client waits; the arm continues, as for every error of level 1."""
    cell.execute("SetAreaDef", [1, "P(364, 100, 278, 0, 0, 0)", "V(100, 60, 100)", 128, 50])
    cell.execute("SetArea", 1)
    cell.put("@VAR_P_LEN", 50)
    line(cell, 364, 100, 278)
    assert io(cell, 128)
    assert cell.rc8.state.faults.code == hresult.VARIABLE_INDEX_INVALID
    assert "area 1" in cell.rc8.state.faults.current.at(0).message
    assert cell.arm.motor.on
    assert not caplog.records


def test_an_area_with_detection_stops_the_arm(cell):
    define(cell, 1)
    cell.execute("SetArea", 3)
    code = cell.code_of(lambda: line(cell, 364, 190, 278, "SPEED=10"))
    assert code == cell.rc8.state.faults.code == hresult.OUT_OF_WORKING_RANGE
    assert "3" in cell.rc8.state.faults.message
    assert not cell.arm.motor.on
    assert 80 <= cell.execute("CurPos")[1] < 120
    cell.rc8.clear_errors()  # the tip may leave the area
    cell.execute("Motor", 1)
    line(cell, 364, 0, 278)
    assert not io(cell, 130)
    assert not cell.rc8.state.faults.code


def test_time_margin_and_rotation_of_an_area(cell):
    base = [364.0, 100, 278, 180, 0, 180, 60, 40, 80, 130, -1]
    cell.execute("SetAreaDef", [0, [*base, 0, 400, 0, 0, 0, 5]])
    cell.execute("SetArea", 0)
    line(cell, 364, 100, 278)
    cell.trace(5)
    assert not io(cell, 130)
    cell.trace(60)
    assert io(cell, 130)
    line(cell, 364, 123, 278)
    assert io(cell, 130)  # 3 mm outside, with a margin of 5 mm
    line(cell, 364, 128, 278)
    assert not io(cell, 130)
    cell.execute("SetAreaDef", [0, [*base, 0, 0, 20, 20, 20, 0]])
    line(cell, 364, 100, 278)
    assert io(cell, 130)
    cell.execute("RotateH", "@E 15")
    assert not io(cell, 130)


def test_the_cycle_does_nothing_for_areas_that_are_not_watched(cell):
    define(cell)
    line(cell, 364, 100, 278)
    cell.trace(5)
    assert not cell.arm.hardware.active
    cell.execute("SetArea", 3)
    cell.clock.advance(PERIOD)
    assert cell.arm.hardware.active
    assert not cell.rc8.state.cycles.busy  # nothing moves


# --- fences -----------------------------------------------------------------------------------------------------------


@pytest.mark.field("3.2")
def test_check_virtual_fence(cell):
    def check(pose: Any) -> int:
        vt, value = exact(cell, "CheckVirtualFence", pose)
        assert vt == VarType.I4
        return value

    poses = ("J(0.0, 45.0, 90.0, 0.0, 45.0, 0.0)", "P(364, 200, 278, 180, 0, 180, 5)", "P(364, 0, 100, 180, 0, 180)")
    assert [check(pose) for pose in poses] == [0, 0, 0]
    cell.put("P1", [364.0, 200, 278, 180, 0, 180, 5])
    inside, outside = ((300, 0, 300, 0, 0, 0), (400, 300, 300), True), ((364, 0, 100, 0, 0, 0), (50, 50, 50), False)
    cell.rc8.workspace.fence(inside, outside)
    assert [check(pose) for pose in poses] == [0, 1, 1]
    assert [check(pose) for pose in ("P1", ["P1"], [[364.0, 0, 278, 180, 0, 180, 5], "P"])] == [1, 1, 0]
    cell.rc8.workspace.fence(outside)
    assert [check(pose) for pose in poses] == [0, 0, 1]
    cell.rc8.workspace.fence()
    assert check(poses[2]) == 0
    for fence in (((0,) * 5, (1, 1, 1), True), ((0,) * 6, (0, 1, 1), True), ((0,) * 6, (1, 1), True)):
        with pytest.raises(ValueError):
            cell.rc8.workspace.fence(fence)


def test_a_fence_stops_the_arm_that_crosses_it(cell):
    cell.rc8.workspace.fence(((300, 0, 300, 0, 0, 0), (400, 200, 400), True))
    assert cell.code_of(lambda: line(cell, 364, 200, 278)) == hresult.OUT_OF_WORKING_RANGE
    assert 100 <= cell.execute("CurPos")[1] < 200
    assert not cell.arm.motor.on
