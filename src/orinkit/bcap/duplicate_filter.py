"""Detection of duplicate requests, so that each request is executed once (docs/protocol.md, "Duplicate requests").

On UDP and on serial lines, each request has a number: the serial of its first attempt. The reserved field of every
attempt contains this number. Numbers increase with every request and continue with 1 after 65535. A request with a
number below the newest number is late and is not executed: its client has already received the reply, or has abandoned
the call and made another one. Old clients set the reserved field to 0. In this case, the number of a request
is the serial of its packet, which may also be 0, and only duplicates of the newest request are detected.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from orinkit.core import hresult
from orinkit.core.record import record

MEMORY: Final = 10.0
"""Seconds for which requests are stored; a silent UDP client is disconnected after the same time."""

_SERVICE_START: Final = 1
_LATE_DATAGRAM: Final = 2.0  # s, longest delay of a packet; a later Service_Start belongs to another client
_LATE_BYTES: Final = 1.0  # s, the same on a serial line
_MAX_SERIAL: Final = 0xFFFF  # serial numbers: 1 to 65535
_HALF: Final = _MAX_SERIAL // 2
_MAX_STORED: Final = 64  # limit on stored replies


class Decision(Enum):
    """The way to handle a request."""

    NEW = "execute it"
    RESTART = "execute it: a client begins, and the previous one has disconnected"
    RUNNING = "it is in progress, or waits"
    BUSY = "refuse it: others are in progress"
    REPLIED = "repeat the reply"
    STALE = "drop it: its client has given it up"


@record
class CachedReply:
    """A stored reply, without its serial, which differs for each attempt."""

    code: int
    count: int = 0
    body: bytes = b""


_BUSY: Final = CachedReply(hresult.E_BUSY_PROC)


@dataclass(slots=True)
class _Request:
    content: bytes
    reserved: bool
    time: float  # time of reception; later, time of the reply
    reply: CachedReply | None = None


class DuplicateFilter:
    """Detects duplicate requests of one client, or of successive clients on one line.

    Args:
        shared: True if several clients may use the same line one after the other.
    """

    def __init__(self, *, shared: bool) -> None:
        self._shared = shared
        self._known: dict[int, _Request] = {}  # by number, oldest first
        self._newest = 0
        self._open: set[int] = set()  # numbers of the requests without a reply
        self._start = 0  # number of the last Service_Start
        self._started = float("-inf")
        self._stopped = True

    def check(self, serial: int, reserved: int, function: int, content: bytes, now: float, *, busy: bool) -> Decision:
        """Return the way to handle a request. A new request is then in progress until its reply is stored.

        Args:
            serial: serial of this attempt.
            reserved: reserved field of this attempt.
            function: function id.
            content: function id and arguments as bytes.
            now: the time, s.
            busy: True if a new request and its duplicates are refused, because calls are in progress.
        """
        number = reserved or serial
        known = self._known.get(number)
        if known is not None and known.content == content:
            if number in self._open:
                return Decision.RUNNING
            # a request that the client has marked as another attempt is a duplicate, regardless of its age
            if (number == self._newest or reserved) and (serial != number or now - known.time < MEMORY):
                return self._seen(known, function, number, now)
        if function == _SERVICE_START:
            return self._begin(number, _Request(content, bool(reserved), now), busy=busy)
        if reserved and self._is_late(number, now):
            return Decision.STALE
        return self._take(number, _Request(content, bool(reserved), now), busy=busy)

    def store_reply(self, number: int, reply: CachedReply, now: float) -> None:
        """Store the reply to a request.

        Args:
            number: number of the request: the reserved field, or the serial if that field is 0.
            reply: the reply.
            now: the time, s.
        """
        request = self._known[number]
        request.reply, request.time = reply, now
        self._open.discard(number)

    def reply_to(self, serial: int, reserved: int) -> CachedReply:
        """Return the stored reply to a request for which :meth:`check` returned :attr:`Decision.REPLIED`."""
        reply = self._known[reserved or serial].reply
        assert reply is not None
        return reply

    def abandon(self) -> None:
        """Forget which requests are without a reply: there will be none."""
        self._open.clear()

    def service_stopped(self) -> None:
        """Record a Service_Stop: the next Service_Start belongs to another client."""
        self._stopped = True

    def _seen(self, known: _Request, function: int, number: int, now: float) -> Decision:
        if function == _SERVICE_START and number != self._newest:
            if not self._is_another(now):
                return Decision.STALE  # with a reply, a restarted client would assume that its session has begun
            return self._restart(number, _Request(known.content, known.reserved, now))
        return Decision.STALE if known.reply is None else Decision.REPLIED

    def _begin(self, number: int, request: _Request, *, busy: bool) -> Decision:
        """Return the way to handle a Service_Start that is not a duplicate of a stored request."""
        if number == self._start and not self._is_another(request.time):
            return Decision.STALE
        ahead = 0 < (number - self._newest) % _MAX_SERIAL <= _HALF
        if self._shared or self._stopped or not ahead:
            return self._restart(number, request)
        decision = self._take(number, request, busy=busy)
        if self._known[number] is request:  # false if the call in progress has this number; then no session begins
            self._start, self._started = number, request.time
        return decision

    def _restart(self, number: int, request: _Request) -> Decision:
        decision = Decision.NEW if self._stopped else Decision.RESTART
        self._known.clear()
        self._start, self._started, self._stopped = number, request.time, False
        self._open.clear()
        self._remember(number, request)
        self._open.add(number)
        return decision

    def _is_another(self, now: float) -> bool:
        """Return True if a Service_Start that has the number of an earlier one comes from a restarted client."""
        return self._stopped or now - self._started >= (_LATE_BYTES if self._shared else _LATE_DATAGRAM)

    def _take(self, number: int, request: _Request, *, busy: bool) -> Decision:
        if busy or number in self._open:
            if number not in self._open:  # the entry of a call in progress is kept for its reply
                request.reply = _BUSY
                self._remember(number, request)
            return Decision.BUSY
        self._remember(number, request)
        self._open.add(number)
        self._stopped = False
        return Decision.NEW

    def _remember(self, number: int, request: _Request) -> None:
        self._newest = number
        self._known.pop(number, None)
        self._known[number] = request
        if len(self._known) > _MAX_STORED:
            del self._known[next(each for each in self._known if each not in self._open)]

    def _is_late(self, number: int, now: float) -> bool:
        """Return True if a request is late: its number is below the newest number."""
        newest = self._known.get(self._newest)
        if newest is None or not newest.reserved or now - newest.time >= MEMORY:
            return False
        return 0 < (self._newest - number) % _MAX_SERIAL <= _HALF
