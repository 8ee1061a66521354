"""Force sensor, force control and compliant surfaces, as clients see them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.cell import Cell
from support.slave_cell import J0, SlaveCell

NUMBERS = ARRAY | VarType.R8
TOP = 250.0
"""Height of the surface, mm; the tip of the arm at home is 28.5 mm above it."""


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    made.rc8.workspace.place("plate", (364.0, 0.0, TOP, 0.0, 0.0, 0.0), stiffness=20.0)
    yield made
    made.close()


def down_to(cell: Cell, height: float, option: str = "") -> Any:
    """Move the tip on a vertical line to a height, mm."""
    x, y, *_ = cell.execute("CurPos")
    result = cell.run(cell.move(2, f"@E P({x}, {y}, {height}, 180, 0, 180, 5)", option), 60.0)
    cell.trace(3)  # to standstill
    return result


def force(cell: Cell, item: int = 0, mode: int = 0) -> list[float]:
    return cell.execute("ForceValue", [item, mode])


def height(cell: Cell) -> float:
    return cell.execute("CurPos")[2]


def settle(cell: Cell, cycles: int = 400) -> None:
    cell.trace(cycles)


def check_limits(cell: Cell, commands: list[tuple[float, ...]]) -> None:
    """Check that a sequence of command positions is within velocity and acceleration of the model."""
    steps = np.diff(np.array(commands), axis=0) / PERIOD
    bends = np.diff(steps, axis=0) / PERIOD
    axes = cell.arm.model.axes
    assert np.all(np.abs(steps) <= np.array([axis.velocity for axis in axes]) * (1 + 1e-6))
    assert np.all(np.abs(bends) <= np.array([axis.acceleration for axis in axes]) * (1 + 1e-6))


def commands(cell: Cell, cycles: int) -> list[tuple[float, ...]]:
    found = []
    for _ in range(cycles):
        cell.clock.advance(PERIOD)
        found.append(cell.arm.servo.command)
    return found


# --- surfaces and sensor ----------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.81 ForceValue")
def test_force_is_stiffness_times_penetration(cell):
    got = cell.robot.execute("ForceValue", variant(0))
    assert (got.type, got.value) == (NUMBERS, [0.0] * 6)
    for depth in (1.0, 4.0, 9.5):
        down_to(cell, TOP - depth)
        assert height(cell) == pytest.approx(TOP - depth)
        assert force(cell) == pytest.approx([0, 0, 20 * depth, 0, 0, 0], abs=1e-6)
        assert force(cell, 13) == pytest.approx([0, 0, -20 * depth, 0, 0, 0], abs=1e-6)  # the tool points down
        assert force(cell, 1) == pytest.approx([0, 0, -20 * depth * 20, 0, 0, 0], abs=0.5)  # pulses
    down_to(cell, TOP + 1)
    assert force(cell) == [0.0] * 6


def test_a_surface_has_edges_and_a_thickness(cell):
    place = cell.rc8.workspace.place
    down_to(cell, TOP - 5)
    for pose, touched in (
        ((364, 0, TOP, 0, 0, 0), True),
        ((364 - 99, 0, TOP, 0, 0, 0), True),
        ((364 - 101, 0, TOP, 0, 0, 0), False),
        ((364, 101, TOP, 0, 0, 0), False),
        ((364, 0, TOP, 180, 0, 0), False),  # its free side is below
        ((364, 0, TOP + 150, 0, 0, 0), False),  # the tip is behind it
    ):
        place("plate", pose)
        assert any(force(cell)) is touched, pose
    cell.rc8.workspace.remove("plate")
    assert not any(force(cell))
    assert not cell.rc8.workspace.surfaces


def test_damping_resists_a_motion_into_the_surface(cell):
    cell.rc8.workspace.place("plate", (364.0, 0.0, TOP, 0, 0, 0), stiffness=1.0, damping=0.5)
    down_to(cell, TOP - 1, "SPEED=2")
    assert force(cell)[2] == pytest.approx(1.0, abs=1e-6)
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 21}, 180, 0, 180, 5)", "SPEED=2,NEXT")
    cell.trace(60)
    speed = -cell.execute("GetSrvData", 17)[2]
    assert speed > 5
    assert force(cell)[2] == pytest.approx(TOP - height(cell) + 0.5 * speed, rel=1e-6)


def test_friction_resists_sliding(cell):
    cell.rc8.workspace.place("plate", (364.0, 0.0, TOP, 0, 0, 0), stiffness=10.0, friction=0.4)
    down_to(cell, TOP - 5)
    assert force(cell) == pytest.approx([0, 0, 50, 0, 0, 0], abs=1e-6)
    x = cell.execute("CurPos")[0]
    cell.move(2, f"P({x}, 60, {TOP - 5}, 180, 0, 180, 5)", "SPEED=5,NEXT")
    cell.trace(60)
    assert force(cell) == pytest.approx([0, -20, 50, 0, 0, 0], abs=0.05)


def test_a_flat_tool_transmits_a_moment(cell):
    cell.rc8.workspace.place("plate", (364.0, 0.0, TOP, 0, 0, 0), stiffness=10.0, radius=20.0)
    x, y, *_ = cell.execute("CurPos")
    cell.run(cell.move(2, f"@E P({x}, {y}, {TOP - 4}, 180, 0, 180, 5)"))
    assert force(cell) == pytest.approx([0, 0, 40, 0, 0, 0], abs=1e-6)
    cell.run(cell.move(2, f"@E P({x}, {y}, {TOP - 4}, 182, 0, 180, 5)"))
    tilted = force(cell)
    assert tilted[2] == pytest.approx(40, abs=0.1)
    lever = 20 * math.sin(math.radians(2))  # mm, the height of the rim
    assert abs(tilted[3]) == pytest.approx(10 / 4 * lever * 20 * math.cos(math.radians(2)) * 2 / 1000, rel=0.01)


@pytest.mark.parametrize(
    "options",
    [
        {"stiffness": 0.0}, {"stiffness": 1e4}, {"stiffness": math.nan}, {"damping": -1.0}, {"damping": 11.0}, {"friction": 3.0},
        {"size": (0.0, 10.0)}, {"thickness": 0.0}, {"radius": -1.0}, {"radius": 1e3}, {"pose": (0.0,) * 5}, {"pose": (1e6,) * 6},
        {"name": " "}, {"name": "x" * 65},
    ],
)  # fmt: skip
def test_numbers_of_a_surface_are_bounded(cell, options):
    given = {"name": "other", "pose": (0.0,) * 6, **options}
    with pytest.raises(ValueError):
        cell.rc8.workspace.place(given.pop("name"), given.pop("pose"), **given)
    assert list(cell.rc8.workspace.surfaces) == ["plate"]


def test_there_are_at_most_sixteen_surfaces(cell):
    for number in range(15):
        cell.rc8.workspace.place(f"s{number}", (0.0,) * 6)
    with pytest.raises(ValueError):
        cell.rc8.workspace.place("one more", (0.0,) * 6)
    with pytest.raises(ValueError):
        cell.rc8.workspace.remove("one more")


@pytest.mark.guide("5.2.28.83 ForceSensor")
def test_a_reset_makes_the_present_reading_zero(cell):
    down_to(cell, TOP - 5)
    assert cell.execute("ForceSensor", 0) is None
    assert force(cell) == pytest.approx([0] * 6, abs=1e-6)
    down_to(cell, TOP - 8)
    assert force(cell)[2] == pytest.approx(60, abs=1e-6)
    assert cell.code_of(lambda: cell.execute("ForceSensor", 1)) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.guide("5.2.28.95 PayLoad")
@pytest.mark.field("3.2")
def test_the_sensor_weighs_the_payload_unless_it_is_compensated(cell):
    assert cell.execute("PayLoad", [2000, "V(0, 0, 50)", "V(1, 2, 3)"]) is None
    assert cell.execute("CurPayLoad") == [2000, [0, 0, 50], [1, 2, 3]]
    assert force(cell) == pytest.approx([0, 0, -2 * 9.80665, 0, 0, 0])
    cell.execute("ForceSensorPayLoad", [1500])
    assert cell.execute("CurForceSensorPayLoad") == [1500, [0, 0, 0], [0, 0, 0]]
    assert force(cell)[2] == pytest.approx(-0.5 * 9.80665)
    for given in ([-1], [1e7], [1, "V(1e9, 0, 0)"], [], ["x"]):
        assert cell.code_of(lambda given=given: cell.execute("PayLoad", given)) != 0
    assert cell.execute("CurPayLoad")[0] == 2000


def test_peaks_are_kept_until_they_are_reset(cell):
    down_to(cell, TOP - 6)
    down_to(cell, TOP - 2)
    assert force(cell, 2)[2] == pytest.approx(120, abs=1)
    assert force(cell, 3) == pytest.approx([0] * 6, abs=1e-6)
    assert force(cell, 2, -1)[2] == pytest.approx(120, abs=1)
    assert force(cell, 2)[2] == pytest.approx(40, abs=1e-6)
    for item, mode in ((14, 0), (-1, 0), (0, 1)):
        assert cell.code_of(lambda item=item, mode=mode: force(cell, item, mode)) != 0


# --- force control ----------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.79 ForceCtrl", "5.2.28.80 ForceParam")
@pytest.mark.field("3.2")
def test_compliance_limits_the_force_and_goes_back_smoothly(cell):
    assert cell.execute("ForceParam", [1, 0, [0.0, 0.0, 30.0, 0.0, 0.0, 0.0]]) is None
    down_to(cell, TOP + 2, "SPEED=20")
    cell.robot.speed(-1, 20)
    assert cell.execute("ForceCtrl", [1, 1, 0]) is None
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 20}, 180, 0, 180, 5)", "NEXT")
    path = commands(cell, 900)
    assert not cell.arm.busy
    assert force(cell)[2] == pytest.approx(30, abs=0.5)
    assert height(cell) == pytest.approx(TOP - 1.5, abs=0.05)
    assert cell.execute("DestPos")[2] == pytest.approx(TOP - 20)
    assert cell.execute("ForceCtrl", 0) is None
    path += commands(cell, 600)
    assert height(cell) == pytest.approx(TOP - 20, abs=1e-3)
    assert force(cell)[2] == pytest.approx(400, abs=0.1)
    check_limits(cell, path)


def test_with_a_spring_the_arm_shares_the_way_with_the_surface(cell):
    cell.execute("ForceParam", [2, 0, [0.0] * 6, None, [1000.0, 1000.0, 20.0, 100.0, 100.0, 100.0]])
    down_to(cell, TOP + 1)
    cell.robot.speed(-1, 10)
    cell.execute("ForceCtrl", [1, 2, 0])
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 10}, 180, 0, 180, 5)", "NEXT")
    settle(cell, 1200)
    assert force(cell)[2] == pytest.approx(100, abs=1)  # equal springs: half of the way each
    assert force(cell, 4)[2] == pytest.approx(-6, abs=0.1)  # travel by command since the start of control
    assert force(cell, 7)[2] == pytest.approx(-6, abs=0.1)


@pytest.mark.guide("5.2.28.81 ForceValue")
def test_travel_deviation_and_their_peaks(cell):
    down_to(cell, TOP + 20)
    cell.robot.speed(-1, 10)
    cell.execute("ForceParam", [1, 0, [1e4] * 6])
    cell.execute("ForceCtrl", [1, 1, 0])
    largest = 0.0
    for way in (-6.0, 4.0):
        x, y, z, *_ = cell.execute("CurPos")
        cell.move(2, f"P({x}, {y}, {z + way}, 180, 0, 180, 5)", "NEXT")
        for _ in range(300):
            cell.trace(1)
            command, encoder, deviation = force(cell, 4), force(cell, 7), force(cell, 10)
            assert deviation == pytest.approx([a - b for a, b in zip(command, encoder, strict=True)], abs=1e-9)
            largest = max(largest, abs(deviation[2]))
        assert not cell.arm.busy
    assert largest > 0.05
    assert (force(cell, 4)[2], force(cell, 7)[2]) == pytest.approx((-2, -2), abs=1e-3)
    for high, low in ((5, 6), (8, 9)):
        assert (force(cell, high)[2], force(cell, low)[2]) == pytest.approx((0, -6), abs=1e-2)
    assert max(force(cell, 11)[2], -force(cell, 12)[2]) == pytest.approx(largest, abs=1e-6)
    assert force(cell, 9, -1)[2] == pytest.approx(-6, abs=1e-2)
    assert force(cell, 9)[2] == pytest.approx(-2, abs=1e-3)  # begun anew
    assert force(cell, 6)[2] == pytest.approx(-6, abs=1e-2)


def test_the_force_sensor_mode_presses_with_a_force(cell):
    down_to(cell, TOP + 3)
    cell.robot.speed(-1, 10)
    rate = [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]
    cell.execute("ForceParam", [3, 0, [0, 0, -50.0, 0, 0, 0], *[None] * 8, rate, 20.0, 10.0])
    x = cell.execute("CurPos")[0]
    cell.execute("ForceCtrl", [1, 3, 1])
    path = commands(cell, 1000)
    assert force(cell)[2] == pytest.approx(50, abs=0.5)
    assert cell.execute("CurPos")[:3] == pytest.approx([x, 0, TOP - 2.5], abs=0.05)
    check_limits(cell, path)


@pytest.mark.guide("5.2.28.84 ForceChangeTable")
def test_the_table_can_be_changed_while_it_is_controlled(cell):
    down_to(cell, TOP + 1)
    cell.robot.speed(-1, 10)
    rate = [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]
    for table, newton in ((1, -20.0), (2, -40.0)):
        cell.execute("ForceParam", [table, 0, [0, 0, newton, 0, 0, 0], *[None] * 7, 1, rate])
    assert cell.code_of(lambda: cell.execute("ForceChangeTable", 2)) == hresult.E_FAIL
    cell.execute("ForceCtrl", [1, 1])
    settle(cell, 800)
    assert force(cell)[2] == pytest.approx(20, abs=0.5)
    assert cell.execute("ForceChangeTable", 2) is None
    settle(cell, 800)
    assert force(cell)[2] == pytest.approx(40, abs=0.5)
    assert cell.code_of(lambda: cell.execute("ForceChangeTable", 11)) == hresult.VALUE_OUT_OF_RANGE


def test_tool_coordinates_turn_with_the_tool(cell):
    cell.execute("ForceParam", [1, 1, [0.0] * 6])
    down_to(cell, TOP - 2)
    cell.execute("ForceCtrl", [1, 1])
    cell.clock.advance(PERIOD)
    assert force(cell)[2] < -35  # the Z axis of the tool points down


def test_a_displacement_beyond_its_tolerance_is_an_error(cell):
    deviation = [5.0, 5.0, 5.0, 45.0, 45.0, 45.0]
    cell.execute("ForceParam", [1, 0, [0.0] * 6, deviation])
    down_to(cell, TOP + 1)
    cell.robot.speed(-1, 20)
    cell.execute("ForceCtrl", [1, 1, 0])
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 30}, 180, 0, 180, 5)", "NEXT")
    settle(cell, 600)
    assert cell.rc8.state.faults.code & ~0xF == 0x84404510
    assert not cell.arm.motor.on
    assert not cell.arm.hardware.force.on
    assert not cell.arm.hardware.force.displacing


def test_force_control_needs_arm_motor_and_half_speed(cell):
    other = cell.connect().get_robot("Arm", "")
    assert cell.code_of(lambda: other.execute("ForceCtrl", variant([1, 1]))) == hresult.ARM_NOT_TAKEN
    for given in ([1], [1, 0], [1, 11], [1, 1, 7]):
        assert cell.code_of(lambda given=given: cell.execute("ForceCtrl", given)) != 0
    cell.execute("ForceCtrl", [1, 1])
    assert cell.code_of(lambda: cell.move(1, "J(10, 45, 90, 0, 45, 0)")) == hresult.FORCE_CONTROL_TOO_FAST
    cell.robot.speed(-1, 50)
    assert cell.code_of(lambda: cell.move(1, "J(1, 45, 90, 0, 45, 0)")) == 0
    cell.execute("GiveArm")
    assert not cell.arm.hardware.force.on  # released
    cell.execute("Motor", 0)
    cell.take()
    assert cell.execute("ForceCtrl", [1, 1]) is None
    assert not cell.arm.hardware.force.on  # without power it has no effect


@pytest.mark.parametrize("option", ["SPEED=51", "S=100", "SPEED=F1"])
def test_the_option_speed_does_not_exceed_half_speed(cell, option):
    cell.put("F1", 60)
    cell.robot.speed(-1, 20)
    cell.execute("ForceCtrl", [1, 1])
    start = cell.arm.queue.joints
    for move in (
        lambda: cell.move(1, "J(10, 45, 90, 0, 45, 0)", option),
        lambda: cell.move(2, "P(364, 5, 279, 180, 0, 180, 5)", option),
    ):
        assert cell.code_of(move) == hresult.FORCE_CONTROL_TOO_FAST
    assert cell.arm.queue.joints == start
    assert cell.code_of(lambda: cell.move(1, "J(1, 45, 90, 0, 45, 0)", "SPEED=50")) == 0


@pytest.mark.parametrize("state", ["runs", "is paused", "is queued"])
def test_force_control_is_refused_during_a_faster_motion(cell, state):
    first, then = ("SPEED=50,NEXT", "SPEED=51,NEXT") if state == "is queued" else ("SPEED=51,NEXT", "SPEED=50,NEXT")
    cell.move(1, "J(20, 45, 90, 0, 45, 0)", first)
    cell.move(1, "J(40, 45, 90, 0, 45, 0)", then)
    cell.trace(5)
    if state == "is paused":
        cell.run(cell.robot.hold(""))
    for given in ([1, 1], [1, 2, 1]):
        assert cell.code_of(lambda given=given: cell.execute("ForceCtrl", given)) == hresult.FORCE_CONTROL_TOO_FAST
    assert not cell.arm.hardware.force.on
    cell.execute("ForceCtrl", 0)
    if state == "is paused":
        cell.robot.unhold("")
    cell.trace(1000)
    assert cell.arm.queue.joints[0] == 40  # the motions are not affected
    cell.move(1, "J(20, 45, 90, 0, 45, 0)", "SPEED=50,NEXT")
    cell.trace(5)
    cell.execute("ForceCtrl", [1, 1])
    assert cell.arm.hardware.force.on


def _pressed(cell: Cell) -> float:
    """Press the tool against the surface with force control; return its height."""
    cell.execute("ForceParam", [1, 0, [0.0] * 6])
    down_to(cell, TOP + 1)
    cell.execute("ExtSpeed", 20)
    cell.execute("ForceCtrl", [1, 1, 0])
    down_to(cell, TOP - 15)
    settle(cell)
    return height(cell)


@pytest.mark.parametrize("loss", ["GiveArm", "client"])
def test_the_arm_stays_displaced_when_it_is_released(cell, loss):
    before = _pressed(cell)
    assert before > TOP - 1
    if loss == "GiveArm":
        cell.execute("GiveArm")
    else:
        cell.controller.release()
        cell.robot = cell.connect().get_robot("Arm", "")
    commands = []
    for _ in range(200):
        cell.trace(1)
        commands.append(cell.arm.servo.command)
        assert height(cell) == pytest.approx(before, abs=0.05)
    check_limits(cell, commands)
    assert not cell.arm.hardware.force.displacing
    assert cell.arm.queue.joints == cell.arm.servo.command
    cell.take()
    assert down_to(cell, TOP + 5) is None


def test_a_moving_arm_whose_client_is_lost_does_not_go_back(cell):
    _pressed(cell)
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 60, {TOP - 15}, 180, 0, 180, 5)", "NEXT")
    cell.trace(30)
    assert cell.arm.busy
    cell.controller.release()
    cell.robot = cell.connect().get_robot("Arm", "")
    commands = []
    for _ in range(300):
        cell.trace(1)
        commands.append(cell.arm.servo.command)
        assert height(cell) > TOP - 1
    check_limits(cell, commands)
    assert commands[-1] == commands[-100] == cell.arm.queue.joints
    assert not cell.arm.hardware.force.displacing


@pytest.mark.parametrize(
    "given",
    [
        [0, 0, [0.0] * 6], [11, 0, [0.0] * 6], [1, 3, [0.0] * 6], [1, 0, [0.0] * 5], [1, 0], [1, 0, [math.inf] * 6], [1, 0, "x"],
        [1, 0, [0.0] * 6, None, [-1.0] * 6], [1, 0, [0.0] * 6, *[None] * 7, 5], [1, 0, [0.0] * 6, *[None] * 12],
        [1, 0, [0.0] * 6, *[None] * 8, [101.0] * 6],
    ],
)  # fmt: skip
def test_invalid_parameters(cell, given):
    assert cell.code_of(lambda: cell.execute("ForceParam", given)) != 0


def test_an_emergency_stop_ends_force_control_where_the_arm_is(cell):
    cell.execute("ForceParam", [1, 0, [0.0] * 6])
    down_to(cell, TOP + 1)
    cell.robot.speed(-1, 10)
    cell.execute("ForceCtrl", [1, 1, 0])
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 15}, 180, 0, 180, 5)", "NEXT")
    settle(cell, 600)
    before = height(cell)
    assert before > TOP - 1
    cell.rc8.emergency_stop(True)
    settle(cell, 100)
    assert height(cell) == pytest.approx(before, abs=0.1)
    assert cell.arm.queue.joints == cell.arm.servo.command == cell.arm.servo.encoder


PROGRAM = b"""
Sub Main
  TakeArm
  PayLoad 1000, V(0, 0, 50)
  ForceSensor 0
  Tool 2, P(0, 0, 10, 0, 0, 0)
  ForceParam 4, 0, P(9999, 9999, 9999, 9999, 9999, 9999)
  Speed 10
  ForceCtrl On, 4, 0
  Move L, P(364.16, 0, 240, 180, 0, 180, 5), Next
  ForceWaitCondition -1, P(-1, -1, 30, -1, -1, -1), -1, 2
  P1 = ForceValue(0)
  J1 = GetSrvData(8)
  I1 = CurTool()
  F1 = GetSrvJntData(5, 2)
  GiveArm
End Sub
"""


def test_programs_use_the_same_commands(cell):
    cell.execute("GiveArm")
    cell.rc8.state.files.write("Press.pcs", PROGRAM)
    cell.run(cell.controller.get_task("Press", "").start(1, ""))
    cell.trace(1500)
    assert not cell.rc8.state.faults.code, cell.rc8.state.faults.message
    values = {name: cell.controller.get_variable(name, "").get_value().plain for name in ("P1", "J1", "I1", "F1")}
    assert 30 <= values["P1"][2] < 120
    assert values["J1"][0] == pytest.approx(0, abs=1e-3)
    assert values["F1"] != 0
    assert cell.execute("GetToolDef", 2) == [0, 0, 10, 0, 0, 0]
    assert cell.execute("CurPayLoad")[0] == 1000
    assert not cell.arm.busy
    assert not cell.arm.hardware.force.on


# --- waiting for a force ----------------------------------------------------------------------------------------------


def wait_for(robot: Any, *given: Any) -> Any:
    return robot.execute("ForceWaitCondition", variant(list(given)))


@pytest.mark.guide("5.2.28.82 ForceWaitCondition")
@pytest.mark.field("3.2")
@pytest.mark.parametrize(("mode", "busy"), [(0, True), (1, False), (2, False)])
def test_a_wait_ends_at_its_force(cell, mode, busy):
    other = cell.connect().get_robot("Arm", "")
    cell.robot.speed(-1, 10)
    cell.execute("ForceParam", [1, 0, [1e4] * 6])
    cell.execute("ForceCtrl", [1, 1, 0])
    cell.move(2, f"P({cell.execute('CurPos')[0]}, 0, {TOP - 60}, 180, 0, 180, 5)", "SPEED=10,NEXT")
    wait = wait_for(other, -1, [-1, -1, 40, -1, -1, -1], -1, mode)
    assert not wait.done()
    cell.cycles(wait)
    assert 40 <= force(cell)[2] < 600
    assert cell.arm.busy is busy
    assert cell.arm.hardware.force.on is (mode != 2)


def test_all_parts_of_a_condition_must_hold(cell):
    cell.robot.speed(-1, 10)
    cell.execute("ForceParam", [1, 0, [1e4] * 6])
    cell.execute("ForceCtrl", [1, 1, 0])
    x = cell.execute("CurPos")[0]
    cell.move(2, f"P({x}, 0, {TOP - 20}, 180, 0, 180, 5)", "NEXT")
    wait = wait_for(cell.connect().get_robot("", ""), "P(-1, -1, 35, -1, -1, -1)", "P(-1, -1, 10, -1, -1, -1)", 500, 1)
    cell.cycles(wait)
    assert abs(force(cell, 7)[2]) >= 35
    assert force(cell)[2] >= 10


def test_a_wait_ends_with_its_time_out(cell):
    robot = cell.connect().get_robot("", "")
    cycles = None
    wait = wait_for(robot, -1, [-1, -1, 40, -1, -1, -1], -1, 1, 80)
    with pytest.raises(CallError) as caught:
        cycles = cell.cycles(wait)
    assert (caught.value.code, cycles) == (hresult.E_TIMEOUT, None)
    assert cell.cycles(wait_for(robot, -1, -1, -1, 0)) <= 1  # nothing is looked at
    for given in ([-1, [1.0] * 5], [-1, -1, -1, 3], [-1, -1, "x"]):
        assert cell.code_of(lambda given=given: wait_for(robot, *given)) != 0


def test_halt_and_a_lost_client_end_a_wait(cell):
    client = cell.connect()
    robot = client.get_robot("", "")
    wait = wait_for(robot, -1, [-1, -1, 40, -1, -1, -1])
    cell.robot.halt("")
    cell.clock.advance(PERIOD)
    assert cell.code(wait) == hresult.STOPPED_DURING_PC_MOTION
    wait = wait_for(robot, -1, [-1, -1, 40, -1, -1, -1])
    robot.release()
    assert cell.code(wait) == hresult.E_ABORT
    assert len(cell.arm.hardware.waits) == 0


@pytest.mark.guide("5.2.28.81 ForceValue", "5.2.28.82 ForceWaitCondition")
def test_a_guarded_approach_in_slave_mode():
    """Stream towards a surface: the force rises as the model predicts, the wait of another client ends, the arm stops."""
    cell = SlaveCell()
    stiffness = 15.0
    cell.rc8.workspace.place("plate", (364.0, 0.0, 270.0, 0, 0, 0), stiffness=stiffness)
    other = cell.connect().get_robot("", "")
    cell.on(J0)
    wait = wait_for(other, -1, [-1, -1, 60, -1, -1, -1], -1, 1)
    home = np.array(cell.arm.queue.joints)
    kinematics, code = cell.arm.space.kinematics, 0
    joints, step, sent = home, 0.0, 0
    for _ in range(600):
        step = min(0.16, step + 0.004)  # mm in a cycle
        frame = kinematics.forward(joints)
        frame[2, 3] -= step
        joints = kinematics.choose(frame, -2, joints)
        try:
            cell.send([float(joint) for joint in joints])
        except CallError as error:
            code = error.code
            break
        sent += 1
        cell.cycle()
        got = other.execute("ForceValue", variant(0)).value
        tip = other.execute("CurPos", variant(None)).value
        assert got[2] == pytest.approx(max(0.0, stiffness * (270.0 - tip[2])), abs=1e-6)
    assert code in (hresult.SLAVE_MODE_OFF, hresult.STOPPED_DURING_PC_MOTION)
    assert sent > 50
    cell.cycles(wait)
    assert not cell.arm.busy
    cell.rest()
    assert 60 <= other.execute("ForceValue", variant(0)).value[2] < 90
    assert cell.mode == 0
    cell.close()
