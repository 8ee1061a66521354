"""State shared by all clients of one server, on all transports."""

from __future__ import annotations

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Iterable
from operator import attrgetter, itemgetter
from typing import Final, Protocol

from orinkit.bcap.profiles import LONGEST_ON_LINE, BcapProfile, line_profile
from orinkit.cao.handles import HandleAllocator
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.cao.shared_secret import SecretAttempts
from orinkit.core.record import replaced
from orinkit.server import log_limiter
from orinkit.server.alive_option import ALIVE, check_alive
from orinkit.server.capacity import (
    UNAUTHENTICATED_PACKET,
    IncompleteRequests,
    MemoryBudget,
    default_per_address,
    limit_of_unauthenticated,
)
from orinkit.server.fair_queue import QueuedClient, queue_of
from orinkit.server.large_values import Worker
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import PacketLimits

_CHUNK: Final = 65536
_TURNS: Final = 100
_OBJECT: Final = 3e-6  # s to release an object
_QUIET: Final = 10.0  # s; during this time after a warning, the same kind of refusal is logged at DEBUG


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
        """Close the object after pending data has been sent and, over HTTP, calls in progress have completed."""

    def abort(self) -> None:
        """Close the object immediately."""


class Client(Closable, Protocol):
    """A connected client.

    Attributes:
        connected_at: loop time at which the client connected, s.
    """

    connected_at: float

    @property
    def holds_objects(self) -> bool:
        """True if the client holds an object."""

    @property
    def network(self) -> str:
        """The network (:func:`~orinkit.transport.address.network_of`) for which ``per_address`` counts the client."""

    def idle_since(self) -> float | None:
        """Return the loop time since which the client is idle; ``None`` if it has objects or a call in progress."""

    def evict(self) -> None:
        """Disconnect immediately, to make room for another client."""


class _Release(QueuedClient):
    """The release of the objects of a client that has disconnected."""

    def __init__(self, session: Session, client: str, pending: set[_Release]) -> None:
        self._session = session
        self._client = client
        self._pending = pending
        pending.add(self)

    def step(self) -> bool:
        """Release all objects."""
        self._pending.discard(self)
        before = CLIENT.set(self._client)
        self._session.close()
        CLIENT.reset(before)
        return False

    def abort(self) -> None:
        """Do nothing: the client has disconnected already."""


class ServerContext:
    """State shared by all clients of one server.

    Args:
        host: the providers.
        limits: limits on packets; a transport may have lower ones.
        clients: maximum number of clients. If it is reached, an idle client that holds no object is disconnected to
            make room for a new client; if there is no such client, the new client receives E_MAX_CONNECT.
        invoke_timeout: default limit on the duration of a call, s; see
            :class:`~orinkit.bcap.server.ServerConversation`.
        alive: seconds that a connectionless client may be silent while its motions run.
        dead_after: time in s after which a TCP connection counts as lost if the client's machine does not reply.
        per_address: maximum number of clients from one address; by default three quarters of ``clients``, rounded up.
        serial_packet: limit on the bytes of a packet on a serial line.

    Attributes:
        line: profile of serial lines.
        requires_secret: True if clients must send a secret (:attr:`~orinkit.cao.provider.Provider.requires_secret`).
        first_limits: limits on the packets of a client that has not sent the required secret.
        open: the connected clients.
        all: all objects that are closed with the server: the clients, connections that are being refused, serial lines
            without a client, HTTP connections.
        turned_away: connections in ``all`` that are refused because a limit is reached; they stay open until they have
            received the reply.
        partial: counts the bytes of incomplete requests.
        memory: counts the memory of calls in progress and unsent replies.
        guesses: failed token attempts over HTTP, by address of the client.
        held: by address of the client, the number of its requests with a wrong token to which the response is being
            delayed.
        opening: number of connections that have been accepted but are not yet in ``all``.
        closing: True if the server is closing and accepts no connections.
        empty: event that is set when ``all`` becomes empty.
        tasks: tasks of running calls, including those of disconnected clients, and of HTTP requests in progress.
        numbers: allocates the handles of all HTTP clients, so that an expired handle is never given to another client.
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
        serial_packet: int = LONGEST_ON_LINE,
    ) -> None:
        log_limiter.install()
        self.line: BcapProfile = line_profile(serial_packet)
        self.host = host
        self.limits = self.first_limits = limits
        self.requires_secret = host.requires_secret
        if self.requires_secret:
            self.first_limits = replaced(limits, packet=min(limits.packet, UNAUTHENTICATED_PACKET))
        self.clients = clients
        self.invoke_timeout = invoke_timeout
        self.dead_after = check_dead_after(dead_after)
        self.per_address = default_per_address(clients) if per_address is None else per_address
        self.alive = check_alive(alive)
        self.open: set[Client] = set()
        self.all: set[Closable] = set()
        self.turned_away: set[Closable] = set()
        self.partial = IncompleteRequests()
        self.memory = MemoryBudget()
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
        self._releases: set[_Release] = set()
        self._warned: dict[str, float] = {}

    def refusal_level(self, now: float, kind: str = "") -> int:
        """Return the log level for a refused client: WARNING once in 10 s, otherwise DEBUG.

        If the level were always WARNING, many refused clients would cause as many warnings.

        Args:
            now: time of the event loop, s.
            kind: kind of refusal, one of a few constants; the 10 s apply to each kind separately.
        """
        if now - self._warned.get(kind, -math.inf) < _QUIET:
            return logging.DEBUG
        self._warned[kind] = now
        return logging.WARNING

    def make_room(self, network: str) -> str:
        """Disconnect an idle client if a limit on clients leaves no room for a new client.

        The client that has been idle longest is disconnected. If the limit of the new client's address is reached, only
        clients of that address are considered, so that one address cannot displace the clients of other addresses. If
        clients must send a secret, the number of clients that have not sent it has a lower limit. The oldest one of
        these clients is disconnected, even if it has a call in progress.

        Args:
            network: :attr:`Client.network` of the new client.

        Returns:
            The reason why the new client cannot be accepted; ``""`` if it can.
        """
        if self.closing:
            return "the server is closing"
        if self.requires_secret:
            without = [each for each in self.open if not each.holds_objects]
            if len(without) >= limit_of_unauthenticated(self.clients):
                min(without, key=attrgetter("connected_at")).evict()
        of_address = [each for each in self.open if each.network == network]
        if len(of_address) >= self.per_address:
            return "" if _evict_idle(of_address) else f"{len(of_address)} clients of its address are connected"
        if len(self.open) >= self.clients:
            return "" if _evict_idle(self.open) else f"{len(self.open)} clients are connected"
        return ""

    def release(self, session: Session, client: str, virtual_time: float) -> None:
        """Release the objects of a client that has disconnected: now, or in turn if many clients disconnect at once.

        Args:
            session: the objects.
            client: the client's name in the log.
            virtual_time: the client's position in the queue (:class:`~orinkit.server.fair_queue.QueuedClient`).
        """
        session.free_names()  # the client may connect again before its objects are released
        release = _Release(session, client, self._releases)
        release.virtual_time = virtual_time
        if self.closing or not len(session):
            release.step()
        else:
            queue_of(asyncio.get_running_loop()).serve(release, _OBJECT * len(session))

    def discard(self, client: Closable) -> None:
        """Remove an object that has been closed from ``all`` and from ``turned_away``."""
        self.all.discard(client)
        self.turned_away.discard(client)
        if not self.all:
            self.empty.set()

    async def close(self, seconds: float) -> None:
        """Close all connections, then wait for the running calls; abort connections and calls that do not end in time.

        The listeners must be closed first.

        Args:
            seconds: time limit, s; it applies separately to closing connections, aborting connections, and the calls.
        """
        for _ in range(_TURNS):
            if not self.opening:
                break
            await asyncio.sleep(0)
        for client in list(self.all):
            client.close()
        for release in list(self._releases):
            release.step()
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
