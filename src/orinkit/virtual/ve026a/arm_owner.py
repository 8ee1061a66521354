"""Who moves the arm of a virtual VE026A: one client."""

from __future__ import annotations

from orinkit.virtual.engine.elastic_time import DrainInput


class Operator:
    """A client.

    Args:
        drain_input: of its connection, see :class:`~orinkit.cao.provider.ClientInfo`.

    Attributes:
        drain_input: as given.
        robots: how many Robot objects it has; without one it has gone.
    """

    def __init__(self, drain_input: DrainInput | None) -> None:
        self.drain_input = drain_input
        self.robots = 0
