"""Opening links in asyncio, by address; the synchronous counterpart is :mod:`orinkit.transport.links`."""

from __future__ import annotations

from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, LinkOptions, resolve, row_of
from orinkit.transport.runner import AsyncLink


async def open_link(address: AnyAddress, opening: LinkOptions) -> AsyncLink:
    """Open a link to the address of a controller, as :func:`orinkit.transport.links.open_link`."""
    row = row_of(address)
    if not row.aio_link:
        raise refused(address)
    link: AsyncLink = await resolve(row.aio_link)(address, opening)
    return link
