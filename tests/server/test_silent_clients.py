"""Connections without requests, or with incomplete ones, do not keep other clients out."""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.core import hresult
from orinkit.server import tcp
from orinkit.server.capacity import DEFAULT_CLIENTS, default_per_address
from orinkit.server.context import ServerContext
from orinkit.server.threaded import Server
from support.devices import Workshop
from support.leaping import leap, take_turns
from support.peers import RawClient
from support.waiting import until

START, CONNECT, EXECUTE, RELEASE = 1, 3, 17, 4
LATE = tcp.PATIENCE + 1.0
LIMIT = 8
LONG = 1000.0  # s; longer than any stall of the machine

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a time limit that elapses only when a test advances the clock."""
    monkeypatch.setattr(tcp, "PATIENCE", LONG)


@pytest.fixture
def server(workshop: Workshop) -> Iterator[Server]:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", clients=LIMIT, per_address=LIMIT) as served:
        yield served


def context_of(server: Server) -> ServerContext:
    return server._server._context


def open_workshop(client: RawClient) -> int:
    handle = client.ask(CONNECT, "", "Test.Workshop", "localhost", "")
    assert isinstance(handle, int)
    return handle


def read(server: Server, client: RawClient, incomplete: int) -> None:
    """Wait until a server has received so many bytes of a client's packet."""
    name = "{}:{}".format(*client.socket.getsockname())

    def received() -> list[int]:
        return [each._conversation.incomplete_bytes for each in list(context_of(server).all) if each._name == name]

    until(lambda: received() == [incomplete])
    take_turns(server)


# --- time -------------------------------------------------------------------------------------------------------------


def test_a_client_that_makes_no_call_is_dropped(server: Server, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "orinkit.server")
    with RawClient(server.url) as silent, RawClient(server.url) as client:
        open_workshop(client)
        until(lambda: server.clients == 2)
        leap(server, LONG - 100)
        assert server.clients == 2
        leap(server, 200)
        assert silent.ended()
        until(lambda: server.clients == 1)
        leap(server, 10 * LONG)  # a client that has objects may be silent
        assert client.ask(EXECUTE, 2, "Echo", 1) == 1
    assert any("no call received" in record.getMessage() for record in caplog.records)


@pytest.mark.parametrize(
    "data",
    [
        packet.pack(1, START, 2, b""),  # invalid
        packet.pack(1, START, 1, bytes.fromhex("0a00000063000100000000000000")),  # unknown type
        packet.encode(Packet(1, START, ["WDT=1"])),  # refused
        packet.encode(Packet(1, START))[:-1],
    ],
)
def test_invalid_requests_do_not_count_as_calls(server: Server, data: bytes) -> None:
    with RawClient(server.url) as silent:
        silent.send(data)
        if len(data) != 15:
            assert hresult.failed(silent.packet().code)
        until(lambda: server.clients == 1)
        leap(server, LONG + 1)
        assert silent.ended()
    until(lambda: not context_of(server).all)


@pytest.mark.parametrize("size", [1, 4, 5, 15, 40])
def test_an_incomplete_packet(server: Server, size: int) -> None:
    request = packet.encode(Packet(2, EXECUTE, [2, "Echo", "x" * 100]))
    with RawClient(server.url) as client:
        open_workshop(client)
        client.send(request[:size])
        read(server, client, size)
        leap(server, LONG + 1)
        assert client.ended()
    until(lambda: server.clients == 0)


def test_a_long_packet_over_a_slow_connection(server: Server) -> None:
    """It may take any time as long as enough bytes arrive; otherwise the client is disconnected."""
    text = "x" * (4 * tcp.PROGRESS)
    request = packet.encode(Packet(2, EXECUTE, [2, "Echo", text]))
    with RawClient(server.url) as client:
        open_workshop(client)
        for begin in range(0, len(request) - tcp.PROGRESS, tcp.PROGRESS):
            client.send(request[begin : begin + tcp.PROGRESS])
            read(server, client, begin + tcp.PROGRESS)
            leap(server, LONG * 0.9)
        client.send(request[begin + tcp.PROGRESS :])
        assert client.packet().arguments == [text]
        client.send(request[: tcp.PROGRESS])
        read(server, client, tcp.PROGRESS)
        leap(server, LONG + 1)
        assert client.ended()


def test_the_time_limit_restarts_with_each_packet(server: Server) -> None:
    request = packet.encode(Packet(2, EXECUTE, [2, "Echo", 1]))
    with RawClient(server.url) as client:
        open_workshop(client)
        for _ in range(5):
            client.send(request[:9])
            read(server, client, 9)
            leap(server, LONG * 0.9)
            client.send(request[9:])
            assert client.packet().arguments == [1]


def test_a_closed_client_that_does_not_read_its_replies(server: Server) -> None:
    with RawClient(server.url, receive_buffer=4096) as greedy:
        handle = open_workshop(greedy)
        (connection,) = context_of(server).open
        greedy.send(packet.encode(Packet(1, EXECUTE, [handle, "Large", 8_000_000])))
        until(lambda: connection._slow)
        server._loop.call_soon_threadsafe(connection.close)
        take_turns(server)
        assert server.clients == 1
        leap(server, LONG + 1)
        until(lambda: server.clients == 0)


# --- limits on clients ------------------------------------------------------------------------------------------------


def test_silent_connections_do_not_keep_clients_out(server: Server) -> None:
    """The attack: silent connections repeatedly use up the limit on clients."""
    with RawClient(server.url) as holder:
        handle = open_workshop(holder)
        silent = [RawClient(server.url) for _ in range(5 * LIMIT)]
        for number in range(20):
            with RawClient(server.url) as client:
                assert client.ask(EXECUTE, open_workshop(client), "Echo", number) == number
            silent.append(RawClient(server.url))
        assert holder.ask(EXECUTE, handle, "Echo", "here") == "here"
        assert server.clients <= LIMIT
        for each in silent:
            each.close()


def test_the_client_idle_for_longest_is_evicted(server: Server) -> None:
    clients = [RawClient(server.url) for _ in range(LIMIT)]
    for client in clients:
        assert client.ask(START) is None
        leap(server, 1)
    open_workshop(clients[0])
    assert clients[1].ask(START) is None
    with RawClient(server.url) as newcomer:
        assert newcomer.ask(START) is None
        assert clients[2].ended()
        for client in [*clients[:2], *clients[3:], newcomer]:
            assert client.ask(START) is None
    for client in clients:
        client.close()


def test_clients_with_objects_or_a_call_in_progress_are_not_evicted(server: Server, workshop: Workshop) -> None:
    clients = [RawClient(server.url) for _ in range(LIMIT)]
    for client in clients:
        open_workshop(client)
    leap(server, 10 * LONG)
    clients[0].request(EXECUTE, 2, "Wait", "done")
    assert workshop.at_work.acquire(timeout=30)
    with RawClient(server.url) as newcomer:
        assert newcomer.ask(START) == hresult.E_MAX_CONNECT
    workshop.gate.set()
    assert clients[0].packet().arguments == ["done"]
    assert clients[1].ask(RELEASE, 2) is None  # now the client has no objects
    with RawClient(server.url) as newcomer:
        assert newcomer.ask(START) is None
    assert clients[1].ended()
    for client in clients:
        client.close()


@pytest.fixture
def addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Treat the loopback addresses as different networks, which the server does not do normally."""
    monkeypatch.setattr("orinkit.server.peer.network_of", lambda host: host)


@pytest.mark.usefixtures("addresses")
def test_one_address_cannot_use_up_the_limit(workshop: Workshop, caplog: pytest.LogCaptureFixture) -> None:
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", clients=LIMIT) as server:
        clients = []
        for _ in range(default_per_address(LIMIT)):
            clients.append(RawClient(server.url, source="127.0.0.7"))
            open_workshop(clients[-1])
        with RawClient(server.url, source="127.0.0.7") as extra:
            assert extra.ask(START) == hresult.E_MAX_CONNECT
        assert "6 clients of its address are connected" in caplog.text
        with RawClient(server.url, source="127.0.0.8") as other:
            assert other.ask(EXECUTE, open_workshop(other), "Echo", 1) == 1
        for client in clients:
            client.close()


@pytest.mark.usefixtures("addresses")
def test_an_address_at_its_limit_evicts_no_client_of_another(workshop: Workshop) -> None:
    with (
        orinkit.serve(workshop, "tcp://127.0.0.1:0", clients=LIMIT) as server,
        RawClient(server.url, source="127.0.0.8") as idle,
    ):
        assert idle.ask(START) is None
        flood = [RawClient(server.url, source="127.0.0.7") for _ in range(5 * LIMIT)]
        assert idle.ask(START) is None
        for client in flood:
            client.close()


def test_a_machine_can_have_256_clients() -> None:
    assert default_per_address(DEFAULT_CLIENTS) >= 256
    assert [default_per_address(limit) for limit in (1, 2, 3, 4, 8, 16)] == [1, 2, 3, 3, 6, 12]


def test_only_a_limited_number_of_clients_receives_e_max_connect(server: Server) -> None:
    clients = [RawClient(server.url) for _ in range(LIMIT)]
    for client in clients:
        open_workshop(client)
    crowd = [RawClient(server.url) for _ in range(100)]
    until(lambda: len(context_of(server).turned_away) == 64 and len(context_of(server).all) == LIMIT + 64)
    assert crowd[-1].ended()
    assert crowd[0].ask(START) == hresult.E_MAX_CONNECT
    for client in [*clients, *crowd]:
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
    until(lambda: not context_of(server).all)
    assert not context_of(server).turned_away


def test_clients_without_objects_over_udp_and_http_are_evicted(workshop: Workshop) -> None:
    with (
        orinkit.serve(
            workshop, "tcp://127.0.0.1:0", "udp://127.0.0.1:0", "http://127.0.0.1:0", clients=2, per_address=2
        ) as server,
        orinkit.open_client(server.urls[1]) as udp,
        orinkit.open_client(server.urls[2]) as http,
    ):
        for client in (udp, http):
            client.call(orinkit.functions.service_start, "")
        assert server.clients == 2
        with RawClient(server.url) as one, RawClient(server.url) as two:
            for raw in (one, two):
                assert raw.ask(EXECUTE, open_workshop(raw), "Echo", 1) == 1
            with pytest.raises(orinkit.CallError, match="E_MAX_CONNECT"):
                udp.call(orinkit.functions.service_start, "")


def test_no_client_is_evicted_while_the_server_closes() -> None:
    async def reason() -> str:
        connections = ServerContext.__new__(ServerContext)
        connections.closing = True
        return connections.make_room("127.0.0.1")

    assert asyncio.run(reason()) == "the server is closing"
