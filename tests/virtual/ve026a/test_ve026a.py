"""The virtual VE026A: variables, commands, motor, errors, the emergency stop, rights of clients."""

from __future__ import annotations

import dataclasses
import re

import pytest

from orinkit.arms import load_model
from orinkit.cao.dialect import VE026A
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, UserDefinedError
from orinkit.core.hresult import CodeFamily
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.ve026a import VirtualVE026A
from orinkit.virtual.ve026a.codes import (
    AXES,
    CODES,
    EMERGENCY_STOP,
    OUT_OF_RANGE_AXIS1,
    ROBOT_RUNNING,
    SET_POINT_MISSED,
    TOO_FAST_AXIS1,
    device_error,
)
from support.ve_cell import ASYNC, HOME, R4, SYNC, Person, VeCell, ramp, turned

JAPANESE = re.compile("[぀-ヿ一-鿿]")
SECOND = ClientInfo("10.0.0.9", "tcp", 4711)


@pytest.fixture
def cell():
    cell = VeCell()
    yield cell
    cell.arm.close()


@pytest.fixture
def off():
    cell = VeCell(motor=False)
    yield cell
    cell.arm.close()


# --- what it is ---------------------------------------------------------------------------------------------------------


def test_it_has_the_functions_of_table_3_3_and_its_dialect(cell):
    assert cell.arm.functions == {1, 2, 3, 4, 7, 9, 17, 62, 64, 84, 101, 111}
    assert all(number in FUNCTIONS for number in cell.arm.functions)
    assert cell.arm.dialect is VE026A
    assert cell.arm.fixed_handles


def test_handles_are_those_of_the_printed_samples(cell):
    handle = cell.arm.handle_of
    assert (handle("Controller", ""), handle("Controller", "x"), handle("Robot", "VE026A")) == (1, 1, 1)
    names = ("@CURRENT_ANGLE", "@Servo_On", " @TYPE", "@version")
    assert [handle("Variable", name) for name in names] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("name", "vt", "value"),
    [("@SERVO_ON", VarType.I2, 1), ("@servo_on", VarType.I2, 1), ("@TYPE", VarType.I4, 0)],
)
def test_variables_of_the_robot(cell, name, vt, value):
    assert cell.client.robot.get_variable(name, "").get_value() == Variant(vt, value)


def test_the_version_is_a_text_of_the_controller(cell):
    version = variant(cell.client.controller.get_variable("@Version", "").get_value())
    assert version.type == VarType.BSTR
    assert version.value.startswith("VE026A")


def test_current_angle_is_eight_r4_numbers(cell):
    value = cell.client.robot.get_variable("@CURRENT_ANGLE", "").get_value()
    assert value == Variant(R4, [*HOME, 0.0])


def test_angles_are_rounded_to_single_precision():
    cell = VeCell(joints=(0.1, 30.9, 120.7, 0.1, 29.8, 0.2, 24.7))
    value = cell.client.robot.get_variable("@CURRENT_ANGLE", "").get_value()
    assert value.value == [
        0.10000000149011612, 30.899999618530273, 120.69999694824219, 0.10000000149011612, 29.799999237060547,
        0.20000000298023224, 24.700000762939453, 0.0,
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["@VERSION", "@NOTHING", "", "CURRENT_ANGLE", "I1", "@" * 5000])
def test_an_unknown_variable_is_an_invalid_argument(cell, name):
    assert cell.code(lambda: cell.client.robot.get_variable(name, "")) == hresult.E_INVALIDARG
    if name != "@VERSION":
        assert cell.code(lambda: cell.client.controller.get_variable(name, "")) == hresult.E_INVALIDARG


def test_variables_of_the_robot_are_not_the_controllers(cell):
    for name in ("@CURRENT_ANGLE", "@SERVO_ON", "@TYPE"):
        assert cell.code(lambda name=name: cell.client.controller.get_variable(name, "")) == hresult.E_INVALIDARG


def test_the_tip_of_the_tool_is_where_the_published_model_has_it(cell):
    assert cell.arm.position == pytest.approx((95.0, 0.0, 50.6603, 180.0, 0.0, 180.0), abs=1e-4)


def test_joints_may_be_six_or_seven():
    assert VirtualVE026A(clock=ManualClock(), joints=(1, 2, 3, 4, 5, 6)).joints == (1, 2, 3, 4, 5, 6, 0)
    assert VirtualVE026A(clock=ManualClock(), joints=(1, 2, 3, 4, 5, 6, 7)).joints == (1, 2, 3, 4, 5, 6, 7)


@pytest.mark.parametrize(
    "joints", [(), (0, 0, 0), (0,) * 8, (106, 0, 0, 0, 0, 0), (float("nan"),) * 6, (0,) * 6 + (26,)]
)
def test_invalid_joints_are_refused(joints):
    with pytest.raises(ValueError, match="VE026A"):
        VirtualVE026A(clock=ManualClock(), joints=joints)


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf"), 1e9])
@pytest.mark.parametrize("name", ["motor_seconds", "clear_seconds"])
def test_seconds_are_a_number_from_0_on(name, seconds):
    with pytest.raises(ValueError, match="3600"):
        VirtualVE026A(clock=ManualClock(), **{name: seconds})


def test_a_model_has_seven_axes():
    with pytest.raises(ValueError, match="7"):
        VirtualVE026A(clock=ManualClock(), model=load_model("VS-050"))


# --- the codes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
def test_its_own_codes_are_in_the_range_for_them_and_have_texts(code):
    assert hresult.family(code.value) is CodeFamily.USER
    assert code.value not in hresult.CODES
    assert code.message.isascii()
    assert JAPANESE.search(i18n.translate("ja", code.message))
    error = device_error(code.value, "detail")
    assert isinstance(error, UserDefinedError)
    assert code.text in error.detail


def test_codes_and_names_are_given_once():
    assert len({code.name for code in CODES.values()}) == len(CODES) == 3 + 2 * AXES
    assert all(value == code.value for value, code in CODES.items())


# --- commands -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["slvMode", "", "TakeArm", "slvGetMode", "ClearError", "Motor1", "x" * 100_000])
def test_an_unknown_command_is_an_invalid_command(cell, command):
    assert cell.code(lambda: cell.client(command, 1)) == hresult.E_INVALIDCOMMAND


@pytest.mark.parametrize("command", ["", "Motor", "GetErrorDescription"])
def test_an_unknown_command_of_the_controller_too(cell, command):
    assert cell.code(lambda: cell.client.controller.execute(command, variant(0))) == hresult.E_INVALIDCOMMAND


@pytest.mark.parametrize("command", ["Motor", "MOTOR", "motor", " Motor "])
@pytest.mark.parametrize(
    "parameter", [Variant(VarType.I2, 1), 1, True, 1.0, "1", Variant(VarType.R4, 1), [1], Variant(VarType.UI1, 1)]
)
def test_motor_in_every_spelling_and_type(off, command, parameter):
    promise = off.client(command, parameter)
    assert off.run(promise) is None
    assert off.arm.servo_on


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        (2, hresult.E_INVALIDARG),
        (0.5, hresult.E_INVALIDARG),
        (float("nan"), hresult.E_INVALIDARG),
        (2**31, hresult.E_INVALIDARGTYPE),  # VT_UI8
        ("on", hresult.E_INVALIDARGTYPE),
        (None, hresult.E_INVALIDARGTYPE),
        ([1, 0], hresult.E_INVALIDARGTYPE),
    ],
)
def test_invalid_parameters_of_motor(off, parameter, code):
    if parameter == 2**31:
        parameter, code = Variant(VarType.UI4, 2**31), hresult.E_INVALIDARG
    assert off.code(lambda: off.client("Motor", parameter)) == code
    assert not off.arm.servo_on


@pytest.mark.parametrize(("first", "parameter"), [(False, 1), (True, 0)])
def test_motor_takes_three_seconds(first, parameter):
    cell = VeCell(motor=first)
    promise = cell.client("Motor", parameter)
    assert cell.cycles(promise) == 3 / PERIOD
    assert promise.result() is None
    assert cell.arm.servo_on is not first


def test_motor_returns_at_once_if_it_is_already_in_this_state(cell):
    assert cell.client("Motor", 1) is None
    assert cell.arm.servo_on


def test_the_seconds_can_be_set():
    cell = VeCell(motor=False, motor_seconds=0.1, clear_seconds=0.0)
    assert cell.cycles(cell.client("Motor", 1)) == 13
    assert cell.cycles(cell.client.controller.execute("ClearError", variant(0))) == 1


def test_servo_on_is_0_while_the_motor_is_switched_on_or_off(off):
    servo = off.client.robot.get_variable("@SERVO_ON", "")
    promise = off.client("Motor", 1)
    off.cycle(10)
    assert servo.get_value().value == 0
    off.run(promise)
    assert servo.get_value().value == 1
    promise = off.client("Motor", 0)
    off.cycle(2)
    assert (servo.get_value().value, promise.done()) == (0, False)


@pytest.mark.parametrize("other", ["Motor", "slvChangeMode", "slvMove", "ClearError"])
@pytest.mark.parametrize("work", ["Motor", "ClearError"])
def test_it_is_busy_while_the_motor_is_switched_or_an_error_cleared(cell, work, other):
    second = Person(cell.arm, SECOND)

    def do(who, command):
        if command == "ClearError":
            return who.controller.execute(command, variant(0))
        return who(command, Variant(R4, [*HOME]) if command == "slvMove" else 0)

    promise = do(cell.client, work)
    cell.cycle(3)
    assert cell.code(lambda: do(second, other)) == hresult.E_ROBOTISBUSY
    cell.run(promise)


@pytest.mark.parametrize(
    "parameter",
    [
        0,
        Variant(VarType.I2, 0),
        Variant(VarType.I4, -0x7FFB9FF5),
        Variant(VarType.UI4, 0x8004600B),
        None,
        "",
        "0",
        [0],
        0.0,
    ],
)
def test_clear_error_takes_a_second_and_any_code(cell, parameter):
    cell.on(SYNC).send(HOME)
    cell.cycle(3)
    assert cell.arm.error == SET_POINT_MISSED
    promise = cell.client.controller.execute("clearERROR", variant(parameter))
    assert cell.cycles(promise) == 125
    assert promise.result() is None
    assert cell.arm.error == hresult.S_OK
    assert cell.arm.error_text == ""


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        ("x", hresult.E_INVALIDARGTYPE),
        (0.5, hresult.E_INVALIDARG),
        (1e300, hresult.E_INVALIDARG),
        ([1, 2], hresult.E_INVALIDARGTYPE),
    ],
)
def test_clear_error_requires_a_code(cell, parameter, code):
    assert cell.code(lambda: cell.client.controller.execute("ClearError", variant(parameter))) == code


def test_clear_error_without_an_error_is_no_error(cell):
    assert cell.clear() == 0


def test_clear_error_is_refused_in_slave_mode(cell):
    cell.on()
    assert cell.clear() == hresult.E_ROBOTISBUSY


# --- slvChangeMode ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "mode"),
    [
        (Variant(VarType.I2, 0x002), SYNC),
        (Variant(VarType.I4, 0x102), ASYNC),
        (Variant(VarType.I2, 0x102), ASYNC),
        (2.0, SYNC),
        ("2", SYNC),
        ("258", ASYNC),
        ("0x102", ASYNC),
        (" 0X102 ", ASYNC),
        ("&H2", SYNC),
        ([258], ASYNC),
        (["0x102"], ASYNC),
        (0, 0),
        ("0x0", 0),
    ],
)
def test_modes(cell, parameter, mode):
    assert cell.client("slvChangeMode", parameter) is None
    assert cell.arm.slave_mode == mode


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        (1, hresult.E_INVALIDARG),
        (3, hresult.E_INVALIDARG),
        (0x202, hresult.E_INVALIDARG),
        (0x101, hresult.E_INVALIDARG),
        (-1, hresult.E_INVALIDARG),
        ("0x3", hresult.E_INVALIDARG),
        (2.5, hresult.E_INVALIDARG),
        ("0x" + "1" * 5000, hresult.E_INVALIDARGTYPE),
        ("sync", hresult.E_INVALIDARGTYPE),
        ("", hresult.E_INVALIDARGTYPE),
        (None, hresult.E_INVALIDARGTYPE),
        ([2, 2], hresult.E_INVALIDARGTYPE),
    ],
)
def test_invalid_modes(cell, parameter, code):
    assert cell.code(lambda: cell.client("slvChangeMode", parameter)) == code
    assert cell.arm.slave_mode == 0


def test_slave_mode_needs_the_motor(off):
    assert off.code(lambda: off.client("slvChangeMode", ASYNC)) == hresult.E_FAIL
    assert off.client("slvChangeMode", 0) is None
    assert off.arm.error == 0


def test_a_move_needs_slave_mode(cell):
    assert cell.code(lambda: cell.send(HOME)) == hresult.E_FAIL
    assert cell.arm.error == 0


def test_the_mode_is_left_when_the_arm_stands(cell):
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", 0)
    assert isinstance(promise, Deferred)
    cycles = cell.cycles(promise)
    assert 5 < cycles * PERIOD * 1000 / 8 < 40
    assert cell.arm.slave_mode == 0
    stood = cell.arm.joints
    cell.cycle(10)
    assert cell.arm.joints == stood


@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_the_mode_is_left_after_its_last_set_point(cell, mode):
    cell.on(mode)
    answers = [cell.send(turned(0.5)), cell.send(turned(1.0))]
    assert cell.execute("slvChangeMode", 0) is None
    assert cell.run(answers[1])[0] in (0.0, 0.5)
    assert cell.arm.joints[0] >= 1.0
    assert (cell.arm.error, cell.arm.slave_mode) == (0, 0)


def test_a_set_point_that_was_dropped_does_not_come_back(cell):
    cell.on()
    cell.send(turned(0.5))
    assert cell.execute("Motor", 0) is None
    assert cell.execute("Motor", 1) is None
    cell.on()
    cell.cycle(20)
    assert cell.arm.joints == HOME


def test_the_mode_can_be_changed_for_the_other(cell):
    cell.on(ASYNC)
    cell.stream(ramp(0.8, 20))
    assert cell.execute("slvChangeMode", SYNC) is None
    assert cell.arm.slave_mode == SYNC
    cell.cycle(50)  # the detector waits for the first slvMove
    assert cell.arm.error == 0


def slow(acceleration):
    model = load_model("VE026A")
    axes = tuple(dataclasses.replace(axis, acceleration=acceleration) for axis in model.axes)
    return VeCell(model=dataclasses.replace(model, axes=axes))


@pytest.mark.parametrize("mode", [0, SYNC, ASYNC])
def test_an_arm_that_does_not_stand_in_time_is_running_600b(mode):
    cell = slow(100.0)
    cell.on()
    cell.stream(ramp(0.8, 20))  # 100 deg/s: a second to standstill
    promise = cell.client("slvChangeMode", mode)
    assert cell.cycles(promise) == 63  # the first cycle after 500 ms
    with pytest.raises(CallError) as caught:
        promise.result()
    assert caught.value.code == ROBOT_RUNNING == 0x8004600B
    assert "600B" in str(caught.value)
    assert (cell.arm.error, cell.arm.slave_mode) == (0, 0)
    cell.rest()
    cell.on(ASYNC)


def test_500_ms_are_just_enough():
    cell = slow(225.0)
    cell.on()
    cell.stream(ramp(0.8, 20))
    assert 55 < cell.cycles(promise := cell.client("slvChangeMode", SYNC)) <= 62
    assert promise.result() is None


def test_everything_waits_for_a_change(cell):
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", ASYNC)
    refused = [
        cell.code(lambda: cell.send(HOME)),
        cell.code(lambda: cell.client("Motor", 0)),
        cell.code(lambda: cell.client("slvChangeMode", 0)),
        cell.clear(),
    ]
    assert refused == [hresult.E_ROBOTISBUSY] * 4
    cell.run(promise)


def test_an_emergency_stop_ends_a_change(cell):
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", ASYNC)
    cell.arm.emergency_stop()
    assert cell.code(lambda: promise) == EMERGENCY_STOP


# --- poses ------------------------------------------------------------------------------------------------------------------

SEVEN = [0.5, 30.0, 120.0, 0.0, 30.0, 0.0, 0.25]
TEXT = "0.5,30,120,0,30,0,0.25"


@pytest.mark.parametrize(
    "parameter",
    [
        Variant(R4, SEVEN),
        Variant(R4, [*SEVEN, 0.0]),
        SEVEN,
        [*SEVEN, 0.0],
        Variant(VARIANT_ARRAY, [Variant(VarType.R4, value) for value in SEVEN]),
        Variant(VARIANT_ARRAY, [Variant(VarType.BSTR, f"{value}") for value in [*SEVEN, 0.0]]),
        Variant(VARIANT_ARRAY, [Variant(VarType.R8, 0.5), *[Variant(VarType.I4, n) for n in (30, 120, 0, 30, 0)], Variant(VarType.R4, 0.25)]),
        TEXT,
        f"{TEXT},0",
        TEXT.replace(",", ", "),
        [*SEVEN, 123.0],  # the eighth is ignored
    ],
)  # fmt: skip
@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_poses_in_every_form(cell, parameter, mode):
    cell.on(mode)
    answer = cell.run(cell.client("slvMove", parameter))
    assert answer == [*HOME, 0.0]  # where it was at that moment
    for _ in range(4):  # the encoders lag
        cell.client("slvMove", parameter)
        cell.cycle()
    assert cell.arm.joints == tuple(SEVEN)


def test_whole_numbers_are_a_pose_too(cell):
    cell.on()
    cell.client("slvMove", [1, 30, 120, 0, 30, 0, 0])
    cell.rest()
    assert cell.arm.joints[0] == 1.0


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        ([], hresult.E_INVALIDARG),
        (None, hresult.E_INVALIDARGTYPE),
        (5, hresult.E_INVALIDARGTYPE),
        ([1.0] * 6, hresult.E_INVALIDARG),
        ([1.0] * 9, hresult.E_INVALIDARG),
        (Variant(R4, []), hresult.E_INVALIDARG),
        ([1.0] * 50_000, hresult.E_INVALIDARG),
        ("", hresult.E_INVALIDARG),
        ("1,2,3", hresult.E_INVALIDARG),
        ("0," * 6 + "0" * 10_000_000, hresult.E_INVALIDARG),
        ("0,0,0,x,0,0,0", hresult.E_INVALIDARGTYPE),
        ("0,0,0,,0,0,0", hresult.E_INVALIDARGTYPE),
        ([float("nan"), *SEVEN[1:]], hresult.E_INVALIDARG),
        ([*SEVEN, float("inf")], hresult.E_INVALIDARG),
        (Variant(R4, [float("-inf"), *SEVEN[1:]]), hresult.E_INVALIDARG),
        ("nan,0,0,0,0,0,0", hresult.E_INVALIDARG),
        (Variant(VARIANT_ARRAY, [variant([1.0, 2.0])] * 7), hresult.E_INVALIDARGTYPE),
    ],
)  # fmt: skip
def test_invalid_poses_are_refused_without_an_error_of_the_arm(cell, parameter, code):
    cell.on()
    assert cell.code(lambda: cell.client("slvMove", parameter)) == code
    assert (cell.arm.error, cell.arm.slave_mode) == (0, ASYNC)


# --- who ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "parameter"),
    [("Motor", 1), ("slvChangeMode", SYNC), ("slvChangeMode", ASYNC), ("slvMove", SEVEN)],
)
def test_a_second_client_cannot_move_it(cell, command, parameter):
    second = Person(cell.arm, SECOND)
    cell.on()
    assert cell.code(lambda: second(command, parameter)) == hresult.E_ACCESSDENIED
    assert cell.code(lambda: second.controller.execute("ClearError", variant(0))) == hresult.E_ACCESSDENIED
    assert cell.arm.slave_mode == ASYNC
    assert second.robot.get_variable("@SERVO_ON", "").get_value().value == 1


STOPS = [("Motor", 0), ("slvChangeMode", 0)]


@pytest.mark.parametrize(("command", "parameter"), STOPS)
@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_a_second_client_can_stop_it(cell, mode, command, parameter):
    second = Person(cell.arm, SECOND)
    cell.on(mode)
    cell.stream(ramp(0.8, 20))
    answer = [cell.send(turned(16.8)), cell.send(turned(17.6))][1]
    done = second(command, parameter)
    assert cell.arm.slave_mode == 0
    if mode == SYNC:
        assert cell.code(lambda: answer) == hresult.E_ABORT
    refused = cell.code(lambda: cell.send(turned(17.6)))
    assert refused in (hresult.E_ACCESSDENIED, hresult.E_ROBOTISBUSY)  # until standstill
    assert cell.run(done) is None
    assert 16.0 < cell.arm.joints[0] < 30.0
    assert (cell.arm.error, cell.arm.servo_on) == (0, command != "Motor")
    assert cell.code(lambda: cell.send(turned(17.6))) == hresult.E_FAIL


@pytest.mark.parametrize(("command", "parameter"), STOPS)
def test_a_second_client_can_stop_one_that_changes_the_mode(cell, command, parameter):
    second = Person(cell.arm, SECOND)
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", SYNC)
    done = second(command, parameter)
    assert cell.code(lambda: promise) == hresult.E_ABORT
    assert cell.run(done) is None
    assert (cell.arm.error, cell.arm.slave_mode) == (0, 0)


@pytest.mark.parametrize(("command", "parameter"), STOPS)
def test_a_stop_in_progress_is_not_repeated(cell, command, parameter):
    second = Person(cell.arm, SECOND)
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", 0)
    assert cell.code(lambda: second(command, parameter)) == hresult.E_ROBOTISBUSY
    assert cell.run(promise) is None
    assert cell.run(second(command, parameter)) is None


def test_a_second_client_cannot_come_between_a_change(cell):
    second = Person(cell.arm, SECOND)
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", ASYNC)
    assert cell.code(lambda: second("slvChangeMode", ASYNC)) == hresult.E_ACCESSDENIED
    cell.run(promise)


def test_a_second_client_may_when_the_first_has_left_slave_mode(cell):
    second = Person(cell.arm, SECOND)
    cell.on()
    cell.execute("slvChangeMode", 0)
    assert second("slvChangeMode", ASYNC) is None
    assert cell.code(lambda: cell.send(HOME)) == hresult.E_ACCESSDENIED


@pytest.mark.parametrize("what", ["robot", "controller"])
@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_a_disconnected_client_is_stopped(cell, what, mode):
    cell.on(mode)
    cell.stream(ramp(0.8, 20))
    answer = [cell.send(turned(16.8)), cell.send(turned(17.6))][1]
    getattr(cell.client, what).release()
    assert cell.arm.slave_mode == 0
    if mode == SYNC:
        assert cell.code(lambda: answer) == hresult.E_ABORT
    cell.rest()
    assert 16.0 < cell.arm.joints[0] < 30.0
    assert (cell.arm.error, cell.arm.servo_on) == (0, True)
    assert Person(cell.arm, SECOND)("slvChangeMode", ASYNC) is None


def test_another_client_that_disconnects_has_no_effect(cell):
    second = Person(cell.arm, SECOND)
    cell.on()
    cell.stream(ramp(0.8, 20))
    second.leave()
    cell.stream(ramp(0.8, 25)[20:])
    assert cell.arm.slave_mode == ASYNC


def test_one_robot_object_of_two_is_enough(cell):
    cell.on()
    cell.client.controller.get_robot("again", "").release()  # like a session for an object that it already has
    assert cell.arm.slave_mode == ASYNC


def test_a_disconnected_client_does_not_enter_slave_mode(cell):
    cell.on()
    cell.stream(ramp(0.8, 20))
    promise = cell.client("slvChangeMode", ASYNC)
    cell.client.leave()
    assert cell.code(lambda: promise) == hresult.E_ABORT
    cell.rest()
    assert cell.arm.slave_mode == 0


# --- motor off, errors, emergency stop ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_motor_off_brakes_first(cell, mode):
    cell.on(mode)
    cell.stream(ramp(0.8, 20))
    promise = cell.client("Motor", 0)
    assert cell.arm.slave_mode == 0
    assert cell.arm.servo_on
    assert cell.cycles(promise) > 3 / PERIOD + 10
    assert not cell.arm.servo_on
    assert cell.arm.error == 0
    assert cell.arm.joints[0] > 17.0


def test_an_error_refuses_all_that_moves_until_it_is_cleared(cell):
    cell.on()
    assert cell.code(lambda: cell.send(turned(105.5))) == OUT_OF_RANGE_AXIS1
    assert cell.arm.error == OUT_OF_RANGE_AXIS1
    assert cell.arm.slave_mode == 0
    assert cell.arm.servo_on
    moving = [("Motor", 1), ("slvChangeMode", SYNC), ("slvChangeMode", ASYNC), ("slvMove", SEVEN)]
    assert {cell.code(lambda each=each: cell.client(*each)) for each in moving} == {OUT_OF_RANGE_AXIS1}
    assert cell.client("slvChangeMode", 0) is None
    assert cell.clear() == 0
    assert cell.code(lambda: cell.send(HOME)) == hresult.E_FAIL  # slave mode has to be entered again (4.3)
    cell.on().send(HOME)


def test_the_motor_can_be_switched_off_in_an_error(cell):
    cell.on(SYNC).send(HOME)
    cell.cycle(2)
    assert cell.execute("Motor", 0) is None
    assert not cell.arm.servo_on
    assert cell.arm.error == SET_POINT_MISSED
    assert cell.code(lambda: cell.client("Motor", 1)) == SET_POINT_MISSED


def test_the_first_error_counts(cell):
    cell.on(SYNC).send(HOME)
    cell.cycle(2)
    cell.arm.emergency_stop()
    assert cell.arm.error == SET_POINT_MISSED
    assert not cell.arm.servo_on
    assert cell.clear() == EMERGENCY_STOP
    assert cell.arm.error == EMERGENCY_STOP
    cell.arm.release_emergency_stop()
    assert cell.clear() == 0


@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_an_emergency_stop_brakes_and_switches_the_motor_off(cell, mode):
    cell.on(mode)
    cell.stream(ramp(0.8, 20))
    answer = [cell.send(turned(16.8)), cell.send(turned(17.6))][1]
    cell.arm.emergency_stop()
    if mode == SYNC:
        assert cell.code(lambda: answer) == EMERGENCY_STOP
    assert (cell.arm.error, cell.arm.slave_mode, cell.arm.servo_on) == (EMERGENCY_STOP, 0, True)
    cell.arm.release_emergency_stop()  # too late
    cell.rest()
    assert not cell.arm.servo_on
    assert cell.code(lambda: cell.client("Motor", 1)) == EMERGENCY_STOP
    assert cell.clear() == 0
    assert cell.execute("Motor", 1) is None


def test_an_emergency_stop_breaks_off_switching_on(off):
    promise = off.client("Motor", 1)
    off.cycle(5)
    off.arm.emergency_stop()
    assert off.code(lambda: promise) == EMERGENCY_STOP
    off.cycle(500)
    assert not off.arm.servo_on


def test_an_emergency_stop_lets_switching_off_go_on(cell):
    promise = cell.client("Motor", 0)
    cell.arm.emergency_stop()
    assert cell.run(promise) is None


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_the_error_has_a_text(cell, lang):
    before = i18n.current()
    i18n.use(lang)
    try:
        cell.arm.emergency_stop()
        assert cell.arm.error_text == {"en": "emergency stop", "ja": "非常停止"}[lang]
    finally:
        i18n.use(before)


def test_an_exception_in_a_cycle_is_an_error_and_the_arm_stands(cell, monkeypatch):
    cell.on()
    monkeypatch.setattr("orinkit.virtual.ve026a.slave.VE026ASlaveMode.step", lambda _: 1 / 0)
    cell.send(turned(0.5))
    cell.cycle()
    assert cell.arm.error == hresult.E_UNEXPECTED
    assert cell.arm.error_text == hresult.lookup(hresult.E_UNEXPECTED).text
    cell.cycle(20)
    assert cell.arm.joints == HOME


def test_close_fails_pending_calls(cell):
    promises = [cell.client("Motor", 0)]
    cell.arm.close()
    cell.arm.close()
    other = VeCell()
    other.on(SYNC).send(HOME)
    promises.append(other.send(HOME))
    other.arm.close()
    assert [cell.code(lambda each=each: each) for each in promises] == [hresult.E_ABORT] * 2
    assert not cell.arm.servo_on
    for command, parameter in (("Motor", 1), ("slvChangeMode", ASYNC), ("slvMove", SEVEN)):
        assert (
            cell.code(lambda command=command, parameter=parameter: cell.client(command, parameter)) == hresult.E_ABORT
        )


def test_too_fast_is_another_code_for_each_axis():
    assert {TOO_FAST_AXIS1 + n for n in range(AXES)} | {OUT_OF_RANGE_AXIS1 + n for n in range(AXES)} <= set(CODES)
