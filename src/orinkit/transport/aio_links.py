"""Links in asyncio, by address; the twin is :mod:`orinkit.transport.links`."""

from __future__ import annotations

import os

from orinkit.transport.address import Address, AnyAddress, CanAddress, HttpAddress, SerialAddress
from orinkit.transport.credentials import NOTHING, Access
from orinkit.transport.links import for_drivers, for_servers
from orinkit.transport.runner import AsyncLink
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS


async def open_link(
    address: AnyAddress,
    seconds: float,
    access: Access = NOTHING,
    most: int = DEFAULT_LIMITS.packet,
    dead_after: float = DEAD_AFTER,
) -> AsyncLink:
    """Open a link to an address.

    Args:
        address: of the controller.
        seconds: that it may take.
        access: for HTTP.
        most: bytes of a reply over HTTP.
        dead_after: seconds without an answer from the controller's machine after which a TCP connection is given up.

    Raises:
        InvalidAddress: it is one for servers, or of a CAN bus.
        ConnectFailed: it cannot be opened; with HTTP that shows later.
        MissingExtra: a serial port, or HTTP, needs a package.
    """
    if isinstance(address, Address):
        if address.scheme == "udp":
            from orinkit.transport.sockets.aio_udp import AsyncUdpLink  # a program has one kind of link, most have TCP

            return await AsyncUdpLink.connect(address, seconds)
        from orinkit.transport.sockets.aio_tcp import AsyncTcpLink

        return await AsyncTcpLink.connect(address, seconds, dead_after)
    if isinstance(address, HttpAddress):
        from orinkit.transport.http.aio_link import AsyncHttpLink

        return AsyncHttpLink(address, access, most, dead_after=dead_after)
    if isinstance(address, SerialAddress):
        if os.name == "nt":
            from orinkit.transport.serial.aio_windows import AsyncPortLink

            return await AsyncPortLink.open(address, seconds)
        from orinkit.transport.serial.aio_port import AsyncSerialLink

        return await AsyncSerialLink.open(address)
    if isinstance(address, CanAddress):
        raise for_drivers(address)
    raise for_servers()
