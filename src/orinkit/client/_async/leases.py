"""What holds the arm and the motor for as long as a block lasts: ``async with robot.arm(), robot.motor():``.

The synchronous twin is made from this file, as that of :mod:`orinkit.client._async.controller` is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Final

from orinkit.client._async.motion import AsyncArmBase, AsyncMotionTracker
from orinkit.client._shared import motion as common
from orinkit.client._shared.common import motor_state
from orinkit.core.errors import BusyError, CallError, ObjectReleased, OrinError, TransportError
from orinkit.transport.runner import Deadline, apause

_HALT_PATIENCE: Final = 0.3


class AsyncLease(ABC):
    """Something that is taken for as long as a block lasts.

    A block that ends well lets the motion that runs come to its end (one that the program has paused is halted), then
    gives back. Where a block ends with an exception the arm is halted first; what goes wrong while giving back is noted
    in the exception, and hides neither it nor the steps that follow. A lost connection ends it: the controller itself
    then stops the arm and takes it back.
    """

    __slots__ = ("_robot", "_track")

    def __init__(self, robot: AsyncArmBase, track: AsyncMotionTracker) -> None:
        self._robot = robot
        self._track = track

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._robot!r}>"

    async def __aenter__(self) -> None:
        try:
            await self._take()
            self._track.at_rest = False
        except CallError:  # refused: nothing has changed
            raise
        except BaseException as error:  # whether it was taken is not known
            await self._persist(error, self._give, self._longest())
            raise

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            await self._clean_up(error)
            return
        try:
            await self._come_to_rest()
        except BaseException as failure:
            await self._clean_up(failure)
            raise
        await self._give()

    async def _come_to_rest(self) -> None:
        track = self._track
        if track.at_rest or (track.running is None and not track.passing):
            return
        if track.paused:
            await self._robot.halt()
        elif track.running is not None:
            await track.running.wait()
        else:
            while not await self._robot.motion_complete():
                await apause(common.POLL)
            track.passing = False

    async def _clean_up(self, error: BaseException) -> None:
        """Halt and give back after an exception; what fails is noted in it."""
        robot = self._robot
        if not self._track.at_rest:
            problem = await self._persist(error, robot.halt, _HALT_PATIENCE)
            if isinstance(problem, BusyError):
                await robot.client.close()
                error.add_note(common.note_closed(robot.client.profile))
                return
            if isinstance(problem, TransportError | ObjectReleased):
                return
        await self._persist(error, self._give, self._longest())

    async def _persist(
        self, error: BaseException, step: Callable[[], Awaitable[None]], seconds: float
    ) -> OrinError | None:
        """Do a step of the clean-up, again and again while the controller is busy with an earlier call.

        Returns:
            what it failed with; that is noted in the exception.
        """
        deadline = Deadline(seconds)
        while True:
            try:
                await step()
            except OrinError as problem:
                if self._is_busy(problem) and not deadline.passed:
                    await apause(common.SETTLE)
                    continue
                common.note_failure(error, problem, self._robot.client.profile)
                return problem
            return None

    def _longest(self) -> float:
        """Seconds that an earlier call may still be at work."""
        client = self._robot.client
        return max(client.timeout, *client.dialect.patience.values(), 0.0)

    def _is_busy(self, problem: OrinError) -> bool:
        """Whether the controller is at work with an earlier call."""
        busy = self._robot.client.dialect.busy
        return isinstance(problem, BusyError) or (isinstance(problem, CallError) and problem.code == busy != 0)

    @abstractmethod
    async def _take(self) -> None:
        """Take it."""

    @abstractmethod
    async def _give(self) -> None:
        """Give it back."""


class AsyncArm(AsyncLease):
    """The arm, taken (RC8 3.3.2) and given back."""

    __slots__ = ("_group", "_keep")

    def __init__(self, robot: AsyncArmBase, track: AsyncMotionTracker, group: int, keep: bool) -> None:
        super().__init__(robot, track)
        self._group = group
        self._keep = keep

    async def _take(self) -> None:
        if self._robot.client.dialect.takes_arm:
            await self._robot.execute("TakeArm", [self._group, int(self._keep)])

    async def _give(self) -> None:
        if self._robot.client.dialect.takes_arm:
            await self._robot.execute("GiveArm")


class AsyncMotor(AsyncLease):
    """The motor, switched on and off again; each waits until that is done."""

    __slots__ = ()

    async def _take(self) -> None:
        await self._robot.execute("Motor", motor_state(self._robot.client.dialect, on=True))

    async def _give(self) -> None:
        await self._robot.execute("Motor", motor_state(self._robot.client.dialect, on=False))
        self._track.at_rest = True
