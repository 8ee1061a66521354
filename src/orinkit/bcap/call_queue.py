"""The calls of one client in progress, and the requests that wait for them.

The calls of one connection are executed one after the other (provider guide, appendix C). A request that arrives during
a call waits. A call that stops motions does not wait: it is executed beside the call in progress. The number and the
bytes of waiting requests are limited; further ones are refused. If the call in progress has timed out, its device may
never finish, so further requests are refused, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from orinkit.cao.functions import controller_get_name

MOST_WAITING: Final = 32
"""Limit on the waiting requests of a client."""
MOST_BYTES: Final = 64 * 1024
"""Limit on the bytes of the waiting requests of a client."""
MOST_BESIDE: Final = 4
"""Limit on the stops that a client executes at the same time, beside the call in progress."""

_NEVER: Final = float("inf")
_SIGN_OF_LIFE: Final = controller_get_name.id


@dataclass(slots=True, eq=False)
class Request:
    """A request, from its reception to the reply.

    Attributes:
        frame: the packet.
        serial: serial of the latest attempt.
        reserved: reserved field of the latest attempt.
        function_id: function id.
        count: number of arguments.
        end: offset of the end of the arguments.
        expires_at: time at which E_TIMEOUT is sent.
        next_wdt: time at which S_EXECUTING is sent.
        timed_out: True if E_TIMEOUT has been sent.
        call: the call that the conversation has passed on; ``None`` while the request waits.
    """

    frame: bytes
    serial: int
    reserved: int
    function_id: int
    count: int
    end: int
    expires_at: float = _NEVER
    next_wdt: float = _NEVER
    timed_out: bool = False
    call: object = None

    @property
    def number(self) -> int:
        """The number by which duplicates are detected (:mod:`orinkit.bcap.duplicate_filter`)."""
        return self.reserved or self.serial

    @property
    def next_time(self) -> float:
        """The time at which a packet is due."""
        return min(self.expires_at, self.next_wdt)


class CallQueue:
    """The calls of one client.

    Args:
        queues: False to refuse requests that arrive during a call, except stops.

    Attributes:
        waiting: the waiting requests, oldest first.
    """

    def __init__(self, *, queues: bool = True) -> None:
        self._queues = queues
        self._current: Request | None = None
        self._beside: list[Request] = []
        self.waiting: deque[Request] = deque()
        self._bytes = 0

    @property
    def busy(self) -> bool:
        """True while a call is in progress."""
        return self._current is not None or bool(self._beside)

    @property
    def idle(self) -> bool:
        """True if a new request is executed at once."""
        return self._current is None and not self.waiting

    @property
    def empty(self) -> bool:
        """True if no call is in progress, and no request waits."""
        return self._current is None and not self._beside and not self.waiting

    @property
    def timed_out(self) -> bool:
        """True if E_TIMEOUT has been sent for the call in progress, except for a stop."""
        return self._current is not None and self._current.timed_out

    def accepts(self, request: Request, *, stops: bool) -> bool:
        """Return True if a request that arrives during a call is executed, at once or later.

        A request of Controller_GetName with serial 0 is a sign of life that expects no result
        (:func:`orinkit.bcap.client.sign_of_life`); it does not have to wait.
        """
        if stops:
            return len(self._beside) < MOST_BESIDE
        if not self._queues or self.timed_out or len(self.waiting) >= MOST_WAITING:
            return False
        if not request.number and request.function_id == _SIGN_OF_LIFE:
            return False
        return self._bytes + len(request.frame) <= MOST_BYTES

    def enqueue(self, request: Request) -> None:
        """Add a waiting request."""
        self.waiting.append(request)
        self._bytes += len(request.frame)

    def remove(self, request: Request) -> None:
        """Remove a waiting request."""
        self.waiting.remove(request)
        self._bytes -= len(request.frame)

    def next(self) -> Request | None:
        """Remove and return the oldest waiting request; ``None`` if there is none, or a call is in progress."""
        if self._current is not None or not self.waiting:
            return None
        request = self.waiting.popleft()
        self._bytes -= len(request.frame)
        return request

    def begin(self, request: Request, call: object, *, beside: bool = False) -> None:
        """Record that a call is in progress; its packet is no longer required."""
        request.call = call
        request.frame = b""
        if beside:
            self._beside.append(request)
        else:
            self._current = request

    def end(self, call: object) -> Request | None:
        """Record the end of a call, and return its request; ``None`` if the call is not in progress."""
        request = self.request_of(call)
        if request is not None:
            if request is self._current:
                self._current = None
            else:
                self._beside.remove(request)
        return request

    def request_of(self, call: object) -> Request | None:
        """Return the request of a call in progress; ``None`` if the call is not in progress."""
        current = self._current
        if current is not None and current.call is call:
            return current
        return next((each for each in self._beside if each.call is call), None)

    def is_beside(self, call: object) -> bool:
        """Return True if a call is executed beside the call in progress."""
        return any(each.call is call for each in self._beside)

    def attempt(self, serial: int, reserved: int) -> None:
        """Record a further attempt of a request, to which the reply will be sent."""
        number = reserved or serial
        for request in self._unanswered():
            if request.number == number:
                request.serial, request.reserved = serial, reserved

    def clear(self) -> None:
        """Discard all calls and requests."""
        self._current = None
        self._beside.clear()
        self.waiting.clear()
        self._bytes = 0

    # --- time ---------------------------------------------------------------------------------------------------

    def next_time(self) -> float | None:
        """Return the time at which a packet is due; ``None`` if no request is unanswered."""
        times = [request.next_time for request in self._unanswered()]
        return min(times) if times else None

    def due(self, now: float) -> Request | None:
        """Return a request to whose client a packet is due now; ``None`` if there is none."""
        return next((request for request in self._unanswered() if request.next_time <= now), None)

    def time_out(self, request: Request) -> None:
        """Record that E_TIMEOUT has been sent; a request that has waited is not executed."""
        request.timed_out = True
        if request.call is None:
            self.remove(request)

    def _unanswered(self) -> Iterator[Request]:
        """Yield the requests that have not been answered: the call in progress, stops, and those that wait."""
        if self._current is not None and not self._current.timed_out:
            yield self._current
        yield from [request for request in self._beside if not request.timed_out]
        yield from self.waiting
