"""The bus of a CAN server: it never raises anything, and comes back when it was lost."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable
from time import monotonic
from typing import TYPE_CHECKING, Final

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame
from orinkit.core.errors import ConnectionLost, TransportError
from orinkit.transport.address import CanAddress

if TYPE_CHECKING:
    import can

_log = logging.getLogger("orinkit.server")
_SEND: Final = 0.02  # s that a frame may wait to be taken
_FIRST_DELAY: Final = 0.5  # s before a bus that was lost is opened again
_LONGEST_DELAY: Final = 5.0
_PROVEN: Final = 1.0  # s without an error after which a bus is back, though nothing was received
_QUIET: Final = 1.0  # s between two frames that are none and are logged
_JOIN: Final = 5.0


class ReconnectingBus:
    """A bus that is opened again when it is lost. All of it is called from one thread, but :meth:`close`.

    Args:
        at: where the bus is, or one that is open and belongs to somebody else.
        ending: is set when the server is to end.

    Raises:
        InvalidAddress, ConnectFailed, MissingExtra: as :func:`orinkit.can.bus.open_bus`.
    """

    def __init__(self, at: CanAddress | can.BusABC, ending: threading.Event) -> None:
        self._ending = ending
        given: Bus | None = Bus.open(at) if isinstance(at, CanAddress) else Bus(at, own=False)
        self.url = str(at) if isinstance(at, CanAddress) else _url(at)
        self._bus = given
        self._last = given
        self._lock = threading.Lock()  # of what follows
        self._opened: Bus | None = None
        self._closed = False
        self._opener: threading.Thread | None = None
        self._delay = _FIRST_DELAY
        self._back_at: float | None = None  # since when a bus that was lost is open again
        self._is_lost = False  # and that was logged
        self._is_refused = False
        self._quiet_until = 0.0

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` when the seconds have passed; without a bus they pass as well."""
        bus = self._bus or self._fresh()
        if bus is None:
            self._ending.wait(seconds)
            return None
        try:
            frame = bus.receive(seconds)
        except Exception as error:  # noqa: BLE001 - what an interface raises is its own affair
            self._lose(error)
            return None
        self._works(frame is not None)
        return frame

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Send frames, in order; when one is not taken, it and those behind it are dropped."""
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
                    _log.warning("frames are dropped until they are taken again: %s", error)
                self._is_refused = True
                return
            except Exception as error:  # noqa: BLE001 - a bus raises nothing else; what is sent is a device's
                self._complain(frame, error)
                continue
            self._is_refused = False

    def _complain(self, frame: object, error: Exception) -> None:
        """Log what cannot be sent, once a second at most."""
        if monotonic() >= self._quiet_until:
            _log.error("%s: a device wants to send %.80r, which is no frame: %s", self.url, frame, error)
            self._quiet_until = monotonic() + _QUIET

    def close(self) -> None:
        """Close the bus, unless it belongs to somebody else."""
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

    # --- lost and found -----------------------------------------------------------------------------------------------

    def _lose(self, error: Exception) -> None:
        """Give up a bus, and have it opened again."""
        if not self._is_lost:
            _log.warning("the CAN bus is lost; it will be tried again and again: %s", error)
        else:
            self._delay = min(2 * self._delay, _LONGEST_DELAY)
        self._is_lost, self._back_at = True, None
        self._bus = None
        self._opener = threading.Thread(target=self._open_again, name="orinkit-can-opener", daemon=True)
        self._opener.start()

    def _open_again(self) -> None:
        """Wait and open the bus, until it can be; in a thread of its own, as opening may take long."""
        last = self._last
        assert last is not None
        last.close()
        while not self._ending.wait(self._delay):
            try:
                # what belongs to somebody else may work again by itself
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

    def _fresh(self) -> Bus | None:
        """Return the bus that has been opened again, once."""
        with self._lock:
            bus, self._opened = self._opened, None
        if bus is not None:
            self._bus = self._last = bus
            self._back_at = monotonic()
        return bus

    def _works(self, received: bool) -> None:
        """Note that there was no error."""
        if self._back_at is not None and (received or monotonic() - self._back_at >= _PROVEN):
            _log.info("the CAN bus %s is back", self.url)
            self._is_lost, self._back_at, self._delay = False, None, _FIRST_DELAY


def _url(bus: can.BusABC) -> str:
    """Return a name for a bus that was opened elsewhere, in the manner of a URL."""
    from can.interfaces import BACKENDS

    kind = (type(bus).__module__, type(bus).__name__)
    interface = next((name for name, place in BACKENDS.items() if tuple(place) == kind), type(bus).__name__)
    own = vars(bus)
    channel = next((own[name] for name in ("channel", "channel_id") if isinstance(own.get(name), str | int)), "")
    return str(CanAddress(interface, str(channel)))
