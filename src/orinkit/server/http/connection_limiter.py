"""The limit on the connections of an HTTP listener."""

from __future__ import annotations

from itertools import chain
from typing import Final, Protocol

from orinkit.server.capacity import default_per_address
from orinkit.server.context import ServerContext

_MIN_CONNECTIONS: Final = 85  # smallest limit on connections; 64 of them may come from one address


class LimitedConnection(Protocol):
    """A connection that a :class:`ConnectionLimiter` counts."""

    @property
    def network(self) -> str:
        """The network of the client's address; see :func:`~orinkit.transport.address.network_of`."""

    @property
    def has_call(self) -> bool:
        """True if a complete request is in progress."""

    def abort(self) -> None:
        """Close the connection immediately."""


class ConnectionLimiter:
    """Counts the connections of a listener. When the limit is exceeded, an idle connection is evicted.

    If the limit of one address is exceeded, a connection of that address is evicted. The limiter first evicts the
    oldest of the connections on which no response has been sent, so that peers that only connect displace each other
    and not clients. If there is no such connection, it evicts the one whose last response is the oldest.

    Args:
        context: the state shared by all clients of the server.

    Attributes:
        context: the state shared by all clients of the server.
        limit: limit on connections. It is higher than the limit on clients, because a client that opens a connection
            for each call may have several connections for a short time.
        per_address: limit on connections of one address.
    """

    def __init__(self, context: ServerContext) -> None:
        self.context = context
        self.limit = max(_MIN_CONNECTIONS, context.clients + context.clients // 2)
        self.per_address = max(default_per_address(self.limit), context.per_address)
        self._unproven: dict[LimitedConnection, None] = {}  # no response has been sent; the oldest connection first
        self._proven: dict[LimitedConnection, None] = {}  # in the order of their last responses, the oldest first

    def __len__(self) -> int:
        """Return the number of connections."""
        return len(self._unproven) + len(self._proven)

    def admit(self, connection: LimitedConnection) -> bool:
        """Count a new connection; return False if the limit is reached and no connection is idle."""
        of_address = [each for each in chain(self._unproven, self._proven) if each.network == connection.network]
        full = len(of_address) >= self.per_address
        if full or len(self) >= self.limit:
            candidates = of_address if full else chain(self._unproven, self._proven)
            oldest = next((each for each in candidates if not each.has_call), None)
            if oldest is None:
                return False
            self.discard(oldest)
            oldest.abort()
        self._unproven[connection] = None
        return True

    def mark_replied(self, connection: LimitedConnection) -> None:
        """Record that a response has been sent on a connection."""
        if connection in self._unproven or connection in self._proven:
            self.discard(connection)
            self._proven[connection] = None

    def discard(self, connection: LimitedConnection) -> None:
        """Stop counting a connection."""
        self._unproven.pop(connection, None)
        self._proven.pop(connection, None)
