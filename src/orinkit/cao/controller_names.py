"""The names of the controllers of all clients of one server (provider guide 5.2.1)."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Final

_SEPARATE: Final = ("udp", "serial", "http")


class ControllerNames:
    """The names of the controllers that clients hold; case is ignored.

    Several clients hold the same name only if they have requested it with ``@IfNotMember``.
    """

    def __init__(self) -> None:
        self._holders: dict[str, set[Hashable]] = {}

    def is_taken(self, name: str) -> bool:
        """Return True if a client holds a controller of this name."""
        return name.lower() in self._holders

    def hold(self, name: str, holder: Hashable) -> None:
        """Record that a controller has this name."""
        self._holders.setdefault(name.lower(), set()).add(holder)

    def free(self, name: str, holder: Hashable) -> None:
        """Record that a controller does not use this name any more."""
        holders = self._holders.get(name.lower())
        if holders is not None:
            holders.discard(holder)
            if not holders:
                del self._holders[name.lower()]


def starts_anew(transport: str) -> bool:
    """Return True if Service_Start may be sent by a client that has lost its session.

    On these transports, no connection shows that the program has started again.
    """
    return transport in _SEPARATE
