"""Shares the time of an event loop between the clients of all servers that run in it.

A client may send any number of requests without waiting for their replies. If the server processed all of them at once,
every other client would have to wait, and with it the emergency stop. Therefore received data is processed in steps. A
step is the smallest unit of work, usually one call. Each turn of the event loop performs steps for :data:`BUDGET`
seconds. After that, the loop looks for new data before it continues.

A client that sends one request at a time is served immediately, without queueing, while the budget lasts. All other
clients wait in the queue. The client that has used the least time is served next, for :data:`SLICE` seconds at a time
(fair queueing). Time counts, not the number of steps. Of two clients that have used the same time, the one with the
shorter work is served first: a small packet does not wait for the large packets of many clients. Clients with
precedence are served before all others.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextvars import Context
from heapq import heappop, heappush
from typing import Final
from weakref import WeakKeyDictionary

logger = logging.getLogger("orinkit.server")

BUDGET: Final = 0.004
"""Seconds of a turn of the event loop after which further steps wait for the next turn."""
SLICE: Final = 0.0005
"""Seconds after which a client has to wait while other clients are served."""
_RENEWAL: Final = BUDGET / 2
"""Used seconds after which the budget is renewed in the next turn of the event loop.

The turns of many clients that send one request at a time are short. Their budget is renewed before it is used up, so
that none of them is queued. To renew it in every turn would take longer than many a call.
"""


class QueuedClient(ABC):
    """A client, a connection, or a piece of work that a :class:`FairQueue` serves: the base class.

    Attributes:
        virtual_time: the position in the queue: the time in s that the client has used, or that the other clients had
            used when it began to use the server.
        is_queued: True while the client waits in the queue, or a step is in progress.
        has_precedence: True if the client is served before clients without precedence.
    """

    virtual_time = 0.0
    is_queued = False
    has_precedence = False

    @abstractmethod
    def step(self) -> bool:
        """Process the next piece of received data, usually one call.

        Returns:
            True if the client has more to process now. If it has not, it calls :meth:`FairQueue.serve` later.
        """

    def resume(self) -> None:  # noqa: B027 - optional
        """Prepare for further steps after the client has waited in the queue."""

    @abstractmethod
    def abort(self) -> None:
        """Disconnect, because a step has raised an exception."""


class _Rank:
    """The clients of one rank.

    Attributes:
        heap: the waiting clients: the virtual time at which the work of the client is expected to end, a number that
            keeps clients with the same time in their order, the virtual time at which the work begins, the client.
        virtual_time: the time in s that each of the clients could have used so far; a new client begins here.
    """

    __slots__ = ("heap", "virtual_time")

    def __init__(self) -> None:
        self.heap: list[tuple[float, int, float, QueuedClient]] = []
        self.virtual_time = 0.0


class FairQueue:
    """Serves the clients of one event loop in steps; see the description of the module.

    Args:
        clock: function that returns the time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._first = _Rank()
        self._others = _Rank()
        self._numbers = itertools.count()  # clients with the same virtual time are served in the order of their arrival
        self._used = 0.0  # time used by steps since the budget was last renewed
        self._ended: float | None = None  # end of the previous turn, if clients are waiting since then
        self._scheduled = False
        self._context = Context()

    def serve(self, client: QueuedClient, expected: float = 0.0) -> None:
        """Process the received data of a client: now, or when it is the client's turn.

        The caller stops receiving from the client while :attr:`QueuedClient.is_queued` is True.

        Args:
            client: the client.
            expected: time in s that the data may take; a rough upper limit.
        """
        if client.is_queued:
            return
        precedence = client.has_precedence
        rank = self._first if precedence else self._others
        heap = rank.heap
        start = rank.virtual_time
        if client.virtual_time > start:
            start = client.virtual_time
        if (self._used < BUDGET or precedence) and not (heap and heap[0][0] < start + expected):
            expected = self._run(client, rank, start)
            if not expected:
                return
            start = client.virtual_time
        self._push(rank, client, start, expected)
        self._schedule()

    def _push(self, rank: _Rank, client: QueuedClient, start: float, expected: float) -> None:
        client.is_queued = True
        heappush(rank.heap, (start + expected, next(self._numbers), start, client))

    def _run(self, client: QueuedClient, rank: _Rank, start: float) -> float:
        """Perform steps of a client for one slice.

        Returns:
            The time used, s, at most :data:`BUDGET`, if the client has more to process; otherwise 0.
        """
        clock = self._clock
        client.is_queued = True
        began = now = clock()
        try:
            while more := client.step():
                now = clock()
                if now - began >= SLICE:
                    break
        except Exception:
            logger.exception("error while processing received data")
            client.abort()
            more = False
        client.is_queued = False
        if not more:
            now = clock()
        took = now - began
        if took > BUDGET:  # the step was probably interrupted; the client is not to blame
            took = BUDGET
        client.virtual_time = end = start + took
        if rank.heap:
            end = max(rank.virtual_time, start) + took / (len(rank.heap) + 1)
        rank.virtual_time = end
        self._used = used = self._used + took
        if used >= _RENEWAL:
            self._schedule()  # renews the budget
        return took if more else 0.0

    def _schedule(self) -> None:
        if not self._scheduled:
            self._scheduled = True
            asyncio.get_running_loop().call_soon(self._turn, context=self._context)

    def _turn(self) -> None:
        """Renew the budget, and serve the clients that are waiting.

        The time that the loop has spent on other work since the previous turn counts, too, up to half of the budget.
        Part of this work follows from the steps of the previous turn, for example the tasks of HTTP requests.
        """
        self._scheduled = False
        self._used = 0.0 if self._ended is None else min(self._clock() - self._ended, BUDGET / 2)
        self._serve(self._first, BUDGET / 2)
        self._serve(self._others, BUDGET)
        if self._first.heap or self._others.heap:
            self._ended = self._clock()
            self._schedule()
        else:
            self._ended = None

    def _serve(self, rank: _Rank, limit: float) -> None:
        """Serve the waiting clients of one rank until the limit on the used time is reached; serve at least one."""
        heap = rank.heap
        while heap:
            _, _, start, client = heappop(heap)
            client.resume()
            took = self._run(client, rank, start)
            if took:  # the client's next slice probably takes the same time
                self._push(rank, client, client.virtual_time, took)
            if self._used >= limit:
                return


_QUEUES: Final[WeakKeyDictionary[asyncio.AbstractEventLoop, FairQueue]] = WeakKeyDictionary()


def queue_of(loop: asyncio.AbstractEventLoop) -> FairQueue:
    """Return the queue of an event loop, which all servers in this loop share."""
    found = _QUEUES.get(loop)
    if found is None:
        found = _QUEUES[loop] = FairQueue()
    return found
