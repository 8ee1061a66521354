"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``shared.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeVar, Unpack
from weakref import WeakSet, finalize

from orinkit.abh3.api.common import BusSettings, bus_address, given_bus
from orinkit.abh3.session.host import Host, broadcasts_of_all
from orinkit.abh3.session.multipacket import exchange
from orinkit.abh3.table import ids
from orinkit.abh3.table.checks import check_seconds
from orinkit.abh3.table.decoder import DecodedFrame, Decoder
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import AnyRecord
from orinkit.abh3.table.signals import Dialect, dialect_of
from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation
from orinkit.can.shared_bus import CanReceiver, SharedCanBus, run_can
from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost

if TYPE_CHECKING:
    import can

R = TypeVar("R")
_HEARD: Final = 4096
"""Frames that a listener may be behind."""
_SLICE: Final = 3600.0


class BusMember(Protocol):
    """A driver, as far as its bus is concerned."""

    host: Host[Any]

    @property
    def closed(self) -> bool:
        """Whether it was closed."""

    def release(self) -> None:
        """Have the driver come to rest, if it was asked to move."""


class DriverLock:
    """Whose turn it is to exchange messages with a driver.

    Attributes:
        lock: is held for an exchange.
        clean: the one before has come to its end.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.clean = False


class SharedBus:
    """What a bus with drivers does for all of them.

    Args:
        line: of the transport.

    Attributes:
        url: of the bus, or what python-can says of a bus that was given.
    """

    def __init__(self, line: SharedCanBus) -> None:
        self._line = line
        self._lock = threading.RLock()
        self._members: WeakSet[BusMember] = WeakSet()
        self._turns: dict[tuple[int, int], DriverLock] = {}
        self.url = str(line)

    @classmethod
    def open(cls, at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> Self:
        """Open a bus, as :func:`open_bus`."""
        bus = given_bus(at)
        if bus is not None:
            return cls(SharedCanBus(Bus(bus, own=False)))
        assert at is None or isinstance(at, str)
        return cls(SharedCanBus.open(bus_address(at, settings)))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

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
        """Request a broadcast of all drivers of a group, and return what they answer by their addresses (4.7).

        Args:
            number: 0 to 6; or, from 8 on, group * 8 + number as in the document.
            seconds: to wait for answers.
            count: of drivers, 0 to 254; when so many have answered there is no more waiting.
            group: of the drivers.
            host: address of this host.
            dialect: of the drivers.
            load_unit: % of a code of the load.

        Raises:
            InvalidValue: an argument is out of its range.
            TransportError: the bus is broken, or closed.
        """
        check_seconds("seconds", seconds)
        codec = Codec(dialect_of(dialect).with_load_unit(load_unit))
        ps = ids.broadcast_number(number, ids.check_group(group))
        port = self._line.port(_is_broadcast)
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
        """Yield every frame on the bus, decoded: those of others, not what is sent from here.

        Some interfaces (udp_multicast) give back what is sent from here too.

        Args:
            seconds: after which it ends; ``None`` for never.
            dialect: of the drivers.
            hosts: addresses of hosts, to tell commands from feedback.
            load_unit: % of a code of the load.

        Raises:
            InvalidValue: an argument is out of its range.
            TransportError: the bus is broken, or closed.
        """
        decoder = Decoder(dialect_of(dialect).with_load_unit(load_unit), hosts=hosts)
        end = None if seconds is None else monotonic() + check_seconds("seconds", seconds)
        port = self._line.port(_is_any, size=_HEARD)
        try:
            while True:
                left = _SLICE if end is None else end - monotonic()
                if left <= 0:
                    return
                frame = port.receive(left)
                if frame is not None:
                    yield decoder.decode(frame)
        finally:
            port.close()

    def close(self) -> None:
        """Have every driver come to rest that was asked to move, and close the bus; one that was given stays open.

        May be called again.
        """
        try:
            for member in list(self._members):
                member.release()
        finally:
            self._line.close()

    # --- for drivers --------------------------------------------------------------------------------------------------

    def enter(self, member: BusMember) -> CanReceiver:
        """Return a port for a driver, which is told what happens to the bus; it is closed when the driver's object goes."""
        self._members.add(member)
        port = self.port_for(member.host)
        finalize(member, port.close).atexit = False
        return port

    def port_for(self, host: Host[Any]) -> CanReceiver:
        """Return a port that gets the frames of one driver."""
        return self._line.port(host.accepts)

    def has(self, host: Host[Any]) -> bool:
        """Whether there is an object already for the same driver and host."""
        wanted = host.address, host.host
        return any((member.host.address, member.host.host) == wanted and not member.closed for member in self._members)

    def run(self, operation: CanOperation[R], port: CanReceiver, *, revive: bool = True) -> R:
        """Carry out an operation over a port.

        Args:
            operation: what to do.
            port: to do it over.
            revive: a bus that is broken and was opened here is opened again.

        Raises:
            TransportError: a frame was not taken.
            ConnectionLost, ConnectionClosed, ConnectFailed: the bus is broken, or closed; the commands of all its drivers are
                0 from then on.
        """
        try:
            if revive and self._line.broken:
                with self._lock:
                    if self._line.broken:
                        self._forget()  # who found out may have been a listener, or nobody at all
                        self._line.reopen()
            return run_can(operation, port)
        except (ConnectionLost, ConnectionClosed, ConnectFailed):
            operation.close()
            self._forget()
            raise
        except BaseException:
            operation.close()
            raise

    def exchange(self, message: bytes, host: Host[Any]) -> bytes:
        """Send a multi-packet message to a driver and return its answer; one exchange at a time, whoever asks for it.

        Raises:
            InvalidValue: it is too long.
            ProtocolError, DriverTimeout: as :func:`orinkit.abh3.session.multipacket.exchange`.
            TransportError: as :meth:`run`.
        """
        turn = self._turns.setdefault((host.address, host.host), DriverLock())
        with turn.lock:
            afresh = not turn.clean
            turn.clean = False  # if this one is broken off, it is the next one that tells the driver
            operation = exchange(message, host=host.host, driver=host.address, priority=host.priority, afresh=afresh)
            port = self.port_for(host)
            try:
                answer = self.run(operation, port)
            finally:
                port.close()
            turn.clean = True
            return answer

    def _forget(self) -> None:
        """Take the commands of all drivers back."""
        for member in list(self._members):
            member.host.reset_commands()


def _is_any(frame: CanFrame) -> bool:  # noqa: ARG001 - as every predicate
    return True


def _is_broadcast(frame: CanFrame) -> bool:
    return ids.FrameId.parse(frame.id).pf == ids.BROADCAST
