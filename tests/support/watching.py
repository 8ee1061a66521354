"""Measuring how long callbacks block a server's event loop, in CPU time of its thread, independent of the machine's load."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from orinkit.server.threaded import Server

LONGEST: Final = 0.020
"""Longest allowed CPU time of a callback of a server, s."""

_MARGIN: Final = 5.0  # tests that run in parallel evict the caches; real faults take seconds
_NOMINAL: Final = 0.010  # s, duration of the reference on the machine for which the bound was chosen


@dataclass
class Watch:
    """CPU times of the callbacks of one thread.

    Attributes:
        allowed: the limit, s.
        longest: the longest CPU time, s.
        what: the callback that took the longest.
        label: the current step of the test.
        slow: the label and CPU time of every callback that exceeded the limit.
    """

    allowed: float
    longest: float = 0.0
    what: str = ""
    label: str = ""
    slow: list[tuple[str, float]] = field(default_factory=list)

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
def watched(server: Server, *, strict: bool = False) -> Iterator[Watch]:
    """Measure the callbacks of a server for the duration of a block; ``strict`` if nothing else runs on the machine."""
    watch = Watch(allowed(1.0 if strict else _MARGIN))
    thread = server._thread
    run = asyncio.Handle._run

    def timed(handle: asyncio.Handle) -> None:
        if threading.current_thread() is not thread:
            run(handle)
            return
        what = repr(handle)[:300]
        began = time.thread_time()
        run(handle)
        took = time.thread_time() - began
        if took > watch.longest:
            watch.longest, watch.what = took, what
        if took > watch.allowed:
            watch.slow.append((watch.label, round(took, 4)))

    gc.collect()
    gc.freeze()  # a full collection would visit the objects of the tests, many more than those of a server
    asyncio.Handle._run = timed  # type: ignore[method-assign]
    try:
        yield watch
    finally:
        asyncio.Handle._run = run  # type: ignore[method-assign]
        gc.unfreeze()
