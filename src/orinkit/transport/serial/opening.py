"""Opening serial ports; the links read and write by descriptor on POSIX systems, and through serialx on Windows."""

from __future__ import annotations

import os

from orinkit.transport.registry import LinkOptions
from orinkit.transport.runner import AsyncLink, Link
from orinkit.transport.serial import settings
from orinkit.transport.serial.address import SerialAddress


def open_link(address: SerialAddress, opening: LinkOptions) -> Link:  # noqa: ARG001 - signature of every opener
    """Open a port, as :func:`orinkit.transport.links.open_link`."""
    if os.name == "nt":
        from orinkit.transport.serial.windows import PortLink

        return PortLink(settings.open_port(address))
    from orinkit.transport.serial.port import SerialLink

    return SerialLink(settings.open_file(address))


async def open_aio_link(address: SerialAddress, opening: LinkOptions) -> AsyncLink:
    """Open a port, as :func:`orinkit.transport.aio_links.open_link`."""
    if os.name == "nt":
        from orinkit.transport.serial.aio_windows import AsyncPortLink

        return await AsyncPortLink.open(address, opening.seconds)
    from orinkit.transport.serial.aio_port import AsyncSerialLink

    return await AsyncSerialLink.open(address)


def adopt(descriptor: int) -> Link:
    """Return a link for a port that another process has opened."""
    from orinkit.transport.serial.port import SerialLink

    return SerialLink(settings.as_file(descriptor))
