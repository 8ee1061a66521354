"""The control cycle of 8 ms, in which all time-dependent parts of the controller are stepped in a fixed order.

Everything that depends on time (the arm, the motor, programs) is a :class:`CyclicTask` with a ``step``. Cycles run only
while a task is busy; idle cycles are skipped. All access to the controller goes through :class:`ControlLoop`, which is
a lock: entering the lock first runs the due cycles. The order of steps is therefore the same with several threads, with
a test's manual clock and with a scaled clock.

The controller's time is counted in cycles. This time stops while the controller waits for a late set-point, and also if
the server process was delayed (:meth:`ControlLoop.delay`). Afterwards it lags behind the clock. It also stops while a
motion of a program is being planned in another thread (:meth:`ControlLoop.suspend`): planning takes no time of the
controller, so that the order of events does not depend on the speed of the machine.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final, Protocol

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.clock import Clock

logger = logging.getLogger("orinkit.rc8")

PERIOD: Final = 0.008
"""Length of a cycle in seconds: the servo cycle of RC8 controllers (RC8 4.1)."""


_MAX_LOCK_TIME: Final = 0.004
"""Real seconds for which a thread runs due cycles before it releases the lock for other threads."""

_MIN_TIME_BUDGET: Final = 5e-5  # s


class CyclicTask(Protocol):
    """A time-dependent part of the controller."""

    def step(self) -> bool:
        """Run one cycle; return True if the task is still busy."""


class ControlLoop:
    """The control cycle, and the lock of the controller; enter this lock to read or change the controller's state.

    Args:
        clock: The controller's clock.

    Attributes:
        clock: The controller's clock.
        number: Number of the last cycle that was run. All cycles since the controller was switched on are counted,
            including skipped ones.
        pace: Callback that returns how many of the due cycles to run before it is called again; ``None`` to run all of
            them. It is called inside the lock with the number of due cycles, 1 or more. If it returns 0, no cycle is
            run, and it is called again when the lock is next entered, at the latest one period later. It may call
            :meth:`delay`.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.number = 0
        self.pace: Callable[[int], int] | None = None
        self._base = clock.first_cycle(PERIOD)  # time of cycle 0; delay() moves it
        self._tasks: list[CyclicTask] = []
        self._on_error: Callable[[Exception], None] | None = None
        self._lock = threading.RLock()
        self._busy = False
        self._stepping = False
        self._waiting = False  # the pace has returned 0
        self._suspended = 0
        self._woken = False
        self._closed = False
        self._driver = clock.drive(self._drive)

    @property
    def last_cycle_time(self) -> float:
        """The controller's time of the last cycle, run or skipped, in seconds since the controller was switched on."""
        return (self.number if self._busy else max(self.number, self._due())) * PERIOD

    @property
    def now(self) -> float:
        """The controller's time in seconds since it was switched on."""
        passed = self.clock.now() - self._base
        return min(passed, (self.number + 1) * PERIOD) if self._busy else passed

    @property
    def busy(self) -> bool:
        """True while cycles run."""
        return self._busy

    @property
    def overdue(self) -> float:
        """Seconds of the clock since the next cycle was due; negative if it is not due yet."""
        return self.clock.now() - self._base - (self.number + 1) * PERIOD

    def add(self, *parts: CyclicTask, on_error: Callable[[Exception], None]) -> None:
        """Add tasks that are stepped in every cycle, in this order.

        Args:
            parts: The tasks.
            on_error: Callback invoked with each exception that a task raises.
        """
        self._tasks.extend(parts)
        self._on_error = on_error

    def wake(self) -> None:
        """Start cycles because a task has become busy; it is first stepped in the next cycle. Call inside the lock."""
        if self._closed:
            return
        self._woken = True
        if not self._busy:
            self.number = max(self.number, self._due())
            self._busy = True
        if not self._stepping:
            self._driver.wake()

    def delay(self, seconds: float) -> None:
        """Delay the next cycle and all later ones by ``seconds`` of the clock. Call this method inside the lock."""
        self._base += seconds

    def suspend(self) -> None:
        """Run no cycles until :meth:`resume` has been called as many times. Call this method inside the lock."""
        self._suspended += 1

    def resume(self) -> None:
        """Continue to run cycles after :meth:`suspend`; the cycles that are due are then caught up."""
        with self._lock:
            self._suspended -= 1
            if self._busy and not self._stepping:
                self._driver.wake()

    def time_budget(self, part: float) -> Callable[[], bool]:
        """Return a function that returns True once the fraction ``part`` of a cycle has passed in real time."""
        return self.clock.time_budget(max(_MIN_TIME_BUDGET, part * PERIOD / self.clock.scale))

    def require_open(self) -> None:
        """Raise an error if the controller has been switched off, because a new operation would never end.

        Raises:
            CallError: E_ABORT if the controller has been switched off.
        """
        if self._closed:
            raise error_for(hresult.E_ABORT, tr("the controller has been switched off"))

    def close(self) -> None:
        """Stop permanently after the cycle in progress has ended."""
        self._driver.close()
        with self._lock:
            self._closed, self._busy = True, False

    def __enter__(self) -> None:
        self._lock.acquire()
        if self._busy and not self._stepping:
            try:
                self._catch_up()
            except BaseException:  # __exit__ is not called if __enter__ raises
                self._lock.release()
                raise

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def _due(self) -> int:
        return int((self.clock.now() - self._base) / PERIOD + 1e-9)

    def _drive(self) -> float | None:
        with self:
            if not self._busy:
                return None
            if self._waiting or self._suspended:  # another thread usually resumes the cycles; this is the fallback
                return PERIOD * min(1.0, self.clock.scale)
            return max(0.0, -self.overdue)

    def _catch_up(self) -> None:
        due = self._due() - self.number
        if due < 1:  # usual for a call between two cycles
            self._waiting = False
            return
        behind = due * PERIOD - self.clock.patience
        if behind > 0:  # after a long delay of the machine, the missed cycles are not run
            self.delay(behind)
        self._stepping = True
        try:
            time_up = self.clock.time_budget(_MAX_LOCK_TIME)
            count = 0
            while self._busy and not self._suspended and not time_up():
                count = count or self._cycles_to_run()
                if count == 0:
                    break
                count -= 1
                self.number += 1
                self._woken = False
                more = self._step()
                self._busy = more or self._woken
        finally:
            self._stepping = False

    def _cycles_to_run(self) -> int:
        due = self._due() - self.number
        self._waiting = False
        if self.pace is None or due < 1:
            return max(0, due)
        try:
            count = self.pace(due)
        except Exception as error:
            logger.exception("pace")
            self._report(error)
            return due
        self._waiting = count == 0
        return count

    def _step(self) -> bool:
        more = False
        for task in self._tasks:
            try:
                more = task.step() or more
            except Exception as error:
                logger.exception("%s", type(task).__name__)
                self._report(error)
        return more

    def _report(self, error: Exception) -> None:
        try:
            if self._on_error is not None:
                self._on_error(error)
        except Exception:
            logger.exception("on_error")
