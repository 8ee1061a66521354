"""Elastic time: decides which cycles are run in slave mode if the client or the server is late.

A real controller has a processor of its own. A virtual controller shares a machine with its client and with other
programs, which may delay the client or the server:

* **The client is late**: the arm moves, and there is no set-point for the next cycle. The controller's time stops until
  a set-point arrives, for 250 ms at most, and the set-point is counted as late. After 250 ms the controller behaves
  like a real one: it reports an error, or in mode 1 stops the arm in place. With strict time the controller behaves
  like a real one immediately; in mode 1 the set-point is counted as late nevertheless.
* **The server is late**: due cycles were not run in time. The missed cycles are not caught up: one cycle is run, and
  from then on the controller's time lags behind the clock. Set-points that have arrived are in time, even if the server
  has not read them yet: before a cycle without a set-point is run, all unread input is processed
  (``when_input_processed``). This also applies with strict time. With strict time, a client whose reply the
  server may have delayed also has one more period for its set-point.
* **The client sends by the clock**, not after each reply. It does not notice that the controller's time lags, so its
  next set-point is farther away than one cycle allows. If set-points are queued (modes 0 and 2), this has no
  effect. If only the newest set-point counts (mode 1), the arm moves to it in as many cycles as the distance seems to
  require (:meth:`PacedSlave.plan_catch_up`). If the server was late, the limits are larger in these cycles.

If a cycle or a set-point is late by less than a quarter of a period, the times of the following cycles do not change.
If each set-point of a client is a little later than the one before, these delays add up, until a set-point is counted
as late.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from orinkit.core.i18n import tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop

LONGEST_WAIT: Final = 0.25
"""Longest wait for a late set-point, real seconds."""

_TOLERANCE: Final = PERIOD / 4  # s; shorter delays are ignored
_DRAIN_TIMEOUT: Final = 5.0  # real seconds; after that, unread input is no longer waited for
_MAX_CHECK_INTERVAL: Final = 2 * PERIOD  # s between two checks of a wait; if it is longer, this process was delayed
_GRACE_CYCLES: Final = 4  # a delay of the client has an effect only after the three set-points in the buffer are used
_EXTRA_LENIENT_CYCLES: Final = 2  # cycles with larger limits after a catch-up
_MAX_LAG: Final = 0.25  # s; the largest lag that can be caught up
_LAG_LIFETIME: Final = 125  # cycles after which a lag is disregarded
_HALF: Final = 0.5  # fraction of a period
_MAX_CASES: Final = 10_000  # late set-points that are stored individually

WhenInputProcessed = Callable[[Callable[[], None]], None]
"""Function that invokes a callback once all input received so far has been processed.

See ``when_input_processed`` of :class:`orinkit.cao.provider.ClientInfo`.
"""


def timed_out_detail() -> str:
    """Return the detail of the error raised when the wait for a set-point ends without one."""
    milliseconds = round(LONGEST_WAIT * 1e3)
    return tr("no set-point for {milliseconds} ms", milliseconds=milliseconds)


def late_detail() -> str:
    """Return the detail of the error raised for a late set-point with strict time."""
    return tr("no set-point for this cycle (strict time: the controller does not wait)")


def late_stream_message(late: Lateness, *, strict: bool) -> str:
    """Return the log message for the end of a stream in which set-points were late."""
    if strict:
        return tr("{late}: the arm stopped in place", late=late)
    return tr(
        "{late}: a real controller would not have waited. Try: --strict-time, to reproduce its behaviour", late=late
    )


class PacedSlave(Protocol):
    """The part of slave mode that :class:`CyclePacer` uses.

    Attributes:
        overwrites: True if only the newest set-point counts (mode 1).
        moving: True if the command position moves.
        starving: True if the next cycle needs a set-point and there is none.
        lenient_cycles: Number of further cycles in which the limits are larger, because the server was late.
    """

    lenient_cycles: int

    @property
    def overwrites(self) -> bool:
        """True if only the newest set-point counts (mode 1)."""

    @property
    def moving(self) -> bool:
        """True if the command position moves."""

    @property
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and there is none."""

    def plan_catch_up(self, most: int) -> int:
        """Plan the command positions that lead to the newest set-point in at most ``most`` cycles.

        Returns:
            Number of planned cycles; 0 if there is no set-point.
        """


class _Cases:
    """Delays of the late set-points: each of the newest ones, and the count, maximum and sum of all."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_MAX_CASES)
        self._all = Lateness()

    def add(self, seconds: float) -> None:
        """Count a late set-point and its delay in real seconds."""
        self._seconds.append(seconds)
        count, longest, total = self._all.count, self._all.longest, self._all.total
        self._all = Lateness(count + 1, max(longest, seconds), total + seconds)

    def lateness(self, skip_first: int) -> Lateness:
        """Return the lateness, without the first ``skip_first`` late set-points.

        If ``skip_first`` is not 0, the longest and the total delay are those of the last 10,000 late set-points at most.
        """
        if skip_first == 0:
            return self._all
        count = max(0, self._all.count - skip_first)
        known = list(self._seconds)[max(0, len(self._seconds) - count) :]
        return Lateness(count, max(known, default=0.0), sum(known))


class CyclePacer:
    """Decides how many cycles :class:`~orinkit.virtual.engine.control_loop.ControlLoop` runs while slave mode is on.

    Args:
        cycles: The control loop of the controller.
        slave: Slave mode of the arm.
        when_input_processed: Function that invokes a callback after the unread input of the client that sends
            set-points has been processed; ``None`` if there is never unread input.
        strict: True for strict time: the controller does not wait for late set-points.
    """

    def __init__(
        self, cycles: ControlLoop, slave: PacedSlave, when_input_processed: WhenInputProcessed | None, *, strict: bool
    ) -> None:
        self._cycles = cycles
        self._slave = slave
        self._when_input_processed = (
            None if cycles.clock.manual else when_input_processed
        )  # all input is processed before a manual clock is moved
        self._strict = strict
        self._longest_wait = LONGEST_WAIT  # limit of the present wait, real s
        self._late_until = 0  # number of the last cycle in which a delay of the server may still affect the client
        self._drain_request: object | None = None  # the pending request to process the input
        self._drain_requested_at = 0.0
        self._drained = False
        self._waited: float | None = None  # real s spent waiting for the client; None if not waiting
        self._wait_updated_at = 0.0
        self._missed_due: float | None = None  # due time of the set-point that strict time did not wait for (mode 1)
        self._cases = _Cases()
        self._lag = 0.0  # s by which the controller's time lags behind a client that sends by the clock
        self._server_lag = 0.0  # the share of _lag that the server has caused, s
        self._lag_expires_at = 0  # number of the cycle after which the lag is disregarded

    def begin(self) -> None:
        """Begin to decide about the cycles, together with the pacers of other arms."""
        others = _pacers_of(self._cycles)
        self._cycles.pace = CommonPace([*others, self]) if others else self

    def end(self) -> None:
        """End to decide about the cycles."""
        others = [each for each in _pacers_of(self._cycles) if each is not self]
        self._cycles.pace = CommonPace(others) if len(others) > 1 else next(iter(others), None)

    def __call__(self, due: int) -> int:
        """Return how many of the due cycles to run now; 0 to wait."""
        return self.cycles_to_run(due) if self.ready(due) else 0

    @property
    def starving(self) -> bool:
        """True if the next cycle needs a set-point and there is none."""
        return self._slave.starving

    def ready(self, due: int) -> bool:
        """Return True if all input that matters for the next cycle has been processed; otherwise request it."""
        slave = self._slave
        matters = slave.starving or (slave.overwrites and (slave.moving or due > 1))
        return not matters or self._input_drained()

    def require_input(self) -> None:
        """Disregard the input that has been processed so far, because no cycle was run."""
        self._drain_request = None

    def cycles_to_run(self, due: int) -> int:
        """Return how many of the due cycles to run now, after :meth:`ready`; 0 to wait."""
        slave = self._slave
        self._drain_request = None
        late = self._server_late()
        if late > _TOLERANCE and self._waited is None:
            self._late_until = self._cycles.number + _GRACE_CYCLES
        if slave.starving:
            if self._wait():
                return 0
            self._end_wait(self._longest_wait)
            late = self._server_late()
            if self._strict and slave.overwrites and self._missed_due is None:
                self._missed_due = self._cycles.clock.now() - self._cycles.overdue
        count = self._catch_up_cycles(late) if slave.overwrites and not slave.starving else 1
        behind = late - (count - 1) * PERIOD
        if behind > _TOLERANCE or count > due:
            self._add_lag(behind, by_server=True)
        return count

    def resume(self) -> None:
        """Stop waiting: a set-point has arrived, or is no longer needed. The next cycle is due now."""
        if self._missed_due is not None:
            self._cases.add((self._cycles.clock.now() - self._missed_due) / self._cycles.clock.scale)
            self._missed_due = None
        if self._waited is not None:
            self._update_wait()
            self._end_wait(math.inf)

    def lateness(self, skip_first: int = 0) -> Lateness:
        """Return the lateness of the set-points, without the first ``skip_first`` late ones."""
        return self._cases.lateness(max(0, skip_first))

    # --- a late client ------------------------------------------------------------------------------------------

    def _wait(self) -> bool:
        """Begin or continue to wait for a set-point; return False if the wait must end now."""
        if self._waited is not None:
            self._update_wait()
            return self._waited < self._longest_wait
        clock, late = self._cycles.clock, self._cycles.overdue
        self._longest_wait = LONGEST_WAIT
        if self._strict:
            self._longest_wait = PERIOD / clock.scale if self._cycles.number <= self._late_until else 0.0
        if self._longest_wait == 0.0:
            return False
        self._waited = late / clock.scale if clock.manual or late <= _TOLERANCE else 0.0
        self._wait_updated_at = clock.now()
        return self._waited < self._longest_wait

    def _update_wait(self) -> None:
        """Add the time since the last call to the waiting time, without delays of this process."""
        assert self._waited is not None
        clock = self._cycles.clock
        now = clock.now()
        passed = (now - self._wait_updated_at) / clock.scale
        self._waited += passed if clock.manual else min(passed, _MAX_CHECK_INTERVAL)
        self._wait_updated_at = now

    def _end_wait(self, limit: float) -> None:
        """End the wait and restart the controller's time; at most ``limit`` real seconds count as late."""
        if self._waited is None:
            return
        waited, self._waited = min(self._waited, limit), None
        clock, late = self._cycles.clock, self._cycles.overdue
        if waited * clock.scale <= _TOLERANCE and waited < LONGEST_WAIT:
            return
        if not self._strict:
            self._cases.add(waited)
        client_share = min(late, waited * clock.scale)
        self._add_lag(client_share)
        if not clock.manual:
            self._add_lag(late - client_share, by_server=True)

    # --- a late server ------------------------------------------------------------------------------------------

    def _input_drained(self) -> bool:
        """Return True if all received input has been processed; otherwise request a callback, unless one is pending."""
        if self._when_input_processed is None:
            return True
        clock = self._cycles.clock
        if self._drain_request is None:
            self._drain_request = request = object()
            self._drain_requested_at, self._drained = clock.now(), False
            self._when_input_processed(lambda: self._on_drained(request))
        if not self._drained and (clock.now() - self._drain_requested_at) / clock.scale > _DRAIN_TIMEOUT:
            self._when_input_processed, self._late_until = None, self._cycles.number + _GRACE_CYCLES
        return self._drained or self._when_input_processed is None

    def _on_drained(self, request: object) -> None:
        if request is self._drain_request:
            self._drained = True
            if self._cycles.clock.now() - self._drain_requested_at > _TOLERANCE:
                self._late_until = self._cycles.number + _GRACE_CYCLES
        with self._cycles:  # entering the lock runs due cycles
            pass

    def _server_late(self) -> float:
        """Return by how many seconds of the clock the next cycle is late; always 0 with a manual clock."""
        return 0.0 if self._cycles.clock.manual else self._cycles.overdue

    def _add_lag(self, seconds: float, *, by_server: bool = False) -> None:
        """Increase the lag of the controller's time.

        Args:
            seconds: The increase, in seconds of the clock.
            by_server: True if the server caused the increase, False if the client did.
        """
        self.note_lag(seconds, by_server=by_server)
        self._cycles.delay(seconds)
        for other in _pacers_of(self._cycles):
            if other is not self:  # the clients of other arms have not caused it
                other.note_lag(seconds, by_server=True)

    def note_lag(self, seconds: float, *, by_server: bool) -> None:
        """Record that the cycles are delayed; the arguments are those of :meth:`_add_lag`."""
        self._lag = min(max(0.0, self._lag + seconds), _MAX_LAG)
        self._server_lag = min(max(0.0, self._server_lag + seconds * by_server), self._lag)
        self._lag_expires_at = self._cycles.number + _LAG_LIFETIME

    def _catch_up_cycles(self, late: float) -> int:
        """Return the number of cycles for the move to the newest set-point in mode 1.

        ``late`` is the delay of the next cycle, in seconds of the clock.
        """
        if self._cycles.number > self._lag_expires_at:
            self._lag = self._server_lag = 0.0
        limit = 1 + int((self._lag + late) / PERIOD + _HALF)
        count = self._slave.plan_catch_up(limit) if limit > 1 else 1
        if count > 1 and self._server_lag + late > _HALF * PERIOD:
            self._slave.lenient_cycles = count + _EXTRA_LENIENT_CYCLES
        return max(1, count)


class CommonPace:
    """Decides how many cycles to run while several arms of a controller are in slave mode.

    The arms share the controller's time. If it waits for a set-point of one arm, all arms wait.

    Args:
        pacers: The pacers of the arms.
    """

    def __init__(self, pacers: Sequence[CyclePacer]) -> None:
        self.pacers = tuple(pacers)

    def __call__(self, due: int) -> int:
        """Return how many of the due cycles to run now; 0 to wait."""
        if not all(each.ready(due) for each in self.pacers):  # every one of them requests its input
            return 0
        count = due
        for pacer in sorted(self.pacers, key=lambda each: not each.starving):  # those that may wait are first
            count = min(count, pacer.cycles_to_run(due))
            if count == 0:
                for each in self.pacers:
                    each.require_input()
                return 0
        return count


def _pacers_of(cycles: ControlLoop) -> Sequence[CyclePacer]:
    """Return the pacers that decide about the cycles at present."""
    pace = cycles.pace
    if isinstance(pace, CommonPace):
        return pace.pacers
    return (pace,) if isinstance(pace, CyclePacer) else ()
