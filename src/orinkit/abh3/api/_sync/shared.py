"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``shared.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeVar, Unpack
from weakref import WeakSet, finalize

from orinkit.abh3.api.common import BusSettings, bus_address, given_bus
from orinkit.abh3.session.host import Host, broadcasts_of_all
from orinkit.abh3.session.multipacket import exchange
from orinkit.abh3.table import ids
from orinkit.abh3.table.decoder import DecodedFrame, Decoder
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import AnyRecord
from orinkit.abh3.table.signals import Dialect, dialect_of
from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation
from orinkit.can.receiving import Trace
from orinkit.can.shared_bus import CanReceiver, SharedCanBus, run_can
from orinkit.core.closing import Closing
from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost
from orinkit.core.validation import check_seconds

if TYPE_CHECKING:
    import can

R = TypeVar("R")
_LISTENER_SIZE: Final = 4096
"""Maximum number of frames that are buffered for one call of :meth:`SharedBus.listen`."""
_SLICE: Final = 3600.0


class BusMember(Protocol):
    """The attributes and methods of a driver object that its bus uses."""

    host: Host[Any]

    @property
    def closed(self) -> bool:
        """True if the driver was closed."""

    def release(self) -> None:
        """Stop the driver if it may be moving."""


class DriverLock:
    """Serializes the multi-packet exchanges with one driver.

    Attributes:
        lock: Held during an exchange.
        clean: True if the previous exchange was completed.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.clean = False


class SharedBus(Closing):
    """A CAN bus, and the operations that concern all drivers on it.

    Args:
        line: The shared CAN bus that transfers the frames.

    Attributes:
        url: URL of the bus. If the program passed a python-can bus to :meth:`open`, it is python-can's description of
            that bus.
    """

    def __init__(self, line: SharedCanBus) -> None:
        self._line = line
        self._lock = threading.RLock()
        self._members: WeakSet[BusMember] = WeakSet()
        self._driver_locks: dict[tuple[int, int], DriverLock] = {}
        self.url = str(line)

    @classmethod
    def open(cls, at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> Self:
        """Open a bus; see :func:`open_bus`."""
        bus = given_bus(at)
        if bus is not None:
            return cls(SharedCanBus(Bus(bus, own=False)))
        assert at is None or isinstance(at, str)
        return cls(SharedCanBus.open(bus_address(at, settings)))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    @property
    def trace(self) -> Trace | None:
        """Callback invoked with each frame: ``trace(">", frame)`` if it was sent, ``trace("<", frame)`` if received.

        It must neither block nor raise. ``None`` for no callback. With some interfaces (udp_multicast), frames that are
        sent through this object are also received.
        """
        return self._line.trace

    @trace.setter
    def trace(self, callback: Trace | None) -> None:
        self._line.trace = callback

    def request_all(
        self,
        number: int,
        *,
        seconds: float = 0.2,
        count: int | None = None,
        group: int = 5,
        host: int = 2,
        dialect: str | Dialect = "v1",
        load_unit: float = 1.0,
    ) -> dict[int, AnyRecord]:
        """Request a broadcast from all drivers of a group, and return their replies by address.

        This method is described in section 4.7 of the ABH3 document (abh3_can_reqBRDBRD).

        Args:
            number: Number of the broadcast in the group, 0 to 6; or, as in the document, this number plus 8 times
                ``group``.
            seconds: Seconds to wait for replies.
            count: Number of drivers, 0 to 254. The wait ends early when this many drivers have replied; ``None`` to
                wait for ``seconds`` in any case.
            group: Broadcast group of the drivers.
            host: Address of this host.
            dialect: Dialect of the drivers.
            load_unit: Resolution of the loads in frames, in %: 1 or 0.1.

        Raises:
            InvalidValue: If an argument is out of range.
            TransportError: If the bus is broken or closed.
        """
        check_seconds("seconds", seconds)
        codec = Codec(dialect_of(dialect).with_load_unit(load_unit))
        ps = ids.broadcast_number(number, ids.check_group(group))
        port = self._line.receiver(_is_broadcast)
        try:
            return self.run(broadcasts_of_all(codec, ids.check_address("host", host), ps, seconds, count), port)
        finally:
            port.close()

    def listen(
        self,
        seconds: float | None = None,
        *,
        dialect: str | Dialect = "v1",
        hosts: Iterable[int] = (2,),
        load_unit: float = 1.0,
    ) -> Iterator[DecodedFrame]:
        """Decode and yield every frame on the bus, except frames that are sent through this object.

        With some interfaces (udp_multicast), frames that are sent through this object are also yielded.

        Args:
            seconds: Seconds after which to stop; ``None`` for never.
            dialect: Dialect of the drivers.
            hosts: Addresses of hosts, to distinguish commands from feedback.
            load_unit: Resolution of the loads in frames, in %: 1 or 0.1.

        Raises:
            InvalidValue: If an argument is out of range.
            TransportError: If the bus is broken or closed.
        """
        decoder = Decoder(dialect_of(dialect).with_load_unit(load_unit), hosts=hosts)
        end = None if seconds is None else monotonic() + check_seconds("seconds", seconds)
        port = self._line.receiver(_is_any, size=_LISTENER_SIZE)
        try:
            while True:
                remaining = _SLICE if end is None else end - monotonic()
                if remaining <= 0:
                    return
                frame = port.receive(remaining)
                if frame is not None:
                    yield decoder.decode(frame)
        finally:
            port.close()

    def close(self) -> None:
        """Stop every driver that may be moving, then close the bus. May be called again.

        A python-can bus that the program passed to :meth:`open` stays open.
        """
        try:
            for member in list(self._members):
                member.release()
        finally:
            self._line.close()

    # --- for drivers --------------------------------------------------------------------------------------------------

    def enter(self, member: BusMember) -> CanReceiver:
        """Register a driver and return its receiver, which is closed when the driver object is garbage collected."""
        self._members.add(member)
        port = self.port_for(member.host)
        finalize(member, port.close).atexit = False
        return port

    def port_for(self, host: Host[Any]) -> CanReceiver:
        """Return a receiver for the frames that the driver of a host sends to this host or to all nodes."""
        return self._line.receiver(host.accepts)

    def has(self, host: Host[Any]) -> bool:
        """Return True if this bus has an open driver object with the same addresses of driver and host as ``host``."""
        wanted = host.address, host.host
        return any((member.host.address, member.host.host) == wanted and not member.closed for member in self._members)

    def run(self, operation: CanOperation[R], port: CanReceiver, *, revive: bool = True) -> R:
        """Run an operation: send its frames over the bus, and pass to it the frames that arrive.

        Args:
            operation: The operation.
            port: The receiver for the frames that the operation expects.
            revive: True to reopen the bus first, if it is lost and was opened by orinkit.

        Raises:
            TransportError: If a frame could not be sent.
            ConnectionLost, ConnectionClosed, ConnectFailed: If the bus is lost or closed, or cannot be reopened; the
                commands of all its drivers are then 0.
        """
        try:
            if revive and self._line.broken:
                with self._lock:
                    if self._line.broken:
                        self._reset_commands()  # needed if no call of a driver has failed since the loss
                        self._line.reopen()
            return run_can(operation, port)
        except (ConnectionLost, ConnectionClosed, ConnectFailed):
            operation.close()
            self._reset_commands()
            raise
        except BaseException:
            operation.close()
            raise

    def exchange(self, message: bytes, host: Host[Any]) -> bytes:
        """Send a multi-packet message to a driver and return its reply. Only one exchange with a driver runs at a time.

        Raises:
            InvalidValue: If the message is empty, too long, or not bytes.
            ProtocolError, DriverTimeout: As for :func:`orinkit.abh3.session.multipacket.exchange`.
            TransportError: As for :meth:`run`.
        """
        driver_lock = self._driver_locks.setdefault((host.address, host.host), DriverLock())
        with driver_lock.lock:
            afresh = not driver_lock.clean
            driver_lock.clean = False  # if this exchange is interrupted, the next one aborts it
            operation = exchange(message, host=host.host, driver=host.address, priority=host.priority, afresh=afresh)
            port = self.port_for(host)
            try:
                reply = self.run(operation, port)
            finally:
                port.close()
            driver_lock.clean = True
            return reply

    def _reset_commands(self) -> None:
        """Set the commands of all drivers to 0 and start to off, without sending them."""
        for member in list(self._members):
            member.host.reset_commands()


def _is_any(frame: CanFrame) -> bool:  # noqa: ARG001 - signature of a predicate
    return True


def _is_broadcast(frame: CanFrame) -> bool:
    return ids.FrameId.parse(frame.id).pf == ids.BROADCAST
