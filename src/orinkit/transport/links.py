"""Opening synchronous links, by address or by descriptor; for asyncio, see :mod:`orinkit.transport.aio_links`."""

from __future__ import annotations

from orinkit.core.errors import InvalidAddress, StreamError
from orinkit.core.i18n import tr
from orinkit.transport.registry import AnyAddress, LinkOptions, Transport, find, resolve, row_of
from orinkit.transport.runner import Link


def open_link(address: AnyAddress, opening: LinkOptions) -> Link:
    """Open a link to the address of a controller.

    Raises:
        InvalidAddress: If only servers can use the address, or if it is the address of a CAN bus.
        ConnectFailed: If the link cannot be opened. Over HTTP, the first request raises this exception.
        MissingExtra: If the package for serial ports, or for HTTP, is not installed.
    """
    row = row_of(address)
    if not row.link:
        raise refused(address)
    link: Link = resolve(row.link)(address, opening)
    return link


def require_handover(kind: str) -> Transport:
    """Return the transport of a link that another process is to take over.

    Args:
        kind: The name of the link's profile: ``"tcp"``, ``"udp"``, ``"serial"``, or the name of a profile of another
            package.

    Raises:
        StreamError: If another process cannot take over links of this transport.
    """
    row = find(kind)
    if row is None or not row.adopt:
        raise StreamError(tr("a connection over {kind} cannot be handed over to another process", kind=kind))
    return row


def adopt(kind: str, descriptor: int) -> Link:
    """Return a link for a descriptor that another process has opened; the link owns the descriptor.

    Args:
        kind: The name of the profile; see :func:`require_handover`.
        descriptor: The descriptor of the socket or the port.
    """
    link: Link = resolve(require_handover(kind).adopt)(descriptor)
    return link


def refused(address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address that a client cannot connect to, or that a server cannot listen on."""
    refusal = row_of(address).refusal
    if refusal:
        reason: InvalidAddress = resolve(refusal)(address)
        return reason
    return InvalidAddress(tr("{address!r:.200} cannot be used here", address=str(address)))


def for_servers(_address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address that a client cannot use, because only a server can listen on it."""
    return InvalidAddress(
        tr("'pty://' is an address for servers; connect to the serial:// address that the server prints")
    )


def for_drivers(address: AnyAddress) -> InvalidAddress:
    """Return the exception for the address of a CAN bus that is given instead of the address of a controller."""
    return InvalidAddress(
        tr(
            "{address!r:.200} is a CAN bus, which does not carry b-CAP. For ABH3 drivers: orinkit.abh3.connect(...)",
            address=str(address),
        )
    )
