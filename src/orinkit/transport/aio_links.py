"""Opening links in asyncio, by address; the synchronous counterpart is :mod:`orinkit.transport.links`."""

from __future__ import annotations

from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, LinkOptions, resolve, row_of
from orinkit.transport.runner import AsyncLink
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS


async def open_link(
    address: AnyAddress,
    seconds: float,
    access: Credentials = NOTHING,
    most: int = DEFAULT_LIMITS.packet,
    dead_after: float = DEAD_AFTER,
) -> AsyncLink:
    """Open a link to an address.

    Args:
        address: The address of the controller.
        seconds: Time-out, s.
        access: Credentials for HTTP.
        most: The largest number of bytes of a reply over HTTP.
        dead_after: s without a response from the controller's machine after which a TCP connection is given up.

    Raises:
        InvalidAddress: If the address is one for servers, or of a CAN bus.
        ConnectFailed: If the link cannot be opened; over HTTP this is reported by the first request.
        MissingExtra: If the package for serial ports, or for HTTP, is not installed.
    """
    row = row_of(address)
    if not row.aio_link:
        raise refused(address)
    link: AsyncLink = await resolve(row.aio_link)(address, LinkOptions(seconds, access, most, dead_after))
    return link
