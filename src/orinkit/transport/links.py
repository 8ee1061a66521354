"""Links on the caller's own thread, by address or by descriptor; the twin is :mod:`orinkit.transport.aio_links`."""

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
    row = row_of(address)
    if not row.link:
        raise refused(address)
    link: Link = resolve(row.link)(address, LinkOptions(seconds, access, most, dead_after))
    return link


def lendable(kind: str) -> Transport:
    """Return the row of links that another process can adopt.

    Args:
        kind: name of the profile: ``"tcp"``, ``"udp"``, ``"serial"``, or that of a transport from elsewhere.

    Raises:
        StreamError: If it cannot adopt them.
    """
    row = find(kind)
    if row is None or not row.adopt:
        raise StreamError(tr("a connection over {kind} cannot be lent to another process", kind=kind))
    return row


def adopt(kind: str, descriptor: int) -> Link:
    """Use a link that another process has opened, by its descriptor, which is this link's from then on.

    Args:
        kind: as of :func:`lendable`.
        descriptor: of the socket or the port.
    """
    link: Link = resolve(lendable(kind).adopt)(descriptor)
    return link


def refused(address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address where no client can connect, or no server listen."""
    refusal = row_of(address).refusal
    if refusal:
        reason: InvalidAddress = resolve(refusal)(address)
        return reason
    return InvalidAddress(tr("{address!r:.200} cannot be used here", address=str(address)))


def for_servers(_address: AnyAddress) -> InvalidAddress:
    """Return the exception for an address that a client cannot use."""
    return InvalidAddress(
        tr("'pty://' is an address for servers; connect to the serial:// address that the server tells")
    )


def for_drivers(address: AnyAddress) -> InvalidAddress:
    """Return the exception for a CAN bus where a controller is wanted, or is to be served."""
    return InvalidAddress(
        tr(
            "{address!r:.200} is a CAN bus, where no b-CAP is spoken. For ABH3 drivers: orinkit.abh3.connect(...)",
            address=str(address),
        )
    )
