"""Links in asyncio, by address; the twin is :mod:`orinkit.transport.links`."""

from __future__ import annotations

import os

from orinkit.transport.address import Address, AnyAddress, SerialAddress
from orinkit.transport.drive import AsyncLink
from orinkit.transport.links import for_servers


async def open_link(address: AnyAddress, seconds: float) -> AsyncLink:
    """Open a link to an address.

    Args:
        address: of the controller.
        seconds: that it may take.

    Raises:
        InvalidAddress: it is one for servers.
        ConnectFailed: it cannot be opened.
        MissingExtra: a serial port needs a package.
    """
    if isinstance(address, Address):
        if address.scheme == "udp":
            from orinkit.transport.aio_udp import AsyncUdpLink  # a program has one kind of link, most have TCP

            return await AsyncUdpLink.connect(address, seconds)
        from orinkit.transport.aio_tcp import AsyncTcpLink

        return await AsyncTcpLink.connect(address, seconds)
    if isinstance(address, SerialAddress):
        if os.name == "nt":
            from orinkit.transport.aio_port_link import AsyncPortLink

            return await AsyncPortLink.open(address, seconds)
        from orinkit.transport.aio_serial import AsyncSerialLink

        return await AsyncSerialLink.open(address)
    raise for_servers()
