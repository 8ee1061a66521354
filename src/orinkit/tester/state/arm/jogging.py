"""Jogging in slave mode: :class:`Jogging`.

Jogging sends set-points that reach only a short time ahead. The streaming process, which sends them to the controller,
stops the arm within the limits if no further ones follow: if the Tester is blocked, is killed (SIGKILL), or has
decided to stop because the user is gone.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextlib import AsyncExitStack
from time import monotonic
from typing import TYPE_CHECKING, Final

import numpy as np

from orinkit.arms.frames import matrix_of_position
from orinkit.arms.kinematics import Kinematics
from orinkit.arms.kinematics.chain import Array
from orinkit.client._async.controller import AsyncController
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._async.stream import AsyncStream
from orinkit.client._shared.stream_options import PERIOD
from orinkit.core.errors import CallError, InvalidValue, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.streaming.planning.limits import Limits
from orinkit.tester.state.arm.jog_motion import JogMotion
from orinkit.tester.state.arm.jog_path import JogPath, JogRequest, JointPath, ToolPath
from orinkit.tester.state.arm.monitor import ArmMonitor
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.held_motion import IDLE, HeldMotion, MotionState
from orinkit.values.poses import P

if TYPE_CHECKING:
    from orinkit.tester.state.workspace import ActiveMotion

logger = logging.getLogger("orinkit.tester")

_LEAD: Final = 0.08  # s by which set-points are ahead
_TICK: Final = 0.01  # s
_NO_TOOL: Final[Array] = np.eye(4)


class Jogging(HeldMotion[JogRequest]):
    """Jogging of one arm, on a connection of its own if the transport allows it.

    Args:
        connection: The connection.
        monitor: The state of the arm.
        motions: The running motions of the workspace.
    """

    def __init__(self, connection: ControllerConnection, monitor: ArmMonitor, motions: set[ActiveMotion]) -> None:
        super().__init__(connection, motions)
        self._connection, self._monitor = connection, monitor
        self._motion: JogMotion | None = None
        self._stream: AsyncStream | None = None
        self._kinematics: Kinematics | None = None
        self._tool = _NO_TOOL

    @property
    def requested(self) -> bool:
        """True while a motion is requested or executing."""
        return self._request is not None or self._motion is not None

    def start(self, request: JogRequest, absent: Callable[[], str]) -> None:
        """Begin to move; if the arm still decelerates, begin afterwards.

        Args:
            request: What to move.
            absent: Function that returns why the user counts as gone; ``""`` if the user is present.

        Raises:
            InvalidValue: If the request is invalid, or jogging is not enabled.
        """
        request.check(len(self._monitor.joints))
        if not self.usable:
            raise InvalidValue(tr("jogging is not enabled. Try: the switch Enable jogging"))
        if self._motion is not None:
            self._motion.release()
        self._request, self._absent = request, absent
        self._tell("")

    def release(self) -> None:
        """Stop within the limits; slave mode remains on. A step that has begun is completed."""
        if self._request is not None and not self._request.step:
            self._halt("")

    # --- the task ------------------------------------------------------------------------------------------------

    async def _operate(self) -> None:
        """Take the arm, enter slave mode, jog, and undo both."""
        async with AsyncExitStack() as stack:
            await self._enter(stack)
            self._set(MotionState.READY)
            self._used = monotonic()
            await self._jog()

    def _forget(self) -> None:
        self._motion = self._stream = self._monitor.lent = None
        self._connection.lent = False

    def _leave_text(self, reason: str) -> str:
        return tr("stopped, and jogging was switched off: {reason}", reason=reason)

    async def _enter(self, stack: AsyncExitStack) -> None:
        connection = self._connection
        robot = await self._connect(stack)
        if await self._monitor.identify() is None:
            raise InvalidValue(
                tr(
                    "the arm {type} is unknown, and so are its limits; it cannot be jogged",
                    type=self._monitor.type_name,
                )
            )
        assert self._monitor.model is not None
        self._kinematics = await asyncio.to_thread(Kinematics, self._monitor.model)
        self._tool = await _tool_of(robot)
        await stack.enter_async_context(robot.arm(keep=True))
        stream = robot.slave_mode(idle=None)
        if not connection.allows_second:
            connection.lent = True
            self._monitor.lent = self._streamed
        self._stream = await stack.enter_async_context(stream)

    async def _connect(self, stack: AsyncExitStack) -> AsyncRobot:
        """Return the robot of a connection of its own, or of the only one."""
        connection = self._connection
        if not connection.allows_second:
            return await connection.robot()
        controller: AsyncController = await connection.connect_another()
        await stack.enter_async_context(controller)
        return await connection.robot_of(controller)

    async def _jog(self) -> None:
        stream = self._stream
        assert stream is not None
        while not self._ending:
            if stream.error is not None:
                raise stream.error
            if not self._connection.is_open:
                self._tell(tr("the connection was closed"))
                break
            if self._unused:
                self._tell(tr("jogging was not used for {seconds:g} s, so it was switched off", seconds=IDLE))
                break
            if self._request is not None:
                self._check_presence()
            await self._feed(stream)
            await asyncio.sleep(_TICK)
        self._set(MotionState.ENDING)
        await stream.stop()

    async def _feed(self, stream: AsyncStream) -> None:
        """Queue set-points, if there is a motion."""
        if self._motion is None and self._request is not None:
            if not (stream.at_rest and not stream.queued):
                return
            self._motion = self._begin(stream, self._request)
            self._set(MotionState.MOVING)
        motion = self._motion
        if motion is None:
            return
        self._used = monotonic()
        while stream.queued < round(_LEAD / PERIOD) and not motion.ended:
            await stream.push(motion.next())
        if motion.ended and not stream.queued and stream.at_rest:
            if motion.obstacle:
                self._halt(motion.obstacle)
            if self._request is not None and self._request.step:
                self._request = None
            self._motion = None
            self._set(MotionState.READY)
        elif motion.obstacle and not self.message:
            self._halt(motion.obstacle)

    def _begin(self, stream: AsyncStream, request: JogRequest) -> JogMotion:
        limits = stream.limits
        model = self._monitor.model
        assert isinstance(limits, Limits)
        assert model is not None
        assert self._kinematics is not None
        start = stream.latest.command[: len(limits.lower)]
        path: JogPath
        if request.frame == "joint":
            path = JointPath(model, start, request)
        else:
            path = ToolPath(self._kinematics, start, self._tool, request)
        return JogMotion(path, start, limits, PERIOD, request.speed, request.step)

    def _halt(self, message: str) -> None:
        self._request = None
        if self._motion is not None:
            self._motion.release()
        self._tell(message)

    # --- state ---------------------------------------------------------------------------------------------------

    def _streamed(self) -> tuple[float, ...]:
        """Return the joints that the controller has returned in slave mode."""
        stream = self._stream
        if stream is None:
            return self._monitor.joints
        try:
            return stream.latest.command
        except OrinError:
            return self._monitor.joints


async def _tool_of(robot: AsyncRobot) -> Array:
    """Return the current tool relative to the flange, a matrix (4, 4)."""
    if not robot.client.dialect.takes_arm:
        return _NO_TOOL
    try:
        number = await robot.get_tool()
        if not number:
            return _NO_TOOL
        given = await robot.execute("GetToolDef", number)
        return matrix_of_position(list(P.of(given))[:6])
    except (CallError, ProtocolError, TypeError, ValueError) as error:
        raise InvalidValue(tr("the definition of the current tool cannot be read: {error}", error=error)) from None
