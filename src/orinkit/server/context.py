"""What the clients of one server share, whatever they are connected by."""

from __future__ import annotations

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Iterable
from operator import itemgetter
from typing import Final, Protocol

from orinkit.cao.session import HandleAllocator, ProviderRegistry
from orinkit.cao.shared_secret import SecretAttempts
from orinkit.server import log_limiter
from orinkit.server.alive_option import ALIVE, check_alive
from orinkit.server.capacity import IncompleteRequests, most_of_an_address
from orinkit.server.large_values import Worker
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import PacketLimits

_CHUNK: Final = 65536
_TURNS: Final = 100
_QUIET: Final = 10.0  # s after a warning in which what is the same is no news


class Listener(Protocol):
    """Where clients come in.

    Attributes:
        url: where it really is.
    """

    url: str

    async def close(self) -> None:
        """Take no more clients; those who are there are closed by :meth:`ServerContext.close`."""


class Closable(Protocol):
    """A client, a connection, a line: whatever has to be closed when the server is."""

    def close(self) -> None:
        """Close it, once what was written has been sent and, over HTTP, the calls at work are done."""

    def abort(self) -> None:
        """Close it at once."""


class Client(Closable, Protocol):
    """A client."""

    @property
    def network(self) -> str:
        """Where it is from, as :func:`~orinkit.transport.address.network_of` tells; a limit counts its clients."""

    def idle_since(self) -> float | None:
        """Return the loop's time at which it was last heard of; ``None`` where it holds an object, or a call is at work."""

    def give_way(self) -> None:
        """Be a client no more, at once: another one has come, and this one holds nothing."""


class ServerContext:
    """What the clients of one server share.

    Args:
        host: the providers.
        limits: bounds on packets; the wire may have narrower ones.
        clients: how many clients at a time; one more is answered with E_MAX_CONNECT, unless one makes room that is idle
            and holds nothing.
        invoke_timeout: seconds, see :class:`~orinkit.bcap.server.ServerConversation`.
        alive: seconds that a client without a connection may be silent while its motions run.
        dead_after: seconds without an answer from a client's machine after which its TCP connection is given up.
        per_address: how many clients of one address at a time; by default three quarters of ``clients``, rounded up.

    Attributes:
        open: the clients.
        all: whatever has to be closed: these, connections that are being refused, serial lines without a client,
            connections over HTTP.
        turned_away: connections of those of ``all`` for whom there is no room, while they are told so.
        partial: bytes of requests that have not come whole.
        guesses: wrong tokens over HTTP, by address.
        held: how many answers to wrong tokens are being held back, by address.
        opening: how many connections have been accepted and are not in ``all`` yet.
        closing: no more connections.
        empty: is set when the last of ``all`` has gone.
        tasks: handlers at work, also those whose client has gone; and requests over HTTP that are being answered.
        numbers: handles of the clients over HTTP: one that a client has kept for too long must not be another's.
        worker: reads large packets and writes large results.
        view: where data is read to; all connections share it, for it is handled at once.
    """

    def __init__(
        self,
        host: ProviderRegistry,
        limits: PacketLimits,
        clients: int,
        invoke_timeout: float,
        dead_after: float = DEAD_AFTER,
        per_address: int | None = None,
        alive: float = ALIVE,
    ) -> None:
        log_limiter.install()
        self.host = host
        self.limits = limits
        self.clients = clients
        self.invoke_timeout = invoke_timeout
        self.dead_after = check_dead_after(dead_after)
        self.per_address = most_of_an_address(clients) if per_address is None else per_address
        self.alive = check_alive(alive)
        self.open: set[Client] = set()
        self.all: set[Closable] = set()
        self.turned_away: set[Closable] = set()
        self.partial = IncompleteRequests()
        self.guesses = SecretAttempts()
        self.held: Counter[str] = Counter()
        self.opening = 0
        self.closing = False
        self.empty = asyncio.Event()
        self.tasks: set[asyncio.Task[None]] = set()
        self.numbers = HandleAllocator()
        self.worker = Worker()
        self.buffer = bytearray(_CHUNK)
        self.view = memoryview(self.buffer)
        self._warned: dict[str, float] = {}

    def refusal_level(self, now: float, kind: str = "") -> int:
        """Return the level at which it is to be logged that a client is refused: a warning in 10 s, as they may be many.

        Args:
            now: time of the event loop, s.
            kind: of refusal; each kind is warned of by itself. One of a few constants.
        """
        if now - self._warned.get(kind, -math.inf) < _QUIET:
            return logging.DEBUG
        self._warned[kind] = now
        return logging.WARNING

    def make_room(self, network: str) -> str:
        """Return why there is no room for a newcomer; ``""`` where there is, or where an idle client has made way.

        The one that has been idle longest makes way. Where an address has all of its places, it is one of that address: it
        cannot drive others out.
        """
        if self.closing:
            return "the server is closing"
        of_address = [each for each in self.open if each.network == network]
        if len(of_address) >= self.per_address:
            return "" if _has_made_way(of_address) else f"{len(of_address)} clients of its address are connected"
        if len(self.open) >= self.clients:
            return "" if _has_made_way(self.open) else f"{len(self.open)} clients are connected"
        return ""

    def discard(self, client: Closable) -> None:
        """Forget one of ``all``: it has been closed."""
        self.all.discard(client)
        self.turned_away.discard(client)
        if not self.all:
            self.empty.set()

    async def close(self, seconds: float) -> None:
        """Close all connections and let the handlers end; what is not done within the seconds is cut off.

        The listeners have been closed before.
        """
        for _ in range(_TURNS):
            if not self.opening:
                break
            await asyncio.sleep(0)
        for client in list(self.all):
            client.close()
        if not await self._emptied(seconds):  # a client does not take its last answers
            for client in list(self.all):
                client.abort()
            await self._emptied(seconds)
        await asyncio.sleep(0)
        if self.tasks:
            await asyncio.wait(self.tasks, timeout=seconds)
        for task in self.tasks:
            task.cancel()
        await asyncio.sleep(0)

    async def _emptied(self, seconds: float) -> bool:
        if self.all:
            self.empty.clear()
            try:
                async with asyncio.timeout(seconds):
                    await self.empty.wait()
            except TimeoutError:
                return False
        return True


def _has_made_way(clients: Iterable[Client]) -> bool:
    idle = [(since, each) for each in clients if (since := each.idle_since()) is not None]
    if not idle:
        return False
    _, longest = min(idle, key=itemgetter(0))
    longest.give_way()
    return True
