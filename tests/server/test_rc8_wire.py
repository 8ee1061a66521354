"""The virtual RC8 on the wire, as published programs use it: forms of replies, sizes, names of controllers, order of calls."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import orinkit
from orinkit import J
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE
from orinkit.cao.functions import BY_NAME
from orinkit.core import hresult
from orinkit.core.errors import AlreadyRegistered
from orinkit.server.threaded import Server
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.callers import SerialRaw, UdpRaw
from support.peers import RawClient
from support.waiting import until

VRC = "CaoProv.DENSO.VRC"
CONNECT, START, STOP, EXECUTE = (
    BY_NAME[name].id for name in ("Controller_Connect", "Service_Start", "Service_Stop", "Controller_Execute")
)
DISCONNECT, ROBOT, MOVE, HALT = (
    BY_NAME[name].id for name in ("Controller_Disconnect", "Controller_GetRobot", "Robot_Move", "Robot_Halt")
)
ROBOT_EXECUTE, VARIABLE, GET = (
    BY_NAME[name].id for name in ("Robot_Execute", "Controller_GetVariable", "Variable_GetValue")
)


@pytest.fixture
def rc8() -> VirtualRC8:
    return VirtualRC8(motor=True, samples=False)


@pytest.fixture
def server(rc8: VirtualRC8) -> Iterator[Server]:
    with orinkit.serve(rc8, "tcp://127.0.0.1:0", "udp://127.0.0.1:0") as served:
        yield served


def exact(raw: RawClient, function: int, *arguments: object) -> Packet:
    """Return the reply to a call, with the exact types of its arguments."""
    raw.request(function, *arguments)
    return packet.decode(raw.frame(), exact=True)


# --- forms of replies -------------------------------------------------------------------------------------------------


@pytest.mark.field("4.4")
@pytest.mark.guide("3.1.3 HRESULT rule")
def test_error_replies_carry_one_vt_empty(server: Server) -> None:
    with RawClient(server.urls[0]) as raw:
        handle = raw.ask(CONNECT, "", VRC, "", "")
        for call in (
            (VARIABLE, handle, "nothing", ""),
            (GET, 99),
            (BY_NAME["Variable_PutValue"].id, 99, 1),
            (200,),
            (EXECUTE, 5),
        ):
            answer = exact(raw, *call)
            assert answer.code >= 0x8000_0000
            assert answer.arguments == [Variant(VarType.EMPTY)]


@pytest.mark.field("4.5")
def test_command_execute_has_a_result(server: Server) -> None:
    with RawClient(server.urls[0]) as raw:
        handle = raw.ask(CONNECT, "", VRC, "", "")
        command = raw.ask(BY_NAME["Controller_GetCommand"].id, handle, "ClearError", "")
        answer = exact(raw, BY_NAME["Command_Execute"].id, command, 0)
        assert (answer.code, answer.arguments) == (0, [Variant(VarType.EMPTY)])
        assert exact(raw, BY_NAME["Command_Release"].id, command).arguments == []
    with orinkit.connect(server.urls[0]) as controller:
        assert controller.command("ClearError").execute() is None


@pytest.mark.field("3.4")
@pytest.mark.guide("5.2.8 get_FileNames", "5.2.9 get_TaskNames", "5.2.10 get_VariableNames")
def test_names_are_arrays_of_strings_also_if_there_are_none(server: Server, rc8: VirtualRC8) -> None:
    names = ("Controller_GetTaskNames", "Controller_GetFileNames")
    with RawClient(server.urls[0]) as raw:
        handle = raw.ask(CONNECT, "", VRC, "", "")
        for name in names:
            assert exact(raw, BY_NAME[name].id, handle, "").arguments == [Variant(VarType.BSTR | ARRAY, [])]
        rc8.state.files.write("Pro1.pcs", b"Sub Main\nEnd Sub\n")
        assert raw.ask(BY_NAME[names[0]].id, handle, "") == ["Pro1"]
        assert raw.ask(BY_NAME[names[1]].id, handle, "") == ["Pro1.pcs"]
        (variables,) = exact(raw, BY_NAME["Controller_GetVariableNames"].id, handle, "").arguments
        assert variables.type == VarType.BSTR | ARRAY
        assert {"I*", "IO*", "@MODE"} <= set(variables.value)


# --- sizes ------------------------------------------------------------------------------------------------------------


@pytest.mark.field("4.1")
def test_503_bytes_over_udp(server: Server) -> None:
    raw = UdpRaw(server.urls[1])
    handle = raw.ask(CONNECT, "", VRC, "", "")
    variable = raw.ask(VARIABLE, handle, "S1", "")
    tag = BY_NAME["Variable_PutTag"].id
    request = packet.encode(Packet(0, tag, [variable, b""]))
    for extra, code in (
        (DATAGRAM.packet - len(request), None),
        (DATAGRAM.packet - len(request) + 1, hresult.E_PACKETSIZEOVER),
    ):
        data = packet.encode(Packet(0, tag, [variable, bytes(extra)]))
        assert len(data) == (503 if code is None else 504)
        assert raw.ask(tag, variable, bytes(extra)) == code
    assert raw.ask(BY_NAME["Controller_GetVariableNames"].id, handle, "") == hresult.E_TOO_MUCH_DATA
    raw.close()


@pytest.mark.field("4.2")
@pytest.mark.parametrize(("limit", "fits"), [(503, False), (65536, True)])
def test_long_replies_on_a_serial_line(rc8: VirtualRC8, limit: int, fits: bool) -> None:
    with orinkit.serve(rc8, "pty://", serial_packet=limit) as server:
        raw = SerialRaw(server.url)
        handle = raw.ask(CONNECT, "", VRC, "", "")
        names = raw.ask(BY_NAME["Controller_GetVariableNames"].id, handle, "")
        assert (isinstance(names, list) and len(names) > 20) if fits else names == hresult.E_TOO_MUCH_DATA
        raw.close()
    with pytest.raises(orinkit.InvalidValue, match="serial_packet must be 128 to 65536, not 100"):
        orinkit.serve(rc8, "pty://", serial_packet=100)


# --- slow calls -------------------------------------------------------------------------------------------------------


@pytest.mark.field("4.3")
def test_a_client_requests_s_executing_on_serial_lines(rc8: VirtualRC8) -> None:
    packets: list[Packet] = []

    def trace(direction: str, data: bytes) -> None:
        if direction == "<":
            packets.append(packet.decode(data, crc=True))

    with orinkit.serve(rc8, "pty://") as server, orinkit.connect(server.url, trace=trace, tries=1) as controller:
        robot = controller.robot()
        with robot.arm():
            robot.move(J(60, 45, 90, 0, 45, 0), speed=20)
    assert any(each.code == hresult.S_EXECUTING for each in packets)


@pytest.mark.field("4.8")
def test_motor_of_the_ve026a_is_reported_while_it_executes() -> None:
    """A client with the usual time-outs of the C library, which sends WDT=400."""
    with orinkit.serve(VirtualVE026A(motor_seconds=1.0), "pty://") as server:
        raw = SerialRaw(server.url)
        assert raw.ask(START, "WDT=100") is None
        handle = raw.ask(CONNECT, "", "", "", "")
        robot = raw.ask(ROBOT, handle, "", "")
        serial = raw.request(ROBOT_EXECUTE, robot, "Motor", Variant(VarType.I2, 1))
        seen = []
        while not seen or seen[-1].code == hresult.S_EXECUTING:
            seen.append(raw.packet())
        assert len(seen) > 3
        assert (seen[-1].serial, seen[-1].code) == (serial, 0)
        raw.close()


@pytest.mark.field("4.7")
def test_calls_at_long_intervals(server: Server) -> None:
    with RawClient(server.urls[0]) as raw:
        handle = raw.ask(CONNECT, "", VRC, "", "")
        for _ in range(3):
            until(lambda: True)
            assert raw.ask(BY_NAME["Controller_GetName"].id, handle) == "Controller1"


@pytest.mark.field("4.9")
def test_the_reply_to_a_malformed_packet_on_a_serial_line_is_transmitted() -> None:
    with orinkit.serve(VirtualVE026A(), "pty://") as server:
        raw = SerialRaw(server.url)
        for number in range(30):
            assert raw.ask(START) is None
            handle = raw.ask(CONNECT, "", "", "", "")
            serial = 1000 + number
            whole = bytearray(packet.encode(Packet(serial, VARIABLE, [handle, "@VERSION", ""], serial), crc=True))
            whole[15] = 200  # length of the first argument
            whole[-3:-1] = packet.checksum(bytes(whole[1:-3])).to_bytes(2, "little")
            raw.send(bytes(whole))
            answer = raw.packet()
            assert (answer.serial, answer.code) == (serial, hresult.E_INVALIDRCVPACKET)
            assert raw.ask(GET, 1) == hresult.E_HANDLE, "the client has been disconnected"
        raw.close()


@pytest.mark.field("4.6")
@pytest.mark.parametrize("option", ["WDT=80", "WDT=infinite"])
def test_wdt_as_real_controllers_read_it(server: Server, option: str) -> None:
    with RawClient(server.urls[0]) as raw:
        assert raw.ask(START, option) is None
    with orinkit.serve(VirtualRC8(strict=True), "tcp://127.0.0.1:0") as strict, RawClient(strict.url) as raw:
        assert raw.ask(START, option) == hresult.E_INVALIDARG


# --- order of calls -----------------------------------------------------------------------------------------------------


@pytest.mark.guide("App. C two calls of one connection at a time")
def test_a_query_during_a_motion_waits_and_halt_does_not(server: Server, rc8: VirtualRC8) -> None:
    with RawClient(server.urls[0]) as raw:
        robot = raw.ask(ROBOT, raw.ask(CONNECT, "", VRC, "", ""), "Arm", "")
        raw.ask(ROBOT_EXECUTE, robot, "TakeArm", [0, 0])
        move = raw.request(MOVE, robot, 1, "J(170, 45, 90, 0, 45, 0)", "S=1")
        until(lambda: rc8.state.arm.queue.joints[0] > 1)
        query = raw.request(ROBOT_EXECUTE, robot, "CurJnt")
        again = raw.request(MOVE, robot, 1, "J(-170, 45, 90, 0, 45, 0)", "S=1")
        halt = raw.request(HALT, robot, "")
        answers = {answer.serial: answer for answer in (raw.packet() for _ in range(4))}
        assert answers[halt].code == 0
        assert answers[move].code == hresult.STOPPED_DURING_PC_MOTION
        assert answers[again].code == hresult.E_ABORT
        assert 0 < answers[query].arguments[0][0] < 170
        assert not rc8.state.arm.busy


# --- names of controllers -----------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.1, 5.2.1.1 name of AddController", "5.2.7 get_Name")
def test_a_name_is_unique_over_all_clients(server: Server) -> None:
    with RawClient(server.urls[0]) as one, RawClient(server.urls[0]) as other:
        handle = one.ask(CONNECT, "RC8", VRC, "", "")
        assert one.ask(BY_NAME["Controller_GetName"].id, handle) == "RC8"
        assert other.ask(CONNECT, "rc8", VRC, "", "") == hresult.E_CAO_COLLECTION_REGISTERED
        assert other.ask(CONNECT, "RC8-2", VRC, "", "") > 0
        one.ask(DISCONNECT, handle)
        assert other.ask(CONNECT, "rc8", VRC, "", "") > 0
    with orinkit.connect(server.urls[0], name="A"), pytest.raises(AlreadyRegistered):
        orinkit.connect(server.urls[0], name="a")


@pytest.mark.guide("5.2.1 options, @IfNotMember, empty name")
def test_if_not_member_and_an_empty_name(server: Server) -> None:
    with RawClient(server.urls[0]) as one, RawClient(server.urls[0]) as other:
        handle = one.ask(CONNECT, "RC8", VRC, "", "@IfNotMember")
        assert one.ask(CONNECT, "rc8", VRC, "", "@IfNotMember") == handle
        shared = other.ask(CONNECT, "RC8", VRC, "", "@IfNotMember")
        assert shared > 0
        one.ask(DISCONNECT, handle)
        assert one.ask(CONNECT, "RC8", VRC, "", "") == hresult.E_CAO_COLLECTION_REGISTERED, "the other client has it"
        names = [raw.ask(BY_NAME["Controller_GetName"].id, raw.ask(CONNECT, "", VRC, "", "")) for raw in (one, other)]
        assert names == ["Controller1", "Controller2"]


def test_a_name_is_free_after_the_end_of_a_connection(server: Server) -> None:
    for _ in range(20):
        with RawClient(server.urls[0]) as raw:
            assert raw.ask(CONNECT, "RC8", VRC, "", "") > 0
        until(lambda: server.clients == 0)


def test_a_client_on_udp_may_start_again(server: Server) -> None:
    raw = UdpRaw(server.urls[1])
    other = UdpRaw(server.urls[1])
    for _ in range(3):
        assert raw.ask(START, "WDT=400") is None
        assert raw.ask(CONNECT, "RC8", VRC, "", "") > 0
        assert other.ask(CONNECT, "RC8", VRC, "", "") == hresult.E_CAO_COLLECTION_REGISTERED
    assert raw.ask(STOP) is None
    assert other.ask(CONNECT, "RC8", VRC, "", "") > 0
    for each in (raw, other):
        each.close()


def test_the_profiles_of_lossy_transports() -> None:
    assert (DATAGRAM.packet, LINE.packet, LINE.uses_watchdog) == (503, 65536, True)
