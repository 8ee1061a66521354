"""Measuring how long a server is blocked, in CPU time of a thread, independent of the machine's load.

Three things block a server: a callback of its event loop, a thread that holds the lock of a virtual controller, and a
garbage collection in any thread.
"""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from orinkit.server.threaded import Server
from orinkit.virtual.engine.control_loop import ControlLoop

LONGEST: Final = 0.020
"""Longest allowed CPU time of a callback of a server, of holding the lock, and of a garbage collection, s."""

_MARGIN: Final = 5.0  # tests that run in parallel evict the caches; real faults take seconds
_REPEATED_MARGIN: Final = 1.0  # for :func:`never_blocks`
_ATTEMPTS: Final = 4
_NOMINAL: Final = 0.010  # s, duration of the reference on the machine for which the bound was chosen


@dataclass
class Watch:
    """CPU times during which a server was blocked.

    Attributes:
        allowed: the limit, s.
        longest: the longest CPU time, s.
        what: what took the longest.
        label: the current step of the test.
        slow: the label, the CPU time and the reason of everything that exceeded the limit.
    """

    allowed: float
    longest: float = 0.0
    what: str = ""
    label: str = ""
    slow: list[tuple[str, float, str]] = field(default_factory=list)

    def add(self, took: float, what: str) -> None:
        """Add a CPU time, s, and what took it."""
        if took > self.longest:
            self.longest, self.what = took, what
        if took > self.allowed:
            self.slow.append((self.label, round(took, 4), what))

    def check(self) -> None:
        """Fail if a callback has exceeded the limit."""
        assert not self.slow, f"more than {self.allowed * 1000:.0f} ms: {self.slow}"


def allowed(margin: float) -> float:
    """Return the limit for a callback in s: ``margin`` times :data:`LONGEST`, or more if this machine is slow."""
    return margin * LONGEST * max(1.0, min(_reference() for _ in range(3)) / _NOMINAL)


def _reference() -> float:
    began = time.thread_time()
    made = [str(number) for number in range(40_000)]
    ",".join(made).split(",")
    return time.thread_time() - began


@contextmanager
def watched(server: Server, *, strict: bool = False, margin: float = _MARGIN) -> Iterator[Watch]:
    """Measure what blocks a server for the duration of a block; ``strict`` if nothing else runs on the machine."""
    watch = Watch(allowed(1.0 if strict else margin))
    thread = server._thread
    run = asyncio.Handle._run

    def timed(handle: asyncio.Handle) -> None:
        if threading.current_thread() is not thread:
            run(handle)
            return
        what = repr(handle)[:300]
        began = time.thread_time()
        run(handle)
        watch.add(time.thread_time() - began, what)

    gc.collect()
    gc.freeze()  # a full collection would visit the objects of the tests, many more than those of a server
    asyncio.Handle._run = timed
    try:
        with _locks_watched(watch), _collections_watched(watch):
            yield watch
    finally:
        asyncio.Handle._run = run
        gc.unfreeze()


@contextmanager
def _locks_watched(watch: Watch) -> Iterator[None]:
    enter, leave = ControlLoop.__enter__, ControlLoop.__exit__
    held = threading.local()

    def enter_timed(cycles: ControlLoop) -> None:
        depth = getattr(held, "depth", 0)
        if not depth:
            held.began = time.thread_time()
        enter(cycles)
        held.depth = depth + 1

    def leave_timed(cycles: ControlLoop, *error: object) -> None:
        leave(cycles, *error)
        held.depth = getattr(held, "depth", 1) - 1
        if not held.depth:
            watch.add(time.thread_time() - held.began, f"lock held by {threading.current_thread().name}")

    ControlLoop.__enter__, ControlLoop.__exit__ = enter_timed, leave_timed
    try:
        yield
    finally:
        ControlLoop.__enter__, ControlLoop.__exit__ = enter, leave


@contextmanager
def _collections_watched(watch: Watch) -> Iterator[None]:
    began = 0.0

    def collected(phase: str, info: dict[str, int]) -> None:
        nonlocal began
        if phase == "start":
            began = time.thread_time()
        else:
            watch.add(time.thread_time() - began, f"garbage collection {info}")

    gc.callbacks.append(collected)
    try:
        yield
    finally:
        gc.callbacks.remove(collected)


def never_blocks(server: Server, act: Callable[[Watch], None]) -> None:
    """Fail if the server is blocked each time that a function is called; it is called several times at most.

    If other processes slow the machine down, a single measurement is not reliable. A real fault takes as long each time.
    """
    for _ in range(_ATTEMPTS):
        with watched(server, margin=_REPEATED_MARGIN) as watch:
            act(watch)
        if not watch.slow:
            return
    watch.check()


@contextmanager
def calls_per_turn(server: Server, owner: type, name: str) -> Iterator[list[int]]:
    """Count the calls of a method in each turn of the server's event loop; the time that they take has no effect.

    Yields:
        A list of the counts of all turns.
    """
    thread = server._thread
    method, run_once = getattr(owner, name), asyncio.BaseEventLoop._run_once
    counts = [0]

    def counted(*arguments: object, **named: object) -> object:
        if threading.current_thread() is thread:
            counts[-1] += 1
        return method(*arguments, **named)

    def turn(loop: asyncio.BaseEventLoop) -> None:
        if threading.current_thread() is thread and counts[-1]:
            counts.append(0)
        run_once(loop)

    setattr(owner, name, counted)
    asyncio.BaseEventLoop._run_once = turn
    try:
        yield counts
    finally:
        setattr(owner, name, method)
        asyncio.BaseEventLoop._run_once = run_once
