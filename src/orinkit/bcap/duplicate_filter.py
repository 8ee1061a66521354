"""What a client has asked lately, so that a request that comes again is carried out once (reference: duplicates).

On UDP and on serial lines a request is known by a number: the serial of its first try, which is in the reserved field
of every try. Numbers grow with every request, from 65535 to 1. A request whose number is behind the newest one's comes
late: its client has been answered, or has given it up and asked something else, so it is not carried out any more. Old
clients leave the field 0: the serial itself is the number then, which may be 0 too, and only the newest request is
known again.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from orinkit.core import hresult

MEMORY: Final = 10.0
"""Seconds that requests are remembered (reference: UDP clients are dropped after that silence)."""

_SERVICE_START: Final = 1
_LATE_DATAGRAM: Final = 2.0  # s that a packet may be under way: a Service_Start that is later is another client's
_LATE_BYTES: Final = 1.0  # s; the same on a serial line
_ROUND: Final = 0xFFFF  # serial numbers: 1 to 65535
_HALF: Final = _ROUND // 2
_KEPT: Final = 64  # answers


class Decision(Enum):
    """What is to be done with a request."""

    NEW = "carry it out"
    ANEW = "carry it out: a client begins, and the one before it has gone"
    RUNNING = "it is at work"
    BUSY = "refuse it: another one is at work"
    ANSWERED = "say the answer again"
    STALE = "its client has given it up"


@dataclass(frozen=True, slots=True)
class CachedReply:
    """An answer as it was given: all of it but the serial."""

    code: int
    count: int = 0
    body: bytes = b""


_BUSY: Final = CachedReply(hresult.E_BUSY_PROC)


@dataclass(slots=True)
class _Request:
    content: bytes
    reserved: bool
    time: float  # when it came, and when it was answered
    answer: CachedReply | None = None


class DuplicateFilter:
    """The requests of one client, or of one after the other on the same line.

    Args:
        shared: whether one client follows the other on the same line.
    """

    def __init__(self, *, shared: bool) -> None:
        self._shared = shared
        self._known: dict[int, _Request] = {}  # by number, the oldest first
        self._newest = 0
        self._running: int | None = None
        self._start = 0  # number of the last Service_Start
        self._started = float("-inf")
        self._stopped = True

    def check(self, serial: int, reserved: int, function: int, content: bytes, now: float, *, busy: bool) -> Decision:
        """Tell what is to be done with a request; one that is new is at work from then on, until :meth:`answered`.

        Args:
            serial: of this try.
            reserved: of this try.
            function: its id.
            content: function and arguments as bytes.
            now: the time, s.
            busy: whether a call is at work, so that a new request is refused, now and whenever it comes again.
        """
        number = reserved or serial
        known = self._known.get(number)
        if known is not None and known.content == content:
            if number == self._running:
                return Decision.RUNNING
            # who says that this is another try means that very request, however long ago it was
            if (number == self._newest or reserved) and (serial != number or now - known.time < MEMORY):
                return self._seen(known, function, number, now)
        if function == _SERVICE_START:
            return self._begin(number, _Request(content, bool(reserved), now), busy=busy)
        if reserved and self._is_late(number, now):
            return Decision.STALE
        return self._take(number, _Request(content, bool(reserved), now), busy=busy)

    def answered(self, answer: CachedReply, now: float) -> None:
        """Remember the answer to the request that is at work."""
        assert self._running is not None
        request = self._known[self._running]
        request.answer, request.time = answer, now
        self._running = None

    def answer_to(self, serial: int, reserved: int) -> CachedReply:
        """Return the answer to a request that has been :attr:`Decision.ANSWERED`."""
        answer = self._known[reserved or serial].answer
        assert answer is not None
        return answer

    def stop(self) -> None:
        """The client has said goodbye: a Service_Start is another one's beginning from now on."""
        self._stopped = True

    def _seen(self, known: _Request, function: int, number: int, now: float) -> Decision:
        if function == _SERVICE_START and number != self._newest:
            if not self._is_another(now):
                return Decision.STALE  # an answer would have a client that begins anew believe that it has begun
            return self._begin_anew(number, _Request(known.content, known.reserved, now))
        return Decision.STALE if known.answer is None else Decision.ANSWERED

    def _begin(self, number: int, request: _Request, *, busy: bool) -> Decision:
        """Judge a Service_Start that is not known."""
        if number == self._start and not self._is_another(request.time):
            return Decision.STALE
        ahead = 0 < (number - self._newest) % _ROUND <= _HALF
        if self._shared or self._stopped or not ahead:
            return self._begin_anew(number, request)
        verdict = self._take(number, request, busy=busy)
        if self._known[number] is request:  # else it has the number of the call at work, and is nobody's beginning
            self._start, self._started = number, request.time
        return verdict

    def _begin_anew(self, number: int, request: _Request) -> Decision:
        verdict = Decision.NEW if self._stopped else Decision.ANEW
        self._known.clear()
        self._start, self._started, self._stopped = number, request.time, False
        self._remember(number, request)
        self._running = number
        return verdict

    def _is_another(self, now: float) -> bool:
        """Whether a Service_Start that seems to be known is that of a client who begins anew with the same number."""
        return self._stopped or now - self._started >= (_LATE_BYTES if self._shared else _LATE_DATAGRAM)

    def _take(self, number: int, request: _Request, *, busy: bool) -> Decision:
        if busy:
            if number != self._running:  # whose answer is to come there
                request.answer = _BUSY
                self._remember(number, request)
            return Decision.BUSY
        self._remember(number, request)
        self._running = number
        self._stopped = False
        return Decision.NEW

    def _remember(self, number: int, request: _Request) -> None:
        self._newest = number
        self._known.pop(number, None)
        self._known[number] = request
        if len(self._known) > _KEPT:
            del self._known[next(each for each in self._known if each != self._running)]

    def _is_late(self, number: int, now: float) -> bool:
        """Whether a request that was never seen, or long ago, is behind the newest one."""
        newest = self._known.get(self._newest)
        if newest is None or not newest.reserved or now - newest.time >= MEMORY:
            return False
        return 0 < (self._newest - number) % _ROUND <= _HALF
