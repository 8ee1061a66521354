"""Entering and leaving slave mode: hand the connection over to a streaming process, and take it back.

The synchronous version is generated from this file; :mod:`orinkit.client._async.controller` describes how.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

from orinkit.client._async.motion import AsyncArmBase
from orinkit.client._shared import stream as common
from orinkit.client._shared.common import clear_error_parameter, motor_state
from orinkit.client._shared.stream_options import StreamOptions, limits_for
from orinkit.core import hresult
from orinkit.core.errors import CallError, OrinError
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.launcher import StreamerProcess
from orinkit.streaming.process.realtime import RealTime
from orinkit.streaming.process.shared_memory import StreamCommand
from orinkit.transport.runner import Deadline, asleep

_NOT_YET: Final = (hresult.MOTOR_NOT_ON, hresult.MOTOR_SWITCHING_OFF, hresult.ERROR_PRESENT)


class AsyncSlaveMode:
    """A context manager for slave mode, during which a streaming process has the connection.

    Attributes:
        limits: Limits of all motions.
        real_time: Real-time settings that the system granted to the streaming process.
    """

    def __init__(self, robot: AsyncArmBase, options: StreamOptions) -> None:
        self._robot = robot
        self._options = options
        self._streaming: StreamerProcess | None = None
        self._recording: common.SampleRecording | None = None
        self._failure: OrinError | None = None
        self._failure_raised = False  # True if a call within the block has raised the failure
        self._inside = False  # True within the block
        self._pose_type = options.mode.kind
        self._outputs = options.outputs
        self.limits: Limits | PathLimits | None = options.limits
        self.real_time = RealTime()

    def _forget(self) -> None:
        """Discard earlier targets, because the arm may be at another position."""

    # --- entering and leaving -----------------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        await self._enter()
        self._inside = True
        try:
            if self._options.record is not None and self._streaming is not None:
                self._recording = common.SampleRecording(self._options.record, self._options)
                self._recording.follow(self._streaming.shared)
        except BaseException:
            self._inside = False
            await self._leave(StreamCommand.LEAVE)
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._inside = False
        try:
            await self._leave(StreamCommand.FINISH if error is None else StreamCommand.LEAVE)
        finally:
            self._close_recording(quiet=error is not None)
        if error is None and self._failure is not None and not self._failure_raised:
            raise self._failure

    async def _enter(self) -> None:
        robot, client, options = self._robot, self._robot.client, self._options
        self._failure, self._failure_raised = None, False
        self._forget()
        streaming = StreamerProcess(client._fileno(), client.profile.name)
        self._streaming = streaming
        try:
            type_name = client.dialect.name
            if client.dialect.slave_formats:
                await robot.execute("slvSendFormat", int(options.send))
                await robot.execute("slvRecvFormat", [options.receive.number, int(options.receive.microseconds)])
                type_name = "" if options.limits else await robot.execute("GetRobotTypeName")
            self.limits = limits_for(options, type_name)
            start, unlimited_joints = await self._start()
            await self._wait_until(lambda: streaming.real_time is not None)
        except BaseException:
            await self._give_up(streaming)
            raise
        self.real_time = streaming.real_time or RealTime()
        serial = client._detach(lambda: _stop_streaming(streaming))
        try:
            streaming.begin(self._config(start, unlimited_joints, serial))
            await self._wait_until(lambda: streaming.streaming and streaming.shared.samples > 0)
        except BaseException:
            await self._give_up(streaming)
            raise
        if self._recording is not None:
            self._recording.follow(streaming.shared)

    def _config(self, start: tuple[float, ...], unlimited_joints: tuple[float, ...], serial: int) -> StreamerConfig:
        options = self._options
        assert self.limits is not None
        return StreamerConfig(
            self._robot._controller().handle, self._robot.handle, options.mode, options.send, options.receive,
            options.window, self._outputs, options.period, self.limits, start, unlimited_joints, serial, self._robot.client.timeout,
            options.idle, os.getpid(), self._robot.client.dialect.name,
            self._robot.client.tries, options.user_io_unit,
        )  # fmt: skip

    async def _start(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Wait for standstill; return the pose of the arm as two groups of numbers.

        If the pose type is J, the second value consists of the joints for which no limits are known, and the first
        value of the other joints. Otherwise, the first value is the complete pose, and the second value is empty.
        """
        robot = self._robot
        deadline = Deadline(common.SETTLE if self._robot.client.dialect.slave_formats else 0.0)
        while not deadline.passed and not await robot.motion_complete(1):
            await asleep(common.POLL)
        if self._pose_type == "P":
            return tuple(await robot.get_position()), ()
        if self._pose_type == "T":
            return tuple(await robot.get_trans()), ()
        assert isinstance(self.limits, Limits)
        return common.split_by_limits(tuple(await robot.get_joints()), self.limits)

    async def _wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait until the streaming process fulfils a condition."""
        while not condition():
            self._check()
            await asleep(common.POLL)

    async def _leave(self, order: StreamCommand) -> None:
        streaming = self._streaming
        if streaming is None:
            return
        try:
            streaming.poll()
            if not streaming.ended:
                if order is StreamCommand.LEAVE:
                    streaming.shared.clear_queue()
                streaming.shared.order(order)
            while not streaming.ended:
                await asleep(common.POLL)
                streaming.poll()
        finally:
            await self._give_up(streaming)

    async def _give_up(self, streaming: StreamerProcess) -> None:
        """Take the connection back from the streaming process; close the connection if its state is unknown.

        If the wait for the end of the streaming process was interrupted, that process still runs and keeps the
        connection. It stops the arm and leaves slave mode by itself.
        """
        self._streaming = None
        if self._recording is not None:
            self._recording.pause()
        client = self._robot.client
        if streaming.ended and self._failure is None:
            self._failure = streaming.error
            if streaming.reason in ("stopped", "terminated"):
                self._failure = common.ended_because(streaming.reason, self._options.idle)
        if streaming.began:  # recover() sends the outputs again
            self._outputs = self._outputs.updated(streaming.shared.last_outputs)
        streaming.close()
        if not streaming.began:
            return
        if not streaming.ended:
            client._forfeit()
            return
        client._reattach(streaming.serial)
        if streaming.error is not None and not isinstance(streaming.error, CallError):
            await client.close()

    def _close_recording(self, *, quiet: bool) -> None:
        recording, self._recording = self._recording, None
        if recording is not None:
            try:
                recording.close()
            except OrinError:
                if not quiet:
                    raise

    async def recover(self) -> None:
        """Resume streaming after an error (RC8 4.7): clear errors, switch the motor on and enter slave mode again.

        Queued set-points are discarded. The arm stays at its current position until there are new set-points.

        Raises:
            CallError: If the controller refuses; an operator must then check the controller.
            StreamError: If this method is called outside the block.
        """
        if not self._inside:
            raise common.ended_because("", None)
        await self._leave(StreamCommand.LEAVE)
        for attempt in range(common.TRIES):
            try:
                dialect = self._robot.client.dialect
                await self._robot._controller().execute("ClearError", clear_error_parameter(dialect))
                await self._robot.execute("Motor", motor_state(dialect, on=True))
                await self._enter()
            except CallError as error:
                if error.code not in _NOT_YET or attempt == common.TRIES - 1:
                    raise
                await asleep(common.SETTLE / common.TRIES)
            else:
                return

    # --- state -------------------------------------------------------------------------------------------------

    @property
    def error(self) -> OrinError | None:
        """The error that ended streaming; ``None`` if there was none."""
        if self._failure is None and self._streaming is not None:
            self._has_ended(self._streaming)
        return self._failure

    def _alive(self) -> StreamerProcess:
        """Return the streaming process, which is running.

        Raises:
            OrinError: If streaming has ended: the error that ended it.
        """
        self._check()
        assert self._streaming is not None
        return self._streaming

    def _check(self) -> None:
        streaming = self._streaming
        if streaming is not None and not self._has_ended(streaming):
            return
        self._failure_raised = True
        raise self._failure or common.ended_because("", None)

    def _has_ended(self, streaming: StreamerProcess) -> bool:
        """Return True if streaming has ended; record the cause."""
        streaming.poll()
        if streaming.ended:
            self._failure = streaming.error or common.ended_because(streaming.reason, self._options.idle)
        return streaming.ended


def _stop_streaming(streaming: StreamerProcess) -> None:
    """Order the streaming process to stop the arm, before this process closes the connection."""
    if not streaming.shared.closed:
        streaming.shared.clear_queue()
        streaming.shared.order(StreamCommand.GOODBYE)
