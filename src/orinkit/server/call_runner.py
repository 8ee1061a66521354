"""Awaiting the result of a provider's method: a blocking call, a :class:`Deferred`, or an awaitable."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from orinkit.cao.provider import BlockingCall, Deferred


def result_of(work: Any) -> Awaitable[Any]:
    """Return an awaitable for the result of a call.

    Args:
        work: ``Pending.work``: a :class:`~orinkit.cao.provider.BlockingCall`, a
            :class:`~orinkit.cao.provider.Deferred`, or an awaitable.
    """
    if type(work) is BlockingCall:
        return in_thread(work.run)
    if type(work) is Deferred:
        return wait_deferred(work)
    awaitable: Awaitable[Any] = work
    return awaitable


def is_cancellable(work: Any) -> bool:
    """Return True if ``Pending.work`` ends when its task is cancelled; work in another thread continues."""
    return type(work) is not BlockingCall and not (type(work) is Deferred and work.brief)


def abandon(work: Any) -> None:
    """Inform the device that the client no longer waits for ``Pending.work`` (:meth:`Deferred.abandon`)."""
    if type(work) is Deferred:
        work.abandon()


async def in_thread(function: Callable[[], Any]) -> Any:
    """Run a function in its own thread; return its result, or raise its exception.

    The thread is not one of asyncio's executor, for two reasons. First, if ``function`` never returns, a daemon thread
    does not prevent the program from exiting, but a thread of the executor does. Second, ``function`` may raise
    StopIteration, which the future that the executor returns cannot hold.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    outcome: list[tuple[bool, Any]] = []

    def run() -> None:
        try:
            outcome.append((True, function()))
        except BaseException as error:  # noqa: BLE001 - in_thread raises it again
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
    if isinstance(value, StopIteration):  # a coroutine cannot raise StopIteration
        raise RuntimeError(f"StopIteration: {value}") from value  # noqa: TRY004 - Python itself raises RuntimeError
    raise value


async def wait_deferred(deferred: Deferred[Any]) -> Any:
    """Wait for a deferred result; return it, or raise the exception of the call.

    If the result is another Deferred, wait for that one.
    """
    await _settled(deferred)
    result = deferred.result()
    if type(result) is not Deferred:
        return result
    return await wait_deferred(result)


async def _settled(deferred: Deferred[Any]) -> None:
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    def finish_threadsafe() -> None:
        try:
            loop.call_soon_threadsafe(finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    deferred.add_done_callback(finish_threadsafe)
    await done
