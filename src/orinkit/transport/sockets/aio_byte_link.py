"""What links of bytes have in common in asyncio."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Final, cast

from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import lost, other_loop
from orinkit.transport.sockets.socket_link import CHUNK

_UNSENT: Final = 16 * 1024 * 1024
"""How many bytes of earlier calls may wait to be sent; more, and the link is given up."""


class AsyncStreamLink(ProcessBound, ABC):
    """A link of bytes: the part of a protocol of asyncio that all kinds have, and what a client calls."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._parents: asyncio.Transport | None = None
        self._received = bytearray()
        self._ended = False
        self._error: Exception | None = None
        self._waiter: asyncio.Future[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The link is up."""
        self._transport = cast("asyncio.Transport", transport)  # uvloop's are none by their class
        self._loop = asyncio.get_running_loop()
        keep_from_children(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """The link is down."""
        self._ended = True
        self._error = exc
        self._wake()

    def _came(self, data: bytes | memoryview) -> None:
        """Bytes came."""
        self._received += data
        if len(self._received) > 64 * CHUNK and self._transport is not None:
            self._transport.pause_reading()  # nobody asks for it: a peer that floods is left to its own buffers
        self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def send(self, data: bytes) -> None:
        """Queue all of the bytes.

        Raises:
            ConnectionClosed: the link was closed before.
            TransportError: it is used in another event loop than the one it was opened in.
            ConnectionLost: the other side has closed it, or has not taken what was queued for it long ago.
        """
        if self._transport is None:
            raise self._unusable()
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()
        if self._ended:
            raise lost(self._error or tr("the other side closed it"))
        if self._transport.get_write_buffer_size() > _UNSENT:
            self.close()
            raise lost(tr("the other side does not read"))
        try:
            self._transport.write(data)
        except OSError as error:
            raise lost(error) from error

    def share(self) -> None:
        """Have :meth:`beside` used from now on."""

    def beside(self, data: bytes) -> None:
        """Send a few bytes while another task waits in :meth:`receive`; what goes wrong is for that task to find out."""
        if self._transport is not None and not self._ended:
            self._transport.write(data)

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, ``None`` when the seconds have passed.

        Raises:
            ConnectionClosed: the link was closed before.
            ConnectionLost: the link broke.
        """
        if self._transport is None:
            raise self._unusable()
        if not self._received and not self._ended:
            self._transport.resume_reading()
            loop = asyncio.get_running_loop()
            self._waiter = loop.create_future()
            alarm = loop.call_later(seconds, self._wake)
            try:
                await self._waiter
            finally:
                alarm.cancel()
                self._waiter = None
            if self._transport is None:
                raise self._unusable()
        if self._received:
            data = bytes(self._received)
            self._received.clear()
            self._transport.resume_reading()
            return data
        if self._error is not None:
            raise lost(self._error)
        return b"" if self._ended else None

    def fileno(self) -> int:
        """Descriptor of the link, to be lent to another process; nothing is received here until the next call.

        Raises:
            ConnectionClosed: it has been closed.
            ConnectionLost: it has broken.
        """
        if self._transport is None:
            raise self._unusable()
        if self._ended:
            raise lost(self._error or tr("the other side closed it"))
        self._transport.pause_reading()
        return self._descriptor(self._transport)

    @abstractmethod
    def _descriptor(self, transport: asyncio.Transport) -> int: ...

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the connection goes on in its parent."""
        transport, self._transport = self._transport, None
        if transport is None:
            return ()
        self._left, self._parents = True, transport  # kept: the child is not to end it, nor to complain of it
        return (self._descriptor(transport),)

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""
        self.close()  # asyncio does not shut the connection down

    def close(self) -> None:
        """Close; a receive that is waiting ends at once."""
        if self._transport is not None:
            if self._transport.get_write_buffer_size():
                self._transport.abort()  # close() would wait for the other side to read
            else:
                self._transport.close()
            self._transport = None
            self._ended = True
            self._wake()
