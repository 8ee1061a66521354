"""Opening synchronous links, by address or by descriptor; for asyncio, see :mod:`orinkit.transport.aio_links`."""

from __future__ import annotations

from orinkit.core.errors import InvalidAddress, StreamError
from orinkit.core.i18n import tr
from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.registry import AnyAddress, LinkOptions, Transport, find, resolve, row_of
from orinkit.transport.runner import Link
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS


def open_link(
    address: AnyAddress,
    seconds: float,
    access: Credentials = NOTHING,
    most: int = DEFAULT_LIMITS.packet,
    dead_after: float = DEAD_AFTER,
) -> Link:
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
    if not row.link:
        raise refused(address)
    link: Link = resolve(row.link)(address, LinkOptions(seconds, access, most, dead_after))
    return link


def lendable(kind: str) -> Transport:
    """Return the transport of a link that can be handed over to another process.

    Args:
        kind: The name of the profile: ``"tcp"``, ``"udp"``, ``"serial"``, or that of a transport of another package.

    Raises:
        StreamError: If links of this transport cannot be handed over.
    """
    row = find(kind)
    if row is None or not row.adopt:
        raise StreamError(tr("a connection over {kind} cannot be handed over to another process", kind=kind))
    return row


def adopt(kind: str, descriptor: int) -> Link:
    """Return a link for a descriptor that another process has opened; the link owns the descriptor.

    Args:
        kind: The name of the profile, as for :func:`lendable`.
        descriptor: The descriptor of the socket or the port.
    """
    link: Link = resolve(lendable(kind).adopt)(descriptor)
    return link


def refused(address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address that a client cannot connect to, or that a server cannot listen on."""
    refusal = row_of(address).refusal
    if refusal:
        reason: InvalidAddress = resolve(refusal)(address)
        return reason
    return InvalidAddress(tr("{address!r:.200} cannot be used here", address=str(address)))


def for_servers(_address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address that a client cannot use."""
    return InvalidAddress(
        tr("'pty://' is an address for servers; connect to the serial:// address that the server prints")
    )


def for_drivers(address: AnyAddress) -> InvalidAddress:
    """Return the exception for a CAN bus given instead of the address of a controller."""
    return InvalidAddress(
        tr(
            "{address!r:.200} is a CAN bus, which does not carry b-CAP. For ABH3 drivers: orinkit.abh3.connect(...)",
            address=str(address),
        )
    )
