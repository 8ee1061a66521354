"""Capacity of a server: clients, clients per address, and bytes of incomplete requests."""

from __future__ import annotations

from typing import Final

DEFAULT_CLIENTS: Final = 344
"""Maximum number of clients. Three quarters of it, 258, may have the same address, so that one machine can run 256."""


def default_per_address(clients: int) -> int:
    """Return the default limit on clients from one address: three quarters of ``clients``, rounded up.

    The remaining quarter is available to other addresses.
    """
    return clients - clients // 4


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
