"""UDP for clients in asyncio; the synchronous twin is :mod:`orinkit.transport.sockets.udp`.

The system's own queue of a socket, which is bounded, is the queue of what nobody has asked for yet: datagrams are taken
from it when they are wanted, so that nothing is lost when another process has the socket.
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
"""Datagrams that are taken until others have their turn: taking one that is there already lets nobody else run."""


class AsyncUdpLink(ProcessBound):
    """A UDP socket in asyncio; :meth:`connect` makes one.

    Args:
        connection: is this link's from then on.
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
        """Take a socket, as :func:`orinkit.transport.aio_links.open_link`."""
        return await cls.connect(address, opening.seconds)

    @classmethod
    async def connect(cls, address: Address, seconds: float) -> Self:
        """Take a socket; nothing is sent, so that nobody need be there.

        Raises:
            ConnectFailed: the host is not known within ``seconds``, or no way leads to it.
        """
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(seconds):
                places = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
            return cls(connected(places))
        except (OSError, ValueError) as error:
            raise connect_failed(address, error) from error

    def send(self, data: bytes) -> None:
        """Send a datagram; one that the system has no room for is dropped, as if lost on the way.

        Raises:
            ConnectFailed: nobody listens there, and nothing has ever come from there.
            ConnectionLost: nobody listens there any more.
            ConnectionClosed: the link was closed before.
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
        """Return the next datagram, ``None`` when the seconds have passed; empty ones are passed over.

        Raises:
            ConnectFailed: nobody listens there, and nothing has ever come from there.
            ConnectionLost: nobody listens there any more.
            ConnectionClosed: the link was closed before.
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
                    await asyncio.sleep(0)  # a flood of empty ones does not keep the time-out from coming
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
        """Descriptor of the socket, to be lent to another process; nothing is received here until the next call.

        Raises:
            ConnectionClosed: it has been closed.
        """
        if not self._open:
            raise self._unusable()
        return self._socket.fileno()

    def left_behind(self) -> Iterable[int]:
        """Be closed in a forked child; the socket stays in its parent."""
        self._open, self._left = False, True
        return (self._socket.fileno(),)

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""
        self.close()

    def close(self) -> None:
        """Close; a receive that is waiting ends at once."""
        self._open = False
        if self._wait is None:
            self._socket.close()
        elif not self._wait.expired():
            self._wait.reschedule(0.0)  # it closes the socket, which the event loop must not be watching then
