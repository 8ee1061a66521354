"""How set-points are handed over in each of the three modes of RC8 4.3, and at what pace."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any, Final, NamedTuple, Protocol

from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.rc8.slave_formats import SlaveAnswer

_PARTS: Final = 8  # of a period: how soon a set-point that found the buffer full is sent again
_LOOKS: Final = 5  # of a period: how often a set-point is repeated until the controller has taken it
_LATE: Final = 4  # of a period
_PATIENCE: Final = 1.0  # s for one set-point; a controller that takes none for so long is not consuming


class Delivery(NamedTuple):
    """What became of a set-point.

    Attributes:
        sent: when it was sent, monotonic s.
        answered: when the answer was there.
        code: S_OK or S_BUF_FULL.
        answer: what came back.
    """

    sent: float
    answered: float
    code: int
    answer: SlaveAnswer


Call = Callable[[Any], Delivery]
"""Sends slvMove with a parameter; raises what a client raises."""


class Pacer(Protocol):
    """One way of handing over."""

    def deliver(self, parameter: Any) -> Delivery:
        """Hand a set-point over; returns when the next one may be made."""


class HandshakePacer:
    """Mode 2: the controller itself lets the answer wait until there is room."""

    def __init__(self, call: Call, period: float) -> None:  # noqa: ARG002 - as the others
        self._call = call

    def deliver(self, parameter: Any) -> Delivery:
        """Hand over."""
        return self._call(parameter)


class BufferFillPacer:
    """Mode 0: as many as there is room for, then a pause until the controller has taken one."""

    def __init__(self, call: Call, period: float) -> None:
        self._call = call
        self._period = period
        self._tick = monotonic()

    def deliver(self, parameter: Any) -> Delivery:
        """Hand over; a set-point that finds the buffer full was not taken, and is sent again (RC8 4.3.1)."""
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
    """Mode 1: one set-point for each cycle of the controller, repeated until the controller's time tells of the next.

    The controller takes the newest set-point at each boundary of its cycle. A set-point that came just after one instead
    of just before would have the arm stop for a cycle; one that is repeated is always there.
    """

    def __init__(self, call: Call, period: float) -> None:
        self._call = call
        self._period = period
        self._tick = monotonic()

    def deliver(self, parameter: Any) -> Delivery:
        """Hand over; returns when the controller has taken it, or a period later where it does not tell its time."""
        first = self._call(parameter)
        began = first.answer.timestamp
        if began is None:
            if first.answered - self._tick > self._period / _LATE:  # the next one is not to come into the same cycle
                self._tick = first.answered
            self._tick = _next_tick(self._tick, self._period)
            sleep_until(self._tick)
            return first
        self._tick = first.sent
        end = first.sent + _PATIENCE
        while True:
            self._tick += self._period / _LOOKS
            sleep_until(self._tick)
            again = self._call(parameter)
            if again.answer.timestamp != began or again.sent > end:
                return again._replace(sent=first.sent)


def _next_tick(tick: float, period: float) -> float:
    """Return the tick behind one, or a period from now where that is past or far: it has been late, or was not needed."""
    now = monotonic()
    following = tick + period
    return following if now < following <= now + period else now + period


def sleep_until(moment: float) -> None:
    """Sleep until a moment of the monotonic clock; not at all if it has passed."""
    seconds = moment - monotonic()
    if seconds > 0:
        sleep(seconds)


FLOWS: Final[dict[int, Callable[[Call, float], Pacer]]] = {0: BufferFillPacer, 1: TimedPacer, 2: HandshakePacer}
"""By the number of the buffering of RC8 table 4-4."""
