"""A CAN bus shared by several receivers, on the callers' threads.

There is no background thread. The first thread that waits for a frame becomes the reading thread: it reads the bus for
all receivers. Another thread that waits is woken when a frame for its receiver arrives. When the reading thread returns
from its call, one of the waiting threads becomes the reading thread.

A lost bus stays broken until :meth:`SharedCanBus.reopen`. The asyncio counterpart is :mod:`orinkit.can.aio_shared_bus`.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from time import monotonic, sleep
from typing import Final, Protocol, Self, TypeVar

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation, checked
from orinkit.can.receiving import SIZE, Accepts, ReceiverBase, SharedBusBase
from orinkit.core.errors import ConnectionLost, OrinError, TransportError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress
from orinkit.transport.link_errors import closed

T = TypeVar("T")
_SLICE: Final = 0.25  # s between checks for a closed bus
_STOP_TIMEOUT: Final = 2.0  # s to wait for the reading thread to stop
_DRAIN_TIMEOUT: Final = 0.5  # s, longest time for draining while frames keep arriving
_GLANCES: Final = 100  # maximum number of polls of the reading thread; not a time, because the machine may be suspended
_GLANCE: Final = 2e-4  # s
_STOP_POLL: Final = 2e-3  # s


class FrameLink(Protocol):
    """The interface that :func:`run_can` requires; :class:`CanReceiver` implements it."""

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order."""

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this receiver, ``None`` after a time-out."""

    def clear(self) -> None:
        """Drop the frames that have arrived for this receiver."""


class SharedCanBus(SharedBusBase):
    """A bus shared by several receivers. Every method may be called from any thread."""

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        # The lock protects the following attributes. It is never held while the bus is read. It is reentrant, because
        # the garbage collector may close a receiver while the lock is held.
        self._lock = threading.RLock()
        self._ports: tuple[CanReceiver, ...] = ()  # replaced as a whole: the reading thread iterates without the lock
        self._waiting: list[CanReceiver] = []  # receivers whose thread waits while another one reads
        self._reader: int | None = None  # identifier of the thread that reads the bus
        self._quiet = False  # the reading thread has read everything, and waits for more
        self._unusable = False  # closed or broken
        self._sending = threading.RLock()
        self._reopening = threading.RLock()

    @classmethod
    def open(cls, address: CanAddress) -> Self:
        """Open a bus and return it as a shared bus; block until it is open.

        Raises:
            InvalidAddress, ConnectFailed, MissingExtra: As for :func:`orinkit.can.bus.open_bus`.
        """
        return cls(Bus.open(address))

    def receiver(self, accepts: Accepts, *, size: int = SIZE) -> CanReceiver:
        """Return a receiver for future frames that match a filter; other receivers may get the same frames.

        Args:
            accepts: Callback that returns True if a frame is for the receiver.
            size: Maximum number of buffered frames; if there are more, the oldest ones are dropped.
        """
        port = CanReceiver(self, accepts, size, self._lock)
        with self._lock:
            self._ports += (port,)
        return port

    # --- sending ------------------------------------------------------------------------------------------------------

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order, and not interleaved with the frames of other threads.

        Args:
            frames: The frames; all of them are checked before the first is sent.
            seconds: Time to wait for each frame until the interface accepts it, s.

        Raises:
            InvalidValue: If a frame is not valid; no frame was sent.
            TransportError: If a frame was not accepted in time; the following frames were not sent. The bus stays
                usable.
            ConnectionLost: If the bus is lost.
            ConnectionClosed: If the shared bus was closed.
        """
        if len(frames) > 1:
            for frame in frames:
                checked(frame)
        try:
            if not self._sending.acquire(timeout=max(0.0, seconds) + _SLICE):
                raise TransportError(
                    tr("{bus}: other threads occupied the bus for the whole timeout. Try: a longer timeout", bus=self)
                )
            if self._unusable:
                self._check_usable(None)
            for frame in frames:
                self._send_frame(frame, seconds)
        except ConnectionLost as error:
            self._break(error)
            raise
        finally:
            # Ctrl-C may arrive immediately after acquire(), before a flag could record its success. Therefore release()
            # is always called. It is the first call here, because Ctrl-C may interrupt a call before it.
            try:
                self._sending.release()
            except RuntimeError:  # the lock was not acquired
                pass

    # --- receiving ----------------------------------------------------------------------------------------------------

    def receive(self, port: CanReceiver, seconds: float) -> CanFrame | None:
        """Return the next frame for a receiver; see :meth:`CanReceiver.receive`."""
        end = monotonic() + seconds
        reads = False
        try:
            with self._lock:
                while True:
                    if self._unusable or port.closed:
                        self._check_usable(port)
                    if port.frames:
                        return port.frames.popleft()
                    if self._reader is None or self._reader == threading.get_ident():  # the latter in a signal handler
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
            if reads:  # before any call, because Ctrl-C may interrupt a call
                self._reader = None
                self._quiet = False
            if self._waiting:
                self._wake_next_reader()

    def _wait(self, port: CanReceiver, seconds: float) -> None:
        """Wait for a frame for ``port``, or until no thread reads, or a time-out. The caller must hold the lock."""
        self._waiting.append(port)
        try:
            if self._reader is not None:  # after append(): a thread that stops reading checks _waiting without the lock
                port.woken.wait(seconds)
        finally:
            self._waiting.remove(port)

    def _wake_next_reader(self) -> None:
        """Wake a waiting thread if no thread reads the bus."""
        with self._lock:
            if self._reader is None and self._waiting:
                self._waiting[0].woken.notify()

    def _read(self, port: CanReceiver, left: float, end: float) -> CanFrame | None:
        """Read the bus for all receivers, on the reading thread, until there is a frame for ``port`` or a time-out."""
        if left < 0:
            left = 0.0
        while True:
            self._quiet = True
            frame = self._receive_frame(min(left, _SLICE))
            self._quiet = False
            while frame is not None:
                if self._dispatch(frame, port):
                    return frame
                if len(self._ports) == 1 or self._unusable or monotonic() >= end:
                    break
                # all pending frames are read, because a thread that clears another receiver waits for this
                frame = self._receive_frame(0.0)
            if self._unusable or port.closed:
                self._check_usable(port)
            left = end - monotonic()
            if left <= 0:
                return None

    def _receive_frame(self, seconds: float) -> CanFrame | None:
        try:
            return self._bus.receive(seconds)
        except ConnectionLost as error:
            self._break(error)
            raise (closed() if self._closed else error) from error.__cause__

    def _dispatch(self, frame: CanFrame, mine: CanReceiver | None) -> bool:
        """Put a frame into every receiver that accepts it, except ``mine``; return True if ``mine`` accepts it."""
        is_mine = False
        if self.trace is not None:
            self.trace("<", frame)
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
        """Drop the frames that have arrived for a receiver; see :meth:`CanReceiver.clear`."""
        if self._unusable or port.closed:
            self._check_usable(port)
        if self._bus.tells and not self._bus.waiting() and self._reader is None and not port.frames:
            return  # the order of the conditions matters: a thread that has just stopped reading has filled port.frames
        polls = _GLANCES
        reads = False
        try:
            while True:
                with self._lock:
                    self._check_usable(port)
                    if self._reader is None or self._reader == threading.get_ident():
                        reads = True
                        self._reader = threading.get_ident()
                if reads:
                    self._drain()
                    break
                # the order of the conditions matters: "holds" stays set until the frame is dispatched
                polls -= 1
                if (not self._bus.waiting() and not self._bus.holds and self._quiet) or polls <= 0:
                    break
                sleep(_GLANCE)
        finally:
            if reads:
                self._reader = None
                self._quiet = False
            if reads and self._waiting:
                self._wake_next_reader()
        if port.frames:
            with self._lock:
                port.frames.clear()

    def _drain(self) -> None:
        """Read all pending frames for all receivers, on the reading thread."""
        end = 0.0
        while (frame := self._receive_frame(0.0)) is not None:
            self._dispatch(frame, None)
            end = end or monotonic() + _DRAIN_TIMEOUT
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

    def _wait_for_reader(self) -> None:
        """Wait until the reading thread has stopped."""
        end = monotonic() + _STOP_TIMEOUT
        while self._reader not in (None, threading.get_ident()) and monotonic() < end:
            sleep(_STOP_POLL)

    def reopen(self, *, force: bool = False) -> None:
        """Reopen a lost bus; block until the bus is open. Receivers stay valid, but their buffered frames are dropped.

        If several threads call this method, one of them reopens the bus and the others wait. If the bus is not lost,
        nothing is done.

        Args:
            force: True to reopen the bus even if no loss is known; pending waits then end with ConnectionLost.

        Raises:
            InvalidValue: If the bus was not opened by an address.
            InvalidAddress, ConnectFailed, MissingExtra: As for :func:`orinkit.can.bus.open_bus`; the bus stays broken.
            ConnectionClosed: If the shared bus was closed.
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
                self._broken = self._broken or tr("{bus} is being reopened", bus=self)
                self._unusable = True
                self._wake_all()
            self._wait_for_reader()
            with self._sending:
                self._bus.reopen()
            with self._lock:
                for port in self._ports:
                    port.frames.clear()
                self._broken = None
                self._unusable = self._closed
            if self._closed:  # closed while it was being reopened
                self._bus.close()
            self._check_open()
        finally:
            # Ctrl-C may arrive immediately after acquire(), before a flag could record its success. Therefore release()
            # is always called. It is the first call here, because Ctrl-C may interrupt a call before it.
            try:
                self._reopening.release()
            except RuntimeError:  # the lock was not acquired
                pass

    def close(self) -> None:
        """Close the shared bus; pending waits in other threads end with ConnectionClosed in a fraction of a second."""
        with self._lock:
            if self._closed:
                return
            self._closed = self._unusable = True
            self._wake_all()
        self._wait_for_reader()
        self._bus.close()

    def forget(self, port: CanReceiver) -> None:
        """Remove a receiver; see :meth:`CanReceiver.close`."""
        with self._lock:
            self._ports = tuple(each for each in self._ports if each is not port)
            port.closed = True
            port.frames.clear()
            port.woken.notify_all()


class CanReceiver(ReceiverBase):
    """Receives the frames of a shared bus that match a filter; created by :meth:`SharedCanBus.receiver`.

    Every method may be called from any thread. Only one thread at a time should receive, because each frame is returned
    to one caller only.

    Attributes:
        line: The shared bus. Its lock protects :attr:`frames` and is held during :meth:`put`.
        woken: Condition that wakes a waiting thread; it uses the lock of the shared bus.
    """

    def __init__(self, line: SharedCanBus, accepts: Accepts, size: int, lock: threading.RLock) -> None:
        super().__init__(accepts, size)
        self.line = line
        self.woken = threading.Condition(lock)

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames; see :meth:`SharedCanBus.send`."""
        self.line.send(frames, seconds)

    def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this receiver, ``None`` after a time-out. With 0 s, the call does not wait.

        Raises:
            ConnectionLost: If the bus is lost and was not reopened.
            ConnectionClosed: If the shared bus or the receiver was closed.
        """
        return self.line.receive(self, seconds)

    def clear(self) -> None:
        """Drop the frames that have arrived on the bus for this receiver; other receivers get their frames.

        Frames that are arriving during the call, or are still in an adapter, may not be dropped, because they cannot be
        distinguished from frames that arrive after the call.

        Raises:
            ConnectionLost, ConnectionClosed: As for :meth:`receive`.
        """
        self.line.clear(self)

    def close(self) -> None:
        """Stop receiving; a wait in another thread ends within a fraction of a second. May be called again."""
        self.line.forget(self)


def run_can(operation: CanOperation[T], port: FrameLink) -> T:
    """Run an operation on the caller's thread and return its result.

    An exception such as KeyboardInterrupt ends the operation. The receiver can still be used: the next operation with
    a step whose ``fresh`` is True (:class:`~orinkit.can.frame.OperationStep`) drops the frames that the interrupted
    operation did not receive.

    Args:
        operation: The operation.
        port: The receiver to use.

    Raises:
        ConnectionLost, ConnectionClosed, TransportError: As for :meth:`SharedCanBus.send` and
            :meth:`CanReceiver.receive`.
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
