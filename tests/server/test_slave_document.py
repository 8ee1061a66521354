"""Section 4 of the RC8 document against the virtual RC8: the packets printed in 4.6 and 4.7."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.server.threaded import Server
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.peers import RawClient
from support.waiting import until

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
ROBOT_EXECUTE, ROBOT_MOVE = 64, 72
SLAVE_MODE_OFF = 0x83500121
ERROR_PRESENT = 0x81501025

# Sections 3.2 and 3.3, with which 4.6 begins, and section 4 itself: the lines of request and reply.
CONNECT, GET_ROBOT, TAKE_ARM, MOTOR_ON = (251, 262), (661, 671), (684, 694), (723, 730)
MOVE_TO_P1, SLAVE_ON, SLAVE_MOVE, SLAVE_OFF, CLEAR_ERROR = (
    (1194, 1204), (1217, 1223), (1252, 1263), (1232, 1240), (1280, 1290),
)  # fmt: skip
POSE_HEAD = 25  # bytes before the numbers in a reply with one array: header, length, type, count


def printed(line: int) -> bytes:
    """Return a packet of the RC8 document by its line."""
    return next(bytes.fromhex(v["hex"]) for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and v["line"] == line)


POSE: list[float] = packet.decode(printed(SLAVE_MOVE[0])).arguments[2]


@pytest.fixture
def device() -> Iterator[VirtualRC8]:
    rc8 = VirtualRC8(model="VS-050", clock=Clock(50))
    yield rc8
    rc8.close()


@pytest.fixture
def server(device: VirtualRC8) -> Iterator[Server]:
    with orinkit.serve(device, "tcp://127.0.0.1:0") as served:
        with orinkit.connect(served.url) as teacher:
            teacher.variable("P1").value = POSE
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[RawClient]:
    with RawClient(server.url) as client:
        yield client


def converse(raw: RawClient, *pairs: tuple[int, int]) -> None:
    """Send printed requests; the replies must be the printed ones, except for the serial, which is sometimes misprinted."""
    for request, answer in pairs:
        raw.send(printed(request))
        got, wanted = raw.frame(), printed(answer)
        assert got[5:7] == printed(request)[5:7], request
        assert (got[:5] + got[7:]).hex(" ") == (wanted[:5] + wanted[7:]).hex(" "), request


def at_the_printed_pose(raw: RawClient) -> None:
    """Execute 4.6 up to 4.6.1, then move to the pose of the printed slvMove.

    P variables are VT_R4, so a P1 of 364.16 is 1e-5 mm off the pose of the slvMove, and the arm must be at the first
    set-point when slave mode begins. The second move, with all digits, is the only request that is not printed.
    """
    converse(raw, CONNECT, GET_ROBOT, TAKE_ARM, MOTOR_ON, MOVE_TO_P1)
    numbers = ", ".join(map(repr, POSE))
    raw.send(packet.encode(Packet(7, ROBOT_MOVE, [3, 1, f"@E P({numbers})", ""])))
    assert raw.packet().code == 0


def current_error(server: Server) -> int:
    with orinkit.connect(server.url) as other:
        value: int = other.variable("@ERROR_CODE").value
        return value & 0xFFFF_FFFF


def slave_mode(server: Server) -> Any:
    with orinkit.connect(server.url) as other:
        return other.robot("Arm").execute("slvGetMode")


def test_section_4_6_is_answered_as_printed(raw: RawClient, server: Server) -> None:
    """Compare every byte of every reply, except for the numbers returned by slvMove: see the next test."""
    at_the_printed_pose(raw)
    assert slave_mode(server) == 0
    converse(raw, SLAVE_ON)
    assert slave_mode(server) == 0x001
    raw.send(printed(SLAVE_MOVE[0]))
    got, wanted = raw.frame(), printed(SLAVE_MOVE[1])
    assert got[:POSE_HEAD].hex(" ") == wanted[:POSE_HEAD].hex(" ")
    assert len(got) == len(wanted)
    assert got[-1] == wanted[-1]
    for _ in range(10):  # some cycles with an empty buffer: the robot is at standstill (table 4-6)
        assert slave_mode(server) == 0x001
    converse(raw, SLAVE_OFF)
    assert slave_mode(server) == 0
    assert current_error(server) == 0


def test_the_printed_slv_move_is_answered_with_the_printed_joints(raw: RawClient) -> None:
    """The numbers agree within 1e-6.

    They are not identical: the printed ones have the rounding errors of a different inverse kinematics (J1 and J6 are
    -1.3e-15) and uninitialized memory after joint 6 (1.8e-307, 3.6e-313), for which the virtual arm returns 0.
    """
    at_the_printed_pose(raw)
    converse(raw, SLAVE_ON)
    raw.send(printed(SLAVE_MOVE[0]))
    answer = raw.packet()
    (joints,) = answer.arguments
    (wanted,) = packet.decode(printed(SLAVE_MOVE[1])).arguments
    assert answer.code == 0
    assert joints == pytest.approx(wanted, abs=1e-6)
    assert [round(joint, 6) + 0 for joint in joints] == [0, 45.000007, 89.999998, 0, 44.999996, 0, 0, 0]


def test_section_4_7_is_answered_as_printed(raw: RawClient, server: Server) -> None:
    """An error ends slave mode; after ClearError and slvChangeMode, as printed, slvMove works again."""
    at_the_printed_pose(raw)
    converse(raw, SLAVE_ON)
    away = [POSE[0] - 50.0, *POSE[1:]]
    raw.send(packet.encode(Packet(9, ROBOT_EXECUTE, [3, "slvMove", away])))
    assert raw.packet().code == 0
    until(lambda: current_error(server))
    assert current_error(server) >> 4 in (0x8420404, 0x8420405)
    assert slave_mode(server) == 0

    ended_by = current_error(server)
    for code in (ended_by, SLAVE_MODE_OFF):  # the error that has ended slave mode is reported once
        raw.send(printed(SLAVE_MOVE[0]))
        assert raw.packet().code & 0xFFFF_FFFF == code
    raw.send(printed(SLAVE_ON[0]))  # 4.7.1: not before the error has been cleared
    assert raw.packet().code & 0xFFFF_FFFF == ERROR_PRESENT
    assert slave_mode(server) == 0

    converse(raw, CLEAR_ERROR)
    assert current_error(server) == 0
    with orinkit.connect(server.url) as other:
        motor_off = not other.robot("Arm").variable("@SERVO_ON").value
    if motor_off:  # errors of level 4 switch it off
        converse(raw, MOTOR_ON)
    converse(raw, SLAVE_ON)
    raw.send(printed(SLAVE_MOVE[0]))
    answer = raw.packet()
    assert answer.code == 0
    assert answer.arguments[0][:6] == pytest.approx([0, 45, 90, 0, 45, 0], abs=1e-4)
    converse(raw, SLAVE_OFF)
    assert current_error(server) == 0


def test_every_printed_packet_of_section_4_is_used() -> None:
    """Check that the tests above omit no packet."""
    lines = {v["line"] for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and 962 <= v["line"] <= 1640}
    assert lines == {*MOVE_TO_P1, *SLAVE_ON, *SLAVE_MOVE, *SLAVE_OFF, *CLEAR_ERROR}
    assert len(lines) == 10
