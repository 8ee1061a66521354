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
from enum import Enum
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
from orinkit.values.poses import P

if TYPE_CHECKING:
    from orinkit.tester.state.workspace import ActiveMotion

logger = logging.getLogger("orinkit.tester")

IDLE: Final = 60.0
"""Time in s without jogging after which slave mode is left and the arm is given back."""
HEARTBEAT: Final = 0.5
"""Time in s without a heartbeat of the page after which the arm is stopped."""
_LEAD: Final = 0.08  # s by which set-points are ahead
_TICK: Final = 0.01  # s
_NO_TOOL: Final[Array] = np.eye(4)


class JogState(Enum):
    """State of jogging."""

    OFF = "off"
    STARTING = "starting"
    READY = "ready"
    MOVING = "moving"
    ENDING = "ending"


class Jogging:
    """Jogging of one arm, on a connection of its own if the transport allows it.

    Args:
        connection: The connection.
        monitor: The state of the arm.
        motions: The running motions of the workspace.

    Attributes:
        state: The state.
        message: Why the last motion or slave mode ended, for the user; otherwise ``""``.
        error: The error that ended slave mode; otherwise ``None``.
        version: Counts the changes of the attributes above.
    """

    def __init__(self, connection: ControllerConnection, monitor: ArmMonitor, motions: set[ActiveMotion]) -> None:
        self._connection, self._monitor, self._motions = connection, monitor, motions
        self.state = JogState.OFF
        self.message = ""
        self.error: Exception | None = None
        self.version = 0
        self._task: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()
        self._ending = False
        self._request: JogRequest | None = None
        self._absent: Callable[[], str] = lambda: ""
        self._motion: JogMotion | None = None
        self._used = 0.0
        self._stream: AsyncStream | None = None
        self._kinematics: Kinematics | None = None
        self._tool = _NO_TOOL

    @property
    def active(self) -> bool:
        """True unless jogging is off."""
        return self.state is not JogState.OFF

    @property
    def requested(self) -> bool:
        """True while a motion is requested or executing."""
        return self._request is not None or self._motion is not None

    async def enable(self) -> None:
        """Take the arm and enter slave mode; return when the arm can be jogged.

        Raises:
            OrinError: If the controller refuses, the type of arm is unknown, or the transport does not support slave mode.
        """
        if self._task is None:
            self.error, self._ending = None, False
            self._set(JogState.STARTING)
            self._motions.add(self)
            self._task = asyncio.create_task(self._run())
        while self.state is JogState.STARTING:
            await self._wait_for_change()
        if self.error is not None:
            raise self.error

    async def disable(self) -> None:
        """Stop the arm, leave slave mode and give the arm back; do nothing if jogging is off."""
        await self.stop("")

    async def stop(self, reason: str) -> None:
        """Stop the arm within the limits and end jogging; return at standstill.

        Args:
            reason: Why, for the user.
        """
        self._request = None
        self._ending = True
        if self._task is not None:
            self._tell(reason)
            while self.active:
                await self._wait_for_change()

    def start(self, request: JogRequest, absent: Callable[[], str]) -> None:
        """Begin to move; if the arm still decelerates, begin afterwards.

        Args:
            request: What to move.
            absent: Function that returns why the user counts as gone; ``""`` if the user is present.

        Raises:
            InvalidValue: If the request is invalid, or jogging is not enabled.
        """
        request.check(len(self._monitor.joints))
        if self.state not in (JogState.READY, JogState.MOVING):
            raise InvalidValue(tr("jogging is not enabled. Try: the switch Enable jogging"))
        if self._motion is not None:
            self._motion.release()
        self._request, self._absent = request, absent
        self._tell("")

    def release(self) -> None:
        """Stop within the limits; slave mode remains on. A step that has begun is completed."""
        if self._request is not None and not self._request.step:
            self._halt("")

    def leave(self, reason: str) -> None:
        """Stop within the limits, leave slave mode and give the arm back, because the user is gone.

        Args:
            reason: Why the user counts as gone.
        """
        if self.active:
            self._halt(tr("stopped, and jogging was switched off: {reason}", reason=reason))
            self._ending = True

    # --- the task ------------------------------------------------------------------------------------------------

    async def _run(self) -> None:
        try:
            async with AsyncExitStack() as stack:
                await self._enter(stack)
                self._set(JogState.READY)
                self._used = monotonic()
                await self._jog()
        except (OrinError, OSError, ValueError, ImportError) as error:
            if not self._ending:
                logger.warning("%s: jogging ended: %s", self._connection.name, error)
                self.error = error
        finally:
            self._request = self._motion = self._stream = self._monitor.lent = None
            self._connection.lent = False
            self._task = None
            self._motions.discard(self)
            self._set(JogState.OFF)

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
        return await controller.robot(connection.robot_name)

    async def _jog(self) -> None:
        stream = self._stream
        assert stream is not None
        while not self._ending:
            if stream.error is not None:
                raise stream.error
            if not self._connection.is_open:
                self._tell(tr("the connection was closed"))
                break
            if monotonic() - self._used > IDLE:
                self._tell(tr("jogging was not used for {seconds:g} s, so it was switched off", seconds=IDLE))
                break
            self._check_presence()
            await self._feed(stream)
            await asyncio.sleep(_TICK)
        self._set(JogState.ENDING)
        await stream.stop()

    def _check_presence(self) -> None:
        if self._request is not None:
            reason = self._absent()
            if reason:
                self.leave(reason)

    async def _feed(self, stream: AsyncStream) -> None:
        """Queue set-points, if there is a motion."""
        if self._motion is None and self._request is not None:
            if not (stream.at_rest and not stream.queued):
                return
            self._motion = self._begin(stream, self._request)
            self._set(JogState.MOVING)
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
            self._set(JogState.READY)
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

    def _tell(self, message: str) -> None:
        if message != self.message:
            self.message = message
            self.version += 1

    def _set(self, state: JogState) -> None:
        self.state = state
        self.version += 1
        self._changed.set()
        self._changed = asyncio.Event()

    async def _wait_for_change(self) -> None:
        await self._changed.wait()


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
