"""State shared by all clients of one server, on all transports."""

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
from orinkit.server.capacity import IncompleteRequests, default_per_address
from orinkit.server.large_values import Worker
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import PacketLimits

_CHUNK: Final = 65536
_TURNS: Final = 100
_QUIET: Final = 10.0  # s after a warning during which the same kind of refusal is logged at DEBUG only


class Listener(Protocol):
    """Accepts clients at one address.

    Attributes:
        url: the address, with its actual port or path.
    """

    url: str

    async def close(self) -> None:
        """Stop accepting clients; :meth:`ServerContext.close` closes those that are connected."""


class Closable(Protocol):
    """An object that is closed with the server: a client, a connection, or a serial line."""

    def close(self) -> None:
        """Close it after pending data has been sent and, over HTTP, calls in progress have completed."""

    def abort(self) -> None:
        """Close it immediately."""


class Client(Closable, Protocol):
    """A connected client."""

    @property
    def network(self) -> str:
        """The network of its address (:func:`~orinkit.transport.address.network_of`); clients are limited per network."""

    def idle_since(self) -> float | None:
        """Return the loop time of its last request; ``None`` if it holds an object or has a call in progress."""

    def evict(self) -> None:
        """Disconnect immediately, to make room for another client; called only if this client is idle."""


class ServerContext:
    """State shared by all clients of one server.

    Args:
        host: the providers.
        limits: bounds on packets; a transport may have narrower ones.
        clients: maximum number of clients; a further one receives E_MAX_CONNECT, unless an idle client that holds no
            object can be disconnected.
        invoke_timeout: default limit on the duration of a call, s; see :class:`~orinkit.bcap.server.ServerConversation`.
        alive: seconds that a connectionless client may be silent while its motions run.
        dead_after: seconds without a reply from a client's machine after which its TCP connection counts as lost.
        per_address: maximum number of clients from one address; by default three quarters of ``clients``, rounded up.

    Attributes:
        open: the connected clients.
        all: everything that is closed with the server: the clients, connections that are being refused, serial lines
            without a client, HTTP connections.
        turned_away: connections in ``all`` that are refused for lack of room and stay open to receive the reply.
        partial: counts the bytes of incomplete requests.
        guesses: failed token attempts over HTTP, by address.
        held: number of delayed replies to wrong tokens, by address.
        opening: number of connections that have been accepted but are not yet in ``all``.
        closing: whether the server is closing and accepts no connections.
        empty: set when ``all`` becomes empty.
        tasks: running handlers, including those of disconnected clients, and HTTP requests in progress.
        numbers: allocates the handles of all HTTP clients, so that an expired handle never belongs to another client.
        worker: decodes large packets and encodes large results.
        buffer: receive buffer of all connections; they can share it because received data is processed immediately.
        view: memoryview of ``buffer``.
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
        self.per_address = default_per_address(clients) if per_address is None else per_address
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
        """Return the log level for a refused client: WARNING once in 10 s, otherwise DEBUG, because there may be many.

        Args:
            now: time of the event loop, s.
            kind: kind of refusal, one of a few constants; each kind has its own 10 s.
        """
        if now - self._warned.get(kind, -math.inf) < _QUIET:
            return logging.DEBUG
        self._warned[kind] = now
        return logging.WARNING

    def make_room(self, network: str) -> str:
        """Return why a new client cannot be accepted, or ``""`` if it can, if necessary by disconnecting an idle client.

        The client that has been idle longest is disconnected. If the limit of the new client's address is reached, only
        clients of that address are considered: an address cannot displace others.
        """
        if self.closing:
            return "the server is closing"
        of_address = [each for each in self.open if each.network == network]
        if len(of_address) >= self.per_address:
            return "" if _evict_idle(of_address) else f"{len(of_address)} clients of its address are connected"
        if len(self.open) >= self.clients:
            return "" if _evict_idle(self.open) else f"{len(self.open)} clients are connected"
        return ""

    def discard(self, client: Closable) -> None:
        """Remove a closed client from ``all``."""
        self.all.discard(client)
        self.turned_away.discard(client)
        if not self.all:
            self.empty.set()

    async def close(self, seconds: float) -> None:
        """Close all connections and wait for the handlers; abort what has not finished in time.

        The listeners must be closed first.

        Args:
            seconds: limit for each of the steps.
        """
        for _ in range(_TURNS):
            if not self.opening:
                break
            await asyncio.sleep(0)
        for client in list(self.all):
            client.close()
        if not await self._emptied(seconds):  # a client does not read its last replies
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


def _evict_idle(clients: Iterable[Client]) -> bool:
    idle = [(since, each) for each in clients if (since := each.idle_since()) is not None]
    if not idle:
        return False
    _, longest = min(idle, key=itemgetter(0))
    longest.evict()
    return True
