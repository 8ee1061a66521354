"""Polling that several pages share: :class:`SharedPoll`."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from typing import Protocol

from orinkit.client._async.controller import AsyncController
from orinkit.client._async.robot import AsyncRobot

logger = logging.getLogger("orinkit.tester")


class PollSource(Protocol):
    """The connection to poll."""

    @property
    def name(self) -> str:
        """The name of the connection."""

    async def monitor(self) -> AsyncController:
        """Return the controller object for polling."""

    async def monitored_robot(self) -> AsyncRobot:
        """Return the robot object for polling."""


class SharedPoll(ABC):
    """Base class of what polls a controller or a driver while at least one page uses it."""

    def __init__(self) -> None:
        self._users = 0
        self._task: asyncio.Task[None] | None = None
        self._wake = asyncio.Event()

    @property
    def polling(self) -> bool:
        """True while a page uses the values."""
        return self._users > 0

    def begin(self) -> None:
        """Note that one more page uses the values; polling starts, or the next cycle begins at once."""
        self._users += 1
        self._wake.set()
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._run())

    def end(self) -> None:
        """Note that a page no longer uses the values. After the last one, polling ends with the current cycle."""
        self._users -= 1
        self._wake.set()

    async def _run(self) -> None:
        while self._users:
            self._wake.clear()
            pause = await self._cycle()
            try:
                await asyncio.wait_for(self._wake.wait(), pause)
            except TimeoutError:
                continue
            finally:
                if not self._users:
                    await self._finish()  # meanwhile, another page may have begun

    @abstractmethod
    async def _cycle(self) -> float:
        """Read everything once; return the time in s to the next cycle. Errors of the connection are not raised."""

    async def _finish(self) -> None:
        """Release objects after the last cycle; there are none by default."""
        return
