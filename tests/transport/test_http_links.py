"""e-CAP over HTTP, synchronous and in asyncio: one test body for both."""

from __future__ import annotations

import asyncio
import importlib
import itertools
import os
import random
import signal
import socket
import ssl
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import (
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    InvalidAddress,
    InvalidValue,
    LimitExceeded,
    MissingExtra,
    OrinError,
    ProtocolError,
    StreamError,
    TransportError,
)
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import Credentials
from orinkit.transport.http import connection
from orinkit.transport.http.aio_link import AsyncHttpLink
from orinkit.transport.http.link import HttpLink
from orinkit.transport.http.response import HttpServerInfo, first_line
from support.both import Both
from support.http_peers import (
    CERTIFICATE,
    CHUNKED,
    HELLO,
    S_OK,
    WORKING,
    HttpLine,
    HttpPeer,
    HttpScript,
    Post,
    SecurePeer,
    after_hello,
    answers,
    answers_and_stays,
    chunks,
    echo,
    head,
    reply,
)
from support.peers import Gone
from support.waiting import TooSlow, until, with_longer_times

PATIENT = 20.0  # s: a time-out that no test may reach
SHORT = 0.1  # s: a time-out that is expected to pass


class Way:
    """A link to a server, synchronous or asynchronous."""

    def __init__(self, both: Both, address: HttpAddress, *more: Any) -> None:
        self.both = both

        async def opened() -> AsyncHttpLink:
            return AsyncHttpLink(address, *more)

        self.link: Any = HttpLink(address, *more) if both.loop is None else both.run(opened())

    def send(self, data: bytes) -> None:
        async def body() -> None:
            self.link.send(data)

        if self.both.loop is None:
            self.link.send(data, PATIENT)
        else:
            self.both.run(body())

    def receive(self, seconds: float = PATIENT) -> bytes | None:
        result: bytes | None = self.both.run(self.link.receive(seconds))
        return result

    def ask(self, data: bytes, seconds: float = PATIENT) -> bytes | None:
        self.send(data)
        return self.receive(seconds)

    def hello(self) -> None:
        """Open the connection beforehand, because that takes time too."""
        assert self.ask(HELLO) == HELLO

    def close(self) -> None:
        async def body() -> None:
            self.link.close()

        self.both.run(self.link.close() if self.both.loop is None else body())
        if self.both.loop is not None:
            self.both.run(self.both.loop.shutdown_default_executor())  # names are resolved here


class Ways:
    """Opens links, and finally closes all of them."""

    def __init__(self, both: Both) -> None:
        self.both = both
        self._made: list[Way] = []

    def __call__(self, peer: HttpPeer | HttpAddress, *more: Any) -> Way:
        way = Way(self.both, peer if isinstance(peer, HttpAddress) else peer.address, *more)
        self._made.append(way)
        return way

    def close(self) -> None:
        for way in self._made:
            way.close()


@pytest.fixture
def ways(both: Both) -> Iterator[Ways]:
    made = Ways(both)
    yield made
    made.close()


# --- requests ---------------------------------------------------------------------------------------------------------


def test_nothing_is_opened_before_the_first_request(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        way.send(b"Func=1")
        assert peer.connections == 0
        assert way.receive() == b"Func=1"
        assert peer.connections == 1


def test_what_a_request_looks_like(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer.address._replace(path="/any/path?x=1"), Credentials("T0k.en-_~+/="))
        assert way.ask(b"Func=3&Arg1=%E6%97%A5") == b"Func=3&Arg1=%E6%97%A5"
        assert peer.posts == [
            Post(
                "POST /any/path?x=1 HTTP/1.1",
                {
                    "host": f"127.0.0.1:{peer.port}",
                    "accept-encoding": "identity",
                    "user-agent": "orinkit",
                    "content-type": "application/x-www-form-urlencoded",
                    "orinkit-executing": "400",
                    "authorization": "Bearer T0k.en-_~+/=",
                    "content-length": "21",
                },
                b"Func=3&Arg1=%E6%97%A5",
            )
        ]


@pytest.mark.parametrize(("seconds", "interval"), [(3.0, "400"), (0.5, "250"), (0.1, "80")])
def test_signs_of_work_come_twice_in_the_time_out(ways: Ways, seconds: float, interval: str) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        way.hello()
        way.ask(b"x", seconds)
    assert [post.headers["orinkit-executing"] for post in peer.posts[1:]] in ([interval], [])


def test_the_connection_is_kept(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        for number in range(5):
            assert way.ask(b"%d" % number) == b"%d" % number
        assert peer.connections == 1


def test_large_bodies(ways: Ways) -> None:
    data = b"0123456789abcdef" * 100_000
    with HttpPeer(echo) as peer:
        assert ways(peer).ask(data) == data


def test_a_connection_that_was_idle_for_long_is_not_used_again(ways: Ways, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "KEPT", 0.0)
    monkeypatch.setattr("orinkit.transport.http.aio_link.KEPT", 0.0)
    with HttpPeer(echo) as peer:
        way = ways(peer)
        for number in range(3):
            assert way.ask(b"%d" % number) == b"%d" % number
            time.sleep(0.001)  # a clock that stands still does not count as silence
        assert peer.connections == 3


def test_proxies_of_the_environment_are_not_used(ways: Ways, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:1")
    with HttpPeer(echo) as peer:
        assert ways(peer).ask(b"x") == b"x"


def test_localhost_may_have_several_addresses(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        assert ways(peer.address._replace(host="localhost")).ask(b"x") == b"x"
        assert peer.posts[0].headers["host"] == f"localhost:{peer.port}"


def test_the_zone_of_an_address_is_not_told() -> None:
    assert HttpServerInfo(HttpAddress("http", "fe80::1%eth0", 8080), Credentials(), 100).url == "http://[fe80::1]:8080"


@pytest.mark.parametrize("host", ["a b", "é\x7f", "<", "xn--a\0", "[::1", "x:y:z", "a/b@"])
def test_a_host_that_no_url_can_have(both: Both, host: str) -> None:
    with pytest.raises((InvalidAddress, ConnectFailed)):
        Way(both, HttpAddress("http", host, 1)).ask(b"x")
    if both.loop is not None:
        both.run(both.loop.shutdown_default_executor())


@pytest.mark.parametrize(
    "token", ["s3cret b", " s3cret", "s3cret\n", "s3cret\r\nX: y", "s3cret\0", "s3cret日本", "s3cret\x7f", "s3crété"]
)
def test_a_token_that_no_header_can_have(both: Both, token: str) -> None:
    with pytest.raises(InvalidValue, match="token") as caught:
        Way(both, HttpAddress("http", "127.0.0.1", 1), Credentials(token))
    assert "s3cr" not in str(caught.value)


def test_the_connection_cannot_be_handed_over(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        with pytest.raises(StreamError, match="tcp://"):
            way.link.fileno()
        way.close()
        with pytest.raises(ConnectionClosed):
            way.link.fileno()


def test_a_link_that_was_closed(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"x"
        way.close()
        way.close()
        for call in (lambda: way.send(b"x"), way.receive):
            with pytest.raises(ConnectionClosed):
                call()


def test_nothing_was_asked(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        assert way.receive(SHORT) is None
        assert way.ask(b"x") == b"x"
        assert way.receive(SHORT) is None


# --- never twice ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("headers", [(), ("Connection: close",)])
def test_a_server_that_closes_after_each_answer(ways: Ways, headers: tuple[str, ...]) -> None:
    def once(line: HttpLine) -> None:
        line.send(reply(line.post().body, "200 OK", *headers))

    with HttpPeer(once) as peer:
        way = ways(peer)
        for number in range(4):
            assert way.ask(b"%d" % number) == b"%d" % number
            assert peer.ended.acquire(timeout=PATIENT)
        assert peer.bodies == [b"0", b"1", b"2", b"3"]
        assert peer.connections == 4


@pytest.mark.parametrize("how", ["close", "reset"])
def test_a_connection_that_ends_when_the_next_request_comes(ways: Ways, how: str) -> None:
    def leaves(line: HttpLine) -> None:
        line.send(reply(line.post().body))
        line.post()
        getattr(line, how)()

    with HttpPeer(leaves, echo) as peer:
        way = ways(peer)
        assert way.ask(b"first") == b"first"
        if how == "close":
            assert way.ask(b"second") == b""
        else:
            with pytest.raises(ConnectionLost):
                way.ask(b"second")
        assert way.ask(b"third") == b"third"
        assert peer.bodies == [b"first", b"second", b"third"]


@pytest.mark.parametrize("how", ["close", "reset"])
def test_no_answer_at_all(ways: Ways, how: str) -> None:
    def leaves(line: HttpLine) -> None:
        line.post()
        getattr(line, how)()

    with HttpPeer(leaves) as peer:
        way = ways(peer)
        with pytest.raises(ConnectionLost) as caught:
            way.ask(b"x")
        assert ("Try: https://" in str(caught.value)) == (how == "close")  # as a server with TLS does
        assert peer.bodies == [b"x"]


def test_no_answer_after_another_one(ways: Ways) -> None:
    """A server that has replied does not use TLS."""

    def leaves(line: HttpLine) -> None:
        line.send(reply(line.post().body))
        line.post()
        line.close()

    with HttpPeer(leaves) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"x"
        assert way.ask(b"y") == b""


def test_a_connection_that_was_closed_while_idle_is_noticed(ways: Ways) -> None:
    def twice(line: HttpLine) -> None:
        for _ in range(2):
            line.send(reply(line.post().body))

    with HttpPeer(twice, echo) as peer:
        way = ways(peer)
        assert way.ask(b"1") == b"1"
        assert way.ask(b"2") == b"2"
        assert peer.ended.acquire(timeout=PATIENT)
        assert way.ask(b"3") == b"3"
        assert peer.bodies == [b"1", b"2", b"3"]


@with_longer_times(SHORT, 1.0, PATIENT)
def test_a_request_that_timed_out_is_not_posted_again(ways: Ways, short: float) -> None:
    with HttpPeer(after_hello(answers_and_stays()), echo) as peer:
        way = ways(peer)
        way.hello()
        began = time.monotonic()
        assert way.ask(b"first", short) is None
        if b"first" not in peer.bodies:
            raise TooSlow
        assert time.monotonic() - began >= short * 0.9
        assert way.receive(short) is None
        assert way.ask(b"second") == b"second"
        assert peer.bodies == [HELLO, b"first", b"second"]


def test_a_late_answer_answers_nothing_else(ways: Ways) -> None:
    go_on = threading.Event()

    def late(line: HttpLine) -> None:
        body = line.post().body
        assert go_on.wait(PATIENT)
        line.send(reply(body))
        line.serve(lambda post: reply(post.body))

    with HttpPeer(after_hello(late), echo) as peer:
        way = ways(peer)
        way.hello()
        assert way.ask(b"first", SHORT) is None
        go_on.set()
        assert way.ask(b"second") == b"second"
        assert way.ask(b"third") == b"third"
        assert peer.connections == 2


def test_a_request_that_was_never_waited_for_is_not_posted(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        way = ways(peer)
        way.send(b"first")
        assert way.ask(b"second") == b"second"
        assert peer.bodies == [b"second"]


@pytest.mark.parametrize("more", [reply(b"wrong"), b"\r\n", b"\n", b"rubbish\r\n\r\n", head(length=3)])
def test_more_than_an_answer(ways: Ways, more: bytes) -> None:
    """Data after a reply is not taken for the next reply; the next call is sent once, over another connection."""

    def too_much(line: HttpLine) -> None:
        line.send(reply(line.post().body) + more)
        line.wait_for_end()

    with HttpPeer(too_much) as peer:
        way = ways(peer)
        for number in range(3):
            assert way.ask(b"%d" % number) == b"%d" % number
        assert peer.bodies == [b"0", b"1", b"2"]
        assert peer.connections == 3


def test_what_comes_over_an_idle_connection(ways: Ways) -> None:
    come = threading.Event()

    def talks(line: HttpLine) -> None:
        line.send(reply(line.post().body))
        line.post()
        line.send(reply(b"right"))
        line.send(reply(b"wrong"))
        come.set()
        line.wait_for_end()

    with HttpPeer(talks, echo) as peer:
        way = ways(peer)
        assert way.ask(b"first") == b"first"
        assert way.ask(b"second") == b"right"
        assert come.wait(PATIENT)
        assert way.ask(b"third") == b"third"
        assert peer.bodies == [b"first", b"second", b"third"]


# --- time -------------------------------------------------------------------------------------------------------------


def _drip(data: bytes, forever: bytes) -> HttpScript:
    def script(line: HttpLine) -> None:
        line.post()
        line.send(data)
        while True:
            for byte in forever:
                line.send(bytes([byte]))
                line.peer.stopping.wait(0.005)
                if line.peer.stopping.is_set():
                    return

    return script


@pytest.mark.parametrize(
    "script",
    [
        answers_and_stays(),
        answers_and_stays(b"HTTP/1.1 200 OK\r\nContent-"),
        answers_and_stays(head(length=10)),
        answers_and_stays(head(length=10) + b"0x0"),
        answers_and_stays(head("200 OK", CHUNKED) + b"a\r\n0x0"),
        _drip(b"HTTP/1.1 200 OK\r\n", b"X: y\r\n"),
        _drip(b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
        _drip(head(length=10_000), b"x"),
        _drip(head("200 OK", CHUNKED), chunks(b"x", end=False)),
    ],
)
@with_longer_times(SHORT, 1.0, PATIENT / 4)
def test_the_time_is_up(ways: Ways, script: HttpScript, short: float) -> None:
    with HttpPeer(after_hello(script), echo) as peer:
        way = ways(peer)
        way.hello()
        began = time.monotonic()
        assert way.ask(b"x", short) is None
        if b"x" not in peer.bodies:
            raise TooSlow
        assert short * 0.9 <= time.monotonic() - began < PATIENT
        assert way.ask(b"y") == b"y"
        assert peer.bodies == [HELLO, b"x", b"y"]


def test_a_server_that_does_not_read(ways: Ways) -> None:
    def deaf(line: HttpLine) -> None:
        line.peer.stopping.wait(PATIENT)

    with HttpPeer(after_hello(deaf), echo) as peer:
        way = ways(peer)
        way.hello()
        began = time.monotonic()
        assert way.ask(bytes(12_000_000), SHORT) is None
        assert time.monotonic() - began < PATIENT / 2
        assert way.ask(b"y") == b"y"


@pytest.fixture
def full() -> Iterator[HttpAddress]:
    """An address to which connecting never completes."""
    listener = socket.create_server(("127.0.0.1", 0), backlog=0)
    address = HttpAddress("http", *listener.getsockname())
    others = [socket.socket() for _ in range(8)]
    for other in others:
        other.setblocking(False)
        other.connect_ex(listener.getsockname())
    probe = socket.socket()
    probe.settimeout(SHORT)
    try:
        probe.connect(listener.getsockname())
        pytest.skip("this system accepts more connections than its backlog")
    except TimeoutError:
        yield address
    finally:
        for each in (listener, probe, *others):
            each.close()


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_nobody_answers_the_door(ways: Ways, full: HttpAddress, scheme: str) -> None:
    way = ways(full._replace(scheme=scheme))
    began = time.monotonic()
    with pytest.raises(ConnectFailed, match="the peer does not respond"):
        way.ask(b"x", SHORT)
    assert time.monotonic() - began < PATIENT / 2
    with pytest.raises(ConnectFailed, match=f"{scheme}://127.0.0.1:{full.port}"):
        way.ask(b"x", SHORT)


# --- at work ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b" \t\n\n"])
def test_signs_of_work(ways: Ways, line_end: bytes) -> None:
    step = threading.Semaphore(0)

    def works(line: HttpLine) -> None:
        line.post()
        line.send(head("200 OK", CHUNKED, WORKING))
        for _ in range(3):
            line.send(chunks(line_end, end=False))
            assert step.acquire(timeout=PATIENT)
        line.send(chunks(line_end + b"0x0000", b"0000,3,", b"2"))
        line.wait_for_end()

    with HttpPeer(works) as peer:
        way = ways(peer)
        way.send(b"x")
        for _ in range(3):
            assert way.receive() == b"\n"
            step.release()
        assert way.receive() == b"0x00000000,3,2"


def test_a_sign_and_the_time_is_up(ways: Ways) -> None:
    with HttpPeer(answers_and_stays(head("200 OK", CHUNKED) + chunks(b"\n", end=False)), echo) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"\n"
        assert way.receive(SHORT) is None
        assert way.ask(b"y") == b"y"


def test_a_sign_and_the_end(ways: Ways) -> None:
    with HttpPeer(answers(head("200 OK", CHUNKED) + chunks(b"\n", end=False)), echo) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"\n"
        with pytest.raises(ConnectionLost, match="in the middle"):
            way.receive()
        assert way.ask(b"y") == b"y"


def test_a_call_that_is_given_up_after_a_sign(ways: Ways) -> None:
    working = answers_and_stays(head("200 OK", CHUNKED) + chunks(b"\n", end=False))
    with HttpPeer(working, working, echo) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"\n"
        assert way.ask(b"y") == b"\n"
        assert way.ask(b"z") == b"z"
        assert peer.bodies == [b"x", b"y", b"z"]


def test_closing_after_a_sign(ways: Ways) -> None:
    with HttpPeer(answers_and_stays(head("200 OK", CHUNKED) + chunks(b"\n", end=False))) as peer:
        way = ways(peer)
        assert way.ask(b"x") == b"\n"
        way.close()
        assert peer.ended.acquire(timeout=PATIENT)


def test_a_flood_of_signs(ways: Ways) -> None:
    def floods(line: HttpLine) -> None:
        line.post()
        line.send(head("200 OK", CHUNKED))
        while not line.peer.stopping.is_set():
            line.send(chunks(*[b"\n"] * 1000, end=False))

    with HttpPeer(floods, echo) as peer:
        way = ways(peer)
        way.send(b"x")
        assert {way.receive() for _ in range(5000)} == {b"\n"}
        assert way.ask(b"y") == b"y"


def test_whether_a_server_tells(ways: Ways) -> None:
    with HttpPeer(answers(reply(S_OK, "200 OK", WORKING), reply(S_OK, "200 OK", WORKING.lower()), reply())) as peer:
        way = ways(peer)
        assert way.link.reports_executing is None
        known = []
        for _ in range(3):
            way.ask(b"x")
            known.append(way.link.reports_executing)
        assert known == [True, True, False]


def test_patience_with_a_server_that_cannot_tell(ways: Ways) -> None:
    def slow(line: HttpLine) -> None:
        line.send(reply(line.post().body))
        body = line.post().body
        line.peer.stopping.wait(SHORT * 3)
        line.send(reply(body))
        line.post()
        line.wait_for_end()

    with HttpPeer(slow, answers_and_stays()) as peer:
        way = ways(peer)
        assert way.link.patience == 180.0
        assert way.ask(b"Func=1") == b"Func=1"
        assert way.ask(b"Func=9", SHORT) == b"Func=9"
        way.link.patience = SHORT * 2
        began = time.monotonic()
        assert way.ask(b"Func=20", SHORT) is None
        assert time.monotonic() - began >= SHORT * 1.9


def test_calls_without_the_extended_time_out(ways: Ways) -> None:
    """Service_Start, Service_Stop, and calls while nothing is known of the server have no extended time-out."""

    def answers_one(line: HttpLine) -> None:
        line.post()
        line.send(reply())
        line.post()
        line.wait_for_end()

    with HttpPeer(after_hello(answers_and_stays()), answers_one, after_hello(answers_and_stays())) as peer:
        way = ways(peer)
        began = time.monotonic()
        way.hello()
        way.link._contact.reports_executing = None
        assert way.ask(b"Func=9&Arg1=3", SHORT) is None
        assert way.ask(b"Func=9") == S_OK
        assert way.link.reports_executing is False
        assert way.ask(b"Func=2&Arg1=", SHORT) is None
        way.hello()
        way.link._contact.reports_executing = False
        assert way.ask(b"Func=1", SHORT) is None
        assert time.monotonic() - began < PATIENT / 2


def test_patience_is_not_for_connecting(ways: Ways, full: HttpAddress) -> None:
    way = ways(full)
    way.link._contact.reports_executing = False
    began = time.monotonic()
    with pytest.raises(ConnectFailed):
        way.ask(b"Func=9", SHORT)
    assert time.monotonic() - began < PATIENT / 2


# --- answers that are none --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sent",
    [
        b"HTTP/1.1 200 OK\r\nContent-",
        head(length=10),
        head(length=10) + b"0x0",
        head("200 OK", CHUNKED) + b"a\r\n0x0",
        head("200 OK", CHUNKED) + chunks(S_OK, end=False),
    ],
)
@pytest.mark.parametrize("how", ["close", "reset"])
def test_half_an_answer(ways: Ways, sent: bytes, how: str) -> None:
    def half(line: HttpLine) -> None:
        line.post()
        line.send(sent)
        getattr(line, how)()

    with HttpPeer(half, echo) as peer:
        way = ways(peer)
        with pytest.raises(ConnectionLost):
            way.ask(b"x")
        assert way.ask(b"y") == b"y"
        assert peer.bodies == [b"x", b"y"]


@pytest.mark.parametrize(
    "sent",
    [
        b"\x01\x15\x00\x00\x00\x01\x00\x00\x00",  # b-CAP
        b"\x15\x03\x01\x00\x02\x02\x46",  # TLS
        b"SSH-2.0-OpenSSH_9.9\r\n",
        b"HTTPS\r\n\r\n",
        b"ICY 200 OK\r\n\r\n",
        b"\n\n\n",
        b"HTTP/1.1 abc\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nno colon\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n0x0",
        b"HTTP/1.1 200 OK\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: gzip\r\n\r\n0x0",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nxyz\r\n",
        b"HTTP/1.1 200 OK\r\n" + b"X: " + b"y" * 1_000_000 + b"\r\n\r\n",
        b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 100_000 + b"\r\n",
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: bcap\r\nConnection: Upgrade\r\n\r\n0x00000000",
        reply(b""),
        reply(b"\r\n\n"),
        head("200 OK", CHUNKED) + chunks(b""),
        reply(S_OK, "200 OK", "Content-Encoding: gzip"),
        reply(b"", "204 No Content"),
        reply(S_OK, "201 Created"),
    ],
)
def test_no_answer_of_ecap(ways: Ways, sent: bytes) -> None:
    def confused(line: HttpLine) -> None:
        line.post()
        line.send(sent)
        echo(line)

    with HttpPeer(confused, echo) as peer:
        way = ways(peer)
        way.send(b"x")
        with pytest.raises(ProtocolError) as caught:
            while way.receive() == b"\n":
                pass
        assert str(peer.address) in str(caught.value)
        assert not caught.value.fatal
        assert len(str(caught.value)) < 500
        assert way.ask(b"y") == b"y"
        assert peer.bodies == [b"x", b"y"]


@pytest.mark.parametrize("sent", [b"HTTP/1.0 200 OK\r\n\r\n0x00000000", b"HTTP/1.1 200\r\n\r\n0x00000000"])
def test_a_body_that_ends_with_the_connection(ways: Ways, sent: bytes) -> None:
    with HttpPeer(answers(sent)) as peer:
        way = ways(peer)
        assert way.ask(b"x") == S_OK
        assert way.ask(b"y") == S_OK
        assert peer.connections == 2


@pytest.mark.parametrize(
    "sent",
    [
        head(length=1001) + b"x" * 1001,
        head(length=10**18),
        head("200 OK", CHUNKED) + chunks(*[b"x" * 100] * 20),
        b"HTTP/1.0 200 OK\r\n\r\n" + b"x" * 5000,
    ],
)
def test_an_answer_that_is_too_long(ways: Ways, sent: bytes) -> None:
    def too_long(line: HttpLine) -> None:
        line.post()
        line.send(sent)
        line.wait_for_end()

    with HttpPeer(too_long, answers_and_stays(reply(b"x" * 1000))) as peer:
        way = ways(peer, Credentials(), 1000)
        with pytest.raises(LimitExceeded, match="1000 bytes"):
            way.ask(b"x")
        assert peer.ended.acquire(timeout=PATIENT)  # the connection is closed
        assert way.ask(b"y") == b"x" * 1000


# --- statuses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "kind", "text"),
    [
        ("301 Moved Permanently", ConnectFailed, "another address"),
        ("304 Not Modified", ConnectFailed, "another address"),
        ("400 Bad Request", ProtocolError, "host, port and path"),
        ("401 Unauthorized", ConnectFailed, "token="),
        ("403 Forbidden", ConnectFailed, "denies access"),
        ("404 Not Found", ConnectFailed, "host, port and path"),
        ("405 Method Not Allowed", ConnectFailed, "POST"),
        ("407 Proxy Authentication Required", ConnectFailed, "proxy"),
        ("408 Request Timeout", TransportError, "not executed"),
        ("413 Payload Too Large", LimitExceeded, "A request of 6 bytes"),
        ("415 Unsupported Media Type", ProtocolError, "host, port and path"),
        ("418 I'm a Teapot", ProtocolError, "host, port and path"),
        ("421 Misdirected Request", ConnectFailed, "for this host name"),
        ("429 Too Many Requests", TransportError, "Too many requests"),
        ("500 Internal Server Error", ProtocolError, "is unknown"),
        ("502 Bad Gateway", ConnectionLost, "upstream"),
        ("503 Service Unavailable", ConnectionLost, "shutting down"),
        ("504 Gateway Timeout", ConnectionLost, "upstream"),
        ("599 Nothing", ProtocolError, "host, port and path"),
    ],
)
def test_a_status_that_is_an_error(ways: Ways, status: str, kind: type[OrinError], text: str) -> None:
    body = b"" if status.startswith("304") else "\r\nWhat the server says / 理由\nmore".encode()
    error = reply(body, status, "Location: http://192.0.2.1/elsewhere") if status[0] == "3" else reply(body, status)
    with HttpPeer(answers(error, error, reply())) as peer:
        way = ways(peer)
        with pytest.raises(OrinError, match=text) as caught:
            way.ask(b"Func=1")
        assert type(caught.value) is kind
        assert str(caught.value).startswith(f"{peer.address} returned HTTP {status[:4]}")
        quoted = bool(body) and not status.startswith("401")  # the hint about the token describes the cause
        assert ("(What the server says / 理由)" in str(caught.value)) is quoted
        assert "more" not in str(caught.value).replace("any more", "")
        i18n.use("ja")
        with pytest.raises(kind, match="の応答は HTTP"):
            way.ask(b"Func=1")
        assert way.ask(b"Func=1") == S_OK
        assert peer.connections == 1  # each error response was complete


def test_a_token_that_is_wrong(ways: Ways) -> None:
    with (
        HttpPeer(answers(reply(b"", "401 Unauthorized"))) as peer,
        pytest.raises(ConnectFailed, match="is wrong") as caught,
    ):
        ways(peer, Credentials("secret")).ask(b"x")
    assert "secret" not in str(caught.value)


def test_redirects_are_named_and_not_followed(ways: Ways) -> None:
    with HttpPeer(echo) as other:
        for code, place in itertools.product(
            (301, 302, 303, 307, 308), (str(other.address), "/elsewhere", "http://[", "")
        ):
            moved = reply(b"", f"{code} Moved", f"Location: {place}")
            with HttpPeer(answers(moved)) as peer:
                with pytest.raises(ConnectFailed, match=str(code)) as caught:
                    ways(peer).ask(b"x")
                assert place in str(caught.value)
                assert len(peer.posts) == 1
        assert other.connections == 0


@pytest.mark.parametrize(
    ("body", "shown"),
    [
        (b"<!DOCTYPE html><html><head><TITLE>\nLog in\n first</TITLE>", "Log in first"),
        (b"<html><body>no title", ""),
        (b"\xef\xbb\xbf  plain\r\ntext", "plain"),
        (b"\xff\xfe\x00\x1b[31mred", "��[31mred"),
        (b"x" * 5000, "x" * 200),
        (b"", ""),
        (b"\n\n", ""),
    ],
)
def test_the_first_line_of_what_a_server_says(body: bytes, shown: str) -> None:
    assert first_line(body) == shown


@pytest.mark.parametrize(
    "script",
    [
        answers_and_stays(head("500 Oh", length=100) + b"a part\nof it"),
        answers_and_stays(head("500 Oh", CHUNKED) + chunks(b"a part\nof it", end=False)),
        answers(head("500 Oh", length=100) + b"a part\nof it"),
        _drip(head("500 Oh", CHUNKED) + chunks(b"a part\n", end=False), chunks(b"x", end=False)),
        answers_and_stays(head("500 Oh", CHUNKED) + chunks(b"a part\n", *[b"y" * 1000] * 100, end=False)),
    ],
)
def test_an_error_that_does_not_come_whole(ways: Ways, script: HttpScript) -> None:
    with HttpPeer(script, echo) as peer:
        way = ways(peer)
        began = time.monotonic()
        with pytest.raises(ProtocolError, match=r"500 Internal Server Error \(a part\)"):
            way.ask(b"x")
        assert time.monotonic() - began < PATIENT / 2
        assert way.ask(b"y") == b"y"


@pytest.mark.parametrize("then", ["reads on", "does not read", "closes"])
def test_a_request_that_is_refused_before_it_was_read(ways: Ways, then: str) -> None:
    def refuses(line: HttpLine) -> None:
        line.head()
        line.send(b"HTTP/1.1 100 Continue\r\n\r\n")
        line.send(reply(b"too long", "413 Payload Too Large"))
        if then == "reads on":
            while len(line._received) < 8_000_000:
                line._received += line.line._receive()
            del line._received[:8_000_000]
            echo(line)
        elif then == "does not read":
            line.peer.stopping.wait(PATIENT)

    with HttpPeer(refuses, echo) as peer:
        way = ways(peer)
        if then == "closes":
            with pytest.raises((LimitExceeded, ConnectionLost)):  # the response may be lost with the connection
                way.ask(bytes(8_000_000))
            assert peer.ended.acquire(timeout=PATIENT)
        else:
            with pytest.raises(LimitExceeded, match=r"\(too long\)\. A request of 8000000 bytes"):
                way.ask(bytes(8_000_000))
        if then != "does not read":
            assert way.ask(b"y") == b"y"


def test_a_server_that_says_something_before_it_reads(ways: Ways) -> None:
    def slow(line: HttpLine) -> None:
        _, headers = line.head()
        line.send(b"HTTP/1.1 102 Processing\r\n\r\n", b"HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n")
        length = int(headers["content-length"])
        while len(line._received) < length:
            line._received += line.line._receive()
        line.send(reply(b"%d" % length))
        line.wait_for_end()

    with HttpPeer(slow) as peer:
        assert ways(peer).ask(bytes(8_000_000)) == b"8000000"


# --- cookies ----------------------------------------------------------------------------------------------------------


def _cookies(*replies: tuple[str, ...]) -> HttpScript:
    return answers(*(reply(S_OK, "200 OK", *(f"Set-Cookie: {each}" for each in cookies)) for cookies in replies))


def _asked(ways: Ways, *replies: tuple[str, ...]) -> list[str]:
    """Return the cookies of a request after each of the replies."""
    with HttpPeer(_cookies(*replies, ())) as peer:
        way = ways(peer)
        for _ in range(len(replies) + 1):
            assert way.ask(b"x") == S_OK
        return [post.headers.get("cookie", "") for post in peer.posts[1:]]


def test_cookies_are_sent_back(ways: Ways) -> None:
    session = "orinkit-8080=abc; HttpOnly; SameSite=Strict; Path=/"
    assert _asked(ways, (session,), (), (session, "other = 1 ;Domain=x")) == [
        "orinkit-8080=abc",
        "orinkit-8080=abc",
        "orinkit-8080=abc; other=1",
    ]


def test_cookies_are_thrown_away(ways: Ways) -> None:
    assert _asked(
        ways,
        ("orinkit-1=a", "orinkit-2=b", "c=d"),
        ("orinkit-1=a; Path=/; Max-Age=0", "orinkit-2=", "none=; max-age=-1"),
        ("orinkit-1=new",),
    ) == ["orinkit-1=a; orinkit-2=b; c=d", "c=d", "c=d; orinkit-1=new"]


def test_cookies_of_others_may_change(ways: Ways) -> None:
    assert _asked(ways, ("route=1", "orinkit-x=1", "xorinkit-1=1"), ("route=2", "orinkit-x=2", "xorinkit-1=2")) == [
        "route=1; orinkit-x=1; xorinkit-1=1",
        "route=2; orinkit-x=2; xorinkit-1=2",
    ]


def test_cookies_have_bounds(ways: Ways) -> None:
    many = tuple(f"n{number}=1" for number in range(50))
    sent = _asked(ways, ("x=" + "y" * 5000, "no value", "=1", ""), many)
    assert sent == ["", "; ".join(many[:20])]


def test_another_session(ways: Ways) -> None:
    with HttpPeer(_cookies(("orinkit-8080=abc",), (), ("orinkit-8080=def",), ())) as peer:
        way = ways(peer)
        assert [way.ask(b"x"), way.ask(b"x")] == [S_OK, S_OK]
        with pytest.raises(ConnectionLost, match="the session has ended"):
            way.ask(b"x")


# --- connecting -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_nobody_listens(ways: Ways, scheme: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = HttpAddress(scheme, *listener.getsockname())
    way = ways(address)
    for _ in range(2):
        with pytest.raises(ConnectFailed, match="cannot connect") as caught:
            way.ask(b"x")
        assert str(address) in str(caught.value)


@pytest.mark.parametrize("host", ["robot.invalid", "a..b", "x" * 100])
def test_a_host_that_is_not_known(ways: Ways, host: str) -> None:
    with pytest.raises(ConnectFailed, match="http://"):
        ways(HttpAddress("http", host, 8080)).ask(b"x")


def test_a_server_that_comes_later(ways: Ways) -> None:
    with HttpPeer(echo) as peer:
        address = peer.address
    way = ways(address)
    with pytest.raises(ConnectFailed):
        way.ask(b"x")
    with HttpPeer(echo) as later:
        way = ways(later)
        assert way.ask(b"x") == b"x"


# --- TLS --------------------------------------------------------------------------------------------------------------

KNOWN = Credentials(cafile=str(CERTIFICATE))


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_server_with_tls(ways: Ways, host: str) -> None:
    with SecurePeer(echo) as peer:
        way = ways(peer.address._replace(host=host), KNOWN)
        for number in range(3):
            assert way.ask(b"%d" % number) == b"%d" % number
        data = b"0123456789abcdef" * 50_000
        assert way.ask(data) == data
        assert peer.connections == 1


@with_longer_times(SHORT, 1.0, PATIENT)
def test_the_time_is_up_with_tls(ways: Ways, short: float) -> None:
    with SecurePeer(after_hello(answers_and_stays(head(length=10))), echo) as peer:
        way = ways(peer, KNOWN)
        way.hello()
        assert way.ask(b"x", short) is None
        if b"x" not in peer.bodies:
            raise TooSlow
        assert way.ask(b"y") == b"y"
        assert peer.bodies == [HELLO, b"x", b"y"]


def test_a_connection_with_tls_that_was_closed_while_idle(ways: Ways) -> None:
    def once(line: HttpLine) -> None:
        line.send(reply(line.post().body))

    with SecurePeer(once) as peer:
        way = ways(peer, KNOWN)
        for number in range(3):
            assert way.ask(b"%d" % number) == b"%d" % number
            assert peer.ended.acquire(timeout=PATIENT)
        assert peer.bodies == [b"0", b"1", b"2"]


def test_a_certificate_that_is_not_trusted(ways: Ways) -> None:
    with SecurePeer(echo) as peer:
        with pytest.raises(ConnectFailed, match=r"CERTIFICATE_VERIFY_FAILED.*cafile="):
            ways(peer).ask(b"x")
        assert peer.posts == []


def test_names_are_checked() -> None:
    for access in (KNOWN, Credentials()):
        context = connection.context_of(HttpAddress("https", "127.0.0.1", 1), access)
        assert context is not None
        assert context.check_hostname
        assert context.verify_mode is ssl.CERT_REQUIRED


def test_tls_where_there_is_none(ways: Ways) -> None:
    def confused(line: HttpLine) -> None:
        line.line._receive()
        line.send(reply(b"", "400 Bad Request"))

    with HttpPeer(confused) as peer, pytest.raises(ConnectFailed, match="http:// if the server does not use TLS"):
        ways(peer.address._replace(scheme="https"), KNOWN).ask(b"x")


def test_no_tls_where_there_is(ways: Ways) -> None:
    with SecurePeer(echo) as peer:
        way = ways(peer.address._replace(scheme="http"))
        try:
            assert way.ask(b"x") == b""  # closed without a reply
        except (ProtocolError, ConnectionLost) as error:
            assert "https" in str(error) or isinstance(error, ConnectionLost)  # noqa: PT017 - one of the two


@pytest.mark.parametrize("how", ["silent", "closes"])
def test_tls_that_is_not_begun(ways: Ways, how: str) -> None:
    def begins_nothing(line: HttpLine) -> None:
        line.line._receive()
        if how == "silent":
            line.wait_for_end()

    with HttpPeer(begins_nothing) as peer:
        way = ways(peer.address._replace(scheme="https"), KNOWN)
        began = time.monotonic()
        with pytest.raises(ConnectFailed):
            way.ask(b"x", SHORT)
        assert time.monotonic() - began < PATIENT / 2


def test_a_file_that_has_no_certificates(both: Both, tmp_path: Path) -> None:
    garbage = tmp_path / "x.pem"
    garbage.write_text("no certificate")
    for name in (str(garbage), str(tmp_path / "none"), str(tmp_path), "\0"):
        with pytest.raises(InvalidValue, match="cafile"):
            Way(both, HttpAddress("https", "127.0.0.1", 1), Credentials(cafile=name))


# --- threads, tasks, interrupts ---------------------------------------------------------------------------------------

STAYING = {
    "before the head": answers_and_stays(),
    "in the body": answers_and_stays(head(length=10) + b"0x"),
    "in an error": answers_and_stays(head("500 Oh", length=10) + b"0x"),
}


@pytest.mark.parametrize("where", [*STAYING, "connecting", "tls"])
@pytest.mark.parametrize("closers", [1, 8])
@pytest.mark.parametrize("kind", [HttpPeer, SecurePeer])
def test_closing_from_another_thread_ends_a_receive(
    kind: type[HttpPeer], where: str, closers: int, full: HttpAddress
) -> None:
    kind = HttpPeer if where == "tls" else kind  # the client never begins TLS
    with kind(STAYING.get(where, answers_and_stays())) as peer:
        address = full if where == "connecting" else peer.address
        link = HttpLink(address._replace(scheme="https") if where == "tls" else address, KNOWN)
        threads = [threading.Timer(SHORT, link.close) for _ in range(closers)]
        link.send(b"x", PATIENT)
        began = time.monotonic()
        for thread in threads:
            thread.start()
        with pytest.raises(ConnectionClosed):
            link.receive(PATIENT)
        assert time.monotonic() - began < PATIENT / 2
        for thread in threads:
            thread.join()


@pytest.mark.parametrize("kind", [HttpPeer, SecurePeer])
def test_closing_from_another_thread_at_any_moment(kind: type[HttpPeer]) -> None:
    """Every call returns its own reply, until the link reports that it is closed."""
    chance = random.Random(1)
    with kind(echo) as peer:
        for _ in range(60):
            link = HttpLink(peer.address, KNOWN)
            closing = threading.Timer(chance.random() * 0.01, link.close)
            closing.start()
            with pytest.raises(ConnectionClosed):
                for number in itertools.count():
                    link.send(b"%d" % number, PATIENT)
                    assert link.receive(PATIENT) == b"%d" % number
            closing.join()


@pytest.mark.parametrize("where", [*STAYING, "after a sign"])
def test_a_last_request_of_another_thread(where: str) -> None:
    """Closing a client sends closing packets first: a pending call ends as if the link were already closed."""
    script = STAYING.get(where, answers_and_stays(head("200 OK", CHUNKED) + chunks(b"\n", end=False)))
    with HttpPeer(script, echo) as peer:
        link = HttpLink(peer.address)
        last: list[bytes | None] = []

        def goodbye() -> None:
            until(lambda: peer.posts)
            time.sleep(0.02)
            link.send(b"Func=2", PATIENT)
            last.append(link.receive(PATIENT))
            link.close()

        closing = threading.Thread(target=goodbye)
        link.send(b"x", PATIENT)
        closing.start()
        with pytest.raises(ConnectionClosed):
            while link.receive(PATIENT) == b"\n":
                pass
        closing.join()
        assert last == [b"Func=2"]
        assert peer.bodies == [b"x", b"Func=2"]


def test_a_last_request_while_another_thread_connects(full: HttpAddress) -> None:
    link = HttpLink(full)
    refused: list[OrinError] = []

    def goodbye() -> None:
        try:
            link.send(b"Func=2", PATIENT)
            link.receive(SHORT)
        except OrinError as error:
            refused.append(error)

    closing = threading.Timer(SHORT, goodbye)
    link.send(b"x", PATIENT)
    closing.start()
    began = time.monotonic()
    with pytest.raises(ConnectionClosed):
        link.receive(PATIENT)
    assert time.monotonic() - began < PATIENT / 2
    closing.join()
    assert [type(error) for error in refused] == [ConnectFailed]
    link.close()


def test_a_last_request_of_another_task() -> None:
    async def body(peer: HttpPeer) -> None:
        link = AsyncHttpLink(peer.address)
        for wait in (0.0, SHORT):
            link.send(b"x")
            waiting = asyncio.ensure_future(link.receive(PATIENT))
            await asyncio.sleep(wait)
            link.send(b"Func=2")
            assert await link.receive(PATIENT) == b"Func=2"
            with pytest.raises(ConnectionClosed):
                await waiting
        link.close()
        await asyncio.sleep(0)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    def silent_at_first(line: HttpLine) -> None:
        while True:
            body = line.post().body
            if body == b"x":
                line.wait_for_end()
            line.send(reply(body))

    with HttpPeer(silent_at_first) as peer:
        asyncio.run(body(peer))


def test_threads_one_after_the_other() -> None:
    with HttpPeer(echo) as peer:
        link = HttpLink(peer.address)
        lock, wrong = threading.Lock(), []

        def work(thread: int) -> None:
            for number in range(50):
                token = b"%d/%d" % (thread, number)
                with lock:
                    link.send(token, PATIENT)
                    if link.receive(PATIENT) != token:
                        wrong.append(token)

        threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong
        assert peer.connections == 1
        link.close()


@pytest.mark.parametrize("where", [*STAYING, "connecting", "tls"])
def test_closing_from_another_task_ends_a_receive(where: str, full: HttpAddress) -> None:
    async def body(address: HttpAddress) -> None:
        link = AsyncHttpLink(address)
        link.send(b"x")
        waiting = asyncio.ensure_future(link.receive(PATIENT))
        await asyncio.sleep(SHORT)
        link.close()
        link.close()
        with pytest.raises(ConnectionClosed):
            await waiting
        assert asyncio.all_tasks() == {asyncio.current_task()}

    with HttpPeer(STAYING.get(where, answers_and_stays())) as peer:
        address = full if where == "connecting" else peer.address
        asyncio.run(body(address._replace(scheme="https") if where == "tls" else address))


@pytest.mark.parametrize("turns", range(12))
@pytest.mark.parametrize("kind", [HttpPeer, SecurePeer])
def test_closing_at_any_moment_leaves_nothing_behind(kind: type[HttpPeer], turns: int) -> None:
    both = Both("async")
    with kind(echo) as peer:

        async def body() -> None:
            link = AsyncHttpLink(peer.address, KNOWN)
            for _ in range(turns % 3):
                link.send(b"w")
                assert await link.receive(PATIENT) == b"w"
            link.send(b"x")
            waiting = asyncio.ensure_future(link.receive(PATIENT))
            for _ in range(turns):
                await asyncio.sleep(0)
            waiting.cancel()
            link.close()
            (outcome,) = await asyncio.gather(waiting, return_exceptions=True)
            assert outcome == b"x" or isinstance(outcome, asyncio.CancelledError)

        both.run(body())
        both.close()


def test_a_cancelled_receive_goes_on() -> None:
    go_on = threading.Event()

    def slow(line: HttpLine) -> None:
        body = line.post().body
        assert go_on.wait(PATIENT)
        line.send(reply(body))
        line.wait_for_end()

    async def body(peer: HttpPeer) -> None:
        link = AsyncHttpLink(peer.address)
        link.send(HELLO)
        assert await link.receive(PATIENT) == HELLO
        link.send(b"x")
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(SHORT):
                await link.receive(PATIENT)
        assert await link.receive(SHORT) is None
        go_on.set()
        assert await link.receive(PATIENT) == b"x"
        assert peer.bodies == [HELLO, b"x"]
        link.close()

    with HttpPeer(after_hello(slow)) as peer:
        asyncio.run(body(peer))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", [HttpPeer, SecurePeer])
def test_receives_cancelled_at_random_moments(kind: type[HttpPeer], seed: int) -> None:
    """After any cancellation, each later call returns its own reply, and nothing is posted twice."""

    def in_pieces(line: HttpLine) -> None:
        chance = random.Random(seed)
        while True:
            answer = head("200 OK", CHUNKED) + chunks(b"\n", b"=", line.post().body)
            cut = chance.randrange(len(answer))
            line.send(answer[:cut])
            line.send(answer[cut:])

    async def body(peer: HttpPeer) -> None:
        chance = random.Random(seed)
        link = AsyncHttpLink(peer.address, KNOWN)
        cancelled = right = 0
        for number in itertools.count():
            if number >= 150 and cancelled > 20 and right > 20:
                break
            token = b"%d" % number
            link.send(token)
            call = asyncio.ensure_future(_whole(link))
            for _ in range(chance.randrange(20)):
                await asyncio.sleep(0 if chance.random() < 0.9 else 0.001)
            if chance.random() < 0.6:
                call.cancel()
            try:
                assert await call == b"=" + token
                right += 1
            except asyncio.CancelledError:
                cancelled += 1
        assert len(peer.bodies) == len(set(peer.bodies))
        link.close()
        await asyncio.sleep(0)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    with kind(in_pieces) as peer:
        asyncio.run(body(peer))


async def _whole(link: AsyncHttpLink) -> bytes | None:
    received: bytes | None = b"\n"
    while received == b"\n":
        received = await link.receive(PATIENT)
    return received


def test_another_event_loop() -> None:
    with HttpPeer(echo) as peer:
        first, second = Both("async"), Both("async")
        way = Way(first, peer.address)
        assert way.ask(b"x") == b"x"
        stranger = Way.__new__(Way)
        stranger.both, stranger.link = second, way.link
        with pytest.raises(TransportError, match="event loop"):
            stranger.send(b"y")
        with pytest.raises(TransportError, match="event loop"):
            stranger.receive()
        assert way.ask(b"z") == b"z"
        way.close()
        first.close()
        second.close()


class Interrupt(BaseException):
    """An exception like KeyboardInterrupt."""


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")  # an interrupt may hit while a socket is being made,
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # or in a callback that has no caller
@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="this system has no such signals")
def test_a_link_that_was_interrupted_is_in_step() -> None:
    armed, stop = False, threading.Event()  # the interrupted code could hold the lock of an Event

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal armed
        if armed:
            armed = False
            raise Interrupt

    def interrupt() -> None:
        chance = random.Random(1)
        while not stop.wait(chance.random() * 0.002):
            os.kill(os.getpid(), signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, handle)
    interrupting = threading.Thread(target=interrupt)
    interrupted = right = 0
    with HttpPeer(echo) as peer:
        link = HttpLink(peer.address)
        link.send(HELLO, PATIENT)
        assert link.receive(PATIENT) == HELLO  # everything is already imported
        interrupting.start()
        try:
            for number in itertools.count():
                if right > 200 and interrupted > 60:
                    break
                token = b"%d" % number
                try:
                    try:
                        armed = True
                        link.send(token, PATIENT)
                        received = link.receive(PATIENT)
                    finally:
                        armed = False
                    assert received == token
                    right += 1
                except Interrupt:
                    interrupted += 1
        finally:
            stop.set()
            interrupting.join()
            signal.signal(signal.SIGUSR1, before)
        link.close()
        assert len(peer.bodies) == len(set(peer.bodies))


# --- random replies ---------------------------------------------------------------------------------------------------

_PARTS = st.sampled_from(
    [
        b"HTTP/1.1 200 OK\r\n", b"HTTP/1.1 302 Found\r\n", b"HTTP/1.1 503 \xff\r\n", b"HTTP/1.0 200\r\n", b"HTTP/1.1 100 \r\n\r\n",
        b"Content-Length: 3\r\n", b"Transfer-Encoding: chunked\r\n", b"Connection: close\r\n", b"Orinkit-Executing: 400\r\n",
        b"Set-Cookie: orinkit-1=\xe6\x97\xa5; Max-Age=\r\n", b"Set-Cookie: ;;=;\r\n", b"Location: http://\xff:99999/\r\n",
        b"Location: //[::1\r\n", b"Location: ftp:\r\n", b"Location: http://xn--/\r\n", b"Content-Encoding: br\r\n",
        b"Content-Type: text/html; charset=nonsense\r\n", b"\r\n", b"0x0", b"3\r\n0x0\r\n", b"0\r\n\r\n", b"\n", b"\xff\x00",
    ]
)  # fmt: skip


@given(
    sent=st.lists(_PARTS | st.binary(max_size=5), max_size=12).map(b"".join), kind=st.sampled_from(["sync", "async"])
)
def test_whatever_comes_is_an_answer_or_an_error_of_orinkit(fuzzed: Any, sent: bytes, kind: str) -> None:
    peer, ways = fuzzed
    peer.sent = sent
    way = ways[kind]
    way.link._contact.reports_executing = None
    try:
        received: bytes | None = way.ask(b"x")
        while received == b"\n":
            received = way.receive()
    except OrinError as error:
        assert len(str(error)) < 800  # noqa: PT017 - or a reply
    else:
        assert received is not None


class _Fuzzed(HttpPeer):
    sent = b""

    def __init__(self) -> None:
        super().__init__(self._script)

    def _script(self, line: HttpLine) -> None:
        line.post()
        line.send(self.sent)
        line.line._socket.shutdown(socket.SHUT_WR)
        line.wait_for_end()


@pytest.fixture(scope="module")
def fuzzed() -> Iterator[Any]:
    both = {kind: Both(kind) for kind in ("sync", "async")}
    with _Fuzzed() as peer:
        ways = {kind: Way(each, peer.address) for kind, each in both.items()}
        yield peer, ways
        for way in ways.values():
            way.close()
    for each in both.values():
        each.close()


# --- without the package ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("module", ["link", "aio_link"])
def test_httpx2_is_missing(monkeypatch: pytest.MonkeyPatch, module: str) -> None:
    monkeypatch.setitem(sys.modules, "httpx2", None)
    monkeypatch.delitem(sys.modules, f"orinkit.transport.http.{module}")
    with pytest.raises(MissingExtra, match=r"e-CAP over HTTP needs httpx2.*orinkit\[http\]"):
        importlib.import_module(f"orinkit.transport.http.{module}")


def test_a_peer_that_is_gone_is_no_error_of_the_test() -> None:
    """The scripts of this file end when the client has disconnected."""
    with HttpPeer(echo) as peer, socket.create_connection(("127.0.0.1", peer.port)) as client:
        client.close()
        assert peer.ended.acquire(timeout=PATIENT)
    assert issubclass(Gone, Exception)
