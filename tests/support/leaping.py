"""Simulated time: the clock of a server's event loop can leap, and a manual device clock can run in a thread.

A silence of a minute takes no time, and no deadline passes because the machine is slow.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from orinkit.server.threaded import Server
from orinkit.virtual.clock import ManualClock
from support.waiting import PATIENCE, until

TURNS = 10
"""Iterations of an event loop that suffice to run all due callbacks and those that they schedule."""


class LeapingLoop(asyncio.SelectorEventLoop):
    """An event loop whose time can leap.

    Attributes:
        ahead: the offset to real time, s.
    """

    ahead = 0.0

    def time(self) -> float:
        return super().time() + self.ahead


def leap(server: Server, seconds: float) -> None:
    """Advance the time of a server's loop; return after all callbacks due by then have run."""
    loop = server._loop

    async def body() -> None:
        time = loop.time
        loop.time = lambda: time() + seconds
        await _turn()

    asyncio.run_coroutine_threadsafe(body(), loop).result(PATIENCE)


def take_turns(server: Server) -> None:
    """Wait until a server has run all due callbacks and those that they schedule."""
    asyncio.run_coroutine_threadsafe(_turn(), server._loop).result(PATIENCE)


async def _turn() -> None:
    for _ in range(TURNS):
        await asyncio.sleep(0)


def settle(server: Server) -> None:
    """Wait until a server has noticed that every client has disconnected and has released their objects."""
    context = server._server._context
    until(lambda: not (context.open or context.all or context.opening or context.tasks))
    take_turns(server)


def see_broken(server: Server) -> None:
    """Wait until a server has noticed that an HTTP connection with a call in progress is broken."""
    until(lambda: any(getattr(each, "_broken", False) for each in list(server._server._context.open)))
    take_turns(server)


@contextmanager
def going(clock: ManualClock, step: float = 0.016) -> Iterator[None]:
    """Advance a manual clock in a thread while the block waits for the device."""
    ending = threading.Event()

    def go() -> None:
        while not ending.wait(0.0005):
            clock.advance(step)

    thread = threading.Thread(target=go)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join(PATIENCE)
    assert not thread.is_alive()
