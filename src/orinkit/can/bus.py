"""CAN buses through python-can: opening one, sending, receiving, and what its errors mean.

The shared use of a bus is in :mod:`orinkit.can.shared_bus` and :mod:`orinkit.can.aio_shared_bus`.
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
_BURST: Final = 100  # receptions without a frame, one after the other, after which there is a rest between them
_REST: Final = 1e-3  # s
_LEAST: Final = 1 / 64  # s for a frame to be taken
_MOST: Final = 5_000  # receptions without a frame when nothing is waited for
_FILTERED: Final = (
    64  # frames that a filter of python-can has taken out, one after the other, when nothing is waited for
)
_LONGEST_LINE: Final = 4096  # bytes of a line of slcan; python-can would keep any number
_FULL: Final = (errno.ENOBUFS, errno.EAGAIN)
_LATE_WRITE: Final = "SerialTimeoutException"  # of pyserial


def open_bus(address: CanAddress) -> can.BusABC:
    """Open a bus; configuration files and variables of python-can are not read, the address says it all.

    With udp_multicast the usual channel is the IPv4 group 239.74.163.2. With slcan, python-can waits 2 s after opening
    the port, as many adapters are reset by that (Arduino) and would lose what comes first; an adapter that is not is ready
    at once with ``?sleep_after_open=0``. On a pseudo-terminal there is no adapter to be reset, and no wait.

    Raises:
        InvalidAddress: python-can has no such interface, or cannot use the channel or an option.
        ConnectFailed: the bus cannot be opened.
        MissingExtra: python-can is missing, or a package that the interface needs.
    """
    return opened(address)


def to_message(frame: CanFrame) -> can.Message:
    """Return a frame as python-can has it.

    Raises:
        InvalidValue: it has more than 29 bits of identifier, or more than 8 bytes.
    """
    import can

    checked(frame)
    return can.Message(arbitration_id=frame.id, is_extended_id=True, data=frame.data, is_rx=False)


def to_frame(message: can.Message) -> CanFrame | None:
    """Return a message of python-can, ``None`` for what no ABH3 driver sends or understands.

    That are standard identifiers, remote, error and FD frames, more than 8 bytes, and what is cut off.
    """
    if not message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd:
        return None
    number, data = message.arbitration_id, bytes(message.data)
    # udp_multicast takes any msgpack for a message: an identifier can be 1.5 there
    if type(number) is not int or not 0 <= number <= MAX_ID or not MAX_DATA >= len(data) == message.dlc:
        return None
    return CanFrame(number, data, message.timestamp)


class Bus:
    """A CAN bus: frames in and out, and the errors of orinkit.

    One thread receives at a time and one sends at a time; these may be two. Any thread may close it.

    Args:
        bus: of python-can. Nobody else may receive from it (no Notifier); filters that it has stay.
        own: it is closed with this one; ``False`` for one that belongs to somebody else.
        address: that it was opened by, to be opened again.
    """

    def __init__(self, bus: can.BusABC, *, own: bool = True, address: CanAddress | None = None) -> None:
        self._own = own
        self.address = address
        self._use(bus)

    @classmethod
    def open(cls, address: CanAddress) -> Self:
        """Open a bus, as :func:`open_bus`; blocks as long as that takes."""
        return cls(open_bus(address), address=address)

    def _use(self, bus: can.BusABC) -> None:
        from can import Message  # whoever has a bus has imported it already

        self._bus = bus
        self._message = Message
        self._asked, self._limit = -1.0, 1.0  # s for sending: as it was asked for last, and what is made of that
        modules = {kind.__module__ for kind in type(bus).__mro__}
        self._descriptor = self.fileno()
        watched = self._descriptor >= 0 and (os.name != "nt" or not modules.isdisjoint(_SOCKETS))
        queue = vars(bus).get("queue") if _VIRTUAL in modules else None
        # python-can keeps nothing in memory where these have a descriptor
        self.tells = queue is not None or (watched and not modules.isdisjoint((*_SOCKETS, *_PORTS)))
        """Whether :meth:`waiting` is true whenever something has arrived."""
        self.holds = False
        """Whether :meth:`receive`, in another thread, may have taken something that it has not returned yet, where that is known."""
        self._nothing: Callable[[], bool] = self._unreadable if queue is None else queue.empty
        # slcan looks for bytes a thousand times a second, serial knows no time-out: the system waits better
        waits = watched and not modules.isdisjoint(_PORTS)
        self._get: Callable[[float], can.Message | None] = self._when_readable if waits else bus.recv
        if queue is not None:
            self._arrived, self._get = queue, self._when_queued
        line = vars(bus).get("_buffer")  # of slcan: what has come of a line
        self._line = line if isinstance(line, bytearray) else bytearray()
        # of serial, which knows no time-out when it sends
        self._port: Any = None if modules.isdisjoint(_READS_ON) else vars(bus).get("_ser")
        self.watchable = watched and modules.isdisjoint(_READS_ON)
        """Whether an event loop can watch :meth:`fileno` and then :meth:`receive` what waits without blocking."""

    def __str__(self) -> str:
        return str(self.address or self._bus.channel_info)

    # --- sending ------------------------------------------------------------------------------------------------------

    def send(self, frame: CanFrame, seconds: float) -> None:
        """Hand a frame over to the interface.

        Args:
            frame: to send.
            seconds: that it may wait until it is taken; at most twice that, between 31 ms and 1 s.

        Raises:
            InvalidValue: it cannot be a frame.
            TransportError: it was not taken in time; the bus goes on, there may be nobody to acknowledge.
            ConnectionLost: the bus is gone.
        """
        checked(frame)
        message = self._message(arbitration_id=frame.id, data=frame.data, is_rx=False)
        try:
            if seconds != self._asked:
                self._set_limit(seconds)
            self._bus.send(message, self._limit)
        except Exception as error:
            if _is_interrupted(error):
                return
            if not _is_full(error):
                raise self._gone(error) from error
            if not self._is_taken(error):
                raise self._not_taken(error) from error

    def _set_limit(self, seconds: float) -> None:
        # powers of two: slcan sets up its port anew whenever the time-out is another one
        self._limit = math.ldexp(1.0, min(math.frexp(max(seconds, _LEAST))[1], 0))
        if self._port is not None:
            self._port.write_timeout = self._limit
        self._asked = seconds

    def _is_taken(self, error: BaseException) -> bool:
        """Whether a port has taken a frame all the same: pyserial looks at the time after it has written.

        The time was not spent waiting for the port if it takes more: this program was held up.
        """
        late = type(error.__cause__).__name__ == _LATE_WRITE
        return late and self._descriptor >= 0 and os.name != "nt" and _takes_more(self._descriptor)

    def _not_taken(self, reason: object) -> TransportError:
        return TransportError(
            tr(
                "{bus}: the frame could not be sent ({reason}). Try: is anybody there to acknowledge it "
                "(driver on, bit rate, wiring, termination)?",
                bus=self,
                reason=reason,
            )
        )

    def _gone(self, error: BaseException) -> ConnectionLost:
        reason = str(error) or type(error).__name__
        if error.__cause__ is not None:
            reason += f" ({error.__cause__})"
        return lost(f"{self}: {reason}")

    # --- receiving ----------------------------------------------------------------------------------------------------

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame, ``None`` when the seconds have passed.

        With 0 seconds ``None`` means that nothing is waiting, as far as can be told. Messages that are no
        :class:`CanFrame` and bytes that are no message are passed over.

        Raises:
            ConnectionLost: the bus is gone.
        """
        if seconds <= 0 and self.tells and self._nothing():
            return None
        end = monotonic() + seconds
        left, fruitless, passed = seconds, 0, 0
        while True:
            try:
                message = self._get(left)
                came = message is not None
                frame = None if message is None else to_frame(message)
            except Exception as error:
                if not self._is_noise(error):
                    raise self._gone(error) from error
                message, frame, came = None, None, True
            if frame is not None:
                return frame
            if message is None:
                fruitless += 1
            passed += 1
            left = end - monotonic()
            if left <= 0:
                left = 0.0
                if seconds > 0 or passed > _MOST or not (came or self._more(fruitless)):
                    return None
            if fruitless > _BURST:  # nothing but noise, or a bus that does not wait
                sleep(min(left, _REST))

    def waiting(self) -> bool:
        """Whether something has arrived that nobody has received; ``False`` where a bus does not tell."""
        return self.tells and not self._nothing()

    def _unreadable(self) -> bool:
        return not self._ready(0)

    def _more(self, fruitless: int) -> bool:
        """Whether something may be waiting although nothing came: a filter, or slcan, takes one message a time."""
        if self.tells:
            return not self._nothing()
        return self._bus.filters is not None and fruitless < _FILTERED

    def _when_readable(self, seconds: float) -> can.Message | None:
        self.holds = False
        if not self._ready(seconds):
            return None
        self.holds = True  # until it is asked for the next one
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
        if os.name == "nt":  # sockets only, and no poll
            try:
                chosen = select.select([self._descriptor], [], [], seconds)
            except (OSError, ValueError):  # it was closed: who receives is told
                return True
            return bool(chosen[0])
        poll = select.poll()  # a new one each time: two threads cannot use one at the same time
        poll.register(self._descriptor, select.POLLIN)
        return bool(poll.poll(max(0.0, seconds) * 1e3))

    def _is_noise(self, error: Exception) -> bool:
        """Whether an error of receiving is about what came, and not about the bus."""
        import can

        if isinstance(error, OSError):  # a time-out, or what was there has gone when it was looked at
            return isinstance(error, BlockingIOError | TimeoutError) and error.errno in (None, errno.EAGAIN)
        if isinstance(error, can.CanError):
            text = str(error)
            noise = "could not unpack" in text or "invalid delimiter" in text
            if isinstance(
                error.__cause__, UnicodeDecodeError
            ):  # slcan keeps the line, and would stumble over it for ever
                self._line.clear()
                noise = True
        else:
            noise = isinstance(error, ValueError | LookupError | TypeError | struct.error)
        return noise and self._is_open()

    def _is_open(self) -> bool:
        """Whether the bus is open; one that somebody has closed raises ValueError as well."""
        return self._descriptor < 0 or self.fileno() >= 0

    # --- the bus itself -----------------------------------------------------------------------------------------------

    def fileno(self) -> int:
        """Descriptor of the bus, -1 where it has none, or none that is open."""
        try:
            return self._bus.fileno()
        except Exception:  # noqa: BLE001 - interfaces have none in many ways
            return -1

    def check_reopening(self) -> CanAddress:
        """Return the address that the bus can be opened by again.

        Raises:
            InvalidValue: it was not opened by one.
        """
        if self.address is None:
            raise InvalidValue(
                tr("a bus that was opened elsewhere has to be opened again there. Try: give its address (can://...)")
            )
        return self.address

    def reopen(self) -> None:
        """Close the bus and open it again; blocks as long as that takes, as :func:`open_bus`.

        Raises:
            InvalidValue: it was not opened by an address.
            InvalidAddress, ConnectFailed, MissingExtra: as :func:`open_bus`; it is closed then.
        """
        address = self.check_reopening()
        self.close()
        self._use(open_bus(address))

    def close(self) -> None:
        """Close the bus if it is one's own; a receive in another thread ends in an error, or when its time is up."""
        if self._own:
            shut(self._bus)


def shut(bus: can.BusABC) -> None:
    """Close a bus of python-can, which may be broken."""
    try:
        bus.shutdown()
    except Exception:  # noqa: BLE001 - slcan says goodbye to its adapter before it closes the port, which may be gone
        port: Any = vars(bus).get("serialPortOrig")
        if port is not None:
            port.close()


def _takes_more(descriptor: int) -> bool:
    """Whether something can be written at once."""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return any(event & select.POLLOUT for _, event in poll.poll(0))


def _is_interrupted(error: BaseException) -> bool:
    """Whether a port has taken a frame, and the wait until it was sent ended early: this program was stopped and continued."""
    return getattr(error.__cause__, "args", ())[:1] == (errno.EINTR,)  # termios.error, of tcdrain; slcan wraps it


def _is_full(error: BaseException) -> bool:
    """Whether a frame was not taken because others wait to be sent."""
    import can

    numbers = {
        getattr(error, "error_code", None),
        getattr(error, "errno", None),
        getattr(error.__cause__, "errno", None),
    }
    return (
        isinstance(error, can.CanTimeoutError)
        or not numbers.isdisjoint(_FULL)
        or "full" in str(error).lower()
        or type(error.__cause__).__name__ == _LATE_WRITE  # slcan wraps it
        or "one or more recipients" in str(error)  # of virtual: somebody's queue is full
    )
