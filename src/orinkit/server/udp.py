"""b-CAP clients on UDP, server side: one socket for all of them, who are told apart by their addresses."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterable
from functools import partial
from typing import Any, Final, Self, TypeAlias, cast

from orinkit.bcap.profiles import DATAGRAM
from orinkit.bcap.server import Encoded, Execute
from orinkit.cao.provider import ClientInfo
from orinkit.cao.session import Session
from orinkit.server.context import ServerContext
from orinkit.server.peer import ConnectionlessClient
from orinkit.transport.address import Address
from orinkit.transport.fork_safety import keep_from_children
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.server")

FORGOTTEN_AFTER: Final = 10.0
"""Seconds of silence after which a client is taken to have gone (reference behaviour: docs/protocol.md)."""

_SIZE_READ: Final = "max_size"  # asyncio's: 256 KiB, in a new block for each datagram, which costs more than all else
_LONGEST: Final = 65536  # bytes of any datagram

_Place: TypeAlias = tuple[Any, ...]  # of a client, as the socket gives it: host, port, and more for IPv6


class UdpClient(ConnectionlessClient):
    """One client on UDP.

    Its first call makes it one. It goes with Service_Stop, or when nothing is heard of it for :data:`FORGOTTEN_AFTER`
    seconds and no call of it is at work. Until then the answer to its last request is kept, in case it was lost.
    """

    def __init__(self, at: UdpSocket, place: _Place) -> None:
        super().__init__(at.shared, at.loop, DATAGRAM)
        self.place = place
        self._socket = at
        self._name = f"{place[0]}:{place[1]}/udp"
        self._host = str(place[0])
        self._send = partial(at.send, place)
        self._is_gone = at.is_gone
        self.patience = at.shared.alive
        self._timer: asyncio.TimerHandle | None = None

    def received(self, data: bytes) -> None:
        """It has sent a datagram."""
        self._heard = now = self._loop.time()
        self._act(self._conversation.receive(data, now))

    def _about(self) -> ClientInfo:
        return ClientInfo(self.place[0], DATAGRAM.name, self.place[1], self.drain_input)

    def _newcomer(self) -> Session | None:
        session = super()._newcomer()
        if session is not None:
            self._shared.all.add(self)
            self._socket.keep(self)
            if self._timer is None:
                self._timer = self._loop.call_later(FORGOTTEN_AFTER, self._look_at_the_time)
        return session

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        self._heard = self._loop.time()
        super()._deliver(call, code, result)

    def _rest(self, reason: object = None) -> None:
        self._leave(reason)
        self._socket.rest(self)

    def _look_at_the_time(self) -> None:
        until = FORGOTTEN_AFTER if self._conversation.busy else self._heard + FORGOTTEN_AFTER - self._loop.time()
        if until > 0:
            self._timer = self._loop.call_later(until, self._look_at_the_time)
        else:
            self._forget("nothing heard")

    def _forget(self, reason: object = None) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._leave(reason)
        self._socket.drop(self)
        self._shared.discard(self)

    def give_up(self, reason: str) -> None:
        """It is taken to have gone: known no more."""
        self._forget(reason)

    def close(self) -> None:
        """Let it go, with all that it holds."""
        self._forget()

    def abort(self) -> None:
        """Let it go."""
        self._forget()


class UdpSocket(asyncio.DatagramProtocol):
    """One socket, and the clients whose datagrams come there.

    Args:
        shared: what all clients of the server share.
        loop: the event loop that it lives in.
    """

    def __init__(self, shared: ServerContext, loop: asyncio.AbstractEventLoop) -> None:
        self.shared = shared
        self.loop = loop
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False
        self._callers: dict[_Place, UdpClient] = {}
        self._resting: dict[_Place, UdpClient] = {}  # those of them who are no clients any more, the oldest first
        self._closed = asyncio.Event()

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is open."""
        self._transport = cast("asyncio.DatagramTransport", transport)  # in Python 3.11 it is one by its methods only
        if hasattr(transport, _SIZE_READ):
            setattr(transport, _SIZE_READ, _LONGEST)
        keep_from_children(self)

    def datagram_received(self, data: bytes, addr: _Place) -> None:
        """A datagram has come, of a client or of anybody."""
        caller = self._callers.get(addr)
        if caller is None:
            caller = UdpClient(self, addr)  # is kept if this is a call
        caller.received(data)

    def error_received(self, exc: Exception) -> None:
        """A datagram could not be sent or received; the client repeats what is lost."""
        logger.debug("UDP: %s", exc)

    def pause_writing(self) -> None:
        """More answers wait than the socket takes: drop those that follow."""
        self._full = True

    def resume_writing(self) -> None:
        """It takes them again."""
        self._full = False

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket has been closed."""
        if exc is not None:
            logger.error("UDP: closed: %s", exc)
        self._closed.set()

    # --- for the clients ------------------------------------------------------------------------------------------

    def is_gone(self) -> bool:
        """Whether nothing can be sent any more."""
        return self._transport is None or self._transport.is_closing()

    def send(self, place: _Place, data: bytes) -> None:
        """Send a datagram, or drop it where the socket does not take it."""
        if not self._full and self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, place)

    def keep(self, caller: UdpClient) -> None:
        """Know a client again."""
        self._callers[caller.place] = caller
        self._resting.pop(caller.place, None)

    def rest(self, caller: UdpClient) -> None:
        """Know one again who is no client any more; not more of them than there may be clients, for anybody can be one."""
        if caller.place not in self._callers:
            return
        self._resting[caller.place] = caller
        if len(self._resting) > self.shared.clients:
            next(iter(self._resting.values())).close()

    def drop(self, caller: UdpClient) -> None:
        """Know a client no more."""
        self._callers.pop(caller.place, None)
        self._resting.pop(caller.place, None)

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()
            await self._closed.wait()


def _bound(family: int, place: _Place) -> socket.socket:
    """Return a socket that is bound; uvloop does not close those that it cannot bind, nor does it say why.

    Raises:
        OSError: the address cannot be used.
    """
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.bind(place)
    except BaseException:
        bound.close()
        raise
    return bound


class UdpListener:
    """Takes clients at one address: with a socket for IPv4, and another for IPv6 where the host has both.

    Attributes:
        url: with the real port.
    """

    def __init__(self) -> None:
        self.url = ""
        self._sockets: list[UdpSocket] = []

    @classmethod
    async def open(cls, address: Address, shared: ServerContext) -> Self:
        """Open the sockets.

        Raises:
            OSError: the address cannot be used.
            ValueError: the host is no host name.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
        listener = cls()
        try:
            places: dict[int, _Place] = {}
            for family, *_, place in found:
                places.setdefault(family, place)
            for kind, (host, _, *more) in places.items():
                bound = _bound(kind, (host, address.port, *more))
                address = address._replace(port=bound.getsockname()[1])
                _, opened = await loop.create_datagram_endpoint(lambda: UdpSocket(shared, loop), sock=bound)
                listener._sockets.append(opened)
        except BaseException:
            await listener.close()
            raise
        listener.url = str(address)
        return listener

    async def close(self) -> None:
        """Take no more clients."""
        for opened in self._sockets:
            await opened.close()
