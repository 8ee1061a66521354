"""Which cycles are run in slave mode: elastic time for a late client, and for a late server.

A real controller has a processor of its own. Here client and server are programs beside others, and the machine may hold
up either of them. So

* **the client is late** (there is no set-point for the next cycle, and the arm moves): the controller's time stands still
  until there is one, for 250 ms at most, and the set-point is counted as late. Strict time does not wait. In mode 1, where
  the arm then stops in place, the set-point is counted all the same;
* **the server is late** (cycles were not run when they were due): cycles are not made up for. One is run, and the
  controller's time is behind from then on. Set-points that have arrived count, even if nobody has read them yet: before a
  cycle goes without one, whoever reads the network is asked to (``look``). Strict time does the same, and gives a client
  that may not have had its answer yet one more period;
* **a client that goes by the clock** notices neither, and what it sends afterwards is farther away than one cycle allows.
  In a queue (modes 0 and 2) that does no harm. Where the newest set-point counts (mode 1), as many cycles are run on the
  way to it as it seems to need (:mod:`~.bridge`). If it was the server that was late, their limits are larger.

A cycle that is late by less than a quarter of a period leaves the grid of 8 ms as it is, and so does a set-point. A client that is
always a little late is so by more each time, and is counted in the end.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final, Protocol

from orinkit.core.i18n import tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop

LONGEST_WAIT: Final = 0.25
"""Real seconds that a late set-point is waited for."""

_ON_TIME: Final = PERIOD / 4
_LONGEST_LOOK: Final = 5.0  # real seconds; whoever has not answered by then does not read any more
_AWAKE: Final = 2 * PERIOD  # between two looks at the time; what is beyond that, this program was held up
_FELT: Final = 4  # cycles: a set-point that was not sent in time is missed when the three in the buffer are used up
_AFTERWARDS: Final = 2  # cycles behind those that led to a set-point
_MOST_OWED: Final = 0.25  # s
_MEMORY: Final = 125  # cycles
_NEARLY: Final = 0.5  # part of a period
_CASES: Final = 10_000  # late set-points that are remembered one by one

DrainInput = Callable[[Callable[[], None]], None]
"""Calls back when everything that has arrived by now has been handled (:class:`orinkit.cao.provider.ClientInfo`)."""


def waited_in_vain() -> str:
    """Return the detail of the error that ends the wait for a set-point."""
    milliseconds = round(LONGEST_WAIT * 1e3)
    return tr("no set-point for {milliseconds} ms", milliseconds=milliseconds)


def not_waited() -> str:
    """Return the detail of the error that a late set-point is with strict time."""
    return tr("no set-point for this cycle; strict time")


def left_late(late: Lateness, *, strict: bool) -> str:
    """Return what the log says at the end of a stream with late set-points."""
    if strict:
        return tr("{late}: the arm stopped in place", late=late)
    return tr(
        "{late}. A real controller would not have waited. With --strict-time this one does not wait either", late=late
    )


class PacedSlave(Protocol):
    """What the cycles are run for: slave mode.

    Attributes:
        overwrites: whether the newest set-point counts (mode 1).
        moving: whether the command moves.
        starving: whether the next cycle needs a set-point and there is none.
        lenient: for how many cycles the limits are larger.
    """

    lenient: int

    @property
    def overwrites(self) -> bool:
        """Whether the newest set-point counts."""

    @property
    def moving(self) -> bool:
        """Whether the command moves."""

    @property
    def starving(self) -> bool:
        """Whether the next cycle needs a set-point and there is none."""

    def bridge(self, most: int) -> int:
        """Lead to the set-point in at most so many cycles; returns in how many, 0 where there is none."""


class _Cases:
    """Late set-points: the latest ones one by one, the earlier ones as sums."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_CASES)
        self._all = Lateness()

    def add(self, seconds: float) -> None:
        """Count one."""
        self._seconds.append(seconds)
        count, longest, total = self._all.count, self._all.longest, self._all.total
        self._all = Lateness(count + 1, max(longest, seconds), total + seconds)

    def lateness(self, leave_out: int) -> Lateness:
        """Return how late they were, but for the first ones."""
        if leave_out == 0:
            return self._all
        count = max(0, self._all.count - leave_out)
        known = list(self._seconds)[max(0, len(self._seconds) - count) :]
        return Lateness(count, max(known, default=0.0), sum(known))


class CyclePacer:
    """The pace of :class:`~orinkit.virtual.engine.control_loop.ControlLoop` while slave mode is on.

    Args:
        cycles: the controller's cycle.
        slave: what they are run for.
        drain_input: of the client that sends set-points; ``None`` where everything that it has sent has been handled.
        strict: a late set-point is not waited for.
    """

    def __init__(self, cycles: ControlLoop, slave: PacedSlave, drain_input: DrainInput | None, *, strict: bool) -> None:
        self._cycles = cycles
        self._slave = slave
        self._look = None if cycles.clock.manual else drain_input  # by hand: time passes when all is handled
        self._strict = strict
        self._longest_wait = LONGEST_WAIT  # of the present wait
        self._late_until = 0  # number of the cycle until which the client may feel that the server was late
        self._question: object | None = None  # the look that has been asked for
        self._asked = 0.0
        self._seen = False
        self._waited: float | None = None  # real s that the client has been waited for; None while it is not
        self._noted = 0.0  # when that was noted
        self._missed: float | None = None  # when the set-point was due that strict time has not waited for (mode 1)
        self._cases = _Cases()
        self._owed = 0.0  # s by which the controller's time is behind, as a client that goes by the clock will notice
        self._own = 0.0  # s of these for which the server is to blame
        self._forget_at = 0  # number of the cycle after which that is forgotten

    def __call__(self, due: int) -> int:
        """Return how many of the cycles that are due to run now; 0 to wait."""
        slave = self._slave
        if (slave.starving or (slave.overwrites and (slave.moving or due > 1))) and not self._looked():
            return 0
        self._question = None
        late = self._server_late()
        if late > _ON_TIME and self._waited is None:
            self._late_until = self._cycles.number + _FELT
        if slave.starving:
            if self._wait():
                return 0
            self._go_on(self._longest_wait)
            late = self._server_late()
            if self._strict and slave.overwrites and self._missed is None:
                self._missed = self._cycles.clock.now() - self._cycles.late
        count = self._lead(late) if slave.overwrites and not slave.starving else 1
        behind = late - (count - 1) * PERIOD
        if behind > _ON_TIME or count > due:
            self._fall_behind(behind, own=True)
        return count

    def resume(self) -> None:
        """Stop waiting: there is a set-point, or none is wanted any more. The next cycle is due now."""
        if self._missed is not None:
            self._cases.add((self._cycles.clock.now() - self._missed) / self._cycles.clock.scale)
            self._missed = None
        if self._waited is not None:
            self._note()
            self._go_on(math.inf)

    def lateness(self, leave_out: int = 0) -> Lateness:
        """Return how late set-points were, but for the first ones."""
        return self._cases.lateness(max(0, leave_out))

    # --- a late client ------------------------------------------------------------------------------------------

    def _wait(self) -> bool:
        """Have the controller's time stand still; returns whether to wait on."""
        if self._waited is not None:
            self._note()
            return self._waited < self._longest_wait
        clock, late = self._cycles.clock, self._cycles.late
        self._longest_wait = LONGEST_WAIT
        if self._strict:
            self._longest_wait = PERIOD / clock.scale if self._cycles.number <= self._late_until else 0.0
        if self._longest_wait == 0.0:
            return False
        self._waited = late / clock.scale if clock.manual or late <= _ON_TIME else 0.0
        self._noted = clock.now()
        return self._waited < self._longest_wait

    def _note(self) -> None:
        """Add the time since the last note; if this program itself was held up meanwhile, that is not the client's fault."""
        assert self._waited is not None
        clock = self._cycles.clock
        now = clock.now()
        passed = (now - self._noted) / clock.scale
        self._waited += passed if clock.manual else min(passed, _AWAKE)
        self._noted = now

    def _go_on(self, most: float) -> None:
        """Let time pass again, after so many real seconds at most; what is beyond them has not been spent waiting."""
        if self._waited is None:
            return
        waited, self._waited = min(self._waited, most), None
        clock, late = self._cycles.clock, self._cycles.late
        if waited * clock.scale <= _ON_TIME and waited < LONGEST_WAIT:
            return
        if not self._strict:
            self._cases.add(waited)
        theirs = min(late, waited * clock.scale)
        self._fall_behind(theirs)
        if not clock.manual:
            self._fall_behind(late - theirs, own=True)

    # --- a late server ------------------------------------------------------------------------------------------

    def _looked(self) -> bool:
        """Ask for a look, if nobody has; returns whether it is over."""
        if self._look is None:
            return True
        clock = self._cycles.clock
        if self._question is None:
            self._question = question = object()
            self._asked, self._seen = clock.now(), False
            self._look(lambda: self._answered(question))
        if not self._seen and (clock.now() - self._asked) / clock.scale > _LONGEST_LOOK:
            self._look, self._late_until = None, self._cycles.number + _FELT
        return self._seen or self._look is None

    def _answered(self, question: object) -> None:
        if question is self._question:
            self._seen = True
            if self._cycles.clock.now() - self._asked > _ON_TIME:
                self._late_until = self._cycles.number + _FELT
        with self._cycles:  # runs what is due
            pass

    def _server_late(self) -> float:
        """Return by how many seconds of the clock the next cycle is late; a clock that is moved by hand is never late."""
        return 0.0 if self._cycles.clock.manual else self._cycles.late

    def _fall_behind(self, seconds: float, *, own: bool = False) -> None:
        """Have the controller's time be behind by so much more; of a time long past nobody knows any more.

        Args:
            seconds: of the clock.
            own: the server is to blame, not the client.
        """
        self._owed = min(max(0.0, self._owed + seconds), _MOST_OWED)
        self._own = min(max(0.0, self._own + seconds * own), self._owed)
        self._forget_at = self._cycles.number + _MEMORY
        self._cycles.stand_still(seconds)

    def _lead(self, late: float) -> int:
        """Return in how many cycles to go to the set-point of mode 1."""
        if self._cycles.number > self._forget_at:
            self._owed = self._own = 0.0
        most = 1 + int((self._owed + late) / PERIOD + _NEARLY)
        count = self._slave.bridge(most) if most > 1 else 1
        if count > 1 and self._own + late > _NEARLY * PERIOD:
            self._slave.lenient = count + _AFTERWARDS
        return max(1, count)
