"""A clock whose devices are all driven by one thread: :class:`SharedClock`, for many virtual controllers in one process.

With a plain :class:`~orinkit.virtual.clock.Clock`, each device has a thread of its own. With a hundred devices, most of
their time would be spent on switching between these threads. The cycles of the devices also begin together, in
:data:`PHASES` groups: otherwise, the thread would wake up for each device, which takes longer than the cycle of a
device. A single group would hold up the last devices, and the event loop, longer than necessary.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from typing import Final

from orinkit.virtual.clock import IDLE_TIME, JOIN_TIMEOUT, SHORTEST_PAUSE, Clock, ClockDriver
from orinkit.virtual.workers import Workers

logger = logging.getLogger("orinkit.rc8")

LONG: Final = 0.02
"""Seconds after which another thread takes over the other devices, if the call of one device has not ended."""
PHASES: Final = 4
"""Times within a period at which cycles of devices begin."""
WORKERS: Final = 4
"""Number of threads for each kind of long work. The computing threads take turns with the event loop and the cycles."""
_FEW: Final = 16  # entries of the heap that are never cleaned up


class SharedClock(Clock):
    """Real time, or a multiple of it, for several devices, all of which one thread drives.

    Their long work (planning, files, compiling) is done by a few threads that they also share.

    Pass the same object to each device, for example ``VirtualRC8(clock=shared)``. The devices have the same time, and
    nothing else in common: each has its own state and its own lock. The device that is due first is called first, so a
    device that catches up a delay does not hold up the others. An exception of one device is logged; it does not affect
    the others. If a call takes longer than :data:`LONG`, another thread takes over the other devices. The threads exist
    only while a device has something to do.

    Args:
        scale: Seconds of the devices per real second, as for :class:`~orinkit.virtual.clock.Clock`.

    Raises:
        ValueError: If the scale is out of range.
    """

    def __init__(self, scale: float = 1.0) -> None:
        super().__init__(scale)
        self._scheduler = _Scheduler(scale)
        self._workers: dict[str, Workers] = {}

    def first_cycle(self, period: float) -> float:
        """Return the present time, rounded down to a quarter of ``period``.

        Many devices are then due at the same time, so that the thread wakes up :data:`PHASES` times in each period, not
        once for each device.
        """
        phase = period / PHASES
        return self.now() // phase * phase

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        """Drive a device with the thread of this clock."""
        return _SharedDriver(self._scheduler, advance)

    def workers(self, name: str) -> Workers:
        """Return the threads with this name, at most :data:`WORKERS`, which all devices share."""
        return self._workers.setdefault(name, Workers(name, WORKERS))


class _SharedDriver(ClockDriver):
    """One device of a scheduler; the lock of the scheduler protects the attributes.

    Attributes:
        advance: the callback of the device.
        entry: number of the valid entry in the heap, 0 if there is none; entries with other numbers are skipped.
        woken: True if the device was woken after its last call had begun.
        caller: the thread in which a call of the device is in progress.
        closed: True if the device is not called any more.
    """

    def __init__(self, scheduler: _Scheduler, advance: Callable[[], float | None]) -> None:
        self.advance = advance
        self.entry = 0
        self.woken = False
        self.caller: threading.Thread | None = None
        self.closed = False
        self._scheduler = scheduler

    def wake(self) -> None:
        self._scheduler.wake(self)

    def close(self) -> None:
        self._scheduler.remove(self)


class _Scheduler:
    """Calls devices when they are due, in one thread (:class:`SharedClock`)."""

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)  # the next device is due earlier than before
        self._ended = threading.Condition(self._lock)  # the call of a closed device has ended
        self._due: list[tuple[float, int, _SharedDriver]] = []
        self._numbers = itertools.count(1)
        self._valid = 0  # number of valid entries in the heap
        self._runner: threading.Thread | None = None  # the thread that calls devices
        self._began: float | None = None  # time at which the call in progress began
        self._watched = False

    def wake(self, device: _SharedDriver) -> None:
        """Call a device as soon as possible."""
        with self._lock:
            if device.closed:
                return
            device.woken = True
            if device.caller is None:  # otherwise it is called again after the call in progress
                self._enqueue(device, time.monotonic())

    def remove(self, device: _SharedDriver) -> None:
        """Call a device no more, and wait for the call in progress unless it is the caller."""
        with self._lock:
            device.closed = True
            self._forget(device)
            if device.caller is not threading.current_thread():
                self._ended.wait_for(lambda: device.caller is None, JOIN_TIMEOUT)

    # --- the heap; call these inside the lock ---------------------------------------------------------------------

    def _enqueue(self, device: _SharedDriver, when: float) -> None:
        self._forget(device)
        first = not self._due or when < self._due[0][0]
        device.entry = next(self._numbers)
        self._valid += 1
        heappush(self._due, (when, device.entry, device))
        if len(self._due) > _FEW + 2 * self._valid:
            self._due = [each for each in self._due if each[1] == each[2].entry]
            heapify(self._due)
        if self._runner is None:
            self._start()
        elif first:
            self._changed.notify()

    def _forget(self, device: _SharedDriver) -> None:
        if device.entry:
            device.entry = 0
            self._valid -= 1

    def _first_due(self) -> float | None:
        """Return the time at which a device is due next; ``None`` if there is no such device."""
        while self._due and self._due[0][1] != self._due[0][2].entry:
            heappop(self._due)
        return self._due[0][0] if self._due else None

    # --- the threads ------------------------------------------------------------------------------------------------

    def _start(self) -> None:
        self._runner = threading.Thread(target=self._run, name="orinkit-devices", daemon=True)
        self._began = None
        self._runner.start()
        if not self._watched:
            self._watched = True
            threading.Thread(target=self._watch, name="orinkit-devices-watch", daemon=True).start()

    def _run(self) -> None:
        thread = threading.current_thread()
        while (device := self._next(thread)) is not None:
            pause: float | None = None
            try:
                pause = device.advance()
            except Exception:  # the device is called again if it is woken
                logger.exception("error in a cycle of a device")
            self._end(device, pause, thread)

    def _next(self, thread: threading.Thread) -> _SharedDriver | None:
        """Wait until a device is due, and return it; return ``None`` if the thread must end instead."""
        with self._lock:
            while self._runner is thread:
                when = self._first_due()
                if when is None:
                    if not self._changed.wait(IDLE_TIME) and self._first_due() is None and self._runner is thread:
                        self._runner = None
                    continue
                now = time.monotonic()
                if when <= now:
                    device = heappop(self._due)[2]
                    self._forget(device)
                    device.woken = False
                    device.caller = thread
                    self._began = now
                    return device
                self._changed.wait(min(when - now, threading.TIMEOUT_MAX))
            return None

    def _end(self, device: _SharedDriver, pause: float | None, thread: threading.Thread) -> None:
        """Record the end of a call; ``pause`` is its result."""
        with self._lock:
            device.caller = None
            if self._runner is thread:
                self._began = None
            if device.closed:
                self._ended.notify_all()
            elif device.woken:
                self._enqueue(device, time.monotonic())
            elif pause is not None:
                self._enqueue(device, time.monotonic() + max(pause / self._scale, SHORTEST_PAUSE))

    def _watch(self) -> None:
        """Start another thread for the other devices whenever the call of one device takes too long."""
        while True:
            time.sleep(LONG)
            with self._lock:
                if self._runner is None:
                    self._watched = False
                    return
                began, due = self._began, self._first_due()
                now = time.monotonic()
                if began is not None and due is not None and now - began > LONG and due <= now:
                    self._start()  # the thread of the long call ends after this call
