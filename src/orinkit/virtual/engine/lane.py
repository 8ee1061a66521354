"""A thread for work that takes too long for the lock of a controller: planning, files, compiling.

The work is divided into jobs. A job computes without the lock, and enters the lock only briefly, to read the state that
it needs and to apply its result.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final, TypeVar

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.clock import Clock

T = TypeVar("T")

_IDLE_TIME: Final = 5.0  # s without a job after which the thread ends; starting a thread would delay each job
_CLOSING_TIME: Final = 5.0  # s to wait for the job in progress when the controller is switched off


class Lane:
    """Runs jobs one at a time, in their order, in a daemon thread, which ends after some seconds without jobs.

    With a manual clock, there is no thread: each job is run immediately, so that tests are deterministic.

    Args:
        name: Name of the thread.
        clock: The controller's clock.

    Attributes:
        immediate: True if jobs are run immediately.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.immediate = clock.manual
        self._name = name
        self._changed = threading.Condition()
        self._jobs: deque[tuple[Callable[[], Any], Deferred[Any]]] = deque()
        self._running = False  # the thread exists
        self._working = False  # a job is in progress
        self._closed = False

    def run(self, job: Callable[[], T]) -> T | Deferred[T]:
        """Run a job: return its result, or a Deferred (``brief``) if it is run in the thread.

        Raises:
            CallError: E_ABORT if the lane is closed. If the job is run immediately, its exceptions are passed on.
        """
        return job() if self.immediate else self.submit(job, Deferred(brief=True))

    def submit(self, job: Callable[[], T], done: Deferred[T]) -> Deferred[T]:
        """Run a job in the thread, and settle ``done`` with its result; return ``done``.

        The job, or another thread, may settle ``done`` earlier. A job whose Deferred is settled before it begins is not
        run.

        Raises:
            CallError: E_ABORT if the lane is closed.
        """
        with self._changed:
            if self._closed:
                raise _switched_off()
            self._jobs.append((job, done))
            self._changed.notify_all()
            if not self._running:
                self._running = True
                threading.Thread(target=self._work, name=self._name, daemon=True).start()
        return done

    def close(self, *, waits: bool = False) -> None:
        """Discard the waiting jobs, whose Deferreds fail with E_ABORT; ``waits`` to wait for the job in progress."""
        with self._changed:
            self._closed = True
            jobs, self._jobs = self._jobs, deque()
            self._changed.notify_all()
        for _, done in jobs:
            done.set_exception(_switched_off())
        if waits:
            with self._changed:
                self._changed.wait_for(lambda: not self._working, _CLOSING_TIME)

    def _work(self) -> None:
        while (taken := self._take()) is not None:
            job, done = taken
            if not done.done():
                try:
                    done.set_result(job())
                except BaseException as error:  # noqa: BLE001 - passed to the caller of the job
                    done.set_exception(error)
            del taken, job, done  # frees the arguments and the result

    def _take(self) -> tuple[Callable[[], Any], Deferred[Any]] | None:
        with self._changed:
            self._working = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._jobs or self._closed, _IDLE_TIME)
            self._working = self._running = bool(self._jobs)
            return self._jobs.popleft() if self._jobs else None


def _switched_off() -> BaseException:
    return error_for(hresult.E_ABORT, tr("the controller has been switched off"))
