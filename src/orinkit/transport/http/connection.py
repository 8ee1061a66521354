"""The connection of a client over HTTP, on the caller's own thread.

Nothing is ever posted twice: httpx2 is given a transport with a single connection, which is looked at before it is used. A
time-out of httpx2 is for one piece of what comes; that of a call is for all of it, so every wait of this transport ends when
the time of the call is up.
"""

from __future__ import annotations

import select
import socket
import ssl
import threading
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import httpcore2
import httpx2

from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import Credentials
from orinkit.transport.http.response import BEGIN, KEPT, HttpServerInfo, no_certificates, no_url, tls_failed
from orinkit.transport.link_errors import closed, connect_failed, lost
from orinkit.transport.runner import Deadline
from orinkit.transport.tcp_keepalive import prepare


class HttpConnection(httpx2.BaseTransport):
    """One connection to one server, opened when it is needed.

    Attributes:
        deadline: when every wait ends.
        closed: for good.
        halted: the thread that uses it is to stop.
    """

    def __init__(self, known: KnownServer, url: httpx2.URL) -> None:
        contact = known.contact
        self.deadline = Deadline(0.0)
        self._contact = contact
        self._url = httpcore2.URL(
            scheme=url.raw_scheme, host=url.raw_host, port=contact.address.port, target=url.raw_path
        )
        self._context = known.context
        self._dead_after = known.dead_after
        self._connection: httpcore2.HTTP11Connection | None = None
        self._stream: _Stream | None = None
        self._socket: socket.socket | None = None
        self._left: socket.socket | None = None  # by a parent
        self._changing = threading.RLock()  # while a socket is closed no other thread touches it
        self.closed = False
        self.halted = False

    @property
    def stopped(self) -> bool:
        """Whether nothing is to be waited for any more."""
        return self.closed or self.halted

    @property
    def ended(self) -> bool:
        """Whether the other side has closed the connection."""
        return self._stream is not None and self._stream.ended

    @property
    def unanswered(self) -> bool:
        """Whether it has done so without a byte of an answer."""
        return self._stream is not None and self._stream.ended and not self._stream.begin

    def connect(self) -> None:
        """See to it that there is a connection over which nothing is under way, and which the other side has not closed.

        Raises:
            ConnectFailed: there is none.
        """
        if self._connection is not None and self._connection.is_available() and not self._connection.has_expired():
            return
        self._hang_up()
        self._stream = _Stream(self._open(), self, self._contact)
        self._connection = httpcore2.HTTP11Connection(self._url.origin, self._stream, KEPT)

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        """Send a request over the connection, once, and return the reply as soon as its headers have come."""
        reply = self._exchange(request)
        if reply is None:
            self._hang_up()
            self.connect()
            reply = self._exchange(request)
        assert reply is not None
        return httpx2.Response(reply.status, headers=reply.headers, stream=_BodyStream(reply))

    def _exchange(self, request: httpx2.Request) -> httpcore2.Response | None:
        """Return the reply, ``None`` where something came behind the last one; then nothing has been sent."""
        assert self._connection is not None
        assert self._stream is not None
        assert isinstance(request.stream, httpx2.SyncByteStream)
        self._stream.begin = b""
        try:
            reply = self._connection.handle_request(
                httpcore2.Request(request.method, self._url, headers=request.headers.raw, content=request.stream)
            )
        except httpcore2.ProtocolError:
            if self._stream.unsent:
                return None
            raise
        return None if self._stream.unsent else reply

    def drop(self) -> None:
        """Close the connection if something is under way over it."""
        if self._connection is not None and not self._connection.is_idle():
            self._hang_up()

    def close(self) -> None:
        """End the connection for good; may be called from another thread, and again."""
        self.closed = True
        self.halt()

    def halt(self) -> None:
        """Have the thread that uses the connection stop, from another one."""
        self.halted = True
        with self._changing:
            self._end()

    def left_behind(self) -> Iterable[int]:
        """Be closed for good in a forked child; returns the descriptor."""
        self.closed = self.halted = True
        self._changing = threading.RLock()
        left, self._socket = self._socket, None  # not to be shut down from here
        self._left = left
        return () if left is None else (left.fileno(),)

    def let_go(self) -> None:
        """Give the descriptor back; nothing is under way."""
        if self._socket is not None:
            self.part(self._socket)

    def part(self, connection: socket.socket) -> None:
        """Close a socket."""
        with self._changing:
            connection.close()

    def _hang_up(self) -> None:
        self._connection = None
        with self._changing:
            self._end()
        self.let_go()

    def _end(self) -> None:
        try:
            if self._socket is not None:
                socket.socket.shutdown(self._socket, socket.SHUT_RDWR)  # SSLSocket's own goes on without TLS
        except OSError:  # the other side may have gone first
            pass

    def _open(self) -> socket.socket:
        """Connect to the first place that can be reached."""
        address = self._contact.address
        try:
            places = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
            connection = self._first(places)
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error
        if self._context is None:
            return connection
        try:
            return self._secure(connection, self._context)
        except (OSError, ValueError) as error:
            raise tls_failed(address, error) from error

    def _first(self, places: list[tuple[Any, ...]]) -> socket.socket:
        failure: OSError = closed()
        for left, (family, kind, protocol, _, place) in zip(range(len(places), 0, -1), places, strict=True):
            if self.stopped:
                break
            try:
                return self._reach(socket.socket(family, kind, protocol), place, self.deadline.left / left)
            except OSError as error:
                failure = error
        raise failure

    def _reach(self, connection: socket.socket, place: Any, seconds: float) -> socket.socket:
        try:
            self._take(connection, seconds)
            prepare(connection, self._dead_after)
            connection.connect(place)
        except BaseException:
            self.part(connection)
            raise
        return connection

    def _secure(self, connection: socket.socket, context: ssl.SSLContext) -> socket.socket:
        secure = connection
        try:
            host = self._contact.address.host
            with self._changing:  # a socket that another thread shuts down meanwhile would be left open by ssl
                if self.stopped:
                    raise closed()
                secure = context.wrap_socket(connection, server_hostname=host, do_handshake_on_connect=False)
            self._take(secure, self.deadline.left)
            secure.do_handshake()
        except BaseException:
            self.part(secure)
            raise
        return secure

    def _take(self, connection: socket.socket, seconds: float) -> None:
        """Make a socket this transport's, so that another thread can close it."""
        if not seconds:
            raise TimeoutError("timed out")
        connection.settimeout(seconds)
        self._socket = connection
        if self.stopped:
            raise closed()


class _Stream(httpcore2.NetworkStream):
    """A connection, every wait of which ends with the transport's deadline.

    Attributes:
        unsent: what has been written, and is sent when an answer is waited for.
        begin: the first bytes of the reply.
        ended: the other side has closed the connection.
    """

    def __init__(self, connection: socket.socket, transport: HttpConnection, contact: HttpServerInfo) -> None:
        self._socket = connection
        self._transport = transport
        self._contact = contact
        self._can_look = hasattr(select, "poll") and not isinstance(connection, ssl.SSLSocket)
        self._going = memoryview(b"")  # what is being sent
        self._torn = False
        self.unsent = bytearray()
        self.begin = b""
        self.ended = False

    def write(self, buffer: bytes, timeout: float | None = None) -> None:  # noqa: ARG002 - declared by the base
        """Keep bytes, so that headers and body travel together."""
        self.unsent += buffer

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:  # noqa: ARG002
        """Send what has been written, and return the next bytes, which may come before all is sent."""
        try:
            if self.unsent:
                self._going, self.unsent = memoryview(self.unsent), bytearray()
                self._send()
            while self._going and self._is_taken():
                self._send()
            self._limit()
            data = self._socket.recv(max_bytes)
        except TimeoutError as error:
            raise httpcore2.ReadTimeout from error
        except (OSError, ValueError) as error:  # a ValueError from TLS that another thread has closed
            raise lost(error) from error
        self.ended = not data
        if len(self.begin) < BEGIN:
            self.begin += data[:BEGIN]
            self._contact.check_begin(self.begin)
        return data

    def _send(self) -> None:
        try:
            self._limit()
            self._going = self._going[self._socket.send(self._going) :]
        except TimeoutError:
            raise
        except OSError:  # a server may refuse a request that it has not read, and close
            self._torn = True
            self._going = memoryview(b"")

    def _is_taken(self) -> bool:
        """Wait until the other side takes more, or says something before it has all."""
        if not self._can_look:
            return True
        looking = select.poll()
        looking.register(self._socket.fileno(), select.POLLIN | select.POLLOUT)
        events = looking.poll(self._transport.deadline.left * 1000)
        if not events:
            raise TimeoutError
        return not events[0][1] & select.POLLIN

    def _limit(self) -> None:
        left = self._transport.deadline.left
        if not left:
            raise TimeoutError
        self._socket.settimeout(left)

    def close(self) -> None:
        """Close."""
        self._transport.part(self._socket)

    def get_extra_info(self, info: str) -> Any:
        """Tell whether the connection, over which nothing is under way, is of no more use: bytes, or the end, have come."""
        if info == "is_readable":
            return self._torn or bool(self._going) or has_news(self._socket.fileno())
        return None


class _BodyStream(httpx2.SyncByteStream):
    """The body of a reply."""

    def __init__(self, reply: httpcore2.Response) -> None:
        self._reply = reply

    def __iter__(self) -> Iterator[bytes]:
        return self._reply.iter_stream()

    def close(self) -> None:
        """Close, and with it the connection if more of the body is to come."""
        self._reply.close()


def url_of(contact: HttpServerInfo) -> httpx2.URL:
    """Return the URL that requests are for.

    Raises:
        InvalidAddress: there can be no such URL.
    """
    try:
        return httpx2.URL(contact.url)
    except httpx2.InvalidURL as error:
        raise no_url(contact.address, error) from error


class KnownServer(NamedTuple):
    """What is known of a server.

    Attributes:
        contact: with it.
        context: how its certificate is checked, ``None`` without TLS.
        dead_after: seconds without an answer from its machine after which a connection is given up.
    """

    contact: HttpServerInfo
    context: ssl.SSLContext | None
    dead_after: float


def context_of(address: HttpAddress, access: Credentials) -> ssl.SSLContext | None:
    """Return how a server is known, ``None`` without TLS.

    Raises:
        InvalidValue: there are no certificates in the file.
    """
    if address.scheme != "https":
        return None
    if access.cafile:
        try:
            context = ssl.create_default_context(cafile=access.cafile)
        except (OSError, ValueError) as error:
            raise no_certificates(access.cafile, error) from error
    else:
        context = httpx2.create_ssl_context(trust_env=False)
    context.set_alpn_protocols(["http/1.1"])
    return context


def has_news(descriptor: int) -> bool:
    """Tell whether something waits to be received, or the end; a socket that is closed has that."""
    if descriptor < 0:
        return True
    try:
        if not hasattr(select, "poll"):  # Windows
            return bool(select.select([descriptor], [], [], 0)[0])
        waiting = select.poll()
        waiting.register(descriptor, select.POLLIN)
        return bool(waiting.poll(0))
    except (OSError, ValueError):
        return True
