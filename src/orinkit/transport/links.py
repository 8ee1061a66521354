"""Opening synchronous links, by address or by descriptor; for asyncio, see :mod:`orinkit.transport.aio_links`."""

from __future__ import annotations

from orinkit.core.errors import InvalidAddress, StreamError
from orinkit.core.i18n import tr
from orinkit.transport.registry import AnyAddress, LinkOptions, Transport, find, resolve, row_of, rows
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
    """Return the transport of a link that another process, the streaming process, is to take over.

    Args:
        kind: The name of the link's profile: ``"tcp"``, ``"udp"``, ``"serial"``, or the name of a profile of another
            package.

    Raises:
        StreamError: If another process cannot take over links of this transport, so that slave mode is not available.
    """
    row = find(kind)
    if row is None or not row.adopt:
        raise StreamError(no_slave_mode(kind))
    return row


def no_slave_mode(kind: str, address: str = "") -> str:
    """Return the message for a transport that does not support slave mode.

    Args:
        kind: The scheme of the transport, or the name of its profile.
        address: The address of the controller; by default the scheme.
    """
    row = find(kind)
    others = ", ".join(f"{row.scheme}://" for row in rows() if row.adopt)
    shown = address or f"{kind}://"
    if row is not None and row.http:
        return tr("slave mode requires b-CAP; {address} uses e-CAP. Try: {others}", address=shown, others=others)
    return tr("slave mode is not available over {address}. Try: {others}", address=shown, others=others)


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
