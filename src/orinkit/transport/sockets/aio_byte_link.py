"""Base classes of byte-stream links in asyncio."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Final, cast

from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import lost, other_loop
from orinkit.transport.sockets.socket_link import CHUNK
from orinkit.transport.tcp_keepalive import prepare
from orinkit.transport.waiter import ConnectionWaiter

_UNSENT: Final = 16 * 1024 * 1024
"""Maximum number of bytes that earlier calls of ``send`` left unsent; if there are more, a call closes the link."""


class AsyncStreamLink(ProcessBound, ABC):
    """Base class of byte-stream links: common methods of the asyncio Protocol classes, and the methods of a link."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._parents: asyncio.Transport | None = None
        self._received = bytearray()
        self._ended = False
        self._paused = False
        self._error: Exception | None = None
        self._waiter = ConnectionWaiter()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport of the new connection."""
        self._transport = cast("asyncio.Transport", transport)  # uvloop's class is not a subclass of it
        self._loop = asyncio.get_running_loop()
        keep_from_children(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Record the end of the connection and its error."""
        self._ended = True
        self._error = exc
        self._waiter.wake()

    def _came(self, data: bytes | memoryview) -> None:
        """Store received bytes."""
        self._received += data
        if len(self._received) > 64 * CHUNK and self._transport is not None:
            self._pause(self._transport)  # if nothing is received, a peer that sends too much fills its own buffers
        self._waiter.wake()

    def send(self, data: bytes) -> None:
        """Queue all bytes for sending.

        Raises:
            ConnectionClosed: If the link is closed.
            TransportError: If the link was opened in another event loop.
            ConnectionLost: If the peer has closed the connection, or more than 16 MiB are unsent.
        """
        if self._transport is None:
            raise self._unusable()
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()
        if self._ended:
            raise lost(self._error or tr("closed by the peer"))
        if self._transport.get_write_buffer_size() > _UNSENT:
            self.close()
            raise lost(tr("the peer does not read the data sent to it"))
        try:
            self._transport.write(data)
        except OSError as error:
            raise lost(error) from error

    def enable_concurrent_send(self) -> None:
        """Do nothing, because :meth:`send_concurrently` requires no preparation in asyncio."""

    def send_concurrently(self, data: bytes) -> None:
        """Send a few bytes while another task waits in :meth:`receive`; errors are reported to that task."""
        if self._transport is not None and not self._ended:
            self._transport.write(data)

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, or ``None`` if the time has passed.

        Raises:
            ConnectionClosed: If the link is closed.
            ConnectionLost: If the connection failed.
        """
        if self._transport is None:
            raise self._unusable()
        if not self._received and not self._ended:
            if self._paused:
                self._resume(self._transport)
            await self._waiter.wait(seconds)
            if self._transport is None:
                raise self._unusable()
        if self._received:
            data = bytes(self._received)
            self._received.clear()
            if self._paused:
                self._resume(self._transport)
            return data
        if self._error is not None:
            raise lost(self._error)
        return b"" if self._ended else None

    async def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Queue all bytes for sending, then return the next received bytes; the same as :meth:`send` and :meth:`receive`."""
        self.send(data)
        return await self.receive(seconds)

    def fileno(self) -> int:
        """Return the descriptor, so that another process can take it over.

        This process receives nothing until the next call of :meth:`receive`.

        Raises:
            ConnectionClosed: If the link is closed.
            ConnectionLost: If the connection was lost.
        """
        if self._transport is None:
            raise self._unusable()
        if self._ended:
            raise lost(self._error or tr("closed by the peer"))
        self._pause(self._transport)
        return self._descriptor(self._transport)

    def _pause(self, transport: asyncio.Transport) -> None:
        transport.pause_reading()
        self._paused = True

    def _resume(self, transport: asyncio.Transport) -> None:
        transport.resume_reading()
        self._paused = False

    @abstractmethod
    def _descriptor(self, transport: asyncio.Transport) -> int: ...

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the connection stays open in the parent."""
        transport, self._transport = self._transport, None
        if transport is None:
            return ()
        self._left, self._parents = (
            True,
            transport,
        )  # the reference prevents the child from deleting the transport, which would close it and log a warning
        return (self._descriptor(transport),)

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""
        self.close()  # asyncio does not shut the connection down

    def close(self) -> None:
        """Close the link; a pending receive ends immediately."""
        if self._transport is not None:
            if self._transport.get_write_buffer_size():
                self._transport.abort()  # close() would wait for the peer to read
            else:
                self._transport.close()
            self._transport = None
            self._ended = True
            self._waiter.close()


class AsyncSocketLink(AsyncStreamLink):
    """A TCP connection in asyncio, with or without TLS: sets the options of its socket.

    Args:
        dead_after: Time in s after which the connection is considered lost if the peer's machine does not respond.
    """

    def __init__(self, dead_after: float) -> None:
        super().__init__()
        self._dead_after = dead_after

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport, and set the options of the socket."""
        super().connection_made(transport)
        prepare(transport.get_extra_info("socket"), self._dead_after)

    def _descriptor(self, transport: asyncio.Transport) -> int:
        descriptor: int = transport.get_extra_info("socket").fileno()
        return descriptor
