"""UDP for clients in asyncio; the synchronous counterpart is :mod:`orinkit.transport.sockets.udp`.

Received datagrams wait in the operating system's queue of the socket, whose length is limited. They are read only on
demand, so that no datagram is lost when another process takes over the socket.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterable
from typing import Final, Self

from orinkit.transport.address import Address
from orinkit.transport.fork_safety import ProcessBound, keep_from_children
from orinkit.transport.link_errors import connect_failed
from orinkit.transport.registry import LinkOptions
from orinkit.transport.sockets.socket_link import CHUNK
from orinkit.transport.sockets.udp import broken, connected, peer_of

_TURN: Final = 8
"""Number of datagrams after which other tasks get a turn, because reading an already queued datagram does not yield."""


class AsyncUdpLink(ProcessBound):
    """A UDP socket in asyncio; created by :meth:`connect`.

    Args:
        connection: The connected socket; the link owns it.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._address = peer_of(connection)
        self._open = True
        self._heard = False
        self._taken = 0
        self._wait: asyncio.Timeout | None = None
        keep_from_children(self)

    @classmethod
    async def open(cls, address: Address, opening: LinkOptions) -> Self:
        """Open a socket, as :func:`orinkit.transport.aio_links.open_link`."""
        return await cls.connect(address, opening.seconds)

    @classmethod
    async def connect(cls, address: Address, seconds: float) -> Self:
        """Open a socket without sending anything; the peer need not be reachable.

        Raises:
            ConnectFailed: If the host name is not resolved within ``seconds``, or there is no route to the host.
        """
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(seconds):
                places = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
            return cls(connected(places))
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error

    def send(self, data: bytes) -> None:
        """Send a datagram; it is dropped, as if lost in the network, if the system's buffer is full.

        Raises:
            ConnectFailed: If no program listens at the address, and nothing was ever received from it.
            ConnectionLost: If the program at the address has stopped listening.
            ConnectionClosed: If the link is closed.
        """
        if not self._open:
            raise self._unusable()
        try:
            self._socket.send(data)
        except BlockingIOError:
            pass
        except OSError as error:
            self.close()
            raise broken(self._address, error, heard=self._heard) from error

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next datagram, or ``None`` if the time has passed; empty datagrams are skipped.

        Raises:
            ConnectFailed, ConnectionLost, ConnectionClosed: As for :meth:`send`.
        """
        if not self._open:
            raise self._unusable()
        loop = asyncio.get_running_loop()
        data: bytes | None = None
        try:
            async with asyncio.timeout(seconds) as self._wait:
                self._taken += 1
                if self._taken % _TURN == 0:
                    await asyncio.sleep(0)
                data = await loop.sock_recv(self._socket, CHUNK)
                while not data:
                    await asyncio.sleep(0)  # otherwise a large number of empty datagrams could prevent the time-out
                    data = await loop.sock_recv(self._socket, CHUNK)
        except TimeoutError:
            pass
        except OSError as error:
            self._open = False
            raise broken(self._address, error, heard=self._heard) from error
        finally:
            self._wait = None
            if not self._open:
                self._socket.close()
        if not self._open:
            raise self._unusable()
        if not data:
            return None
        self._heard = True
        return data

    def fileno(self) -> int:
        """Return the socket's descriptor, so that another process can take it over.

        This process receives nothing until the next call of :meth:`receive`.

        Raises:
            ConnectionClosed: If the link is closed.
        """
        # Also in transport.sockets.socket_link: the rest of that link is for threads.
        if not self._open:
            raise self._unusable()
        return self._socket.fileno()

    def after_fork_in_child(self) -> Iterable[int]:
        """Mark the link as closed in a forked child; the socket stays open in the parent."""
        self._open, self._left = False, True
        return (self._socket.fileno(),)

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""
        self.close()

    def close(self) -> None:
        """Close the link; a pending receive ends immediately."""
        self._open = False
        if self._wait is None:
            self._socket.close()
        elif not self._wait.expired():
            self._wait.reschedule(
                0.0
            )  # ends the wait; receive() then closes the socket, which must not be closed while the event loop polls it
