"""The operations of a host, each against a driver that replies from a list."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.session.host import Host, broadcasts_of_all
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import BR0, BR1, BR1V2, BR2, BR3, BR4, BR5, BR6, BUF, DP0R, DP0RV2, DP1R, Flags
from orinkit.abh3.table.signals import V1, V2, Dialect
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.core import i18n
from orinkit.core.errors import DriverFault, DriverTimeout, InvalidValue

pytestmark = pytest.mark.core

# --- a driver from a list ---------------------------------------------------------------------------------------------


def frame(text: str) -> CanFrame:
    """``00EF0201 b6 ff 00 00 db ff db ff``."""
    number, _, data = text.partition(" ")
    return CanFrame(int(number, 16), bytes.fromhex(data))


class Peer:
    """Answers the steps of an operation in order: with a frame, or with ``None`` for a time-out."""

    def __init__(self, *answers: str | CanFrame | None) -> None:
        self._answers = [frame(answer) if isinstance(answer, str) else answer for answer in answers]
        self.turns: list[OperationStep] = []

    def run(self, operation: CanOperation[Any]) -> Any:
        """Return the result; check that there is exactly one answer for each step."""
        self.turns = []
        answers = iter(self._answers)
        try:
            self.turns.append(next(operation))
            for answer in answers:
                self.turns.append(operation.send(answer))
        except StopIteration as end:
            assert list(answers) == [], "ended early"
            return end.value
        operation.close()
        pytest.fail(f"one more turn: {self.turns[-1]}")

    @property
    def sent(self) -> list[str]:
        """The frames that were sent: ``00EF0102#0000000003300000``."""
        return [str(each) for turn in self.turns for each in turn.frames]


FEEDBACK = "00EF0201 b6 ff 00 00 db ff db ff"
VELOCITIES = DP0R(-14.8, 0.0, -7.4, -7.4)
REST = "00EF0201 00 00 00 00 00 00 00 00"


def sent_by(operation: CanOperation[Any]) -> str:
    """Run an operation that gets a reply at once, and return the only frame that it sent."""
    peer = Peer(FEEDBACK)
    peer.run(operation)
    (only,) = peer.sent
    return only


# --- sections 4.1 to 4.5 ----------------------------------------------------------------------------------------------


def test_one_command_one_reply() -> None:
    host: Host[DP0R] = Host()
    peer = Peer(FEEDBACK)
    assert peer.run(host.command(1000, -1000)) == VELOCITIES
    assert peer.turns == [OperationStep((frame("00EF0102 88 13 78 ec 00 00 00 00"),), 1.0, fresh=True)]


def test_init_sends_nothing_but_zeros() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    peer = Peer(FEEDBACK)
    assert peer.run(host.init()) == VELOCITIES
    assert peer.sent == ["00EF0102#0000000000000000"]
    assert (host.commands, host.inputs) == ((0, 0), 0)


def test_omitted_commands_are_unchanged() -> None:
    host: Host[DP0R] = Host()
    assert sent_by(host.set_inputs(0x3003)) == "00EF0102#0000000003300000"
    assert sent_by(host.command(0.2)) == "00EF0102#0100000003300000"
    assert sent_by(host.command(bx=-0.4)) == "00EF0102#0100FEFF03300000"
    assert sent_by(host.command(0.6)) == "00EF0102#0300FEFF03300000"
    assert sent_by(host.command(bx=0)) == "00EF0102#0300000003300000"
    assert sent_by(host.command(6553.4, -6553.6)) == "00EF0102#FF7F008003300000"
    assert sent_by(host.command()) == "00EF0102#FF7F008003300000"
    assert sent_by(host.send_commands()) == "00EF0102#FF7F008003300000"
    assert host.commands == (6553.4, -6553.6)
    assert host.inputs == 0x3003


def test_inputs_by_mask() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.command(0.2, 0.4))
    assert sent_by(host.set_inputs(0x10345678)) == "00EF0102#0100020078563410"
    assert sent_by(host.set_inputs(0xFFFFFFFF, 0x00FF00F0))[-8:] == "F856FF10"
    assert sent_by(host.set_inputs(0, 0x000F0008))[-8:] == "F056F010"
    assert sent_by(host.set_inputs(0xFFFFFFFF, 0))[-8:] == "F056F010"
    assert host.inputs == 0x10F056F0
    assert sent_by(host.set_inputs(0, 0xFFFFFFFF))[-8:] == "00000000"
    assert type(host.inputs) is int


def test_inputs_as_numpy_numbers() -> None:
    np = pytest.importorskip("numpy")
    host = Host()
    assert sent_by(host.set_inputs(np.uint32(0x80000000), np.uint64(0x80000000)))[-8:] == "00000080"
    assert type(host.inputs) is int
    for bad in (np.int32(-5), np.True_):
        with pytest.raises(InvalidValue):
            sent_by(host.set_inputs(bad))
    assert host.inputs == 0x80000000


WORDS = st.integers(0, 0xFFFFFFFF)


@given(WORDS, WORDS, WORDS, st.sampled_from([V1, V2]))
def test_the_formula_of_the_inputs(before: int, data: int, mask: int, dialect: Dialect) -> None:
    host: Host[Any] = Host(dialect)
    assert sent_by(host.set_inputs(before)) == f"00EF0102#00000000{before.to_bytes(4, 'little').hex().upper()}"
    wanted = (before & ~mask) | (data & mask)
    assert sent_by(host.set_inputs(data, mask))[-8:] == wanted.to_bytes(4, "little").hex().upper()
    assert host.inputs == wanted


@given(WORDS, st.integers(0, 31), st.integers(0, 1))
def test_the_formula_of_one_input(before: int, number: int, value: int) -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(before))
    wanted = (before & ~(1 << number)) | (value << number)
    assert sent_by(host.set_input(number, value))[-8:] == wanted.to_bytes(4, "little").hex().upper()
    assert host.inputs == wanted


def test_inputs_by_name() -> None:
    host: Host[DP0R] = Host()
    assert sent_by(host.set_input("servo_on", 1))[-8:] == "01100000"
    assert sent_by(host.set_input("bx_start", True))[-8:] == "01300000"
    assert sent_by(host.set_input("ay_servo_on", False))[-8:] == "00300000"
    assert sent_by(host.set_input("error_reset", 1))[-8:] == "00300080"
    two: Host[DP0RV2] = Host(V2)
    assert sent_by(two.set_input("servo_on", 1))[-8:] == "01010000"
    assert sent_by(two.set_input("error_reset", 1))[-8:] == "01014000"


def test_stop_leaves_the_servo_on() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0xFFFFFFFF))
    Peer(FEEDBACK).run(host.command(1, 2))
    peer = Peer(FEEDBACK)
    assert peer.run(host.stop()) == VELOCITIES
    assert peer.sent == ["00EF0102#00000000FDDFFFFF"]
    two: Host[DP0RV2] = Host(V2)
    Peer(FEEDBACK).run(two.set_inputs(0xFFFFFFFF))
    assert sent_by(two.stop()) == "00EF0102#00000000FDFDFFFF"


def test_torque_is_commanded_in_percent() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_input("ay_torque", 1))
    assert sent_by(host.command(50, 50)) == "00EF0102#8813FA0000000001"
    assert host.commands == (50, 50)
    two: Host[DP0RV2] = Host(V2)
    Peer(FEEDBACK).run(two.set_input("bx_torque", 1))
    assert sent_by(two.command(50, 50)) == "00EF0102#FA00881300000200"
    assert two.commands == (50, 50)


@pytest.mark.parametrize(("dialect", "ay", "bx"), [(V1, 24, 25), (V2, 16, 17)])
def test_a_command_is_zero_after_a_change_of_its_unit(dialect: Dialect, ay: int, bx: int) -> None:
    def moving() -> Host[Any]:
        host: Host[Any] = Host(dialect)
        Peer(FEEDBACK).run(host.command(1, 2))
        return host

    host = moving()
    assert sent_by(host.set_input(ay, 1))[9:17] == "00000A00"
    assert sent_by(host.set_input(ay, 1))[9:17] == "00000A00"
    Peer(FEEDBACK).run(host.command(3))  # %
    assert sent_by(host.set_input(ay, 1))[9:17] == "2C010A00"  # nothing changes
    assert sent_by(host.set_input(ay, 0))[9:17] == "00000A00"
    host = moving()
    assert sent_by(host.set_inputs(1 << bx, 1 << bx))[9:17] == "05000000"
    assert sent_by(host.set_inputs(0))[9:17] == "05000000"
    host = moving()
    assert sent_by(host.set_input("torque", 1))[9:17] == "00000000"
    host = moving()
    others = 0xFFFFFFFF & ~(1 << ay | 1 << bx)
    assert sent_by(host.set_inputs(others))[9:17] == "05000A00"


# --- invalid values ---------------------------------------------------------------------------------------------------

BAD: list[Callable[[Any], CanOperation[Any]]] = [
    lambda host: host.command(6553.6),
    lambda host: host.command(1, -6553.8),
    lambda host: host.command(7000, 1),
    lambda host: host.command(float("nan"), 1),
    lambda host: host.command(bx=float("inf")),
    lambda host: host.command("1", 1),
    lambda host: host.command(10**5000),
    lambda host: host.set_inputs(1 << 32),
    lambda host: host.set_inputs(-1),
    lambda host: host.set_inputs(0, -1),
    lambda host: host.set_inputs(0, 1 << 32),
    lambda host: host.set_inputs(True),
    lambda host: host.set_inputs(1.0),
    lambda host: host.set_inputs(0, None),
    lambda host: host.set_inputs(10**5000),
    lambda host: host.set_input(32, 1),
    lambda host: host.set_input(-1, 1),
    lambda host: host.set_input("servo", 1),
    lambda host: host.set_input("ay_ready", 1),
    lambda host: host.set_input(0, 2),
    lambda host: host.set_input(0, -1),
    lambda host: host.set_input(0, "1"),
    lambda host: host.set_input(0, 10**5000),
    lambda host: host.request(-1),
    lambda host: host.request(256),
    lambda host: host.request(256, everyone=True),
    lambda host: host.request_single(2),
    lambda host: host.request_single(-1),
    lambda host: host.request_single(False),
    lambda host: host.request_single(True),
    lambda host: host.request_single(0.0),
    lambda host: host.request(0x30),
    lambda host: host.request(0x27, everyone=True),
    lambda host: host.request(True),
    lambda host: host.request_single(10**5000),
]


@pytest.mark.parametrize("number", range(len(BAD)))
def test_bad_values_send_nothing_and_change_nothing(number: int) -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue) as caught:
            next(BAD[number](host))
        assert len(str(caught.value)) < 600
    assert (host.commands, host.inputs, host.commanded) == ((1, 2), 0x3003, 2)
    assert sent_by(host.send_commands()) == "00EF0102#05000A0003300000"


def test_errors_name_the_axis() -> None:
    host: Host[DP0R] = Host()
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        for arguments, axis in (((7000, 1), "ay"), ((1, 7000), "bx"), ((None, "1"), "bx"), ((7000, 7000), "ay")):
            with pytest.raises(InvalidValue, match=f"^{axis}: "):
                next(host.command(*arguments))


def test_the_remedy_for_a_negative_word() -> None:
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        for arguments, name in (((-1,), "data"), ((0, -1), "mask")):
            with pytest.raises(InvalidValue, match=rf"^{name} .*-1.*: {name} & 0xFFFFFFFF$"):
                next(Host().set_inputs(*arguments))


def test_an_operation_that_is_not_run_changes_nothing() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    for operation in (
        host.init(),
        host.command(3, 4),
        host.set_inputs(0),
        host.set_input(0, 0),
        host.stop(),
        host.reset_errors(),
        host.stop_and_wait(1.0),
        host.release(1.0),
    ):
        assert inspect.isgenerator(operation)
        operation.close()
    assert (host.commands, host.inputs, host.commanded) == ((1, 2), 0x3003, 2)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"address": 254}, "address"),
        ({"address": -1}, "address"),
        ({"address": "1"}, "address"),
        ({"host": 254}, "host"),
        ({"host": True}, "host"),
        ({"group": 32}, "group"),
        ({"priority": 8}, "priority"),
        ({"address": 7, "host": 7}, "7"),
        ({"address": 2}, "2"),
    ],
)
def test_settings_out_of_range(settings: dict[str, Any], named: str) -> None:
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=named):
            Host(V1, **settings)


# --- missing replies --------------------------------------------------------------------------------------------------

FUNCTIONS: list[tuple[str, Callable[[Host[DP0R]], CanOperation[Any]]]] = [
    ("abh3_can_cmd_init", lambda host: host.init()),
    ("abh3_can_cmd", lambda host: host.command(1, 2)),
    ("abh3_can_cmdAY", lambda host: host.command(1)),
    ("abh3_can_cmdBX", lambda host: host.command(bx=2)),
    ("abh3_can_inSet", lambda host: host.set_inputs(1)),
    ("abh3_can_inBitSet", lambda host: host.set_input(0, 1)),
    ("abh3_can_inBitSet", lambda host: host.reset_errors()),
    ("abh3_can_cmd", lambda host: host.stop()),
    ("abh3_can_cmd", lambda host: host.stop_and_wait(60.0)),
    ("abh3_can_cmd", lambda host: host.send_commands()),
    ("abh3_can_reqBRD", lambda host: host.request(0)),
    ("abh3_can_reqBRDBRD", lambda host: host.request(0, everyone=True)),
    ("abh3_can_reqSNG", lambda host: host.request_single()),
    ("abh3_can_reqSNG", lambda host: host.request_single(1)),
]


@pytest.mark.parametrize(("function", "start"), FUNCTIONS)
def test_no_reply(function: str, start: Callable[[Host[DP0R]], CanOperation[Any]]) -> None:
    host: Host[DP0R] = Host(address=9, timeout=0.25)
    peer = Peer(None)
    with pytest.raises(DriverTimeout) as caught:
        peer.run(start(host))
    assert (caught.value.function, caught.value.seconds, caught.value.address) == (function, 0.25, 9)
    assert len(peer.sent) == 1  # it is not repeated
    assert peer.turns[0].seconds == 0.25


def test_commands_are_zero_after_a_command_without_reply() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    peer = Peer(None)
    with pytest.raises(DriverTimeout):
        peer.run(host.command(1, 2))
    assert peer.sent == ["00EF0102#05000A0003300000"]
    assert (host.commands, host.inputs) == ((0, 0), 0x1001)  # a data set of the driver would run with start on
    peer = Peer(FEEDBACK, None)
    assert peer.run(host.command(3)) == VELOCITIES
    assert peer.sent == ["00EF0102#0F00000001100000"]


def test_inputs_without_reply_reset_the_commands_too() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.command(1, 2))
    with pytest.raises(DriverTimeout):
        Peer(None).run(host.set_input(1, 1))
    assert (host.commands, host.inputs) == ((0, 0), 0)


def test_an_interrupted_wait_resets_the_commands_too() -> None:
    """After Ctrl-C, a cancelled task or a lost bus, it is unknown what the driver has received."""
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    operation = host.command(1, 2)
    next(operation)
    assert host.commands == (1, 2)
    operation.close()
    peer = Peer(FEEDBACK, None)
    peer.run(host.send_commands())
    assert peer.sent == ["00EF0102#0000000001100000"]


def test_when_a_driver_may_be_moving() -> None:
    host: Host[DP0R] = Host()
    assert not host.moving
    Peer(FEEDBACK).run(host.set_inputs(0x1001))
    assert not host.moving
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    assert host.moving
    with pytest.raises(DriverTimeout):
        Peer(None).run(host.command(1, 2))
    assert (host.commands, host.inputs, host.moving) == ((0, 0), 0x1001, True)  # its state is unknown
    with pytest.raises(DriverTimeout):
        Peer(None).run(host.stop())
    assert host.moving
    assert Peer(None).run(host.release(0.1)) is False
    assert host.moving
    assert Peer(FEEDBACK).run(host.release(0.1))
    assert not host.moving
    assert Peer().run(host.release(0.1))
    Peer(FEEDBACK).run(host.command(5))
    host.relinquish()
    assert not host.moving


# --- late replies -----------------------------------------------------------------------------------------------------

LATE = "00EF0201 05 00 00 00 00 00 00 00"
"""The reply to the previous command."""


def in_vain(operation: CanOperation[Any]) -> None:
    with pytest.raises(DriverTimeout):
        Peer(None).run(operation)


def interrupted(operation: CanOperation[Any]) -> None:
    next(operation)
    operation.close()


def unanswered(operation: CanOperation[bool]) -> None:
    assert Peer(None).run(operation) is False


LOST: list[Callable[[Host[DP0R]], None]] = [
    lambda host: in_vain(host.command(1)),
    lambda host: interrupted(host.command(1)),
    lambda host: unanswered(host.repeat(0.1)),
    lambda host: interrupted(host.repeat(0.1)),
]


@pytest.mark.parametrize("lose", LOST)
def test_the_second_of_two_replies_counts(lose: Callable[[Host[DP0R]], None]) -> None:
    """The first one may be the reply to the previous command; then two replies follow each other at once."""
    host: Host[DP0R] = Host()
    lose(host)
    peer = Peer(LATE, *NOT_THE_ANSWER, FEEDBACK)
    assert peer.run(host.command(2)) == VELOCITIES
    assert peer.turns[1:] == [OperationStep((), 0.02), *[OperationStep()] * len(NOT_THE_ANSWER)]
    assert sent_by(host.command(3)) == "00EF0102#0F00000000000000"  # no reply is pending: no second wait


@pytest.mark.parametrize("lose", LOST)
def test_a_single_reply_counts(lose: Callable[[Host[DP0R]], None]) -> None:
    host: Host[DP0R] = Host()
    lose(host)
    peer = Peer(FEEDBACK, *NOT_THE_ANSWER, None)
    assert peer.run(host.command(2)) == VELOCITIES
    assert host.commands == (2, 0)
    assert sent_by(host.command(3)) == "00EF0102#0F00000000000000"


def test_a_reply_stays_pending_until_one_arrives() -> None:
    host: Host[DP0R] = Host()
    in_vain(host.command(1))
    in_vain(host.command(2))
    operation = host.command(3)  # interrupted while it waits for the second one
    next(operation)
    assert operation.send(frame(LATE)) == OperationStep((), 0.02)
    operation.close()
    assert host.commands == (0, 0)
    assert Peer(LATE, FEEDBACK).run(host.command(4)) == VELOCITIES
    assert Peer(LATE).run(host.command(5)) == DP0R(1.0, 0.0, 0.0, 0.0)


def test_a_reply_to_a_keep_alive_ends_the_pending_one() -> None:
    host: Host[DP0R] = Host()
    unanswered(host.repeat(0.1))
    assert Peer(FEEDBACK).run(host.repeat(0.1)) is True
    sent_by(host.command(1))


def test_requests_leave_no_reply_pending() -> None:
    host: Host[DP0R] = Host()
    in_vain(host.request(0))
    in_vain(host.request_single())
    sent_by(host.command(1))


def test_a_request_without_reply_keeps_the_commands() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.command(1, 2))
    with pytest.raises(DriverTimeout):
        Peer(None).run(host.request(0))
    assert host.commands == (1, 2)


# --- other traffic ----------------------------------------------------------------------------------------------------

NOT_THE_ANSWER = [
    "00EF0102 00 00 00 00 00 00 00 00",  # the own command, which some interfaces return
    "00EF0203 00 00 00 00 00 00 00 00",  # of another driver
    "00EF0301 00 00 00 00 00 00 00 00",  # to another host
    "01EF0201 00 00 00 00 00 00 00 00",  # the other page
    "02EF0201 00 00 00 00 00 00 00 00",  # R is 1
    "00EE0201 00 00 00 00 00 00 00 00",
    "00EA0201 00 00 00 00 00 00 00 00",
    "00FF2801 00 00 00 00 00 00 00 00",
    "00EF0201 00 00 00 00 00 00 00",  # too short
    "00EF0201",
    "00000000 00 00 00 00 00 00 00 00",
]


def test_other_frames_do_not_prolong_the_wait() -> None:
    host: Host[DP0R] = Host(timeout=0.5)
    peer = Peer(*NOT_THE_ANSWER, FEEDBACK)
    assert peer.run(host.command(1)) == VELOCITIES
    first, *others = peer.turns
    assert (first.seconds, first.fresh, len(first.frames)) == (0.5, True, 1)
    assert others == [OperationStep((), None, fresh=False)] * len(NOT_THE_ANSWER)


def test_other_frames_are_not_a_reply() -> None:
    host: Host[DP0R] = Host()
    with pytest.raises(DriverTimeout):
        Peer(*NOT_THE_ANSWER, None).run(host.command(1))


@pytest.mark.parametrize("priority", range(8))
def test_the_priority_of_a_reply_is_ignored(priority: int) -> None:
    host: Host[DP0R] = Host()
    answer = frame(FEEDBACK)
    assert Peer(answer._replace(id=answer.id | priority << 26)).run(host.send_commands()) == VELOCITIES
    data = frame("00FF2801 01 00 00 00 00 00 00 00")
    found = Peer(data._replace(id=data.id | priority << 26)).run(host.request(0))
    assert found == BR0(Flags(1, V1.errors), Flags(0, V1.warnings))
    assert Peer(answer._replace(id=answer.id | priority << 26)).run(host.repeat(0.1)) is True


def test_frames_have_the_selected_priority() -> None:
    host: Host[DP0R] = Host(priority=3)
    assert sent_by(host.send_commands()) == "0CEF0102#0000000000000000"
    peer = Peer("08FF2801 00 00 00 00 00 00 00 00")
    peer.run(host.request(0))
    assert peer.sent == ["0CEA0102#28FF00"]
    assert sent_by(host.request_single()) == "0CEA0102#00EF00"


def test_addresses_and_groups() -> None:
    host: Host[DP0R] = Host(address=0x11, host=0x22, group=16)
    peer = Peer("00EF2211 b6 ff 00 00 db ff db ff")
    assert peer.run(host.send_commands()) == VELOCITIES
    assert peer.sent == ["00EF1122#0000000000000000"]
    peer = Peer("00FF2811 00 00 00 00 00 00 00 00", "00FF8111 00 00 00 00 00 00 00 00")
    peer.run(host.request(1))
    assert peer.sent == ["00EA1122#81FF00"]


def test_frames_for_a_host() -> None:
    host: Host[DP0R] = Host()
    for good in (
        "00EF0201", "01EF0201", "1CEF0201", "00EC0201", "00EB0201", "00FF2801", "08FF2E01", "00FF8001", "00FF0001",
    ):  # fmt: skip
        assert host.accepts(frame(good)), good
    for bad in (
        "00EF0102", "00EF0301", "00EF0203", "02EF0201", "00EC0301", "00EB0202", "00EA0201", "00EAFF01", "00FF2802",
        "02FF2801", "00EE0201", "00000001",
    ):  # fmt: skip
        assert not host.accepts(frame(bad)), bad


# --- section 4.7 ------------------------------------------------------------------------------------------------------

DATA = "05 00 0a 00 0f 00 14 00"


@pytest.mark.parametrize(
    ("number", "record"),
    [
        (0, BR0(Flags(0x000A0005, V1.errors), Flags(0x0014000F, V1.warnings))),
        (1, BR1(Flags(0x000A0005, V1.control), Flags(0x0014000F, V1.io))),
        (2, BR2(1, 2, 3, 4)),
        (3, BR3(0.05, 0.1, 15, 20)),
        (4, BR4(0x000A0005, 0x0014000F)),
        (5, BR5(0.05, 0.1, 1.5, 2)),
        (7, BUF(bytes.fromhex(DATA))),
    ],
)
def test_requests(number: int, record: Any) -> None:
    host: Host[DP0R] = Host()
    for asked in (number, 0x28 + number):
        for everyone, destination in ((False, "01"), (True, "FF")):
            peer = Peer(f"00FF{0x28 + number:02X}01 {DATA}")
            found = peer.run(host.request(asked, everyone=everyone))
            assert found == record
            assert type(found) is type(record)
            assert peer.turns == [
                OperationStep((frame(f"00EA{destination}02 {0x28 + number:02X} FF 00"),), 1.0, fresh=True)
            ]
    assert host.commanded == 0


def test_a_request_of_monitors() -> None:
    host: Host[DP0R] = Host()
    assert Peer("00FF2E01 00 00 80 3f 00 00 00 c0").run(host.request(6)) == BR6(1, -2)


def test_requests_of_other_groups() -> None:
    host: Host[DP0R] = Host(group=16)
    for number in (2, 0x82):
        peer = Peer(f"00FF2A01 {DATA}", f"00FF8201 {DATA}")
        assert peer.run(host.request(number)) == BR2(1, 2, 3, 4)
        assert peer.sent == ["00EA0102#82FF00"]
    host = Host(group=1)
    assert Peer(f"00FF0F01 {DATA}").run(host.request(0x0F)) == BUF(bytes.fromhex(DATA))
    assert Peer(f"00FFFD01 {DATA}").run(Host(group=31).request(0xFD)) == BR5(0.05, 0.1, 1.5, 2)


def test_a_request_accepts_replies_of_its_own_driver_only() -> None:
    host: Host[DP0R] = Host()
    others = [
        f"00FF2A03 {DATA}", f"00FF2B01 {DATA}", f"00FF2A01 {DATA} "[:-4], f"01FF2A01 {DATA}", f"02FF2A01 {DATA}",
        "00EAFF02 2A FF 00", FEEDBACK,
    ]  # fmt: skip
    peer = Peer(*others, f"00FF2A01 {DATA}")
    assert peer.run(host.request(2, everyone=True)) == BR2(1, 2, 3, 4)
    assert peer.turns[1:] == [OperationStep()] * len(others)


def test_single_packets_can_be_requested() -> None:
    host: Host[DP0R] = Host()
    peer = Peer("01EF0201 00 00 00 00 00 00 00 00", FEEDBACK)
    assert peer.run(host.request_single()) == VELOCITIES
    assert peer.sent == ["00EA0102#00EF00"]
    peer = Peer(FEEDBACK, "01EF0201 ff ff ff ff 02 00 00 00")
    assert peer.run(host.request_single(1)) == DP1R(-1, 2)
    assert peer.sent == ["00EA0102#00EF01"]
    assert host.commanded == 0


def test_the_dialect_of_2023() -> None:
    host: Host[DP0RV2] = Host(V2)
    found = Peer("00EF0201 b6 ff 01 00 03 03 00 80").run(host.send_commands())
    assert found == DP0RV2(-14.8, 0.2, Flags(0x80000303, V2.control))
    assert isinstance(found, DP0RV2)
    assert list(found.control) == ["ay_servo_on", "ay_start", "bx_servo_on", "bx_start", "error"]
    states = Peer("00FF2901 01 00 00 00 03 03 00 00").run(host.request(1))
    assert isinstance(states, BR1V2)
    assert (list(states.io), "servo_on" in states.external) == (["do_0"], True)


def test_load_units() -> None:
    host: Host[DP0R] = Host(V1.with_load_unit(0.1))
    assert Peer(f"00FF2B01 {DATA}").run(host.request(3)) == BR3(0.05, 0.1, 1.5, 2)


def test_the_number_of_commands() -> None:
    host: Host[DP0R] = Host()
    assert not host.moving
    Peer(FEEDBACK).run(host.set_input("servo_on", 1))
    assert not host.moving
    Peer(FEEDBACK).run(host.set_input("bx_start", 1))
    assert host.moving
    Peer(FEEDBACK).run(host.stop())
    assert not host.moving
    Peer(FEEDBACK).run(host.command(bx=0.2))
    assert host.moving
    host.reset_commands()
    assert host.moving  # the driver has not received it
    assert host.commands == (0, 0)
    assert host.commanded == 4


# --- resetting errors -------------------------------------------------------------------------------------------------

SET, CLEAR = "00FF2801 00 00 40 00 00 00 40 00", "00FF2801 00 00 00 00 00 00 00 00"


@pytest.mark.parametrize(("dialect", "resting", "reset"), [(V1, "FCCFFF7F", "FCCFFFFF"), (V2, "FCFCBFFF", "FCFCFFFF")])
def test_a_reset_is_an_edge_and_a_request(dialect: Dialect, resting: str, reset: str) -> None:
    """With commands 0, start and servo off; the other inputs are unchanged."""
    host: Host[Any] = Host(dialect, timeout=0.5)
    Peer(FEEDBACK).run(host.set_inputs(0xFFFFFFFF))
    Peer(FEEDBACK).run(host.command(1, 2))
    peer = Peer(REST, REST, REST, FEEDBACK, None, CLEAR)
    assert peer.run(host.reset_errors()) == BR0(Flags(0, dialect.errors), Flags(0, dialect.warnings))
    assert peer.sent == [
        f"00EF0102#00000000{resting}", f"00EF0102#00000000{reset}", f"00EF0102#00000000{resting}", "00EA0102#28FF00",
    ]  # fmt: skip
    asked = [(turn.seconds, turn.fresh) for turn in peer.turns]
    assert asked == [(0.5, True), (0.5, True), (0.5, True), (0.005, False), (None, False), (0.5, True)]
    assert f"{host.inputs:08X}" == bytes.fromhex(resting)[::-1].hex().upper()


def test_a_reset_is_repeated() -> None:
    host: Host[DP0R] = Host()
    peer = Peer(*[REST, REST, REST, None, SET] * 2, REST, REST, REST, None, CLEAR)
    assert not peer.run(host.reset_errors()).errors
    assert len(peer.sent) == 12
    assert [turn.seconds for turn in peer.turns if not turn.frames] == [0.005, 0.01, 0.02]


@pytest.mark.parametrize(("tries", "made"), [(1, 1), (3, 3), (0, 1), (9, 9)])
def test_a_reset_has_a_limit_of_tries(tries: int, made: int) -> None:
    host: Host[DP0R] = Host()
    peer = Peer(*[REST, REST, REST, None, "00FF2801 04 00 40 00 00 00 40 00"] * made)
    with pytest.raises(DriverFault) as caught:
        peer.run(host.reset_errors(tries))
    assert (caught.value.errors, caught.value.warnings) == (0x00400004, 0x00400000)
    assert caught.value.texts == ("driver overheated", "CAN communication time-out")
    assert len(peer.sent) == 4 * made
    pauses = [turn.seconds for turn in peer.turns if not turn.frames]
    assert pauses == [0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.2, 0.2, 0.2][:made]
    assert host.inputs == 0


@pytest.mark.parametrize("tries", [-1, 101, 2.5, None, "x", math.inf, True])
def test_invalid_tries(tries: Any) -> None:
    with pytest.raises(InvalidValue, match="tries must be 0 to 100"):
        Peer().run(Host().reset_errors(tries))


def test_five_tries_by_default() -> None:
    peer = Peer(*[REST, REST, REST, None, "00FF2801 00 00 00 00 00 00 01 00"] * 5)
    with pytest.raises(DriverFault) as caught:
        peer.run(Host().reset_errors())
    assert (caught.value.errors, caught.value.warnings) == (0, 0x00010000)  # a warning alone counts too
    assert len(peer.sent) == 20


@pytest.mark.parametrize("answers", [[None], [REST, None], [REST, REST, None], [REST, REST, REST, None, None]])
def test_a_reset_without_reply_clears_its_bit(answers: list[str | None]) -> None:
    host: Host[DP0R] = Host()
    with pytest.raises(DriverTimeout):
        Peer(*answers).run(host.reset_errors())
    assert host.inputs == 0
    operation = host.reset_errors()
    next(operation)
    operation.send(frame(REST))
    operation.close()  # while the reset bit is set
    assert host.inputs == 0


# --- standstill -------------------------------------------------------------------------------------------------------

STOPPED = "00EF0102#0000000001100000"


def turning() -> Host[DP0R]:
    host: Host[DP0R] = Host(timeout=0.5)
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    return host


def test_a_motor_at_standstill_ends_the_wait_at_once() -> None:
    host = turning()
    peer = Peer(REST)
    assert peer.run(host.stop_and_wait(5.0)) == DP0R(0.0, 0.0, 0.0, 0.0)
    assert peer.sent == [STOPPED]
    assert peer.turns[0].seconds == 0.5
    assert (host.commands, host.inputs) == ((0, 0), 0x1001)


@pytest.mark.parametrize(
    "turns",
    ["05 00 00 00 00 00 00 00", "00 00 fb ff 00 00 00 00", "00 00 00 00 05 00 00 00", "00 00 00 00 00 00 fb ff"],
)
def test_it_repeats_stop_until_standstill(turns: str) -> None:
    """1 min^-1 of any motor is not yet standstill, 0.8 min^-1 is."""
    host = turning()
    slow = "00EF0201 04 00 fc ff 04 00 fc ff"
    peer = Peer(f"00EF0201 {turns}", None, FEEDBACK, *NOT_THE_ANSWER, None, slow)
    assert peer.run(host.stop_and_wait(5.0)) == DP0R(0.8, -0.8, 0.8, -0.8)
    assert peer.sent == [STOPPED] * 3
    assert [turn.seconds for turn in peer.turns if turn.seconds] == [0.5, 0.05, 0.5, 0.05, 0.5]


def test_standstill_of_a_driver_of_2023() -> None:
    host: Host[DP0RV2] = Host(V2)
    found = Peer("00EF0201 05 00 00 00 00 00 00 00", None, "00EF0201 00 00 04 00 03 03 00 00").run(
        host.stop_and_wait(5.0)
    )
    assert (found.ay_velocity, found.bx_velocity) == (0.0, 0.8)


@pytest.mark.parametrize(("seconds", "looks"), [(0.001, 1), (0.05, 1), (0.2, 4), (0.21, 5), (1, 20)])
def test_motors_that_do_not_stop(seconds: float, looks: int) -> None:
    host = turning()
    peer = Peer(*[FEEDBACK, None] * looks)
    with pytest.raises(DriverTimeout, match="did not reach standstill") as caught:
        peer.run(host.stop_and_wait(seconds))
    assert (caught.value.function, caught.value.seconds, caught.value.address) == ("stop_and_wait", seconds, 1)
    assert peer.sent == [STOPPED] * looks


# --- keep-alive and release -------------------------------------------------------------------------------------------


def test_repeat_sends_what_was_sent_last() -> None:
    host: Host[DP0R] = Host(timeout=5)
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    peer = Peer(*NOT_THE_ANSWER, FEEDBACK)
    assert peer.run(host.repeat(0.1)) is True
    assert peer.turns[0] == OperationStep((frame("00EF0102 05 00 0a 00 03 30 00 00"),), 0.1, fresh=True)
    assert peer.turns[1:] == [OperationStep()] * len(NOT_THE_ANSWER)
    assert Peer(*NOT_THE_ANSWER, None).run(host.repeat(0.1)) is False
    assert (host.commands, host.inputs, host.commanded) == ((1, 2), 0x3003, 4)


def test_release_stops_a_driver() -> None:
    host: Host[DP0R] = Host()
    Peer(FEEDBACK).run(host.set_inputs(0x3003))
    Peer(FEEDBACK).run(host.command(1, 2))
    peer = Peer(FEEDBACK)
    assert peer.run(host.release(0.2)) is True
    assert peer.turns == [OperationStep((frame("00EF0102 00 00 00 00 01 10 00 00"),), 0.2, fresh=True)]
    assert not host.moving
    Peer(FEEDBACK).run(host.command(1))
    assert Peer(None).run(host.release(0.2)) is False
    assert host.commands == (0, 0)


def test_a_driver_that_has_another_host_now() -> None:
    host = turning()
    host.relinquish()
    assert (host.commands, host.inputs, host.commanded, host.moving) == ((0, 0), 0, 2, False)
    assert Peer().run(host.release(0.2)) is True  # nothing is sent


def test_release_sends_nothing_to_a_driver_without_commands() -> None:
    host: Host[DP0R] = Host()
    peer = Peer()
    assert peer.run(host.release(0.2)) is True
    assert peer.turns == []
    assert host.commanded == 0


# --- all drivers ------------------------------------------------------------------------------------------------------


def test_a_broadcast_of_all() -> None:
    answers = [
        "00FF2801 01 00 00 00 00 00 00 00",
        "00FF2803 02 00 00 00 00 00 00 00",
        "00FF2905 00 00 00 00 00 00 00 00",  # another one
        "00EAFF02 28 FF 00",
        "00FF2806 00",
        "01FF2807 00 00 00 00 00 00 00 00",
        "02FF2807 00 00 00 00 00 00 00 00",
        "00EF0208 00 00 00 00 00 00 00 00",
        "08FF2804 04 00 00 00 00 00 00 00",
        "00FF2801 08 00 00 00 00 00 00 00",  # a second reply: the latest counts
    ]
    peer = Peer(*answers, None)
    found = peer.run(broadcasts_of_all(Codec(V1), 2, 0x28, 0.3))
    assert {address: int(record.errors) for address, record in found.items()} == {1: 8, 3: 2, 4: 4}
    assert peer.turns == [
        OperationStep((frame("00EAFF02 28 FF 00"),), 0.3, fresh=True),
        *[OperationStep()] * len(answers),
    ]


def test_a_known_number_of_drivers() -> None:
    answers = ["00FF2A01 " + DATA, "00FF2A01 " + DATA, "00FF2A05 " + DATA]
    peer = Peer(*answers)
    assert peer.run(broadcasts_of_all(Codec(V1), 9, 0x2A, 0.3, count=2, priority=4)) == dict.fromkeys(
        (1, 5), BR2(1, 2, 3, 4)
    )
    assert peer.sent == ["10EAFF09#2AFF00"]


def test_no_drivers() -> None:
    assert Peer(None).run(broadcasts_of_all(Codec(V2), 2, 0x28, 0.3)) == {}


def test_an_unknown_broadcast_of_all() -> None:
    assert Peer("00FF8703 " + DATA, None).run(broadcasts_of_all(Codec(V1), 2, 0x87, 0.3)) == {
        3: BUF(bytes.fromhex(DATA))
    }
