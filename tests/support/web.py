"""A raw e-CAP client over HTTP, for tests that specify every byte."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Iterator
from types import TracebackType
from typing import Any, ClassVar, NamedTuple, Self
from urllib.parse import quote, unquote

from support.waiting import PATIENCE

FORM = "application/x-www-form-urlencoded"

OK = b"0x00000000"

GET_VARIABLE, EXECUTE, GET, PUT = 9, 17, 101, 102


class Answer(NamedTuple):
    """An HTTP reply; names of headers are in lower case."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def code(self) -> int:
        """The return code."""
        assert self.status == 200, self
        return int(self.body.strip().partition(b",")[0], 16)

    @property
    def result(self) -> str:
        """The result after the return code, which must be S_OK."""
        assert self.code == 0, self
        return self.body.strip().partition(b",")[2].decode()

    @property
    def handle(self) -> int:
        """The handle in the result."""
        assert self.result.startswith("3,"), self
        return int(self.result[2:])

    @property
    def detail(self) -> str:
        """The error description."""
        return unquote(self.headers.get("orinkit-detail", ""))


class Web:
    """One connection of a raw client. All of them are closed at the end of a test."""

    opened: ClassVar[list[Web]] = []

    def __init__(self, url: str, *, keeps_cookies: bool = False, context: ssl.SSLContext | None = None) -> None:
        self.place = url.partition("//")[2].partition("/")[0]
        host, _, port = self.place.rpartition(":")
        self.socket = socket.create_connection((host, int(port)), PATIENCE)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if context is not None:
            self.socket = context.wrap_socket(self.socket, server_hostname=host)
        self.keeps_cookies = keeps_cookies
        self.cookie = ""
        self._rest = b""
        self.opened.append(self)

    @classmethod
    def close_all(cls) -> None:
        """Close all connections."""
        while cls.opened:
            cls.opened.pop().close()

    def send(self, data: bytes) -> None:
        """Send bytes unchanged."""
        self.socket.sendall(data)

    def head(self, body: bytes | str = b"", method: str = "POST", path: str = "/ecap", **headers: str) -> bytes:
        """Return the header of a request; an empty value as in ``Content_Type=""`` omits a line."""
        length = str(len(body.encode() if isinstance(body, str) else body))
        given = {"Host": self.place, "Content-Type": FORM, "Content-Length": length}
        if self.cookie:
            given["Cookie"] = self.cookie
        given.update({name.replace("_", "-"): value for name, value in headers.items()})
        lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items() if value)]
        return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1")

    def ask(self, body: bytes | str, method: str = "POST", path: str = "/ecap", **headers: str) -> Answer:
        """Send a request and return the reply."""
        self.send(self.head(body, method, path, **headers) + (body.encode() if isinstance(body, str) else body))
        return self.answer(bodiless=method == "HEAD")

    def call(self, function: int, *arguments: Any) -> Answer:
        """Call a function with percent-encoded arguments."""
        return self.ask(request(function, *arguments))

    def line(self) -> bytes:
        """Return the next line."""
        while b"\n" not in self._rest:
            self._more()
        line, _, self._rest = self._rest.partition(b"\n")
        return line.removesuffix(b"\r")

    def answer(self, *, bodiless: bool = False) -> Answer:
        """Return the next reply."""
        status = int(self.line().split(b" ")[1])
        headers: dict[str, str] = {}
        while line := self.line():
            name, _, value = line.decode("latin-1").partition(":")
            headers[name.lower()] = value.strip()
        if status in (100, 204):
            return Answer(status, headers, b"")
        if self.keeps_cookies and "set-cookie" in headers:
            self.cookie = headers["set-cookie"].partition(";")[0]
        return Answer(status, headers, b"" if bodiless else b"".join(self.pieces(headers)))

    def pieces(self, headers: dict[str, str]) -> Iterator[bytes]:
        """Yield a body: chunk by chunk, by Content-Length, or up to the end of the connection."""
        if headers.get("transfer-encoding") == "chunked":
            while size := int(self.line(), 16):
                yield self.take(size)
                assert self.line() == b""
            assert self.line() == b""
        elif "content-length" in headers:
            yield self.take(int(headers["content-length"]))
        else:
            yield self.rest()

    def take(self, count: int) -> bytes:
        """Return the next ``count`` bytes."""
        while len(self._rest) < count:
            self._more()
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken

    def rest(self) -> bytes:
        """Return all bytes up to the end of the connection."""
        while data := self.socket.recv(65536):
            self._rest += data
        taken, self._rest = self._rest, b""
        return taken

    def _more(self) -> None:
        data = self.socket.recv(65536)
        if not data:
            raise EOFError(self._rest)
        self._rest += data

    def ended(self) -> bool:
        """Return True if the stream has ended, False if data has arrived."""
        try:
            return not self._rest and self.socket.recv(1) == b""
        except ConnectionError:
            return True

    def close(self) -> None:
        self.socket.close()

    def reset(self) -> None:
        """Reset the connection."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def request(function: int, *arguments: Any) -> str:
    """Return the body of a call."""
    return ",".join([f"Func={function}", *(f"Arg{n}={quote(str(a))}" for n, a in enumerate(arguments, 1))])


def curl(url: str, function: int, *arguments: Any) -> Answer:
    """Call a function as ``curl`` does: one connection per call, no cookies."""
    with Web(url) as web:
        return web.ask(request(function, *arguments), Connection="close")


def connect(web: Web, provider: str = "Test.Workshop") -> int:
    """Start the service, connect to the workshop and return the handle of the controller."""
    assert web.cookie or web.call(1).body == OK
    return web.call(3, "", provider, "localhost", "").handle


GARBAGE = {
    "noise": bytes(range(256)) * 10,
    "zeros": bytes(5000),
    "b-CAP": bytes.fromhex("0110000000000000000001000000000004"),
    "TLS": bytes.fromhex("16030100c8010000c40303") + bytes(200),
    "HTTP/2": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "no line": b"\r\n\r\n\r\n\r\n",
    "one word": b"POST\r\n\r\n",
    "no host": b"POST / HTTP/1.1\r\nContent-Length: 0\r\n\r\n",
    "two hosts": b"POST / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    "a colon missing": b"POST / HTTP/1.1\r\nHost: a\r\nwhat\r\n\r\n",
    "a blank before the colon": b"POST / HTTP/1.1\r\nHost : 127.0.0.1\r\n\r\n",
    "zero in a header": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: a\0b\r\n\r\n",
    "length is no number": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
    "length is huge": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n",
    "length of 19 digits": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: " + b"9" * 19 + b"\r\n\r\nFunc=1",
    "two lengths": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 6\r\nContent-Length: 7\r\n\r\nFunc=1",
    "another coding": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: gzip, chunked\r\n\r\n",
    "no chunk": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    "a negative chunk": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n-1\r\n",
    "a chunk too short": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n2\r\nabcd\r\n",
    "a huge chunk": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n" + b"f" * 30 + b"\r\n",
    "a long header": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 100_000 + b"\r\n\r\n",
    "many headers": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"a: b\r\n" * 20_000 + b"\r\n",
    "a long line": b"POST /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
    "version": b"POST / HTTP/9.9\r\nHost: 127.0.0.1\r\n\r\n",
    "no version": b"POST /\r\n\r\n",
    "cookies": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: ;;=;a;orinkit=;\xff=\xfe;orinkit-1=\"\r\nContent-Length: 6\r\n\r\nFunc=1",
    "headers of ours": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrinkit-Executing: -1\r\nContent-Length: 6\r\n\r\nFunc=1",
    "a request, and noise": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 6\r\n\r\nFunc=1\xff\xfe\0\r\n\r\n",
    "an end of line too many": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 6\r\n\r\nFunc=1\r\n",
}  # fmt: skip
