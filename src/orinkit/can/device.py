"""What can be served on a CAN bus."""

from __future__ import annotations

from typing import Protocol

from orinkit.can.frame import CanFrame


class DeviceClock(Protocol):
    """A clock as those of :mod:`orinkit.virtual.clock`."""

    scale: float
    """Its seconds per real second."""

    def now(self) -> float:
        """Return its seconds."""


class CanDevice(Protocol):
    """What :func:`serve_can` serves: a device that knows no bus. All of it is called from one thread."""

    @property
    def address(self) -> int:
        """Its address on the bus, 0 to 255; no other device of the server has the same."""

    @property
    def clock(self) -> DeviceClock:
        """What :meth:`due` counts by."""

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Take a frame, whoever it is for, and return what is to be sent now."""

    def advance(self) -> list[CanFrame]:
        """Do what is due by the clock, and return what is to be sent."""

    def due(self) -> float | None:
        """Return when :meth:`advance` is wanted next, in seconds of the clock; ``None`` for not until a frame comes."""

    def close(self) -> None:
        """Let go of what it has; it is not used any more."""
