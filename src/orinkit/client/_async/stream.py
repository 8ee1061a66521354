"""Slave mode: an arm that is moved set-point by set-point (RC8 4), by a process of its own.

The synchronous twin is made from this file, as that of :mod:`orinkit.client._async.controller` is.
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
from orinkit.client._shared.stream_options import StreamOptions, check_opened, check_outputs, read_outputs
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.planning.planners import Planner, planner_for
from orinkit.streaming.process.shared_memory import QUEUE_ROOM, Outputs, StreamCommand
from orinkit.streaming.recording.samples import Sample
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.streaming.trajectory.retime import retime as retimed
from orinkit.streaming.trajectory.trajectory import check_path, check_trajectory, read_point, read_trajectory
from orinkit.transport.runner import apause
from orinkit.values.poses import J, P, T


class AsyncStream(AsyncSlaveMode):
    """Slave mode for as long as a block lasts; ``Robot.slave_mode`` makes one.

    A process of its own has the connection meanwhile and sends a set-point in each cycle of the controller, whatever this
    program does: from :meth:`run`, from :attr:`target`, or from :meth:`push`. When there are none, when this program
    raises, is stopped or killed, it brings the arm to rest within the limits, repeats the last pose, and leaves slave mode.

    Attributes:
        limits: within which everything stays.
        real_time: what the system has granted the process.
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

    # --- a whole trajectory -------------------------------------------------------------------------------------

    async def run(
        self, trajectory: Any, *, retime: bool = False, progress: Callable[[Progress], object] | None = None
    ) -> StreamResult:
        """Send a trajectory, one set-point for each cycle, and wait until the arm stands at its end.

        Args:
            trajectory: an array of one row per cycle, a sequence of ``J(...)``, ``P(...)`` or ``T(...)``, the path of a
                CSV file, or an iterator. All but an iterator is checked as a whole before anything moves.
            retime: slow down what is faster than the limits; not of an iterator.
            progress: is told how many set-points have been sent.

        Raises:
            TrajectoryError: a set-point breaks a limit, or is none; the message names it and the axis.
            CallError: the controller ended slave mode: its first error.
            StreamError: slave mode has ended.
        """
        streaming = self._alive()
        total: int | None = None
        await self._still()
        if isinstance(trajectory, Iterator):
            if retime:
                raise InvalidValue(tr("retime: an iterator cannot be retimed; make a list of it"))
            points = self._checked(trajectory)
            ready = list(islice(points, common.PREFETCH))
        else:
            ready = self._prepared(trajectory, retime=retime)
            points, total = iter(()), len(ready)
        course = common.TrajectoryRun(streaming.shared, total, progress)
        try:
            sent = await self._feed(ready, points, course)
            while course.sent < sent or not course.shared.settled:
                await self._go_on(course)
        except BaseException:
            course.give_up()
            raise
        self._pushed = None
        return course.result(sent)

    async def _feed(
        self, ready: Sequence[tuple[float, ...]], points: Iterator[tuple[float, ...]], course: common.TrajectoryRun
    ) -> int:
        """Queue set-points as there is room; returns how many there were."""
        shared = course.shared
        sent = 0
        looked = monotonic_ns()
        for source in (iter(ready), points):
            for point in source:
                while shared.waiting >= QUEUE_ROOM:
                    course.start()
                    await self._go_on(course)
                shared.put(point)
                sent += 1
                if monotonic_ns() - looked > common.LOOK_NS:
                    await self._go_on(course)
                    looked = monotonic_ns()
            course.start()  # as much as there is room for is there before the first one is sent
        return sent

    async def _go_on(self, course: common.TrajectoryRun) -> None:
        """DrainInput how a trajectory goes, and let others do something.

        Raises:
            StreamError: something else has ended it.
        """
        self._alive()
        course.look()
        await apause(common.POLL)

    def _prepared(self, trajectory: Any, *, retime: bool) -> list[tuple[float, ...]]:
        options, start = self._options, self._command()
        points = read_trajectory(trajectory, self._kind, self._axes, period=options.period)
        assert self.limits is not None
        if retime:
            points = retimed(points, self.limits, options.period, self._kind)
        if isinstance(self.limits, Limits):
            check_trajectory(points, self.limits, start, options.period)
        else:
            check_path(points, self.limits, start, options.period, self._kind)
        return points

    def _checked(self, points: Iterator[Any]) -> Iterator[tuple[float, ...]]:
        start = self._command()
        shadow = self._shadow(start)
        for number, given in enumerate(points):
            point = read_point(given, self._kind, self._axes, number)
            try:
                shadow.check(point)
            except InvalidValue as error:
                raise TrajectoryError(tr("set-point {number}: {error}", number=number, error=error), number) from None
            shadow.track(point)
            yield point

    def _shadow(self, start: Sequence[float]) -> Planner:
        """Return a planner that goes where the streaming process goes, to see what it would pass through."""
        assert self.limits is not None
        return planner_for(self.limits, self._options.period, start, self._kind)

    async def _still(self) -> None:
        """Wait until what was pushed has been sent, or the live target is reached, and the arm stands."""
        shared = self._alive().shared
        from_now = shared.samples + 1  # one that knows what was wanted just now
        while shared.samples <= from_now or not shared.rested or shared.waiting:
            self._alive()
            await apause(common.POLL)
        shared.hold()

    # --- set-points one by one ----------------------------------------------------------------------------------

    async def push(
        self, point: Any, *, mini: int | None = None, hand: int | None = None, user: tuple[int, bytes] | None = None
    ) -> None:
        """Queue one set-point; waits while the queue is full.

        When no more come the arm is brought to rest, and after ``idle`` seconds slave mode is left.

        Args:
            point: ``J(...)``, ``P(...)`` or ``T(...)`` as the block's ``pose`` has it, or its numbers.
            mini: outputs that change with it, of those that the block was opened with.
            hand: the same.
            user: the same.

        Raises:
            InvalidValue: it is none, or farther from the one before than the limits allow.
            CallError: the controller ended slave mode: its first error.
            StreamError: slave mode has ended.
        """
        values = read_point(point, self._kind, self._axes)
        outputs = self._changed(mini=mini, hand=hand, user=user)
        while self._alive().shared.waiting >= self._options.queue:
            await apause(common.POLL)
        with self._lock:
            self._put(values, outputs)

    def _put(self, values: tuple[float, ...], outputs: Outputs) -> None:
        shared = self._alive().shared
        shadow = self._pushed
        under_way = shared.waiting or not shared.at_rest
        if shadow is None or not (under_way or _admitted(shadow, values)):
            shadow = self._shadow(self._command())  # nothing is under way: from where the arm is held
        shadow.check(values)
        shadow.track(values)
        self._pushed = shadow
        self._outputs = self._outputs.changed(outputs)
        shared.put(values, outputs)
        shared.feed_queue()

    # --- a live target ------------------------------------------------------------------------------------------

    @property
    def target(self) -> J | P | T | None:
        """Where the arm is to go: may be set at any time, as often as one likes; the arm follows within the limits."""
        return self._target

    @target.setter
    def target(self, pose: Any) -> None:
        streaming = self._alive()
        values = read_point(pose, self._kind, self._axes)
        if self._options.on_range == "refuse":
            self._check_range(values)
        streaming.shared.forget()
        streaming.shared.set_target(values, monotonic_ns())
        self._target = common.POSE_TYPES[self._kind].of(values)
        self._pushed = None

    def _check_range(self, values: Sequence[float]) -> None:
        if not isinstance(self.limits, Limits):
            return
        for axis, (value, low, high) in enumerate(zip(values, self.limits.lower, self.limits.upper, strict=False), 1):
            if not low <= value <= high:
                raise InvalidValue(
                    tr(
                        "axis {axis}: {value:g} is beyond its range of {low:g} to {high:g}",
                        axis=axis,
                        value=value,
                        low=low,
                        high=high,
                    )
                )

    async def stop(self) -> None:
        """Bring the arm to rest within the limits, forget what is queued, and hold it there; slave mode stays on."""
        shared = self._alive().shared
        shared.forget()
        shared.hold()
        self._forget()
        shared.order(StreamCommand.HALT)
        try:
            while not shared.order_done:
                self._alive()
                await apause(common.POLL)
        finally:
            if not shared.closed:
                shared.order(StreamCommand.RUN)  # nothing is fed: the arm stays at rest, or comes to it

    async def wait(self) -> None:
        """Wait until the arm stands: at the live target, or at the last set-point."""
        streaming = self._alive()
        shared = streaming.shared
        from_now = shared.samples + 1  # one that knows what was wanted just now
        while shared.samples <= from_now or shared.waiting or not shared.settled:
            self._alive()
            await apause(common.POLL)

    def outputs(
        self, *, mini: int | None = None, hand: int | None = None, user: tuple[int, bytes] | None = None
    ) -> None:
        """Change outputs, of those that the block was opened with, from the next cycle on (RC8 table 4-2)."""
        streaming = self._alive()
        self._outputs = self._outputs.changed(self._changed(mini=mini, hand=hand, user=user))
        streaming.shared.set_outputs(self._outputs)

    def _changed(self, **given: int | tuple[int, bytes] | None) -> Outputs:
        new_ones = read_outputs(**given)
        check_opened(self._options, new_ones)
        check_outputs(self._options, new_ones)
        return new_ones

    # --- what comes back ----------------------------------------------------------------------------------------

    async def feedback(self) -> AsyncIterator[Sample]:
        """Give every sample from now on, until the block ends."""
        streaming = self._alive()
        reader = SampleReader(streaming.shared, streaming.shared.samples)
        while self._streaming is streaming and not streaming.ended:
            for sample in reader.new():
                yield sample
            await apause(common.POLL)
            streaming.look()
        if self._streaming is streaming:
            self._alive()

    def samples(self) -> list[Sample]:
        """Return the samples since the last call, or since the block began, without waiting."""
        streaming = self._alive()
        if self._reader is None or self._reader.shared is not streaming.shared:
            self._reader = SampleReader(streaming.shared)
        return list(self._reader.new())

    @property
    def latest(self) -> Sample | None:
        """The newest sample; ``None`` before the first one."""
        shared = self._alive().shared
        for number in range(shared.samples - 1, max(-1, shared.samples - 3), -1):
            raw = shared.sample(number)
            if raw is not None:
                return common.sample_of(raw, shared.began_ns)
        return None

    @property
    def at_rest(self) -> bool:
        """Whether the command stands still."""
        return self._alive().shared.at_rest

    @property
    def waiting(self) -> int:
        """How many set-points are queued."""
        return self._alive().shared.waiting

    @property
    def underflows(self) -> int:
        """How often the queue was empty while the arm moved, so that the arm was brought to rest."""
        return self._alive().shared.dry

    @property
    def _axes(self) -> int:
        return len(self.limits.lower) if isinstance(self.limits, Limits) else 6

    def _command(self) -> tuple[float, ...]:
        """Return the newest command."""
        sample = self.latest
        assert self.limits is not None
        count = len(self.limits.lower) if isinstance(self.limits, Limits) else {"P": 7, "T": 10}[self._kind]
        return sample.command[:count] if sample is not None else (math.nan,) * count


def _admitted(planner: Planner, values: Sequence[float]) -> bool:
    try:
        planner.check(values)
    except InvalidValue:
        return False
    return True
