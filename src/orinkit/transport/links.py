"""Links on the caller's own thread, by address or by descriptor; the twin is :mod:`orinkit.transport.aio_links`."""

from __future__ import annotations

import os

from orinkit.core.errors import InvalidAddress
from orinkit.core.i18n import tr
from orinkit.transport.address import Address, AnyAddress, CanAddress, HttpAddress, SerialAddress
from orinkit.transport.credentials import NOTHING, Access
from orinkit.transport.runner import Link
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS


def open_link(
    address: AnyAddress,
    seconds: float,
    access: Access = NOTHING,
    most: int = DEFAULT_LIMITS.packet,
    dead_after: float = DEAD_AFTER,
) -> Link:
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
            from orinkit.transport.sockets.udp import UdpLink  # a program has one kind of link, most have TCP

            return UdpLink.connect(address, seconds)
        from orinkit.transport.sockets.tcp import TcpLink

        return TcpLink.connect(address, seconds, dead_after)
    if isinstance(address, HttpAddress):
        from orinkit.transport.http.link import HttpLink

        return HttpLink(address, access, most, dead_after=dead_after)
    if isinstance(address, SerialAddress):
        from orinkit.transport.serial import settings

        if os.name == "nt":
            from orinkit.transport.serial.windows import PortLink

            return PortLink(settings.open_port(address))
        from orinkit.transport.serial.port import SerialLink

        return SerialLink(settings.open_file(address))
    if isinstance(address, CanAddress):
        raise for_drivers(address)
    raise for_servers()


def adopt(kind: str, descriptor: int) -> Link:
    """Use a link that another process has opened, by its descriptor, which is this link's from then on.

    Args:
        kind: ``"tcp"``, ``"udp"`` or ``"serial"``.
        descriptor: of the socket or the port.
    """
    if kind == "serial":
        from orinkit.transport.serial.port import SerialLink
        from orinkit.transport.serial.settings import as_file

        return SerialLink(as_file(descriptor))
    import socket

    if kind == "udp":
        from orinkit.transport.sockets.udp import UdpLink

        return UdpLink(socket.socket(fileno=descriptor), heard=True)
    from orinkit.transport.sockets.tcp import TcpLink

    return TcpLink(socket.socket(fileno=descriptor))


def for_servers() -> InvalidAddress:
    """Return the exception for an address that a client cannot use."""
    return InvalidAddress(
        tr("'pty://' is an address for servers; connect to the serial:// address that the server tells")
    )


def for_drivers(address: CanAddress) -> InvalidAddress:
    """Return the exception for a CAN bus where a controller is wanted, or is to be served."""
    return InvalidAddress(
        tr(
            "{address!r:.200} is a CAN bus, where no b-CAP is spoken. For ABH3 drivers: orinkit.abh3.connect(...)",
            address=str(address),
        )
    )
