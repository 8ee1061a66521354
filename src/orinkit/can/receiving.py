"""Base classes of the shared CAN buses and of their receivers.

The derived classes are in :mod:`~orinkit.can.shared_bus` and :mod:`~orinkit.can.aio_shared_bus`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, TypeAlias

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame
from orinkit.core.errors import ConnectionLost
from orinkit.transport.link_errors import closed

Accepts: TypeAlias = Callable[[CanFrame], bool]
"""Filter of a receiver: function that returns True if a frame is for the receiver.

The filter must neither block nor raise. On a bus shared by threads, any of the threads may call it.
"""

Trace: TypeAlias = Callable[[str, CanFrame], None]
"""Callback invoked with ``">"`` and each frame that was sent, or ``"<"`` and each frame that was received.

It must neither block nor raise. On a bus shared by threads, any of the threads may call it.
"""

SIZE: Final = 256
"""Maximum number of frames buffered in a receiver, by default."""


class ReceiverBase:
    """Buffers the frames of a shared bus that match a filter.

    Attributes:
        accepts: The filter.
        frames: The buffered frames.
        dropped: Number of frames dropped from the full buffer.
        closed: True if the receiver was closed.
    """

    def __init__(self, accepts: Accepts, size: int) -> None:
        self.accepts = accepts
        self.frames: deque[CanFrame] = deque(maxlen=size)
        self.dropped = 0
        self.closed = False

    def put(self, frame: CanFrame) -> None:
        """Buffer a frame."""
        self.dropped += len(self.frames) == self.frames.maxlen
        self.frames.append(frame)


class SharedBusBase:
    """The state of a shared bus.

    Args:
        bus: The bus, which is closed with the shared bus. Nothing else may receive from it afterwards.

    Attributes:
        trace: Callback invoked with every frame; ``None`` if there is none.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._closed = False
        self._broken: str | None = None  # reason for the loss
        self.trace: Trace | None = None

    def __str__(self) -> str:
        return str(self._bus)

    @property
    def broken(self) -> bool:
        """True if the bus was lost. Until ``reopen``, all pending and new calls raise ConnectionLost."""
        return self._broken is not None

    @property
    def closed(self) -> bool:
        """True if the shared bus was closed."""
        return self._closed

    def _send_frame(self, frame: CanFrame, seconds: float) -> None:
        self._bus.send(frame, seconds)
        if self.trace is not None:
            self.trace(">", frame)

    def _check_open(self) -> None:
        if self._closed:
            raise closed()

    def _check_usable(self, port: ReceiverBase | None) -> None:
        """Raise an exception if the shared bus or the receiver ``port`` is closed, or the bus is lost."""
        if self._closed or (port is not None and port.closed):
            raise closed()
        if self._broken is not None:
            raise ConnectionLost(self._broken)
