"""The server over TCP, tested with raw bytes."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit.bcap import packet
from orinkit.bcap.call_queue import MOST_WAITING
from orinkit.bcap.packet import Packet
from orinkit.core import hresult
from orinkit.core.errors import ConnectFailed, ConnectionLost, InvalidAddress, TransportError
from orinkit.server.threaded import Server
from orinkit.values.codec import PacketLimits
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.devices import Call, Recorder, Workshop
from support.peers import Gone, RawClient
from support.waiting import until

START, STOP, CONNECT, DISCONNECT, GET_VARIABLE, EXECUTE = 1, 2, 3, 4, 9, 17
GET, PUT, RELEASE = 101, 102, 111
VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
PATIENCE = 30.0


pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve([workshop, VirtualRC8()], "tcp://127.0.0.1:0") as served:
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[RawClient]:
    with RawClient(server.url) as client:
        yield client


def open_workshop(client: RawClient) -> int:
    handle = client.ask(CONNECT, "", "Test.Workshop", "localhost", "")
    assert isinstance(handle, int)
    return handle


def execute(client: RawClient, handle: int, command: str, parameter: Any = None) -> int:
    return client.request(EXECUTE, handle, command, parameter)


# --- the packets of the document ------------------------------------------------------------------------------------


def printed(line: int) -> bytes:
    """Return a packet of the RC8 document by its line."""
    return next(bytes.fromhex(v["hex"]) for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and v["line"] == line)


def test_section_3_1_is_answered_as_printed(raw: RawClient) -> None:
    """RC8 3.1.1 to 3.1.5 on a new connection, byte for byte; if no complete reply is printed, S_OK without arguments."""
    ok = "0110000000{:02x}00000000000000000004"
    conversation = [
        (216, bytes.fromhex(ok.format(0))),  # Service_Start
        (236, bytes.fromhex(ok.format(1))),  # Service_Start WDT=400
        (251, printed(262)),  # Controller_Connect -> 2
        (270, printed(279)),  # Controller_GetVariable IO150 -> 3
        (291, printed(297)),  # Variable_GetValue -> FALSE
        (305, printed(312)),  # Variable_PutValue TRUE
        (324, bytes.fromhex(ok.format(6))),  # Variable_Release
        (338, bytes.fromhex(ok.format(7))),  # Controller_Disconnect
        (354, bytes.fromhex(ok.format(8))),  # Service_Stop
    ]
    for line, answer in conversation:
        raw.send(printed(line))
        assert raw.frame().hex(" ") == answer.hex(" "), line


def test_every_printed_pair_of_section_3_1_is_in_the_conversation() -> None:
    """Check that the test above omits no packet of 3.1. 378/387 is the @MODE sample of 3.1.6."""
    lines = {v["line"] for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and v["line"] < 400}
    assert lines == {216, 236, 251, 262, 270, 279, 291, 297, 305, 312, 324, 338, 354, 378, 387}


def test_the_mode_sample_is_answered_as_printed(raw: RawClient) -> None:
    """RC8 3.1.6; the printed reply to serial 2 has serial 3, so the request's serial is expected here."""
    raw.send(printed(251))
    assert raw.frame() == printed(262)
    raw.send(printed(378))
    answer = packet.decode(raw.frame())
    wanted = packet.decode(printed(387))
    assert (answer.code, answer.arguments, answer.serial) == (wanted.code, wanted.arguments, 2)
    assert raw.ask(GET, 3) in (1, 2, 3)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 16, 1000])
def test_the_conversation_in_pieces_of_any_size(raw: RawClient, size: int) -> None:
    stream = b"".join(printed(line) for line in (236, 251, 270, 291, 305, 324, 338, 354))
    for begin in range(0, len(stream), size):
        raw.send(stream[begin : begin + size])
    answers = [raw.packet() for _ in range(8)]
    assert [answer.serial for answer in answers] == [1, 1, 3, 4, 5, 6, 7, 8]
    assert {answer.code for answer in answers} == {0}


def test_the_reserved_field_of_replies_is_zero(raw: RawClient) -> None:
    raw.send(packet.encode(Packet(5, START, reserved=77)))
    answer = raw.packet()
    assert (answer.serial, answer.reserved, answer.code) == (5, 0, 0)


# --- pipelining, long calls, E_BUSY_PROC, time-outs -------------------------------------------------------------------


def test_pipelined_packets_are_answered_in_order(raw: RawClient) -> None:
    handle = open_workshop(raw)
    requests = [packet.encode(Packet(100 + n, EXECUTE, [handle, "Echo", f"{n}"])) for n in range(500)]
    raw.send(b"".join(requests))
    for number in range(500):
        answer = raw.packet()
        assert (answer.serial, answer.code, answer.arguments) == (100 + number, 0, [f"{number}"])


@pytest.mark.parametrize("command", ["Wait", "Block"])
def test_executing_is_reported_during_a_call(raw: RawClient, workshop: Workshop, command: str) -> None:
    assert raw.ask(START, "WDT=100") is None
    handle = open_workshop(raw)
    serial = execute(raw, handle, command, "done")
    for _ in range(3):
        notice = raw.packet()
        assert (notice.serial, notice.code, notice.arguments) == (serial, hresult.S_EXECUTING, [])
    workshop.gate.set()
    answer = raw.packet()
    while answer.code == hresult.S_EXECUTING:
        assert answer.serial == serial
        answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (serial, 0, ["done"])
    for number in range(5):  # no S_EXECUTING after the reply
        assert raw.ask(EXECUTE, handle, "Echo", number) == number


def test_executing_is_not_reported_unless_asked_for(raw: RawClient, workshop: Workshop) -> None:
    handle = open_workshop(raw)
    serial = execute(raw, handle, "Wait", "done")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    with RawClient(raw_url(raw)) as clock:  # three S_EXECUTING of another client: at least 300 ms have passed
        assert clock.ask(START, "WDT=100") is None
        execute(clock, open_workshop(clock), "Wait")
        assert [clock.packet().code for _ in range(3)] == [hresult.S_EXECUTING] * 3
        workshop.gate.set()
        answer = raw.packet()
        assert (answer.serial, answer.code, answer.arguments) == (serial, 0, ["done"])


def raw_url(client: RawClient) -> str:
    host, port = client.socket.getpeername()
    return f"tcp://{host}:{port}"


def test_executing_is_not_reported_for_calls_that_are_answered_immediately(raw: RawClient) -> None:
    assert raw.ask(START, "WDT=81") is None
    handle = open_workshop(raw)
    raw.send(b"".join(packet.encode(Packet(n, EXECUTE, [handle, "Echo", n])) for n in range(1, 2000)))
    assert [raw.packet().code for _ in range(1, 2000)] == [0] * 1999


@pytest.mark.parametrize("option", ["WDT=79", "WDT=0", "WDT=-400", "InvokeTimeout=79", "Alive=x"])
def test_invalid_service_options_are_refused(raw: RawClient, option: str) -> None:
    assert raw.ask(START, option) == hresult.E_INVALIDARG
    assert raw.ask(START, "") is None


@pytest.mark.parametrize(
    "option",
    [
        "WDT=81",
        "wdt=400",
        ",WDT=400",
        "WDT=400,InvokeTimeout=180000",
        "Other=1",
        "WDT=0x190",
        " WDT = 400 ",
        "WDT=80",
        "WDT",
    ],
)
def test_service_options_in_their_forms(raw: RawClient, option: str) -> None:
    assert raw.ask(START, option) is None


@pytest.mark.guide("App. C two calls of one connection at a time")
def test_calls_of_one_connection_are_executed_in_order(raw: RawClient, workshop: Workshop) -> None:
    handle = open_workshop(raw)
    first = execute(raw, handle, "Wait", "first")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    serials = [execute(raw, handle, "Echo", number) for number in range(10)]
    stop = raw.request(STOP)
    workshop.gate.set()
    answers = [raw.packet() for _ in range(12)]
    assert [answer.serial for answer in answers] == [first, *serials, stop]
    assert [answer.arguments for answer in answers] == [["first"], *([number] for number in range(10)), []]


def test_blocking_and_waiting_calls_are_executed_in_order(raw: RawClient, workshop: Workshop) -> None:
    handle = open_workshop(raw)
    workshop.gate.set()
    serials = [execute(raw, handle, command, n) for n, command in enumerate(("Wait", "Block", "Echo", "Wait") * 5)]
    answers = [raw.packet() for _ in serials]
    assert [answer.serial for answer in answers] == serials
    assert [answer.arguments for answer in answers] == [[number] for number in range(20)]


def test_requests_that_wait_are_limited(raw: RawClient, workshop: Workshop) -> None:
    handle = open_workshop(raw)
    execute(raw, handle, "Wait", "first")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    serials = [execute(raw, handle, "Echo", number) for number in range(MOST_WAITING + 1)]
    answer = raw.packet()
    assert (answer.serial, answer.code) == (serials[-1], hresult.E_BUSY_PROC)
    workshop.gate.set()
    assert [raw.packet().code for _ in range(MOST_WAITING + 1)] == [0] * (MOST_WAITING + 1)


def test_waiting_requests_of_a_client_that_disconnects_are_not_executed(
    raw: RawClient, server: Server, workshop: Workshop
) -> None:
    handle = open_workshop(raw)
    execute(raw, handle, "Wait", "first")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    execute(raw, handle, "Wait", "second")
    raw.close()
    until(lambda: server.clients == 0)
    workshop.gate.set()
    assert not workshop.at_work.acquire(timeout=0.05)


def test_busy_concerns_one_client_only(raw: RawClient, server: Server, workshop: Workshop) -> None:
    execute(raw, open_workshop(raw), "Block")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    with RawClient(server.url) as other:
        handle = open_workshop(other)
        assert other.ask(EXECUTE, handle, "Echo", 1) == 1
    workshop.gate.set()
    assert raw.packet().code == 0


@pytest.mark.parametrize("command", ["Wait", "Block"])
@pytest.mark.parametrize("option", ["InvokeTimeout=150", "WDT=100,InvokeTimeout=250"])
def test_a_call_longer_than_invoke_timeout(raw: RawClient, workshop: Workshop, command: str, option: str) -> None:
    """E_TIMEOUT once, then E_BUSY_PROC until the device has finished; its late result is dropped."""
    assert raw.ask(START, option) is None
    handle = open_workshop(raw)
    serial = execute(raw, handle, command, "late")
    answer = raw.packet()
    while answer.code == hresult.S_EXECUTING:
        assert "WDT" in option
        answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (serial, hresult.E_TIMEOUT, [None])
    assert raw.ask(EXECUTE, handle, "Echo", 1) == hresult.E_BUSY_PROC
    workshop.gate.set()
    while (result := raw.ask(EXECUTE, handle, "Echo", 2)) == hresult.E_BUSY_PROC:
        pass
    assert result == 2


def test_the_servers_own_time_limit(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", invoke_timeout=0.1) as server, RawClient(server.url) as raw:
        serial = execute(raw, open_workshop(raw), "Wait")
        answer = raw.packet()
        assert (answer.serial, answer.code) == (serial, hresult.E_TIMEOUT)


@pytest.mark.parametrize("command", ["Crash", "CrashLater", "CrashBlocking"])
def test_an_exception_in_the_device_is_answered_and_logged(
    raw: RawClient, caplog: pytest.LogCaptureFixture, command: str
) -> None:
    handle = open_workshop(raw)
    assert raw.ask(EXECUTE, handle, command, None) == hresult.E_FAIL
    assert raw.ask(EXECUTE, handle, "Echo", "alive") == "alive"
    assert [record.levelno for record in caplog.records if record.exc_info] == [logging.ERROR]
    caplog.clear()


# --- invalid requests -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "arguments", "code"),
    [
        (0, [], hresult.E_NOTIMPL),
        (138, [], hresult.E_NOTIMPL),
        (0xFFFFFFFF, [1, 2, 3], hresult.E_NOTIMPL),
        (GET, [99], hresult.E_HANDLE),
        (GET, [-1], hresult.E_HANDLE),
        (GET, [0], hresult.E_HANDLE),
        (GET, [], hresult.E_INVALIDARG),
        (GET, [2, 2], hresult.E_INVALIDARG),
        (GET, ["2"], hresult.E_INVALIDARGTYPE),
        (GET, [2], hresult.E_HANDLE),  # a controller's handle, not a variable's
        (GET_VARIABLE, [2, 5, ""], hresult.E_INVALIDARGTYPE),
        (CONNECT, ["", "No.Such.Provider", "", ""], hresult.E_CAO_PROV_INVALID),
        (START, [400], hresult.E_INVALIDARGTYPE),
    ],
)
def test_the_codes_of_invalid_requests(raw: RawClient, function: int, arguments: list[Any], code: int) -> None:
    handle = open_workshop(raw)
    assert handle == 2
    assert raw.ask(function, *arguments) == code
    assert raw.ask(EXECUTE, handle, "Echo", "alive") == "alive"


@pytest.mark.parametrize(
    ("count", "body"),
    [
        (1, ""),
        (1, "0a000000030001000000"),
        (2, "0a00000003000100000002000000"),
        (1, "ffffffff03000100000002000000"),
        (1, "0a0000000300ffffffff02000000"),
        (1, "0a00000063000100000002000000"),
        (65535, "0a00000003000100000002000000"),
    ],
)
def test_a_packet_with_invalid_content_is_answered_and_the_connection_stays_open(
    raw: RawClient, count: int, body: str
) -> None:
    raw.send(packet.pack(9, GET, count, bytes.fromhex(body)))
    answer = raw.packet()
    assert answer.serial == 9
    assert hresult.family(answer.code) is hresult.CodeFamily.PACKET
    assert raw.ask(START) is None


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (bytes.fromhex("010000000001000000010000000000") + b"\x04", hresult.E_INVALIDRCVPACKET),
        (bytes.fromhex("010f0000000100000001000000000004"), hresult.E_INVALIDRCVPACKET),
        (bytes.fromhex("0110000000010000000100000000 00 05"), hresult.E_INVALIDRCVPACKET),
        (bytes.fromhex("01ffffffff") + bytes(20), hresult.E_PACKETSIZEOVER),
        (bytes.fromhex("0101000001") + bytes(20), hresult.E_PACKETSIZEOVER),
    ],
)
def test_a_stream_without_packet_boundary_receives_a_code_and_is_closed(
    raw: RawClient, server: Server, data: bytes, code: int
) -> None:
    raw.send(data)
    answer = raw.packet()
    assert (answer.serial, answer.code) == (0, code)
    assert raw.ended()
    with RawClient(server.url) as other:
        assert other.ask(START) is None


def test_a_packet_longer_than_the_servers_limit(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "tcp://127.0.0.1:0", limits=PacketLimits(packet=1000)) as server,
        RawClient(server.url) as raw,
    ):
        handle = open_workshop(raw)
        assert raw.ask(EXECUTE, handle, "Echo", "x" * 400) == "x" * 400
        assert raw.ask(EXECUTE, handle, "Large", 2000) == hresult.E_TOO_MUCH_DATA
        assert raw.ask(EXECUTE, handle, "Echo", 1) == 1
        raw.request(EXECUTE, handle, "Echo", "x" * 1000)
        assert raw.packet().code == hresult.E_PACKETSIZEOVER
        assert raw.ended()


# --- limits on clients and memory -------------------------------------------------------------------------------------


def test_one_client_too_many_receives_a_code(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", clients=3) as server:
        clients = [RawClient(server.url) for _ in range(3)]
        for client in clients:
            open_workshop(client)
        for _ in range(3):
            with RawClient(server.url) as extra:
                extra.send(packet.encode(Packet(7, START)) * 10)
                answer = extra.packet()
                assert (answer.serial, answer.code) == (7, hresult.E_MAX_CONNECT)
                with pytest.raises((Gone, ConnectionError)):
                    extra.packet()
            assert server.clients == 3
        with pytest.raises(orinkit.CallError) as caught:
            orinkit.connect(server.url, provider="Test.Workshop")
        assert caught.value.code == hresult.E_MAX_CONNECT
        clients.pop().close()
        while True:  # until the server has detected the disconnection
            with RawClient(server.url) as late:
                if late.ask(START) is None:
                    break
        for client in clients:
            assert client.ask(START) is None
            client.close()


def test_the_server_stops_reading_from_a_client_that_never_reads(server: Server) -> None:
    """Its replies are buffered only up to the size of the buffers; then the server stops reading its requests."""
    with RawClient(server.url, receive_buffer=4096) as greedy, RawClient(server.url) as other:
        theirs, mine = open_workshop(greedy), open_workshop(other)
        request = packet.encode(Packet(1, EXECUTE, [theirs, "Large", 60_000]))
        greedy.socket.settimeout(0.5)
        sent = 0
        with pytest.raises(TimeoutError):
            while sent < 500_000 * len(request):  # the replies would have 30 GB
                sent += greedy.socket.send(request * 100)
        for number in range(100):
            assert other.ask(EXECUTE, mine, "Echo", number) == number
    assert sent > 0


def test_a_client_that_reads_late_receives_every_reply_in_order(server: Server, workshop: Workshop) -> None:
    with RawClient(server.url, receive_buffer=4096) as slow:
        handle = open_workshop(slow)
        answers: list[tuple[int, int]] = []
        go = threading.Event()

        def read() -> None:
            go.wait(PATIENCE)
            for _ in range(600):
                answer = slow.packet()
                answers.append((answer.serial, len(answer.arguments[0])))

        reader = threading.Thread(target=read)
        reader.start()
        slow.socket.settimeout(PATIENCE)
        for number in range(1, 601):
            slow.send(packet.encode(Packet(number, EXECUTE, [handle, "Large", 20_000 + number])))
            if number == 300:
                go.set()
        reader.join(PATIENCE)
        assert answers == [(number, 20_000 + number) for number in range(1, 601)]


def test_half_a_packet_and_then_silence(server: Server, workshop: Workshop) -> None:
    request = packet.encode(Packet(1, CONNECT, ["", "Test.Workshop", "localhost", ""]))
    silent = [RawClient(server.url) for _ in range(20)]
    for number, client in enumerate(silent):
        client.send(request[: 1 + number * (len(request) - 1) // 20])
    with RawClient(server.url) as other:
        handle = open_workshop(other)
        assert other.ask(EXECUTE, handle, "Echo", 1) == 1
    for number, client in enumerate(silent):  # the other half is still accepted
        client.send(request[1 + number * (len(request) - 1) // 20 :])
        assert client.packet().arguments == [2]
        client.close()


# --- clients that disconnect ------------------------------------------------------------------------------------------


def test_objects_are_released_newest_first_when_the_client_disconnects() -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, "tcp://127.0.0.1:0") as server:
        with RawClient(server.url) as raw:
            controller = raw.ask(CONNECT, "RC", "Test.Recorder", "", "")
            robot = raw.ask(7, controller, "Arm", "")
            raw.ask(GET_VARIABLE, controller, "a", "")
            raw.ask(62, robot, "b", "")
        assert recorder.wait_for(Call("Controller_Disconnect", "RC", ()))
        assert [call.path for call in recorder.calls[-4:]] == ["RC/Arm/b", "RC/a", "RC/Arm", "RC"]


@pytest.mark.parametrize("how", ["close", "reset", "half closed"])
def test_an_async_handler_is_cancelled_when_its_client_disconnects(
    server: Server, workshop: Workshop, how: str
) -> None:
    raw = RawClient(server.url)
    handle = open_workshop(raw)
    raw.ask(GET_VARIABLE, handle, "v", "")
    execute(raw, handle, "Wait")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    if how == "half closed":
        raw.socket.shutdown(socket.SHUT_WR)
    elif how == "reset":
        raw.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
    if how != "half closed":
        raw.close()
    assert workshop.cancelled.acquire(timeout=PATIENCE)
    assert workshop.let_go.acquire(timeout=PATIENCE)
    raw.close()
    with RawClient(server.url) as other:
        assert other.ask(EXECUTE, open_workshop(other), "Echo", 1) == 1


def test_a_call_in_a_thread_continues_after_its_client_has_disconnected(server: Server, workshop: Workshop) -> None:
    raw = RawClient(server.url)
    execute(raw, open_workshop(raw), "Block")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    raw.close()
    with RawClient(server.url) as other:
        handle = open_workshop(other)
        while "Controller" not in workshop.released:
            assert other.ask(EXECUTE, handle, "Echo", 1) == 1
        workshop.gate.set()
        assert other.ask(EXECUTE, handle, "Block", 2) == 2


def test_an_object_created_for_a_disconnected_client_is_released(server: Server, workshop: Workshop) -> None:
    raw = RawClient(server.url)
    raw.request(GET_VARIABLE, open_workshop(raw), "slow", "")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    raw.close()
    with RawClient(server.url) as other:
        handle = open_workshop(other)
        while "Controller" not in workshop.released:
            assert other.ask(EXECUTE, handle, "Echo", 1) == 1
    workshop.gate.set()
    assert workshop.let_go.acquire(timeout=PATIENCE)
    until(lambda: len(workshop.released) == 3)
    assert (workshop.made, sorted(workshop.released)) == (["slow"], ["Controller", "Controller", "slow"])


# --- start and end of a server ----------------------------------------------------------------------------------------


def test_port_zero_selects_a_free_port(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0") as one, orinkit.serve(workshop, "tcp://127.0.0.1:0") as two:
        assert one.url != two.url
        assert one.url.startswith("tcp://127.0.0.1:")
        for server in (one, two):
            with RawClient(server.url) as raw:
                assert raw.ask(START) is None


def test_a_port_in_use(server: Server, workshop: Workshop) -> None:
    with pytest.raises(ConnectFailed, match=server.url.rpartition(":")[2]):
        orinkit.serve(Workshop(), server.url)
    with RawClient(server.url) as raw:
        assert raw.ask(START) is None


def test_if_one_address_fails_none_is_served(server: Server) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with pytest.raises(ConnectFailed):
        orinkit.serve(Workshop(), f"tcp://127.0.0.1:{free}", server.url)
    with orinkit.serve(Workshop(), f"tcp://127.0.0.1:{free}"):
        pass


def test_several_addresses_of_one_server(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", "127.0.0.1:0") as server:
        assert len(server.urls) == 2
        with RawClient(server.urls[0]) as one, RawClient(server.urls[1]) as two:
            assert one.ask(START) is None
            assert two.ask(START) is None
            assert server.clients == 2


@pytest.mark.parametrize("url", ["", "tcp://", "can://can0", "tcp://127.0.0.1:99999", "nonsense://x"])
def test_invalid_addresses(url: str) -> None:
    with pytest.raises(InvalidAddress):
        orinkit.serve(Workshop(), url)


def test_an_address_of_another_machine() -> None:
    with pytest.raises(ConnectFailed, match=r"192\.0\.2\.1"):
        orinkit.serve(Workshop(), "tcp://192.0.2.1:0")


def test_the_same_port_again_after_closing(workshop: Workshop) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0") as server:
        url = server.url
        raw = RawClient(url)
        assert raw.ask(START) is None
    with orinkit.serve(Workshop(), url), RawClient(url) as again:
        assert again.ask(START) is None
    raw.close()


def test_closing_disconnects_every_client(workshop: Workshop) -> None:
    server = orinkit.serve(workshop, "tcp://127.0.0.1:0", clients=20, per_address=20)
    clients = [RawClient(server.url) for _ in range(20)]
    for client in clients:
        client.ask(GET_VARIABLE, open_workshop(client), "v", "")
    refused = RawClient(server.url)
    half = clients[0]
    half.send(b"\x01\x20\x00")
    for client in clients[1:4]:
        execute(client, 2, "Wait")
    for client in clients[4:7]:
        execute(client, 2, "Tidy")
    for _ in range(6):
        assert workshop.at_work.acquire(timeout=PATIENCE)
    server.close()
    for _ in range(6):
        assert workshop.cancelled.acquire(timeout=PATIENCE)
    for client in [*clients, refused]:
        assert client.ended()
        client.close()
    assert workshop.released.count("v") == 20
    assert workshop.closed == 1
    server.close()
    assert workshop.closed == 1
    with pytest.raises(ConnectFailed):
        orinkit.open_client(server.url)


def test_closing_during_a_call_in_a_thread(workshop: Workshop) -> None:
    """The thread cannot be stopped; closing waits for it for a short time only."""
    server = orinkit.serve(workshop, "tcp://127.0.0.1:0")
    raw = RawClient(server.url)
    execute(raw, open_workshop(raw), "Block")
    assert workshop.at_work.acquire(timeout=PATIENCE)
    server.close()
    assert raw.ended()
    raw.close()


def test_closing_with_a_client_that_never_reads(server: Server, workshop: Workshop) -> None:
    with RawClient(server.url, receive_buffer=4096) as greedy:
        handle = open_workshop(greedy)
        greedy.socket.settimeout(0.3)
        with pytest.raises(TimeoutError):
            while True:
                greedy.send(packet.encode(Packet(1, EXECUTE, [handle, "Large", 60_000])) * 100)
        server.close()
    assert workshop.released == ["Controller"]


def test_closing_while_clients_connect(workshop: Workshop) -> None:
    for _ in range(10):
        server = orinkit.serve(Workshop(), "tcp://127.0.0.1:0")
        clients = [RawClient(server.url) for _ in range(10)]
        server.close()
        for client in clients:
            assert client.ended()
            client.close()


def test_a_client_of_a_closed_server_receives_an_error(workshop: Workshop) -> None:
    server = orinkit.serve(workshop, "tcp://127.0.0.1:0")
    controller = orinkit.connect(server.url, provider="Test.Workshop", timeout=PATIENCE)
    server.close()
    with pytest.raises(ConnectionLost):
        controller.execute("Echo", 1)
    with pytest.raises(TransportError):
        controller.execute("Echo", 1)
    controller.close()


def test_with_closes_the_server_also_after_an_exception(workshop: Workshop) -> None:
    with pytest.raises(RuntimeError, match="trouble"), orinkit.serve(workshop, "tcp://127.0.0.1:0") as server:
        raise RuntimeError("trouble")
    assert workshop.closed == 1
    with pytest.raises(ConnectFailed):
        orinkit.open_client(server.url)


def test_wait_ends_when_another_thread_closes(workshop: Workshop) -> None:
    server = orinkit.serve(workshop, "tcp://127.0.0.1:0")
    server.wait(0.01)
    threading.Timer(0.05, server.close).start()
    server.wait(PATIENCE)
    with pytest.raises(ConnectFailed):
        orinkit.open_client(server.url)


def test_the_async_server(workshop: Workshop) -> None:
    async def body() -> None:
        async with aio.serve(workshop, "tcp://127.0.0.1:0") as server:
            async with aio.connect(server.url, provider="Test.Workshop") as controller:
                assert await controller.execute("Echo", "hello") == "hello"
                assert server.clients == 1
            with pytest.raises(ConnectFailed):
                await aio.serve(Workshop(), server.url).start()
        assert workshop.closed == 1
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(body())


# --- beyond ASCII -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["変数１２３", "äöü ß €", "🤖🦾", "\u202etfel", "a\x00b", "\ufeff", "", " ", "x" * 1000, "ー" * 1000]
)
def test_any_text_anywhere(text: str) -> None:
    recorder = Recorder()
    recorder.provider_names = (f"Test.{text.strip() or 'empty'}",)
    with orinkit.serve(recorder, "tcp://127.0.0.1:0") as server:
        with orinkit.connect(
            server.url, provider=recorder.provider_names[0], name=f"RC{text}", option=text
        ) as controller:
            variable = controller.variable(text, text)
            variable.value = text
            variable.tag = [text[:10_000]] * 2  # at most 64 KiB are stored
            controller.execute(text, text)
            assert text in controller.name
        assert Call("Controller_GetVariable", f"RC{text}", (text, text)) in recorder.calls
        assert Call("Variable_PutValue", f"RC{text}/{text}", (text,)) in recorder.calls
        assert Call("Variable_PutTag", f"RC{text}/{text}", ([text[:10_000]] * 2,)) in recorder.calls
        assert Call("Controller_Execute", f"RC{text}", (text, text)) in recorder.calls


def test_half_a_surrogate_pair_does_no_harm(raw: RawClient) -> None:
    """A BSTR that is not valid text: d800 alone. It is refused or returned unchanged."""
    handle = open_workshop(raw)
    body = bytes.fromhex("0a0000000300010000000200000012000000080001000000080000004500630068006f00")
    broken = bytes.fromhex("0c000000080001000000020000 0000d8")
    raw.send(packet.pack(9, EXECUTE, 3, body + broken))
    answer = raw.frame()
    assert answer.endswith(bytes.fromhex("0000d804")) or packet.decode(answer).code >= 0x80000000
    assert raw.ask(EXECUTE, handle, "Echo", "alive") == "alive"
