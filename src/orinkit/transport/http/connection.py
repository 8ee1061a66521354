"""The synchronous HTTP connection of a client.

No request is ever posted twice: httpx2 uses a transport with a single connection, which is checked before each use. The
time-outs of httpx2 apply to each piece of a reply, but the time-out of a call applies to the whole reply. Therefore
every wait of this transport ends at the deadline of the call.
"""

from __future__ import annotations

import select
import socket
import ssl
import threading
from collections.abc import Iterable, Iterator
from typing import Any

import httpcore2
import httpx2

from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import Credentials
from orinkit.transport.http.response import KEPT, HttpServerInfo, no_certificates, no_url, tls_failed
from orinkit.transport.http.single_connection import KnownServer, SingleConnection, StreamBuffers
from orinkit.transport.link_errors import closed, connect_failed, lost
from orinkit.transport.runner import Deadline
from orinkit.transport.tcp_keepalive import prepare


class _Stream(StreamBuffers, httpcore2.NetworkStream):
    """A connection on which every wait ends at the transport's deadline."""

    def __init__(self, connection: socket.socket, transport: HttpConnection, contact: HttpServerInfo) -> None:
        super().__init__(contact)
        self._socket = connection
        self._transport = transport
        self._can_poll = hasattr(select, "poll") and not isinstance(connection, ssl.SSLSocket)
        self._sending = memoryview(b"")  # bytes being sent
        self._torn = False

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        """Store bytes, so that headers and body are sent together."""
        self.unsent += buffer

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        """Send the stored bytes, and return the next received bytes, which may arrive before all bytes are sent."""
        try:
            if self.unsent:
                self._sending, self.unsent = memoryview(self.unsent), bytearray()
                self._send()
            while self._sending and self._wait_writable():
                self._send()
            self._limit()
            data = self._socket.recv(max_bytes)
        except TimeoutError as error:
            raise httpcore2.ReadTimeout from error
        except (OSError, ValueError) as error:  # ValueError: another thread has closed the TLS connection
            raise lost(error) from error
        return self._received(data)

    def _send(self) -> None:
        try:
            self._limit()
            self._sending = self._sending[self._socket.send(self._sending) :]
        except TimeoutError:
            raise
        except OSError:  # a server may reject a request and close the connection before it has read all
            self._torn = True
            self._sending = memoryview(b"")

    def _wait_writable(self) -> bool:
        """Wait until more bytes can be sent, or data arrives.

        Returns:
            True if more bytes can be sent, False if data has arrived.
        """
        if not self._can_poll:
            return True
        poller = select.poll()
        poller.register(self._socket.fileno(), select.POLLIN | select.POLLOUT)
        events = poller.poll(self._transport.deadline.left * 1000)
        if not events:
            raise TimeoutError
        return not events[0][1] & select.POLLIN

    def _limit(self) -> None:
        left = self._transport.deadline.left
        if not left:
            raise TimeoutError
        self._socket.settimeout(left)

    def close(self) -> None:
        """Close the connection."""
        self._transport.close_socket(self._socket)

    def get_extra_info(self, info: str) -> Any:
        """Return, for ``is_readable``, True if the idle connection is stale; return ``None`` for any other ``info``."""
        if info == "is_readable":
            return self._torn or bool(self._sending) or has_news(self._socket.fileno())
        return None


class HttpConnection(SingleConnection[httpcore2.HTTP11Connection, _Stream], httpx2.BaseTransport):
    """A single connection to a server, opened on demand.

    Attributes:
        deadline: The deadline of every wait.
        closed: True if the connection is closed permanently.
        interrupted: True if the thread that uses the connection must stop waiting.
    """

    def __init__(self, known: KnownServer, url: httpx2.URL) -> None:
        super().__init__(known, url)
        self.deadline = Deadline(0.0)
        self._socket: socket.socket | None = None
        self._left: socket.socket | None = None  # in a forked child: the socket of the parent process
        self._changing = threading.RLock()  # no other thread may use a socket while it is being closed
        self.closed = False
        self.interrupted = False

    @property
    def stopped(self) -> bool:
        """True if the thread that uses the connection must stop waiting."""
        return self.closed or self.interrupted

    def connect(self) -> None:
        """Ensure that there is an idle connection that the server has not closed.

        Raises:
            ConnectFailed: If the connection cannot be opened.
        """
        if self._must_connect():
            self._stream = _Stream(self._open(), self, self._contact)
            self._connection = httpcore2.HTTP11Connection(self._url.origin, self._stream, KEPT)

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        """Send a request once over the connection, and return the reply after its headers were received."""
        reply = self._exchange(request)
        if reply is None:
            self.abort()
            self.connect()
            reply = self._exchange(request)
        assert reply is not None
        return httpx2.Response(reply.status, headers=reply.headers, stream=_BodyStream(reply))

    def _exchange(self, request: httpx2.Request) -> httpcore2.Response | None:
        """Send a request and return the reply; send nothing and return ``None`` if data followed the previous reply."""
        connection, stream = self._begin_exchange()
        try:
            reply = connection.handle_request(self._to_send(request))
        except httpcore2.ProtocolError:
            if stream.unsent:
                return None
            raise
        return None if stream.unsent else reply

    def close(self) -> None:
        """Close the connection permanently; may be called from another thread, and repeatedly."""
        self.closed = True
        self.interrupt()

    def interrupt(self) -> None:
        """Make the thread that uses the connection stop waiting; called from another thread."""
        self.interrupted = True
        with self._changing:
            self._end()

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the connection as permanently closed in a forked child; return its descriptor, if it has one."""
        self.closed = self.interrupted = True
        self._changing = threading.RLock()
        left, self._socket = self._socket, None  # a shutdown in the child would end the parent's connection
        self._left = left
        return () if left is None else (left.fileno(),)

    def close_idle(self) -> None:
        """Close the socket of the connection, if there is one; no thread may be using the connection."""
        if self._socket is not None:
            self.close_socket(self._socket)

    def close_socket(self, connection: socket.socket) -> None:
        """Close a socket; meanwhile, no other thread can shut it down."""
        with self._changing:
            connection.close()

    def abort(self) -> None:
        """Shut the connection down, so that a thread that waits for it ends the wait; then close the connection."""
        self._connection = None
        with self._changing:
            self._end()
        self.close_idle()

    def _end(self) -> None:
        try:
            if self._socket is not None:
                socket.socket.shutdown(self._socket, socket.SHUT_RDWR)  # with SSLSocket.shutdown, reads would lose TLS
        except OSError:  # the peer may have closed first
            pass

    def _open(self) -> socket.socket:
        """Connect to the first address of the server's host that can be reached, and return the socket."""
        address = self._contact.address
        try:
            places = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
            connection = self._first(places)
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error
        if self._known.context is None:
            return connection
        try:
            return self._secure(connection, self._known.context)
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
            prepare(connection, self._known.dead_after)
            connection.connect(place)
        except BaseException:
            self.close_socket(connection)
            raise
        return connection

    def _secure(self, connection: socket.socket, context: ssl.SSLContext) -> socket.socket:
        secure = connection
        try:
            host = self._contact.address.host
            with self._changing:  # if another thread shut the socket down now, ssl would leave it open
                if self.stopped:
                    raise closed()
                secure = context.wrap_socket(connection, server_hostname=host, do_handshake_on_connect=False)
            self._take(secure, self.deadline.left)
            secure.do_handshake()
        except BaseException:
            self.close_socket(secure)
            raise
        return secure

    def _take(self, connection: socket.socket, seconds: float) -> None:
        """Store a socket as the current one, so that another thread can shut it down."""
        if not seconds:
            raise TimeoutError("timed out")
        connection.settimeout(seconds)
        self._socket = connection
        if self.stopped:
            raise closed()


class _BodyStream(httpx2.SyncByteStream):
    """The body of a reply."""

    def __init__(self, reply: httpcore2.Response) -> None:
        self._reply = reply

    def __iter__(self) -> Iterator[bytes]:
        return self._reply.iter_stream()

    def close(self) -> None:
        """Close the reply, and also the connection if the body is incomplete."""
        self._reply.close()


def url_of(contact: HttpServerInfo) -> httpx2.URL:
    """Return the URL of requests.

    Raises:
        InvalidAddress: If the URL is not valid.
    """
    try:
        return httpx2.URL(contact.url)
    except httpx2.InvalidURL as error:
        raise no_url(contact.address, error) from error


def context_of(address: HttpAddress, access: Credentials) -> ssl.SSLContext | None:
    """Return the TLS settings to verify a server's certificate; ``None`` without TLS.

    Raises:
        InvalidValue: If the file ``access.cafile`` contains no certificates.
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
    """Return True if data can be read from a socket, or if it was closed by the peer or by this process."""
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
