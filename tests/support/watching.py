"""How long a server's event loop is held up: CPU time of its thread in one callback, so that a busy machine counts for nothing."""

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
"""Seconds of CPU that one callback of a server may take."""

_MARGIN: Final = 5.0  # other tests run beside these and take the caches away; what is caught here takes seconds
_NOMINAL: Final = 0.010  # s that the reference takes on a machine where the bound is exact


@dataclass
class Watch:
    """What the callbacks of one thread have taken.

    Attributes:
        longest: seconds of CPU.
        what: the callback that took them.
        slow: all that took longer than allowed, with the label that was set then.
        label: what is being done.
    """

    allowed: float
    longest: float = 0.0
    what: str = ""
    label: str = ""
    slow: list[tuple[str, float]] = field(default_factory=list)

    def check(self) -> None:
        """Fail where one took longer than allowed."""
        assert not self.slow, f"more than {self.allowed * 1000:.0f} ms: {self.slow}"


def allowed(margin: float) -> float:
    """Return how long a callback may take on this machine: :data:`LONGEST` on a quiet one that is not slower than most."""
    return margin * LONGEST * max(1.0, min(_reference() for _ in range(3)) / _NOMINAL)


def _reference() -> float:
    began = time.thread_time()
    made = [str(number) for number in range(40_000)]
    ",".join(made).split(",")
    return time.thread_time() - began


@contextmanager
def watched(server: Server, *, strict: bool = False) -> Iterator[Watch]:
    """Watch the event loop of a server for the time of a block; strict where nothing else runs on the machine."""
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
    gc.freeze()  # a full collection looks at what the tests have made: that is much more than a server has
    asyncio.Handle._run = timed  # type: ignore[method-assign]
    try:
        yield watch
    finally:
        asyncio.Handle._run = run  # type: ignore[method-assign]
        gc.unfreeze()
