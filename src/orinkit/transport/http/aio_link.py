"""e-CAP over HTTP for clients in asyncio; the synchronous counterpart is :mod:`orinkit.transport.http.link`.

Each request is posted by its own task. The task continues if the caller of :meth:`AsyncHttpLink.receive` is cancelled
or times out. The next request, or closing the link, cancels the task and closes its connection. Closing does not block,
because httpx2 uses a connection of :mod:`orinkit.transport.sockets.aio_byte_link`, which can be closed immediately.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import aclosing
from typing import Any, Final, Self

from orinkit.core.errors import ConnectionLost, OrinError
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require
from orinkit.transport.address import HttpAddress
from orinkit.transport.http.response import KEPT, NEED, SHOWING, SHOWN, HttpServerInfo, tls_failed
from orinkit.transport.link_errors import closed, connect_failed, other_loop
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.aio_byte_link import AsyncSocketLink
from orinkit.transport.sockets.socket_link import CHUNK
from orinkit.transport.waiter import AsyncWaiter

require(tr(NEED), "http", "httpx2")

import httpcore2  # noqa: E402 - report a missing package first
import httpx2  # noqa: E402 - as above

from orinkit.transport.http.base import HttpLinkBase  # noqa: E402 - as above
from orinkit.transport.http.connection import has_news  # noqa: E402 - as above
from orinkit.transport.http.single_connection import KnownServer, SingleConnection, StreamBuffers  # noqa: E402 - as above

_OK: Final = 200
_SIGN: Final = b"\n"
_LONG: Final = 3600.0  # s
_TLS_FAILURES: Final = (ssl.SSLError, ConnectionResetError, ConnectionAbortedError)


class AsyncHttpLink(HttpLinkBase):
    """A link to an e-CAP server, in asyncio."""

    def _begin(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._transport = _HttpConnection(self._known, self._url)
        self._client = httpx2.AsyncClient(transport=self._transport, trust_env=False)
        self._asked: _PendingRequest | None = None

    @classmethod
    async def open(cls, address: HttpAddress, opening: LinkOptions) -> Self:
        """Create a link, as :func:`orinkit.transport.aio_links.open_link`; the first request opens the connection."""
        return cls(address, opening.access, opening.most, dead_after=opening.dead_after)

    def send(self, data: bytes) -> None:
        """Store the body of a request, which :meth:`receive` posts.

        An earlier request without a reply is cancelled, and its connection closed.

        Raises:
            ConnectionClosed: If the link is closed.
            TransportError: If the link was opened in another event loop.
        """
        self._check()
        self._drop()
        self._asked = _PendingRequest(data)

    async def receive(self, seconds: float) -> bytes | None:
        """Post the request, if it is not posted yet, and return the received data.

        Args:
            seconds: Time-out, s; extended to :attr:`patience` if the server does not report that a call is executing.

        Returns:
            The complete reply; a line feed if the server reports that the call is executing; ``b""`` if the server has
            closed the connection without a reply; ``None`` if the time has passed. In the last case the request
            remains in progress.

        Raises:
            ConnectFailed: If the server cannot be reached, or rejects this client.
            ConnectionLost: If the connection was lost, or the session has ended.
            TransportError: If the server has not executed the call, or the link was opened in another event loop.
            ProtocolError: If the data received is not an e-CAP reply.
            LimitExceeded: If the reply is too long.
            ConnectionClosed: If the link is closed, before or during the call.
        """
        self._check()
        asked = self._asked
        if asked is None:
            return None
        longer = seconds
        if asked.task is None:
            longer = self._wait(asked.data, seconds)
            asked.task = self._loop.create_task(self._carry(asked, seconds))
        await asked.wait(seconds)
        if not asked.news and self._is_current(asked):
            if self._transport.connecting:
                self._drop()
                raise connect_failed(self._contact.address, TimeoutError("timed out"))
            await asked.wait(longer - seconds)
        if not self._is_current(asked):
            raise closed()
        if not asked.done:
            return asked.take_sign()
        self._asked = None
        try:
            return asked.task.result()
        except OrinError:
            self._transport.close_unless_idle()
            raise

    def _is_current(self, asked: _PendingRequest) -> bool:
        """Return False if the request was cancelled by the request of another task, or because the link was closed."""
        return self._open and asked is self._asked

    def _check(self) -> None:
        if not self._open:
            raise self._unusable()
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()

    async def _carry(self, asked: _PendingRequest, seconds: float) -> bytes:
        """Post a request and return the reply; the next request, or closing the link, cancels this task."""
        try:
            return await self._post(asked, seconds)
        except httpcore2.ProtocolError as error:
            if self._transport.closed_without_reply:
                self._contact.check_closed()
                return b""
            raise self._contact.broken(error, ended=self._transport.ended) from error
        finally:
            asked.finish()

    async def _post(self, asked: _PendingRequest, seconds: float) -> bytes:
        await self._transport.connect()
        request = httpx2.Request("POST", self._url, headers=self._contact.fields(seconds), content=asked.data)
        response = await self._client.send(request, stream=True)
        headers = response.headers.multi_items()
        if response.status_code != _OK:
            shown = await self._shown(response, min(SHOWING, seconds / 2))
            raise self._contact.refusal(response.status_code, headers, shown, len(asked.data))
        body = self._contact.accept(headers)
        async with aclosing(response.aiter_raw()) as pieces:
            async for piece in pieces:
                if body.add(piece):
                    await asked.sign()
        return body.whole()

    async def _shown(self, response: httpx2.Response, seconds: float) -> bytes:
        """Return the part of the body of an error response that arrives within ``seconds``."""
        shown = b""
        try:
            async with asyncio.timeout(seconds), aclosing(response.aiter_raw()) as pieces:
                async for piece in pieces:
                    shown += piece
                    if len(shown) >= SHOWN:
                        break
        except (TimeoutError, OrinError, httpcore2.ProtocolError):
            pass  # the status is sufficient
        return shown[:SHOWN]

    def _drop(self) -> None:
        """Cancel the request in progress, if any."""
        asked, self._asked = self._asked, None
        if asked is not None:
            asked.give_up()
            self._transport.close_unless_idle()

    def close(self) -> None:
        """Close the link; a pending receive ends immediately."""
        if self._open:
            self._open = False
            self._drop()
            self._transport.abort()


class _PendingRequest:
    """A request and its state.

    An "executing" sign is a line feed by which the server reports that the call is still executing.

    Attributes:
        data: The body of the request.
        task: The task that posts the request and returns the reply, or ``b""`` if there was no reply; ``None`` if the
            task has not been started.
        done: True if the task has ended.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.task: asyncio.Task[bytes] | None = None
        self.done = False
        self._taken: asyncio.Future[None] | None = None  # set while an "executing" sign is waiting to be taken
        self._waiter = AsyncWaiter()

    @property
    def news(self) -> bool:
        """True if the request has ended, or an "executing" sign can be taken."""
        return self.done or self._taken is not None

    async def wait(self, seconds: float) -> None:
        """Wait until :attr:`news` is True, or the time has passed."""
        if self.news or seconds <= 0:
            return
        await self._waiter.wait(seconds)

    async def sign(self) -> None:
        """Store an "executing" sign that was received, and wait until :meth:`take_sign` takes it.

        Meanwhile, nothing is read from the connection. Thus a server that sends too many signs fills only its own
        buffers.
        """
        self._taken = asyncio.get_running_loop().create_future()
        self._waiter.wake()
        await self._taken

    def take_sign(self) -> bytes | None:
        """Return the "executing" sign and remove it; return ``None`` if there is none."""
        if self._taken is None:
            return None
        if not self._taken.done():
            self._taken.set_result(None)
        self._taken = None
        return _SIGN

    def finish(self) -> None:
        """Mark the task as ended."""
        self.done = True
        self._waiter.wake()

    def give_up(self) -> None:
        """Cancel the task."""
        if self.task is not None and not self.task.cancel() and not self.task.cancelled():
            self.task.exception()  # marks the exception as retrieved
        self._waiter.wake()


class _TcpStream(AsyncSocketLink, asyncio.BufferedProtocol):
    """A TCP connection, with or without TLS; created by :meth:`open`."""

    def __init__(self, dead_after: float) -> None:
        super().__init__(dead_after)
        self._view = memoryview(bytearray(CHUNK))

    @classmethod
    async def open(cls, known: KnownServer) -> Self:
        """Connect to a server.

        Raises:
            ConnectFailed: If the connection cannot be established.
        """
        loop = asyncio.get_running_loop()
        address, context = known.contact.address, known.context
        name = None if context is None else address.host
        try:
            _, wire = await loop.create_connection(
                lambda: cls(known.dead_after), address.host, address.port, ssl=context, server_hostname=name
            )
        except (OSError, ValueError) as error:
            if context is not None and isinstance(error, _TLS_FAILURES):
                raise tls_failed(address, error) from error
            raise connect_failed(address, error) from error
        return wire

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the buffer for the next received bytes; with TLS, asyncio writes into slices of this memoryview."""
        return self._view

    def buffer_updated(self, nbytes: int) -> None:
        """Store received bytes."""
        self._came(self._view[:nbytes])

    @property
    def has_news(self) -> bool:
        """True if the idle connection is stale: it was closed, has received data, or still has unsent bytes."""
        link = self._transport
        if link is None or self._ended or self._received or link.is_closing() or link.get_write_buffer_size():
            return True
        return has_news(self._descriptor(link))

    def close(self) -> None:
        """Close the connection without the closing handshake of TLS, because that would take time."""
        if self._transport is not None:
            self._transport.abort()
        super().close()


class _Stream(StreamBuffers, httpcore2.AsyncNetworkStream):
    """A connection with the interface that httpx2 requires."""

    def __init__(self, wire: _TcpStream, contact: HttpServerInfo) -> None:
        super().__init__(contact)
        self._wire = wire

    async def write(self, buffer: bytes, timeout: float | None = None) -> None:
        """Store bytes, so that headers and body are sent together."""
        self.unsent += buffer

    async def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        """Send the stored bytes, and return the next received bytes."""
        if self.unsent:
            unsent, self.unsent = bytes(self.unsent), bytearray()
            try:
                self._wire.send(unsent)
            except ConnectionLost:  # a server may reject a request and close the connection before it has read all
                pass
        data = None
        while data is None:
            data = await self._wire.receive(_LONG)
        return self._received(data)

    async def aclose(self) -> None:
        """Close the connection."""
        self._wire.close()

    def abort(self) -> None:
        """Close the connection immediately."""
        self._wire.close()

    def get_extra_info(self, info: str) -> Any:
        """Return, for ``is_readable``, True if the idle connection is stale; return ``None`` for any other ``info``."""
        return self._wire.has_news if info == "is_readable" else None


class _HttpConnection(SingleConnection[httpcore2.AsyncHTTP11Connection, _Stream], httpx2.AsyncBaseTransport):
    """A single connection to a server, opened on demand.

    Attributes:
        connecting: True while the connection is being opened.
    """

    def __init__(self, known: KnownServer, url: httpx2.URL) -> None:
        super().__init__(known, url)
        self.connecting = False

    async def connect(self) -> None:
        """Ensure that there is an idle connection that the server has not closed.

        Raises:
            ConnectFailed: If the connection cannot be opened.
        """
        if not self._must_connect():
            return
        self.connecting = True
        try:
            wire = await _TcpStream.open(self._known)
        finally:
            self.connecting = False
        self._stream = _Stream(wire, self._contact)
        self._connection = httpcore2.AsyncHTTP11Connection(self._url.origin, self._stream, KEPT)

    async def handle_async_request(self, request: httpx2.Request) -> httpx2.Response:
        """Send a request once over the connection, and return the reply after its headers were received."""
        reply = await self._exchange(request)
        if reply is None:
            self.abort()
            await self.connect()
            reply = await self._exchange(request)
        assert reply is not None
        return httpx2.Response(reply.status, headers=reply.headers, stream=_BodyStream(reply))

    async def _exchange(self, request: httpx2.Request) -> httpcore2.Response | None:
        """Send a request and return the reply; send nothing and return ``None`` if data followed the previous reply."""
        connection, stream = self._begin_exchange()
        try:
            reply = await connection.handle_async_request(self._to_send(request))
        except httpcore2.ProtocolError:
            if stream.unsent:
                return None
            raise
        return None if stream.unsent else reply

    def abort(self) -> None:
        """Close the connection immediately."""
        self._connection = None
        if self._stream is not None:
            self._stream.abort()


class _BodyStream(httpx2.AsyncByteStream):
    """The body of a reply."""

    def __init__(self, reply: httpcore2.Response) -> None:
        self._reply = reply

    def __aiter__(self) -> AsyncIterator[bytes]:
        return self._reply.aiter_stream()

    async def aclose(self) -> None:
        """Close the reply, and also the connection if the body is incomplete."""
        await self._reply.aclose()
