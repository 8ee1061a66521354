"""Streams of set-points in slave mode (RC8 4), sent by a streaming process.

The synchronous version is generated from this file; :mod:`orinkit.client._async.controller` describes how.
"""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from itertools import islice
from threading import Lock
from time import monotonic_ns
from typing import Any

from orinkit.client._async.motion import AsyncArmBase
from orinkit.client._async.slave_mode import AsyncSlaveMode
from orinkit.client._shared import stream as common
from orinkit.client._shared.stream import Progress, SampleReader, StreamResult
from orinkit.client._shared.stream_options import (
    StreamOptions,
    check_outputs_enabled,
    check_sendable,
    queue_room,
    read_outputs,
)
from orinkit.core.errors import InvalidValue, StreamError
from orinkit.core.i18n import tr
from orinkit.core.public_name import public
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.planning.planners import Planner, planner_for
from orinkit.streaming.process.shared_memory import Outputs, StreamCommand
from orinkit.streaming.recording.samples import Sample
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.streaming.trajectory.retime import retime as retimed
from orinkit.streaming.trajectory.trajectory import check_path, check_trajectory, read_point, read_trajectory
from orinkit.transport.runner import asleep
from orinkit.values.poses import J, P, T


@public("orinkit.aio")
class AsyncStream(AsyncSlaveMode):
    """A context manager for slave mode, returned by ``Robot.slave_mode``.

    During the block, a separate streaming process uses the connection to the controller; this program cannot make
    calls. The streaming process sends a set-point in each cycle of the controller, independently of the load of this
    program. The set-points come from :meth:`run`, :attr:`target` or :meth:`push`.

    If there are no more set-points, the streaming process stops the arm within the limits and repeats the last pose. If
    this program raises an exception, is killed or (on Linux) is stopped, the streaming process stops the arm in the
    same way, and leaves slave mode.

    Attributes:
        limits: Limits of all motions.
        real_time: Real-time settings that the system granted to the streaming process.
    """

    def __init__(self, robot: AsyncArmBase, options: StreamOptions) -> None:
        super().__init__(robot, options)
        self._lock = Lock()
        self._reader: SampleReader | None = None
        self._pushed: Planner | None = None
        self._target: J | P | T | None = None

    def __repr__(self) -> str:
        state = "not active" if self._streaming is None else "active"
        return f"<{type(self).__name__} of {self._robot!r}, {state}>"

    def _forget(self) -> None:
        self._pushed = self._target = None

    # --- trajectories -------------------------------------------------------------------------------------------

    async def run(
        self,
        trajectory: Any,
        *,
        retime: bool = False,
        progress: Callable[[Progress], object] | None = None,
        ahead: float | None = None,
        keep_samples: bool = True,
    ) -> StreamResult:
        """Send a trajectory, one set-point per cycle, and wait for standstill at its end.

        Args:
            trajectory: Array with one row per cycle, sequence of ``J(...)``, ``P(...)`` or ``T(...)``, path of a CSV
                file, or iterator. All set-points are checked before the arm moves, except those of an iterator, which
                are checked as they are read.
            retime: Slow the trajectory down if it exceeds the limits; not available for an iterator.
            progress: Callback invoked with the progress.
            ahead: Time in s, at least 0.1, for which set-points are queued in the streaming process: if this program
                hangs, the arm continues for this time, and then stops within the limits. By default, as many set-points
                are queued as possible, those of 32 s.
            keep_samples: False for long trajectories: the result contains no samples, which take 1 kB each.

        Returns:
            The number of set-points sent, the samples and the timing.

        Raises:
            TrajectoryError: If a set-point is invalid or exceeds a limit; the message gives the set-point and the axis.
            CallError: If the controller ended slave mode: the first error that it returned.
            StreamError: If slave mode has ended.
        """
        streaming = self._alive()
        total: int | None = None
        room = queue_room(ahead, self._options.period)
        await self._wait_for_standstill()
        if isinstance(trajectory, Iterator):
            if retime:
                raise InvalidValue(tr("an iterator cannot be retimed. Try: convert it to a list"))
            points = self._checked(trajectory)
            ready = list(islice(points, common.PREFETCH))
        else:
            ready = self._prepare(trajectory, retime=retime)
            points, total = iter(()), len(ready)
        run = common.TrajectoryRun(streaming.shared, total, progress, keep_samples=keep_samples)
        try:
            sent = await self._feed(ready, points, run, room)
            while run.sent < sent or not run.shared.settled:
                await self._poll(run)
        except BaseException:
            run.give_up()
            raise
        self._pushed = None
        return run.result(sent)

    async def _feed(
        self,
        ready: Sequence[tuple[float, ...]],
        points: Iterator[tuple[float, ...]],
        run: common.TrajectoryRun,
        room: int,
    ) -> int:
        """Queue the set-points as room becomes available, at most ``room`` at a time; return their number."""
        shared = run.shared
        sent = 0
        polled = monotonic_ns()
        for source in (iter(ready), points):
            for point in source:
                while shared.queued >= room:
                    run.start()
                    await self._poll(run)
                shared.put(point)
                sent += 1
                if monotonic_ns() - polled > common.LOOK_NS:
                    await self._poll(run)
                    polled = monotonic_ns()
            run.start()  # the queue is filled before the first set-point is sent
        return sent

    async def _poll(self, run: common.TrajectoryRun) -> None:
        """Read the state of the streaming process and report the progress; then let other tasks run.

        Raises:
            StreamError: If another call interrupted the trajectory.
        """
        self._alive()
        run.look()
        await asleep(common.POLL)

    def _prepare(self, trajectory: Any, *, retime: bool) -> list[tuple[float, ...]]:
        options, start = self._options, self._command()
        points = read_trajectory(trajectory, self._pose_type, self._axes, period=options.period)
        assert self.limits is not None
        if retime:
            points = retimed(points, self.limits, options.period, self._pose_type)
        if isinstance(self.limits, Limits):
            check_trajectory(points, self.limits, start, options.period)
        else:
            check_path(points, self.limits, start, options.period, self._pose_type)
        return points

    def _checked(self, points: Iterator[Any]) -> Iterator[tuple[float, ...]]:
        start = self._command()
        shadow = self._shadow(start)
        for number, given in enumerate(points):
            point = read_point(given, self._pose_type, self._axes, number)
            try:
                shadow.check(point)
            except InvalidValue as error:
                raise TrajectoryError(tr("set-point {number}: {error}", number=number, error=error), number) from None
            shadow.track(point)
            yield point

    def _shadow(self, start: Sequence[float]) -> Planner:
        """Return a planner that checks set-points in advance, by the same rules as the streaming process."""
        assert self.limits is not None
        return planner_for(self.limits, self._options.period, start, self._pose_type)

    async def _wait_for_standstill(self) -> None:
        """Wait until all pushed set-points are sent or the live target is reached, and the arm is at standstill."""
        shared = self._alive().shared
        current = shared.samples + 1  # a later sample takes the newest target into account
        while shared.samples <= current or not shared.lateness_queried or shared.queued:
            self._alive()
            await asleep(common.POLL)
        shared.hold()

    # --- single set-points --------------------------------------------------------------------------------------

    async def push(
        self, point: Any, *, mini: int | None = None, hand: int | None = None, user: tuple[int, bytes] | None = None
    ) -> None:
        """Queue a set-point; wait while the queue is full.

        If no further set-point is pushed, the arm is stopped. If none is pushed for the time ``idle`` that was passed
        to ``slave_mode``, slave mode is left.

        Args:
            point: Pose of the type that was passed to ``slave_mode``, ``J(...)``, ``P(...)`` or ``T(...)``, or the
                numbers of such a pose.
            mini: New mini I/O outputs from this set-point on, if enabled in ``slave_mode``.
            hand: New hand I/O outputs from this set-point on, if enabled in ``slave_mode``.
            user: New user I/O outputs from this set-point on, if enabled in ``slave_mode``.

        Raises:
            InvalidValue: If the set-point is invalid, or the step from the previous set-point exceeds the limits.
            CallError: If the controller ended slave mode: the first error that it returned.
            StreamError: If slave mode has ended.
        """
        values = read_point(point, self._pose_type, self._axes)
        outputs = self._changed(mini=mini, hand=hand, user=user)
        while self._alive().shared.queued >= self._options.queue:
            await asleep(common.POLL)
        with self._lock:
            self._put(values, outputs)

    def _put(self, values: tuple[float, ...], outputs: Outputs) -> None:
        shared = self._alive().shared
        shadow = self._pushed
        moving = shared.queued or not shared.at_rest
        if shadow is None or not (moving or _admitted(shadow, values)):
            shadow = self._shadow(self._command())  # the arm is held: start at the current command
        shadow.check(values)
        shadow.track(values)
        self._pushed = shadow
        shared.put(values, outputs)
        shared.select_queue()

    # --- live target --------------------------------------------------------------------------------------------

    @property
    def target(self) -> J | P | T | None:
        """The live target of the arm; ``None`` if none has been set.

        The target may be set at any time and at any rate; the arm follows it within the limits. A call of :meth:`stop`
        removes the target.
        """
        return self._target

    @target.setter
    def target(self, pose: Any) -> None:
        streaming = self._alive()
        values = read_point(pose, self._pose_type, self._axes)
        if self._options.on_range == "refuse":
            self._check_range(values)
        streaming.shared.clear_queue()
        streaming.shared.set_target(values, monotonic_ns())
        self._target = common.POSE_TYPES[self._pose_type].of(values)
        self._pushed = None

    def _check_range(self, values: Sequence[float]) -> None:
        if not isinstance(self.limits, Limits):
            return
        for axis, (value, low, high) in enumerate(zip(values, self.limits.lower, self.limits.upper, strict=False), 1):
            if not low <= value <= high:
                raise InvalidValue(
                    tr(
                        "axis {axis}: {value:g} is outside the range of {low:g} to {high:g}",
                        axis=axis,
                        value=value,
                        low=low,
                        high=high,
                    )
                )

    async def stop(self) -> None:
        """Stop the arm within the limits, discard queued set-points, and hold the position; slave mode stays on."""
        shared = self._alive().shared
        shared.clear_queue()
        shared.hold()
        self._forget()
        shared.order(StreamCommand.HALT)
        try:
            while not shared.order_done:
                self._alive()
                await asleep(common.POLL)
        finally:
            if not shared.closed:
                shared.order(StreamCommand.RUN)  # without set-points, the arm stops or remains at standstill

    async def wait(self) -> None:
        """Wait for standstill at the live target or at the last set-point."""
        streaming = self._alive()
        shared = streaming.shared
        current = shared.samples + 1  # a later sample takes the newest target into account
        while shared.samples <= current or shared.queued or not shared.settled:
            self._alive()
            await asleep(common.POLL)

    def outputs(
        self, *, mini: int | None = None, hand: int | None = None, user: tuple[int, bytes] | None = None
    ) -> None:
        """Change outputs that were enabled in ``slave_mode``, from the next cycle on (RC8 table 4-2)."""
        streaming = self._alive()
        streaming.shared.set_outputs(self._changed(mini=mini, hand=hand, user=user))

    def _changed(self, **given: int | tuple[int, bytes] | None) -> Outputs:
        outputs = read_outputs(**given)
        check_outputs_enabled(self._options, outputs)
        check_sendable(self._options, outputs)
        return outputs

    # --- feedback -----------------------------------------------------------------------------------------------

    async def feedback(self) -> AsyncIterator[Sample]:
        """Yield all samples from now on, until the end of the block."""
        streaming = self._alive()
        reader = SampleReader(streaming.shared, streaming.shared.samples)
        while self._streaming is streaming and not streaming.ended:
            for sample in reader.new():
                yield sample
            await asleep(common.POLL)
            streaming.poll()
        if self._streaming is streaming:
            self._alive()

    def new_samples(self) -> list[Sample]:
        """Return the samples since the last call, or since the beginning of the block, without waiting."""
        streaming = self._alive()
        if self._reader is None or self._reader.shared is not streaming.shared:
            self._reader = SampleReader(streaming.shared)
        return list(self._reader.new())

    @property
    def latest(self) -> Sample:
        """The newest sample. At least one sample exists from the beginning of the block."""
        sample = self._newest()
        if sample is None:
            raise StreamError(tr("no sample of the stream can be read yet"))
        return sample

    def _newest(self) -> Sample | None:
        """Return the newest sample; ``None`` if no sample can be read yet."""
        shared = self._alive().shared
        for number in range(shared.samples - 1, max(-1, shared.samples - 3), -1):
            raw = shared.sample(number)
            if raw is not None:
                return common.sample_of(raw, shared.began_ns)
        return None

    @property
    def at_rest(self) -> bool:
        """True if the command position is at standstill."""
        return self._alive().shared.at_rest

    @property
    def queued(self) -> int:
        """The number of queued set-points."""
        return self._alive().shared.queued

    @property
    def underflows(self) -> int:
        """The number of times that the queue was empty while the arm moved, so that the arm was stopped."""
        return self._alive().shared.underflows

    @property
    def _axes(self) -> int:
        return len(self.limits.lower) if isinstance(self.limits, Limits) else 6

    def _command(self) -> tuple[float, ...]:
        """Return the newest command position; NaN for each value if no sample can be read yet."""
        sample = self._newest()
        assert self.limits is not None
        count = len(self.limits.lower) if isinstance(self.limits, Limits) else {"P": 7, "T": 10}[self._pose_type]
        return sample.command[:count] if sample is not None else (math.nan,) * count


def _admitted(planner: Planner, values: Sequence[float]) -> bool:
    try:
        planner.check(values)
    except InvalidValue:
        return False
    return True
