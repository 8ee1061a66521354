"""How many clients a server takes, and how many of them from one address."""

from __future__ import annotations

from typing import Final

DEFAULT_CLIENTS: Final = 344
"""Clients of a server at a time; three quarters of them, 258, may be of one address: a machine can have 256."""


def most_of_an_address(places: int) -> int:
    """Return how many of a number of places the clients of one address may have, so that there are some for others."""
    return places - places // 4
