"""The direct path of a TCP server: same bytes, same order, same limits as the path of all other packets.

Each script is sent to two servers: one with the direct path, and one without. The replies must be equal.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import orinkit
from orinkit import functions as f
from orinkit.bcap import packet
from orinkit.bcap.requests import encode_request
from orinkit.bcap.server import ServerConversation
from orinkit.cao.provider import (
    BlockingCall,
    ClientInfo,
    ControllerObject,
    Deferred,
    Provider,
    ResultWithCode,
    VariableObject,
)
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.server.tcp import TcpConnection
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from support.leaping import leap
from support.waiting import until

CONTROLLER, CELL = 2, 3
WAIT = 10.0  # s; only for failing tests


class Cell(VariableObject):
    """A variable that stores a value."""

    value: Variant = Variant(VarType.EMPTY)

    def get_value(self) -> Value:
        return self.value

    def put_value(self, value: Variant) -> None:
        self.value = value


class Kit(ControllerObject):
    """A controller whose command selects the form of the result."""

    def get_variable(self, name: str, option: str) -> Cell:
        return Cell(name)

    def execute(self, command: str, parameter: Variant) -> Any:
        if command == "echo":
            return parameter
        if command == "nothing":
            return None
        if command == "code":
            return ResultWithCode(hresult.S_BUF_FULL, parameter)
        if command == "refuse":
            raise error_for(hresult.E_ACCESSDENIED, "refused")
        if command == "crash":
            raise RuntimeError("crash")
        if command == "misfit":
            result = Variant(VarType.R8 | ARRAY, [0.5])
            result.value.append("text")  # an error of the device
            return result
        if command == "thread":
            return BlockingCall(lambda: 7)
        if command == "done":
            done = Deferred[int]()
            done.set_result(8)
            return done
        return self._slowly()

    async def _slowly(self) -> float:
        await asyncio.sleep(0.12)
        return 0.5


class KitProvider(Provider):
    """The provider of the controller."""

    provider_names = ("Kit",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Kit:
        return Kit(name)


def _request(function: Any, *arguments: Any, serial: int = 1) -> bytes:
    return encode_request(function, arguments, serial)


START = _request(f.service_start, "", serial=1)
CONNECT = _request(f.controller_connect, "", "Kit", "", "", serial=2)
VARIABLE = _request(f.controller_get_variable, CONTROLLER, "V", "", serial=3)
PROLOGUE = (START, CONNECT, VARIABLE)
GET = _request(f.variable_get_value, CELL, serial=10)


def _put(value: Any, serial: int = 11) -> bytes:
    return _request(f.variable_put_value, CELL, value, serial=serial)


def _run(command: str, parameter: Any = None, serial: int = 12) -> bytes:
    return _request(f.controller_execute, CONTROLLER, command, parameter, serial=serial)


def _count(counted: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    serve = TcpConnection._serve_directly

    def counting(self: TcpConnection, data: bytes) -> bool:
        done = serve(self, data)
        counted.append(done)
        return done

    monkeypatch.setattr(TcpConnection, "_serve_directly", counting)


@contextmanager
def _both(monkeypatch: pytest.MonkeyPatch, **options: Any) -> Iterator[Callable[[Callable[[socket.socket], Any]], Any]]:
    """Yield a function that runs a script on both servers, compares the results, and returns them."""

    def run(script: Callable[[socket.socket], Any]) -> Any:
        results = []
        for direct in (True, False):
            with monkeypatch.context() as patch:
                if not direct:
                    patch.setattr(TcpConnection, "_process_directly", TcpConnection._process)
                with orinkit.serve(KitProvider(), "tcp://127.0.0.1:0", **options) as server:
                    host, port = server.url.removeprefix("tcp://").split(":")
                    with socket.create_connection((host, int(port)), WAIT) as peer:
                        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        results.append(script(peer))
        assert results[0] == results[1]
        return results[0]

    yield run


def _receive(peer: socket.socket) -> bytes:
    """Return one packet; ``b""`` at the end of the connection."""
    data = b""
    while len(data) < 5 or len(data) < int.from_bytes(data[1:5], "little"):
        try:
            more = peer.recv(5 - len(data) if len(data) < 5 else int.from_bytes(data[1:5], "little") - len(data))
        except ConnectionResetError:
            return b""
        if not more:
            return b""
        data += more
    return data


def _calls(*requests: bytes) -> Callable[[socket.socket], list[bytes]]:
    def script(peer: socket.socket) -> list[bytes]:
        replies = []
        for request in (*PROLOGUE, *requests):
            peer.sendall(request)
            replies.append(_receive(peer))
            if not replies[-1]:
                break
        return replies

    return script


VALUES = [
    1, -7, 0.25, True, False, None, "text", "座標", "", "x" * 3000, [1.0] * 8, [0.5] * 100, [1, 2, 3], ["a", "b"],
    [1, "a", 0.5], b"bytes", [], Variant(VarType.I2, 5), Variant(VarType.R4, 0.1), Variant(VarType.ERROR, 3),
    Variant(VarType.UI1, 9), [0.5] * 20_000,
]  # fmt: skip


def test_values_of_all_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[bool] = []
    _count(counted, monkeypatch)
    with _both(monkeypatch) as run:
        replies = run(_calls(*(each for value in VALUES for each in (_put(value), GET, _run("echo", value)))))
    assert len(replies) == len(PROLOGUE) + 3 * len(VALUES)
    assert all(packet.decode(each).code == 0 for each in replies)
    assert sum(counted) > 2 * len(VALUES)  # the direct path was really used


ODD = [
    _request(f.variable_get_value, 99, serial=20),  # no such object
    _request(f.variable_get_value, CONTROLLER, serial=21),  # of another interface
    _request(f.variable_get_value, -1, serial=22),
    packet.pack(23, f.variable_get_value.id, 0, b""),  # too few arguments
    packet.pack(24, 999, 0, b""),  # no such function
    packet.pack(25, 0, 0, b""),
    packet.pack(26, 0x8000_0001, 0, b""),
    packet.pack(27, 999, 2000, b"\0" * 30_000),
    packet.pack(28, f.variable_get_value.id, 1, b"\0" * 14),  # malformed argument
    packet.pack(29, f.variable_get_value.id, 3, b"\x0a\0\0\0\x03\0\x01\0\0\0\x03\0\0\0"),  # fewer arguments than counted
    packet.pack(30, f.variable_get_value.id, 1, b"\x0a\0\0\0\x03\0\x01\0\0\0\x03\0\0\0" + b"trailer"),
    packet.pack(31, f.variable_get_value.id, 1, b"\x08\0\0\0\x02\0\x01\0\0\0\x03\0"),  # the handle as VT_I2
    packet.pack(0, f.variable_get_value.id, 1, b"\x0a\0\0\0\x03\0\x01\0\0\0\x03\0\0\0"),  # serial 0
    packet.pack(32, f.variable_get_value.id, 1, b"\x0a\0\0\0\x03\0\x01\0\0\0\x03\0\0\0", 77),  # reserved
    _run("nothing"), _run("code", 5), _run("code"), _run("refuse"), _run("crash"), _run("thread"), _run("done"),
    _run("misfit"),
    _run("x" * 2000), _run("slow"),
    _request(f.controller_get_variable, CONTROLLER, "W", "", serial=40),
    _request(f.variable_put_tag, CELL, "tag", serial=41), _request(f.variable_get_tag, CELL, serial=42),
    _request(f.controller_get_name, CONTROLLER, serial=43), _request(f.variable_get_attribute, CELL, serial=44),
    _request(f.controller_get_variable_names, CONTROLLER, "", serial=45),
    _request(f.variable_release, CELL, serial=46), GET,
    _request(f.service_start, "WDT=100,InvokeTimeout=2000", serial=47), _run("slow", serial=48), GET,
    _request(f.service_start, "WDT=nonsense", serial=49),
    _request(f.controller_disconnect, CONTROLLER, serial=50), _run("nothing"),
    _request(f.service_stop, serial=51), GET,
]  # fmt: skip


def _all_packets(requests: tuple[bytes, ...]) -> Callable[[socket.socket], list[bytes]]:
    def script(peer: socket.socket) -> list[bytes]:
        replies = _calls()(peer)
        for request in requests:
            peer.sendall(request)
            while True:
                reply = _receive(peer)
                if reply != replies[-1]:  # a slow machine receives S_EXECUTING several times
                    replies.append(reply)
                if not reply or packet.decode(reply).code != hresult.S_EXECUTING:
                    break
        return replies

    return script


def test_unusual_requests(monkeypatch: pytest.MonkeyPatch) -> None:
    with _both(monkeypatch) as run:
        replies = run(_all_packets(tuple(ODD)))
    assert all(replies)
    assert hresult.S_EXECUTING in [packet.decode(each).code for each in replies]


def test_a_packet_in_two_pieces_at_every_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    def script(peer: socket.socket) -> list[bytes]:
        replies = _calls()(peer)
        for at in range(1, len(GET)):
            peer.sendall(GET[:at])
            time.sleep(0.001)
            peer.sendall(GET[at:])
            replies.append(_receive(peer))
            peer.sendall(GET)
            replies.append(_receive(peer))
        return replies

    with _both(monkeypatch) as run:
        assert len(set(run(script)[len(PROLOGUE) :])) == 1


def test_several_packets_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def script(peer: socket.socket) -> list[bytes]:
        replies = _calls()(peer)
        for number in range(1, 20):
            group = b"".join(_put(each, serial=each + 1) + GET for each in range(number))
            peer.sendall(group + GET[:7])
            replies += [_receive(peer) for _ in range(2 * number)]
            peer.sendall(GET[7:] + GET)
            replies += [_receive(peer) for _ in range(2)]
        return replies

    with _both(monkeypatch) as run:
        run(script)


def test_requests_during_a_slow_call_are_executed_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def script(peer: socket.socket) -> list[int]:
        _calls()(peer)
        peer.sendall(_run("slow", serial=60))
        time.sleep(0.02)
        for serial in range(61, 66):
            peer.sendall(_put(serial, serial=serial))
        return [packet.decode(_receive(peer)).serial for _ in range(6)]

    with _both(monkeypatch) as run:
        assert run(script) == [60, 61, 62, 63, 64, 65]


@pytest.mark.parametrize(
    "rest",
    [b"GET / HTTP/1.1\r\n\r\n", b"\x01\x05\0\0\0", b"\x01\xff\xff\xff\x7f" + b"\0" * 40, GET[:-1] + b"\x05"],
)
def test_anything_but_a_packet_closes_the_connection(monkeypatch: pytest.MonkeyPatch, rest: bytes) -> None:
    with _both(monkeypatch) as run:
        replies = run(_calls(GET, rest, GET))
    assert packet.decode(replies[-1] or replies[-2]).code & 0x8000_0000
    assert replies[-1] == b""


def test_limits_of_packets_apply(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = PacketLimits(packet=200, variants=20)
    with _both(monkeypatch, limits=limits) as run:
        replies = run(
            _calls(_put("x" * 60), GET, _put([1.0] * 20), GET, _run("nothing"), _put(["a"] * 30), _put("x" * 99))
        )
    codes = [packet.decode(each).code for each in replies if each]
    assert hresult.E_PACKETSIZEOVER in codes


def test_a_disconnected_client_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[bool] = []
    _count(counted, monkeypatch)
    with orinkit.serve(KitProvider(), "tcp://127.0.0.1:0") as server:
        host, port = server.url.removeprefix("tcp://").split(":")
        for last in (GET, GET + GET, GET[:9], _run("slow"), b""):
            with socket.create_connection((host, int(port)), WAIT) as peer:
                _calls(GET)(peer)
                peer.sendall(last)
        end = time.monotonic() + WAIT
        while server.clients and time.monotonic() < end:
            time.sleep(0.01)
        assert server.clients == 0
    assert any(counted)


def test_calls_on_the_direct_path_are_signs_of_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client that has announced signs of life with ``Alive`` is disconnected after 10 s without a request."""
    counted: list[bool] = []
    _count(counted, monkeypatch)
    with orinkit.serve(KitProvider(), "tcp://127.0.0.1:0") as server:
        host, port = server.url.removeprefix("tcp://").split(":")
        with socket.create_connection((host, int(port)), WAIT) as peer:
            for request in (_request(f.service_start, "Alive=1000"), CONNECT, VARIABLE):
                peer.sendall(request)
                _receive(peer)
            until(lambda: len(counted) == 3)  # a call is counted after its reply has been sent
            counted.clear()
            for _ in range(3):
                leap(server, 6.0)
                peer.sendall(GET)
                assert packet.decode(_receive(peer)).code == 0
            until(lambda: counted == [True] * 3)
            assert server.clients == 1
            leap(server, 11.0)
            until(lambda: not server.clients)
            assert _receive(peer) == b""


def test_a_flooding_client_does_not_delay_others_on_the_direct_path() -> None:
    with orinkit.serve(KitProvider(), "tcp://127.0.0.1:0") as server:
        host, port = server.url.removeprefix("tcp://").split(":")
        peers = [socket.create_connection((host, int(port)), WAIT) for _ in range(2)]
        for peer in peers:
            _calls()(peer)
        flood, quiet = peers
        flood.setblocking(False)
        ended = threading.Event()
        received = 0

        def send() -> None:
            nonlocal received
            while not ended.is_set():
                for action in (lambda: flood.send(GET * 500), lambda: flood.recv(1 << 20)):
                    try:
                        action()
                        received += 1
                    except BlockingIOError:
                        pass

        sender = threading.Thread(target=send)
        sender.start()
        try:
            while not received and sender.is_alive():
                time.sleep(0.001)
            for _ in range(200):  # each of these calls would wait for all of the flood if shares were not fair
                quiet.sendall(GET)
                assert packet.decode(_receive(quiet)).code == 0
        finally:
            ended.set()
            sender.join()
            for peer in peers:
                peer.close()


def test_the_conversation_has_the_same_state_on_both_paths() -> None:
    direct, usual = ServerConversation(), ServerConversation()
    for data in (GET, _put(1), _run("x", [1.0, 2.0])):
        call = direct.take_directly(data, 5.0)
        assert call is not None
        reply = direct.reply_directly(call, 0, Variant(VarType.I4, 1))
        (execute,) = usual.receive(data, 5.0)
        assert usual.finish(execute, 0, Variant(VarType.I4, 1)) == reply  # type: ignore[arg-type]  # loosely typed by the table of the test
        for name in ("packets", "calls", "last_request_at", "last_reply_at", "busy", "stopped", "incomplete_bytes"):
            assert getattr(direct, name) == getattr(usual, name)


def test_a_conversation_that_is_busy_or_has_a_partial_packet_refuses_the_direct_path() -> None:
    conversation = ServerConversation()
    call = conversation.take_directly(GET, 1.0)
    assert call is not None
    execute = conversation.continue_call(call)
    assert conversation.busy
    assert conversation.take_directly(GET, 2.0) is None
    assert conversation.next_time() == pytest.approx(181.0)
    assert conversation.finish(execute, 0, None)
    assert not conversation.busy
    assert list(conversation.receive(GET[:5], 3.0)) == []
    assert conversation.take_directly(GET, 3.0) is None
    assert conversation.calls == 1
