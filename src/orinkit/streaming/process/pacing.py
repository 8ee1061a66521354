"""Pacing: when and how set-points are sent in the modes 0, 1 and 2 of slave mode (RC8 4.3)."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any, Final, NamedTuple, Protocol

from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.rc8.slave_formats import SlaveReply

_PARTS: Final = 8  # if the buffer is full, the set-point is sent again after 1/8 of a period
_LOOKS: Final = 5  # number of repetitions of a set-point per period, until the controller has taken it
_LATE: Final = 4  # a reply is late after 1/4 of a period
_PATIENCE: Final = 1.0  # s; if the controller does not take a set-point in this time, it has stopped taking set-points


class Delivery(NamedTuple):
    """The result of sending a set-point.

    Attributes:
        sent: Time of sending, monotonic clock, s.
        replied_at: Time of the reply, monotonic clock, s.
        code: Return code of slvMove: S_OK or S_BUF_FULL.
        reply: The feedback in the reply.
    """

    sent: float
    replied_at: float
    code: int
    reply: SlaveReply


Call = Callable[[Any], Delivery]
"""Callback that sends slvMove with its argument as the parameter; raises the same exceptions as a call of a client."""


class Pacer(Protocol):
    """Sends set-points at the times that the mode (0, 1 or 2) of slave mode requires."""

    def deliver(self, parameter: Any) -> Delivery:
        """Send a set-point; return when the next set-point may be computed."""


class HandshakePacer:
    """Pacer of mode 2: the controller delays the reply until its buffer has room."""

    def __init__(self, call: Call, period: float) -> None:
        self._call = call

    def deliver(self, parameter: Any) -> Delivery:
        """Send a set-point; return when the controller has replied."""
        return self._call(parameter)


class BufferFillPacer:
    """Pacer of mode 0: fills the controller's buffer, then pauses until the controller has taken a set-point."""

    def __init__(self, call: Call, period: float) -> None:
        self._call = call
        self._period = period
        self._tick = monotonic()

    def deliver(self, parameter: Any) -> Delivery:
        """Send a set-point; while the controller refuses it because the buffer is full, send it again (RC8 4.3.1)."""
        end = monotonic() + _PATIENCE
        while True:
            try:
                delivery = self._call(parameter)
            except CallError as error:
                if error.code != hresult.E_BUF_FULL or monotonic() > end:
                    raise
                self._tick = monotonic() + self._period / _PARTS
                sleep_until(self._tick)
            else:
                if delivery.code == hresult.S_BUF_FULL:
                    self._tick = _next_tick(self._tick, self._period)
                    sleep_until(self._tick)
                return delivery


class TimedPacer:
    """Pacer of mode 1: one set-point per cycle of the controller.

    The controller takes the newest set-point at each cycle boundary. If a set-point arrived just after its boundary,
    instead of just before, the arm would stop for a cycle. Therefore a set-point is repeated until the time stamp of a
    reply shows that the next cycle has begun. The next set-point is then sent early in this cycle.
    """

    def __init__(self, call: Call, period: float) -> None:
        self._call = call
        self._period = period
        self._tick = monotonic()

    def deliver(self, parameter: Any) -> Delivery:
        """Send a set-point; return when the controller has taken it.

        If the replies contain no time stamps, return after a period.
        """
        first = self._call(parameter)
        began = first.reply.timestamp
        if began is None:
            if first.replied_at - self._tick > self._period / _LATE:  # the next set-point must be in another cycle
                self._tick = first.replied_at
            self._tick = _next_tick(self._tick, self._period)
            sleep_until(self._tick)
            return first
        self._tick = first.sent
        end = first.sent + _PATIENCE
        while True:
            self._tick += self._period / _LOOKS
            sleep_until(self._tick)
            again = self._call(parameter)
            if again.reply.timestamp != began or again.sent > end:
                return again._replace(sent=first.sent)


def _next_tick(tick: float, period: float) -> float:
    """Return ``tick`` plus a period; if that time is past or more than a period away, return now plus a period."""
    now = monotonic()
    following = tick + period
    return following if now < following <= now + period else now + period


def sleep_until(moment: float) -> None:
    """Sleep until a time of the monotonic clock; return immediately if the time has passed."""
    seconds = moment - monotonic()
    if seconds > 0:
        sleep(seconds)


FLOWS: Final[dict[int, Callable[[Call, float], Pacer]]] = {0: BufferFillPacer, 1: TimedPacer, 2: HandshakePacer}
"""Class of the pacer for each value of ``SlaveMode.buffering``: 0, 1 or 2 (RC8 table 4-4)."""
