"""What runs in the thread of a CAN server: the devices, and what each of them is asked."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from time import monotonic
from typing import TYPE_CHECKING, Final

from orinkit.can.frame import CanFrame
from orinkit.can.reconnecting_bus import ReconnectingBus

if TYPE_CHECKING:
    from orinkit.can.device import CanDevice

_log = logging.getLogger("orinkit.server")
_LONGEST_WAIT: Final = 0.05  # s: a clock may have been moved by hand, and no device has much to make up for
_SHORTEST_WAIT: Final = 0.0005  # s: a device that is always due leaves the others their turns
_SOURCE: Final = 0xFF  # the bits of an identifier that say who sends, as in J1939
_QUIET: Final = 1.0  # s between two exceptions of a device that are logged


def run(devices: Sequence[ServedDevice], wire: ReconnectingBus, ending: threading.Event) -> None:
    """Give frames to devices and send what they want to, until the event is set."""
    while not ending.is_set():
        frame = wire.receive(min((device.pause() for device in devices), default=_LONGEST_WAIT))
        if frame is not None:
            for device in devices:
                wire.send(device.receive(frame))
        for device in devices:
            if device.pause() <= 0:
                wire.send(device.advance())


class ServedDevice:
    """A device whose exceptions are logged, and end nothing."""

    def __init__(self, device: CanDevice) -> None:
        self._device = device
        self._not_before = 0.0  # of advance
        self._not_after = 0.0
        self._quiet_until = 0.0

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Return what the device sends because of a frame."""
        try:
            if frame.id & _SOURCE == self._device.address:
                return []  # its own frame, as some interfaces give back what they send
            return list(self._device.receive(frame))
        except Exception as error:  # noqa: BLE001 - a device of whoever's
            self._complain(f"when it received {frame}", error)
            return []

    def advance(self) -> list[CanFrame]:
        """Return what the device sends because of the time."""
        now = monotonic()
        self._not_before, self._not_after = now + _SHORTEST_WAIT, now + _LONGEST_WAIT
        try:
            return list(self._device.advance())
        except Exception as error:  # noqa: BLE001 - as above
            self._complain("when it did what was due", error)
            self._not_before = monotonic() + _LONGEST_WAIT
            return []

    def pause(self) -> float:
        """Return the real seconds until the device is due; 0 if it is."""
        try:
            due, clock = self._device.due(), self._device.clock
            left = _LONGEST_WAIT if due is None else (due - clock.now()) / clock.scale
        except Exception as error:  # noqa: BLE001 - as above
            self._complain("when it was asked what is due", error)
            left = _LONGEST_WAIT
        now = monotonic()
        return max(min(left, self._not_after - now), self._not_before - now, 0.0)

    def close(self) -> None:
        """Close the device."""
        try:
            self._device.close()
        except Exception as error:  # noqa: BLE001 - as above
            self._complain("when it was closed", error)

    def _complain(self, when: str, error: Exception) -> None:
        """Log an exception, unless there was one a moment ago: a busy bus would bring thousands."""
        if monotonic() >= self._quiet_until:
            _log.error("a device raised an exception %s", when, exc_info=error)
            self._quiet_until = monotonic() + _QUIET
