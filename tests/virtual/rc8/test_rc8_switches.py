"""The settings of a person at the controller (executable token, mode, machine lock) and their effect on the arm."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import hresult
from orinkit.values.variant import variant
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.robot.motor import MotorState
from orinkit.virtual.rc8.switches import ModeSwitch, Switches, Token, TokenKind
from support.cell import ADDRESS, Cell

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)


@pytest.fixture
def cell() -> Iterator[Cell]:
    made = Cell().take()
    yield made
    made.close()


# --- executable token -------------------------------------------------------------------------------------------------

TOKENS = {
    "any": Token(TokenKind.ANY),
    " TP ": Token(TokenKind.TP),
    "io": Token(TokenKind.IO),
    "Ethernet": Token(TokenKind.ETHERNET),
    "ethernet:": Token(TokenKind.ETHERNET),
    "ethernet:192.168.0.7": Token(TokenKind.ETHERNET, "192.168.0.7"),
    "ETHERNET : 192.168.0.7 ": Token(TokenKind.ETHERNET, "192.168.0.7"),
    "ethernet:::1": Token(TokenKind.ETHERNET, "::1"),
    "ethernet:2001:db8::7": Token(TokenKind.ETHERNET, "2001:db8::7"),
}


@pytest.mark.parametrize("text", TOKENS)
def test_a_token_is_read(text):
    assert Token.parse(text) == TOKENS[text]
    assert Token.parse(str(TOKENS[text])) == TOKENS[text]


@pytest.mark.parametrize(
    "text",
    ["", "any:", "tp:192.168.0.7", "io:::1", "any:1.2.3.4", "usb", "ethernet:localhost", "ethernet:192.168.0", "ethernet,1.2.3.4",
     "ethernet:192.168.0.7:5007", "ethernet:192.168.0.0/24", "any any", "イーサネット", "ethernet:１.2.3.4", "x" * 100_000],
)  # fmt: skip
def test_invalid_tokens(text):
    if text == "any:":
        assert Token.parse(text) == Token()  # nothing after the colon: no address
        return
    with pytest.raises(ValueError, match="token"):
        Token.parse(text)


@given(st.text(max_size=30))
def test_any_text_is_a_token_or_a_clear_error(text):
    try:
        token = Token.parse(text)
    except ValueError as error:
        assert "token" in str(error)  # noqa: PT017 - not every case raises
    else:
        assert Token.parse(str(token)) == token


OTHERS, HERE = "192.168.0.9", "192.168.0.7"
REFUSALS = [
    ("any", HERE, 0),
    ("any", "", 0),
    ("tp", HERE, hresult.START_RIGHT_NOT_ETHERNET),
    ("io", HERE, hresult.START_RIGHT_NOT_ETHERNET),
    ("tp", "", hresult.START_RIGHT_NOT_ETHERNET),
    ("ethernet", HERE, 0),
    ("ethernet", "::1", 0),
    ("ethernet", "", hresult.START_RIGHT_NOT_ETHERNET),
    ("ethernet:" + HERE, HERE, 0),
    ("ethernet:" + HERE, "::ffff:" + HERE, 0),
    ("ethernet:::ffff:" + HERE, HERE, 0),
    ("ethernet:" + HERE, OTHERS, hresult.START_RIGHT_NOT_THIS_ADDRESS),
    ("ethernet:" + HERE, "COM1", hresult.START_RIGHT_NOT_THIS_ADDRESS),
    ("ethernet:" + HERE, "", hresult.START_RIGHT_NOT_ETHERNET),
    ("ethernet:::1", "0:0:0:0:0:0:0:1", 0),
    ("ethernet:::1", "::2", hresult.START_RIGHT_NOT_THIS_ADDRESS),
]


@pytest.mark.parametrize(("token", "address", "code"), REFUSALS)
def test_who_has_the_token(token, address, code):
    assert f"{Token.parse(token).refusal(address):08X}" == f"{code:08X}"


def test_the_token_changes_hands():
    """A running motion continues; Halt, Hold and Motor off need no token."""
    cell = Cell(token=f"ethernet:{ADDRESS}").take()
    other = cell.connect("192.168.0.9").get_robot("", "")
    assert cell.code_of(lambda: other.execute("TakeArm", variant(0))) == hresult.START_RIGHT_NOT_THIS_ADDRESS
    move = cell.move(1, "J(30, 45, 90, 0, 45, 0)")
    cell.trace(5)
    cell.rc8.pendant.token("tp")
    assert cell.code(move) == 0
    assert cell.code_of(lambda: cell.move(1, "J(0, 45, 90, 0, 45, 0)")) == hresult.START_RIGHT_NOT_ETHERNET
    assert cell.code_of(lambda: cell.robot.hold("")) == 0
    assert cell.code_of(lambda: cell.robot.halt("")) == 0
    assert cell.code_of(lambda: cell.execute("Motor", 0)) == 0
    assert cell.code_of(lambda: cell.execute("Motor", 1)) == hresult.START_RIGHT_NOT_ETHERNET
    cell.rc8.pendant.token("ethernet:192.168.0.9")
    assert cell.code_of(lambda: cell.execute("Motor", 1)) == hresult.START_RIGHT_NOT_THIS_ADDRESS
    cell.execute("GiveArm")
    assert cell.code_of(lambda: other.execute("TakeArm", variant(0))) == 0
    cell.close()


def test_how_it_is_at_the_start():
    switches = Switches()
    assert (switches.mode, switches.token, switches.auto_enable) == (ModeSwitch.AUTOMATIC, Token(), True)
    assert not any((switches.emergency_stop, switches.protective_stop, switches.machine_lock, switches.deadman))
    assert not switches.torque_off
    assert Switches(emergency_stop=True).torque_off
    assert Switches(protective_stop=True).torque_off
    for wrong in ({"token": "usb"}, {"mode": 4}, {"mode": 0}):
        with pytest.raises(ValueError, match=r"token|mode"):
            VirtualRC8(**wrong)


# --- where the arm stands at the start --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "joints",
    [
        (171, 0, 0, 0, 0, 0),
        (float("nan"), 0, 90, 0, 45, 0),
        (0, 45, 90, 0, 45, float("inf")),
        (0, 45, 90, 0, 45, 0, 0),
        (1e300,) * 6,
        ("x",),
    ],
)
def test_joints_that_the_arm_cannot_take(joints):
    with pytest.raises(ValueError):
        Cell(joints=joints)


def test_joints_of_the_start():
    cell = Cell(joints=(10, 20, 80, 0, 45, 0))
    assert cell.arm.queue.joints == cell.arm.servo.encoder == (10, 20, 80, 0, 45, 0)
    cell.close()


# --- mode -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [1, 2])
def test_another_mode_stops_and_the_way_back_does_not_go_on(cell, mode):
    move = cell.move(1, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(15)
    cell.rc8.pendant.mode(mode)
    cell.rc8.pendant.mode(3)  # without waiting
    cell.trace(100)
    assert cell.code(move) == hresult.EMERGENCY_STOP_OR_MODE_CHANGE
    assert not cell.arm.busy
    assert cell.arm.motor.state is MotorState.OFF
    assert not cell.rc8.state.faults.code  # a stop, not an error
    stands = cell.arm.queue.joints
    cell.execute("Motor", 1)
    assert cell.trace(20) == [stands] * 20


def test_the_same_mode_again_changes_nothing(cell):
    move = cell.move(1, "J(90, 45, 90, 0, 45, 0)")
    cell.trace(15)
    cell.rc8.pendant.mode(3)
    assert cell.code(move) == 0
    assert cell.arm.motor.on


@pytest.mark.parametrize("mode", [0, 4, -1, "auto", None, 2.5])
def test_invalid_modes(cell, mode):
    with pytest.raises(ValueError, match="mode"):
        cell.rc8.pendant.mode(mode)
    assert cell.rc8.state.switches.mode is ModeSwitch.AUTOMATIC


# --- machine lock -----------------------------------------------------------------------------------------------------


@pytest.fixture
def locked(cell) -> Cell:
    cell.execute("Motor", 0)
    cell.rc8.pendant.machine_lock()
    cell.execute("Motor", 1)
    return cell


@pytest.mark.parametrize(
    ("interpolation", "pose"), [(1, "J(90, 30, 95, 0, 45, 20)"), (2, "P(300, 250, 300, 180, 0, 180)")]
)
@pytest.mark.parametrize("mark", ["", "@E ", "@P "])
def test_locked_motions_run_and_the_arm_stays(locked, interpolation, pose, mark):
    free = Cell().take()
    usual = free.cycles(free.move(interpolation, mark + pose))
    free.close()
    move = locked.move(interpolation, mark + pose)
    taken = 0
    while not move.done():
        locked.trace(1)
        taken += 1
        assert locked.execute("CurJnt")[:6] == list(HOME)
    assert taken == usual - (3 if mark == "@E " else 0)  # no encoders to wait for
    while locked.arm.busy:
        locked.trace(1)
    assert locked.arm.queue.joints != HOME
    assert locked.execute("DestJnt")[:6] == list(locked.arm.queue.joints)
    assert locked.execute("MotionComplete", [-1, 1])
    there = locked.execute("CurPos")
    locked.run(locked.move(1, "J(0, 45, 90, 0, 45, 10)"))  # from the command position
    assert locked.execute("CurPos") == there


def test_without_the_lock_commands_begin_where_the_arm_is(locked):
    locked.run(locked.move(1, "J(90, 30, 95, 0, 45, 20)"))
    locked.execute("Motor", 0)
    locked.rc8.pendant.machine_lock(False)
    assert locked.arm.queue.joints == locked.arm.servo.encoder == HOME
    locked.execute("Motor", 1)
    move = locked.move(1, "J(10, 45, 90, 0, 45, 0)")
    joints = [HOME, *locked.trace(10)]
    assert max(abs(b[0] - a[0]) for a, b in itertools.pairwise(joints)) < 425 * 0.008
    assert locked.code(move) == 0
    locked.trace(3)
    assert locked.execute("CurJnt")[:6] == [10, 45, 90, 0, 45, 0]


def test_the_lock_needs_the_motor_off(cell):
    assert cell.code_of(lambda: cell.rc8.pendant.machine_lock(True)) == hresult.MOTOR_IS_ON
    assert cell.code_of(lambda: cell.rc8.pendant.machine_lock(False)) == 0  # already off
    going = cell.robot.execute("Motor", variant(0))
    assert cell.code_of(cell.rc8.pendant.machine_lock) == hresult.MOTOR_IS_ON  # the motor is not off yet
    cell.run(going)
    cell.rc8.pendant.machine_lock()
    assert cell.rc8.state.switches.machine_lock
    assert cell.controller.get_variable("@LOCK", "").get_value().plain is True


def test_a_stop_counts_for_locked_motions_too(locked):
    move = locked.move(1, "J(90, 30, 95, 0, 45, 20)")
    locked.trace(10)
    locked.rc8.pendant.emergency_stop()
    locked.trace(100)
    assert locked.code(move) == hresult.EMERGENCY_STOP_ON
    assert locked.arm.motor.state is MotorState.OFF
    assert locked.execute("CurJnt")[:6] == list(HOME)
    locked.rc8.pendant.machine_lock(False)
    assert locked.arm.queue.joints == HOME
