"""Limit on the memory for the arguments of calls in progress and for unsent replies, and clients that read slowly."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.core import hresult
from orinkit.gateway import RemoteProvider
from orinkit.server import capacity, tcp
from orinkit.server.capacity import ALWAYS, CallMemory, MemoryBudget
from orinkit.server.http.stage import Stage
from orinkit.server.large_values import memory_of
from orinkit.server.tcp import PATIENCE, PROGRESS, TcpConnection
from orinkit.server.threaded import Server
from orinkit.values.codec import encode
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from support.devices import Workshop
from support.gateways import gateway, hurry
from support.leaping import leap
from support.peers import BadPeer, Line, RawClient, reply
from support.waiting import PATIENCE as WAITING
from support.waiting import until
from support.web import EXECUTE, Web, connect, request

CONNECT = 3
MIB = 1024 * 1024
RESULT = 12 * MIB  # more than the buffers of the system for a connection
ROOM = 28 * MIB  # for one result, decoded and encoded, and part of another one
TEXT = MIB
TEXTS = 5 * MIB  # room for one text, not for two

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def workshop() -> Workshop:
    return Workshop()


@pytest.fixture
def server(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(capacity, "CALL_MEMORY", ROOM)
    with orinkit.serve(workshop, "tcp://127.0.0.1:0", "http://127.0.0.1:0") as served:
        yield served
    Web.close_all()


def budget(server: Server) -> MemoryBudget:
    return server._server._context.memory


def open_workshop(client: RawClient) -> int:
    handle = client.ask(CONNECT, "", "Test.Workshop", "localhost", "")
    assert isinstance(handle, int)
    return handle


def unsent(server: Server, client: RawClient) -> int:
    """Return the number of bytes that the server has not yet passed to the system."""
    name = "{}:{}".format(*client.socket.getsockname())
    found = [each for each in list(server._server._context.all) if isinstance(each, TcpConnection)]
    return sum(each._transport.get_write_buffer_size() for each in found if each._name == name)


def slow_reader(server: Server) -> RawClient:
    return RawClient(server.url, receive_buffer=65536)


def read_to_end(client: RawClient) -> None:
    """Read until the server has closed the connection."""
    try:
        while client.socket.recv(MIB):
            pass
    except ConnectionError:
        pass


def length_of_response(web: Web) -> int:
    """Read a response; return the length of its body."""
    while not (line := web.line().lower()).startswith(b"content-length:"):
        pass
    length = int(line.partition(b":")[2])
    while web.line():
        pass
    left = length - len(web._rest)
    while left > 0:
        left -= len(web.socket.recv(MIB))
    web._rest = b""
    return length


def send(web: Web, command: str, handle: int, parameter: str) -> None:
    """Send a call without reading the response."""
    body = request(EXECUTE, handle, command, parameter)
    web.send(web.head(body) + body.encode())


def ask_for_result(server: Server, client: RawClient) -> None:
    """Request a large result without reading it."""
    client.request(EXECUTE, open_workshop(client), "Large", RESULT)
    until(lambda: unsent(server, client) > 0)
    until(lambda: 0 < budget(server).bytes <= RESULT)  # the system may accept more bytes after they were counted


def read_until(server: Server, client: RawClient, left: int) -> None:
    """Read a reply until the server has only so many unsent bytes."""
    while unsent(server, client) > left:
        assert client.socket.recv(MIB)


# --- replies over TCP -------------------------------------------------------------------------------------------------


def test_unread_replies_are_limited(server: Server) -> None:
    with slow_reader(server) as reader, RawClient(server.url) as client:
        ask_for_result(server, reader)
        handle = open_workshop(client)
        assert client.ask(EXECUTE, handle, "Large", RESULT) == hresult.E_OUTOFMEMORY
        assert budget(server).bytes <= ROOM
        assert client.ask(EXECUTE, handle, "Large", 20_000) == bytes(20_000)  # small enough to be always accepted
        assert client.ask(EXECUTE, handle, "Echo", 7) == 7
        assert reader.packet().arguments == [bytes(RESULT)]
        until(lambda: budget(server).bytes == 0)
        assert client.ask(EXECUTE, handle, "Large", RESULT) == bytes(RESULT)
        until(lambda: budget(server).bytes == 0)


def test_the_cause_can_be_requested(server: Server) -> None:
    with slow_reader(server) as reader:
        ask_for_result(server, reader)
        with (
            orinkit.connect(server.url, provider="Test.Workshop") as controller,
            pytest.raises(orinkit.CallError) as caught,
        ):
            controller.execute("Large", RESULT)
        assert caught.value.code == hresult.E_OUTOFMEMORY


def test_a_client_that_has_gone_does_not_count(server: Server) -> None:
    with slow_reader(server) as reader:
        ask_for_result(server, reader)
    until(lambda: budget(server).bytes == 0)
    until(lambda: server.clients == 0)


def test_a_client_that_does_not_read_is_disconnected(server: Server) -> None:
    with slow_reader(server) as reader, RawClient(server.url) as client:
        ask_for_result(server, reader)
        open_workshop(client)
        leap(server, PATIENCE - 9.0)
        assert server.clients == 2
        leap(server, 10.0)
        until(lambda: server.clients == 1)
        assert budget(server).bytes == 0


def test_a_client_that_reads_too_little_is_disconnected(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "PROGRESS", RESULT)  # the system transfers a megabyte or more at a time
    with slow_reader(server) as reader:
        ask_for_result(server, reader)
        read_until(server, reader, unsent(server, reader) - 1)
        leap(server, PATIENCE + 1.0)
        until(lambda: server.clients == 0)


def test_a_slow_reader_is_disconnected_only_if_its_memory_is_required(
    server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    with slow_reader(server) as reader, RawClient(server.url) as client:
        ask_for_result(server, reader)
        handle = open_workshop(client)
        read_until(server, reader, unsent(server, reader) - PROGRESS)
        leap(server, PATIENCE + 1.0)
        assert server.clients == 2
        assert budget(server).bytes > 0
        assert client.ask(EXECUTE, handle, "Large", RESULT) == bytes(RESULT)
        until(lambda: server.clients == 1)
        read_to_end(reader)
    assert "the memory is required for other clients" in caplog.text


# --- replies over HTTP ------------------------------------------------------------------------------------------------


def test_unread_responses_are_limited(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    size = 5 * MIB  # about 10 MiB as text
    monkeypatch.setattr(capacity, "CALL_MEMORY", 15 * MIB)
    reader, web = Web(server.urls[1], keeps_cookies=True), Web(server.urls[1], keeps_cookies=True)
    mine, other = connect(reader), connect(web)
    send(reader, "Large", mine, f"3,{size}")
    until(lambda: budget(server).bytes > 0)
    refused = web.call(EXECUTE, other, "Large", f"3,{size}")
    assert refused.code == hresult.E_OUTOFMEMORY
    assert str(15 * MIB) in refused.detail
    assert web.call(EXECUTE, other, "Echo", "3,7").result == "3,7"
    assert length_of_response(reader) > 2 * size
    until(lambda: budget(server).bytes == 0)


def test_a_client_that_does_not_read_its_response_is_disconnected(server: Server) -> None:
    reader = Web(server.urls[1])
    send(reader, "Large", connect(reader), f"3,{5 * MIB}")
    until(lambda: any(getattr(each, "stage", None) is Stage.TAKING for each in list(server._server._context.all)))
    assert budget(server).bytes > 0
    leap(server, Stage.TAKING.seconds + 1.0)
    until(lambda: budget(server).bytes == 0)


# --- arguments --------------------------------------------------------------------------------------------------------


def test_arguments_of_calls_in_progress_are_limited(
    server: Server, workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capacity, "CALL_MEMORY", TEXTS)
    with RawClient(server.url) as busy, RawClient(server.url) as client:
        busy.request(EXECUTE, open_workshop(busy), "Block", "x" * TEXT)
        assert workshop.at_work.acquire(timeout=WAITING)
        assert budget(server).bytes >= 3 * TEXT
        handle = open_workshop(client)
        assert client.ask(EXECUTE, handle, "Block", "y" * TEXT) == hresult.E_OUTOFMEMORY
        assert not workshop.at_work.acquire(blocking=False)  # not executed
        assert client.ask(EXECUTE, handle, "Echo", "y" * 10_000) == "y" * 10_000
        busy.close()
        until(lambda: server.clients == 1)
        assert budget(server).bytes >= 3 * TEXT  # the thread still has the arguments
        workshop.gate.set()
        until(lambda: budget(server).bytes == 0)
        assert client.ask(EXECUTE, handle, "Echo", "y" * TEXT) == "y" * TEXT
        until(lambda: budget(server).bytes == 0)


def test_arguments_of_cancelled_calls_do_not_count(server: Server, workshop: Workshop) -> None:
    with RawClient(server.url) as busy:
        busy.request(EXECUTE, open_workshop(busy), "Wait", "x" * TEXT)
        assert workshop.at_work.acquire(timeout=WAITING)
        assert budget(server).bytes >= 3 * TEXT
    assert workshop.cancelled.acquire(timeout=WAITING)
    until(lambda: budget(server).bytes == 0)


def test_arguments_over_http_are_limited(server: Server, workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capacity, "CALL_MEMORY", TEXTS)
    busy, web = Web(server.urls[1], keeps_cookies=True), Web(server.urls[1], keeps_cookies=True)
    mine, other = connect(busy), connect(web)
    send(busy, "Block", mine, "8," + "x" * TEXT)
    assert workshop.at_work.acquire(timeout=WAITING)
    refused = web.call(EXECUTE, other, "Block", "8," + "y" * TEXT)
    assert refused.code == hresult.E_OUTOFMEMORY
    assert not workshop.at_work.acquire(blocking=False)
    busy.close()
    assert budget(server).bytes >= 3 * TEXT
    workshop.gate.set()
    until(lambda: budget(server).bytes == 0)
    assert web.call(EXECUTE, other, "Echo", "8," + "y" * TEXT).result == "8," + "y" * TEXT


def test_a_gateway_to_a_controller_that_does_not_reply(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capacity, "CALL_MEMORY", TEXTS)
    made: list[RemoteProvider] = []
    received = threading.Semaphore(0)

    def silent(line: Line) -> None:
        line.send(reply(line.request()))
        line.send(reply(line.request(), 5))
        line.request()
        received.release()
        peer.stopping.wait(2 * WAITING)

    with (
        BadPeer(silent) as peer,
        gateway(peer.url, made=made) as url,
        RawClient(url) as busy,
        RawClient(url) as client,
    ):
        mine, other = open_workshop(busy), open_workshop(client)
        busy.request(EXECUTE, mine, "Echo", "x" * TEXT)
        assert received.acquire(timeout=WAITING)
        assert client.ask(EXECUTE, other, "Echo", "y" * TEXT) == hresult.E_OUTOFMEMORY
        busy.close()
        until(lambda: len(made[0]._connections) == 1)
        hurry(made, 0.3)
        connection = next(iter(made[0]._connections))
        assert connection._client is not None
        assert client.ask(EXECUTE, other, "Echo", "y" * TEXT) == hresult.E_TIMEOUT
        until(lambda: connection._client is None)  # unsent bytes of the call would stay in its buffer


# --- the estimate -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [
        Variant(VarType.BSTR, "x" * 50_000),
        Variant(VarType.BSTR, "\U0001f600" * 50_000),
        Variant(int(VarType.UI1 | ARRAY), bytes(50_000)),
        Variant(int(VarType.R8 | ARRAY), [1.5] * 50_000),
        Variant(int(VarType.I8 | ARRAY), list(range(2**60, 2**60 + 50_000))),
        Variant(int(VarType.BSTR | ARRAY), ["abc" * 10] * 5_000),
        Variant(VARIANT_ARRAY, [Variant(VarType.R8, 1.5)] * 50_000),
        Variant(VARIANT_ARRAY, [Variant(VARIANT_ARRAY, [Variant(VarType.BSTR, "x" * 50)] * 3)] * 5_000),
    ],
    ids=lambda value: f"{int(value.type):#x} {len(value.value)}",
)
def test_the_estimate_includes_the_encoded_value(value: Variant) -> None:
    assert len(encode(value)) < memory_of((value,)) < 100 * len(encode(value))


def test_up_to_64_kib_are_always_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capacity, "CALL_MEMORY", 2 * ALWAYS)
    total = MemoryBudget()
    large, refused, small = CallMemory(total), CallMemory(total), CallMemory(total)
    assert large.set(2 * ALWAYS)
    assert not refused.set(ALWAYS + 1)
    assert (refused.bytes, total.bytes) == (0, 2 * ALWAYS)
    assert small.set(ALWAYS)
    assert large.set(ALWAYS + 1)  # less than before
    kept = large.hand_over()
    large.release()
    assert total.bytes == 2 * ALWAYS + 1
    kept.release()
    small.release()
    assert total.bytes == 0
