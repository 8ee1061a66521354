"""Motor loads: gravity, payload, contact, current limits, and the servo data of clients."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.arms import MODEL_NAMES, load_model
from orinkit.core import hresult
from orinkit.values.variant import ARRAY, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.dynamics import ArmDynamics, Payload, Wrench
from support.cell import Cell

NUMBERS = ARRAY | VarType.R8
STRETCHED = (0.0, 90.0, 0.0, 0.0, 0.0, 0.0)
UPRIGHT = (0.0,) * 6


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


def servo(cell: Cell, item: int) -> list[float]:
    return cell.execute("GetSrvData", item)


# --- the model --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in MODEL_NAMES if not load_model(name).is_scara])
def test_gravity_of_every_arm(name):
    dynamics = ArmDynamics(load_model(name))
    assert all(rated > 0 for rated in dynamics.rated)
    upright, stretched = dynamics.holding(UPRIGHT), dynamics.holding(STRETCHED)
    assert upright[0] == stretched[0] == 0  # its axis is vertical
    assert abs(stretched[1]) > abs(stretched[2]) > abs(stretched[4]) > 0
    assert all(abs(torque) < rated for torque, rated in zip(stretched, dynamics.rated, strict=True))


def test_a_payload_adds_its_weight_times_its_lever():
    dynamics = ArmDynamics(load_model("VS-050"))
    before = dynamics.holding(STRETCHED)
    dynamics.payload = Payload(2.0, (0.0, 0.0, 100.0))
    after = dynamics.holding(STRETCHED)
    reach = 0.25 + 0.1195 + 0.1355 + 0.07 + 0.1  # from joint 2 to the centre of the load, m
    assert abs(after[1] - before[1]) == pytest.approx(2.0 * 9.80665 * reach, rel=0.01)
    assert abs(after[4] - before[4]) == pytest.approx(2.0 * 9.80665 * 0.17, rel=0.01)
    contact = Wrench((0.0, 0.0, 19.6133), (0.0, 0.0, 0.0), (reach * 1000, -0.0, 345.0 + 10))
    lifted = dynamics.torques(STRETCHED, STRETCHED, STRETCHED, PERIOD, contact)
    assert lifted[1] == pytest.approx(before[1], rel=0.01)  # the force carries the load


def test_acceleration_needs_torque():
    dynamics = ArmDynamics(load_model("VS-050"))
    joints = [(angle, 90.0, 0.0, 0.0, 0.0, 0.0) for angle in (-0.01, 0.0, 0.02)]
    torque = dynamics.torques(*joints, PERIOD, None)[0]
    dynamics.payload = Payload(0.0, inertia=(0.0, 0.0, 0.0))
    acceleration = math.radians(0.01) / PERIOD**2
    assert torque / acceleration > 0.5  # kg m2
    dynamics.payload = Payload(1e-9, inertia=(1e4, 1e4, 1e4))
    assert dynamics.torques(*joints, PERIOD, None)[0] - torque == pytest.approx(acceleration, rel=0.01)
    assert dynamics.torques(joints[1], joints[1], joints[1], PERIOD, None)[0] == 0


# --- servo data -------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.85 GetSrvData", "5.2.28.86 GetSrvJntData")
@pytest.mark.field("3.2")
def test_types_of_servo_data(cell):
    for item in (1, 2, 4, 5, 7, 8):
        got = cell.robot.execute("GetSrvData", variant(item))
        assert (got.type, len(got.value)) == (NUMBERS, 8)
    for item in (17, 18, 19, 20):
        got = cell.robot.execute("GetSrvData", variant([item]))
        assert (got.type, len(got.value)) == (NUMBERS, 7)
    for item in (1, 2, 4, 5, 8):
        got = cell.robot.execute("GetSrvJntData", variant([item, 2]))
        assert got.type == VarType.R4
        assert got.value == pytest.approx(servo(cell, item)[1])
    for given in ([7, 1], [4, 0], [4, 7], [4], 4, [17, 1]):
        assert cell.code_of(lambda given=given: cell.execute("GetSrvJntData", given)) != 0


def test_servo_data_of_a_motion(cell):
    assert servo(cell, 1) == [0.0] * 8
    assert servo(cell, 8)[:6] == [0, 45, 90, 0, 45, 0]
    cell.move(2, "P(364, 200, 278, 180, 0, 180)", "SPEED=20,NEXT")
    cell.trace(60)
    velocity, limits = cell.arm.servo.velocity(), cell.arm.model.axes
    assert servo(cell, 1)[:6] == pytest.approx(
        [4000 * rate / axis.velocity for rate, axis in zip(velocity, limits, strict=True)]
    )
    assert servo(cell, 17)[1] == pytest.approx(300, rel=0.02)
    assert servo(cell, 18)[1] == pytest.approx(300 * 3 * PERIOD, rel=0.05)  # three cycles of lag
    x, y = servo(cell, 19)[:2]
    assert math.hypot(x, y) == pytest.approx(300, rel=0.02)
    assert servo(cell, 20)[3:] == [0.0] * 4
    assert servo(cell, 8)[:6] == list(cell.arm.queue.joints)
    cell.trace(400)
    for item in (1, 17, 18, 19, 20):
        assert servo(cell, item) == pytest.approx([0.0] * len(servo(cell, item)), abs=1e-9)


@pytest.mark.guide("5.2.28.95 PayLoad")
def test_a_payload_loads_the_motors(cell):
    before = servo(cell, 4)
    cell.execute("PayLoad", [4000, "V(0, 0, 100)"])
    after = servo(cell, 4)
    assert after[1] > before[1] + 3
    assert all(load >= 0 for load in after)  # the current is absolute
    assert any(torque < 0 for torque in servo(cell, 5)) or any(torque > 0 for torque in servo(cell, 5))
    assert servo(cell, 7)[1] == pytest.approx(after[1], rel=1e-6)  # at standstill
    assert servo(cell, 0x11) == [0.0] * 7


@pytest.mark.guide("5.2.28.87 GrvCtrl", "5.2.28.90 GrvOffset")
@pytest.mark.field("3.2")
def test_gravity_control_takes_the_weight_out_of_the_torque_command(cell):
    assert abs(servo(cell, 5)[1]) > 1
    cell.execute("GrvCtrl", 1)
    assert servo(cell, 5) == pytest.approx([0.0] * 8, abs=1e-9)
    cell.rc8.workspace.place("plate", (364.0, 0.0, 300.0, 0, 0, 0), stiffness=1.0)
    cell.clock.advance(PERIOD)
    pressed = servo(cell, 5)
    assert abs(pressed[1]) > 0.5  # the force of the contact remains
    cell.execute("GrvOffset", 1)
    assert servo(cell, 5) == pytest.approx([0.0] * 8, abs=1e-9)
    cell.execute("GrvOffset", 0)
    assert servo(cell, 5) == pytest.approx(pressed)
    cell.execute("GrvCtrl", 0)
    assert abs(servo(cell, 5)[1]) > 1
    for name in ("GrvCtrl", "GrvOffset"):
        assert cell.code_of(lambda name=name: cell.execute(name, "x")) != 0


# --- current limits ---------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.88 CurLmt")
@pytest.mark.field("3.2")
def test_a_limited_axis_yields_to_a_contact(cell):
    """The arm presses on a plate: with a limit, it stays behind its command, and the force follows from the limit."""
    cell.execute("GrvCtrl", 1)
    cell.rc8.workspace.place("plate", (364.0, 0.0, 270.0, 0, 0, 0), stiffness=10.0)

    def press() -> float:
        cell.run(cell.move(2, "P(364.16, 0, 255, 180, 0, 180, 5)", "SPEED=10"))
        cell.trace(1500)
        return cell.execute("ForceValue", 0)[2]

    free = press()
    assert free == pytest.approx(150, rel=0.01)
    cell.run(cell.move(2, "P(364.16, 0, 278, 180, 0, 180, 5)", "SPEED=10"))
    for axis in (2, 3, 5):
        cell.execute("CurLmt", [1, axis, 5.0])
    limited = press()
    assert 1 < limited < 0.6 * free
    assert max(servo(cell, 4)) < 8
    assert cell.execute("CurPos")[2] > cell.execute("DestPos")[2] + 2
    assert max(map(abs, servo(cell, 2))) > 0.1
    cell.execute("CurLmt", [0, 0])
    cell.trace(1500)
    assert cell.execute("ForceValue", 0)[2] == pytest.approx(free, rel=0.01)
    assert cell.execute("CurPos")[2] == pytest.approx(cell.execute("DestPos")[2], abs=1e-3)
    assert not cell.rc8.state.faults.code


def test_an_axis_that_yields_too_far_is_an_error(cell):
    cell.execute("CurLmt", [1, 2, 1.0])  # without gravity control: the limit does not hold the weight
    cell.trace(3000)
    assert cell.rc8.state.faults.code == hresult.POSITION_DEVIATION_AXIS1 + 1
    assert not cell.arm.motor.on
    cell.trace(10)
    assert cell.arm.queue.joints == cell.arm.servo.encoder
    assert abs(cell.arm.servo.encoder[1] - 45) > 5


@pytest.mark.parametrize("switch_off", ["Motor", "emergency stop", "refused motion"])
def test_the_brakes_hold_a_limited_axis_without_power(cell, switch_off):
    """A motion that is refused with a code of level 3 switches the motor off: the arm then sank by its own weight."""
    cell.execute("CurLmt", [1, 2, 1.0])
    cell.trace(10)
    sunk = cell.arm.servo.encoder
    assert sunk[1] > 45  # with power, the limit does not hold the weight
    if switch_off == "Motor":
        cell.robot.execute("Motor", variant(0))
    elif switch_off == "emergency stop":
        cell.rc8.emergency_stop(True)
    else:
        assert cell.code_of(lambda: cell.move(5, "J(0, 45, 90, 0, 45, 0)")) == hresult.INTERPOLATION_NOT_SUPPORTED
    assert not cell.arm.motor.on
    cell.trace(500)
    assert cell.arm.servo.encoder == cell.arm.queue.joints == sunk
    cell.execute("CurLmt", [0, 0])
    cell.trace(500)
    assert cell.arm.servo.encoder == sunk


@pytest.mark.parametrize("given", [[1, 2], [1, 2, 0.5], [1, 2, 101], [1, 0, 50], [1, 7, 50], [0, 9], [1], ["x", 1, 50]])
def test_invalid_current_limits(cell, given):
    assert cell.code_of(lambda: cell.execute("CurLmt", given)) != 0
    assert not cell.arm.servo.loads.limits


@pytest.mark.guide("5.2.28.89 Zforce")
def test_zforce_needs_a_linear_third_axis(cell):
    assert cell.code_of(lambda: cell.execute("Zforce", 50.0)) == hresult.E_INVALIDARG


@pytest.mark.guide("5.2.28.91 HighPathAccuracy")
@pytest.mark.field("3.2")
def test_high_path_accuracy_reduces_the_lag(cell):
    def lag() -> float:
        y = 150 if cell.execute("CurPos")[1] < 75 else 0
        cell.move(2, f"P(364, {y}, 278, 180, 0, 180, 5)", "SPEED=10,NEXT")
        cell.trace(60)
        found = max(map(abs, servo(cell, 18)))
        cell.trace(300)
        assert not cell.arm.busy
        return found

    usual = lag()
    assert cell.execute("HighPathAccuracy", 1) is None
    assert lag() == pytest.approx(usual / 3, rel=0.1)
    cell.move(1, "J(20, 45, 90, 0, 45, 0)", "NEXT")
    cell.trace(5)
    assert cell.code_of(lambda: cell.execute("HighPathAccuracy", 0)) == hresult.ROBOT_MOVING
    cell.trace(400)
    cell.execute("HighPathAccuracy", 0)
    assert lag() == pytest.approx(usual, rel=0.1)


# --- information ------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.97 RobInfo", "5.2.28.73 GetRobotTypeName")
@pytest.mark.field("3.2")
def test_information_about_the_robot(cell):
    def info(item: Any) -> tuple[int, Any]:
        got = cell.robot.execute("RobInfo", variant(item))
        return got.type, got.value

    assert info(0) == (VarType.I4, 0)
    assert info(1) == (VarType.BSTR, "VS050A3-AV6-NNN-NNN")
    name = cell.robot.execute("GetRobotTypeName", variant(None))
    assert (name.type, name.value) == info(1)
    assert info(2) == (NUMBERS, [0.0] * 8)
    cell.run(cell.move(1, "@E J(10, 45, 90, 0, 45, 0)"))
    cell.run(cell.move(1, "@E J(-5, 45, 90, 0, 45, 30)"))
    assert info(2)[1] == pytest.approx([25, 0, 0, 0, 0, 30, 0, 0], abs=1e-9)
    assert cell.code_of(lambda: cell.execute("RobInfo", 3)) == hresult.E_INVALIDARG
