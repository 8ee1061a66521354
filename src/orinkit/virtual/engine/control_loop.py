"""The controller's 8 ms cycle: what moves and runs by itself does so in steps of it, all in one order.

Everything that happens in time (the arm, the motor, programs) is a part with a ``step``. Cycles run only while a part
has something to do; when nothing has, they are skipped. Whoever looks at the controller holds :class:`ControlLoop` as a
lock, which first brings it up to the present: so two threads, a thread and a test's clock, or a scaled clock see the
same steps in the same order.

The controller's time is counted in cycles. It stands still where the controller waits for a late set-point, or where its
own program was held up (:meth:`ControlLoop.stand_still`), and is behind the clock from then on.
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
"""Seconds of a cycle, the servo cycle of RC8 controllers (RC8 4.1)."""


_TURN: Final = 0.004
"""Real seconds after which whoever brings the controller up to the present lets others have the lock."""

_LEAST_PART: Final = 5e-5


class CyclicTask(Protocol):
    """Something of the controller that goes on by itself."""

    def step(self) -> bool:
        """Do what belongs to one cycle; returns whether there is more to do."""


class ControlLoop:
    """The cycle, and the lock around everything that it changes; enter it to look at or change the controller.

    Args:
        clock: of the controller.

    Attributes:
        clock: as given.
        number: cycles since the controller was switched on.
        pace: decides how many cycles are run where some are due, ``None`` for all of them. It is given how many are due,
            1 or more, inside the lock, and returns how many to run before it is asked again; 0 to wait: it is asked
            again when the lock is entered, a period later at the latest. It may call :meth:`stand_still`.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.number = 0
        self.pace: Callable[[int], int] | None = None
        self._origin = self._base = clock.now()  # when cycle 0 was; the second is moved on where time stands still
        self._parts: list[CyclicTask] = []
        self._failed: Callable[[Exception], None] | None = None
        self._lock = threading.RLock()
        self._busy = False
        self._stepping = False
        self._waiting = False  # the pace wants to know more
        self._woken = False
        self._closed = False
        self._driver = clock.drive(self._drive)

    @property
    def seconds(self) -> float:
        """When the last cycle was, in seconds of the controller's time since it was switched on; one that was skipped, too."""
        return (self.number if self._busy else max(self.number, self._due())) * PERIOD

    @property
    def now(self) -> float:
        """Seconds of the controller's time since it was switched on."""
        passed = self.clock.now() - self._base
        return min(passed, (self.number + 1) * PERIOD) if self._busy else passed

    @property
    def busy(self) -> bool:
        """Whether cycles run."""
        return self._busy

    @property
    def late(self) -> float:
        """Seconds of the clock that have passed since the next cycle was due; negative while it is not."""
        return self.clock.now() - self._base - (self.number + 1) * PERIOD

    def add(self, *parts: CyclicTask, failed: Callable[[Exception], None]) -> None:
        """Have parts step in every cycle, in this order.

        Args:
            parts: what steps.
            failed: is told of an exception that a part has let out.
        """
        self._parts.extend(parts)
        self._failed = failed

    def wake(self) -> None:
        """Say that a part has something to do; its first step is in the next cycle. To be called inside the lock."""
        if self._closed:
            return
        self._woken = True
        if not self._busy:
            self.number = max(self.number, self._due())
            self._busy = True
        if not self._stepping:
            self._driver.wake()

    def stand_still(self, seconds: float) -> None:
        """Move the next cycle, and all behind it, so many seconds of the clock away. To be called inside the lock."""
        self._base += seconds

    def stopwatch(self, part: float) -> Callable[[], bool]:
        """Return what tells whether such a part of a cycle's real time has passed."""
        return self.clock.stopwatch(max(_LEAST_PART, part * PERIOD / self.clock.scale))

    def require_open(self) -> None:
        """Check that the controller has not been switched off: what is begun then would never end.

        Raises:
            CallError: E_ABORT.
        """
        if self._closed:
            raise error_for(hresult.E_ABORT, tr("the controller has been switched off"))

    def close(self) -> None:
        """Stop for good; the cycle that is being done is finished first."""
        self._driver.close()
        with self._lock:
            self._closed, self._busy = True, False

    def __enter__(self) -> None:
        self._lock.acquire()
        if self._busy and not self._stepping:
            try:
                self._catch_up()
            except BaseException:  # nobody would let go of the lock
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
            if self._waiting:  # not for this thread: it comes back only in case nobody else does
                return PERIOD * min(1.0, self.clock.scale)
            return max(0.0, -self.late)

    def _catch_up(self) -> None:
        behind = (self._due() - self.number) * PERIOD - self.clock.patience
        if behind > 0:  # a machine that was busy with something else: late, but no jump
            self.stand_still(behind)
        self._stepping = True
        try:
            enough = self.clock.stopwatch(_TURN)
            wanted = 0
            while self._busy and not enough():
                wanted = wanted or self._wanted()
                if wanted == 0:
                    break
                wanted -= 1
                self.number += 1
                self._woken = False
                more = self._step()
                self._busy = more or self._woken
        finally:
            self._stepping = False

    def _wanted(self) -> int:
        due = self._due() - self.number
        self._waiting = False
        if self.pace is None or due < 1:
            return max(0, due)
        try:
            wanted = self.pace(due)
        except Exception as error:
            logger.exception("pace")
            self._tell(error)
            return due
        self._waiting = wanted == 0
        return wanted

    def _step(self) -> bool:
        more = False
        for part in self._parts:
            try:
                more = part.step() or more
            except Exception as error:
                logger.exception("%s", type(part).__name__)
                self._tell(error)
        return more

    def _tell(self, error: Exception) -> None:
        try:
            if self._failed is not None:
                self._failed(error)
        except Exception:
            logger.exception("failed")
