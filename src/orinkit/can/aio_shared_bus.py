"""A CAN bus shared by several tasks of an event loop; the synchronous counterpart is :mod:`orinkit.can.shared_bus`.

If the bus has a descriptor that reports pending frames, the event loop watches the descriptor. Otherwise a thread reads
the bus and passes the frames to the loop. The thread is required for virtual buses, most drivers on Windows, and the
interface serial of python-can. Frames are read even if no task waits for them. All methods must be called in the event
loop in which the shared bus was created.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Final, Protocol, Self, TypeVar, cast

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation, checked
from orinkit.can.reader_thread import BusReader
from orinkit.can.receiving import SIZE, Accepts, ReceiverBase, SharedBusBase
from orinkit.core.errors import ConnectionLost, OrinError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress
from orinkit.transport.link_errors import other_loop

T = TypeVar("T")
_BURST: Final = 64  # maximum number of frames read in one iteration of the loop
_MAX_DRAINED: Final = 10_000  # maximum number of frames read by clear()
_MAX_SEND_BLOCK: Final = 0.05  # s, longest time for which sending may block the loop
_STOP_TIMEOUT: Final = 2.0  # s to wait for the thread to end
_GLANCES: Final = 40  # maximum number of polls; not a time, because the machine may be suspended
_GLANCE: Final = 1e-3  # s; the resolution of uvloop


class AsyncFrameLink(Protocol):
    """The interface that :func:`arun_can` requires; :class:`AsyncCanReceiver` implements it."""

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order."""

    async def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this receiver, ``None`` after a time-out."""

    async def clear(self) -> None:
        """Drop the frames that have arrived for this receiver."""


class AsyncSharedCanBus(SharedBusBase):
    """A bus shared by several receivers in the event loop in which it is created."""

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self._loop = asyncio.get_running_loop()
        self._ports: tuple[AsyncCanReceiver, ...] = ()
        self._watched = -1  # descriptor watched by the loop
        self._thread: BusReader | None = None
        self._leaving: BusReader | None = None
        self._reopening = asyncio.Lock()
        self._begin()

    @classmethod
    async def open(cls, address: CanAddress) -> Self:
        """Open a bus in a thread, because opening may block, and return it as a shared bus.

        Raises:
            InvalidAddress, ConnectFailed, MissingExtra: As for :func:`orinkit.can.bus.open_bus`.
        """
        opening = _in_thread(lambda: Bus.open(address))
        try:
            return cls(await asyncio.shield(opening))
        except asyncio.CancelledError:
            opening.add_done_callback(_close_unused)
            raise

    def receiver(self, accepts: Accepts, *, size: int = SIZE) -> AsyncCanReceiver:
        """Return a receiver for future frames that match a filter; other receivers may get the same frames.

        Args:
            accepts: Callback that returns True if a frame is for the receiver; it must not raise exceptions.
            size: Maximum number of buffered frames; if there are more, the oldest ones are dropped.
        """
        port = AsyncCanReceiver(self, accepts, size)
        self._ports += (port,)
        return port

    def forget(self, port: AsyncCanReceiver) -> None:
        """Remove a receiver; see :meth:`AsyncCanReceiver.close`."""
        self._ports = tuple(each for each in self._ports if each is not port)
        port.closed = True
        port.frames.clear()
        port.wake()

    def check(self, port: AsyncCanReceiver | None = None) -> None:
        """Raise an exception if bus or receiver is closed, the bus is lost, or the caller is in another event loop."""
        self._check_usable(port)
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order, with the exceptions of :meth:`orinkit.can.shared_bus.SharedCanBus.send`.

        The call blocks the loop until the interface accepts the frames. Most interfaces accept them immediately.

        Args:
            frames: The frames; all of them are checked before the first is sent.
            seconds: Time to wait for each frame until the interface accepts it, s; a longer time is reduced to 0.05.
        """
        for frame in frames:
            checked(frame)
        self.check()
        try:
            for frame in frames:
                self._send_frame(frame, min(seconds, _MAX_SEND_BLOCK))
        except ConnectionLost as error:
            self._break(error)
            raise

    # --- receiving ----------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        if self._bus.watchable:
            try:
                self._loop.add_reader(self._bus.fileno(), self._readable)
            except (NotImplementedError, OSError, ValueError):  # on Windows, or if the descriptor cannot be watched
                pass
            else:
                self._watched = self._bus.fileno()
                return
        self._thread = BusReader(self._bus, self._loop, self._thread_ready)
        self._thread.start()

    def _end(self) -> None:
        """Stop reading. If a thread reads the bus, this thread ends soon afterwards."""
        if self._watched >= 0:
            self._loop.remove_reader(self._watched)
            self._watched = -1
        if self._thread is not None:
            self._thread.stopping = True
            self._leaving, self._thread = self._thread, None

    def _readable(self) -> None:
        if self._watched >= 0 and self._dispatch_pending(_BURST):
            self._loop.call_soon(
                self._readable
            )  # python-can may have buffered frames, which the descriptor does not report

    def _dispatch_pending(self, limit: int) -> bool:
        """Pass pending frames to their receivers, up to a limit; return True if more may be pending."""
        try:
            for _ in range(limit):
                frame = self._bus.receive(0.0)
                if frame is None:
                    return False
                self._dispatch(frame)
        except ConnectionLost as error:
            self._break(error)
            return False
        return True

    def _thread_ready(self) -> None:
        """Pass the new frames of the reading thread to their receivers, or handle the end of the thread."""
        thread = self._thread
        if thread is None:
            return
        for frame in thread.take_frames():
            self._dispatch(frame)
        if thread.error is not None:
            self._break(thread.error)

    def _dispatch(self, frame: CanFrame) -> None:
        if self.trace is not None:
            self.trace("<", frame)
        for port in self._ports:
            if port.accepts(frame):
                port.put(frame)

    async def dispatch_arrived(self) -> None:
        """Pass all frames that have arrived until now to their receivers."""
        if self._watched >= 0:
            self._dispatch_pending(_MAX_DRAINED)
            return
        for _ in range(_GLANCES):
            if self._thread is None:
                return
            # the order of the conditions matters: "holds" stays set until the frame is in the thread's buffer
            quiet = not self._bus.waiting() and not self._bus.holds and self._thread.quiet
            self._thread_ready()
            if quiet:
                return
            await asyncio.sleep(_GLANCE)

    # --- breaking, opening again, closing -----------------------------------------------------------------------------

    def _break(self, error: OrinError) -> None:
        self._end()
        self._broken = str(error)
        self._wake_all()

    def _wake_all(self) -> None:
        for port in self._ports:
            port.wake()

    async def reopen(self, *, force: bool = False) -> None:
        """Reopen a lost bus, in a thread, because opening may block.

        See :meth:`orinkit.can.shared_bus.SharedCanBus.reopen`. If several tasks call this method, one of them reopens
        the bus and the others wait.
        """
        first = not self._reopening.locked()
        async with self._reopening:
            self._check_open()
            if self._broken is None and not (force and first):
                return
            self._bus.check_reopening()
            self._broken = self._broken or tr("{bus} is being reopened", bus=self)
            self._wake_all()
            await self._stop_reading()
            await self._open_again()
            if self._closed:  # closed while it was being reopened
                self._bus.close()
            self._check_open()
            for port in self._ports:
                port.frames.clear()
            self._broken = None
            self._begin()

    async def _open_again(self) -> None:
        opening = _in_thread(self._bus.reopen)
        try:
            await asyncio.shield(opening)
        except asyncio.CancelledError:
            await asyncio.wait([opening])  # the bus is unusable until then; a second cancellation interrupts this wait
            raise

    async def _stop_reading(self) -> None:
        """Stop reading; if a thread reads the bus, wait until this thread has ended."""
        self._end()
        if self._leaving is not None:
            await self._leaving.wait_ended(_STOP_TIMEOUT)

    async def close(self) -> None:
        """Close the shared bus; pending waits end immediately with ConnectionClosed. May be called again."""
        if self._closed:
            return
        self._closed = True
        self._wake_all()
        try:
            await self._stop_reading()
        finally:
            self._bus.close()


class AsyncCanReceiver(ReceiverBase):
    """Receives the frames of a shared bus that match a filter; created by :meth:`AsyncSharedCanBus.receiver`.

    Attributes:
        line: The shared bus.
    """

    def __init__(self, line: AsyncSharedCanBus, accepts: Accepts, size: int) -> None:
        super().__init__(accepts, size)
        self.line = line
        self._waiters: list[asyncio.Future[None]] = []

    def put(self, frame: CanFrame) -> None:
        """Buffer a frame, and wake the waiting tasks."""
        super().put(frame)
        if self._waiters:
            self.wake()

    def wake(self) -> None:
        """Wake all waiting tasks."""
        for waiter in self._waiters:
            if not waiter.done():
                waiter.set_result(None)

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames; see :meth:`AsyncSharedCanBus.send`.

        This method is not a coroutine, so it cannot be cancelled halfway.
        """
        self.line.send(frames, seconds)

    async def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this receiver, ``None`` after a time-out.

        With 0 s, the call does not wait: it returns a frame that is already buffered, or ``None``. A cancelled call
        loses no frame.

        Raises:
            ConnectionLost: If the bus is lost and was not reopened.
            ConnectionClosed: If the shared bus or the receiver was closed.
            TransportError: If called in another event loop.
        """
        end = monotonic() + seconds
        while True:
            self.line.check(self)
            if self.frames:
                return self.frames.popleft()
            left = end - monotonic()
            if left <= 0:
                return None
            await self._wait(left)

    async def _wait(self, seconds: float) -> None:
        """Wait until the receiver is woken, or until a time-out."""
        loop = asyncio.get_running_loop()
        waiter = loop.create_future()
        self._waiters.append(waiter)
        timer = loop.call_later(seconds, _finish, waiter)
        try:
            await waiter
        finally:
            timer.cancel()
            self._waiters.remove(waiter)

    async def clear(self) -> None:
        """Drop the frames that have arrived on the bus for this receiver; other receivers get their frames.

        Frames that are arriving during the call, or are still in an adapter, may remain.

        Raises:
            ConnectionLost, ConnectionClosed: As for :meth:`receive`.
        """
        self.line.check(self)
        await self.line.dispatch_arrived()
        self.line.check(self)
        self.frames.clear()

    def close(self) -> None:
        """Stop receiving; a pending wait ends immediately. May be called again."""
        self.line.forget(self)


async def arun_can(operation: CanOperation[T], port: AsyncFrameLink) -> T:
    """Run an operation in asyncio and return its result.

    After a cancelled operation, the receiver can still be used: the next operation with a step whose ``fresh`` is True
    (:class:`~orinkit.can.frame.OperationStep`) drops the frames that the cancelled operation did not receive.

    Args:
        operation: The operation.
        port: The receiver to use.

    Raises:
        ConnectionLost, ConnectionClosed, TransportError: As for :meth:`AsyncSharedCanBus.send` and
            :meth:`AsyncCanReceiver.receive`.
    """
    # Also in can.shared_bus: the loop differs by await only.
    received: CanFrame | None = None
    deadline = 0.0
    try:
        while True:
            frames, seconds, fresh = operation.send(received)
            left = deadline - monotonic() if seconds is None else seconds
            if fresh:
                await port.clear()
            if frames:
                port.send(frames, max(left, 0.0))
            if seconds is not None:
                deadline = monotonic() + seconds
            received = await port.receive(left) if left > 0 else None
    except StopIteration as stop:
        result: T = stop.value
        return result
    finally:
        operation.close()


def _finish(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)


def _in_thread(function: Callable[[], T]) -> asyncio.Future[T]:
    """Run a function in a daemon thread, and return a future with its result.

    The function may block forever, for example because it opens a bus. Therefore no thread of the loop's executor is
    used: a blocked thread of the executor would prevent the program from exiting.
    """
    loop = asyncio.get_running_loop()
    result: asyncio.Future[T] = loop.create_future()

    def settle(value: T | None, error: BaseException | None) -> None:
        if result.done():
            return
        if error is not None:
            result.set_exception(error)
        else:
            result.set_result(cast(T, value))

    def run() -> None:
        value: T | None = None
        raised: BaseException | None = None
        try:
            value = function()
        except Exception as error:  # noqa: BLE001 - raised in the awaiting task
            raised = error
        try:
            loop.call_soon_threadsafe(settle, value, raised)
        except RuntimeError:  # the loop was closed
            if isinstance(value, Bus):
                value.close()

    threading.Thread(target=run, name="orinkit can opening", daemon=True).start()
    return result


def _close_unused(opening: asyncio.Future[Bus]) -> None:
    """Close a bus that was opened for a cancelled task."""
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()
