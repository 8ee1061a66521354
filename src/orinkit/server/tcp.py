"""A b-CAP client's TCP connection, server side, and the listener that takes them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from typing import Final, Self, cast

from orinkit.bcap.profiles import STREAM, BcapProfile
from orinkit.bcap.server import Execute
from orinkit.cao.provider import ClientInfo
from orinkit.server import accepting
from orinkit.server.accepting import ONE_AT_A_TIME, deepen
from orinkit.server.context import ServerContext
from orinkit.server.peer import Peer
from orinkit.transport.address import Address
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.tcp_keepalive import prepare

logger = logging.getLogger("orinkit.server")

PATIENCE: Final = 10.0
"""Seconds that a client has for its first call, for each packet, and for its last answers."""
PROGRESS: Final = 64 * 1024
"""Bytes of a packet in :data:`PATIENCE` seconds with which a client has that long again: long packets on slow lines."""

_TO_BE_TOLD: Final = 5.0  # seconds in which one client too many may ask once and be told
_TOLD: Final = 64  # of those who are told at a time; further ones are closed at once


class TcpConnection(Peer, asyncio.BufferedProtocol):
    """One client on TCP, or on another stream.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB, which costs
    more than everything else that is done for a call.
    """

    def __init__(self, shared: ServerContext, loop: asyncio.AbstractEventLoop, profile: BcapProfile = STREAM) -> None:
        super().__init__(shared, loop, profile)
        self._kind = profile.name
        shared.opening += 1
        self._idle_timer: asyncio.TimerHandle | None = None
        self._partial = 0  # bytes of it that are counted
        self._begun = 0.0  # when the packet began that is not whole yet; 0 where there is none
        self._seen = 0, 0  # packets before it, and its bytes then

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self._transport = transport = cast("asyncio.Transport", transport)  # uvloop's are none by their class
        self._send = transport.write
        self._is_gone = transport.is_closing
        prepare(transport.get_extra_info("socket"), self._shared.dead_after)
        host, port = (transport.get_extra_info("peername") or ("", 0))[:2]
        self._place = (host, port)
        self._name = f"{host}:{port}"
        self._host = str(host)
        self._heard = self._loop.time()
        self._shared.opening -= 1
        keep_from_children(self)
        self._shared.all.add(self)
        if self._shared.closing:
            transport.abort()
        elif self._admit() is not None:
            self._idle_timer = self._loop.call_at(self._heard + PATIENCE, self._look_at_the_time)
        elif len(self._shared.turned_away) < _TOLD:
            self._shared.turned_away.add(self)
            self._alarm = self._loop.call_later(_TO_BE_TOLD, transport.abort)
        else:
            transport.abort()

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - declared by the base
        """Where to put what comes next; all connections share it, for it is read at once."""
        return self._shared.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """The client has sent something."""
        self._heard = now = self._loop.time()
        self._act(self._conversation.receive(bytes(self._shared.view[:nbytes]), now))
        incomplete = self._conversation.incomplete
        if (incomplete or self._partial) and not self._held:  # one that waits for the worker counts until it is read
            self._count(incomplete)
        if incomplete:
            self._await_packet(now)
        elif self._begun:
            self._begun = 0.0

    def pause_writing(self) -> None:
        """The client does not take its answers: stop listening to it."""
        self._slow = True
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        """It takes them again."""
        self._slow = False
        if not self._held:
            self._transport.resume_reading()
        self._go_on()

    def _hold(self) -> None:
        self._held = True
        self._transport.pause_reading()

    def _let_go(self) -> None:
        self._held = False
        if self._partial:
            self._count(self._conversation.incomplete)
        if not self._slow:
            self._transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone: whatever it held is released."""
        if self._idle_timer is not None:
            self._idle_timer.cancel()
            self._idle_timer = None
        self._shared.partial.change(self._partial, 0)
        self._partial = 0
        self._leave(exc)
        self._shared.discard(self)

    def _count(self, incomplete: int) -> None:
        """Count the bytes of a packet that has begun; there is only so much room for those of all clients."""
        before, self._partial = self._partial, incomplete
        if self._shared.partial.change(before, incomplete) or self._is_gone():
            return
        self._send(self._conversation.refuse_packet())
        level = self._shared.refusal_level(self._loop.time(), "partial")
        logger.log(
            level, "%s: closed: packets that have not come whole have %d bytes", self._name, self._shared.partial.bytes
        )
        self.close()

    # --- time ---------------------------------------------------------------------------------------------------

    def _await_packet(self, now: float) -> None:
        """A packet has begun: its rest is to come."""
        if not self._begun or self._conversation.packets != self._seen[0]:
            self._mark(now)
        if self._idle_timer is None and not self._is_gone():
            self._idle_timer = self._loop.call_at(self._begun + PATIENCE, self._look_at_the_time)

    def _mark(self, now: float) -> None:
        self._begun = now
        self._seen = self._conversation.packets, self._conversation.incomplete

    def _look_at_the_time(self) -> None:
        """A first call, or the rest of a packet, should have come by now, unless it began later."""
        self._idle_timer = None
        now = self._loop.time()
        if self._held:  # it is this side that takes its time
            self._idle_timer = self._loop.call_at(now + PATIENCE, self._look_at_the_time)
        elif not self._conversation.calls:
            self._give_up("it has made no call")
        elif self._begun:
            # while its answers are not taken, it is this side that does not read
            if self._slow or self._conversation.incomplete - self._seen[1] >= PROGRESS:
                self._mark(now)
            if now < self._begun + PATIENCE:
                self._await_packet(now)
            else:
                self._give_up("the rest of a packet has not come")

    def _give_up(self, reason: str) -> None:
        level = self._shared.refusal_level(self._loop.time(), "silent")
        logger.log(level, "%s: closed: %s within %g s", self._name, reason, PATIENCE)
        self._transport.abort()

    # --- the shell ------------------------------------------------------------------------------------------------

    def _about(self) -> ClientInfo:
        host, port = self._place
        return ClientInfo(host, self._kind, port, self.drain_input)

    def _refuse(self, call: Execute) -> None:
        super()._refuse(call)
        self.close()

    def give_way(self) -> None:
        """Be a client no more: another one has come, and this one holds nothing."""
        super().give_way()
        self._transport.abort()

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return (self._transport.get_extra_info("socket").fileno(),)

    def close(self) -> None:
        """Close the connection from this side, once what was written has been sent; not later than in 10 s."""
        self._transport.close()
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        self._idle_timer = self._loop.call_later(PATIENCE, self._transport.abort)

    def abort(self) -> None:
        """Close the connection at once, whatever was to be sent."""
        self._transport.abort()


class TcpListener:
    """Takes clients at one address.

    Attributes:
        url: with the real port.
    """

    def __init__(self, server: asyncio.Server, url: str) -> None:
        self._server = server
        self.url = url
        keep_from_children(self)

    @classmethod
    async def open(cls, address: Address, shared: ServerContext) -> Self:
        """Listen.

        Raises:
            OSError: the address cannot be used.
            ValueError: the host is no host name.
        """
        loop = asyncio.get_running_loop()
        server = await loop.create_server(
            lambda: TcpConnection(shared, loop), address.host, address.port, backlog=ONE_AT_A_TIME, reuse_address=True
        )
        deepen(server)
        return cls(server, str(address._replace(port=server.sockets[0].getsockname()[1])))

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return [each.fileno() for each in self._server.sockets]

    async def close(self) -> None:
        """Take no more clients."""
        await accepting.close(self._server)
