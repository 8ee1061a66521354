"""TCP for clients in asyncio; the synchronous counterpart is :mod:`orinkit.transport.sockets.tcp`."""

from __future__ import annotations

import asyncio
from typing import Self

from orinkit.transport.address import Address
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.aio_byte_link import AsyncSocketLink
from orinkit.transport.sockets.socket_link import CHUNK
from orinkit.transport.tcp_keepalive import DEAD_AFTER


class AsyncTcpLink(AsyncSocketLink, asyncio.BufferedProtocol):
    """A TCP connection in asyncio; created by :meth:`connect`.

    This is a BufferedProtocol, because for a plain Protocol asyncio allocates a block of 256 KiB for each piece of
    received data. The allocation would take longer than the rest of a call.
    """

    def __init__(self, dead_after: float = DEAD_AFTER) -> None:
        super().__init__(dead_after)
        self._buffer = bytearray(CHUNK)
        self._view = memoryview(self._buffer)

    @classmethod
    async def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Connect to a controller, as :func:`orinkit.transport.aio_links.open_link`."""
        return await cls.connect(address, opening.seconds, opening.dead_after)

    @classmethod
    async def connect(cls, address: Address, seconds: float, dead_after: float = DEAD_AFTER) -> Self:
        """Connect to a controller, as :meth:`orinkit.transport.sockets.tcp.TcpLink.connect`."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(seconds):
                _, link = await loop.create_connection(lambda: cls(dead_after), address.host, address.port)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise connect_failed(address, error) from error
        return link

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return the buffer for the next bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Store received bytes."""
        self._came(self._view[:nbytes])
