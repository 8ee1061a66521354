"""Slave mode as published programs use it: queries beside the stream, flags of all axes, user I/O in bits, errors."""

from __future__ import annotations

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.provider_guide import REFUSED_IN_SLAVE_MODE, controller_execute_commands, robot_execute_commands
from support.slave_cell import HOME, J0, J1, J2, P0, P2, SlaveCell, value

STEP = 0.1  # deg in a cycle
R8S = int(VarType.R8) | ARRAY
ALL_MODES = pytest.mark.parametrize("mode", [J0, J1, J2])


@pytest.fixture
def cell():
    cell = SlaveCell()
    yield cell
    cell.close()


def ramp(count: int, step: float = STEP, axis: int = 0) -> list[tuple[float, ...]]:
    """Return set-points that move one axis evenly, without acceleration at the start."""
    return [tuple(q + step * n * (number == axis) for number, q in enumerate(HOME)) for n in range(1, count + 1)]


def raw(cell: SlaveCell, command: str, parameter: object = None) -> object:
    """Execute a command of the robot; return the result with its type."""
    return cell.robot.execute(command, variant(parameter))


# --- queries on the connection that streams ---------------------------------------------------------------------------

READS = {
    "CurJnt": 8, "CurPos": 7, "CurTrn": 10, "HighCurJnt": 8, "CurJntEx": 9, "DestJnt": 8, "GetToolDef": None, "GetSrvData": 8,
}  # fmt: skip
PARAMETERS = {"GetToolDef": 1, "GetSrvData": 4}


@ALL_MODES
@pytest.mark.field("1.1")
@pytest.mark.guide("5.2.28 ff. what may be called in slave mode")
def test_queries_are_answered_between_set_points(cell, mode):
    cell.on(mode)
    for pose in ramp(4):
        cell.send(pose)
        for command, count in READS.items():
            result = raw(cell, command, PARAMETERS.get(command))
            assert result.type == R8S
            assert count is None or len(result.plain) == count
        assert raw(cell, "DevH", ["P(350, 0, 300, 180, 0, 180)", "P(0, 0, 10, 0, 0, 0)"]).type == R8S
        assert raw(cell, "MotionComplete", [-1, 0]) in (True, False)
        assert cell.controller.execute("GetCurErrorCount", variant(None)) == 0
        assert cell.controller.execute("GetErrorLogCount", variant(None)) == 0
        assert isinstance(cell.controller.execute("SysState", variant(None)), int)
        assert cell.controller.execute("ManualReset", variant(None)) is None
        assert cell.controller.execute("ClearError", variant(None)) is None
        cell.cycle()
    assert (cell.mode, cell.error) == (mode, 0)
    assert cell.arm.queue.joints[0] > 0


@pytest.mark.field("1.1")
def test_the_position_beside_the_stream_is_the_actual_one(cell):
    cell.on(J0)
    cell.stream(ramp(10))
    assert raw(cell, "CurJnt").plain[0] == pytest.approx(cell.arm.servo.encoder[0])
    assert raw(cell, "DestJnt").plain[0] == pytest.approx(cell.arm.queue.joints[0])
    assert 0 < cell.arm.servo.encoder[0] < cell.arm.queue.joints[0]


CONCERN_THE_MOTION = ("SetBaseDef", "SyncTimeStart", "SyncTimeEnd", "SyncMoveStart", "SyncMoveEnd")
"""Commands that the guide does not exclude from slave mode, and that are refused nevertheless (docs/howto/robot.md)."""


@pytest.mark.parametrize("command", robot_execute_commands())
@pytest.mark.guide("5.2.28 ff. what may be called in slave mode")
def test_exactly_the_commands_that_the_guide_names_are_refused(cell, command):
    """A command that is answered may have another error, because it gets no parameter here."""
    cell.on(J0)
    code = cell.code_of(lambda: cell.robot.execute(command, variant(None)))
    refused = command in (*REFUSED_IN_SLAVE_MODE, *CONCERN_THE_MOTION)
    assert (code == hresult.REFUSED_IN_SLAVE_MODE) is refused
    assert (cell.mode, cell.error) == (0 if command == "GiveArm" else J0, 0)


@pytest.mark.parametrize(
    "call",
    [
        lambda robot: robot.move(1, variant("J(1, 45, 90, 0, 45, 0)"), ""),
        lambda robot: robot.rotate(variant("XY"), 1.0, variant("V(0, 0, 0)"), ""),
        lambda robot: robot.speed(-1, 50.0),
        lambda robot: robot.accelerate(-1, 50.0, 50.0),
        lambda robot: robot.change("Tool1"),
        lambda robot: robot.execute("slvSendFormat", variant(0)),
        lambda robot: robot.execute("slvRecvFormat", variant(2)),
    ],
)  # fmt: skip
@pytest.mark.guide("5.2.28 ff. what may be called in slave mode")
def test_methods_that_move_or_set_are_refused(cell, call):
    cell.on(J0)
    assert cell.code_of(lambda: call(cell.robot)) == hresult.REFUSED_IN_SLAVE_MODE
    assert (cell.mode, cell.error) == (J0, 0)


@pytest.mark.guide("5.2.28 ff. what may be called in slave mode")
def test_all_commands_of_the_controller_are_answered_except_the_one_that_starts_programs(cell):
    cell.on(J0)
    refused = [
        name
        for name in controller_execute_commands()
        if cell.code_of(lambda name=name: cell.controller.execute(name, variant(None))) == hresult.REFUSED_IN_SLAVE_MODE
    ]
    assert refused == ["ContinueStartAll"]
    assert (cell.mode, cell.error) == (J0, 0)


@pytest.mark.guide("5.2.28.39 StopLog")
def test_stop_log_ends_the_recording_of_a_stream(cell):
    cell.execute("ClearLog")
    cell.on(J0)
    cell.stream(ramp(3))
    assert raw(cell, "StopLog") is None
    count = len(cell.arm.log)
    cell.cycle(3)
    assert count == len(cell.arm.log) > 0


def test_a_strict_controller_answers_only_the_commands_of_slave_mode():
    cell = SlaveCell(strict=True).on(J0)
    for command in ("CurJnt", "MotionComplete", "DevH", "GiveArm", "StopLog", "ClearError"):
        assert cell.code_of(lambda command=command: raw(cell, command)) == hresult.REFUSED_IN_SLAVE_MODE
    for command in ("SysState", "ClearError", "ManualReset"):
        call = cell.controller.execute
        assert (
            cell.code_of(lambda call=call, command=command: call(command, variant(None)))
            == hresult.REFUSED_IN_SLAVE_MODE
        )
    assert raw(cell, "GetSrvData", 4).type == R8S
    assert cell.mode == J0
    cell.close()


@ALL_MODES
def test_give_arm_leaves_slave_mode_at_standstill(cell, mode):
    cell.on(mode)
    cell.stream(ramp(10))
    done = raw(cell, "GiveArm")
    assert isinstance(done, Deferred)
    assert cell.arm.holder is not None
    cell.run(done)
    assert (cell.arm.holder, cell.mode, cell.error) == (None, 0, 0)
    assert not cell.arm.busy
    cell.rest()
    cell.check_brake(10)


def test_halt_on_the_streaming_connection_stops_the_arm(cell):
    cell.on(J0)
    cell.stream(ramp(10))
    cell.run(cell.robot.halt(""))
    assert (cell.mode, cell.error) == (0, 0)
    cell.rest()
    cell.check_brake(10)


# --- flags and user I/O -----------------------------------------------------------------------------------------------


@ALL_MODES
@pytest.mark.field("1.2")
def test_flags_may_name_all_axes(cell, mode):
    """A mask of all six axes behind every J pose, as DENSO's ROS drivers send it."""
    cell.on(mode)
    for pose in ramp(5):
        cell.send([*pose, 0.0, 0.0, float(0x40003F)])
        cell.cycle()
    assert (cell.mode, cell.error) == (mode, 0)
    assert cell.arm.queue.joints[0] == pytest.approx(0.5)


@pytest.mark.parametrize("flags", [0x40007F, 0x4000FF, 0x400100, 0x3F, 0x400000 + 0.5, -0x400000])
def test_flags_of_axes_that_do_not_exist_are_refused(cell, flags):
    cell.on(J0)
    assert cell.code_of(lambda: cell.send([*HOME, 0.0, 0.0, float(flags)])) == hresult.E_INVALIDARG
    assert (cell.mode, cell.error) == (J0, 0)


def test_flags_of_robot_axes_belong_to_joints_only(cell):
    cell.on(P0)
    pose = raw(cell, "CurPos").plain
    assert (
        cell.code_of(lambda: cell.robot.execute("slvMove", variant([*pose, float(0x40003F)]))) == hresult.E_INVALIDARG
    )


USER_SENT, USER_BACK = 0x200, 0x202


def user_io(size: int, states: bytes = b"\x05") -> list[object]:
    return [128, size, Variant(VarType.UI1 | ARRAY, list(states))]


@pytest.mark.parametrize("size", [8, 1], ids=["bits", "bytes"])
@pytest.mark.field("1.3")
def test_the_number_of_bytes_shows_the_unit_of_user_io(cell, size):
    """DENSO's ROS driver sends the size in bits, for the I/O that it sends and for the I/O that it receives."""
    cell.execute("slvSendFormat", USER_SENT)
    cell.execute("slvRecvFormat", USER_BACK)
    cell.on(J0)
    for _ in range(2):
        pose, states = value(cell.send(HOME, *user_io(size), 128, size))
        cell.cycle()
    assert pose == [*HOME, 0.0, 0.0]
    assert bytes(states) == b"\x05"
    assert cell.rc8.state.variables.points(128, 8) == 5


@pytest.mark.parametrize(("unit", "size"), [("bits", 16), ("bytes", 2)])
@pytest.mark.field("1.3")
def test_the_unit_of_requested_user_io_is_an_option(unit, size):
    cell = SlaveCell(user_io_unit=unit)
    cell.put("IOW128", 0x0301)
    cell.execute("slvRecvFormat", USER_BACK)
    cell.on(J0)
    _, states = value(cell.send(HOME, 128, size))
    assert bytes(states) == b"\x01\x03"
    cell.close()


def test_a_number_of_bits_is_a_multiple_of_eight(cell):
    cell.execute("slvRecvFormat", USER_BACK)
    cell.on(J0)
    assert cell.code_of(lambda: cell.send(HOME, 128, 12)) == hresult.E_INVALIDARG


def test_an_unknown_unit_is_refused():
    with pytest.raises(ValueError, match="bits"):
        SlaveCell(user_io_unit="words")


# --- accelerations ----------------------------------------------------------------------------------------------------


def there_and_back(start: tuple[float, ...], axis: int, step: float, count: int = 10) -> list[tuple[float, ...]]:
    """Return set-points that move an axis evenly from rest, reverse, and stop where they began."""
    places = [*range(1, count + 1), *range(count - 1, -1, -1)]
    return [tuple(q + step * place * (number == axis) for number, q in enumerate(start)) for place in places]


SAMPLES = [("COBOTTA", 0.05), ("COBOTTA", 0.1), ("VS-050", 0.2)]


@pytest.mark.parametrize("limit", [0, 2], ids=["servo limit", "command limit"])
@ALL_MODES
@pytest.mark.parametrize(("model", "step"), SAMPLES)
@pytest.mark.field("1.4")
def test_published_samples_run_from_rest_with_a_reversal(model, step, mode, limit):
    cell = SlaveCell(model=model, slave_limit=limit)
    start = cell.arm.queue.joints
    cell.on(mode)
    for axis in range(6):
        for pose in there_and_back(start, axis, step):
            cell.send(pose)
            cell.cycle()
        cell.send(start)
        cell.cycle(2)
        assert (cell.mode, cell.error) == (mode, 0)
        assert not cell.arm.busy
    cell.close()


@ALL_MODES
@pytest.mark.parametrize(("model", "step"), SAMPLES)
@pytest.mark.field("1.4")
def test_the_limits_catch_ten_times_the_published_samples(model, step, mode):
    for axis in range(6):
        cell = SlaveCell(model=model)
        cell.on(mode)
        start = cell.arm.queue.joints
        for pose in there_and_back(start, axis, 10 * step):
            cell.send(pose)
            cell.cycle()
            if cell.error:
                break
        limits = (hresult.COMMAND_ACCELERATION_OVER_AXIS1 + axis, hresult.SENT_SPEED_OVER_AXIS1 + axis)
        assert cell.error in limits
        cell.rest()
        assert max(abs(a - b) for a, b in zip(start, cell.arm.queue.joints, strict=True)) < 10 * step
        cell.close()


# --- the error that ends slave mode -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [J0, J2])
@pytest.mark.field("1.6")
def test_starvation_is_reported_once(cell, mode):
    cell.on(mode)
    cell.stream(ramp(10))
    cell.cycle(5)  # no set-point arrives
    assert (cell.error, cell.mode) == (hresult.COMMAND_DELAY, 0)
    codes = [cell.code_of(lambda: cell.send(HOME)) for _ in range(3)]
    assert codes == [hresult.COMMAND_DELAY, hresult.SLAVE_MODE_OFF, hresult.SLAVE_MODE_OFF]


def test_a_waiting_set_point_reports_the_error_itself(cell):
    cell.on(J2)
    for pose in ramp(3):
        cell.send(pose)
    waiting = cell.send(ramp(4)[-1])
    assert isinstance(waiting, Deferred)
    cell.rc8.emergency_stop(True)
    assert cell.code(waiting) == hresult.EMERGENCY_STOP_ON
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.SLAVE_MODE_OFF


def test_a_set_point_out_of_reach_reports_the_error_itself(cell):
    cell.on(P2)
    pose = raw(cell, "CurPos").plain
    pose[0] = 5000.0
    assert cell.code_of(lambda: cell.robot.execute("slvMove", variant(pose))) == hresult.OUT_OF_WORKING_RANGE
    assert cell.code_of(lambda: cell.robot.execute("slvMove", variant(pose))) == hresult.SLAVE_MODE_OFF


def test_the_error_is_forgotten_with_the_next_stream(cell):
    cell.on(J0)
    cell.stream(ramp(10))
    cell.cycle(5)
    cell.rest()
    cell.controller.execute("ClearError", variant(None))
    cell.execute("Motor", [1, 0])
    cell.on(J0)
    cell.send(cell.arm.queue.joints)
    cell.execute("slvChangeMode", 0)
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.SLAVE_MODE_OFF


def test_another_client_does_not_receive_the_error(cell):
    other = cell.connect().get_robot("", "")
    cell.on(J0)
    cell.stream(ramp(10))
    cell.cycle(5)
    send = variant([*HOME, 0.0, 0.0])
    assert cell.code_of(lambda: other.execute("slvMove", send)) == hresult.SLAVE_MODE_OFF
    assert cell.code_of(lambda: cell.send(HOME)) == hresult.COMMAND_DELAY
