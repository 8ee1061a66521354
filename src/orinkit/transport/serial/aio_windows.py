"""Serial ports through the transport of serialx, for event loops that cannot poll a port (Windows)."""

from __future__ import annotations

import asyncio
from typing import Self

from orinkit.transport.serial.address import SerialAddress
from orinkit.transport.serial.settings import open_failed, settings
from orinkit.transport.sockets.aio_byte_link import AsyncStreamLink


class AsyncPortLink(AsyncStreamLink, asyncio.Protocol):
    """A serial port through serialx; created by :meth:`open`."""

    @classmethod
    async def open(cls, address: SerialAddress, seconds: float) -> Self:
        """Open a port within the given seconds, as :meth:`orinkit.transport.serial.aio_port.AsyncSerialLink.open`."""
        chosen = settings(address)
        import serialx

        link = cls()
        try:
            async with asyncio.timeout(seconds):
                await serialx.create_serial_connection(
                    asyncio.get_running_loop(),
                    lambda: link,
                    address.path,
                    transport_cls=serialx.SerialTransport,
                    **chosen,
                )
        except (OSError, ValueError, RuntimeError, serialx.SerialException) as error:
            raise open_failed(address, error) from error
        return link

    def data_received(self, data: bytes) -> None:
        """Store received bytes."""
        self._came(data)

    def _descriptor(self, transport: asyncio.Transport) -> int:
        descriptor: int = transport.get_extra_info("serial").fileno()
        return descriptor
