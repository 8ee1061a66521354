"""e-CAP over HTTP for clients, on the caller's own thread; the asynchronous twin is :mod:`orinkit.transport.aio_http_link`.

A call is one POST over a connection that is kept for the next one. Nothing is ever posted twice: httpx2 is given a transport
with a single connection, which is looked at before it is used. A time-out of httpx2 is for one piece of what comes; that of
a call is for all of it, so every wait of this transport ends when the time of the call is up.
"""

from __future__ import annotations

import select
import socket
import ssl
from collections.abc import Iterator
from typing import Any, Final

from orinkit.errors import OrinError
from orinkit.extra import require
from orinkit.transport.access import NOTHING, Access
from orinkit.transport.address import HttpAddress
from orinkit.transport.drive import Deadline
from orinkit.transport.http_reply import (
    BEGIN,
    KEPT,
    MOST,
    NEED,
    SHOWING,
    SHOWN,
    Body,
    Contact,
    no_certificates,
    not_to_be_lent,
    tls_failed,
)
from orinkit.transport.link_errors import closed, connect_failed, lost

require(NEED, "http", "httpx2")

import httpcore2  # noqa: E402 - what is missing is to be told first
import httpx2  # noqa: E402

_OK: Final = 200
_SIGN: Final = b"\n"


class HttpLink:
    """A server of e-CAP, used by one thread at a time; nothing is opened before the first request.

    Args:
        address: of the server.
        access: what lets a client in.
        most: bytes of a reply.

    Raises:
        InvalidValue: the token cannot be sent, or there are no certificates in the file.
    """

    def __init__(self, address: HttpAddress, access: Access = NOTHING, most: int = MOST) -> None:
        self._contact = Contact(address, access, most)
        self._url = httpx2.URL(self._contact.url)
        self._transport = _Transport(self._contact, self._url, context_of(address, access))
        self._client = httpx2.Client(transport=self._transport, trust_env=False)
        self._open = True
        self._request: bytes | None = None  # that has not been posted
        self._body: Body | None = None
        self._pieces: Iterator[bytes] = iter(())

    @property
    def tells(self) -> bool | None:
        """Whether the server says that it is at work on a call; ``None`` where that is not known yet."""
        return self._contact.tells

    @property
    def patience(self) -> float:
        """Seconds that a server gets for a call that cannot say that it is at work; may be set."""
        return self._contact.patience

    @patience.setter
    def patience(self, seconds: float) -> None:
        self._contact.patience = seconds

    def fileno(self) -> int:
        """Refuse.

        Raises:
            StreamError: a connection over HTTP cannot be lent.
            ConnectionClosed: the link has been closed.
        """
        if not self._open:
            raise closed()
        raise not_to_be_lent()

    def send(self, data: bytes, seconds: float) -> None:  # noqa: ARG002 - as of every link
        """Keep the body of a request, which :meth:`receive` posts.

        An earlier one that has not been answered is given up, and its connection closed.

        Raises:
            ConnectionClosed: the link was closed before.
        """
        if not self._open:
            raise closed()
        self._drop()
        self._request = data

    def receive(self, seconds: float) -> bytes | None:
        """Post the request, if that has not been done, and return what comes.

        Args:
            seconds: to wait; longer, :attr:`patience`, for a server that cannot say that it is at work.

        Returns:
            the whole answer; a line feed as a sign that the server is at work; ``b""`` if it has closed the connection
            without an answer; ``None`` when the seconds have passed. The request is then given up, and nothing more
            comes until the next one.

        Raises:
            ConnectFailed: nobody is there, or does not let this client in.
            ConnectionLost: the connection broke, or the session has ended.
            TransportError: the server has not carried out the call.
            ProtocolError: what came is no answer of e-CAP.
            LimitExceeded: it is too long.
            ConnectionClosed: the link was closed before, or is meanwhile.
        """
        if not self._open:
            raise closed()
        try:
            data = self._go_on(seconds)
        except (OrinError, httpcore2.TimeoutException, httpcore2.ProtocolError) as error:
            self._drop()
            if not self._open:
                raise closed() from error
            if isinstance(error, httpcore2.TimeoutException):
                return None
            if isinstance(error, OrinError):
                raise
            if self._transport.unanswered:
                return b""
            raise self._contact.broken(error, ended=self._transport.ended) from error
        if not self._open:
            raise closed()
        return data

    def _go_on(self, seconds: float) -> bytes | None:
        self._transport.deadline = Deadline(seconds)
        if self._request is not None:
            request, self._request = self._request, None  # whatever happens, it is posted once
            self._post(request, seconds)
        if self._body is None:
            return None
        for piece in self._pieces:
            if self._body.add(piece):
                return _SIGN
        body, self._body = self._body, None
        return body.whole()

    def _post(self, data: bytes, seconds: float) -> None:
        self._transport.connect()
        longer = self._contact.wait(data, seconds)
        if longer > seconds:
            self._transport.deadline = Deadline(longer)
        request = httpx2.Request("POST", self._url, headers=self._contact.fields(seconds), content=data)
        response = self._client.send(request, stream=True)
        headers = response.headers.multi_items()
        if response.status_code != _OK:
            raise self._contact.refusal(response.status_code, headers, self._shown(response), len(data))
        self._body = self._contact.accept(headers)
        self._pieces = response.iter_raw()

    def _shown(self, response: httpx2.Response) -> bytes:
        """Return as much of the body of an error as comes soon."""
        self._transport.deadline = Deadline(min(self._transport.deadline.left, SHOWING))
        shown = b""
        try:
            for piece in response.iter_raw():
                shown += piece
                if len(shown) >= SHOWN:
                    break
        except (OrinError, httpcore2.TimeoutException, httpcore2.ProtocolError):
            pass  # the status says enough
        return shown[:SHOWN]

    def _drop(self) -> None:
        """Give up the request that is under way, if there is one."""
        self._request = self._body = None
        self._pieces = iter(())
        self._transport.drop()

    def release(self) -> None:
        """Close, as nobody else can have it."""
        self.close()

    def close(self) -> None:
        """Close; a receive that another thread is in ends at once."""
        self._open = False
        self._transport.close()


class _Transport(httpx2.BaseTransport):
    """One connection to one server, opened when it is needed.

    Attributes:
        deadline: when every wait ends.
    """

    def __init__(self, contact: Contact, url: httpx2.URL, context: ssl.SSLContext | None) -> None:
        self.deadline = Deadline(0.0)
        self._contact = contact
        self._url = httpcore2.URL(
            scheme=url.raw_scheme, host=url.raw_host, port=contact.address.port, target=url.raw_path
        )
        self._context = context
        self._connection: httpcore2.HTTP11Connection | None = None
        self._stream: _Stream | None = None
        self._socket: socket.socket | None = None
        self._closed = False

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
        self._stream = _Stream(self._open(), self)
        self._connection = httpcore2.HTTP11Connection(self._url.origin, self._stream, KEPT)

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        """Send a request over the connection, once, and return the reply as soon as its headers have come."""
        assert self._connection is not None
        assert self._stream is not None
        assert isinstance(request.stream, httpx2.SyncByteStream)
        self._stream.begin = b""
        reply = self._connection.handle_request(
            httpcore2.Request(request.method, self._url, headers=request.headers.raw, content=request.stream)
        )
        if not self._stream.begin:  # it came with the one before
            raise self._contact.unasked()
        return httpx2.Response(reply.status, headers=reply.headers, stream=_Pieces(reply))

    def check_begin(self, begin: bytes) -> None:
        """Check the first bytes of a reply, see :meth:`Contact.check_begin`."""
        self._contact.check_begin(begin)

    def drop(self) -> None:
        """Close the connection if something is under way over it."""
        if self._connection is not None and not self._connection.is_idle():
            self._hang_up()

    def close(self) -> None:
        """Close for good; may be called from another thread, and again."""
        self._closed = True
        self._hang_up()

    def _hang_up(self) -> None:
        self._connection = None
        connection = self._socket
        if connection is not None:
            try:
                socket.socket.shutdown(connection, socket.SHUT_RDWR)  # SSLSocket's own goes on without TLS
            except OSError:  # the other side may have gone first
                pass
            connection.close()

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
            connection.close()
            raise tls_failed(address, error) from error

    def _first(self, places: list[tuple[Any, ...]]) -> socket.socket:
        for number, (family, kind, protocol, _, place) in enumerate(places):
            connection = socket.socket(family, kind, protocol)
            try:
                self._take(connection, self.deadline.left / (len(places) - number))
                connection.connect(place)
            except BaseException as error:
                connection.close()
                if self._closed or number + 1 == len(places) or not isinstance(error, OSError):
                    raise
            else:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
                return connection
        raise AssertionError

    def _secure(self, connection: socket.socket, context: ssl.SSLContext) -> socket.socket:
        host = self._contact.address.host
        secure = context.wrap_socket(connection, server_hostname=host, do_handshake_on_connect=False)
        try:
            self._take(secure, self.deadline.left)
            secure.do_handshake()
        except BaseException:
            secure.close()
            raise
        return secure

    def _take(self, connection: socket.socket, seconds: float) -> None:
        """Make a socket this transport's, so that another thread can close it."""
        if not seconds:
            raise TimeoutError("timed out")
        connection.settimeout(seconds)
        self._socket = connection
        if self._closed:
            raise closed()


class _Stream(httpcore2.NetworkStream):
    """A connection, every wait of which ends with the transport's deadline.

    Attributes:
        begin: the first bytes of the reply.
        ended: the other side has closed the connection.
    """

    def __init__(self, connection: socket.socket, transport: _Transport) -> None:
        self._socket = connection
        self._transport = transport
        self._unsent = bytearray()
        self.begin = b""
        self.ended = False

    def write(self, buffer: bytes, timeout: float | None = None) -> None:  # noqa: ARG002 - declared by the base
        """Keep bytes, so that headers and body travel together."""
        self._unsent += buffer

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:  # noqa: ARG002
        """Send what has been written, and return the next bytes."""
        try:
            if self._unsent:
                self._send()
            self._limit()
            data = self._socket.recv(max_bytes)
        except TimeoutError as error:
            raise httpcore2.ReadTimeout from error
        except OSError as error:
            raise lost(error) from error
        self.ended = not data
        if len(self.begin) < BEGIN:
            self.begin += data[:BEGIN]
            self._transport.check_begin(self.begin)
        return data

    def _send(self) -> None:
        unsent, self._unsent = self._unsent, bytearray()
        try:
            with memoryview(unsent) as view:
                sent = 0
                while sent < len(view):
                    self._limit()
                    sent += self._socket.send(view[sent:])
        except TimeoutError:
            raise
        except OSError:  # a server may refuse a request that it has not read, and close
            pass

    def _limit(self) -> None:
        left = self._transport.deadline.left
        if not left:
            raise TimeoutError
        self._socket.settimeout(left)

    def close(self) -> None:
        """Close."""
        self._socket.close()

    def get_extra_info(self, info: str) -> Any:
        """Tell whether bytes, or the end, have come over a connection that nobody has asked anything."""
        return has_news(self._socket.fileno()) if info == "is_readable" else None


class _Pieces(httpx2.SyncByteStream):
    """The body of a reply."""

    def __init__(self, reply: httpcore2.Response) -> None:
        self._reply = reply

    def __iter__(self) -> Iterator[bytes]:
        return self._reply.iter_stream()

    def close(self) -> None:
        """Close, and with it the connection if more of the body is to come."""
        self._reply.close()


def context_of(address: HttpAddress, access: Access) -> ssl.SSLContext | None:
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
