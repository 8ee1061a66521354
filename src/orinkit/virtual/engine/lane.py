"""Work that takes too long for the lock of a controller, in another thread: planning, files, compiling.

The work is divided into jobs. A job computes without the lock, and enters the lock only briefly, to read the state that
it needs and to apply its result.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from itertools import chain
from time import monotonic
from typing import Any, Final, TypeVar

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.clock import Clock

T = TypeVar("T")

_CLOSING_TIME: Final = 5.0  # s to wait for the job in progress when the controller is switched off


@record
class LaneLimits:
    """Limits on the jobs that wait in a lane.

    Attributes:
        jobs: Maximum number of waiting jobs.
        of_client: Maximum number of waiting jobs of one client.
        seconds: Time that a job may wait; a job that has waited longer is not run.
    """

    jobs: int
    of_client: int
    seconds: float


@record
class _Job:
    run: Callable[[], Any]
    done: Deferred[Any]
    since: float


class Lane:
    """Runs jobs one at a time in a thread of :meth:`Clock.workers <orinkit.virtual.clock.Clock.workers>`.

    The jobs of one client are run in their order. If several clients have waiting jobs, one job of each client is run in
    turn. Controllers with a shared clock share a few threads: each lane runs one job, and then waits until the other
    lanes have had their turns. A lane occupies one thread at most.

    With a manual clock, there is no thread: each job is run immediately, so that tests are deterministic.

    Args:
        name: Name of the threads.
        clock: The controller's clock, which has the threads.
        limits: Limits on waiting jobs; None for no limits.

    Attributes:
        immediate: True if jobs are run immediately.
    """

    def __init__(self, name: str, clock: Clock, limits: LaneLimits | None = None) -> None:
        self.immediate = clock.manual
        self._workers = clock.workers(name)
        self._limits = limits
        self._changed = threading.Condition()
        self._jobs: OrderedDict[object, deque[_Job]] = OrderedDict()  # by client, in the order of their turns
        self._has_turn = False  # the lane waits for its turn, or a job is in progress
        self._working = False  # a job is in progress
        self._closed = False

    def run(self, job: Callable[[], T]) -> T | Deferred[T]:
        """Run a job: return its result, or a Deferred (``brief``) if it is run in the thread.

        Raises:
            CallError: E_ABORT if the lane is closed. If the job is run immediately, its exceptions are passed on.
        """
        return job() if self.immediate else self.submit(job, Deferred(brief=True))

    def submit(self, job: Callable[[], T], done: Deferred[T], client: object = None) -> Deferred[T]:
        """Run a job in the thread, and settle ``done`` with its result; return ``done``.

        The job, or another thread, may settle ``done`` earlier. A job whose Deferred is settled before it begins is not
        run.

        Args:
            job: The job.
            done: Its result.
            client: The client, any hashable object; jobs without a client count as those of one client.

        Raises:
            CallError: E_ABORT if the lane is closed; E_BUSY_PROC if a limit is reached.
        """
        with self._changed:
            if self._closed:
                raise _switched_off()
            if self._limits is not None:
                self._require_room(client, self._limits)
            self._jobs.setdefault(client, deque()).append(_Job(job, done, monotonic()))
            if not self._has_turn:
                self._has_turn = True
                self._workers.add(self._turn)
        return done

    def close(self, *, waits: bool = False) -> None:
        """Discard the waiting jobs, whose Deferreds fail with E_ABORT; ``waits`` to wait for the job in progress."""
        with self._changed:
            self._closed = True
            jobs, self._jobs = self._jobs, OrderedDict()
        for job in chain.from_iterable(jobs.values()):
            job.done.set_exception(_switched_off())
        if waits:
            with self._changed:
                self._changed.wait_for(lambda: not self._working, _CLOSING_TIME)
        self._workers.end_idle()

    def _require_room(self, client: object, limits: LaneLimits) -> None:
        for each, jobs in list(self._jobs.items()):
            waiting = deque(job for job in jobs if not job.done.done())
            if waiting:
                self._jobs[each] = waiting
            else:
                del self._jobs[each]
        if len(self._jobs.get(client, ())) >= limits.of_client or sum(map(len, self._jobs.values())) >= limits.jobs:
            raise _busy()

    def _turn(self) -> None:
        """Run one job; then, if there are more, wait for the next turn."""
        try:
            self._run_next()
        finally:
            with self._changed:
                self._working = False
                self._changed.notify_all()
                self._has_turn = bool(self._jobs)
                if self._has_turn:
                    self._workers.add(self._turn)

    def _run_next(self) -> None:
        job = self._take()
        if job is not None and not job.done.done():
            try:
                self._require_in_time(job)
                job.done.set_result(job.run())
            except BaseException as error:  # noqa: BLE001 - passed to the caller of the job
                job.done.set_exception(error)

    def _require_in_time(self, job: _Job) -> None:
        if self._limits is not None and monotonic() - job.since > self._limits.seconds:
            raise _busy()

    def _take(self) -> _Job | None:
        with self._changed:
            self._working = bool(self._jobs)
            return self._next() if self._jobs else None

    def _next(self) -> _Job:
        """Remove and return the oldest job of the client whose turn it is."""
        client, jobs = next(iter(self._jobs.items()))
        job = jobs.popleft()
        if jobs:
            self._jobs.move_to_end(client)
        else:
            del self._jobs[client]
        return job


def _switched_off() -> BaseException:
    return error_for(hresult.E_ABORT, tr("the controller has been switched off"))


def _busy() -> BaseException:
    return error_for(
        hresult.E_BUSY_PROC,
        tr("too many calls wait, or this call has waited too long. Try: repeat the call later"),
    )
