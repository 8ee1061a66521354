"""Synchronous TCP for clients; the asynchronous counterpart is :mod:`orinkit.transport.sockets.aio_tcp`."""

from __future__ import annotations

import socket
from typing import Self

from orinkit.transport.address import Address
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.socket_link import SocketLink
from orinkit.transport.tcp_keepalive import DEAD_AFTER, prepare


class TcpLink(SocketLink):
    """A TCP connection, used from the caller's thread; created by :meth:`connect`."""

    @classmethod
    def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Connect to a controller, as :func:`orinkit.transport.links.open_link`."""
        return cls.connect(address, opening.seconds, opening.dead_after)

    @classmethod
    def adopt(cls, descriptor: int) -> Self:
        """Return a link for a socket that another process has connected."""
        return cls(socket.socket(fileno=descriptor))

    @classmethod
    def connect(cls, address: Address, seconds: float, dead_after: float = DEAD_AFTER) -> Self:
        """Connect to a controller.

        Args:
            address: The address of the controller.
            seconds: Time-out, s.
            dead_after: Time in s after which the connection is considered lost if the controller's machine does not
                respond.

        Raises:
            ConnectFailed: If the connection cannot be established within ``seconds``.
        """
        try:
            connection = socket.create_connection((address.host, address.port), seconds)
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error
        prepare(connection, dead_after)
        return cls(connection)
