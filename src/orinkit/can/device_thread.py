"""The thread of a CAN server: passes frames and time to the devices."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol

from orinkit.can.frame import CanFrame

if TYPE_CHECKING:
    from orinkit.can.device import CanDevice

_log = logging.getLogger("orinkit.server")
_LONGEST_WAIT: Final = 0.05  # s, longest time between calls of a device; a program may advance its clock meanwhile
_SHORTEST_WAIT: Final = 0.0005  # s, shortest time; a device that is always due must not delay the others
_SOURCE: Final = 0xFF  # mask of the source address, as in J1939
_QUIET: Final = 1.0  # s between two logged exceptions of a device


class ServedBus(Protocol):
    """The bus of a CAN server; its methods raise no exceptions."""

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` after a time-out."""

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Send frames, in order."""


def run(devices: Sequence[IsolatedDevice], bus: ServedBus, ending: threading.Event) -> None:
    """Pass received frames to the devices and send the frames that the devices return, until ``ending`` is set."""
    while not ending.is_set():
        frame = bus.receive(min((device.seconds_until_due() for device in devices), default=_LONGEST_WAIT))
        if frame is not None:
            for device in devices:
                bus.send(device.receive(frame))
        for device in devices:
            if device.seconds_until_due() <= 0:
                bus.send(device.advance())


class IsolatedDevice:
    """Wraps a device so that its exceptions are logged and do not end the server."""

    def __init__(self, device: CanDevice) -> None:
        self._device = device
        self._not_before = 0.0  # earliest time of the next call of advance()
        self._not_after = 0.0  # latest time of this call
        self._quiet_until = 0.0

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Pass a frame to the device and return the frames that it sends."""
        try:
            if frame.id & _SOURCE == self._device.address:
                return []  # the device's own frame: some interfaces also return the frames that they send
            return list(self._device.receive(frame))
        except Exception as error:  # noqa: BLE001 - third-party code
            self._log_error(f"while receiving {frame}", error)
            return []

    def advance(self) -> list[CanFrame]:
        """Make the device perform the actions that are due, and return the frames that it sends."""
        now = monotonic()
        self._not_before, self._not_after = now + _SHORTEST_WAIT, now + _LONGEST_WAIT
        try:
            return list(self._device.advance())
        except Exception as error:  # noqa: BLE001 - as above
            self._log_error("while advancing", error)
            self._not_before = monotonic() + _LONGEST_WAIT
            return []

    def seconds_until_due(self) -> float:
        """Return the real time in s until the device is due; 0 if it is due now."""
        try:
            due, clock = self._device.due(), self._device.clock
            left = _LONGEST_WAIT if due is None else (due - clock.now()) / clock.scale
        except Exception as error:  # noqa: BLE001 - as above
            self._log_error("while returning its due time", error)
            left = _LONGEST_WAIT
        now = monotonic()
        return max(min(left, self._not_after - now), self._not_before - now, 0.0)

    def close(self) -> None:
        """Close the device."""
        try:
            self._device.close()
        except Exception as error:  # noqa: BLE001 - as above
            self._log_error("while closing", error)

    def _log_error(self, when: str, error: Exception) -> None:
        """Log an exception, at most one per second, because a busy bus may cause thousands of exceptions."""
        if monotonic() >= self._quiet_until:
            _log.error("a device raised an exception %s", when, exc_info=error)
            self._quiet_until = monotonic() + _QUIET
