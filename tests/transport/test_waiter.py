"""Waiting on one connection in asyncio: one timer serves waits of any length."""

from __future__ import annotations

import asyncio
import gc
import weakref
from time import monotonic

import pytest

from orinkit.transport.waiter import ConnectionWaiter

PATIENT = 20.0  # a time that must not pass
SHORT = 0.05  # a time that passes


async def elapsed(waiter: ConnectionWaiter, seconds: float, wake_after: float | None = None) -> float:
    if wake_after is not None:
        asyncio.get_running_loop().call_later(wake_after, waiter.wake)
    began = monotonic()
    await waiter.wait(seconds)
    return monotonic() - began


def test_waits_of_any_order_last_as_long_as_they_should() -> None:
    async def body() -> None:
        waiter = ConnectionWaiter()
        for _ in range(3):
            assert await elapsed(waiter, PATIENT, 0.0) < PATIENT / 2  # woken
            assert SHORT * 0.9 <= await elapsed(waiter, SHORT) < PATIENT / 2  # shorter than the timer
            assert await elapsed(waiter, SHORT, 0.0) < PATIENT / 2
            assert 3 * SHORT * 0.9 <= await elapsed(waiter, 3 * SHORT) < PATIENT / 2  # longer than the timer
        waiter.close()

    asyncio.run(body())


def test_a_timer_that_fires_between_two_waits_ends_neither() -> None:
    async def body() -> None:
        waiter = ConnectionWaiter()
        await elapsed(waiter, SHORT, 0.0)
        await asyncio.sleep(2 * SHORT)
        assert await elapsed(waiter, 2 * SHORT) >= 2 * SHORT * 0.9
        waiter.close()

    asyncio.run(body())


def test_closing_wakes_the_task_and_stops_the_timer() -> None:
    async def body() -> None:
        waiter = ConnectionWaiter()
        waiting = asyncio.create_task(elapsed(waiter, PATIENT))
        await asyncio.sleep(0)
        waiter.close()
        assert await waiting < PATIENT / 2
        gone = weakref.ref(waiter)
        del waiter, waiting
        gc.collect()
        assert gone() is None  # the timer does not refer to it any more

    asyncio.run(body())


def test_a_cancelled_wait_is_followed_by_others() -> None:
    async def body() -> None:
        waiter = ConnectionWaiter()
        for _ in range(3):
            waiting = asyncio.create_task(elapsed(waiter, PATIENT))
            await asyncio.sleep(0)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            assert await elapsed(waiter, SHORT) >= SHORT * 0.9
        waiter.close()

    asyncio.run(body())
