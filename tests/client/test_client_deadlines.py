"""Servers that report S_EXECUTING without end: calls with a deadline end, and a flood of reports costs little CPU time."""

from __future__ import annotations

import re
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
from orinkit.bcap.packet import Framer, Packet
from orinkit.core import hresult
from orinkit.core.errors import CallTimeout, ConnectionClosed, InvalidValue, ProtocolError
from orinkit.values.codec import DEFAULT_LIMITS
from support.both import Both
from support.devices import Workshop
from support.http_peers import HttpLine, HttpPeer, reply
from support.waiting import PATIENCE, TooSlow, with_longer_times

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nOrinkit-Executing: 100\r\nTransfer-Encoding: chunked\r\n\r\n"


class Hostile:
    """A server that replies to the first calls, and then reports S_EXECUTING without end.

    Args:
        kind: ``"tcp"`` or ``"http"``.
        answered: Number of calls that receive a reply.
        pause: Time between two reports in s; 0 for the maximum rate.
    """

    def __init__(self, kind: str, answered: int, pause: float) -> None:
        self._kind, self._answered, self._pause = kind, answered, pause
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"{kind}://127.0.0.1:{self._listener.getsockname()[1]}"
        self._ending = threading.Event()
        self._threads = [threading.Thread(target=self._take)]
        self._threads[0].start()

    def _take(self) -> None:
        while True:
            try:
                peer, _ = self._listener.accept()
            except OSError:
                return
            self._threads.append(threading.Thread(target=self._serve, args=(peer,)))
            self._threads[-1].start()

    def _serve(self, peer: socket.socket) -> None:
        peer.settimeout(0.2)
        with peer:
            try:
                (self._web if self._kind == "http" else self._bcap)(peer)
            except OSError:
                pass

    def _received(self, peer: socket.socket) -> bytes:
        while not self._ending.is_set():
            try:
                return peer.recv(65536)
            except TimeoutError:
                continue
        return b""

    def _bcap(self, peer: socket.socket) -> None:
        framer = Framer(DEFAULT_LIMITS)
        while data := self._received(peer):
            frame = framer.feed(data)
            while frame is not None:
                request = packet.decode(frame)
                if self._answered:
                    self._answered -= 1
                    result = [2] if request.code == f.controller_connect.id else []
                    peer.sendall(packet.encode(Packet(request.serial, 0, result)))
                else:
                    self._say(peer, packet.encode(Packet(request.serial, hresult.S_EXECUTING, [])))
                    return
                frame = framer.next_frame()

    def _web(self, peer: socket.socket) -> None:
        came = b""
        while data := self._received(peer):
            came += data
            head, end, body = came.partition(b"\r\n\r\n")
            length = re.search(rb"content-length: (\d+)", head.lower())
            if not end or length is None or len(body) < int(length[1]):
                continue
            came = body[int(length[1]) :]
            if self._answered:
                self._answered -= 1
                answer = b"0x00000000,3,2" if b"Func=3," in body else b"0x00000000"
                peer.sendall(HEAD + b"%x\r\n%s\r\n0\r\n\r\n" % (len(answer), answer))
            else:
                peer.sendall(HEAD)
                self._say(peer, b"1\r\n\n\r\n")
                return

    def _say(self, peer: socket.socket, sign: bytes) -> None:
        peer.settimeout(PATIENCE)
        while not self._ending.wait(self._pause) if self._pause else not self._ending.is_set():
            peer.sendall(sign if self._pause else sign * 100)

    def close(self) -> None:
        self._ending.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for thread in self._threads:
            thread.join(PATIENCE)


@contextmanager
def hostile(kind: str, answered: int, pause: float = 0.02) -> Iterator[str]:
    server = Hostile(kind, answered, pause)
    try:
        yield server.url
    finally:
        server.close()


def costs(call: Callable[[], Any]) -> float:
    """Return the CPU time in s that a call takes in this thread."""
    before = time.thread_time()
    call()
    return time.thread_time() - before


@pytest.mark.parametrize("kind", ["tcp", "http"])
@with_longer_times(0.5, 5.0, 20.0)
def test_connect_ends_by_its_deadline(both: Both, kind: str, short: float) -> None:
    for answered in (0, 1):
        with hostile(kind, answered) as url:
            with pytest.raises(CallTimeout) as late:
                both.connect(url, timeout=4 * short, deadline=short)
            if not late.value.executing:  # the machine stalled before the first report
                raise TooSlow
            assert "reported that the call was still executing" in str(late.value)


@pytest.mark.parametrize("kind", ["tcp", "http"])
def test_connect_has_a_deadline_by_default(both: Both, kind: str) -> None:
    with hostile(kind, 0) as url, pytest.raises(CallTimeout, match="still executing"):
        both.connect(url, timeout=0.2)


@pytest.mark.parametrize("kind", ["tcp", "http"])
def test_close_ends_by_its_deadline(both: Both, kind: str) -> None:
    with hostile(kind, 2) as url:
        controller = both.connect(url)
        both.run(controller.close(deadline=0.3))
    with hostile(kind, 2) as url:
        both.run(both.connect(url, timeout=0.2).close())


@pytest.mark.parametrize("kind", ["tcp", "http"])
@pytest.mark.parametrize("way", ["of the call", "of the client"])
def test_a_call_ends_by_its_deadline(both: Both, kind: str, way: str) -> None:
    with hostile(kind, 1) as url:
        client = both.client(url, timeout=2.0)
        both.run(client.call(f.service_start))
        with pytest.raises(CallTimeout, match="still executing"):
            if way == "of the call":
                both.run(client.request(f.service_start, deadline=0.3))
            else:
                client.deadline = 0.3
                both.run(client.call(f.service_start))
        both.run(client.close())


def test_deadlines_limit_the_wait_for_a_server_that_cannot_report(both: Both) -> None:
    """Otherwise, a client waits up to 180 s for the reply of an e-CAP server that cannot report S_EXECUTING."""

    def hangs(line: HttpLine) -> None:
        line.post()
        line.send(reply())
        line.post()
        line.send(reply(b"0x00000000,3,2"))
        line.post()
        line.wait_for_end()

    with HttpPeer(hangs, HttpLine.wait_for_end, HttpLine.wait_for_end, HttpLine.wait_for_end) as peer:
        controller = both.connect(str(peer.address), timeout=PATIENCE)
        controller.client.timeout = 0.1
        began = time.monotonic()
        with pytest.raises(CallTimeout):
            both.run(controller.client.request(f.controller_execute, 2, "Echo", 1, deadline=0.3))
        both.run(controller.close(deadline=0.3))
        assert time.monotonic() - began < PATIENCE


@pytest.mark.parametrize("kind", ["tcp", "http"])
def test_a_flood_costs_little_and_ends_the_connection(both: Both, kind: str) -> None:
    with hostile(kind, 1, pause=0.0) as url:
        client = both.client(url, timeout=2.0)
        both.run(client.call(f.service_start))

        def flooded() -> None:
            with pytest.raises(ProtocolError, match="packets per second, but not the reply"):
                both.run(client.call(f.service_start))

        assert costs(flooded) < 5.0
        with pytest.raises(ConnectionClosed):
            both.run(client.call(f.service_start))
        both.run(client.close())


def test_calls_continue_without_a_deadline(both: Both, listen_at: str) -> None:
    shop = Workshop()
    with orinkit.serve(shop, listen_at) as server:
        controller = both.connect(server.url, provider="Test.Workshop", timeout=0.5, deadline=PATIENCE)
        timer = threading.Timer(1.5, shop.gate.set)
        timer.start()
        assert both.run(controller.execute("Wait", 7)) == 7
        timer.join()
        both.run(controller.close(deadline=PATIENCE))


@pytest.mark.parametrize("bad", [0, -1, float("nan"), "1"])
def test_invalid_deadlines(both: Both, bad: Any) -> None:
    with orinkit.serve(Workshop(), "tcp://127.0.0.1:0") as server:
        with pytest.raises(InvalidValue, match="deadline"):
            both.connect(server.url, deadline=bad)
        with pytest.raises(InvalidValue, match="deadline"):
            both.client(server.url, deadline=bad)
        controller = both.connect(server.url, provider="Test.Workshop")
        with pytest.raises(InvalidValue, match="deadline"):
            controller.client.deadline = bad
        with pytest.raises(InvalidValue, match="deadline"):
            both.run(controller.client.request(f.service_start, deadline=bad))
        with pytest.raises(InvalidValue, match="deadline"):
            both.run(controller.close(deadline=bad))
        both.run(controller.close())
