"""Decoding and encoding of large packets and results in a worker thread, one at a time; their size in memory.

Python runs one thread at a time. While the worker executes Python code, the event loop gets a turn every 5 ms.
Therefore one worker serves all clients, and it makes no long call into C (:mod:`orinkit.values.codec` reads and writes
arrays in slices).
"""

from __future__ import annotations

import asyncio
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final, Generic, TypeVar

from orinkit.bcap.server import LARGE
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.server import capacity
from orinkit.values.variant import VARIANT_ARRAY, Variant

T = TypeVar("T")

_SAMPLE: Final = 1000  # number of elements of which memory_of determines the size
_OBJECT: Final = 128  # bytes of a Variant and of a small value
_POINTER: Final = 8
_NUMBER: Final = 48  # bytes of a number in a list, with its pointer and its bytes in a packet
_ELEMENT: Final = 16  # bytes counted per array element; more than the actual size, because dates are slow to convert


def is_large(result: Variant) -> bool:
    """Return True if a result takes long to encode, in binary or as text; inspect as few elements as possible."""
    left = LARGE
    rest: list[Any] = [result]
    while rest and left >= 0:
        item = rest.pop()
        value = item.value if isinstance(item, Variant) else item
        if isinstance(value, Variant):  # in a VT_VARIANT
            rest.append(value)
        elif isinstance(value, str | bytes):
            left -= len(value)
        elif isinstance(value, list):
            left -= _ELEMENT * len(value)
            if left >= 0 and value and (item.type == VARIANT_ARRAY or isinstance(value[0], str)):
                rest += value
    return left < 0


def memory_of(values: Iterable[Variant]) -> int:
    """Return an estimate of the memory in bytes that values require, decoded and encoded.

    Elements of long arrays are sampled.
    """
    total = 0.0
    left = _SAMPLE
    rest: list[tuple[Any, float]] = [(each, 1.0) for each in values]
    while rest:
        item, weight = rest.pop()
        value = item.value if isinstance(item, Variant) else item
        size = _OBJECT
        if isinstance(value, Variant):  # in a VT_VARIANT
            rest.append((value, weight))
        elif isinstance(value, str):
            size += sys.getsizeof(value) + 2 * len(value)
        elif isinstance(value, bytes):
            size += 2 * len(value)
        elif isinstance(value, list) and value and isinstance(value[0], Variant | str):
            size += _POINTER * len(value)
            sample = value[:: max(1, len(value) // max(1, left))]
            left -= len(sample)
            rest += [(each, weight * len(value) / len(sample)) for each in sample]
        elif isinstance(value, list):
            size += _NUMBER * len(value)
        total += weight * size
    return int(total)


def out_of_memory() -> CallError:
    """Return the exception for a call whose arguments or result exceed the memory of the server for calls."""
    return error_for(
        hresult.E_OUTOFMEMORY,
        tr(
            "the calls in progress and the unsent replies of all clients exceed the limit of {most} bytes. Try: repeat "
            "the call later, or transfer less at a time",
            most=capacity.CALL_MEMORY,
        ),
    )


class _Job(Generic[T]):
    """A function to be run by the worker, and its result."""

    __slots__ = ("done", "error", "function", "loop", "result")

    def __init__(self, function: Callable[[], T], loop: asyncio.AbstractEventLoop) -> None:
        self.function: Callable[[], T] | None = function
        self.loop = loop
        self.done: asyncio.Future[None] = loop.create_future()
        self.result: T | None = None
        self.error: BaseException | None = None

    def run(self) -> None:
        function, self.function = self.function, None
        if function is None:  # the job was cancelled before it began
            return
        try:
            self.result = function()
        except BaseException as error:  # noqa: BLE001 - Worker.run raises it again
            self.error = error
        del function  # frees the packet that the function has decoded
        try:
            self.loop.call_soon_threadsafe(self._finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    def _finish(self) -> None:
        if not self.done.done():
            self.done.set_result(None)


class Worker:
    """Runs functions one at a time in a daemon thread, which exists only while there is work."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._jobs: deque[_Job[Any]] = deque()
        self._running = False

    async def run(self, function: Callable[[], T]) -> T:
        """Run a function; return its result, or raise its exception.

        If this coroutine is cancelled before the function begins, the function is not executed.
        """
        job = _Job(function, asyncio.get_running_loop())
        with self._lock:
            self._jobs.append(job)
            starts = not self._running
            self._running = True
        if starts:
            threading.Thread(target=self._work, name="orinkit-large", daemon=True).start()
        del function
        try:
            await job.done
        except asyncio.CancelledError:
            job.function = None
            raise
        if job.error is not None:
            raise job.error
        result: T = job.result  # type: ignore[assignment]  # set if there is no error
        return result

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._jobs:
                    self._running = False
                    return
                job = self._jobs.popleft()
            job.run()
            del job
