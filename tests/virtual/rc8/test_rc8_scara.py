"""A SCARA with all commands that six-axis arms have: poses, motions, conversions, slave mode, loads, force, programs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.cell import Cell
from support.slave_cell import J0, J1, J2, P0, P1, P2, T0, T1, T2, SlaveCell

HOME = (0.0, 60.0, 100.0, -60.0)
PTP, LINE, ARC, CURVE = 1, 2, 3, 4
R4 = ARRAY | VarType.R4


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell(model="HSR065").take()
    yield made
    made.close()


def commanded(cell: Cell) -> list[float]:
    """Return the pose of the tool at the command position: X, Y, Z, RX, RY, RZ, Fig."""
    return cell.arm.space.position(cell.arm.queue.joints)


# --- poses ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("CurJnt", [0, 60, 100, -60, 0, 0, 0, 0]),
        ("CurPos", [512.5, 238.156986, 100, 0, 0, 0, 0]),
        ("CurTrn", [512.5, 238.156986, 100, 0, 1, 0, 0, 0, 1, 0]),
        ("HighCurJnt", [0, 60, 100, -60, 0, 0, 0, 0]),
    ],
)
def test_where_the_arm_is(cell, command, expected):
    assert cell.execute(command) == pytest.approx(expected, abs=1e-6)


def test_variables_of_the_robot(cell):
    value = {name: cell.run(cell.robot.get_variable(name, "").get_value()) for name in ("@TYPE", "@TYPE_NAME")}
    assert value == {"@TYPE": 1, "@TYPE_NAME": "HSR065A1-N32-NNN-NNN A"}
    assert cell.run(cell.robot.get_variable("@CURRENT_ANGLE", "").get_value()) == pytest.approx([*HOME, 0, 0, 0, 0])


@pytest.mark.parametrize("interpolation", [PTP, LINE])
@pytest.mark.parametrize(
    "pose",
    [
        "P(450, 50, 80, 0, 0, 30, 0)",
        "P(450, 50, 80, 180, 0, 30)",  # RX and RY do not count
        "P(450, 50, 80, 12, -34, 30, -1)",
        "T(450, 50, 80, -0.5, 0.8660254037844386, 0, 0, 0, 1, 0)",
        [[450.0, 50.0, 80.0, 0.0, 0.0, 30.0, 0.0], "P", "@E"],
    ],
)
@pytest.mark.guide("5.2.25, App. B Move")
def test_a_pose_in_every_form_is_the_same_place(cell, interpolation, pose):
    cell.run(cell.move(interpolation, pose))
    assert commanded(cell) == pytest.approx([450, 50, 80, 0, 0, 30, 0], abs=1e-6)


@pytest.mark.parametrize(
    "pose",
    [
        "J(20, 40, 50, 10)",
        "J(20, 40, 50, 10, 0, 0, 0, 0)",
        [Variant(R4, [20, 40, 50, 10]), "J"],
        [Variant(R4, [20, 40, 50, 10]), 2, -2],
        [[20.0, 40.0, 50.0, 10.0], "J", "@E"],
    ],
)
@pytest.mark.parametrize("interpolation", [PTP, LINE, CURVE])
def test_joints_have_four_elements(cell, interpolation, pose):
    cell.run(cell.move(interpolation, pose))
    assert cell.arm.queue.joints == pytest.approx((20, 40, 50, 10), abs=1e-6)


def test_four_numbers_without_a_type_are_no_pose(cell):
    assert cell.code_of(lambda: cell.move(PTP, Variant(R4, [20, 40, 50, 10]))) == hresult.E_INVALIDARG
    assert cell.arm.queue.joints == HOME


def test_the_four_joints_of_a_six_axis_arm_leave_the_others():
    cell = Cell().take()
    cell.run(cell.move(PTP, "J(10, 40, 80, 5)"))
    assert cell.arm.queue.joints == pytest.approx((10, 40, 80, 5, 45, 0))
    assert cell.code_of(lambda: cell.robot.execute("J2P", variant([10.0, 40.0, 80.0, 5.0]))) == hresult.E_INVALIDARG
    cell.close()


@pytest.mark.parametrize(
    ("interpolation", "pose", "code"),
    [
        (PTP, "P(700, 50, 80, 0, 0, 0)", hresult.TARGET_OUT_OF_RANGE),
        (LINE, "P(700, 50, 80, 0, 0, 0)", hresult.TARGET_OUT_OF_RANGE),
        (PTP, "P(90, 0, 80, 0, 0, 0)", hresult.TARGET_OUT_OF_RANGE),
        (PTP, "T(450, 50, 80, 0, 1, 0, 0, 0, -1)", hresult.TARGET_OUT_OF_RANGE),  # tool downwards
        (LINE, "T(450, 50, 80, 0, 1, 0, 0.6, 0, 0.8)", hresult.TARGET_OUT_OF_RANGE),
        (PTP, "P(450, 50, 221, 0, 0, 0)", hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 2),
        (LINE, "P(450, 50, -101, 0, 0, 0)", hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 2),
        (PTP, "J(0, 60, 0, 361)", hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 3),
        (PTP, "P(450, 50, 80, 0, 0, 0, 5)", hresult.FIGURE_OUT_OF_RANGE),
        (LINE, "P(450, 50, 80, 0, 0, 0, 1)", hresult.FIGURE_MISMATCH),
        (LINE, "P(-300, 50, 80, 0, 0, 0)", hresult.SOFT_LIMIT_OVER_AXIS1 + 1),  # the elbow would fold too far
    ],
)
def test_what_the_arm_cannot_reach(cell, interpolation, pose, code):
    assert cell.code_of(lambda: cell.move(interpolation, pose)) == code
    assert cell.arm.queue.joints == HOME


def test_the_figure_selects_the_side_of_the_elbow(cell):
    cell.run(cell.move(PTP, "P(450, 50, 80, 0, 0, 0, 1)"))
    assert cell.arm.queue.joints[1] < 0
    assert commanded(cell) == pytest.approx([450, 50, 80, 0, 0, 0, 1], abs=1e-6)
    cell.run(cell.move(PTP, "P(450, 50, 80, 0, 0, 0, 17)"))
    assert abs(cell.arm.queue.joints[3]) > 180
    assert commanded(cell) == pytest.approx([450, 50, 80, 0, 0, 0, 17], abs=1e-6)


@pytest.mark.parametrize(
    ("command", "given", "expected"),
    [
        ("J2P", "J(20, 40, 50, 10)", [489.884733, 366.414540, 50, 0, 0, 70, 0]),
        ("J2P", [20.0, 40.0, 50.0, 10.0], [489.884733, 366.414540, 50, 0, 0, 70, 0]),
        ("P2J", "P(489.884732795, 366.414539788, 50, 180, 0, 70, 0)", [20, 40, 50, 10, 0, 0, 0, 0]),
        ("J2T", "J(0, 90, 0, 0)", [375, 275, 0, -1, 0, 0, 0, 0, 1, 0]),
        ("T2J", "T(375, 275, 0, -1, 0, 0, 0, 0, 1, 0)", [0, 90, 0, 0, 0, 0, 0, 0]),
        ("P2T", "P(450, 50, 80, 180, 0, 0, 0)", [450, 50, 80, 0, 1, 0, 0, 0, 1, 0]),
        ("T2P", "T(450, 50, 80, 0, 1, 0, 0, 0, 1, 0)", [450, 50, 80, 0, 0, 0, 0]),
        ("OutRange", "P(450, 50, 80, 180, 0, 0, 0)", 0),
        ("OutRange", "P(450, 50, 380, 0, 0, 0, 0)", 4),
        ("OutRange", "P(1450, 50, 80, 0, 0, 0, 0)", -1),
        ("OutRange", "T(450, 50, 80, 0, 1, 0, 0, 0, -1, 0)", -1),
        ("OutRange", "J(131, 40, 80, 361)", 9),
        ("OutRange", "J(0, 0, 80, 0)", -2),
        ("Dev", ["P(450, 50, 80, 0, 0, 10, 0)", "P(10, 0, 0, 0, 0, 90)"], [460, 50, 80, 0, 0, 100, 0]),
        ("DevH", ["P(450, 50, 80, 0, 0, 90, 0)", "P(10, 0, 0, 90, 90, 90)"], [450, 60, 80, 0, 0, 180, 0]),
    ],
)
@pytest.mark.guide("5.2.28.4 J2T")
@pytest.mark.guide("5.2.28.12 OutRange")
def test_conversions(cell, command, given, expected):
    found = cell.execute(command, given)
    assert found == (expected if isinstance(expected, int) else pytest.approx(expected, abs=1e-6))


@pytest.mark.parametrize("tool", [(0, 0, -120, 0, 0, 0), (30, 10, -120, 180, 0, 45), (0, 0, 50, 10, 20, 30)])
@pytest.mark.parametrize("work", [(100, -50, 20, 0, 0, 30), (100, -50, 20, 180, 0, -20), (10, 20, 5, 3, 4, 5)])
def test_a_pose_that_the_arm_reports_is_a_pose_that_it_reaches(cell, tool, work):
    cell.execute("SetToolDef", [1, f"P{tool}"])
    cell.execute("SetWorkDef", [1, f"P{work}"])
    for name, number in (("@CURRENT_TOOL", 1), ("@CURRENT_WORK", 1)):
        cell.run(cell.robot.get_variable(name, "").put_value(variant(number)))
    reported = commanded(cell)
    cell.run(cell.move(PTP, "J(30, 70, 20, 15)"))
    cell.run(cell.move(PTP, [reported, "P"]))
    assert cell.arm.queue.joints == pytest.approx(HOME, abs=1e-6)


# --- motions ----------------------------------------------------------------------------------------------------------


def test_a_line_is_straight(cell):
    begin = cell.arm.space.tcp(HOME)[:3, 3]
    move = cell.move(LINE, "P(420, 100, 180, 0, 0, 90)")
    joints = [cell.arm.queue.joints]
    while not move.done():
        joints += cell.trace(1)
    tips = np.array([cell.arm.space.tcp(each)[:3, 3] for each in joints])
    way = np.array([420, 100, 180]) - begin
    assert np.abs(np.cross(tips - begin, way / np.linalg.norm(way))).max() < 0.01
    assert len(joints) > 20


def test_an_arc_goes_through_its_middle(cell):
    cell.run(cell.move(PTP, "P(450, 0, 80, 0, 0, 0)"))
    move = cell.move(ARC, "P(500, 50, 80, 0, 0, 0), P(550, 0, 80, 0, 0, 90)")
    tips = []
    while not move.done():
        tips += [cell.arm.space.tcp(each)[:3, 3] for each in cell.trace(1)]
    radii = np.linalg.norm(np.array(tips) - (500, 0, 80), axis=1)
    assert np.abs(radii - 50).max() < 0.01
    assert commanded(cell)[5] == pytest.approx(90)


@pytest.mark.parametrize("interpolation", [PTP, LINE])
def test_approach_and_depart_go_upwards(cell, interpolation):
    cell.execute("Approach", [interpolation, "P(450, 50, 80, 180, 0, 0, 0)", "@0 50"])
    assert commanded(cell)[:3] == pytest.approx([450, 50, 130], abs=1e-6)
    cell.execute("Depart", [interpolation, "@0 20"])
    assert commanded(cell)[:3] == pytest.approx([450, 50, 150], abs=1e-6)


def test_drive_draw_and_rotate_hand(cell):
    cell.execute("DriveEx", ["@0 (3, -20), (4, 90)"])
    assert cell.arm.queue.joints == pytest.approx((0, 60, 80, 30))
    cell.execute("DriveAEx", ["@0 (3, 0), (1, 20)"])
    assert cell.arm.queue.joints == pytest.approx((20, 60, 0, 30))
    x, y, z, _, _, rz, _ = commanded(cell)
    cell.execute("Draw", [LINE, "V(-10, 20, 30)"])
    cell.execute("RotateH", ["@0 30"])
    assert commanded(cell)[:6] == pytest.approx([x - 10, y + 20, z + 30, 0, 0, rz + 30], abs=1e-6)
    for axis in (0, 5, 7):
        assert cell.code_of(lambda axis=axis: cell.robot.execute("DriveEx", variant([f"@0 ({axis}, 1)"]))) != 0


def test_arch_motion_and_home(cell):
    cell.execute("ArchMove", ["P(400, 100, 50, 0, 0, 0)", 30.0, 10.0, 10.0])
    assert commanded(cell)[:3] == pytest.approx([400, 100, 50], abs=1e-6)
    cell.run(cell.robot.go_home())
    assert cell.arm.queue.joints == pytest.approx(HOME)


def rotate(cell: Cell, plane: str, option: str = "") -> int:
    return cell.code_of(lambda: cell.robot.rotate(variant(plane), 20.0, variant("V(500, 200, 100)"), option))


def test_rotations(cell):
    assert rotate(cell, "XY") == 0
    assert commanded(cell)[5] == pytest.approx(20)
    assert rotate(cell, "YZ", "pose=2") == 0  # only the position follows the arc
    assert rotate(cell, "YZ") == hresult.TARGET_OUT_OF_RANGE  # would tilt the tool


def test_extended_joints_do_not_exist(cell):
    assert cell.code_of(lambda: cell.move(PTP, "P(450, 50, 80, 0, 0, 0) EX((7, 10))")) == hresult.E_INVALIDARG


# --- slave mode -------------------------------------------------------------------------------------------------------


@pytest.fixture
def slave() -> Iterator[SlaveCell]:
    made = SlaveCell(model="HSR065")
    yield made
    made.close()


def ramp(count: int = 40, *, back: bool = True) -> list[float]:
    """Return smooth parts of a way, 0 to 1 and back to 0."""
    there = [0.5 - 0.5 * math.cos(math.pi * step / count) for step in range(1, count + 1)]
    return there + ([*there[-2::-1], 0.0] if back else [])


def pose_of(cell: SlaveCell, kind: str, joints: tuple[float, ...]) -> list[float]:
    if kind == "J":
        return [*joints, 0.0, 0.0, 0.0, 0.0]
    return cell.arm.space.position(joints) if kind == "P" else cell.arm.space.trans(joints)


@pytest.mark.parametrize("mode", [J0, J1, J2, P0, P1, P2, T0, T1, T2])
def test_slave_mode_in_all_modes(slave, mode):
    slave.on(mode)
    kind = {1: "P", 2: "J", 3: "T"}[mode & 0xFF]
    for part in ramp():
        joints = (HOME[0] + 4 * part, HOME[1] + 6 * part, HOME[2] + 30 * part, HOME[3] - 12 * part)
        slave.send(pose_of(slave, kind, joints))
        slave.cycle()
    for _ in range(8):
        slave.send(pose_of(slave, kind, HOME))
        slave.cycle()
    assert slave.mode == mode
    tops = max(joints[2] for joints in slave.commands)
    assert tops == pytest.approx(130, abs=1e-4)
    assert slave.commands[-1] == pytest.approx(HOME, abs=1e-4)


@pytest.mark.parametrize("mask", [0x400000, 0x40000F, 0x40003F])
@pytest.mark.field("1.2")
def test_the_mask_of_the_joints_of_the_robot(slave, mask):
    slave.on()
    for part in ramp():
        slave.send([*HOME[:2], HOME[2] + 5 * part, HOME[3], 0, 0, 0, 0, float(mask)])
        slave.cycle()
    assert max(joints[2] for joints in slave.commands) == pytest.approx(105)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ((0, 0, 40, 0), hresult.SENT_SPEED_OVER_AXIS1 + 2),  # 5000 mm/s
        ((0, 0, 10, 0), hresult.COMMAND_ACCELERATION_OVER_AXIS1 + 2),
        ((0, 4, 0, 0), hresult.SENT_SPEED_OVER_AXIS1 + 1),
        ((0, 0, 0, 15), hresult.SENT_SPEED_OVER_AXIS1 + 3),
        ((0, 0, 130, 0), hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + 2),
    ],
)
def test_the_limits_of_set_points(slave, change, code):
    slave.on()
    slave.send([*HOME, 0, 0, 0, 0])
    slave.cycle(4)
    assert slave.code_of(lambda: _after(slave, [a + b for a, b in zip(HOME, change, strict=True)])) == code


def _after(slave: SlaveCell, joints: list[float]) -> object:
    found = slave.send([*joints, 0, 0, 0, 0])
    slave.cycle(8)
    again = slave.send([*joints, 0, 0, 0, 0])
    return found if slave.mode else again


def test_a_tilted_tool_in_slave_mode_is_a_stop(slave):
    slave.on(T0)
    tilted = [*slave.arm.space.trans(HOME)[:3], 0, 1, 0, 0.6, 0, 0.8, 0]
    assert slave.code_of(lambda: slave.send(tilted)) == hresult.OUT_OF_WORKING_RANGE


# --- loads, force, areas, programs ------------------------------------------------------------------------------------


def test_only_the_linear_axis_carries_weight(cell):
    dynamics = cell.arm.servo.loads.dynamics
    empty = dynamics.holding(HOME)
    assert len(empty) == len(dynamics.rated) == 4
    assert (empty[0], empty[1], empty[3]) == pytest.approx((0, 0, 0), abs=1e-9)
    assert 0 < empty[2] < dynamics.rated[2]
    cell.execute("PayLoad", [2000, "V(0, 0, -50)", "V(0, 0, 0)"])
    assert dynamics.holding(HOME)[2] - empty[2] == pytest.approx(2 * 9.80665)


def test_loads_while_the_arm_moves(cell):
    move = cell.move(PTP, "J(40, 60, 200, -60)")
    largest = [0.0] * 8
    while not move.done():
        cell.trace(1)
        largest = [max(a, abs(b)) for a, b in zip(largest, cell.execute("GetSrvData", 4), strict=True)]
    assert all(load > 5 for load in largest[:3])
    assert max(largest) < 400
    assert largest[4:] == [0, 0, 0, 0]


def test_compliance_of_the_linear_axis_limits_the_force(cell):
    cell.rc8.workspace.place("plate", (512.5, 238.0, 90.0, 0.0, 0.0, 0.0), stiffness=20.0)
    cell.execute("ForceParam", [1, 0, [0.0, 0.0, 30.0, 0.0, 0.0, 0.0]])
    cell.robot.speed(-1, 10)
    cell.execute("ForceCtrl", [1, 1, 0])
    cell.move(LINE, "P(512.5, 238.157, 70, 0, 0, 0)", "NEXT")
    cell.trace(1500)
    assert not cell.arm.busy
    assert cell.execute("ForceValue", [0, 0])[2] == pytest.approx(30, abs=0.5)
    assert cell.execute("CurPos")[:3] == pytest.approx([512.5, 238.157, 88.5], abs=0.05)
    assert cell.execute("GetSrvData", 4)[2] != 0
    cell.execute("ForceCtrl", 0)
    cell.trace(600)
    assert cell.execute("CurPos")[2] == pytest.approx(70, abs=1e-3)
    assert cell.execute("ForceValue", [0, 0])[2] == pytest.approx(400, abs=0.1)


def test_a_current_limit_lets_the_linear_axis_yield(cell):
    cell.execute("PayLoad", [8000, "V(0, 0, -50)", "V(0, 0, 0)"])
    cell.execute("CurLmt", [1, 3, 1])
    cell.trace(200)
    assert cell.arm.servo.encoder[2] < HOME[2] - 1
    assert cell.code_of(lambda: cell.robot.execute("CurLmt", variant([1, 5, 50]))) == hresult.E_INVALIDARG


def test_an_area_detects_the_tool(cell):
    cell.execute("SetAreaDef", [0, "P(450, 50, 80, 0, 0, 0)", "V(20, 20, 20)", 100, 1])
    cell.execute("SetArea", 0)
    assert cell.arm.hardware.areas is not None
    cell.run(cell.move(PTP, "P(450, 50, 80, 0, 0, 0, 0)"))
    cell.trace(5)
    assert cell.run(cell.controller.get_variable("IO100", "").get_value()) is True


def test_a_program_moves_the_arm(cell):
    cell.execute("GiveArm")
    text = """
Sub Main
  TakeArm
  Move P, J(20, 40, 50, 10)
  Move L, @E P(450, 50, 80, 0, 0, 30)
  Depart L, 20
  P1 = CurPos
  J1 = CurJnt
  GiveArm
End Sub
"""
    cell.run(cell.controller.get_file("scara.pcs", "@Create=1").put_value(variant(text)))
    task = cell.controller.get_task("scara", "")
    cell.run(task.start(1, ""))
    for _ in range(2000):
        cell.trace(1)
        if not cell.arm.busy and cell.arm.holder is None and commanded(cell)[2] > 99:
            break
    cell.trace(50)
    assert commanded(cell) == pytest.approx([450, 50, 100, 0, 0, 30, 0], abs=1e-3)
    assert cell.run(cell.controller.get_variable("P1", "").get_value())[:3] == pytest.approx([450, 50, 100], abs=1)
    assert cell.run(cell.controller.get_variable("J1", "").get_value())[2] == pytest.approx(100, abs=1)
