"""The sequence of Slave Move (RC8 5.1.1): :class:`SlaveMove`. It needs a present user, and stops without one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager, nullcontext
from pathlib import Path
from time import monotonic
from typing import Final

from orinkit.client._async.robot import AsyncRobot
from orinkit.client._async.stream import AsyncStream
from orinkit.client._shared.stream import POSE_TYPES, Progress, StreamResult
from orinkit.client._shared.stream_options import FeedbackField
from orinkit.core.errors import CallError, InvalidValue, OrinError, StreamError
from orinkit.core.i18n import tr
from orinkit.rc8.slave_formats import PoseKind
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_options import SlaveMoveOptions, Step, StepState
from orinkit.tester.state.slave_trace import SlaveTrace
from orinkit.tester.state.slave_trajectory import SlaveTrajectory, read_arm
from orinkit.transport.links import require_handover
from orinkit.values.poses import J, P, T

logger = logging.getLogger("orinkit.tester")

_POLL: Final = 0.02  # s
_COLLECT: Final = 0.05  # s
_AHEAD: Final = 1.0  # s of set-points that the streaming process has: the arm stops if the Tester hangs for longer
_ARRIVED: Final = 1e-3  # deg, mm
_RECEIVED: Final[dict[PoseKind, tuple[FeedbackField, ...]]] = {
    "J": ("time", "joints"),
    "P": ("time", "position"),
    "T": ("time", "trans"),
}


class MotorOff(OrinError):
    """The motor is off; nothing was sent that moves the arm."""


class _Stopped(Exception):
    """The user or the loss of the user has ended the sequence."""


class SlaveMove:
    """One execution of the sequence.

    Args:
        connection: The connection; the sequence uses a further connection of its own if the transport allows it.
        trajectory: The set-points.
        options: The options.
        absent: Function that returns why the user counts as gone; ``""`` while the user is present. It is called
            at least every 50 ms.
        folder: Directory for the recordings.
        scope: Context in which the sequence runs; it determines the language of messages.

    Attributes:
        trajectory: The set-points.
        options: The options.
        steps: The state of each step.
        sent: Number of set-points of the current repetition that were sent.
        repetition: Number of the current repetition, from 1.
        approached: Part of the motion to the first pose that is done, 0 to 1.
        reason: Why the sequence was stopped; ``""`` if it was not.
        error: The error that ended the sequence; ``None`` if there was none.
        result: Result of the last repetition; ``None`` before its end.
        trace: What was measured.
    """

    def __init__(
        self,
        connection: ControllerConnection,
        trajectory: SlaveTrajectory,
        options: SlaveMoveOptions,
        *,
        absent: Callable[[], str],
        folder: Path,
        scope: AbstractContextManager[object] | None = None,
    ) -> None:
        self.trajectory = trajectory
        self.options = options.check()
        self.steps = dict.fromkeys(Step, StepState.WAITING)
        self.sent = 0
        self.repetition = 1
        self.approached = 0.0
        self.reason = ""
        self.error: Exception | None = None
        self.result: StreamResult | None = None
        self.trace = SlaveTrace(trajectory.kind, trajectory.period)
        self.finished = False
        self._connection = connection
        self._absent = absent
        self._folder = folder
        self._scope = scope or nullcontext()
        self._task: asyncio.Task[None] | None = None
        self._stream: AsyncStream | None = None
        self._collected = 0.0

    @property
    def step(self) -> Step | None:
        """The current step; ``None`` before the first one and after the last one."""
        return next((step for step, state in self.steps.items() if state is StepState.ACTIVE), None)

    @property
    def fraction(self) -> float:
        """Part of the set-points of this repetition that were sent, 0 to 1."""
        return self.sent / len(self.trajectory.points)

    def begin(self, done: Callable[[], object]) -> None:
        """Start the sequence; ``done`` is called at its end."""
        self._task = asyncio.create_task(self._run(done))

    async def stop(self, reason: str) -> None:
        """Decelerate within the limits and stop, leave slave mode, give the arm; return after that.

        Raises:
            OrinError, OSError: If the arm may not have stopped.
        """
        if self.finished:
            return
        self.reason = self.reason or reason
        if self._task is not None:
            await asyncio.wait([self._task])
        if self.error is not None:
            raise self.error

    async def _run(self, done: Callable[[], object]) -> None:
        try:
            with self._scope:
                await self._carry_out()
        except _Stopped as stopped:
            notes = getattr(stopped, "__notes__", [])
            self.error = StreamError("; ".join(notes)) if notes else None
        except (OrinError, OSError) as error:
            logger.debug("Slave Move: %s", error)
            ended = isinstance(error, CallError) and self.reason  # the stop button also halts the robot
            self.error = None if ended else error
        finally:
            self._end_steps()
            await asyncio.to_thread(self.trace.close)
            self.finished = True
            done()

    async def _carry_out(self) -> None:
        connection = self._connection
        require_handover(connection.controller.client.profile.name)
        if not connection.allows_second:  # a serial line
            await self._sequence(await connection.robot())
            return
        controller = await connection.connect_another()
        try:
            await self._sequence(await connection.robot_of(controller))
        finally:
            await controller.close()

    async def _sequence(self, robot: AsyncRobot) -> None:
        if not await robot.get_motor_on():
            raise MotorOff(tr("the motor is off. This page never switches it on. Try: switch it on, then start again"))
        await self._check_limits(robot)
        async with self._arm(robot):
            if robot.client.dialect.takes_arm:
                await self._move_to_first(robot)
            await self._slave_mode(robot)

    async def _check_limits(self, robot: AsyncRobot) -> None:
        """Check all set-points against the limits of the connected arm, once more, before anything moves."""
        self._check()
        arm = await read_arm(robot, self.options.speed)
        limits = arm.limits(self.trajectory.kind, self.options.mode)
        found = await asyncio.to_thread(self.trajectory.violations, limits)
        if found:
            raise InvalidValue(
                tr("the trajectory exceeds the limits; nothing was moved: {first}", first=found[0])
            )  # fmt: skip
        self._check()

    @asynccontextmanager
    async def _arm(self, robot: AsyncRobot) -> AsyncIterator[None]:
        self._enter(Step.TAKE_ARM)
        async with robot.arm():
            try:
                yield
            finally:
                self._enter(Step.GIVE_ARM)

    async def _move_to_first(self, robot: AsyncRobot) -> None:
        self._check()
        self._enter(Step.FIRST_POSE)
        first = POSE_TYPES[self.trajectory.kind].of(self.trajectory.points[0])
        motion = await robot.move(first, "@E", speed=self.options.approach, wait=False)
        while not await motion.get_done():
            self._check()
            self.approached = await motion.get_progress()
            await asyncio.sleep(_POLL)
        self.approached = 1.0
        self._check()

    async def _slave_mode(self, robot: AsyncRobot) -> None:
        self._check()
        self._enter(Step.ENTER)
        options, client = self.options, robot.client
        mode = robot.slave_mode(
            options.mode, self.trajectory.kind, _RECEIVED[self.trajectory.kind], speed=options.speed, idle=None
        )
        before, client.timeout = client.timeout, options.timeout
        try:
            async with mode as stream:
                self._stream = stream
                if options.record:
                    self.trace.record(self._folder)
                try:
                    await self._stream_all(stream, approach=not client.dialect.takes_arm)
                finally:
                    self._collect(0.0)
                    self._stream = None
                    self._enter(Step.LEAVE)
        finally:
            client.timeout = before

    async def _stream_all(self, stream: AsyncStream, *, approach: bool) -> None:
        if approach:  # this arm moves in slave mode only
            self._enter(Step.FIRST_POSE)
            await self._go_to_first(stream)
        self._enter(Step.STREAM)
        while True:
            self._check()
            self.sent = 0
            # An iterator: all set-points have been checked, in a thread; checking them again here would block the Tester.
            self.result = await stream.run(
                iter(self.trajectory.points), progress=self._progress, ahead=_AHEAD, keep_samples=False
            )
            if not self.options.repeat:
                return
            await self._go_to_first(stream)
            self.repetition += 1

    async def _go_to_first(self, stream: AsyncStream) -> None:
        """Move to the first set-point within the limits, in slave mode."""
        self._check()
        goal = POSE_TYPES[self.trajectory.kind].of(self.trajectory.points[0])
        whole = _distance(stream, goal)
        if whole <= _ARRIVED:
            return
        stream.target = goal
        while (left := _distance(stream, goal)) > _ARRIVED or not stream.at_rest:
            self._check()
            self._collect(_COLLECT)
            self.approached = 1.0 - left / whole
            await asyncio.sleep(_POLL)
        await stream.wait()
        self.approached = 1.0

    def _progress(self, progress: Progress) -> None:
        """Check the user and read the samples; :meth:`AsyncStream.run` calls this every few ms."""
        self.sent = progress.sent
        if self._stream is not None and self._stream.underflows and not self.reason:
            self.reason = tr("the Tester was blocked for more than {seconds:g} s", seconds=_AHEAD)
        self._check()
        self._collect(_COLLECT)

    def _collect(self, interval: float) -> None:
        stream, now = self._stream, monotonic()
        if stream is None or now - self._collected < interval:
            return
        self._collected = now
        try:
            self.trace.add(stream.new_samples())
            self.trace.queued = stream.queued
        except OrinError as error:  # the stream has ended; its own call raises the error
            logger.debug("Slave Move: %s", error)

    def _check(self) -> None:
        """Raise _Stopped if the sequence must stop."""
        if not self.reason:
            self.reason = self._absent()
        if not self.reason and not self._connection.is_open:
            self.reason = tr("the connection was closed")
        if self.reason:
            raise _Stopped

    def _enter(self, step: Step) -> None:
        self._end_steps()
        self.steps[step] = StepState.ACTIVE

    def _end_steps(self) -> None:
        """End the current step; the last two steps are executed after a stop, too."""
        for step, state in self.steps.items():
            if state is StepState.ACTIVE:
                completed = not self.reason and (step is not Step.STREAM or self.result is not None)
                ending = step in (Step.LEAVE, Step.GIVE_ARM) and self.error is None
                self.steps[step] = StepState.DONE if completed or ending else StepState.STOPPED


def _distance(stream: AsyncStream, goal: J | P | T) -> float:
    """Return the largest difference between a value of the latest set-point and the same value of a pose."""
    return max(abs(a - b) for a, b in zip(stream.latest.command, goal, strict=False))
