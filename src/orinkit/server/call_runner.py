"""Waiting for what a device's method has begun, in the three ways that there are."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from orinkit.cao.provider import BlockingCall, Deferred


def result_of(work: Any) -> Awaitable[Any]:
    """Return what gives the result when it is awaited.

    Args:
        work: ``Pending.work``: :class:`~orinkit.cao.provider.Blocking`, :class:`~orinkit.cao.provider.Later`, or an
            awaitable.
    """
    if type(work) is BlockingCall:
        return in_thread(work.run)
    if type(work) is Deferred:
        return later(work)
    awaitable: Awaitable[Any] = work
    return awaitable


async def in_thread(function: Callable[[], Any]) -> Any:
    """Run a function in a thread of its own and return what it returns, or raise what it raises.

    Not in asyncio's executor: a daemon thread does not keep the program from ending, should the function never return;
    and what it raises may be anything, such as StopIteration, which no future can hold.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    outcome: list[tuple[bool, Any]] = []

    def run() -> None:
        try:
            outcome.append((True, function()))
        except BaseException as error:  # noqa: BLE001 - raised again where it is awaited
            outcome.append((False, error))
        try:
            loop.call_soon_threadsafe(finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    threading.Thread(target=run, name="orinkit-worker", daemon=True).start()
    await done
    succeeded, value = outcome[0]
    if succeeded:
        return value
    if isinstance(value, StopIteration):  # would end the coroutine instead of telling of the error
        raise RuntimeError(f"StopIteration: {value}") from value  # noqa: TRY004 - as Python itself does
    raise value


async def later(promise: Deferred[Any]) -> Any:
    """Wait for a result that the device has promised and return it, or raise what the call failed with."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    def finish_from_anywhere() -> None:
        try:
            loop.call_soon_threadsafe(finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    promise.add_done_callback(finish_from_anywhere)
    await done
    return promise.result()
