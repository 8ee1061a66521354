"""The owner of the arm of a virtual VE026A: one client."""

from __future__ import annotations

from orinkit.virtual.engine.elastic_time import DrainInput


class Operator:
    """A client that can move the arm.

    Args:
        drain_input: Drains the input of its connection, see :class:`~orinkit.cao.provider.ClientInfo`.

    Attributes:
        drain_input: Drains the input of its connection.
        robots: Number of its Robot objects; when it drops to 0, the client counts as disconnected.
    """

    def __init__(self, drain_input: DrainInput | None) -> None:
        self.drain_input = drain_input
        self.robots = 0
