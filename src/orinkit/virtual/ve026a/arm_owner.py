"""Who moves the arm of a virtual VE026A: one client."""

from __future__ import annotations

from orinkit.virtual.engine.elastic_time import Look


class Operator:
    """A client.

    Args:
        look: of its connection, see :class:`~orinkit.cao.provider.ClientInfo`.

    Attributes:
        look: as given.
        robots: how many Robot objects it has; without one it has gone.
    """

    def __init__(self, look: Look | None) -> None:
        self.look = look
        self.robots = 0
