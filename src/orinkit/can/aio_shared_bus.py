"""One CAN bus shared by many tasks of an event loop; the twin is :mod:`orinkit.can.shared_bus`.

The loop watches the bus where it has a descriptor that tells; elsewhere (virtual, most drivers of Windows, python-can's
serial) a thread of the line's own reads it and hands over what came. Frames are taken from the bus whether anybody waits
for them or not. Everything is to be called in the event loop that the line was made in.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Final, Protocol, Self, TypeVar, cast

from orinkit.can.bus import Bus
from orinkit.can.frame import CanFrame, CanOperation, checked
from orinkit.can.reader_thread import BusReader
from orinkit.can.shared_bus import SIZE, Accepts
from orinkit.core.errors import ConnectionLost, OrinError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress
from orinkit.transport.link_errors import closed, other_loop

T = TypeVar("T")
_BURST: Final = 64  # frames taken at a time, before others in the loop have their turn
_DRAINED: Final = 10_000  # frames that clearing takes at most
_PATIENCE: Final = 0.05  # s that the loop waits for an interface to take a frame
_LEAVING: Final = 2.0  # s that the thread gets to end
_GLANCES: Final = 40  # until the thread has handed over what has arrived; no time, for the machine may stand still
_GLANCE: Final = 1e-3  # s; uvloop waits for no less


class AsyncFrameLink(Protocol):
    """What an operation is carried out over in asyncio: :class:`AsyncCanReceiver`."""

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order."""

    async def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this port, ``None`` when the seconds have passed."""

    async def clear(self) -> None:
        """Drop what has arrived for this port."""


class AsyncSharedCanBus:
    """A bus that many ports share, in one event loop; it is to be made there.

    Args:
        bus: is this line's from then on: nobody else receives from it. It is closed with the line if it is its own.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._ports: tuple[AsyncCanReceiver, ...] = ()
        self._closed = False
        self._broken: str | None = None  # why
        self._watched = -1  # descriptor that the loop watches
        self._thread: BusReader | None = None
        self._leaving: BusReader | None = None
        self._reopening = asyncio.Lock()
        self._begin()

    @classmethod
    async def open(cls, address: CanAddress) -> Self:
        """Open a bus and a line over it; another thread does what takes long in that.

        Raises:
            InvalidAddress, ConnectFailed, MissingExtra: as :func:`orinkit.can.bus.open_bus`.
        """
        opening = _in_thread(lambda: Bus.open(address))
        try:
            return cls(await asyncio.shield(opening))
        except asyncio.CancelledError:
            opening.add_done_callback(_close_unused)
            raise

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

    def port(self, accepts: Accepts, *, size: int = SIZE) -> AsyncCanReceiver:
        """Return a port, which gets each frame from now on that it accepts; others may get the same frame.

        Args:
            accepts: whether a frame is for it; must not raise anything.
            size: frames that wait in it; of more the oldest are dropped.
        """
        port = AsyncCanReceiver(self, accepts, size)
        self._ports += (port,)
        return port

    def forget(self, port: AsyncCanReceiver) -> None:
        """Give a port no more frames, as :meth:`AsyncCanReceiver.close`."""
        self._ports = tuple(each for each in self._ports if each is not port)
        port.closed = True
        port.frames.clear()
        port.wake()

    def check(self, port: AsyncCanReceiver | None = None) -> None:
        """Raise what a call on the line, or on a port, ends with if it is closed or broken."""
        if self._closed or (port is not None and port.closed):
            raise closed()
        if self._broken is not None:
            raise ConnectionLost(self._broken)
        if asyncio.get_running_loop() is not self._loop:
            raise other_loop()

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, in order. The loop waits while the interface takes them, which most do at once.

        Args:
            frames: to send; all of them are looked at before the first is sent.
            seconds: that each may wait until the interface takes it, at most 50 ms.

        Raises:
            InvalidValue: one cannot be a frame; none was sent.
            TransportError: one was not taken in time, nor were those behind it; the line goes on.
            ConnectionLost: the bus is gone.
            ConnectionClosed: the line was closed.
        """
        for frame in frames:
            checked(frame)
        self.check()
        try:
            for frame in frames:
                self._bus.send(frame, min(seconds, _PATIENCE))
        except ConnectionLost as error:
            self._break(error)
            raise

    # --- receiving ----------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        if self._bus.watchable:
            try:
                self._loop.add_reader(self._bus.fileno(), self._readable)
            except (NotImplementedError, OSError, ValueError):  # Windows; a file that cannot be watched
                pass
            else:
                self._watched = self._bus.fileno()
                return
        self._thread = BusReader(self._bus, self._loop, self._came)
        self._thread.start()

    def _end(self) -> None:
        """Stop reading; the thread is about to end."""
        if self._watched >= 0:
            self._loop.remove_reader(self._watched)
            self._watched = -1
        if self._thread is not None:
            self._thread.stopping = True
            self._leaving, self._thread = self._thread, None

    def _readable(self) -> None:
        if self._watched >= 0 and self._take(_BURST):
            self._loop.call_soon(self._readable)  # python-can may have read on: the descriptor does not tell of that

    def _take(self, most: int) -> bool:
        """Hand out what waits on the bus; returns whether more may be waiting."""
        try:
            for _ in range(most):
                frame = self._bus.receive(0.0)
                if frame is None:
                    return False
                self._hand_out(frame)
        except ConnectionLost as error:
            self._break(error)
            return False
        return True

    def _came(self) -> None:
        """The thread has frames, or has ended."""
        thread = self._thread
        if thread is None:
            return
        for frame in thread.taken():
            self._hand_out(frame)
        if thread.error is not None:
            self._break(thread.error)

    def _hand_out(self, frame: CanFrame) -> None:
        for port in self._ports:
            if port.accepts(frame):
                port.put(frame)

    async def settle(self) -> None:
        """Hand out all that has arrived until now."""
        if self._watched >= 0:
            self._take(_DRAINED)
            return
        for _ in range(_GLANCES):
            if self._thread is None:
                return
            # in this order: what was taken is held until it is among the thread's frames
            quiet = not self._bus.waiting() and not self._bus.holds and self._thread.quiet
            self._came()
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
        """Open a bus again that was lost; ports stay valid, and are empty. Another thread does what takes long in that.

        Where several tasks call it, one of them opens the bus and the others wait for that; it does nothing to a line that
        is not broken.

        Args:
            force: close and open it although it is not known to be broken; waits end with ConnectionLost.

        Raises:
            InvalidValue: the bus was not opened by an address.
            InvalidAddress, ConnectFailed, MissingExtra: as :func:`orinkit.can.bus.open_bus`; the line is still
                broken.
            ConnectionClosed: the line was closed.
        """
        first = not self._reopening.locked()
        async with self._reopening:
            self._check_open()
            if self._broken is None and not (force and first):
                return
            self._bus.check_reopening()
            self._broken = self._broken or tr("{bus} is being opened again", bus=self)
            self._wake_all()
            await self._see_off()
            await self._open_again()
            if self._closed:  # meanwhile
                self._bus.close()
            self._check_open()
            for port in self._ports:
                port.frames.clear()
            self._broken = None
            self._begin()

    def _check_open(self) -> None:
        if self._closed:
            raise closed()

    async def _open_again(self) -> None:
        opening = _in_thread(self._bus.reopen)
        try:
            await asyncio.shield(opening)
        except asyncio.CancelledError:
            await asyncio.wait([opening])  # the bus cannot be used before; a second cancellation goes through
            raise

    async def _see_off(self) -> None:
        """Stop reading, and wait for the thread to notice."""
        self._end()
        if self._leaving is not None:
            await self._leaving.left(_LEAVING)

    async def close(self) -> None:
        """Close the line; waits end with ConnectionClosed at once. May be called again."""
        if self._closed:
            return
        self._closed = True
        self._wake_all()
        try:
            await self._see_off()
        finally:
            self._bus.close()


class AsyncCanReceiver:
    """What one user has of a line: the frames that it accepts. :meth:`AsyncSharedCanBus.port` makes one.

    Attributes:
        line: it belongs to.
        accepts: whether a frame is for it.
        frames: that wait.
        dropped: frames that were dropped because too many waited.
        closed: whether it was closed.
    """

    def __init__(self, line: AsyncSharedCanBus, accepts: Accepts, size: int) -> None:
        self.line = line
        self.accepts = accepts
        self.frames: deque[CanFrame] = deque(maxlen=size)
        self.dropped = 0
        self.closed = False
        self._waiters: list[asyncio.Future[None]] = []

    def put(self, frame: CanFrame) -> None:
        """Keep a frame."""
        self.dropped += len(self.frames) == self.frames.maxlen
        self.frames.append(frame)
        if self._waiters:
            self.wake()

    def wake(self) -> None:
        """Have everybody who waits look again."""
        for waiter in self._waiters:
            if not waiter.done():
                waiter.set_result(None)

    def send(self, frames: Sequence[CanFrame], seconds: float) -> None:
        """Send frames, as :meth:`AsyncSharedCanBus.send`; they are sent when it returns, so no task can be cancelled in it."""
        self.line.send(frames, seconds)

    async def receive(self, seconds: float) -> CanFrame | None:
        """Return the next frame for this port, ``None`` when the seconds have passed.

        0 s takes what the line has handed out already. One that is cancelled loses no frame.

        Raises:
            ConnectionLost: the bus is gone, and was not opened again.
            ConnectionClosed: the line or the port was closed.
            TransportError: this is another event loop.
        """
        end = monotonic() + seconds
        while True:
            self.line.check(self)
            if self.frames:
                return self.frames.popleft()
            left = end - monotonic()
            if left <= 0:
                return None
            await self._change(left)

    async def _change(self, seconds: float) -> None:
        """Wait until something has changed, or the time is up."""
        loop = asyncio.get_running_loop()
        waiter = loop.create_future()
        self._waiters.append(waiter)
        alarm = loop.call_later(seconds, _finish, waiter)
        try:
            await waiter
        finally:
            alarm.cancel()
            self._waiters.remove(waiter)

    async def clear(self) -> None:
        """Drop what has arrived for this port on the bus until now; other ports get theirs.

        What arrives in this very moment, or waits in an adapter, cannot be told from what comes later.

        Raises:
            ConnectionLost, ConnectionClosed: as :meth:`receive`.
        """
        self.line.check(self)
        await self.line.settle()
        self.line.check(self)
        self.frames.clear()

    def close(self) -> None:
        """Get no more frames; a wait ends at once. May be called again."""
        self.line.forget(self)


async def arun_can(operation: CanOperation[T], port: AsyncFrameLink) -> T:
    """Carry out an operation in asyncio and return its result.

    One that is cancelled leaves the port usable: what was not received yet is dropped by the next operation that wants to
    begin afresh.

    Args:
        operation: what to do.
        port: to do it over.

    Raises:
        ConnectionLost, ConnectionClosed, TransportError: as :meth:`AsyncSharedCanBus.send` and :meth:`AsyncCanReceiver.receive`.
    """
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
    """Return what will be the result of a function that may block for good, as opening a bus may: in a daemon thread.

    A thread of the loop's executor would keep the program from ending.
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
        except Exception as error:  # noqa: BLE001 - it is raised where the result is awaited
            raised = error
        try:
            loop.call_soon_threadsafe(settle, value, raised)
        except RuntimeError:  # the loop has ended
            if isinstance(value, Bus):
                value.close()

    threading.Thread(target=run, name="orinkit can opening", daemon=True).start()
    return result


def _close_unused(opening: asyncio.Future[Bus]) -> None:
    """Close a bus that was opened for a task that was cancelled."""
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()
