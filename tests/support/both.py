"""One test body for the synchronous and the asynchronous client, over TCP, UDP, serial lines and HTTP.

``both.run(client.call(...))`` returns the result of either: the synchronous client returns it directly; the coroutine of
the asynchronous one is run in a separate event loop for each test.
"""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections.abc import Awaitable, Callable, Coroutine
from inspect import isawaitable
from typing import Any

import pytest

import orinkit
from orinkit import aio

LISTEN_AT = {"tcp": "tcp://127.0.0.1:0", "udp": "udp://127.0.0.1:0", "serial": "pty://", "http": "http://127.0.0.1:0"}
"""Listen address for each transport; the fixture ``listen_at`` takes each of them in turn."""


def only(*kinds: str, because: str) -> pytest.MarkDecorator:
    """Restrict a test to these transports, with the reason."""
    assert because
    return pytest.mark.parametrize("listen_at", kinds, indirect=True)


class Both:
    """Either client; ``kind`` is ``"sync"`` or ``"async"``."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.loop = asyncio.new_event_loop() if kind == "async" else None
        if self.loop is not None:  # a test that ends early, for example for lack of an extra, does not close it
            weakref.finalize(self, self.loop.close)

    def __repr__(self) -> str:
        return self.kind

    def run(self, result: Any) -> Any:
        """Return the result of a call of either client."""
        if self.loop is None:
            assert not isawaitable(result)
            return result
        return self.loop.run_until_complete(_awaited(result))

    async def now(self, result: Any) -> Any:
        """Return the result of a call in a body of :meth:`side_by_side`."""
        return await result if isawaitable(result) else result

    def side_by_side(self, *bodies: Coroutine[Any, Any, Any]) -> list[Any]:
        """Run bodies concurrently, each in a thread or as a task, and return their results.

        The same body serves both clients: it uses ``await both.now(client.call(...))`` and awaits nothing else.
        """
        if self.loop is not None:
            return self.loop.run_until_complete(_all_of(bodies))
        outcomes: list[Any] = [None] * len(bodies)

        def run(number: int, body: Coroutine[Any, Any, Any]) -> None:
            try:
                body.send(None)  # never suspends: synchronous calls are complete when they return
                outcomes[number] = RuntimeError("a body has awaited something")
            except StopIteration as stop:
                outcomes[number] = stop.value
            except BaseException as error:  # noqa: BLE001 - raised below
                outcomes[number] = error

        threads = [threading.Thread(target=run, args=each, daemon=True) for each in enumerate(bodies)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for outcome in outcomes:
            if isinstance(outcome, BaseException):
                raise outcome
        return outcomes

    def client(self, url: str, **options: Any) -> Any:
        """Open a raw client."""
        return self.run((orinkit.open_client if self.loop is None else aio.open_client)(url, **options))

    def connect(self, url: str, **options: Any) -> Any:
        """Connect to a controller; on a serial line the dialect is given instead of detected."""
        if url.startswith("serial"):
            options.setdefault("dialect", "rc8")
        return self.run((orinkit.connect if self.loop is None else aio.connect)(url, **options))

    def within(self, manager: Any, body: Callable[[Any], None]) -> None:
        """Run a body inside ``with`` or ``async with``."""
        if self.loop is None:
            with manager as entered:
                body(entered)
            return
        entered = self.run(manager.__aenter__())
        try:
            body(entered)
        except BaseException as error:
            self.run(manager.__aexit__(type(error), error, error.__traceback__))
            raise
        self.run(manager.__aexit__(None, None, None))

    def close(self) -> None:
        """Close the loop; an unfinished task is an error."""
        if self.loop is not None:
            self.loop.run_until_complete(asyncio.sleep(0))
            left = asyncio.all_tasks(self.loop)
            self.loop.close()
            assert not left


async def _awaited(result: Awaitable[Any]) -> Any:
    return await result


async def _all_of(bodies: tuple[Coroutine[Any, Any, Any], ...]) -> list[Any]:
    try:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(body) for body in bodies]
    except BaseExceptionGroup as failed:
        raise failed.exceptions[0] from None
    return [task.result() for task in tasks]
