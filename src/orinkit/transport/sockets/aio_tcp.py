"""TCP for clients in asyncio; the synchronous twin is :mod:`orinkit.transport.sockets.tcp`."""

from __future__ import annotations

import asyncio
from typing import Self

from orinkit.transport.address import Address
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.aio_byte_link import AsyncStreamLink
from orinkit.transport.sockets.socket_link import CHUNK
from orinkit.transport.tcp_keepalive import DEAD_AFTER, prepare


class AsyncTcpLink(AsyncStreamLink, asyncio.BufferedProtocol):
    """A TCP connection in asyncio; :meth:`connect` makes one.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB, which costs
    more than the rest of a call.
    """

    def __init__(self, dead_after: float = DEAD_AFTER) -> None:
        super().__init__()
        self._dead_after = dead_after
        self._buffer = bytearray(CHUNK)
        self._view = memoryview(self._buffer)

    @classmethod
    async def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Connect, as :func:`orinkit.transport.aio_links.open_link`."""
        return await cls.connect(address, opening.seconds, opening.dead_after)

    @classmethod
    async def connect(cls, address: Address, seconds: float, dead_after: float = DEAD_AFTER) -> Self:
        """Connect.

        Args:
            address: of the controller.
            seconds: that it may take.
            dead_after: seconds without an answer from the other machine after which the connection is given up.

        Raises:
            ConnectFailed: it could not be done within ``seconds``.
        """
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(seconds):
                _, link = await loop.create_connection(lambda: cls(dead_after), address.host, address.port)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise connect_failed(address, error) from error
        return link

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The link is up."""
        super().connection_made(transport)
        prepare(transport.get_extra_info("socket"), self._dead_after)

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - declared by the base
        """Where to put what comes next."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes came."""
        self._came(self._view[:nbytes])

    def _descriptor(self, transport: asyncio.Transport) -> int:
        descriptor: int = transport.get_extra_info("socket").fileno()
        return descriptor
