"""What a client has asked lately, so that a request that comes more than once is carried out once (reference: duplicates).

On UDP and on serial lines a request is known by a number: the serial of its first try, which is in the reserved field of
every try. Old clients leave the field 0: the serial itself is the number then, and only the last request is known again.
Of the others the latest are, for a datagram may come late. A try that comes when its client has given the request up and
asked something else is not carried out any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

MEMORY: Final = 10.0
"""Seconds that requests are remembered (reference: UDP clients are dropped after that silence)."""

_SERVICE_START: Final = 1
_LATE: Final = 1.0  # s that a datagram may be under way; a Service_Start that comes again later is another client's
_ROUND: Final = 0xFFFF  # serial numbers: 1 to 65535
_BEHIND: Final = 64  # serial numbers by which a try may be behind; what is further behind is not a try that is late
_KEPT: Final = 64  # requests


class Verdict(Enum):
    """What is to be done with a request."""

    NEW = "carry it out"
    RUNNING = "it is at work"
    ANSWERED = "say the answer again"
    STALE = "its client has given it up"
    BUSY = "another one is at work"


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer as it was given: all of it but the serial."""

    code: int
    count: int
    body: bytes


@dataclass(slots=True)
class _Request:
    content: bytes
    time: float
    reserved: bool
    answer: Answer | None = None


class Requests:
    """The requests of one client."""

    def __init__(self) -> None:
        self._known: dict[int, _Request] = {}  # by number, the oldest first
        self._newest = 0
        self._starts: dict[tuple[int, int], float] = {}  # tries of Service_Start, and when they came

    def judge(self, serial: int, reserved: int, function: int, content: bytes, now: float, *, busy: bool) -> Verdict:
        """Tell what is to be done with a request; one that is :attr:`Verdict.NEW` is the newest from then on.

        Args:
            serial: of this try.
            reserved: of this try.
            function: its id.
            content: function and arguments as bytes.
            now: the time, s.
            busy: whether a call is at work, so that there can be no new one.
        """
        number = reserved or serial
        known = self._known.get(number)
        if known is not None and known.content == content and now - known.time < MEMORY:
            if number == self._newest:
                known.time = now
                return Verdict.RUNNING if known.answer is None else Verdict.ANSWERED
            if reserved and function != _SERVICE_START:
                return Verdict.STALE if known.answer is None else Verdict.ANSWERED
        if function == _SERVICE_START:
            if self._came_before(serial, reserved, now):
                return Verdict.STALE
        elif reserved and self._is_late(number, now):
            return Verdict.STALE
        if busy:
            return Verdict.BUSY
        if function == _SERVICE_START:
            self._known.clear()
        self._newest = number
        self._known.pop(number, None)
        self._known[number] = _Request(content, now, bool(reserved))
        if len(self._known) > _KEPT:
            del self._known[next(iter(self._known))]
        return Verdict.NEW

    def answered(self, answer: Answer) -> None:
        """Remember the answer to the newest request."""
        self._known[self._newest].answer = answer

    def answer_to(self, serial: int, reserved: int) -> Answer:
        """Return the answer to a request that has been :attr:`Verdict.ANSWERED`."""
        answer = self._known[reserved or serial].answer
        assert answer is not None
        return answer

    def forget(self) -> None:
        """The client has said goodbye: whatever comes next is a new request."""
        kept = self._known[self._newest]  # of the goodbye itself the answer may be lost
        kept.reserved = False
        self._known = {self._newest: kept}
        self._starts.clear()

    def _is_late(self, number: int, now: float) -> bool:
        """Whether a request that was never seen is older than the newest one."""
        newest = self._known.get(self._newest)
        if newest is None or not newest.reserved or now - newest.time >= MEMORY:
            return False
        return 0 < (self._newest - number) % _ROUND < _BEHIND

    def _came_before(self, serial: int, reserved: int, now: float) -> bool:
        """Whether this very packet came before; a client that begins anew sends another one, at its second try."""
        self._starts = {start: time for start, time in self._starts.items() if now - time < _LATE}
        known = (serial, reserved) in self._starts
        self._starts[serial, reserved] = now
        return known
