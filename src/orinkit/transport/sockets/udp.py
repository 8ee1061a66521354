"""UDP for clients, on the caller's own thread; the asynchronous twin is :mod:`orinkit.transport.sockets.aio_udp`.

The socket is connected, so that the system drops what comes from other addresses. One datagram is one packet.
"""

from __future__ import annotations

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
    """A UDP socket used by the thread that calls; :meth:`connect` makes one.

    Args:
        connection: is this link's from then on.
        heard: whether the other side is known to be there.
    """

    datagrams = True

    def __init__(self, connection: socket.socket, *, heard: bool = False) -> None:
        super().__init__(connection)
        self._heard = heard
        self._address = peer_of(connection)

    @classmethod
    def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Take a socket, as :func:`orinkit.transport.links.open_link`."""
        return cls.connect(address, opening.seconds)

    @classmethod
    def adopt(cls, descriptor: int) -> Self:
        """Take a socket that another process has connected."""
        return cls(socket.socket(fileno=descriptor), heard=True)

    @classmethod
    def connect(cls, address: Address, seconds: float) -> Self:  # noqa: ARG003 - as the others
        """Take a socket; nothing is sent, so that nobody need be there.

        Raises:
            ConnectFailed: the host is not known, or no way leads to it.
        """
        try:
            places = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
            return cls(connected(places))
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error

    def receive(self, seconds: float) -> bytes | None:
        """Return the next datagram, ``None`` when the seconds have passed; empty ones are passed over.

        Raises:
            ConnectFailed: nobody listens there, and nothing has ever come from there.
            ConnectionLost: nobody listens there any more.
            ConnectionClosed: the link was closed before.
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
    """Return a socket that is connected to the first of the places that there is a way to.

    Args:
        places: as ``getaddrinfo`` gives them, at least one.

    Raises:
        OSError: there is a way to none of them.
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
    """Return the exception for what the system says of a socket.

    Args:
        address: of the other side.
        error: refused (Windows says reset) where the other machine has answered that no program listens there.
        heard: whether anything has come from there before.
    """
    refused = isinstance(error, ConnectionRefusedError | ConnectionResetError)
    if not heard:
        nobody = tr("no program listens there")
        return connect_failed(address, OSError(nobody) if refused else error)
    if not refused:
        return lost(error)
    return lost(tr("no program listens at {address} any more", address=address))
