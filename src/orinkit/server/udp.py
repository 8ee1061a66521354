"""b-CAP server on UDP: one socket for all clients, which are distinguished by their addresses."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterable
from functools import partial
from typing import Any, Final, Self, TypeAlias, cast

from orinkit.bcap.actions import Encoded, Execute
from orinkit.bcap.profiles import DATAGRAM
from orinkit.cao.provider import ClientInfo
from orinkit.cao.session import Session
from orinkit.server.connectionless import ConnectionlessClient
from orinkit.server.context import ServerContext
from orinkit.transport.address import Address
from orinkit.transport.fork_safety import keep_from_children
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.server")

IDLE_TIMEOUT: Final = 10.0
"""Idle time in s after which a client is disconnected (docs/protocol.md)."""

_MAX_QUEUED: Final = 16 * 1024  # bytes of the queued datagrams of one client, above which further ones are dropped
_MAX_ALL_QUEUED: Final = 1024 * 1024  # the same of all clients of a socket
_DATAGRAM: Final = 512  # bytes added to the length of a queued datagram, for the objects that it requires
_MAX_SIZE_ATTRIBUTE: Final = "max_size"  # attribute of asyncio: buffer size per datagram; the default, 256 KiB, is slow
_MAX_DATAGRAM: Final = 65536  # length of the longest datagram, bytes

_SocketAddress: TypeAlias = tuple[Any, ...]  # socket address of a client: host and port, for IPv6 two more elements


class UdpClient(ConnectionlessClient):
    """A client on UDP.

    The client's session begins with its first call. It ends with Service_Stop, or if nothing is received for
    :data:`IDLE_TIMEOUT` while no call is in progress. The reply to the last request is stored for :data:`IDLE_TIMEOUT`,
    because the client repeats the request if the reply is lost.
    """

    def __init__(self, udp_socket: UdpSocket, socket_address: _SocketAddress) -> None:
        super().__init__(udp_socket.context, udp_socket.loop, DATAGRAM)
        self.socket_address = socket_address
        self._socket = udp_socket
        self._name = f"{socket_address[0]}:{socket_address[1]}/udp"
        self._host = str(socket_address[0])
        self._send = partial(udp_socket.send, socket_address)
        self._is_closing = udp_socket.is_closing
        self.default_silence_limit = udp_socket.context.alive
        self._timer: asyncio.TimerHandle | None = None
        self._queued = 0

    def received(self, data: bytes) -> None:
        """Process a datagram of the client: now, or when it is the client's turn.

        Reading from the socket cannot be paused for one client. Therefore datagrams are dropped if too many are queued.
        """
        size = len(data) + _DATAGRAM
        if (self._queued and self._queued + size > _MAX_QUEUED) or not self._socket.has_room(size):
            return
        self._process(data, self._loop.time())
        if self.is_queued:
            self._queued += size
            self._socket.keep_queued(self, size)

    def _on_processed(self) -> None:
        if self._queued:
            self._socket.forget_queued(self, self._queued)
            self._queued = 0

    def _about(self) -> ClientInfo:
        host, port, *_ = self.socket_address
        return ClientInfo(host, DATAGRAM.name, port, self.when_input_processed, disconnect=self.disconnect)

    def _new_session(self) -> Session | None:
        session = super()._new_session()
        if session is not None:
            self._context.all.add(self)
            self._socket.keep(self)
            if self._timer is None:
                self._timer = self._loop.call_later(IDLE_TIMEOUT, self._check_idle_time)
        return session

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        self._heard = self._loop.time()
        super()._deliver(call, code, result)

    def _end_session(self, reason: object = None) -> None:
        self._leave(reason)
        self._socket.keep_for_duplicates(self)

    def _check_idle_time(self) -> None:
        until = IDLE_TIMEOUT if self._conversation.busy else self._heard + IDLE_TIMEOUT - self._loop.time()
        if until > 0:
            self._timer = self._loop.call_later(until, self._check_idle_time)
        else:
            self._forget("nothing received")

    def _forget(self, reason: object = None) -> None:
        self._waiting.clear()
        self._on_processed()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._leave(reason)
        self._socket.drop(self)
        self._context.discard(self)

    def give_up(self, reason: str) -> None:
        """Close the session of an unreachable client, and discard its address."""
        self._forget(reason)

    def close(self) -> None:
        """Close the session, and discard the client's address."""
        self._forget()

    def abort(self) -> None:
        """Close the session, and discard the client's address."""
        self._forget()


class UdpSocket(asyncio.DatagramProtocol):
    """A UDP socket and its clients.

    Args:
        context: the state shared by all clients of the server.
        loop: the event loop of the socket.
    """

    def __init__(self, context: ServerContext, loop: asyncio.AbstractEventLoop) -> None:
        self.context = context
        self.loop = loop
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False
        self._clients: dict[_SocketAddress, UdpClient] = {}
        self._without_session: dict[_SocketAddress, UdpClient] = {}  # the clients without a session, the oldest first
        self._queued: dict[_SocketAddress, UdpClient] = {}  # the clients with queued datagrams
        self._queued_bytes = 0
        self._closed = asyncio.Event()

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Prepare the socket."""
        self._transport = cast("asyncio.DatagramTransport", transport)  # not a subclass in Python 3.11
        if hasattr(transport, _MAX_SIZE_ATTRIBUTE):
            setattr(transport, _MAX_SIZE_ATTRIBUTE, _MAX_DATAGRAM)
        keep_from_children(self)

    def datagram_received(self, data: bytes, addr: _SocketAddress) -> None:
        """Process a datagram of a client or of an unknown sender."""
        client = self._clients.get(addr) or self._queued.get(addr)
        if client is None:
            client = UdpClient(self, addr)  # the client is stored only if the datagram is a call, or has to wait
        client.received(data)

    def error_received(self, exc: Exception) -> None:
        """Log that a datagram could not be sent or received; the client repeats a lost request."""
        logger.debug("UDP: %s", exc)

    def pause_writing(self) -> None:
        """Drop further replies, because the socket's buffer is full."""
        self._full = True

    def resume_writing(self) -> None:
        """Send replies again."""
        self._full = False

    def connection_lost(self, exc: Exception | None) -> None:
        """Signal that the socket has been closed."""
        if exc is not None:
            logger.error("UDP: closed: %s", exc)
        self._closed.set()

    # --- for the clients ------------------------------------------------------------------------------------------

    def is_closing(self) -> bool:
        """Return True if nothing can be sent any more."""
        return self._transport is None or self._transport.is_closing()

    def send(self, socket_address: _SocketAddress, data: bytes) -> None:
        """Send a datagram, or drop it if the socket's buffer is full."""
        if not self._full and self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, socket_address)

    def has_room(self, size: int) -> bool:
        """Return True if a datagram of ``size`` bytes may be queued."""
        return self._queued_bytes + size <= _MAX_ALL_QUEUED

    def keep_queued(self, client: UdpClient, size: int) -> None:
        """Store a client while a datagram of it is queued, so that its next datagram is processed after this one."""
        self._queued[client.socket_address] = client
        self._queued_bytes += size

    def forget_queued(self, client: UdpClient, size: int) -> None:
        """Remove a client without queued datagrams; they had ``size`` bytes."""
        self._queued.pop(client.socket_address, None)
        self._queued_bytes -= size

    def keep(self, client: UdpClient) -> None:
        """Store a client that has a session."""
        self._clients[client.socket_address] = client
        self._without_session.pop(client.socket_address, None)

    def keep_for_duplicates(self, client: UdpClient) -> None:
        """Store a client whose session has ended, to detect duplicates of its requests.

        The number of such clients is limited, because any sender may become a client.
        """
        if client.socket_address not in self._clients:
            return
        self._without_session[client.socket_address] = client
        if len(self._without_session) > self.context.clients:
            next(iter(self._without_session.values())).close()

    def drop(self, client: UdpClient) -> None:
        """Remove a client."""
        self._clients.pop(client.socket_address, None)
        self._without_session.pop(client.socket_address, None)

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptor that a forked child replaces by the null device."""
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()
            await self._closed.wait()


def _bound(family: int, socket_address: _SocketAddress) -> socket.socket:
    """Return a bound socket.

    The event loop does not bind the socket, because uvloop does not close a socket that it cannot bind, and does not
    report the reason.

    Raises:
        OSError: If the address cannot be used.
    """
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.bind(socket_address)
    except BaseException:
        bound.close()
        raise
    return bound


class UdpListener:
    """Accepts UDP clients at one address: with one socket for IPv4 and one for IPv6 if the host has addresses of both.

    Attributes:
        url: the address, with the actual port.
    """

    def __init__(self) -> None:
        self.url = ""
        self._sockets: list[UdpSocket] = []

    @classmethod
    async def open(cls, address: Address, context: ServerContext) -> Self:
        """Open the sockets.

        Raises:
            OSError: If the address cannot be used.
            ValueError: If the host is not a valid host name.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
        listener = cls()
        try:
            socket_addresses: dict[int, _SocketAddress] = {}
            for family, *_, socket_address in found:
                socket_addresses.setdefault(family, socket_address)
            for number, (host, _, *more) in socket_addresses.items():
                bound = _bound(number, (host, address.port, *more))
                address = address._replace(port=bound.getsockname()[1])
                _, opened = await loop.create_datagram_endpoint(lambda: UdpSocket(context, loop), sock=bound)
                listener._sockets.append(opened)
        except BaseException:
            await listener.close()
            raise
        listener.url = str(address)
        return listener

    async def close(self) -> None:
        """Close the sockets."""
        for opened in self._sockets:
            await opened.close()
