"""Time in a test's hand: the clock of a server's event loop leaps, and a device's clock goes on while something is done.

A silence of a minute takes no time, and no limit runs out because the machine was slow.
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
"""Of an event loop, in which whatever is due is done, and what follows from it."""


class LeapingLoop(asyncio.SelectorEventLoop):
    """An event loop whose time can leap.

    Attributes:
        ahead: seconds by which it has.
    """

    ahead = 0.0

    def time(self) -> float:
        return super().time() + self.ahead


def leap(server: Server, seconds: float) -> None:
    """Have the time of a server's loop leap; returns when everything that is due then has been done."""
    loop = server._loop

    async def body() -> None:
        time = loop.time
        loop.time = lambda: time() + seconds  # type: ignore[method-assign]
        await _turn()

    asyncio.run_coroutine_threadsafe(body(), loop).result(PATIENCE)


def take_turns(server: Server) -> None:
    """Wait until a server has done what was to be done, and what follows from it."""
    asyncio.run_coroutine_threadsafe(_turn(), server._loop).result(PATIENCE)


async def _turn() -> None:
    for _ in range(TURNS):
        await asyncio.sleep(0)


def settle(server: Server) -> None:
    """Wait until a server has seen every client go and has cleaned up behind all of them."""
    shared = server._server._connections
    until(lambda: not (shared.open or shared.all or shared.opening or shared.tasks))
    take_turns(server)


def see_broken(server: Server) -> None:
    """Wait until a server has seen that the connection of a client of HTTP is gone on which a call was at work."""
    until(lambda: any(getattr(each, "_broken", False) for each in list(server._server._connections.open)))
    take_turns(server)


@contextmanager
def going(clock: ManualClock, step: float = 0.016) -> Iterator[None]:
    """Have a clock that is moved by hand go on, in a thread, while something is done that waits for the device."""
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
