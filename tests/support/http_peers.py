"""HTTP servers on raw sockets that misbehave by script: :class:`HttpPeer`, the counterpart of :class:`peers.BadPeer` for b-CAP.

::

    def answers_twice(line: HttpLine) -> None:
        line.post()
        line.send(reply(b"0x00000000") * 2)

    with HttpPeer(answers_twice) as peer:
        ...  # connect to peer.address

Every connection runs the next script, further ones the last script; ``peer.posts`` contains all requests received.
"""

from __future__ import annotations

import ssl
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from orinkit.transport.address import HttpAddress
from support.paths import DATA
from support.peers import BadPeer, Gone, Line

CERTIFICATE = DATA / "localhost.pem"
"""Self-signed, for localhost, 127.0.0.1 and ::1, valid from 2020 to 2120."""
KEY = CERTIFICATE.with_name("localhost-key.pem")
S_OK = b"0x00000000"


class Post(NamedTuple):
    """A request as received; names of headers are in lower case."""

    line: str
    headers: dict[str, str]
    body: bytes


def head(status: str = "200 OK", *headers: str, length: int | None = None) -> bytes:
    """Return the status line and headers of a reply."""
    lines = [f"HTTP/1.1 {status}", *headers]
    if length is not None:
        lines.append(f"Content-Length: {length}")
    return "\r\n".join([*lines, "", ""]).encode()


def reply(body: bytes = S_OK, status: str = "200 OK", *headers: str) -> bytes:
    """Return a complete reply."""
    return head(status, *headers, length=len(body)) + body


def chunks(*pieces: bytes, end: bool = True) -> bytes:
    """Return the pieces of a body in the chunked encoding."""
    return b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces) + (b"0\r\n\r\n" if end else b"")


CHUNKED = "Transfer-Encoding: chunked"
WORKING = "Orinkit-Executing: 400"


class HttpLine:
    """One connection, as used by a script."""

    def __init__(self, line: Line, peer: HttpPeer) -> None:
        self.line = line
        self.peer = peer
        self._received = bytearray()

    def secure(self) -> None:
        """Perform the TLS handshake."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(CERTIFICATE, KEY)
        try:
            self.line._socket = context.wrap_socket(self.line._socket, server_side=True)
        except OSError as error:
            raise Gone from error

    def head(self) -> tuple[str, dict[str, str]]:
        """Return the request line and headers of the next request."""
        while b"\r\n\r\n" not in self._received:
            self._received += self.line._receive()
        text, _, rest = bytes(self._received).partition(b"\r\n\r\n")
        self._received = bytearray(rest)
        first, *lines = text.decode().split("\r\n")
        return first, {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}

    def post(self) -> Post:
        """Return the next request."""
        first, headers = self.head()
        length = int(headers["content-length"])
        while len(self._received) < length:
            self._received += self.line._receive()
        body = bytes(self._received[:length])
        del self._received[:length]
        request = Post(first, headers, body)
        self.peer.posts.append(request)
        return request

    def send(self, *pieces: bytes) -> None:
        """Send bytes unchanged; several pieces in such a way that the client most likely receives them separately."""
        if len(pieces) == 1:
            self.line.send(pieces[0])
        else:
            self.line.send_in_pieces(*pieces)

    def serve(self, answer: Callable[[Post], bytes]) -> None:
        """Reply to requests until the client disconnects."""
        while True:
            self.send(answer(self.post()))

    def wait_for_end(self) -> None:
        """Wait until the client has closed the connection."""
        self.line.wait_for_end()

    def shut(self) -> None:
        """End the connection gracefully, even while another thread waits on it."""
        self.line.shut()

    def close(self) -> None:
        """Close the connection gracefully."""
        self.line.close()

    def reset(self) -> None:
        """Reset the connection."""
        self.line.reset()


HttpScript: TypeAlias = Callable[[HttpLine], None]


class HttpPeer(BadPeer):
    """An HTTP server that runs scripts."""

    scheme = "http"

    def __init__(self, *scripts: HttpScript) -> None:
        super().__init__(*map(self._wrapped, scripts))
        self.posts: list[Post] = []

    def _wrapped(self, script: HttpScript) -> Callable[[Line], None]:
        def run(line: Line) -> None:
            script(HttpLine(line, self))

        return run

    @property
    def address(self) -> HttpAddress:
        """The address of the server."""
        return HttpAddress(self.scheme, "127.0.0.1", self.port)

    @property
    def bodies(self) -> list[bytes]:
        """The bodies of all requests received."""
        return [post.body for post in self.posts]


class SecurePeer(HttpPeer):
    """An HTTPS server that runs scripts."""

    scheme = "https"

    def _wrapped(self, script: HttpScript) -> Callable[[Line], None]:
        def secured(line: HttpLine) -> None:
            line.secure()
            script(line)

        return super()._wrapped(secured)


def echo(line: HttpLine) -> None:
    """Reply to every request with its own body."""
    line.serve(lambda post: reply(post.body))


HELLO = b"hello"


def after_hello(script: HttpScript) -> HttpScript:
    """Return a script that replies to a first request, so that the connection exists when the next request is sent.

    The reply has the header Orinkit-Executing, so that the client applies its time-out without extension.
    """

    def run(line: HttpLine) -> None:
        line.send(reply(line.post().body, "200 OK", WORKING))
        script(line)

    return run


def answers(*replies: bytes) -> HttpScript:
    """Return a script that sends these replies unchanged and then closes the connection."""

    def script(line: HttpLine) -> None:
        for each in replies:
            line.post()
            line.send(each)

    return script


def answers_and_stays(*pieces: bytes) -> HttpScript:
    """Return a script that sends these bytes after a request, and keeps the connection open."""

    def script(line: HttpLine) -> None:
        line.post()
        line.send(*pieces)
        line.wait_for_end()

    return script
