"""How many clients a server takes, how many of them from one address, and how much of what they have begun to send."""

from __future__ import annotations

from typing import Final

DEFAULT_CLIENTS: Final = 344
"""Clients of a server at a time; three quarters of them, 258, may be of one address: a machine can have 256."""


def most_of_an_address(places: int) -> int:
    """Return how many of a number of places the clients of one address may have, so that there are some for others."""
    return places - places // 4


PARTIAL: Final = 64 * 1024 * 1024
"""Bytes of requests that have not come whole, of all clients of a server."""
ALWAYS: Final = 64 * 1024
"""Bytes of one of them that there is always room for, however much others have begun to send."""


class IncompleteRequests:
    """Counts the bytes of requests that have not come whole."""

    def __init__(self) -> None:
        self.bytes = 0

    def change(self, before: int, now: int) -> bool:
        """Count what a request has now instead of what it had; returns whether there is room for that."""
        self.bytes += now - before
        return now <= ALWAYS or now <= before or self.bytes <= PARTIAL
