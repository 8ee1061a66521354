"""One CAN bus shared by many, on the threads of those who call.

There is no thread of its own: whoever waits for a frame reads the bus, for all. A thread that waits while another one reads
is woken when a frame for it was read, and reads on itself when the other one leaves. A single caller reads the bus on its
own thread, with nothing in between.

A line that has broken stays broken until :meth:`SharedCanBus.reopen`. The twin is :mod:`orinkit.can.aio_shared_bus`.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic, sleep
from typing import Final, Protocol, Self, TypeAlias, TypeVar

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation, checked
from orinkit.core.errors import ConnectionLost, OrinError, TransportError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress
from orinkit.transport.link_errors import closed

T = TypeVar("T")
Accepts: TypeAlias = Callable[[CanFrame], bool]
"""Whether a frame is for a port; is asked on any thread that reads, and must not wait, nor raise anything."""

SIZE: Final = 256
"""Frames that wait in a port."""
_SLICE: Final = 0.25  # s after which a wait finds that the line was closed
_LEAVING: Final = 2.0  # s that a thread that reads gets to leave the bus
_DRAINING: Final = 0.5  # s that clearing may take, though more and more comes
_GLANCES: Final = 100  # until a thread that reads has handed out all; no time, for the machine may stand still
_GLANCE: Final = 2e-4  # s
_LOOK: Final = 2e-3  # s


class FrameLink(Protocol):
    """What an operation is carried out over, on the caller's thread: :class:`CanReceiver`."""

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order."""

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this port, ``None`` when the seconds have passed."""

    def clear(self) -> None:
        """Drop what has arrived for this port."""


class SharedCanBus:
    """A bus that many ports share. Every method may be called from any thread.

    Args:
        bus: is this line's from then on: nobody else receives from it. It is closed with the line if it is its own.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        # of what follows; never held while the bus is read. A port may be closed by the garbage collector, while it is held
        self._lock = threading.RLock()
        self._ports: tuple[CanReceiver, ...] = ()  # replaced as a whole: who reads goes through it without the lock
        self._waiting: list[CanReceiver] = []  # those with a thread that waits for another one that reads
        self._reader: int | None = None  # the thread that reads the bus
        self._quiet = False  # it has taken all that has arrived, and waits for more
        self._closed = False
        self._broken: str | None = None  # why
        self._unusable = False  # closed or broken
        self._sending = threading.RLock()
        self._reopening = threading.RLock()

    @classmethod
    def open(cls, address: CanAddress) -> Self:
        """Open a bus and a line over it; blocks as long as that takes.

        Raises:
            InvalidAddress, ConnectFailed, MissingExtra: as :func:`orinkit.can.bus.open_bus`.
        """
        return cls(Bus.open(address))

    def __str__(self) -> str:
        return str(self._bus)

    @property
    def broken(self) -> bool:
        """Whether the bus was lost; what waited knows, and everything else raises until :meth:`reopen`."""
        return self._broken is not None

    @property
    def closed(self) -> bool:
        """Whether it was closed here."""
        return self._closed

    def port(self, accepts: Accepts, *, size: int = SIZE) -> CanReceiver:
        """Return a port, which gets each frame from now on that it accepts; others may get the same frame.

        Args:
            accepts: whether a frame is for it.
            size: frames that wait in it; of more the oldest are dropped.
        """
        port = CanReceiver(self, accepts, size, self._lock)
        with self._lock:
            self._ports += (port,)
        return port

    def _check(self, port: CanReceiver | None = None) -> None:
        if self._closed or (port is not None and port.closed):
            raise closed()
        if self._broken is not None:
            raise ConnectionLost(self._broken)

    # --- sending ------------------------------------------------------------------------------------------------------

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order, without those of others in between.

        Args:
            frames: to send; all of them are looked at before the first is sent.
            seconds: that each may wait until the interface takes it.

        Raises:
            InvalidValue: one cannot be a frame; none was sent.
            TransportError: one was not taken in time, nor were those behind it; the line goes on.
            ConnectionLost: the bus is gone.
            ConnectionClosed: the line was closed.
        """
        if len(frames) > 1:
            for frame in frames:
                checked(frame)
        try:
            if not self._sending.acquire(timeout=max(0.0, seconds) + _SLICE):
                raise TransportError(tr("{bus}: others are sending all the time. Try: a longer timeout", bus=self))
            if self._unusable:
                self._check()
            for frame in frames:
                self._bus.send(frame, seconds)
        except ConnectionLost as error:
            self._break(error)
            raise
        finally:  # whether it was acquired cannot be told where Ctrl-C comes in between; nor may it come before a call of ours
            try:
                self._sending.release()
            except RuntimeError:  # it was not
                pass

    # --- receiving ----------------------------------------------------------------------------------------------------

    def receive(self, port: CanReceiver, seconds: float) -> CanFrame | None:
        """Return the next frame for a port, as :meth:`CanReceiver.receive`."""
        end = monotonic() + seconds
        reads = False
        try:
            with self._lock:
                while True:
                    if self._unusable or port.closed:
                        self._check(port)
                    if port.frames:
                        return port.frames.popleft()
                    if self._reader is None or self._reader == threading.get_ident():  # in a signal handler
                        reads = True
                        self._reader = threading.get_ident()
                        break
                    left = end - monotonic()
                    if left <= 0:
                        return None
                    self._wait(port, left)
                    seconds = end - monotonic()
            return self._read(port, seconds, end)
        finally:
            if reads:  # before any call: Ctrl-C may come in each of them
                self._reader = None
                self._quiet = False
            if self._waiting:
                self._pass_on()

    def _wait(self, port: CanReceiver, seconds: float) -> None:
        """Wait until there is a frame, or nobody who reads; the lock is held before and after."""
        self._waiting.append(port)
        try:
            if self._reader is not None:  # who leaves looks at those who wait without the lock
                port.woken.wait(seconds)
        finally:
            self._waiting.remove(port)

    def _pass_on(self) -> None:
        """Wake a thread that waits if nobody reads the bus."""
        with self._lock:
            if self._reader is None and self._waiting:
                self._waiting[0].woken.notify()

    def _read(self, port: CanReceiver, left: float, end: float) -> CanFrame | None:
        """Read the bus for all until there is a frame for a port, or the time is up; this thread is the one that reads."""
        if left < 0:
            left = 0.0
        while True:
            self._quiet = True
            frame = self._take(min(left, _SLICE))
            self._quiet = False
            while frame is not None:
                if self._hand_out(frame, port):
                    return frame
                if len(self._ports) == 1 or self._unusable or monotonic() >= end:
                    break
                # who wants to clear another port has to know when all that has arrived was taken
                frame = self._take(0.0)
            if self._unusable or port.closed:
                self._check(port)
            left = end - monotonic()
            if left <= 0:
                return None

    def _take(self, seconds: float) -> CanFrame | None:
        try:
            return self._bus.receive(seconds)
        except ConnectionLost as error:
            self._break(error)
            raise (closed() if self._closed else error) from error.__cause__

    def _hand_out(self, frame: CanFrame, mine: CanReceiver | None) -> bool:
        """Give a frame to every port that accepts it; returns whether one's own does, which does not keep it."""
        is_mine = False
        for port in self._ports:
            if port.accepts(frame):
                if port is mine:
                    is_mine = True
                else:
                    with self._lock:
                        port.put(frame)
                        port.woken.notify()
        return is_mine

    def clear(self, port: CanReceiver) -> None:
        """Drop what has arrived for a port, as :meth:`CanReceiver.clear`."""
        if self._unusable or port.closed:
            self._check(port)
        if self._bus.tells and not self._bus.waiting() and self._reader is None and not port.frames:
            return  # in this order: what a thread took that was reading until now has reached the port
        glances = _GLANCES
        reads = False
        try:
            while True:
                with self._lock:
                    self._check(port)
                    if self._reader is None or self._reader == threading.get_ident():
                        reads = True
                        self._reader = threading.get_ident()
                if reads:
                    self._drain()
                    break
                # in this order: what was taken is held until it is handed out
                glances -= 1
                if (not self._bus.waiting() and not self._bus.holds and self._quiet) or glances <= 0:
                    break
                sleep(_GLANCE)
        finally:
            if reads:
                self._reader = None
                self._quiet = False
            if reads and self._waiting:
                self._pass_on()
        if port.frames:
            with self._lock:
                port.frames.clear()

    def _drain(self) -> None:
        """Take all that has arrived, for all; this thread is the one that reads."""
        end = 0.0
        while (frame := self._take(0.0)) is not None:
            self._hand_out(frame, None)
            end = end or monotonic() + _DRAINING
            if monotonic() > end:
                break

    # --- breaking, opening again, closing -----------------------------------------------------------------------------

    def _break(self, error: OrinError) -> None:
        with self._lock:
            self._broken = str(error)
            self._unusable = True
            self._wake_all()

    def _wake_all(self) -> None:
        for port in self._waiting:
            port.woken.notify_all()

    def _see_off(self) -> None:
        """Wait for the thread that reads to notice that it is to leave."""
        end = monotonic() + _LEAVING
        while self._reader not in (None, threading.get_ident()) and monotonic() < end:
            sleep(_LOOK)

    def reopen(self, *, force: bool = False) -> None:
        """Open a bus again that was lost; ports stay valid, and are empty. Blocks as long as that takes.

        Where several threads call it, one of them opens the bus and the others wait for that; it does nothing to a line that
        is not broken.

        Args:
            force: close and open it although it is not known to be broken; waits end with ConnectionLost.

        Raises:
            InvalidValue: the bus was not opened by an address.
            InvalidAddress, ConnectFailed, MissingExtra: as :func:`orinkit.can.bus.open_bus`; the line is still
                broken.
            ConnectionClosed: the line was closed.
        """
        first = False
        try:
            first = self._reopening.acquire(blocking=False)
            if not first:
                self._reopening.acquire()
            self._check_open()
            if self._broken is None and not (force and first):
                return
            self._bus.check_reopening()
            with self._lock:
                self._broken = self._broken or tr("{bus} is being opened again", bus=self)
                self._unusable = True
                self._wake_all()
            self._see_off()
            with self._sending:
                self._bus.reopen()
            with self._lock:
                for port in self._ports:
                    port.frames.clear()
                self._broken = None
                self._unusable = self._closed
            if self._closed:  # meanwhile
                self._bus.close()
            self._check_open()
        finally:  # whether it was acquired cannot be told where Ctrl-C comes in between; nor may it come before a call of ours
            try:
                self._reopening.release()
            except RuntimeError:  # it was not
                pass

    def _check_open(self) -> None:
        if self._closed:
            raise closed()

    def close(self) -> None:
        """Close the line; waits in other threads end with ConnectionClosed within a fraction of a second."""
        with self._lock:
            if self._closed:
                return
            self._closed = self._unusable = True
            self._wake_all()
        self._see_off()
        self._bus.close()

    def forget(self, port: CanReceiver) -> None:
        """Give a port no more frames, as :meth:`CanReceiver.close`."""
        with self._lock:
            self._ports = tuple(each for each in self._ports if each is not port)
            port.closed = True
            port.frames.clear()
            port.woken.notify_all()


class CanReceiver:
    """What one user has of a line: the frames that it accepts. :meth:`SharedCanBus.port` makes one.

    Every method may be called from any thread; one thread at a time should receive, as a frame goes to one of them only.

    Attributes:
        line: it belongs to.
        accepts: whether a frame is for it.
        frames: that wait; is used with the line's lock.
        woken: tells a thread that waits that something has changed; has the line's lock.
        dropped: frames that were dropped because too many waited.
        closed: whether it was closed.
    """

    def __init__(self, line: SharedCanBus, accepts: Accepts, size: int, lock: threading.RLock) -> None:
        self.line = line
        self.accepts = accepts
        self.frames: deque[CanFrame] = deque(maxlen=size)
        self.woken = threading.Condition(lock)
        self.dropped = 0
        self.closed = False

    def put(self, frame: CanFrame) -> None:
        """Keep a frame; the line's lock is held."""
        self.dropped += len(self.frames) == self.frames.maxlen
        self.frames.append(frame)

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, as :meth:`SharedCanBus.send`."""
        self.line.send(frames, seconds)

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this port, ``None`` when the seconds have passed; 0 s takes what is there.

        Raises:
            ConnectionLost: the bus is gone, and was not opened again.
            ConnectionClosed: the line or the port was closed.
        """
        return self.line.receive(self, seconds)

    def clear(self) -> None:
        """Drop what has arrived for this port on the bus until now; other ports get theirs.

        What arrives in this very moment, or waits in an adapter, cannot be told from what comes later.

        Raises:
            ConnectionLost, ConnectionClosed: as :meth:`receive`.
        """
        self.line.clear(self)

    def close(self) -> None:
        """Get no more frames; a wait in another thread ends within a fraction of a second. May be called again."""
        self.line.forget(self)


def run_can(operation: CanOperation[T], port: FrameLink) -> T:
    """Carry out an operation on the caller's thread and return its result.

    An exception, as KeyboardInterrupt, ends the operation and leaves the port usable: what was not received yet is
    dropped by the next operation that wants to begin afresh.

    Args:
        operation: what to do.
        port: to do it over.

    Raises:
        ConnectionLost, ConnectionClosed, TransportError: as :meth:`SharedCanBus.send` and :meth:`CanReceiver.receive`.
    """
    received: CanFrame | None = None
    deadline = 0.0
    try:
        while True:
            frames, seconds, fresh = operation.send(received)
            left = deadline - monotonic() if seconds is None else seconds
            if fresh:
                port.clear()
            if frames:
                port.send(frames, max(left, 0.0))
            if seconds is not None:
                deadline = monotonic() + seconds
            received = port.receive(left) if left > 0 else None
    except StopIteration as stop:
        result: T = stop.value
        return result
    finally:
        operation.close()
