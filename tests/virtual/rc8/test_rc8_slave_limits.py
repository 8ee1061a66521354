"""Slave mode of the virtual RC8: limits of velocity and acceleration, and poses that the arm cannot reach."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.arms import load_model
from orinkit.cao.provider import ClientInfo
from orinkit.cli._shared.errors import CommandError
from orinkit.cli.commands.pendant import ACTIONS, PendantArguments
from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider
from orinkit.virtual.rc8.robot.slave_mode.limits import LENIENCY, SERVO_LIMIT, SlaveLimits
from orinkit.virtual.rc8.robot.speeds import Speeds
from orinkit.virtual.rc8.switches import SlaveLimit, Switches
from support.slave_cell import HOME, J0, J1, J2, P0, T0, SlaveCell, straight

VS050 = load_model("VS-050")
ZERO = (0.0,) * 6


@pytest.fixture
def cell() -> Iterator[SlaveCell]:
    made = SlaveCell()
    yield made
    made.close()


def along(axis: int, value: float) -> tuple[float, ...]:
    return (*ZERO[:axis], value, *ZERO[axis + 1 :])


# --- what is compared -------------------------------------------------------------------------------------------------

# setting: fractions of the model's velocity and acceleration at external speed 40 %, acceleration 30 %
PARTS = {0: (SERVO_LIMIT, SERVO_LIMIT), 1: (SERVO_LIMIT * 0.4, SERVO_LIMIT * 0.3), 2: (1.0, 1.0), 3: (0.4, 0.3)}


def limits(setting: int) -> SlaveLimits:
    speeds = Speeds()
    made = SlaveLimits(VS050, Switches(slave_limit=SlaveLimit(setting)), speeds)
    speeds.set_external(40.0, 30.0, 20.0)  # set afterwards: they apply at any time
    return made


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("setting", PARTS)
def test_the_velocity_of_each_axis(setting, axis, sign):
    most = VS050.axes[axis].velocity * PARTS[setting][0] * PERIOD * sign
    for part, code in ((1 - 1e-7, None), (1 + 5e-7, None), (1 + 2e-6, 0x84204051 + axis), (5, 0x84204051 + axis)):
        place = most * part
        fault = limits(setting).violation(along(axis, -place), ZERO, along(axis, place), lenient=False)
        assert (fault and fault.code) == code


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("setting", PARTS)
def test_the_acceleration_of_each_axis(setting, axis, sign):
    most = VS050.axes[axis].slave_acceleration * PARTS[setting][1] * PERIOD**2 * sign
    for part, code in ((1 - 1e-7, None), (1 + 5e-7, None), (1 + 2e-6, 0x84204041 + axis)):
        fault = limits(setting).violation(ZERO, ZERO, along(axis, most * part), lenient=False)
        assert (fault and fault.code) == code
        slowing = limits(setting).violation(along(axis, -most * part), ZERO, ZERO, lenient=False)
        assert (slowing and slowing.code) == code


def test_velocity_comes_first_and_the_lowest_axis():
    check = limits(2)
    far = (0.0, 9.0, 0.0, 9.0, 0.0, 0.0)
    assert check.violation(ZERO, ZERO, far, lenient=False).code == hresult.SENT_SPEED_OVER_AXIS1 + 1
    some = (0.0, 0.0, 0.5, 0.0, 9.0, 0.5)  # axes 3 and 6 only accelerate
    assert check.violation(ZERO, ZERO, some, lenient=False).code == hresult.SENT_SPEED_OVER_AXIS1 + 4
    some = (0.0, 0.0, 0.5, 0.0, 0.0, 0.5)
    assert check.violation(ZERO, ZERO, some, lenient=False).code == hresult.COMMAND_ACCELERATION_OVER_AXIS1 + 2


def test_a_late_server_is_lenient():
    axis = VS050.axes[0]
    place = axis.velocity * LENIENCY * PERIOD
    assert limits(2).violation(along(0, -place), ZERO, along(0, place), lenient=True) is None
    assert limits(2).violation(along(0, -place), ZERO, along(0, place * 1.001), lenient=True).code == 0x84204051
    bend = axis.slave_acceleration * LENIENCY * PERIOD**2
    assert limits(2).violation(ZERO, ZERO, along(0, bend), lenient=True) is None
    assert limits(2).violation(ZERO, ZERO, along(0, bend * 1.001), lenient=True).code == 0x84204041


@pytest.mark.parametrize("bad", [float("nan"), 1e308, -1e308])
def test_unusable_numbers_raise_no_exception(bad):
    """slvMove and the soft limits refuse these values before; nevertheless they must not raise here."""
    fault = limits(0).violation(ZERO, ZERO, along(3, bad), lenient=False)
    assert fault is None or fault.code == hresult.SENT_SPEED_OVER_AXIS1 + 3


# --- in the cycle -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [J0, J1, J2])
@pytest.mark.parametrize("axis", range(6))
def test_a_command_that_is_too_fast_is_not_carried_out(cell, mode, axis):
    most = VS050.axes[axis].velocity * SERVO_LIMIT * PERIOD
    ramp = VS050.axes[axis].acceleration * SERVO_LIMIT * PERIOD**2 * 0.99
    cell.stand(*(-60.0 if n == axis else q for n, q in enumerate(HOME)))
    cell.commands = [cell.arm.queue.joints]
    base = cell.commands[0]
    cell.on(mode)
    poses = list(straight(most * 0.999, 30, ramp, axis))
    poses = [
        tuple(q if n != axis else base[axis] + pose[axis] - HOME[axis] for n, q in enumerate(base)) for pose in poses
    ]
    cell.stream(poses)
    assert (cell.error, cell.arm.queue.joints) == (0, poses[-1])
    last = len(cell.commands) - 1
    cell.send(tuple(q + (most * 1.0005 if n == axis else 0) for n, q in enumerate(poses[-1])))
    cell.cycle()
    assert cell.error == hresult.SENT_SPEED_OVER_AXIS1 + axis
    assert cell.mode == 0
    cell.rest()
    cell.check_brake(last)
    assert not cell.arm.motor.on
    assert abs(cell.commands[last + 1][axis] - poses[-1][axis]) < most


@pytest.mark.parametrize("mode", [J0, J1, J2])
def test_a_command_that_is_too_abrupt_is_not_carried_out(cell, mode):
    cell.on(mode)
    poses = list(straight(1.0, 25))
    cell.stream(poses)
    last = len(cell.commands) - 1
    cell.send(poses[-1])  # stop within one cycle
    cell.cycle()
    assert cell.error == hresult.COMMAND_ACCELERATION_OVER_AXIS1
    assert cell.commands[-1] != poses[-1]
    cell.rest()
    cell.check_brake(last)


def test_an_error_while_standing_moves_nothing(cell):
    cell.on(J0)
    cell.send((5.0, *HOME[1:]))
    cell.send((5.0, *HOME[1:]))
    cell.cycle(5)
    assert cell.error == hresult.SENT_SPEED_OVER_AXIS1
    assert set(cell.commands) == {HOME}
    assert (cell.mode, cell.arm.motor.on, cell.arm.busy) == (0, False, False)


def test_the_error_contains_value_and_limit(cell):
    cell.on(J0)
    cell.send((5.0, *HOME[1:]))
    cell.cycle()
    assert "625 deg/s exceeds the limit of 531.25" in cell.rc8.state.faults.message
    assert len(cell.rc8.state.faults.current) == 1


def test_restart_after_an_error_as_documented(cell):
    """ClearError, motor on, slave mode on (RC8 4.7)."""
    cell.on(J0)
    cell.send((5.0, *HOME[1:]))
    cell.cycle(3)
    assert cell.code_of(lambda: cell.on()) == hresult.ERROR_PRESENT
    cell.controller.execute("ClearError", variant(None))
    assert cell.code_of(lambda: cell.on()) == hresult.MOTOR_NOT_ON
    cell.execute("Motor", [1, 0])
    cell.on(J0)
    cell.stream([HOME] * 3)
    assert (cell.error, cell.mode) == (0, J0)


@pytest.mark.parametrize(("setting", "accepted"), [(0, True), (1, False), (2, True), (3, False)])
def test_external_speed_counts_if_the_setting_includes_it(setting, accepted):
    cell = SlaveCell(slave_limit=setting)
    cell.execute("ExtSpeed", [10.0])
    cell.on(J0)
    cell.stream([(0.001, *HOME[1:]), (0.03, *HOME[1:])])  # 440 deg/s^2; 1 % of 2125 is 21
    assert (cell.error == 0) is accepted
    cell.close()


# --- the setting ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [4, -1, 1.5, "servo", None, [0]])
def test_invalid_settings(number):
    with pytest.raises(ValueError, match="selects the limits in slave mode"):
        VirtualRC8(slave_limit=number)


def test_the_pendant_has_the_setting(cell):
    for number in (3, 0, 1, 2):
        cell.rc8.pendant.slave_limit(number)
        assert cell.rc8.pendant.status()["slave_limit"] == number == cell.rc8.state.switches.slave_limit
    with pytest.raises(ValueError, match="selects the limits in slave mode"):
        cell.rc8.pendant.slave_limit(4)
    assert cell.rc8.pendant.status()["slave_mode"] == 0
    cell.on(J2)
    assert cell.rc8.pendant.status()["slave_mode"] == J2


def test_the_setting_counts_at_once(cell):
    """Also in slave mode."""
    cell.on(J0)
    most = VS050.axes[0].slave_acceleration * PERIOD**2
    cell.stream([(most * 1.1, *HOME[1:])])
    assert cell.error == 0
    cell.rc8.pendant.slave_limit(2)
    cell.stream([(most * 3.3, *HOME[1:])])
    assert cell.error == hresult.COMMAND_ACCELERATION_OVER_AXIS1


def test_the_control_port_has_the_setting(cell):
    provider = ControlProvider(cell.rc8)
    panel = provider.connect("", "", f"Secret={provider.secret}", ClientInfo("127.0.0.1", "tcp"))
    for given in (2, "2", [2]):
        cell.rc8.pendant.slave_limit(0)
        panel.execute("SlaveLimit", variant(given))
        assert cell.rc8.state.switches.slave_limit is SlaveLimit.COMMAND
    for given in (7, 1.5, None):
        assert cell.code_of(lambda given=given: panel.execute("SlaveLimit", variant(given))) == hresult.E_INVALIDARG


@pytest.mark.parametrize(("word", "number"), [("0", 0), ("3", 3)])
def test_the_command_line_has_the_setting(word, number):
    action = ACTIONS["slave-limit"]
    assert (action.command, action.read(PendantArguments((word,), False, "slave-limit 0|1|2|3"))) == (
        "SlaveLimit",
        number,
    )


@pytest.mark.parametrize("words", [(), ("1", "2"), ("servo",), ("1.5",), ("nan",), ("inf",)])
def test_words_that_are_no_setting(words):
    with pytest.raises(CommandError, match="usage: slave-limit"):
        ACTIONS["slave-limit"].read(PendantArguments(words, False, "slave-limit 0|1|2|3"))


def test_serve_rc8_has_its_options():
    process = subprocess.Popen(
        [sys.executable, "-m", "orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0", "--motor-on", "--no-slave-licence",
         "--slave-limit", "3", "--control", "127.0.0.1:0"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        url, control, secret = (process.stdout.readline().split()[-1] for _ in range(3))
        with orinkit.connect(control, provider="CaoProv.orinkit.Pendant", option=f"Secret={secret}") as panel:
            assert '"slave_limit": 3' in panel.execute("Status")
        with orinkit.connect(url) as rc8:
            robot = rc8.robot("Arm")
            robot.execute("TakeArm", [0, 0])
            with pytest.raises(orinkit.CallError) as refused:
                robot.execute("slvChangeMode", 2)
        assert refused.value.code == hresult.LICENSE_NOT_REGISTERED
    finally:
        process.terminate()
        process.communicate()


# --- where the arm cannot be ------------------------------------------------------------------------------------------

SINGULAR = (0.0, 20.0, 90.0, 0.0, 0.0, 0.0)
PLACES = {
    "out of reach": (P0, (2000, 0, 300, 180, 0, 180, 5), hresult.OUT_OF_WORKING_RANGE),
    "out of reach, any figure": (P0, (2000, 0, 300, 180, 0, 180, -1), hresult.OUT_OF_WORKING_RANGE),
    "farther than any arm": (P0, (0, 0, 999_999, 180, 0, 180, -3), hresult.OUT_OF_WORKING_RANGE),
    "out of reach, T": (T0, (0, 2000, 300, 0, 1, 0, 0, 0, -1, 5), hresult.OUT_OF_WORKING_RANGE),
    "singular": (P0, (*VirtualRC8(joints=SINGULAR).state.arm.space.position(SINGULAR)[:6], -1), hresult.SINGULAR_POINT_STOP),
    "no such figure": (P0, (364, 0, 278, 180, 0, 180, 99), hresult.FIGURE_OUT_OF_RANGE),
    "figure not there": (P0, (364, 0, 278, 180, 0, 180, 5 | 32), hresult.FIGURE_INVALID),
    **{
        f"axis {axis + 1} {side}": (
            J0,
            tuple(limit + sign * 0.1 if n == axis else q for n, q in enumerate(HOME)),
            hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + axis,
        )
        for axis in range(6)
        for side, sign, limit in (("up", 1, VS050.axes[axis].upper), ("down", -1, VS050.axes[axis].lower))
    },
}  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
def test_a_pose_where_the_arm_cannot_be_ends_slave_mode(cell, place):
    mode, pose, code = PLACES[place]
    cell.on(mode)
    assert cell.code_of(lambda: cell.send(pose)) == code
    assert (cell.error, cell.mode) == (code, 0)
    assert len(cell.rc8.state.faults.current) == 1
    cell.cycle(5)
    assert set(cell.commands) == {HOME}
    assert cell.code_of(lambda: cell.send(pose)) == hresult.SLAVE_MODE_OFF


@pytest.mark.parametrize("mode", [J0, J1, J2])
def test_such_a_pose_brings_a_moving_arm_to_rest(cell, mode):
    cell.on(mode)
    cell.stream(list(straight(1.0, 30)))
    cell.send((cell.commands[-1][0] + 1.0, *HOME[1:]))  # in the buffer: dropped
    last = len(cell.commands) - 1
    assert cell.code_of(lambda: cell.send((171.0, *HOME[1:]))) == hresult.TARGET_OVER_SOFT_LIMIT_AXIS1
    cell.cycle()
    assert cell.commands[-1][0] < cell.commands[-2][0] + 1.0
    cell.rest()
    cell.check_brake(last)
    assert not cell.arm.motor.on


def test_a_low_error_ends_it_and_leaves_the_motor_on(cell):
    """FIGURE_INVALID has level 1."""
    cell.on(P0)
    assert cell.code_of(lambda: cell.send(PLACES["figure not there"][1])) == hresult.FIGURE_INVALID
    assert (cell.mode, cell.arm.motor.on) == (0, True)


def test_a_brake_may_run_over_a_soft_limit(cell):
    """Stopping before it would require more acceleration than the axis has."""
    cell.stand(150, 45, 90, 0, 45, 0)
    cell.commands = [cell.arm.queue.joints]
    cell.on(J0)
    poses = [(150 + pose[0], *HOME[1:]) for pose in straight(2.5, 40)]
    cell.stream([pose for pose in poses if pose[0] <= 170.0])
    last = len(cell.commands) - 1
    cell.rest()
    assert cell.error == hresult.COMMAND_DELAY
    cell.check_brake(last)
    assert cell.arm.queue.joints[0] > 170.0


def test_extra_axes_that_there_are_not_are_only_refused(cell):
    cell.on(P0)
    start = cell.arm.space.position(HOME)
    assert cell.code_of(lambda: cell.send([*start, 0x400040, 1.0])) == hresult.E_INVALIDARG
    assert (cell.error, cell.mode) == (0, P0)
