"""CAN buses of python-can: open, send, receive, and convert errors to exceptions of orinkit.

Shared buses are in :mod:`orinkit.can.shared_bus` and :mod:`orinkit.can.aio_shared_bus`.
"""

from __future__ import annotations

import errno
import math
import os
import select
import struct
from collections.abc import Callable
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final, Self

from orinkit.can.frame import MAX_DATA, MAX_ID, CanFrame, checked
from orinkit.can.interfaces import opened
from orinkit.core.errors import ConnectionLost, InvalidValue, TransportError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress
from orinkit.transport.link_errors import lost

if TYPE_CHECKING:
    import can

_SOCKETS: Final = ("can.interfaces.socketcan.socketcan", "can.interfaces.udp_multicast.bus")
_PORTS: Final = ("can.interfaces.slcan", "can.interfaces.serial.serial_can")
_VIRTUAL: Final = "can.interfaces.virtual"
_READS_ON: Final = ("can.interfaces.serial.serial_can",)
_EMPTY_BURST: Final = 100  # after this number of receptions without a frame, each is followed by a pause
_EMPTY_PAUSE: Final = 1e-3  # s, duration of this pause
_MIN_LIMIT: Final = 1 / 64  # s, shortest time-out for sending
_MAX_EMPTY: Final = 5_000  # maximum number of receptions without a frame if the time-out is 0
_MAX_FILTERED: Final = 64  # maximum number of consecutive frames that python-can filters out if the time-out is 0
_LONGEST_LINE: Final = 4096  # bytes, longest line of slcan; python-can has no limit
_FULL_ERRORS: Final = (errno.ENOBUFS, errno.EAGAIN)
_LATE_WRITE: Final = "SerialTimeoutException"  # of pyserial


def open_bus(address: CanAddress) -> can.BusABC:
    """Open a bus from its address alone; configuration files and environment variables of python-can are not read.

    For udp_multicast, the default channel is the IPv4 group 239.74.163.2. For slcan, python-can waits 2 s after it has
    opened the port: opening the port resets many adapters (Arduino), and an adapter loses frames during the reset. For
    an adapter without this reset, ``?sleep_after_open=0`` removes the wait. For a pseudo-terminal, there is no wait,
    because there is no adapter.

    Raises:
        InvalidAddress: If python-can does not have the interface, or rejects the channel or an option.
        ConnectFailed: If the bus cannot be opened.
        MissingExtra: If python-can, or a package that the interface requires, is missing.
    """
    return opened(address)


def to_message(frame: CanFrame) -> can.Message:
    """Convert a frame to a message of python-can.

    Raises:
        InvalidValue: If the identifier has more than 29 bits, or the frame has more than 8 bytes.
    """
    import can

    checked(frame)
    return can.Message(arbitration_id=frame.id, is_extended_id=True, data=frame.data, is_rx=False)


def to_frame(message: can.Message) -> CanFrame | None:
    """Convert a message of python-can to a frame; return ``None`` for a message that ABH3 drivers do not use.

    Not used are messages with standard identifiers, remote, error and FD frames, messages of more than 8 bytes, and
    truncated messages.
    """
    if not message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd:
        return None
    number, data = message.arbitration_id, bytes(message.data)
    # udp_multicast accepts any msgpack data as a message, so the identifier may be a value such as 1.5
    if type(number) is not int or not 0 <= number <= MAX_ID or not MAX_DATA >= len(data) == message.dlc:
        return None
    return CanFrame(number, data, message.timestamp)


class Bus:
    """A CAN bus that sends and receives frames, and raises exceptions of orinkit.

    One thread at a time may receive and one may send; these may be different threads. Any thread may close the bus.

    Args:
        bus: A python-can bus. Nothing else may receive from it (no Notifier); its filters are kept.
        own: True to close the python-can bus with this one; False if the python-can bus belongs to the caller.
        address: Address by which the bus was opened; ``None`` if there is none, so that the bus cannot be reopened.
    """

    def __init__(self, bus: can.BusABC, *, own: bool = True, address: CanAddress | None = None) -> None:
        self._own = own
        self.address = address
        self._use(bus)

    @classmethod
    def open(cls, address: CanAddress) -> Self:
        """Open a bus by :func:`open_bus`; block until it is open."""
        return cls(open_bus(address), address=address)

    def _use(self, bus: can.BusABC) -> None:
        from can import Message  # already imported by the creator of the bus

        self._bus = bus
        self._message = Message
        self._requested, self._limit = -1.0, 1.0  # s for sending: last requested time-out, and the one in use
        modules = {kind.__module__ for kind in type(bus).__mro__}
        self._descriptor = self.fileno()
        watched = self._descriptor >= 0 and (os.name != "nt" or not modules.isdisjoint(_SOCKETS))
        queue = vars(bus).get("queue") if _VIRTUAL in modules else None
        # if these interfaces have a descriptor, they buffer no frames in memory, so the descriptor reports all of them
        self.tells = queue is not None or (watched and not modules.isdisjoint((*_SOCKETS, *_PORTS)))
        """True if :meth:`waiting` is reliable."""
        self.holds = False
        """True if :meth:`receive` in another thread may have taken a frame that it has not returned yet.

        It is set only for interfaces on which this can be detected.
        """
        self._nothing: Callable[[], bool] = self._unreadable if queue is None else queue.empty
        # the descriptor is awaited, because recv() of slcan polls 1000 times per second, and serial has no time-out
        waits = watched and not modules.isdisjoint(_PORTS)
        self._get: Callable[[float], can.Message | None] = self._when_readable if waits else bus.recv
        if queue is not None:
            self._arrived, self._get = queue, self._when_queued
        line = vars(bus).get("_buffer")  # slcan: the received part of a line
        self._line = line if isinstance(line, bytearray) else bytearray()
        # the interface serial has no time-out for sending, so the time-out of its port is set
        self._port: Any = None if modules.isdisjoint(_READS_ON) else vars(bus).get("_ser")
        self.watchable = watched and modules.isdisjoint(_READS_ON)
        """True if an event loop can watch :meth:`fileno` and then :meth:`receive` pending frames without blocking."""

    def __str__(self) -> str:
        return str(self.address or self._bus.channel_info)

    # --- sending ------------------------------------------------------------------------------------------------------

    def send(self, frame: CanFrame, seconds: float) -> None:
        """Pass a frame to the interface.

        Args:
            frame: The frame.
            seconds: Time to wait until the interface accepts the frame, s. It is increased to the next power of two,
                and limited to the range from 31 ms to 1 s.

        Raises:
            InvalidValue: If the frame is not valid.
            TransportError: If the frame was not accepted in time, for example because no node acknowledges frames. The
                bus stays usable.
            ConnectionLost: If the bus is lost.
        """
        checked(frame)
        message = self._message(arbitration_id=frame.id, data=frame.data, is_rx=False)
        try:
            if seconds != self._requested:
                self._set_limit(seconds)
            self._bus.send(message, self._limit)
        except Exception as error:
            if _is_interrupted(error):
                return
            if not _is_full(error):
                raise self._lost(error) from error
            if not self._is_taken(error):
                raise self._not_taken(error) from error

    def _set_limit(self, seconds: float) -> None:
        # rounded to a power of two, because slcan reconfigures its port whenever the time-out changes
        self._limit = math.ldexp(1.0, min(math.frexp(max(seconds, _MIN_LIMIT))[1], 0))
        if self._port is not None:
            self._port.write_timeout = self._limit
        self._requested = seconds

    def _is_taken(self, error: BaseException) -> bool:
        """Return True if a port accepted the frame despite a time-out: pyserial checks the time after writing.

        If the port can accept more bytes, its buffer was not full. The time-out then occurred because this program was
        suspended.
        """
        late = type(error.__cause__).__name__ == _LATE_WRITE
        return late and self._descriptor >= 0 and os.name != "nt" and _takes_more(self._descriptor)

    def _not_taken(self, reason: object) -> TransportError:
        return TransportError(
            tr(
                "{bus}: the frame could not be sent ({reason}). Try: check that another node acknowledges frames "
                "(driver on, bit rate, wiring, termination)",
                bus=self,
                reason=reason,
            )
        )

    def _lost(self, error: BaseException) -> ConnectionLost:
        reason = str(error) or type(error).__name__
        if error.__cause__ is not None:
            reason += f" ({error.__cause__})"
        return lost(f"{self}: {reason}")

    # --- receiving ----------------------------------------------------------------------------------------------------

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` after a time-out.

        With 0 seconds, ``None`` means that no frame is pending; this is certain only if the attribute ``tells`` is
        True. Messages that :func:`to_frame` does not convert, and bytes that are not a message, are skipped.

        Raises:
            ConnectionLost: If the bus is lost.
        """
        if seconds <= 0 and self.tells and self._nothing():
            return None
        end = monotonic() + seconds
        left, empty, rounds = seconds, 0, 0
        while True:
            try:
                message = self._get(left)
                arrived = message is not None
                frame = None if message is None else to_frame(message)
            except Exception as error:
                if not self._is_noise(error):
                    raise self._lost(error) from error
                message, frame, arrived = None, None, True
            if frame is not None:
                return frame
            if message is None:
                empty += 1
            rounds += 1
            left = end - monotonic()
            if left <= 0:
                left = 0.0
                if seconds > 0 or rounds > _MAX_EMPTY or not (arrived or self._more(empty)):
                    return None
            if empty > _EMPTY_BURST:  # only noise arrives, or the interface returns before its time-out
                sleep(min(left, _EMPTY_PAUSE))

    def waiting(self) -> bool:
        """Return True if a frame is pending; ``False`` if the bus does not report this."""
        return self.tells and not self._nothing()

    def _unreadable(self) -> bool:
        return not self._ready(0)

    def _more(self, empty: int) -> bool:
        """Return True if a frame may be pending although none was returned.

        With a filter or with slcan, one call of python-can's ``recv`` may remove a message without returning a frame.
        """
        if self.tells:
            return not self._nothing()
        return self._bus.filters is not None and empty < _MAX_FILTERED

    def _when_readable(self, seconds: float) -> can.Message | None:
        self.holds = False
        if not self._ready(seconds):
            return None
        self.holds = True  # until the next call
        message = self._bus.recv(0)
        if len(self._line) > _LONGEST_LINE:
            self._line.clear()
        return message

    def _when_queued(self, seconds: float) -> can.Message | None:
        self.holds = False
        with self._arrived.not_empty:
            self._arrived.not_empty.wait_for(lambda: self._arrived.queue, max(0.0, seconds))
        self.holds = True
        return self._bus.recv(0)

    def _ready(self, seconds: float) -> bool:
        if os.name == "nt":  # Windows has no poll(), and select() supports sockets only
            try:
                chosen = select.select([self._descriptor], [], [], seconds)
            except (OSError, ValueError):  # closed: the following reception raises an exception
                return True
            return bool(chosen[0])
        poll = select.poll()  # a new object each time, because two threads cannot share one
        poll.register(self._descriptor, select.POLLIN)
        return bool(poll.poll(max(0.0, seconds) * 1e3))

    def _is_noise(self, error: Exception) -> bool:
        """Return True if the received bytes, not the bus, caused an error."""
        import can

        if isinstance(error, OSError):  # a time-out, or the pending data is gone
            return isinstance(error, BlockingIOError | TimeoutError) and error.errno in (None, errno.EAGAIN)
        if isinstance(error, can.CanError):
            text = str(error)
            noise = "could not unpack" in text or "invalid delimiter" in text
            if isinstance(error.__cause__, UnicodeDecodeError):  # slcan keeps the line, and would fail on it again
                self._line.clear()
                noise = True
        else:
            noise = isinstance(error, ValueError | LookupError | TypeError | struct.error)
        return noise and self._is_open()

    def _is_open(self) -> bool:
        """Return True if the bus is open, or if this is unknown because it has no descriptor.

        Invalid bytes and a closed bus may both raise ValueError; this method distinguishes them.
        """
        return self._descriptor < 0 or self.fileno() >= 0

    # --- the bus itself -----------------------------------------------------------------------------------------------

    def fileno(self) -> int:
        """Return the descriptor of the bus, -1 if it has none or is closed."""
        try:
            return self._bus.fileno()
        except Exception:  # noqa: BLE001 - depends on the interface
            return -1

    def check_reopening(self) -> CanAddress:
        """Return the address for reopening the bus.

        Raises:
            InvalidValue: If the bus was not opened by an address.
        """
        if self.address is None:
            raise InvalidValue(
                tr(
                    "a bus can be reopened only if it was opened by an address. Try: open the bus with its "
                    "address (can://...)"
                )
            )
        return self.address

    def reopen(self) -> None:
        """Close the bus and reopen it; block until it is open.

        Raises:
            InvalidValue: If the bus was not opened by an address.
            InvalidAddress, ConnectFailed, MissingExtra: As for :func:`open_bus`; the bus is then closed.
        """
        address = self.check_reopening()
        self.close()
        self._use(open_bus(address))

    def close(self) -> None:
        """Close the bus if this object owns it.

        A reception in another thread ends with an error, or after its time-out.
        """
        if self._own:
            shut(self._bus)


def shut(bus: can.BusABC) -> None:
    """Close a python-can bus, which may be broken."""
    try:
        bus.shutdown()
    except Exception:  # noqa: BLE001 - slcan first writes to its port, which may be gone
        port: Any = vars(bus).get("serialPortOrig")
        if port is not None:
            port.close()


def _takes_more(descriptor: int) -> bool:
    """Return True if a descriptor is writable."""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return any(event & select.POLLOUT for _, event in poll.poll(0))


def _is_interrupted(error: BaseException) -> bool:
    """Return True if a port accepted the frame, but the process was suspended before the end of the transmission."""
    return getattr(error.__cause__, "args", ())[:1] == (errno.EINTR,)  # termios.error of tcdrain, wrapped by slcan


def _is_full(error: BaseException) -> bool:
    """Return True if a frame was not accepted because the transmit queue is full."""
    import can

    numbers = {
        getattr(error, "error_code", None),
        getattr(error, "errno", None),
        getattr(error.__cause__, "errno", None),
    }
    return (
        isinstance(error, can.CanTimeoutError)
        or not numbers.isdisjoint(_FULL_ERRORS)
        or "full" in str(error).lower()
        or type(error.__cause__).__name__ == _LATE_WRITE  # wrapped by slcan
        or "one or more recipients" in str(error)  # virtual: the queue of a receiver is full
    )
