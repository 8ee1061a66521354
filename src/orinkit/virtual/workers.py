"""Threads that several controllers share for their long work: :class:`Workers`."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

logger = logging.getLogger("orinkit.rc8")

IDLE_TIME: Final = 5.0  # s without work after which a thread ends; starting a thread would delay each job


class Workers:
    """A limited number of daemon threads, which call functions in the order in which they were added.

    A thread is started if work waits and no thread is idle. It ends after some seconds without work.

    Args:
        name: Name of the threads.
        most: Maximum number of threads.
    """

    def __init__(self, name: str, most: int = 1) -> None:
        self._name = name
        self._most = most
        self._changed = threading.Condition()
        self._turns: deque[Callable[[], object]] = deque()
        self._threads = 0
        self._idle = 0  # threads that wait for work
        self._ends = 0  # calls of end_idle()

    def add(self, turn: Callable[[], object]) -> None:
        """Call a function in a thread, after all functions that were added before."""
        with self._changed:
            self._turns.append(turn)
            if self._idle >= len(self._turns):
                self._changed.notify()
            elif self._threads < self._most:
                self._threads += 1
                threading.Thread(target=self._work, name=self._name, daemon=True).start()

    def end_idle(self) -> None:
        """End the threads that have nothing to do; :meth:`add` starts threads again."""
        with self._changed:
            self._ends += 1
            self._changed.notify_all()

    def _work(self) -> None:
        ends = self._ends
        while (turn := self._next(ends)) is not None:
            ends = self._ends  # read before the turn, so that an end_idle() during the turn has an effect
            try:
                turn()
            except Exception:
                logger.exception("error in the thread %s", self._name)
            del turn  # frees the arguments and the result

    def _next(self, ends: int) -> Callable[[], object] | None:
        """Wait for work, and return it; return ``None`` if the thread must end: ``ends`` is not the present number."""
        with self._changed:
            self._idle += 1
            self._changed.wait_for(lambda: self._turns or self._ends != ends, IDLE_TIME)
            self._idle -= 1
            if self._turns:
                return self._turns.popleft()
            self._threads -= 1
            return None
