"""Sections 3.2 and 3.3 of the RC8 document against the virtual RC8: the printed packets, and the two programs."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.server.threaded import Server
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.peers import RawClient
from support.waiting import until

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
P1 = [350.0, 50.0, 300.0, 180.0, 0.0, 180.0, 5.0]
SERVICE_START, SERVICE_STOP, CONNECT, DISCONNECT, GET_ROBOT, GET_TASK = 1, 2, 3, 4, 7, 8
ROBOT_EXECUTE, ROBOT_MOVE, ROBOT_RELEASE, TASK_START, TASK_STOP, TASK_RELEASE = 64, 72, 84, 88, 89, 99
CONTROLLER = ("", "CaoProv.DENSO.VRC", "localhost", "")


def printed(line: int) -> bytes:
    """Return a packet of the RC8 document by its line."""
    return next(bytes.fromhex(v["hex"]) for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and v["line"] == line)


def empty_reply(serial: int) -> bytes:
    """Return a reply with S_OK and no arguments."""
    return bytes.fromhex(f"0110000000{serial:02x}00000000000000000004")


@pytest.fixture
def device() -> Iterator[VirtualRC8]:
    rc8 = VirtualRC8(clock=Clock(50))
    yield rc8
    rc8.close()


@pytest.fixture
def server(device: VirtualRC8) -> Iterator[Server]:
    with orinkit.serve(device, "tcp://127.0.0.1:0") as served:
        with orinkit.connect(served.url) as teacher:
            teacher.variable("P1").value = P1
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[RawClient]:
    with RawClient(server.url) as client:
        yield client


def motor_on(device: VirtualRC8) -> None:
    """Switch the motor on at the pendant."""
    device.pendant.motor()
    until(lambda: device.state.arm.motor.on)


def equal_except_serial(answer: bytes, wanted: bytes) -> bool:
    """Compare two replies without their serials, as some are printed with a serial different from their request's."""
    return answer[:5] + answer[7:] == wanted[:5] + wanted[7:]


def test_section_3_2_is_answered_as_printed(raw: RawClient) -> None:
    conversation = [
        (251, printed(262)),  # Controller_Connect -> 2
        (493, printed(503)),  # Controller_GetTask Pro1 -> 3
        (515, printed(524)),  # Task_Start 2
        (533, printed(539)),  # Task_Stop 3
        (551, empty_reply(6)),  # Task_Release
    ]
    for line, answer in conversation:
        raw.send(printed(line))
        assert raw.frame().hex(" ") == answer.hex(" "), line


def test_section_3_3_is_answered_as_printed(raw: RawClient, device: VirtualRC8) -> None:
    conversation = [
        (251, printed(262)),  # Controller_Connect -> 2
        (661, printed(671)),  # Controller_GetRobot Arm -> 3
        (684, printed(694)),  # Takearm (0, 1)
        (723, printed(730)),  # Motor (1, 0)
        (760, printed(769)),  # Move 1, P1, NEXT
        (776, printed(783)),  # Halt
        (738, printed(748)),  # Motor (0, 0)
        (702, printed(711)),  # Givearm
        (820, printed(830)),  # ClearError
        (794, empty_reply(11)),  # Robot_Release
    ]
    for line, answer in conversation:
        raw.send(printed(line))
        assert equal_except_serial(raw.frame(), answer), line
    assert not device.state.arm.motor.on


def test_every_printed_pair_of_both_sections_is_used() -> None:
    """Check that the tests above omit no packet."""
    lines = {v["line"] for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and 480 < v["line"] < 960}
    assert lines == {
        493, 503, 515, 524, 533, 539, 551,
        661, 671, 684, 694, 702, 711, 723, 730, 738, 748, 760, 769, 776, 783, 794, 820, 830,
    }  # fmt: skip


def test_list_3_2(raw: RawClient, device: VirtualRC8) -> None:
    """Run task Pro1 continuously, then stop it at the end of its cycle, as bCapTask.c does."""
    motor_on(device)
    assert raw.ask(SERVICE_START) is None
    controller = raw.ask(CONNECT, *CONTROLLER)
    task = raw.ask(GET_TASK, controller, "Pro1", "")
    assert raw.ask(TASK_START, task, 2, "") is None
    assert device.state.running_programs == 1
    assert raw.ask(TASK_STOP, task, 3, "") is None
    assert raw.ask(TASK_RELEASE, task) is None
    assert raw.ask(DISCONNECT, controller) is None
    assert raw.ask(SERVICE_STOP) is None


def test_list_3_3(raw: RawClient, device: VirtualRC8) -> None:
    """Move to P1, with every parameter as a BSTR, as bCapRobot.c does."""
    assert raw.ask(SERVICE_START) is None
    controller = raw.ask(CONNECT, *CONTROLLER)
    robot = raw.ask(GET_ROBOT, controller, "Arm", "")
    for command, parameter in (("Takearm", ""), ("Motor", "1")):
        assert raw.ask(ROBOT_EXECUTE, robot, command, parameter) is None, command
    assert raw.ask(ROBOT_MOVE, robot, 1, "P1", "") is None
    assert device.state.arm.space.position(device.state.arm.queue.joints) == pytest.approx(P1, abs=1e-4)
    for command, parameter in (("Motor", "0"), ("Givearm", "")):
        assert raw.ask(ROBOT_EXECUTE, robot, command, parameter) is None, command
    assert raw.ask(ROBOT_RELEASE, robot) is None
    assert raw.ask(DISCONNECT, controller) is None
    assert raw.ask(SERVICE_STOP) is None


def test_s_executing_during_a_long_move() -> None:
    """With WDT=100, a Move without NEXT is answered at its end, and S_EXECUTING is sent meanwhile (RC8 table 3-1)."""
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, RawClient(server.url) as raw:
        assert raw.ask(SERVICE_START, "WDT=100") is None
        controller = raw.ask(CONNECT, *CONTROLLER)
        robot = raw.ask(GET_ROBOT, controller, "Arm", "")
        assert raw.ask(ROBOT_EXECUTE, robot, "TakeArm", [0, 0]) is None
        serial = raw.request(ROBOT_MOVE, robot, 1, "J(60, 45, 90, 0, 45, 0)", "TIME=20000")
        for seconds in (0.0, 10.0, 9.0):
            clock.advance(seconds)
            answer = raw.packet()
            assert (answer.serial, answer.code) == (serial, 0x900)
        clock.advance(2.0)
        while answer.code == 0x900:
            answer = raw.packet()
        assert (answer.serial, answer.code) == (serial, 0)
