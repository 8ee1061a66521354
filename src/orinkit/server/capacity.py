"""Capacity of a server: clients, clients per address, and bytes of incomplete requests."""

from __future__ import annotations

from typing import Final

DEFAULT_CLIENTS: Final = 344
"""Maximum number of clients. Three quarters of them, 258, may have one address: one machine can run 256 clients."""


def default_per_address(clients: int) -> int:
    """Return the limit for one address: three quarters of all clients, rounded up; the rest is for other addresses."""
    return clients - clients // 4


PARTIAL: Final = 64 * 1024 * 1024
"""Limit on the bytes of incomplete requests of all clients of a server."""
ALWAYS: Final = 64 * 1024
"""Bytes of one incomplete request that are always accepted, regardless of the other clients."""


class IncompleteRequests:
    """Counts the bytes of incomplete requests."""

    def __init__(self) -> None:
        self.bytes = 0

    def change(self, before: int, now: int) -> bool:
        """Change the count of one request from ``before`` to ``now`` bytes; return False if the limit is exceeded."""
        self.bytes += now - before
        return now <= ALWAYS or now <= before or self.bytes <= PARTIAL
