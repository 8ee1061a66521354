"""One test body for the synchronous and the asynchronous client, over TCP, UDP, serial lines and HTTP.

``both.run(client.call(...))`` gives the result of either: of the synchronous one it is there already, the coroutine
of the asynchronous one is run in an event loop of the test's own.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Coroutine
from inspect import isawaitable
from typing import Any

import pytest

import orinkit
from orinkit import aio

LISTEN_AT = {"tcp": "tcp://127.0.0.1:0", "udp": "udp://127.0.0.1:0", "serial": "pty://", "http": "http://127.0.0.1:0"}
"""Where a server is to listen that is reached over each kind of wire; the fixture ``listen_at`` is one after the other."""


def only(*kinds: str, because: str) -> pytest.MarkDecorator:
    """Have a test over these wires only, and say why."""
    assert because
    return pytest.mark.parametrize("listen_at", kinds, indirect=True)


class Both:
    """Either client; ``kind`` is ``"sync"`` or ``"async"``."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.loop = asyncio.new_event_loop() if kind == "async" else None

    def __repr__(self) -> str:
        return self.kind

    def run(self, result: Any) -> Any:
        """Return the result of a call, whichever client it was made on."""
        if self.loop is None:
            assert not isawaitable(result)
            return result
        return self.loop.run_until_complete(_awaited(result))

    async def now(self, result: Any) -> Any:
        """Return the result of a call in a body of :meth:`side_by_side`."""
        return await result if isawaitable(result) else result

    def side_by_side(self, *bodies: Coroutine[Any, Any, Any]) -> list[Any]:
        """Run bodies at the same time, each in a thread or each as a task, and return their results.

        A body is one for either client: it says ``await both.now(client.call(...))``, and nothing else is awaited.
        """
        if self.loop is not None:
            return self.loop.run_until_complete(_all_of(bodies))
        outcomes: list[Any] = [None] * len(bodies)

        def run(number: int, body: Coroutine[Any, Any, Any]) -> None:
            try:
                body.send(None)  # it never waits: the calls have been made when they return
                outcomes[number] = RuntimeError("a body has awaited something")
            except StopIteration as stop:
                outcomes[number] = stop.value
            except BaseException as error:  # noqa: BLE001 - is raised below
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
        """Connect to a controller; on a serial line it is not asked which dialect it speaks."""
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
        """Close the loop; a task that is left over is an error."""
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
