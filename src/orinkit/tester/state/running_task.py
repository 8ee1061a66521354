"""A program that was started on the page Programs: :class:`RunningTask`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Final

from orinkit.core.errors import CallError, OrinError
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.poller import VariableRef, Watch
from orinkit.tester.state.workspace import ActiveMotion

logger = logging.getLogger("orinkit.tester")

_CHECK: Final = 0.1  # s
_STOPPING: Final = 5.0  # s in which a task must have stopped
_STANDSTILL: Final = 0.001  # deg; smallest change of a joint that counts as a motion
_BETWEEN: Final = 0.05  # s between two readings of the joints
_TRIES: Final = 3
_BACKGROUND: Final[set[asyncio.Task[None]]] = set()


class RunningTask:
    """A program that runs because a user has started it here. It is in ``workspace.motions`` while it runs.

    Args:
        connection: The connection to the controller.
        name: Name of the task.
        motions: ``workspace.motions``.

    Attributes:
        finished: Set when the program no longer runs.
    """

    def __init__(self, connection: ControllerConnection, name: str, motions: set[ActiveMotion]) -> None:
        self.name = name
        self.finished = asyncio.Event()
        self._connection = connection
        self._motions = motions

    async def start(self, mode: TaskMode) -> None:
        """Start the program (Task_Start).

        Raises:
            CallError: If the controller refuses.
            OrinError: If there is no reply; the program may run, and counts as running.
        """
        self._motions.add(self)
        try:
            async with await self._connection.controller.task(self.name) as task:
                await task.start(mode)
        except CallError:
            self._end()
            raise
        finally:
            if not self.finished.is_set():
                _in_background(self._follow())

    async def stop(self, reason: str) -> None:
        """Stop the program immediately (Task_Stop), and wait until the arm no longer moves.

        Args:
            reason: Why, for the log.

        Raises:
            OrinError: If the program may not have stopped.
            TimeoutError: If the program or the arm has not stopped within 5 s.
        """
        logger.info("%s: stopping the program %s: %s", self._connection.name, self.name, reason)
        controller = await self._connection.monitor()
        async with await controller.task(self.name) as task:
            await task.stop(StopMode.INSTANT)
            await task.wait(_STOPPING)
        self._end()
        await asyncio.wait_for(self._standstill(), _STOPPING)

    def stop_when(self, lost: Callable[[], Awaitable[str]], wanted: Callable[[], bool]) -> None:
        """Stop the program when the user is gone.

        Args:
            lost: Function that waits until the user is gone, and returns the reason.
            wanted: Function that returns True if the program is then to be stopped.
        """
        _in_background(self._stop_when(lost, wanted))

    async def _stop_when(self, lost: Callable[[], Awaitable[str]], wanted: Callable[[], bool]) -> None:
        leaving = asyncio.ensure_future(lost())
        ending = asyncio.ensure_future(self.finished.wait())
        await asyncio.wait((leaving, ending), return_when=asyncio.FIRST_COMPLETED)
        for each in (leaving, ending):
            each.cancel()
        if self.finished.is_set() or leaving.cancelled() or not wanted():
            return None
        for _ in range(_TRIES):
            try:
                await self.stop(leaving.result())
            except (OrinError, OSError) as error:
                logger.warning("%s: cannot stop the program %s: %s", self._connection.name, self.name, error)
                await asyncio.sleep(_STOPPING / _TRIES)
            else:
                return

    async def _follow(self) -> None:
        """Wait until the program has ended by itself."""
        poller = self._connection.poller
        watch = poller.watch(VariableRef("task", self.name, "@STATUS"))
        first = poller.cycles + 2  # the cycle in progress may have read the status before the start
        try:
            while not self.finished.is_set() and (poller.cycles < first or not _has_ended(watch)):  # noqa: ASYNC110 - no event: polled
                await asyncio.sleep(_CHECK)
        finally:
            watch.close()
            self._end()

    def _end(self) -> None:
        self._motions.discard(self)
        self.finished.set()

    async def _standstill(self) -> None:
        """Wait until the joints no longer change."""
        robot = await self._connection.monitored_robot()
        async with await robot.variable("@CURRENT_ANGLE") as joints:
            previous = await joints.get_value()
            while True:
                await asyncio.sleep(_BETWEEN)
                now = await joints.get_value()
                if all(abs(a - b) < _STANDSTILL for a, b in zip(previous, now, strict=False)):
                    return
                previous = now


def _has_ended(watch: Watch) -> bool:
    """Return True if the controller has reported that the task does not run; False while it cannot be reached."""
    reading = watch.reading
    if reading.error is not None or reading.value is None:
        return isinstance(reading.error, CallError)  # the task has been deleted
    return bool(reading.value.value != TaskStatus.RUNNING)


def _in_background(work: Awaitable[None]) -> None:
    task = asyncio.ensure_future(work)
    _BACKGROUND.add(task)
    task.add_done_callback(_BACKGROUND.discard)
