"""Capacity of a server: clients, clients per address, bytes of incomplete requests, memory of calls and replies."""

from __future__ import annotations

from typing import Final, Protocol

DEFAULT_CLIENTS: Final = 344
"""Maximum number of clients. Three quarters of it, 258, may have the same address, so that one machine can run 256."""


def default_per_address(clients: int) -> int:
    """Return the default limit on clients from one address: three quarters of ``clients``, rounded up.

    The remaining quarter is available to other addresses.
    """
    return clients - clients // 4


UNAUTHENTICATED: Final = 64
"""Maximum number of clients without an object, on a server whose clients must send a secret."""
UNAUTHENTICATED_PACKET: Final = 4096
"""Maximum number of bytes of a packet of such a client."""


def limit_of_unauthenticated(clients: int) -> int:
    """Return the maximum number of clients that have not sent the secret, at most half of ``clients``, rounded up."""
    return min(UNAUTHENTICATED, clients - clients // 2)


PARTIAL: Final = 64 * 1024 * 1024
"""Limit on the total number of bytes in the incomplete requests of all clients of a server."""
ALWAYS: Final = 64 * 1024
"""Number of bytes of one incomplete request that are always accepted, even if :data:`PARTIAL` is exceeded."""


class IncompleteRequests:
    """Counts the bytes of the incomplete requests of all clients of a server."""

    def __init__(self) -> None:
        self.bytes = 0

    def change(self, before: int, now: int) -> bool:
        """Change the count of one request from ``before`` to ``now`` bytes; return False if the request is refused.

        A request is refused if it grows beyond :data:`ALWAYS` bytes while all requests together exceed :data:`PARTIAL`.
        """
        self.bytes += now - before
        return now <= ALWAYS or now <= before or self.bytes <= PARTIAL


CALL_MEMORY: Final = 64 * 1024 * 1024
"""Limit on the memory of all clients of a server for arguments of calls in progress and for unsent replies, bytes."""


class Reader(Protocol):
    """A client that reads a large reply slowly."""

    def drop(self) -> None:
        """Disconnect the client, and no longer count its unsent reply."""


class MemoryBudget:
    """Counts the memory for the arguments of calls in progress and for unsent replies, of all clients of a server.

    If it is exhausted, slow readers are disconnected, so that they do not prevent the calls of other clients.

    Attributes:
        bytes: the counted memory.
    """

    def __init__(self) -> None:
        self.bytes = 0
        self._slow: dict[Reader, None] = {}  # the slowest reader first

    def add_slow_reader(self, reader: Reader) -> None:
        """Disconnect a client if the budget is exhausted later."""
        self._slow[reader] = None

    def discard_slow_reader(self, reader: Reader) -> None:
        """Undo :meth:`add_slow_reader`, because the client has read its reply or has disconnected."""
        self._slow.pop(reader, None)

    def change(self, before: int, now: int) -> bool:
        """Change the count of one call or reply from ``before`` to ``now`` bytes; return False if that exceeds the limit.

        Up to :data:`ALWAYS` bytes are always permitted.
        """
        self.bytes += now - before
        if now <= ALWAYS or now <= before:
            return True
        while self.bytes > CALL_MEMORY and self._slow:
            reader = next(iter(self._slow))
            del self._slow[reader]
            reader.drop()
        return self.bytes <= CALL_MEMORY


class CallMemory:
    """The memory of one call, or of one unsent reply, in a :class:`MemoryBudget`.

    Args:
        budget: the budget of the server.

    Attributes:
        bytes: the memory that the budget counts.
    """

    __slots__ = ("_budget", "bytes")

    def __init__(self, budget: MemoryBudget) -> None:
        self._budget = budget
        self.bytes = 0

    def set(self, size: int) -> bool:
        """Set the memory; return False, and set it to 0, if the limit of the budget would be exceeded."""
        before, self.bytes = self.bytes, size
        if self._budget.change(before, size):
            return True
        self.release()
        return False

    def hand_over(self) -> CallMemory:
        """Return another object that counts the memory from now on."""
        other = CallMemory(self._budget)
        other.bytes, self.bytes = self.bytes, 0
        return other

    def release(self) -> None:
        """Set the memory to 0."""
        if self.bytes:
            self._budget.change(self.bytes, 0)
            self.bytes = 0
