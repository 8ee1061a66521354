"""TCP for clients, on the caller's own thread; the asynchronous twin is :mod:`orinkit.transport.aio_tcp`."""

from __future__ import annotations

import socket
from typing import Self

from orinkit.transport.address import Address
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.socket_link import SocketLink


class TcpLink(SocketLink):
    """A TCP connection used by the thread that calls; :meth:`connect` makes one."""

    @classmethod
    def connect(cls, address: Address, seconds: float) -> Self:
        """Connect.

        Raises:
            ConnectFailed: it could not be done within ``seconds``.
        """
        try:
            connection = socket.create_connection((address.host, address.port), seconds)
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        return cls(connection)
