"""TCP for clients in asyncio; the synchronous twin is :mod:`orinkit.transport.tcp`."""

from __future__ import annotations

import asyncio
import socket
from typing import Final

from orinkit.errors import TransportError
from orinkit.language import pick
from orinkit.transport.address import Address
from orinkit.transport.tcp import CHUNK, closed, connect_failed, lost

_UNSENT: Final = 16 * 1024 * 1024
"""How many bytes of earlier calls may wait to be sent; more, and the link is given up."""


class AsyncTcpLink(asyncio.BufferedProtocol):
    """A TCP connection in asyncio; :meth:`connect` makes one.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB, which costs
    more than the rest of a call.
    """

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._received = bytearray()
        self._buffer = bytearray(CHUNK)
        self._view = memoryview(self._buffer)
        self._ended = False
        self._error: Exception | None = None
        self._waiter: asyncio.Future[None] | None = None

    @classmethod
    async def connect(cls, address: Address, seconds: float) -> AsyncTcpLink:
        """Connect.

        Raises:
            ConnectFailed: it could not be done within ``seconds``.
        """
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(seconds):
                _, link = await loop.create_connection(cls, address.host, address.port)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise connect_failed(address, error) from error
        return link

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The link is up."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        peer = transport.get_extra_info("socket")
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - declared by the base
        """Where to put what comes next."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes came."""
        self._received += self._view[:nbytes]
        if len(self._received) > 64 * CHUNK and self._transport is not None:
            self._transport.pause_reading()  # nobody asks for it: a peer that floods is left to its own buffers
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """The link is down."""
        self._ended = True
        self._error = exc
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
            raise closed()
        if asyncio.get_running_loop() is not self._loop:
            raise TransportError(
                pick(
                    "the connection belongs to another event loop; connect again in this one",
                    "接続は別のイベントループのものです。このループで接続し直してください",
                )
            )
        if self._ended:
            raise lost(self._error or pick("the other side closed it", "相手が閉じました"))
        if self._transport.get_write_buffer_size() > _UNSENT:
            self.close()
            raise lost(pick("the other side does not read", "相手が受信しません"))
        self._transport.write(data)

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, ``None`` when the seconds have passed.

        Raises:
            ConnectionClosed: the link was closed before.
        """
        if self._transport is None:
            raise closed()
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
                raise closed()
        if self._received:
            data = bytes(self._received)
            self._received.clear()
            self._transport.resume_reading()
            return data
        if self._error is not None:
            raise lost(self._error)
        return b"" if self._ended else None

    def fileno(self) -> int:
        """Descriptor of the connection, to be lent to another process; nothing is received here until the next call.

        Raises:
            ConnectionClosed: it has been closed.
        """
        if self._transport is None:
            raise closed()
        self._transport.pause_reading()
        descriptor: int = self._transport.get_extra_info("socket").fileno()
        return descriptor

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
