"""The protocol of devices that can be served on a CAN bus."""

from __future__ import annotations

from typing import Protocol

from orinkit.can.frame import CanFrame


class DeviceClock(Protocol):
    """The clock of a device; the clocks of :mod:`orinkit.virtual.clock` have this interface."""

    scale: float
    """Seconds of the clock per real second."""

    def now(self) -> float:
        """Return the time of the clock, in s."""


class CanDevice(Protocol):
    """A device for :func:`serve_can`, independent of the bus. All methods except ``close`` run in one thread."""

    @property
    def address(self) -> int:
        """Address on the bus, 0 to 255; unique among the devices of a server."""

    @property
    def clock(self) -> DeviceClock:
        """The clock to which the times of :meth:`due` refer."""

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Process a frame for any destination, and return the frames to be sent now."""

    def advance(self) -> list[CanFrame]:
        """Perform the actions that are due according to the clock, and return the frames to be sent."""

    def due(self) -> float | None:
        """Return the next time to call :meth:`advance`, in s of the clock; ``None`` to wait for the next frame."""

    def close(self) -> None:
        """Release the resources of the device; it is not used afterwards."""
