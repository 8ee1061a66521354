"""The owner of the arm of a virtual VE026A: one client."""

from __future__ import annotations

from orinkit.virtual.engine.elastic_time import WhenInputProcessed


class Operator:
    """A client that can move the arm.

    Args:
        when_input_processed: Invokes a callback after the input of the client has been processed, see
            :class:`~orinkit.cao.provider.ClientInfo`.

    Attributes:
        when_input_processed: The argument of the same name.
        robots: Number of its Robot objects; when it drops to 0, the client counts as disconnected.
    """

    def __init__(self, when_input_processed: WhenInputProcessed | None) -> None:
        self.when_input_processed = when_input_processed
        self.robots = 0
