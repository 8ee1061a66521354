"""How many cycles are run in slave mode when they are due: a server that is late must not be the client's fault.

The controller here is a program beside others: its clock's thread, or the one that reads the network, may be late. A real
controller would have answered its client meanwhile, and had its set-points. So

* set-points that have arrived count, also where nobody has read them yet: before a cycle goes without one, whoever reads
  the network is asked to (``look``), and the cycle waits for that;
* where set-points are queued (modes 0 and 2) cycles are not made up for: one is run, and the controller's time is late;
* where the newest one counts (mode 1) as many are run as the way to it seems to need (:mod:`~.bridge`);
* where a cycle, or whoever answers the client, was late lately and there is no new set-point, the client may not have had
  its answer: it gets a period, once.

A cycle that is late by less than a quarter of a period leaves the grid of 8 ms as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from orinkit.virtual.rc8.cycle import PERIOD, Cycles

_ON_TIME: Final = PERIOD / 4
_LONGEST_LOOK: Final = 5.0  # real seconds; whoever has not answered by then does not read any more
_FELT: Final = 4  # cycles: a set-point that was not sent in time is missed when the three in the buffer are used up
_AFTERWARDS: Final = 2  # cycles behind those that were late
_MOST_OWED: Final = 0.25  # s
_MEMORY: Final = 125  # cycles
_NEARLY: Final = 0.5  # part of a period

Look = Callable[[Callable[[], None]], None]
"""Calls back when everything that has arrived by now has been handled (:class:`orinkit.cao.provider.ClientInfo`)."""


class Paced(Protocol):
    """What the cycles are run for: slave mode.

    Attributes:
        overwrites: whether the newest set-point counts (mode 1).
        starving: whether the next cycle needs a set-point and there is none.
        moving: whether the command moves.
        idling: whether the next cycle would stop the command, for there is nothing new.
        lenient: for how many cycles the limits are larger.
    """

    lenient: int

    @property
    def overwrites(self) -> bool:
        """Whether the newest set-point counts."""

    @property
    def starving(self) -> bool:
        """Whether the next cycle needs a set-point and there is none."""

    @property
    def moving(self) -> bool:
        """Whether the command moves."""

    @property
    def idling(self) -> bool:
        """Whether the next cycle would stop the command, for there is nothing new."""

    def bridge(self, most: int) -> int:
        """Lead to the set-point in at most so many cycles; returns in how many, 0 where there is none."""


class Pace:
    """The pace of :class:`~orinkit.virtual.rc8.cycle.Cycles` while slave mode is on.

    Args:
        cycles: the controller's cycle.
        slave: what they are run for.
        look: of the client that sends set-points; ``None`` where everything that it has sent has been handled.
    """

    def __init__(self, cycles: Cycles, slave: Paced, look: Look | None) -> None:
        self._cycles = cycles
        self._slave = slave
        self._look = look
        self._question: object | None = None  # the look that has been asked for
        self._asked = 0.0
        self._seen = False
        self._spared = False
        self._late_until = 0  # number of the cycle until which the client may feel that something was late
        self._ping: float | None = None  # when whoever answers the client was last asked whether it is awake
        self._owed = 0.0  # s by which the controller's time is late, as a client that goes by the clock will notice
        self._forget_at = 0  # number of the cycle after which that is forgotten

    def __call__(self, due: int) -> int:
        """Return how many of the cycles that are due to run now; 0 to wait."""
        slave = self._slave
        if (slave.starving or (slave.overwrites and (slave.moving or due > 1))) and not self._looked():
            return 0
        self._question = None
        late = self._cycles.late
        self._take_pulse(late)
        if slave.idling and self._cycles.number <= self._late_until and not self._spared and self._seen:
            self._spare(late + PERIOD)
            return 0
        self._spared = False
        count = self._lead(late) if slave.overwrites and not slave.idling else 1
        behind = late - (count - 1) * PERIOD
        if behind > _ON_TIME or count > due:
            self._owe(behind)
            self._cycles.put_off(count)
        return count

    def _take_pulse(self, late: float) -> None:
        """Note whether this cycle is late, or whoever answers the client is; its answers are then late, too."""
        clock = self._cycles.clock
        ping = self._ping  # another thread may answer meanwhile
        if late > _ON_TIME or (ping is not None and clock.now() - ping > _ON_TIME):
            self._late_until = self._cycles.number + _FELT
        if ping is None and self._look is not None and self._slave.moving:
            self._ping = clock.now()
            self._look(self._awake)

    def _awake(self) -> None:
        ping, self._ping = self._ping, None
        if ping is not None and self._cycles.clock.now() - ping > _ON_TIME:
            self._late_until = self._cycles.number + _FELT

    def _looked(self) -> bool:
        """Ask for a look, if nobody has; returns whether it is over."""
        if self._look is None:
            return True
        clock = self._cycles.clock
        if self._question is None:
            self._question = question = object()
            self._asked, self._seen = clock.now(), False
            self._look(lambda: self._answered(question))
        return self._seen or (clock.now() - self._asked) / clock.scale > _LONGEST_LOOK

    def _answered(self, question: object) -> None:
        if question is self._question:
            self._seen = True
        with self._cycles:  # runs what is due
            pass

    def _spare(self, late: float) -> None:
        """Give the client a period."""
        self._spared = True
        self._slave.lenient = 1 + _AFTERWARDS
        self._owe(late)
        self._cycles.put_off(0)

    def _owe(self, seconds: float) -> None:
        """Note by how much the controller's time has become late; of a time long past nobody knows any more."""
        self._owed = min(max(0.0, self._owed + seconds), _MOST_OWED)
        self._forget_at = self._cycles.number + _MEMORY

    def _lead(self, late: float) -> int:
        """Return in how many cycles to go to the set-point of mode 1."""
        if self._cycles.number > self._forget_at:
            self._owed = 0.0
        most = 1 + int((self._owed + late) / PERIOD + _NEARLY)
        count = self._slave.bridge(most) if most > 1 else 1
        if count > 1:
            self._slave.lenient = count + _AFTERWARDS
        return max(1, count)
