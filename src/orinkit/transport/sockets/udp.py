"""Synchronous UDP for clients; the asynchronous counterpart is :mod:`orinkit.transport.sockets.aio_udp`.

The socket is connected, so that the system drops datagrams from other addresses. One datagram is one packet.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterable
from time import monotonic
from typing import Any, Self

from orinkit.core.errors import TransportError
from orinkit.core.i18n import tr
from orinkit.transport.address import Address
from orinkit.transport.link_errors import connect_failed, lost
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.socket_link import SocketLink


class UdpLink(SocketLink):
    """A UDP socket, used from the caller's thread; created by :meth:`connect`.

    Args:
        connection: The connected socket; the link owns it.
        heard: True if something was received from the peer before.
    """

    datagrams = True

    def __init__(self, connection: socket.socket, *, heard: bool = False) -> None:
        super().__init__(connection)
        self._heard = heard
        self._address = peer_of(connection)

    @classmethod
    def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Open a socket, as :func:`orinkit.transport.links.open_link`."""
        return cls.connect(address, opening.seconds)

    @classmethod
    def adopt(cls, descriptor: int) -> Self:
        """Return a link for a socket that another process has connected."""
        return cls(socket.socket(fileno=descriptor), heard=True)

    @classmethod
    def connect(cls, address: Address, seconds: float) -> Self:  # noqa: ARG003 - signature of every link
        """Open a socket without sending anything; the peer need not be reachable.

        Raises:
            ConnectFailed: If the host name cannot be resolved, or there is no route to the host.
        """
        try:
            places = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
            return cls(connected(places))
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error

    def receive(self, seconds: float) -> bytes | None:
        """Return the next datagram, or ``None`` if the time has passed; empty datagrams are skipped.

        Raises:
            ConnectFailed: If no program listens at the address, and nothing was ever received from it.
            ConnectionLost: If the program at the address has stopped listening.
            ConnectionClosed: If the link is closed.
        """
        end = monotonic() + seconds
        while seconds > 0:
            data = super().receive(seconds)
            if data:
                self._heard = True
                return data
            if data is None:
                return None
            seconds = end - monotonic()
        return None

    def _broken(self, error: OSError) -> TransportError:
        return broken(self._address, error, heard=self._heard)


def connected(places: Iterable[tuple[Any, ...]]) -> socket.socket:
    """Return a UDP socket connected to the first address to which there is a route.

    Args:
        places: At least one of the tuples that ``getaddrinfo`` returns.

    Raises:
        OSError: If there is no route to any of the addresses.
    """
    failure = OSError()
    for family, kind, protocol, _, place in places:
        try:
            connection = socket.socket(family, kind, protocol)
        except OSError as error:
            failure = error
            continue
        try:
            connection.connect(place)
        except (OSError, OverflowError) as error:
            connection.close()
            failure = error if isinstance(error, OSError) else OSError(str(error))
        else:
            return connection
    raise failure


def peer_of(connection: socket.socket) -> Address:
    """Return the address that a socket is connected to."""
    host, port = connection.getpeername()[:2]
    return Address("udp", host, port)


def broken(address: Address, error: OSError, *, heard: bool) -> TransportError:
    """Return the exception for an error that the operating system reported for a socket.

    Args:
        address: The address of the peer.
        error: The error. It is "connection refused" (on Windows, "connection reset") if the peer's machine has replied
            that no program listens at the address.
        heard: True if something was received from the peer before.
    """
    refused = isinstance(error, ConnectionRefusedError | ConnectionResetError)
    if not heard:
        return connect_failed(address, OSError(errno.ECONNREFUSED, "") if refused else error)
    if not refused:
        return lost(error)
    return lost(tr("the program at {address} has stopped listening", address=address))
