"""Slave mode of the virtual RC8: modes and buffers, access, sent and received fields."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest

from orinkit.arms import AxisModel, load_model
from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.core import hresult
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.engine.motion.queue import QueueState
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.variables.table import VariableTable
from support.cell import ADDRESS
from support.slave_cell import HOME, J0, J1, J2, P0, P1, T0, T2, SlaveCell, code, sine, value

NEAR = (0.05, *HOME[1:])
SINE = sine()


@pytest.fixture
def cell() -> Iterator[SlaveCell]:
    made = SlaveCell()
    yield made
    made.close()


def step(number: int) -> tuple[float, ...]:
    """Return a set-point slightly farther than the previous one, with small accelerations."""
    return (0.001 * number, *HOME[1:])


# --- on and off -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0x001, 0x002, 0x003, 0x101, 0x102, 0x103, 0x201, 0x202, 0x203])
def test_every_mode_is_turned_on_and_off(cell, number):
    assert cell.mode == 0
    cell.on(number)
    assert cell.mode == number
    assert cell.robot.execute("slvGetMode", variant(None)) == number
    assert cell.execute("slvChangeMode", 0) is None
    assert cell.mode == 0
    assert cell.execute("slvChangeMode", 0) is None  # already off


@pytest.mark.parametrize("parameter", ["514", " 2 ", [1], 1.0, Variant(VarType.I2, 258), Variant(VarType.UI4, 3)])
def test_a_mode_is_any_number(cell, parameter):
    cell.on(parameter)
    assert cell.mode in (514, 2, 1, 258, 3)


@pytest.mark.parametrize("number", [4, 0x100, 0x104, 0x200, 0x302, -1, 0x10002, 2**31 - 1, 1.5, [1, 2]])
def test_other_numbers_are_no_mode(cell, number):
    assert cell.code_of(lambda: cell.execute("slvChangeMode", number)) == hresult.E_INVALIDARG
    assert cell.mode == 0


@pytest.mark.parametrize("parameter", ["", None, "J", [], ["J"], b"\x01\x02"])
def test_a_mode_must_be_a_number(cell, parameter):
    assert cell.code_of(lambda: cell.execute("slvChangeMode", parameter)) in (
        hresult.E_INVALIDARG,
        hresult.DISP_E_TYPEMISMATCH,
    )


def test_slave_mode_requires_the_licence():
    cell = SlaveCell(slave_licence=False)
    assert cell.code_of(lambda: cell.on()) == hresult.LICENSE_NOT_REGISTERED
    assert cell.mode == 0
    cell.close()


def test_the_arm_must_stand(cell):
    """A motion whose call has returned is complete; a running one is not."""
    running = cell.move(pose="@0 J(10, 45, 90, 0, 45, 0)")
    cell.cycle(5)
    assert cell.code_of(lambda: cell.on()) == hresult.ROBOT_MOVING
    cell.run(running)
    assert cell.code_of(lambda: cell.on()) == 0
    assert cell.error == 0


def test_the_arm_that_is_locked_comes_to_stand_too():
    """Its encoders do not keep the cycle running."""
    cell = SlaveCell(motor=False)
    cell.rc8.pendant.machine_lock()
    cell.execute("Motor", [1, 0])
    cell.run(cell.move(pose="@0 J(10, 45, 90, 0, 45, 0)"))
    cell.cycle()
    cell.on()
    cell.stream([(10.0, *HOME[1:])] * 3)
    assert (cell.error, cell.arm.servo.encoder) == (0, HOME)
    cell.close()


def test_turning_it_on_twice_is_refused(cell):
    cell.on(J0)
    for mode in (J0, J1, P0):
        assert cell.code_of(lambda mode=mode: cell.execute("slvChangeMode", mode)) == hresult.REFUSED_IN_SLAVE_MODE
    assert cell.mode == J0


def test_no_slave_mode_after_the_controller_is_switched_off(cell):
    cell.rc8.close()
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(J0))) != 0


# --- who may do what --------------------------------------------------------------------------------------------------

FORBIDDEN = {
    "StartLog": None, "ClearLog": None, "ClrPathPoint": 1, "Depart": [2, "@0 10"], "SetToolDef": [1, "P(0, 0, 1, 0, 0, 0)"],
    "slvSendFormat": 0, "slvRecvFormat": 1, "TakeArm": [0, 0], "Motor": [0, 0],
}  # fmt: skip


@pytest.mark.parametrize("command", FORBIDDEN)
def test_its_client_may_not_command_the_robot(cell, command):
    looking = cell.controller.get_robot("Other", "")
    cell.on()
    for robot in (cell.robot, looking):
        refused = cell.code_of(lambda robot=robot: robot.execute(command.upper(), variant(FORBIDDEN[command])))
        assert refused == hresult.REFUSED_IN_SLAVE_MODE
    assert cell.mode == J0


@pytest.mark.parametrize(
    "command", ["ClearError", "GetCurErrorCount", "SysState", "ManualReset", "HandCurPos", "SysInfo"]
)
def test_its_client_may_use_commands_of_the_controller(cell, command):
    cell.on()
    assert cell.code_of(lambda: cell.controller.execute(command, variant(0))) == 0
    assert cell.mode == J0


def test_a_command_object_is_refused_like_the_command(cell):
    command = cell.controller.get_command("Robot.StartLog", "")
    cell.on()
    command.execute(0)
    assert cell.code_of(command.get_result) == hresult.REFUSED_IN_SLAVE_MODE


def test_its_client_may_read_servo_data_and_variables(cell):
    cell.on()
    assert len(cell.execute("GetSrvData", 4)) == 8
    assert cell.controller.get_variable("@MODE", "").get_value().plain == 3
    assert cell.robot.get_variable("@CURRENT_ANGLE", "").get_value().plain == [*HOME, 0.0, 0.0]
    assert cell.controller.get_variable("I1", "").get_value().plain == 0


def test_its_client_sets_nothing_of_the_robot_with_variables(cell):
    cell.on()
    for name, given in (("@SERVO_ON", False), ("@EXTSPEED", 50.0), ("@CURRENT_TOOL", 1)):
        put = cell.robot.get_variable(name, "").put_value
        assert cell.code_of(lambda put=put, given=given: put(variant(given))) == hresult.REFUSED_IN_SLAVE_MODE
    assert cell.mode == J0


def test_an_unknown_command_is_unknown_in_slave_mode_too(cell):
    cell.on()
    assert cell.code_of(lambda: cell.execute("slvMode", 0)) == hresult.E_INVALID_CMD_NAME
    assert cell.code_of(lambda: cell.execute("ServoLock")) == hresult.E_NOTIMPL


def test_another_client_reads_everything(cell):
    other = cell.connect()
    robot = other.get_robot("", "")
    cell.on(J0)
    cell.stream(SINE[:20])
    assert robot.execute("CurJnt", variant(None)).plain[0] > 0
    assert robot.execute("slvGetMode", variant(None)) == J0
    assert robot.get_variable("@BUSY_STATUS", "").get_value().plain is True
    bits = other.execute("SysState", variant(None))
    assert bits >> 20 & 1
    assert bits >> 21 & 1
    assert not bits >> 24 & 1
    assert robot.execute("DestJnt", variant(None)).plain[:6] == list(cell.arm.queue.joints)
    cell.rest()


@pytest.mark.parametrize(
    ("command", "parameter", "refusal"),
    [
        ("slvMove", [0.0] * 8, hresult.ARM_NOT_TAKEN),
        ("slvChangeMode", 0, hresult.REFUSED_IN_SLAVE_MODE),
        ("slvChangeMode", J1, hresult.REFUSED_IN_SLAVE_MODE),
        ("slvSendFormat", 0, hresult.REFUSED_IN_SLAVE_MODE),
        ("TakeArm", [0, 0], hresult.REFUSED_IN_SLAVE_MODE),
        ("Motor", [0, 0], hresult.REFUSED_IN_SLAVE_MODE),
        ("DriveEx", ["@0 (1,5)"], hresult.REFUSED_IN_SLAVE_MODE),
    ],
)
def test_another_client_commands_nothing(cell, command, parameter, refusal):
    other = cell.connect().get_robot("", "")
    cell.on()
    assert cell.code_of(lambda: other.execute(command, variant(parameter))) == refusal
    assert cell.mode == J0


def test_a_client_that_may_only_read_asks_for_the_mode():
    cell = SlaveCell(permission=Permission("rw", {"192.168.0.9": "r"}))
    other = cell.connect("192.168.0.9").get_robot("", "")
    cell.on(J1)
    assert other.execute("slvGetMode", variant(None)) == J1
    assert cell.code_of(lambda: other.execute("slvMove", variant([0.0] * 8))) == hresult.NO_WRITE_RIGHT
    assert ADDRESS != "192.168.0.9"
    cell.close()


def test_moving_before_slave_mode_is_refused(cell):
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.SLAVE_MODE_OFF
    assert cell.error == 0


# --- mode 0 -----------------------------------------------------------------------------------------------------------


def test_mode_0_accepts_three_and_reports_a_full_buffer(cell):
    cell.on(J0)
    assert [code(cell.send(step(n))) for n in (1, 2, 3)] == [0, 0, hresult.S_BUF_FULL]
    for _ in range(3):
        assert cell.code_of(lambda: cell.send(step(4))) == hresult.E_BUF_FULL
    assert (cell.error, cell.mode) == (0, J0)
    cell.cycle()
    assert cell.arm.queue.joints == step(1)
    assert code(cell.send(step(4))) == hresult.S_BUF_FULL  # the refused one was not queued
    cell.cycle(3)
    assert cell.commands[-3:] == [step(2), step(3), step(4)]


def test_the_answer_to_a_full_buffer_is_a_whole_one(cell):
    cell.on(J0)
    cell.send(HOME)
    cell.send(HOME)
    answer = cell.send(HOME)
    assert isinstance(answer, ResultWithCode)
    assert value(answer) == [*HOME, 0.0, 0.0]


def test_each_cycle_takes_one_set_point(cell):
    cell.on(J0)
    cell.stream([*SINE, SINE[-1]])
    assert cell.commands[1:] == [*SINE, SINE[-1]]
    assert (cell.error, cell.mode) == (0, J0)
    assert not cell.arm.busy


@pytest.mark.parametrize("mode", [J0, J2])
def test_an_empty_buffer_while_standing_is_nothing(cell, mode):
    cell.on(mode)
    cell.cycle(50)
    cell.stream([*SINE, SINE[-1]])  # the same twice: the velocity is zero
    cell.cycle(200)
    assert (cell.error, cell.mode) == (0, mode)
    cell.stream([*SINE, SINE[-1]])
    assert (cell.error, cell.mode) == (0, mode)


@pytest.mark.parametrize("mode", [J0, J2])
@pytest.mark.parametrize("after", [3, 20, 25, 60])
def test_an_empty_buffer_while_moving_is_an_error(cell, mode, after):
    cell.on(mode)
    cell.stream(SINE[:after])
    assert cell.error == 0
    last = len(cell.commands) - 1
    cell.cycle()
    assert cell.error == hresult.COMMAND_DELAY
    assert cell.mode == 0
    cell.rest()
    cell.check_brake(last)
    assert not cell.arm.motor.on  # the error has level 4
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.COMMAND_DELAY
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.SLAVE_MODE_OFF


# --- mode 1 -----------------------------------------------------------------------------------------------------------


def test_mode_1_keeps_the_newest(cell):
    cell.on(J1)
    assert [code(cell.send(step(n))) for n in (5, 9, 2)] == [0, 0, 0]
    cell.cycle()
    assert cell.arm.queue.joints == step(2)


def test_mode_1_stays_where_it_is_without_one(cell):
    """Slow enough to stop from one cycle to the next."""
    cell.on(J1)
    cell.stream([step(1), step(2)])
    cell.cycle(20)
    assert cell.commands[-20:] == [step(2)] * 20
    assert (cell.error, cell.mode) == (0, J1)
    cell.send(step(3))
    cell.cycle()
    assert cell.arm.queue.joints == step(3)


def test_mode_1_that_stays_may_exceed_the_acceleration(cell):
    cell.on(J1)
    cell.stream(SINE[:25])
    last = len(cell.commands) - 1
    cell.cycle()
    assert cell.error == hresult.COMMAND_ACCELERATION_OVER_AXIS1
    assert cell.mode == 0
    cell.rest()
    cell.check_brake(last)


# --- mode 2 -----------------------------------------------------------------------------------------------------------


def test_mode_2_answers_when_there_is_room(cell):
    cell.on(J2)
    for number in (1, 2, 3):
        assert code(cell.send(step(number))) == 0  # at once, without S_BUF_FULL
    held = cell.send(step(4))
    assert isinstance(held, Deferred)
    assert not held.done()
    cell.cycle()
    assert held.done()
    assert value(held)[1:] == [*HOME[1:], 0.0, 0.0]
    cell.cycle(3)
    assert cell.commands[-4:] == [step(1), step(2), step(3), step(4)]


def test_mode_2_returns_the_pose_at_the_time_of_the_reply(cell):
    cell.on(J2)
    cell.stream(SINE[:30])
    for index in range(30, 33):
        cell.send(SINE[index])
    held = cell.send(SINE[33])
    before = cell.arm.servo.encoder
    cell.cycle()
    assert value(held)[:6] == list(cell.arm.servo.encoder) != list(before)
    cell.rest()


def test_a_client_that_waits_for_its_answers_is_never_late_in_mode_2(cell):
    cell.on(J2)
    poses = iter([*SINE, SINE[-1], SINE[-1]])
    held: Deferred | None = None
    for _ in range(len(SINE) + 10):
        while held is None or held.done():
            pose = next(poses, None)
            if pose is None:
                break
            answer = cell.send(pose)
            held = answer if isinstance(answer, Deferred) else None
        cell.cycle()
    assert (cell.error, cell.mode) == (0, J2)
    assert [joints for joints in cell.commands if joints != HOME] == SINE[1:-1]


# --- leaving ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [J0, J2])
def test_it_is_left_when_the_buffer_has_been_consumed(cell, mode):
    cell.on(mode)
    for number in (1, 2):
        cell.send(step(number))
    cell.send(step(2))
    leaving = cell.robot.execute("slvChangeMode", variant(0))
    assert not leaving.done()
    assert cell.mode == mode
    assert cell.code_of(lambda: cell.send(step(3))) == hresult.SLAVE_MODE_OFF
    cell.cycle(2)
    assert not leaving.done()
    cell.cycle()
    assert leaving.done()
    assert leaving.result() is None
    assert (cell.mode, cell.error) == (0, 0)
    assert cell.arm.queue.joints == step(2)
    assert cell.code(cell.move()) == 0


@pytest.mark.parametrize("mode", [J0, J1, J2])
def test_an_arm_that_still_moves_is_brought_to_rest_first(cell, mode):
    cell.on(mode)
    cell.stream(SINE[:25])
    cell.send(SINE[25])
    leaving = cell.robot.execute("slvChangeMode", variant(0))
    cell.cycle()
    assert cell.arm.queue.joints == SINE[25]
    last = len(cell.commands) - 1
    while not leaving.done():
        assert cell.mode == mode
        assert cell.execute("slvGetMode") == mode
        cell.cycle()
    assert cell.arm.queue.state is QueueState.IDLE
    assert (cell.mode, cell.error, cell.arm.motor.on) == (0, 0, True)
    cell.rest()
    cell.check_brake(last)
    assert cell.execute("TakeArmState", -1) == 1


def test_leaving_twice_is_leaving_once(cell):
    cell.on(J0)
    cell.stream(SINE[:25])
    first, second = (cell.robot.execute("slvChangeMode", variant(0)) for _ in range(2))
    cell.rest()
    assert first.done()
    assert second.done()
    assert cell.code_of(lambda: cell.on()) == 0


# --- poses ------------------------------------------------------------------------------------------------------------


def test_positions_are_followed_with_tool_and_work(cell):
    cell.execute("SetToolDef", [1, "P(10, 20, 80, 0, 30, 0)"])
    cell.execute("SetWorkDef", [1, "P(100, -50, 20, 0, 0, 45)"])
    cell.robot.change("Tool1")
    cell.robot.change("Work1")
    cell.execute("slvRecvFormat", 1)
    start = cell.execute("CurPos")
    cell.on(P0)
    for index in range(40):
        cell.send([start[0] + 0.02 * min(index, 20), *start[1:]])
        cell.cycle()
    assert cell.error == 0
    cell.cycle(3)
    assert cell.robot.get_variable("@CURRENT_POSITION", "").get_value().plain == pytest.approx(
        [start[0] + 0.4, *start[1:]], abs=1e-6
    )
    assert value(cell.send([start[0] + 0.4, *start[1:]])) == pytest.approx([start[0] + 0.4, *start[1:]], abs=1e-6)


@pytest.mark.parametrize("figure", [5, -1, -2, -3])
@pytest.mark.parametrize("mode", [P0, T0])
def test_a_figure_or_the_nearest(cell, mode, figure):
    read = "CurPos" if mode == P0 else "CurTrn"
    start = cell.execute(read)[:-1]
    cell.on(mode)
    for index in range(30):
        cell.send([start[0], start[1] + 0.02 * min(index, 20), *start[2:], figure])
        cell.cycle()
    assert cell.error == 0
    assert cell.arm.queue.joints[0] > 0
    assert cell.arm.space.kinematics.figure(cell.arm.queue.joints) == 5
    assert not cell.arm.busy


@pytest.mark.parametrize("model", ["COBOTTA", "VS-087", "VP-6242"])
def test_two_equal_positions_are_rest_for_every_arm(model):
    """Numerical kinematics finds the same joints for the same pose."""
    cell = SlaveCell(model=model)
    start = cell.execute("CurPos")
    cell.on(P0)
    for index in range(30):
        cell.send([start[0], start[1] + 0.01 * min(index, 20), *start[2:]])
        cell.cycle()
    cell.cycle(10)
    assert (cell.error, cell.mode) == (0, P0)
    cell.close()


def test_single_precision_and_short_joints(cell):
    cell.on(J0)
    cell.robot.execute("slvMove", Variant(VarType.R4 | 0x2000, list(HOME)))
    cell.cycle()
    assert cell.arm.queue.joints == HOME


EXTRA = 0x400000


@pytest.fixture
def eight() -> Iterator[SlaveCell]:
    """An arm with two extended joints, the eighth a linear one."""
    base = load_model("VS-050")
    axes = (*base.axes, AxisModel(-90, 90, 200, 1000), AxisModel(0, 500, 300, 1500, linear=True))
    made = SlaveCell(model=type(base)("X", "X", base.origins, axes, (*base.home, 1.0, 100.0)))
    yield made
    made.close()


@pytest.mark.parametrize(
    ("pose", "ends"),
    [
        ([*HOME, 1.05, 100.05], (1.0, 100.0)),  # without the option they do not move (RC8 4.4)
        ([*HOME, 1.05, 100.05, EXTRA | 0x40], (1.05, 100.0)),
        ([*HOME, 1.05, 100.05, EXTRA | 0x80], (1.0, 100.05)),
        ([*HOME, 1.05, 100.05, EXTRA | 0xC0], (1.05, 100.05)),
    ],
)
def test_extra_axes_beside_joints(eight, pose, ends):
    eight.on(J0)
    eight.send(pose)
    eight.cycle()
    assert eight.arm.queue.joints == (*HOME, *ends)
    assert value(eight.send(pose))[6:] == [1.0, 100.0]  # the encoders lag behind


@pytest.mark.parametrize(
    ("option", "ends"),
    [
        ([], (1.0, 100.0)),
        ([EXTRA | 0x40, 1.05], (1.05, 100.0)),
        ([EXTRA | 0x80, 100.05], (1.0, 100.05)),
        ([EXTRA | 0xC0, 1.05, 100.05], (1.05, 100.05)),
    ],
)
@pytest.mark.parametrize("mode", [P0, T0])
def test_extra_axes_beside_positions(eight, mode, option, ends):
    start = eight.execute("CurPos" if mode == P0 else "CurTrn")
    eight.on(mode)
    eight.send([*start, *option])
    eight.cycle()
    assert eight.arm.queue.joints == pytest.approx((*HOME, *ends), abs=1e-6)


def test_a_set_point_begins_where_the_one_before_ends(eight):
    """Not the present position of the arm: both are in the buffer."""
    eight.on(J0)
    eight.send([*HOME, 1.05, 100.0, EXTRA | 0x40])
    eight.send(HOME)
    eight.send([*HOME, 0.0, 100.05, EXTRA | 0x80])
    eight.cycle(3)
    assert eight.arm.queue.joints == (*HOME, 1.05, 100.05)


# --- what is sent and answered ----------------------------------------------------------------------------------------


def io(cell: SlaveCell, first: int, count: int) -> int:
    return cell.rc8.state.variables.points(first, count)


def test_outputs_are_set_in_the_cycle_of_their_set_point(cell):
    cell.execute("slvSendFormat", 0x120)
    cell.on(J0)
    cell.send(HOME, 0x1_BEEF, 0x15A)
    cell.send(HOME, 0, 0)
    assert (io(cell, 16, 16), io(cell, 64, 8)) == (0, 0)
    cell.cycle()
    assert (io(cell, 0, 16), io(cell, 16, 16), io(cell, 64, 8), io(cell, 72, 32)) == (0, 0xBEEF, 0x5A, 0)
    cell.cycle()
    assert (io(cell, 16, 16), io(cell, 64, 8)) == (0, 0)


def test_negative_numbers_are_bits_too(cell):
    cell.execute("slvSendFormat", 0x100)
    cell.on(J0)
    cell.send(HOME, -1)
    cell.cycle()
    assert io(cell, 0, 48) == 0xFFFF << 16


def test_user_io_is_set_byte_by_byte(cell):
    cell.execute("slvSendFormat", 0x220)
    cell.on(J0)
    cell.send(HOME, 128, 3, b"\x01\x80\xff", 0x81)
    cell.cycle()
    assert (io(cell, 128, 24), io(cell, 152, 8), io(cell, 64, 8)) == (0xFF8001, 0, 0x81)


def test_a_set_point_that_is_refused_sets_nothing(cell):
    cell.execute("slvSendFormat", 0x20)
    cell.on(J0)
    cell.send((30.0, *HOME[1:]), 0xFF)
    cell.cycle()
    assert cell.error
    assert io(cell, 64, 8) == 0


def test_inputs_and_outputs_are_answered(cell):
    for name, given in (
        ("IOW0", 0x1234),
        ("IOW16", -0x5433),
        ("IOB48", 0x5A),
        ("IOB64", 0xC3),
        ("IOB128", 1),
        ("IOB136", 254),
    ):
        cell.put(name, given)
    cell.execute("slvRecvFormat", 0x322)
    cell.on(J0)
    pose, mini, user, hand = value(cell.send(HOME, 128, 16))
    assert pose == [*HOME, 0.0, 0.0]
    assert mini == 0x1234 | (0xABCD << 16) - (1 << 32)
    assert bytes(user) == b"\x01\xfe"
    assert hand == 0xC35A


@pytest.mark.parametrize(("unit", "factor"), [(0, 1), (1, 1000)])
def test_the_time_is_that_of_the_last_cycle(cell, unit, factor):
    cell.execute("slvRecvFormat", [0x12, unit])
    cell.on(J0)
    times = []
    for number in range(6):
        cell.send(step(number))
        cell.cycle()
        times.append(value(cell.send(step(number)))[0])
        cell.cycle()
    assert {later - earlier for earlier, later in pairwise(times)} == {16 * factor}
    assert times[0] == pytest.approx(cell.rc8.state.last_cycle_time * 1000 * factor - 5 * 16 * factor - 8 * factor)


@pytest.mark.parametrize("seconds", [3000.0, 3_000_000.0])
def test_a_time_that_is_long_stays_a_vt_i4(cell, seconds):
    cell.clock.advance(seconds)
    cell.execute("slvRecvFormat", [0x12, 1])
    cell.on(J0)
    stamp = cell.robot.execute("slvMove", variant([*HOME, 0.0, 0.0])).value[0]
    assert stamp.type == VarType.I4
    assert 0 <= stamp.value < 2**31


def test_currents_are_those_of_the_log(cell):
    cell.execute("slvRecvFormat", 0x42)
    cell.on(J0)
    cell.stream(SINE[:30])
    pose, current = value(cell.send(SINE[30]))
    sample = cell.arm.servo.sample(True)
    assert current == [*sample.current, 0.0, 0.0]
    assert pose == [*sample.encoder, 0.0, 0.0]
    assert any(current)
    cell.rest()


@pytest.mark.parametrize(("number", "size"), [(1, 7), (2, 8), (3, 10), (4, 15), (5, 18), (0, 8)])
def test_poses_are_those_of_the_encoders(cell, number, size):
    cell.execute("slvRecvFormat", number)
    cell.on(J0)
    cell.stream(SINE[:30])
    answer = value(cell.send(SINE[30]))
    assert len(answer) == size
    whole = [*cell.arm.space.position(cell.arm.servo.encoder), *cell.arm.servo.encoder, 0.0, 0.0]
    if number == 4:
        assert answer == whole
    if number in (0, 2):
        assert answer == whole[7:]
    if number == 3:
        assert answer == cell.arm.space.trans(cell.arm.servo.encoder)
    cell.rest()


def test_formats_belong_to_a_client(cell):
    """The formats are kept from one slave mode to the next."""
    other = cell.connect().get_robot("", "")
    other.execute("slvRecvFormat", variant(1))
    cell.execute("slvRecvFormat", 0x11)
    for _ in range(2):
        cell.on(J0)
        assert len(value(cell.send(HOME))) == 2
        cell.run(cell.robot.execute("slvChangeMode", variant(0)))
    cell.execute("GiveArm")
    other.execute("TakeArm", variant([0, 0]))
    other.execute("slvChangeMode", variant(J0))
    assert len(value(other.execute("slvMove", variant([*HOME, 0.0, 0.0])))) == 7


@pytest.mark.parametrize(
    ("command", "parameter"),
    [("slvSendFormat", 0x300), ("slvSendFormat", 1), ("slvSendFormat", -1), ("slvRecvFormat", 6), ("slvRecvFormat", 0x1000),
     ("slvRecvFormat", [1, 2]), ("slvRecvFormat", [1, 0, 0]), ("slvSendFormat", [])],
)  # fmt: skip
def test_invalid_formats(cell, command, parameter):
    assert cell.code_of(lambda: cell.execute(command, parameter)) == hresult.E_INVALIDARG


@pytest.mark.parametrize(
    ("points", "command", "number"),
    [
        (31, "slvSendFormat", 0x100),
        (31, "slvRecvFormat", 0x101),
        (71, "slvSendFormat", 0x20),
        (71, "slvRecvFormat", 0x21),
    ],
)
def test_a_controller_with_fewer_points(points, command, number):
    """The I/O of a format must exist (denso_robot_ros 47)."""
    for count, wanted in ((points, hresult.E_INVALIDARG), (points + 1, 0)):
        cell = SlaveCell(io_points=count)
        assert cell.code_of(lambda cell=cell: cell.execute(command, number)) == wanted
        cell.close()


@pytest.mark.parametrize(
    ("offset", "size", "wanted"), [(504, 1, 0), (504, 2, hresult.E_INVALIDARG), (512, 1, hresult.E_INVALIDARG)]
)
def test_user_io_must_be_there(cell, offset, size, wanted):
    cell.execute("slvSendFormat", 0x200)
    cell.execute("slvRecvFormat", 0x202)
    cell.on(J0)
    assert cell.code_of(lambda: cell.send(HOME, offset, size, b"\xff" * size, 128, 1)) == wanted
    assert cell.code_of(lambda: cell.send(HOME, 128, 1, b"\xff", offset, size)) == wanted
    assert (cell.error, cell.mode) == (0, J0)


# --- malformed parameters ---------------------------------------------------------------------------------------------

MALFORMED = [
    None, "J(0,45,90,0,45,0)", 5, [], [1.0] * 5, [1.0] * 20, [float("nan"), *HOME[1:], 0.0, 0.0], [float("inf")] * 8,
    [1e300] * 8, [*HOME, 0.0, 0.0, 5.0], [*HOME, 0.0, 0.0, EXTRA | 0x40], ["x"] * 8, [[0.0] * 8, 1], True,
]  # fmt: skip


@pytest.mark.parametrize("given", MALFORMED)
def test_a_malformed_parameter_is_answered_and_nothing_else(cell, given):
    cell.on(J0)
    cell.send(step(1))
    assert cell.code_of(lambda: cell.robot.execute("slvMove", variant(given))) in (
        hresult.E_INVALIDARG,
        hresult.DISP_E_TYPEMISMATCH,
    )
    assert (cell.error, cell.mode) == (0, J0)
    cell.cycle()
    assert cell.arm.queue.joints == step(1)


@pytest.mark.parametrize("values", [[0.0] * 9, [350, 0, 300, 0, 0, 0, 0, 0, 1], [350, 0, 300, 0, 0, 1, 0, 0, 1]])
def test_invalid_vectors_are_malformed(cell, values):
    cell.on(T2)
    assert cell.code_of(lambda: cell.send([*values, 5.0])) == hresult.E_INVALIDARG
    assert (cell.error, cell.mode) == (0, T2)


def test_a_full_buffer_comes_before_where_the_pose_is(cell):
    cell.on(J0)
    for _ in range(3):
        cell.send(HOME)
    assert cell.code_of(lambda: cell.send((500.0, *HOME[1:]))) == hresult.E_BUF_FULL
    assert cell.code_of(lambda: cell.send([1.0] * 5)) == hresult.E_INVALIDARG
    assert (cell.error, cell.mode) == (0, J0)


# --- it costs nothing when it is off ----------------------------------------------------------------------------------


def test_the_cycle_sleeps_while_nothing_is_sent(cell):
    cell.on(P1)
    cell.cycle(20)
    assert not cell.rc8.state.cycles.busy
    cell.send(cell.connect().get_robot("", "").execute("CurPos", variant(None)).plain)
    assert cell.rc8.state.cycles.busy
    cell.cycle(20)
    assert not cell.rc8.state.cycles.busy


def test_points_that_do_not_change_are_not_written(tmp_path):
    """125 set-points per second and a slow disk."""
    device = VirtualRC8(state=tmp_path)
    variables: VariableTable = device.state.variables
    saved = []
    keep, variables._save = variables._save, lambda *given: saved.append(given[1])
    variables.set_points(16, 16, 0x8001)
    variables.set_points(16, 16, 0x8001)
    variables.set_points(16, 16, 0x8000)
    assert saved == [{16: True, 31: True}, {16: False}]
    assert variables.points(16, 16) == 0x8000
    variables._save = keep
    device.close()


def test_outputs_are_kept_in_the_state_directory(tmp_path):
    cell = SlaveCell(state=str(tmp_path))
    cell.execute("slvSendFormat", 0x20)
    cell.on(J0)
    cell.send(HOME, 0x81)
    cell.cycle()
    cell.close()
    device = VirtualRC8(state=str(tmp_path))
    assert device.state.variables.points(64, 8) == 0x81
    device.close()


def test_several_held_answers_come_in_their_order(cell):
    """Command objects may execute several calls at a time."""
    cell.on(J2)
    for number in range(1, 4):
        cell.send(step(number))
    held = [cell.send(step(number)) for number in range(4, 8)]
    done = []
    for _ in range(4):
        cell.cycle()
        done.append([each.done() for each in held])
    assert done == [[index < count for index in range(4)] for count in (1, 2, 3, 4)]
    cell.cycle(3)
    assert cell.commands[-7:] == [step(number) for number in range(1, 8)]
