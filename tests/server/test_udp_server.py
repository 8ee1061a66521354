"""The server over UDP, tested with raw datagrams."""

from __future__ import annotations

import asyncio
import gc
import inspect
import json
import logging
import random
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit.bcap import packet
from orinkit.bcap.duplicate_filter import MEMORY
from orinkit.bcap.packet import Packet
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import ConnectFailed
from orinkit.server import udp
from orinkit.server.connectionless import ConnectionlessClient
from orinkit.server.context import ServerContext
from orinkit.server.peer import Peer
from orinkit.server.threaded import Server
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.callers import CONNECT, EXECUTE, GET, GET_VARIABLE, PATIENCE, PUT, START, STOP, Counting, UdpRaw
from support.devices import Call, Recorder, Workshop
from support.leaping import LeapingLoop, leap
from support.peers import RawClient
from support.waiting import until

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
DESCRIPTORS = Path("/proc/self/fd")


pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def shop() -> Counting:
    return Counting()


@pytest.fixture
def server(shop: Counting) -> Iterator[Server]:
    with orinkit.serve([shop, VirtualRC8()], "udp://127.0.0.1:0") as served:
        yield served


@pytest.fixture
def raw(server: Server) -> Iterator[UdpRaw]:
    with UdpRaw(server.url) as client:
        yield client


@pytest.fixture
def long(monkeypatch: pytest.MonkeyPatch) -> float:
    """Set and return the time after which a client is dropped, s; it elapses only when a test advances the clock."""
    monkeypatch.setattr(udp, "IDLE_TIMEOUT", 1000.0)
    return 1000.0


# --- requests and answers ---------------------------------------------------------------------------------------------


def test_section_3_1_is_answered_as_printed(raw: UdpRaw) -> None:
    """RC8 3.1.1 to 3.1.5, byte for byte if a reply is printed; serial 1 occurs twice, for different calls."""
    printed = {
        v["line"]: bytes.fromhex(v["hex"]) for v in VECTORS if v["document"] == "bcap-rc8.ja.txt" and v["line"] < 400
    }
    for line, answered in ((236, None), (251, 262), (270, 279), (291, 297), (305, 312), (324, None), (338, None), (354, None)):  # fmt: skip
        raw.send(printed[line])
        answer = raw.packet()
        assert (answer.code, answer.reserved, answer.serial) == (0, 0, packet.decode(printed[line]).serial)
        if answered is not None:
            assert packet.encode(answer) == printed[answered] or answer.arguments == []


def test_a_request_that_arrives_twice_is_executed_once(raw: UdpRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    request = raw.encode(100, EXECUTE, handle, "Count", "a", reserved=100)
    for _ in range(5):
        raw.send(request)
    answers = [raw.packet() for _ in range(5)]
    assert [(answer.serial, answer.code, answer.arguments) for answer in answers] == [(100, 0, [1])] * 5
    assert shop.counts == ["a"]


def test_a_retry_is_answered_with_the_stored_answer_under_its_own_serial(raw: UdpRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    for serial in (100, 101, 102, 65535, 1):
        raw.request(EXECUTE, handle, "Count", "a", serial=serial, reserved=100)
        answer = raw.packet()
        assert (answer.serial, answer.reserved, answer.code, answer.arguments) == (serial, 0, 0, [1])
    raw.request(EXECUTE, handle, "Count", "a", serial=103, reserved=103)
    assert raw.packet().arguments == [2]
    assert shop.counts == ["a", "a"]


def test_an_old_client_with_reserved_field_0(raw: UdpRaw, shop: Counting) -> None:
    """It repeats a request with the same serial; the next serial is a different request."""
    handle = raw.open_workshop()
    for serial, count in ((100, 1), (100, 1), (102, 2), (102, 2), (104, 3)):
        raw.request(EXECUTE, handle, "Count", "same", serial=serial)
        assert raw.packet().arguments == [count]
    assert shop.counts == ["same"] * 3


def test_a_retry_of_an_executing_call_returns_s_executing(raw: UdpRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    raw.request(EXECUTE, handle, "CountLater", 1, serial=100, reserved=100)
    assert shop.at_work.acquire(timeout=PATIENCE)
    for serial in (101, 102, 103):
        raw.request(EXECUTE, handle, "CountLater", 1, serial=serial, reserved=100)
        answer = raw.packet()
        assert (answer.serial, answer.code) == (serial, hresult.S_EXECUTING)
    raw.request(EXECUTE, handle, "Count", 2, serial=104, reserved=104)
    shop.gate.set()
    answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (103, 0, [1])
    answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (104, 0, [2])
    raw.request(EXECUTE, handle, "CountLater", 1, serial=105, reserved=100)  # as if that reply had been lost
    answer = raw.packet()
    assert (answer.serial, answer.code, answer.arguments) == (105, 0, [1])
    assert shop.counts == [1, 2]


class RecordingTransport(asyncio.DatagramTransport):
    """A transport that records the packets sent.

    Attributes:
        packets: the packets sent.
    """

    def __init__(self) -> None:
        super().__init__()
        self.packets: list[Packet] = []

    def is_closing(self) -> bool:
        return False

    def sendto(self, data: Any, addr: Any = None) -> None:
        self.packets.append(packet.decode(bytes(data)))


def test_the_age_of_a_stored_reply_counts_from_the_end_of_its_call(shop: Counting) -> None:
    """A call takes longer than replies are stored; its request arrives again some time after the reply."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, LeapingLoop)
        endpoint, transport = (
            udp.UdpSocket(ServerContext(ProviderRegistry(shop), DEFAULT_LIMITS, 1, 180.0), loop),
            RecordingTransport(),
        )
        endpoint.connection_made(transport)

        def ask(serial: int, function: int, *arguments: Any) -> None:
            endpoint.datagram_received(packet.encode(Packet(serial, function, list(arguments))), ("127.0.0.1", 5))

        async def answer() -> Packet:
            async with asyncio.timeout(PATIENCE):
                while not transport.packets:  # noqa: ASYNC110 - there is no event to wait for
                    await asyncio.sleep(0)
            return transport.packets.pop()

        ask(1, CONNECT, "", "Test.Workshop", "", "")
        (handle,) = (await answer()).arguments
        ask(2, EXECUTE, handle, "CountLater", "a")
        await asyncio.sleep(0)
        loop.ahead += MEMORY
        shop.gate.set()
        assert await answer() == Packet(2, 0, [1])
        loop.ahead += MEMORY / 2
        ask(2, EXECUTE, handle, "CountLater", "a")
        assert await answer() == Packet(2, 0, [1])
        assert shop.counts == ["a"]
        endpoint.context.all.pop().close()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        runner.run(main())


@pytest.mark.parametrize("kind", [Peer, ConnectionlessClient])
def test_the_base_classes_of_connections_are_abstract(kind: type) -> None:
    assert inspect.isabstract(kind)


def test_executing_is_reported_with_wdt(raw: UdpRaw, shop: Counting) -> None:
    assert raw.ask(START, "WDT=100") is None
    serial = raw.request(EXECUTE, raw.open_workshop(), "Block", 7)
    for _ in range(3):
        notice = raw.packet()
        assert (notice.serial, notice.code) == (serial, hresult.S_EXECUTING)
    shop.gate.set()
    answer = raw.packet()
    while answer.code == hresult.S_EXECUTING:
        answer = raw.packet()
    assert (answer.serial, answer.arguments) == (serial, [7])


def test_a_reply_that_is_too_long_for_a_datagram(raw: UdpRaw) -> None:
    handle = raw.open_workshop()
    assert raw.ask(EXECUTE, handle, "Large", 477) == bytes(477)  # with the 10 bytes around them: 487
    assert raw.ask(EXECUTE, handle, "Large", 478) == hresult.E_TOO_MUCH_DATA
    assert raw.ask(EXECUTE, handle, "Echo", "alive") == "alive"


def test_the_device_receives_the_client_info(raw: UdpRaw, shop: Counting) -> None:
    raw.open_workshop()
    (visitor,) = shop.visitors
    assert (visitor.transport, visitor.address, visitor.port) == ("udp", "127.0.0.1", raw.port)
    handled = threading.Event()
    assert visitor.when_input_processed is not None
    visitor.when_input_processed(handled.set)
    assert handled.wait(PATIENCE)


# --- invalid requests ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\x01",
        b"\x04",
        b"GET / HTTP/1.1\r\n\r\n",
        bytes(2000),
        b"\xff" * 65507,
        packet.pack(1, START, 0, b"")[:-1],
        packet.pack(1, START, 0, b"")[1:],
        packet.pack(1, START, 0, b"") + b"\x04",
        packet.pack(1, START, 0, b"") * 2,
        b"\0" + packet.pack(1, START, 0, b""),
    ],
)
def test_invalid_datagrams_are_dropped_and_create_no_client(raw: UdpRaw, server: Server, datagram: bytes) -> None:
    raw.send(datagram)
    with UdpRaw(server.url) as other:
        assert other.ask(START) is None  # the first datagram has been handled
        assert server.clients == 1
    assert raw.ask(START) is None
    assert server.clients == 2


def test_every_truncation_of_a_request(raw: UdpRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    request = raw.encode(50, EXECUTE, handle, "Count", "x")
    for end in range(len(request)):
        raw.send(request[:end])
    assert raw.ask(EXECUTE, handle, "Echo", 1) == 1
    assert shop.counts == []


def test_refused_packets_create_no_client(server: Server) -> None:
    """Packets that are too long or have invalid content receive a reply, but no client is created."""
    for refused, code in (
        (packet.pack(7, EXECUTE, 1, bytes(489)), hresult.E_PACKETSIZEOVER),
        (packet.pack(7, EXECUTE, 1, b""), hresult.E_INVALIDRCVPACKET),
    ):
        with UdpRaw(server.url) as raw:
            raw.send(refused)
            answer = raw.packet()
            assert answer.serial == 7
            assert hresult.family(answer.code) is hresult.CodeFamily.PACKET or answer.code == code
            assert server.clients == 0


def test_corrupted_requests_do_not_affect_other_clients(server: Server) -> None:
    dice = random.Random(5)
    with UdpRaw(server.url) as raw, UdpRaw(server.url) as other:
        handle = other.open_workshop()
        for number in range(2000):
            request = bytearray(raw.encode(dice.randrange(1, 65536), dice.choice((1, 3, 9, 17, 101)), 2, "x", 3))
            for _ in range(dice.randrange(3)):
                request[dice.randrange(len(request))] = dice.randrange(256)
            raw.send(bytes(request))
            if number % 50 == 0:  # more would overflow the buffers of the sockets
                assert other.ask(EXECUTE, handle, "Echo", number) == number


# --- clients that connect and disconnect --------------------------------------------------------------------------------


def test_clients_are_identified_by_their_addresses(server: Server, shop: Counting) -> None:
    clients = [UdpRaw(server.url) for _ in range(20)]
    for number, raw in enumerate(clients):
        handle = raw.open_workshop()
        variable = raw.ask(GET_VARIABLE, handle, "v", "")
        assert raw.ask(PUT, variable, number) is None
    assert server.clients == 20
    for number, raw in enumerate(clients):
        assert raw.ask(GET, 3) == number
        raw.close()


def test_the_limit_on_clients_is_shared_with_tcp(shop: Counting) -> None:
    with orinkit.serve(shop, "tcp://127.0.0.1:0", "udp://127.0.0.1:0", clients=2) as server:
        tcp, udp_url = server.urls
        with RawClient(tcp) as one, UdpRaw(udp_url) as two, UdpRaw(udp_url) as three:
            assert one.ask(CONNECT, "", "Test.Workshop", "", "") == 2
            two.open_workshop()
            for _ in range(3):
                assert three.ask(START) == hresult.E_MAX_CONNECT
            with RawClient(tcp) as four:
                assert four.ask(START) == hresult.E_MAX_CONNECT
            assert server.clients == 2
            assert two.ask(STOP) is None
            assert server.clients == 1
            three.open_workshop()
            assert two.ask(START) == hresult.E_MAX_CONNECT
            assert server.clients == 2


def test_many_refused_clients_do_not_fill_the_log(
    shop: Counting, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orinkit.server.context._QUIET", 1000.0)
    caplog.set_level(logging.DEBUG, "orinkit.server")
    with orinkit.serve(shop, "udp://127.0.0.1:0", clients=1) as server, UdpRaw(server.url) as one:
        one.open_workshop()
        for _ in range(20):
            with UdpRaw(server.url) as other:
                assert other.ask(START) == hresult.E_MAX_CONNECT
    levels = [record.levelno for record in caplog.records if "refused" in record.getMessage()]
    assert (levels[0], set(levels[1:])) == (logging.WARNING, {logging.DEBUG})
    assert len(levels) == 12  # the warning, ten messages, and the number suppressed


def test_refusals_are_logged_again_after_a_while() -> None:
    async def levels() -> list[int]:
        connections = ServerContext(ProviderRegistry(Counting()), DEFAULT_LIMITS, 1, 3.0)
        return [connections.refusal_level(now) for now in (0.0, 9.9, 10.1, 20.0, 20.2)]

    warning, debug = logging.WARNING, logging.DEBUG
    assert asyncio.run(levels()) == [warning, debug, warning, debug, warning]


def test_service_stop_releases_everything_and_its_reply_is_stored(server: Server, raw: UdpRaw, shop: Counting) -> None:
    handle = raw.open_workshop()
    raw.ask(GET_VARIABLE, handle, "v", "")
    raw.request(STOP, serial=200, reserved=200)
    assert raw.packet().code == 0
    assert server.clients == 0
    assert shop.released == ["v", "Controller"]
    for serial in (200, 201, 202):  # the reply may have been lost
        raw.request(STOP, serial=serial, reserved=200)
        answer = raw.packet()
        assert (answer.serial, answer.code) == (serial, 0)
    assert server.clients == 0
    raw.request(GET, handle, serial=203, reserved=203)  # any call makes it a client again, without objects
    assert raw.packet().code == hresult.E_HANDLE
    assert server.clients == 1
    assert raw.open_workshop() == 2


def test_a_silent_client_is_dropped(long: float) -> None:
    recorder = Recorder()
    with orinkit.serve(recorder, "udp://127.0.0.1:0") as server, UdpRaw(server.url) as raw:
        controller = raw.ask(CONNECT, "RC", "Test.Recorder", "", "")
        robot = raw.ask(7, controller, "Arm", "")
        raw.ask(GET_VARIABLE, controller, "a", "")
        raw.ask(62, robot, "b", "")
        leap(server, long - PATIENCE)
        assert server.clients == 1
        leap(server, PATIENCE)
        assert recorder.wait_for(Call("Controller_Disconnect", "RC", ()))
        assert [call.path for call in recorder.calls[-4:]] == ["RC/Arm/b", "RC/a", "RC/Arm", "RC"]
        until(lambda: server.clients == 0)
        assert raw.ask(GET, robot) == hresult.E_HANDLE  # it may come back as a new client


def test_a_client_that_makes_calls_is_not_dropped(server: Server, shop: Counting, long: float) -> None:
    with UdpRaw(server.url) as busy, UdpRaw(server.url) as silent:
        handle = busy.open_workshop()
        for _ in range(3):
            assert silent.ask(START) is None
            assert server.clients == 2
            for _ in range(2):
                leap(server, long / 2)
                assert busy.ask(EXECUTE, handle, "Echo", 1) == 1
            assert server.clients == 1
        assert shop.released == []
    leap(server, long)
    assert server.clients == 0
    assert shop.released == ["Controller"]


def test_a_client_is_not_dropped_during_a_call(shop: Counting, long: float) -> None:
    """Its time starts again at the end of the call."""
    with orinkit.serve(shop, "udp://127.0.0.1:0", invoke_timeout=1e6) as server, UdpRaw(server.url) as patient:
        handle = patient.open_workshop()
        serial = patient.request(EXECUTE, handle, "Wait", "done")
        assert shop.at_work.acquire(timeout=PATIENCE)
        for _ in range(3):
            leap(server, long)
        shop.gate.set()
        answer = patient.packet()
        assert (answer.serial, answer.arguments) == (serial, ["done"])
        leap(server, long - PATIENCE)
        assert patient.ask(EXECUTE, handle, "Echo", 1) == 1
        assert shop.released == []
        leap(server, long)
        assert server.clients == 0


def test_stopped_clients_are_dropped_too(server: Server, long: float) -> None:
    with UdpRaw(server.url) as raw:
        assert raw.ask(STOP) is None
        assert len(known(server)) == 1
    leap(server, long)
    assert not known(server)


def test_the_number_of_stored_service_stops_is_limited(shop: Counting, long: float) -> None:
    """Any program can send Service_Stop from thousands of addresses within ten seconds."""
    with orinkit.serve(shop, "udp://127.0.0.1:0", clients=5) as server:
        for _ in range(50):
            with UdpRaw(server.url) as raw:
                assert raw.ask(START) is None
                assert raw.ask(STOP) is None
        assert server.clients == 0
        assert len(known(server)) == 5


def test_disconnected_clients_leave_nothing_behind(server: Server, shop: Counting, long: float) -> None:
    gc.collect()
    before = sum(isinstance(thing, (Session, udp.UdpClient)) for thing in gc.get_objects())
    last = UdpRaw(server.url)
    for number in range(200):
        raw = UdpRaw(server.url)
        last.close()  # not earlier: the next client might get its port, and E_BUSY_PROC because of its call
        handle = raw.open_workshop()
        raw.ask(GET_VARIABLE, handle, "v", "")
        if number % 3 == 0:
            raw.ask(STOP)
        elif number % 3 == 1:
            raw.request(EXECUTE, handle, "EchoLater", [number, 2])
        last = raw
    last.close()

    def all_are_dropped() -> bool:
        leap(server, long)
        return not known(server)

    until(all_are_dropped)
    assert server.clients == 0
    assert shop.released.count("v") == shop.released.count("Controller") == 200
    shop.visitors.clear()  # they refer to their clients
    gc.collect()
    assert sum(isinstance(thing, (Session, udp.UdpClient)) for thing in gc.get_objects()) == before


def known(server: Server) -> dict[Any, Any]:
    """Return the clients known to the first listener."""
    listener: Any = server._server._listeners[0]
    clients: dict[Any, Any] = listener._sockets[0]._clients
    return clients


def test_replies_are_dropped_while_the_socket_does_not_accept_data(server: Server, raw: UdpRaw) -> None:
    handle = raw.open_workshop()
    listener: Any = server._server._listeners[0]
    endpoint = listener._sockets[0]
    endpoint.pause_writing()  # called by asyncio normally
    raw.request(EXECUTE, handle, "Count", "x", serial=90, reserved=90)
    assert raw.nothing_comes()
    endpoint.resume_writing()
    raw.request(EXECUTE, handle, "Count", "x", serial=91, reserved=90)
    assert raw.packet().arguments == [1]


# --- start and end of a server ------------------------------------------------------------------------------------------


def test_port_zero_and_several_addresses(shop: Counting) -> None:
    with orinkit.serve(shop, "udp://127.0.0.1:0", "tcp://127.0.0.1:0", "udp:127.0.0.1:0") as server:
        assert [url.partition("://")[0] for url in server.urls] == ["udp", "tcp", "udp"]
        assert all(not url.endswith(":0") for url in server.urls)
        with UdpRaw(server.urls[0]) as one, UdpRaw(server.urls[2]) as two, RawClient(server.urls[1]) as three:
            assert [raw.ask(START) for raw in (one, two, three)] == [None] * 3
            assert server.clients == 3


def test_localhost_stands_for_all_its_addresses(shop: Counting) -> None:
    addresses = {(family, place[0]) for family, *_, place in socket.getaddrinfo("localhost", 0, type=socket.SOCK_DGRAM)}
    with orinkit.serve(shop, "udp://localhost:0") as server:
        for family, host in addresses:
            with UdpRaw(server.url, family, str(host)) as raw:
                assert raw.ask(START) is None


def test_a_port_in_use(server: Server, raw: UdpRaw) -> None:
    with pytest.raises(ConnectFailed, match=f"cannot listen on {server.url}"):
        orinkit.serve(Workshop(), server.url)
    assert raw.ask(START) is None


def test_an_address_of_another_machine() -> None:
    with pytest.raises(ConnectFailed, match=r"192\.0\.2\.1"):
        orinkit.serve(Workshop(), "udp://192.0.2.1:0")


def test_if_one_address_fails_none_is_served(server: Server) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with pytest.raises(ConnectFailed):
        orinkit.serve(Workshop(), f"tcp://127.0.0.1:{free}", f"udp://127.0.0.1:{free}", server.url)
    with orinkit.serve(Workshop(), f"udp://127.0.0.1:{free}", f"tcp://127.0.0.1:{free}"):
        pass


def test_closing_disconnects_every_client(shop: Counting) -> None:
    before = left_over()
    server = orinkit.serve(shop, "udp://127.0.0.1:0")
    clients = [UdpRaw(server.url) for _ in range(10)]
    for raw in clients:
        raw.ask(GET_VARIABLE, raw.open_workshop(), "v", "")
    for raw in clients[:3]:
        raw.request(EXECUTE, 2, "Wait")
    for raw in clients[3:6]:
        raw.request(EXECUTE, 2, "Tidy")
    clients[9].ask(STOP)
    for _ in range(6):
        assert shop.at_work.acquire(timeout=PATIENCE)
    url = server.url
    server.close()
    for _ in range(6):
        assert shop.cancelled.acquire(timeout=PATIENCE)
    assert shop.released.count("v") == 10
    assert shop.closed == 1
    for raw in clients:
        raw.close()
    with orinkit.serve(Counting(), url), UdpRaw(url) as raw:
        assert raw.ask(START) is None
    assert left_over() == before


def left_over() -> tuple[int, list[str]]:
    """Return open descriptors and threads; those of asyncio's executor end after their loop is closed."""
    for thread in threading.enumerate():
        if thread.name.startswith("asyncio"):
            thread.join(PATIENCE)
    return (
        len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.exists() else 0,
        sorted(thread.name for thread in threading.enumerate()),
    )


def test_the_async_server(shop: Counting) -> None:
    async def body() -> None:
        async with aio.serve(shop, "udp://127.0.0.1:0") as server:
            with UdpRaw(server.url) as raw:
                assert await asyncio.to_thread(raw.ask, START) is None
                assert server.clients == 1
            with pytest.raises(ConnectFailed):
                await aio.serve(Workshop(), server.url).start()
        assert shop.closed == 1
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(body())
