"""One test body for the synchronous and the asynchronous client.

``both.run(client.call(...))`` gives the result of either: of the synchronous one it is there already, the coroutine
of the asynchronous one is run in an event loop of the test's own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from inspect import isawaitable
from typing import Any

import orinkit
from orinkit import aio


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

    def client(self, url: str, **options: Any) -> Any:
        """Open a raw client."""
        return self.run((orinkit.open_client if self.loop is None else aio.open_client)(url, **options))

    def connect(self, url: str, **options: Any) -> Any:
        """Connect to a controller."""
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
