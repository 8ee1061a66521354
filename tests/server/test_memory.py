"""Limits on the memory that clients can make a server use: incomplete packets and bodies, and tags."""

from __future__ import annotations

import asyncio
import struct
import threading
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.core import hresult
from orinkit.server import capacity
from orinkit.server.capacity import ALWAYS, IncompleteRequests
from orinkit.server.threaded import Server
from support.devices import Workshop
from support.peers import RawClient
from support.waiting import until
from support.web import Web

CONNECT, EXECUTE = 3, 17
ROOM = 4 * 1024 * 1024
LENGTH = 16 * 1024 * 1024

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(capacity, "PARTIAL", ROOM)  # an amount that a test can send quickly
    with orinkit.serve(Workshop(), "tcp://127.0.0.1:0", "http://127.0.0.1:0") as served:
        yield served
    Web.close_all()


def partial(server: Server) -> IncompleteRequests:
    return server._server._context.partial


def test_incomplete_packets(server: Server, caplog: pytest.LogCaptureFixture) -> None:
    """The attack: 50 connections, each with an almost complete packet."""
    head = packet.HEADER.pack(packet.SOH, LENGTH, 1, 0, EXECUTE, 1)
    attackers = [RawClient(server.url) for _ in range(50)]
    codes = []
    for attacker in attackers:
        try:
            attacker.send(head + bytes(1024 * 1024))
            until(lambda: partial(server).bytes <= ROOM)
        except ConnectionError:
            pass
    until(lambda: server.clients <= 4)
    assert partial(server).bytes <= ROOM
    for attacker in attackers:
        try:
            attacker.socket.settimeout(0.05)
            codes.append(attacker.packet().code)
        except (OSError, Exception):  # noqa: BLE001 - reset, or no reply yet
            pass
        attacker.close()
    assert set(codes) <= {hresult.E_PACKETSIZEOVER}
    until(lambda: partial(server).bytes == 0)
    assert "incomplete packets have" in caplog.text


def test_others_are_served_meanwhile(server: Server) -> None:
    head = packet.HEADER.pack(packet.SOH, LENGTH, 1, 0, EXECUTE, 1)
    with RawClient(server.url) as greedy, RawClient(server.url) as client:
        handle = client.ask(CONNECT, "", "Test.Workshop", "localhost", "")
        greedy.send(head + bytes(ROOM - 16 * 1024))
        until(lambda: partial(server).bytes > ROOM - 32 * 1024)
        text = "x" * (ALWAYS // 4)
        request = packet.encode(Packet(5, EXECUTE, [handle, "Echo", text]))
        for begin in range(0, len(request), 10_000):
            client.send(request[begin : begin + 10_000])
        assert client.packet().arguments == [text]
        web = Web(server.urls[1])
        assert web.ask("Func=1").status == 200
    until(lambda: partial(server).bytes == 0)


def test_incomplete_bodies(server: Server) -> None:
    head = "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 16000000\r\n\r\n"
    bodies = [Web(server.urls[1]) for _ in range(8)]
    for web in bodies:
        try:
            web.send(head.encode() + b"Func=1,Arg1=8," + b"x" * 1024 * 1024)
        except ConnectionError:
            pass
    until(lambda: partial(server).bytes <= ROOM and len(server._server._context.all) <= 4)
    for web in bodies:
        web.close()
    until(lambda: partial(server).bytes == 0)
    with Web(server.urls[1]) as web:
        assert web.ask("Func=1").status == 200


def test_memory_grows_with_the_bytes_received_and_not_with_those_announced(server: Server) -> None:
    head = struct.pack("<BI", packet.SOH, LENGTH)
    clients = [RawClient(server.url) for _ in range(20)]
    for client in clients:
        client.send(head)
    until(lambda: partial(server).bytes == 20 * len(head))
    for client in clients:
        client.close()
    until(lambda: partial(server).bytes == 0)


def test_the_size_of_a_tag_is_limited(server: Server) -> None:
    with orinkit.connect(server.url, provider="Test.Workshop") as controller:
        controller.tag = "x" * 30_000
        with pytest.raises(orinkit.CallError, match="E_TOO_MUCH_DATA"):
            controller.tag = "x" * 1_000_000
        assert controller.tag == "x" * 30_000


def test_large_packets_that_wait_for_decoding_count_too(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """Complete packets count until the worker has decoded them."""
    gate = threading.Event()
    context = server._server._context
    blocking = asyncio.run_coroutine_threadsafe(context.worker.run(gate.wait), server._loop)
    request = packet.encode(Packet(1, EXECUTE, [2, "Echo", bytes(1024 * 1024)]))
    clients = [RawClient(server.url) for _ in range(3)]
    for client in clients:
        client.send(request)
    until(lambda: partial(server).bytes > 2_500_000)
    gate.set()
    blocking.result(30)
    for client in clients:
        assert client.packet().code == hresult.E_HANDLE
        client.close()
    until(lambda: partial(server).bytes == 0)
