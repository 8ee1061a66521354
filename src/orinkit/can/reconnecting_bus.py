"""The bus of a CAN server: it raises no exceptions, and is reopened after a loss."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable
from time import monotonic
from typing import TYPE_CHECKING, Final

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame
from orinkit.can.invalid_frames import InvalidFrameLog
from orinkit.core.errors import ConnectionLost, TransportError
from orinkit.transport.address import CanAddress

if TYPE_CHECKING:
    import can

_log = logging.getLogger("orinkit.server")
_SEND: Final = 0.02  # s to wait until the interface accepts a frame
_FIRST_DELAY: Final = 0.5  # s before a lost bus is reopened
_LONGEST_DELAY: Final = 5.0
_PROVEN: Final = 1.0  # s without an error after which a bus counts as restored, even if nothing is received
_JOIN: Final = 5.0


class ReconnectingBus:
    """A bus that is reopened after a loss. All methods except :meth:`close` are called from one thread.

    Args:
        at: Address of the bus, or an open python-can bus, which :meth:`close` does not close.
        ending: Event that is set when the server ends.

    Raises:
        InvalidAddress, ConnectFailed, MissingExtra: As for :func:`orinkit.can.bus.open_bus`.
    """

    def __init__(self, at: CanAddress | can.BusABC, ending: threading.Event) -> None:
        self._ending = ending
        bus: Bus | None = Bus.open(at) if isinstance(at, CanAddress) else Bus(at, own=False)
        self.url = str(at) if isinstance(at, CanAddress) else _url(at)
        self._bus = bus
        self._last = bus
        self._lock = threading.Lock()  # protects the following attributes
        self._opened: Bus | None = None
        self._closed = False
        self._opener: threading.Thread | None = None
        self._delay = _FIRST_DELAY
        self._back_at: float | None = None  # time at which a lost bus was reopened
        self._is_lost = False  # the loss has been logged
        self._is_refused = False
        self._invalid = InvalidFrameLog()

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` after a time-out. While the bus is lost, wait for the time-out."""
        bus = self._bus or self._take_reopened()
        if bus is None:
            self._ending.wait(seconds)
            return None
        try:
            frame = bus.receive(seconds)
        except Exception as error:  # noqa: BLE001 - interfaces may raise anything
            self._lose(error)
            return None
        self._record_success(frame is not None)
        return frame

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Send frames, in order; if a frame is not accepted, this frame and the following ones are dropped."""
        for frame in frames:
            bus = self._bus
            if bus is None:
                return
            try:
                bus.send(frame, _SEND)
            except ConnectionLost as error:
                self._lose(error)
                return
            except TransportError as error:
                if not self._is_refused:
                    _log.warning("dropping frames until the interface accepts them again: %s", error)
                self._is_refused = True
                return
            except Exception as error:  # noqa: BLE001 - caused by an invalid frame of a device
                self._invalid.add(self.url, frame, error)
                continue
            self._is_refused = False

    def close(self) -> None:
        """Close the bus, unless an open python-can bus was passed to the constructor."""
        self._ending.set()
        opener = self._opener
        if opener is not None:
            opener.join(_JOIN)
        with self._lock:
            self._closed = True
            buses = (self._bus, self._opened)
            self._bus = self._opened = None
        for bus in buses:
            if bus is not None:
                bus.close()

    # --- loss and reopening -------------------------------------------------------------------------------------------

    def _lose(self, error: Exception) -> None:
        """Drop a lost bus, and start to reopen it."""
        if not self._is_lost:
            _log.warning("the CAN bus is lost; reopening it: %s", error)
        else:
            self._delay = min(2 * self._delay, _LONGEST_DELAY)
        self._is_lost, self._back_at = True, None
        self._bus = None
        self._opener = threading.Thread(target=self._open_again, name="orinkit-can-opener", daemon=True)
        self._opener.start()

    def _open_again(self) -> None:
        """Try to open the bus until this succeeds or the server ends; run in a thread, because opening may block."""
        last = self._last
        assert last is not None
        last.close()
        while not self._ending.wait(self._delay):
            try:
                # a bus that was passed in open may recover by itself
                bus = last if last.address is None else Bus.open(last.address)
            except Exception as error:  # noqa: BLE001 - the next try may succeed
                _log.debug("the CAN bus cannot be opened: %s", error)
                self._delay = min(2 * self._delay, _LONGEST_DELAY)
                continue
            with self._lock:
                if not self._closed:
                    self._opened = bus
                    return
            bus.close()

    def _take_reopened(self) -> Bus | None:
        """Return the reopened bus if it was not returned before, otherwise ``None``."""
        with self._lock:
            bus, self._opened = self._opened, None
        if bus is not None:
            self._bus = self._last = bus
            self._back_at = monotonic()
        return bus

    def _record_success(self, received: bool) -> None:
        """Record a call of the bus without an error. If the bus was lost, log that it works again."""
        if self._back_at is not None and (received or monotonic() - self._back_at >= _PROVEN):
            _log.info("the CAN bus %s is back", self.url)
            self._is_lost, self._back_at, self._delay = False, None, _FIRST_DELAY


def _url(bus: can.BusABC) -> str:
    """Return a name in the form of a URL for a python-can bus that the caller has opened."""
    from can.interfaces import BACKENDS

    kind = (type(bus).__module__, type(bus).__name__)
    interface = next((name for name, place in BACKENDS.items() if tuple(place) == kind), type(bus).__name__)
    own = vars(bus)
    channel = next((own[name] for name in ("channel", "channel_id") if isinstance(own.get(name), str | int)), "")
    return str(CanAddress(interface, str(channel)))
