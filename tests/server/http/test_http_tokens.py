"""Guessed tokens over HTTP, and ambiguous headers."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.cao.shared_secret import FREE
from orinkit.core import i18n
from orinkit.server.http import app
from orinkit.server.http.app import _HELD
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server
from support.devices import Workshop
from support.waiting import PATIENCE, until
from support.web import Web

TOKEN = "0123456789abcdef"
RIGHT, WRONG = f"Bearer {TOKEN}", "Bearer guess"

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")


@pytest.fixture
def server() -> Iterator[Server]:
    with orinkit.serve(Workshop(), "http://127.0.0.1:0", http=HttpOptions(token=TOKEN)) as served:
        yield served
    Web.close_all()


class DelayedReplies:
    """A replacement for ``asyncio.sleep`` that delays replies until the test opens the gate."""

    def __init__(self) -> None:
        self.delays: list[float] = []
        self.gate = threading.Event()

    async def sleep(self, seconds: float) -> None:
        self.delays.append(seconds)
        while not self.gate.is_set():  # noqa: ASYNC110 - the test polls
            await asyncio.sleep(0.005)  # another thread opens the gate


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> DelayedReplies:
    waiting = DelayedReplies()

    class Asyncio:
        sleep = staticmethod(waiting.sleep)

        def __getattr__(self, name: str) -> object:
            return getattr(asyncio, name)

    monkeypatch.setattr(app, "asyncio", Asyncio())
    return waiting


def guess(server: Server) -> Web:
    """Send a wrong token, without waiting for the reply."""
    web = Web(server.url)
    web.send(web.head("Func=1", Authorization=WRONG) + b"Func=1")
    return web


def test_guesses_are_slowed_down_and_the_right_token_is_not(
    server: Server, held: DelayedReplies, caplog: pytest.LogCaptureFixture
) -> None:
    context = server._server._context
    with Web(server.url) as web, Web(server.url, keeps_cookies=True) as client:
        assert client.ask("Func=1", Authorization=RIGHT).status == 200
        for _ in range(FREE):
            assert web.ask("Func=1", Authorization=WRONG).status == 401
        waiting = [guess(server) for _ in range(_HELD - 1)]
        until(lambda: len(held.delays) == _HELD - 1)
        assert sorted(held.delays)[:4] == [0.125, 0.25, 0.5, 1.0]
        assert web.ask("Func=1", Authorization=RIGHT).status == 200  # from the same address, meanwhile
        waiting.append(guess(server))
        until(lambda: len(held.delays) == _HELD)
        for token in (
            WRONG,
            RIGHT,
        ):  # the maximum number of replies is delayed: the status does not reveal the correct token
            with Web(server.url) as other:
                more = other.ask("Func=1", Authorization=token)
            assert (more.status, more.headers["connection"], more.headers["retry-after"]) == (429, "close", "1")
        assert client.ask("Func=1", Authorization=RIGHT).status == 200  # a client with a session is not affected
        assert sum(context.held.values()) == _HELD
        held.gate.set()
        assert [each.answer().status for each in waiting] == [401] * _HELD
    until(lambda: not context.held)
    logged = [record.getMessage() for record in caplog.records if "wrong token" in record.getMessage()]
    assert logged == ["127.0.0.1: 5 HTTP requests with a wrong token or without one"]


def test_guessing_is_slow(server: Server) -> None:
    """The attack: one guess after the other; without delays, there were 1,100 per second."""
    begin = time.monotonic()
    with Web(server.url) as web:
        for _ in range(FREE + 4):
            assert web.ask("Func=1", Authorization=WRONG).status == 401
    assert time.monotonic() - begin >= 1.8


@pytest.mark.parametrize("token", ["x", "0123456789abcde"])
def test_a_weak_token_causes_a_warning(token: str, caplog: pytest.LogCaptureFixture) -> None:
    for lang, text in (("en", "can be guessed. Try: use 16 or more"), ("ja", "推測されるおそれがあります")):
        i18n.use("ja" if lang == "ja" else "en")
        with orinkit.serve(Workshop(), "http://127.0.0.1:0", http=HttpOptions(token=token)):
            pass
        assert text in caplog.text


def test_a_strong_token_causes_no_warning(server: Server, caplog: pytest.LogCaptureFixture) -> None:
    assert "can be guessed" not in caplog.text
    assert server.url


# --- headers ----------------------------------------------------------------------------------------------------------


def answer_to(server: Server, *lines: str, body: str = "Func=1") -> bytes:
    """Send a header and a body; return everything received until the server closes the connection."""
    host, _, port = server.url.removeprefix("http://").rpartition(":")
    received = b""
    with socket.create_connection((host, int(port)), PATIENCE) as raw:
        raw.sendall("\r\n".join(("POST / HTTP/1.1", *lines, "", body)).encode())
        try:
            while data := raw.recv(65536):
                received += data
        except ConnectionError:
            pass
    return received


HOST, LENGTH, TOKEN_HEADER = "Host: 127.0.0.1", "Content-Length: 6", f"Authorization: {RIGHT}"
FORM = "Content-Type: application/x-www-form-urlencoded"


@pytest.mark.parametrize(
    ("twice", "first"),
    [
        (f"Authorization: {WRONG}", TOKEN_HEADER),
        (TOKEN_HEADER, f"Authorization: {WRONG}"),
        (TOKEN_HEADER, TOKEN_HEADER),
        ("Origin: http://127.0.0.1", "Origin: http://evil.example"),
        ("Host: evil.example", HOST),
        (HOST, HOST),
        ("Content-Type: text/plain", FORM),
        (FORM, FORM),
        ("Content-Length: 5", LENGTH),
        ("Transfer-Encoding: chunked", LENGTH),
    ],
)
def test_ambiguous_headers_are_refused(server: Server, twice: str, first: str) -> None:
    lines = [line for line in (HOST, LENGTH, TOKEN_HEADER, FORM) if line.partition(":")[0] != first.partition(":")[0]]
    for pair in ((first, twice), (twice, first)):
        body = "6\r\nFunc=1\r\n0\r\n\r\n" if "chunked" in twice else "Func=1"
        received = answer_to(server, *pair, *lines, body=body)
        assert received.startswith(b"HTTP/1.1 400 ")
        assert b"connection: close" in received.lower()
        assert received.count(b"HTTP/1.1 400") == 1
    assert server.clients == 0


def test_bytes_after_an_ambiguous_request_are_not_executed(server: Server) -> None:
    hidden = f"POST / HTTP/1.1\r\n{HOST}\r\n{LENGTH}\r\n{TOKEN_HEADER}\r\n\r\nFunc=1"
    received = answer_to(server, HOST, LENGTH, TOKEN_HEADER, "Transfer-Encoding: chunked", body=f"0\r\n\r\n{hidden}")
    assert received.count(b"HTTP/1.1 4") == 1
    assert server.clients == 0


def test_the_same_request_with_each_header_once(server: Server) -> None:
    received = answer_to(server, HOST, LENGTH, TOKEN_HEADER, FORM, "Connection: close")
    assert received.startswith(b"HTTP/1.1 200 ")
