"""Clients that send requests without waiting for the replies do not delay other clients, on any transport.

The tests count calls instead of measuring times, or use calls that take a given time.
"""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import h11
import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.server import udp
from orinkit.server.aio_server import AsyncServer
from orinkit.server.context import ServerContext
from orinkit.server.fair_queue import BUDGET, SLICE, queue_of
from orinkit.server.peer import Peer
from orinkit.server.threaded import Server
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.variant import Variant, plain
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.control import PROVIDER_NAME, ControlProvider
from support.callers import CONNECT, EXECUTE, START, SerialRaw, UdpRaw
from support.peers import RawClient
from support.waiting import PATIENCE, until
from support.watching import calls_per_turn, watched
from support.web import Web, connect, request

WORK = 0.001  # s
GET_TAG, PUT_TAG = BY_NAME["Controller_GetTag"].id, BY_NAME["Controller_PutTag"].id
MANY = 400
FEW = 100  # calls that may be executed between the arrival of a request and its execution
URLS = {"tcp": "tcp://127.0.0.1:0", "udp": "udp://127.0.0.1:0", "serial": "pty://", "http": "http://127.0.0.1:0"}

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


class Bench(Provider):
    """A device with the commands Work, which takes 1 ms, and Gate, which blocks the event loop.

    Attributes:
        log: the parameters of Work, and ``"released"`` for each controller that has been released.
        gate: event that Gate waits for.
        at_gate: event that Gate sets.
        clients: the clients that have connected.
        at: callbacks to invoke when the log has a certain length.
    """

    provider_names = ("Test.Bench",)

    def __init__(self) -> None:
        self.log: list[Any] = []
        self.gate = threading.Event()
        self.at_gate = threading.Event()
        self.clients: list[ClientInfo] = []
        self.at: dict[int, Callable[[], None]] = {}

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        self.clients.append(client)
        return BenchController(self)


class BenchController(ControllerObject):
    """The controller object of :class:`Bench`."""

    def __init__(self, bench: Bench) -> None:
        super().__init__("Bench")
        self._bench = bench

    def execute(self, command: str, parameter: Variant) -> Any:
        bench = self._bench
        if command == "Gate":
            bench.at_gate.set()
            assert bench.gate.wait(PATIENCE)
            return None
        time.sleep(WORK)
        bench.log.append(plain(parameter))
        bench.at.pop(len(bench.log), lambda: None)()
        return len(bench.log)

    def release(self) -> None:
        time.sleep(WORK)
        self._bench.log.append("released")


@pytest.fixture
def bench() -> Bench:
    return Bench()


@contextmanager
def opened(url: str) -> Iterator[RawClient]:
    with RawClient(url) as client:
        assert client.ask(CONNECT, "", "Test.Bench", "", "") == 2
        yield client


def calls(number: int, *arguments: Any) -> bytes:
    """Return calls of Controller_Execute of the first controller, with the serials 1, 2, ..."""
    return b"".join(packet.encode(Packet(serial, EXECUTE, [2, *arguments])) for serial in range(1, number + 1))


# --- other clients ----------------------------------------------------------------------------------------------------


def asks(scheme: str, url: str, stack: ExitStack) -> Callable[[], Callable[[], object]]:
    """Connect a client; return a function that sends a call, and returns a function that waits for its reply."""
    if scheme == "http":
        web = stack.enter_context(Web(url, keeps_cookies=True))
        body = request(EXECUTE, connect(web, "Test.Bench"), "8,Work", "8,other")

        def post() -> Callable[[], object]:
            web.send(web.head(body) + body.encode())
            return web.answer

        return post
    client: Any = stack.enter_context({"tcp": RawClient, "udp": UdpRaw, "serial": SerialRaw}[scheme](url))
    handle = client.ask(CONNECT, "", "Test.Bench", "", "")

    def call() -> Callable[[], object]:
        client.request(EXECUTE, handle, "Work", "other")
        return lambda: client.packet()

    return call


@pytest.mark.parametrize("scheme", list(URLS))
def test_another_client_is_served_before_the_rest_of_the_requests(bench: Bench, scheme: str) -> None:
    with (
        orinkit.serve(bench, URLS["tcp"], URLS[scheme]) as server,
        opened(server.urls[0]) as flooding,
        ExitStack() as stack,
    ):
        ask = asks(scheme, server.urls[1], stack)
        flooding.send(calls(1, "Gate", None) + calls(MANY, "Work", "flood"))
        assert bench.at_gate.wait(PATIENCE)
        wait = ask()  # arrives while the server is busy with the first of many requests
        bench.gate.set()
        wait()
        assert bench.log.index("other") < FEW
        for serial in (1, *range(1, MANY + 1)):
            assert flooding.packet().serial == serial


def test_requests_of_a_crowd_are_executed_in_turn(bench: Bench) -> None:
    with orinkit.serve(bench, URLS["tcp"]) as server, ExitStack() as stack:
        clients = [stack.enter_context(opened(server.url)) for _ in range(8)]
        clients[0].send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
        for number, client in enumerate(clients):
            client.send(calls(50, "Work", number))
        bench.gate.set()
        until(lambda: len(bench.log) >= 200)
        counts = [bench.log[:200].count(number) for number in range(1, 8)]
        assert max(counts) - min(counts) <= 15  # 25 calls of each on average


def test_the_pendant_takes_precedence() -> None:
    bench = Bench()
    buttons = ControlProvider(VirtualRC8())
    with orinkit.serve(bench, URLS["tcp"]) as server, ExitStack() as stack:
        control = AsyncServer(buttons, URLS["tcp"])
        asyncio.run_coroutine_threadsafe(control.start(), server._loop).result(PATIENCE)
        stack.callback(lambda: asyncio.run_coroutine_threadsafe(control.close(), server._loop).result(PATIENCE))
        pendant = stack.enter_context(
            orinkit.connect(control.url, provider=PROVIDER_NAME, option=f"Secret={buttons.secret}", timeout=PATIENCE)
        )
        crowd = [stack.enter_context(opened(server.url)) for _ in range(40)]
        crowd[0].send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
        for client in crowd:
            client.send(calls(20, "Work", "flood"))
        threading.Timer(0.05, bench.gate.set).start()
        pendant.execute("EmergencyStop", True)
        assert len(bench.log) < FEW
        pendant.execute("EmergencyStop", False)


# --- turns of the event loop ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("connections", [1, 6])
def test_a_turn_executes_a_limited_number_of_calls(connections: int) -> None:
    """Without a limit, the requests of a chunk of 64 KiB are executed in one turn, of each connection: 2,184 each."""
    count = 2000
    calls_of_one = b"".join(packet.encode(Packet(serial, START, [""])) for serial in range(1, count + 1))
    with (
        orinkit.serve(VirtualRC8(), URLS["tcp"]) as server,
        ExitStack() as stack,
        calls_per_turn(server, Session, "invoke") as counts,
    ):
        clients = [stack.enter_context(RawClient(server.url)) for _ in range(connections)]
        for client in clients:
            client.send(calls_of_one)
        for client in clients:
            assert [client.packet().serial for _ in range(count)] == list(range(1, count + 1))
    assert sum(counts) == count * connections
    assert max(counts) < 1000


def test_a_turn_handles_a_limited_number_of_chunks_of_a_body() -> None:
    """Without a limit, a chunk of 64 KiB has 10,000 events."""
    head = (
        b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/x-www-form-urlencoded\r\n"
        b"Transfer-Encoding: chunked\r\n\r\n"
    )
    body = b"".join(b"1\r\n%c\r\n" % sign for sign in b"Func=1," + b"x" * 20_000) + b"0\r\n\r\n"
    with (
        orinkit.serve(VirtualRC8(), URLS["http"]) as server,
        Web(server.url) as web,
        calls_per_turn(server, h11.Connection, "next_event") as counts,
    ):
        web.send(head + body)
        assert web.answer().status == 200
        web.send(head + b"6\r\nFunc=1\r\n0\r\n\r\n")
        assert web.answer().body == b"0x00000000"
    assert sum(counts) > 20_000
    assert max(counts) < 4000


def test_a_turn_executes_a_limited_number_of_calls_over_http(bench: Bench) -> None:
    """Without a limit, a turn executes one call of each connection."""
    with orinkit.serve(bench, URLS["tcp"], URLS["http"]) as server, ExitStack() as stack:
        clients = []
        for _ in range(40):
            web = stack.enter_context(Web(server.urls[1], keeps_cookies=True))
            body = request(EXECUTE, connect(web, "Test.Bench"), "8,Work", "8,x")
            clients.append((web, web.head(body) + body.encode()))
        gate = stack.enter_context(opened(server.urls[0]))
        gate.send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
        for web, data in clients:
            web.send(data * 5)
        with calls_per_turn(server, BenchController, "execute") as counts:
            bench.gate.set()
            for web, _ in clients:
                for _ in range(5):
                    assert web.answer().status == 200
    assert sum(counts) == 200
    assert max(counts) <= 2 * BUDGET / WORK


def test_many_clients_that_disconnect_at_once_are_released_in_turn(bench: Bench) -> None:
    with orinkit.serve(bench, URLS["tcp"]) as server:
        with ExitStack() as stack:
            clients = [stack.enter_context(opened(server.url)) for _ in range(50)]
            clients[0].send(calls(1, "Gate", None))
            assert bench.at_gate.wait(PATIENCE)
        with calls_per_turn(server, BenchController, "release") as counts:
            bench.gate.set()
            until(lambda: bench.log.count("released") == 50)
        assert max(counts) <= 2 * BUDGET / WORK


def test_the_objects_of_disconnected_clients_are_released_when_the_server_closes(bench: Bench) -> None:
    server = orinkit.serve(bench, URLS["tcp"])
    with ExitStack() as stack:
        clients = [stack.enter_context(opened(server.url)) for _ in range(50)]
        clients[0].send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
    bench.gate.set()
    server.close()
    assert bench.log.count("released") == 50


NOISE = {
    "SOH": b"\x01" * 4096,
    "short packets": b"\x01\x12\x00\x00\x00" * 800,
    "headers": b"\x01\x00\x40\x00\x00" * 800,
    "packets with a wrong checksum": b"\x01\x04\x7f\x00\x00" * 800,
}


@pytest.mark.parametrize("kind", list(NOISE))
def test_noise_on_a_serial_line_does_not_block_the_server(bench: Bench, kind: str) -> None:
    with orinkit.serve(bench, URLS["serial"], URLS["tcp"]) as server, opened(server.urls[1]) as other:
        with SerialRaw(server.url) as line, watched(server) as watch:
            for number in range(40):
                line.send(NOISE[kind])
                other.request(EXECUTE, 2, "Work", number)
                assert other.packet().code == hresult.S_OK
            line.send(bytes(2 * 65536))  # completes any packet that the noise has announced
            serial = line.request(START, "")
            while line.packet().serial != serial:
                pass
        watch.check()


# --- what does not change ---------------------------------------------------------------------------------------------


def test_replies_are_in_order_also_behind_large_packets() -> None:
    """Several clients send small and large requests; the latter are decoded in the worker."""
    errors: list[BaseException] = []

    def one(url: str) -> None:
        try:
            with RawClient(url) as client:
                handle = client.ask(CONNECT, "", "CaoProv.DENSO.VRC", "", "")
                texts = ["x" * (20_000 if number % 50 == 9 else number) for number in range(300)]
                data = [
                    packet.encode(Packet(number + 1, *call))
                    for number, text in enumerate(texts)
                    for call in ((PUT_TAG, [handle, text]), (GET_TAG, [handle]))
                ]
                sender = threading.Thread(target=client.send, args=(b"".join(data),))
                sender.start()
                for number, text in enumerate(texts):
                    assert client.packet() == Packet(number + 1, 0, [])
                    assert client.packet() == Packet(number + 1, 0, [text])
                sender.join(PATIENCE)
        except BaseException as error:  # noqa: BLE001 - reported by the test
            errors.append(error)

    with orinkit.serve(VirtualRC8(), URLS["tcp"]) as server:
        threads = [threading.Thread(target=one, args=(server.url,)) for _ in range(6)]
        for each in threads:
            each.start()
        for each in threads:
            each.join(2 * PATIENCE)
    assert errors == []


def test_requests_before_the_end_of_the_stream_are_executed(bench: Bench) -> None:
    with orinkit.serve(bench, URLS["tcp"]) as server:
        with opened(server.url) as client:
            client.send(calls(50, "Work", "last"))
            client.socket.shutdown(socket.SHUT_WR)
            assert [client.packet().serial for _ in range(50)] == list(range(1, 51))
            assert client.ended()
        until(lambda: "released" in bench.log)
    assert bench.log == ["last"] * 50 + ["released"]


def test_the_bytes_of_a_client_that_disconnects_while_it_is_queued_do_not_count(bench: Bench) -> None:
    with orinkit.serve(bench, URLS["tcp"]) as server, RawClient(server.url) as client:
        assert client.ask(CONNECT, "", "Test.Bench", "", "") == 2
        client.send(calls(1, "Gate", None) + calls(MANY, "Work", "x"))
        assert bench.at_gate.wait(PATIENCE)
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close() sends RST
        client.socket.close()
        time.sleep(2 * SLICE)  # the call takes longer than a slice, so the client is queued when it is disconnected
        bench.gate.set()
        until(lambda: "released" in bench.log)
        with opened(server.url):
            assert server._server._context.partial.bytes == 0


def test_a_client_is_notified_after_its_queued_data_has_been_processed(bench: Bench) -> None:
    """``when_input_processed``: without the queue, three turns of the event loop were sufficient."""
    notified: list[int] = []
    with orinkit.serve(bench, URLS["tcp"]) as server, opened(server.url) as client:
        bench.at[10] = lambda: bench.clients[0].when_input_processed(lambda: notified.append(len(bench.log)))
        client.send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
        client.send(calls(MANY, "Work", "x"))
        bench.gate.set()
        for serial in (1, *range(1, MANY + 1)):
            assert client.packet().serial == serial
        until(lambda: notified)
    assert notified == [MANY]


def test_queued_data_counts_as_a_sign_of_life(bench: Bench) -> None:
    """The requests of a client wait for longer than the silence that it permits for itself; it is not silent."""
    with orinkit.serve(bench, URLS["tcp"]) as server, opened(server.url) as flooding, opened(server.url) as client:
        assert client.ask(START, "Alive=200") is None
        (peer,) = (each for each in server._server._context.open if each.requested_silence_limit)
        assert isinstance(peer, Peer)
        flooding.send(calls(1, "Gate", None))
        assert bench.at_gate.wait(PATIENCE)
        client.send(calls(MANY, "Work", "x"))
        silences: list[float] = []
        bench.at[MANY // 2] = lambda: silences.append(time.monotonic() - peer.last_request_at)
        bench.at[MANY // 2 + 1] = lambda: silences.append(time.monotonic() - peer._heard)
        bench.gate.set()
        for serial in range(1, MANY + 1):
            assert client.packet() == Packet(serial, 0, [serial])
    assert silences[0] < 0.2 * silences[1]


# --- UDP --------------------------------------------------------------------------------------------------------------


class Silent(asyncio.DatagramTransport):
    """A transport that records the serials of replies."""

    def __init__(self) -> None:
        super().__init__()
        self.serials: list[int] = []

    def is_closing(self) -> bool:
        return False

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return default

    def sendto(self, data: Any, addr: Any = None) -> None:
        self.serials.append(packet.decode(bytes(data)).serial)


def test_queued_datagrams_are_limited_and_keep_their_order(bench: Bench) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        context = ServerContext(ProviderRegistry(bench), DEFAULT_LIMITS, 100, 180.0)
        endpoint, transport = udp.UdpSocket(context, loop), Silent()
        endpoint.connection_made(transport)
        queue = queue_of(loop)
        queue._used = 1.0  # as after a turn with much work: everything is queued
        queue._schedule()

        def send(port: int, serial: int, function: int, *arguments: Any) -> None:
            data = packet.encode(Packet(serial, function, list(arguments), serial))
            endpoint.datagram_received(data, ("127.0.0.1", port))

        for serial in range(1, 200):
            send(1, serial, START, "")
        send(2, 1000, START, "")
        assert transport.serials == []
        assert endpoint._queued_bytes <= udp._MAX_QUEUED + udp._MAX_ALL_QUEUED
        (first,) = (client for (_, port), client in endpoint._queued.items() if port == 1)  # not one for each datagram
        assert first.step()
        assert transport.serials == [1]
        while endpoint._queued:  # noqa: ASYNC110 - there is no event to wait for
            await asyncio.sleep(0)
        accepted = transport.serials
        assert 10 < len(accepted) - 1 < 60
        assert 1000 in accepted
        assert [serial for serial in accepted if serial < 1000] == sorted(accepted)[:-1]
        assert endpoint._queued_bytes == 0
        assert len(context.open) == 2
        send(3, 2000, START, "x" * udp._MAX_QUEUED)
        assert transport.serials[-1] == 2000  # refused, not dropped
        await context.close(1.0)

    asyncio.run(main())


# --- clients without the secret ----------------------------------------------------------------------------------------


@contextmanager
def busy_worker(server: Server) -> Iterator[None]:
    """Keep the worker that decodes large packets busy."""
    ended = threading.Event()
    job = asyncio.run_coroutine_threadsafe(
        server._server._context.worker.run(lambda: ended.wait(PATIENCE)), server._loop
    )
    try:
        yield
    finally:
        ended.set()
        job.result(PATIENCE)


LARGE = packet.encode(Packet(1, CONNECT, ["", "x" * 20_000, "", ""]))


def test_a_large_packet_does_not_protect_a_client_without_objects(bench: Bench) -> None:
    """The packets of all clients wait for the worker; before they are decoded, they are not calls."""
    with (
        orinkit.serve(bench, URLS["tcp"], clients=4, per_address=4) as server,
        ExitStack() as stack,
        busy_worker(server),
    ):
        crowd = [stack.enter_context(RawClient(server.url)) for _ in range(4)]
        for client in crowd:
            client.send(LARGE)
        until(lambda: sum(each._task is not None for each in server._server._context.open) == 4)
        stack.enter_context(opened(server.url))


def test_clients_without_the_secret_do_not_keep_an_operator_out() -> None:
    buttons = ControlProvider(VirtualRC8())
    option = f"Secret={buttons.secret}"
    wrong = packet.encode(Packet(1, CONNECT, ["", PROVIDER_NAME, "", "Secret=wrong-wrong-wrong"]))
    with orinkit.serve(buttons, URLS["tcp"], clients=16, per_address=16) as server, ExitStack() as stack:

        def operate() -> orinkit.Controller:
            pendant = stack.enter_context(
                orinkit.connect(server.url, provider=PROVIDER_NAME, option=option, timeout=PATIENCE)
            )
            pendant.execute("EmergencyStop", True)
            return pendant

        first = operate()
        with busy_worker(server):
            for number in range(30):
                client = stack.enter_context(RawClient(server.url))
                client.send(wrong if number % 2 else LARGE)
            pendants = [operate() for _ in range(5)]
        for pendant in (first, *pendants):
            pendant.execute("EmergencyStop", False)
        assert server.clients <= 6 + 8


def test_a_packet_before_the_secret_must_be_small() -> None:
    buttons = ControlProvider(VirtualRC8())
    with orinkit.serve(buttons, URLS["tcp"]) as server, RawClient(server.url) as small, RawClient(server.url) as large:
        assert small.ask(START, "x" * 2000) is None  # 4,028 bytes
        large.send(packet.encode(Packet(1, START, ["x" * 2048])))
        assert large.packet().code == hresult.E_PACKETSIZEOVER
        assert large.ended()
        handle = small.ask(CONNECT, "", PROVIDER_NAME, "", f"Secret={buttons.secret}")
        assert small.ask(EXECUTE, handle, "Status", "x" * 30_000).startswith("{")
