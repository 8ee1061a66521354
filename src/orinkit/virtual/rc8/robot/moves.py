"""The motion functions of clients and programs: they plan motions and put them into the queue of the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, TypeAlias, TypeVar

import numpy as np

from orinkit.arms import frames
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.motion_options import MotionOptions
from orinkit.values.poses import Extra, PassMark, Target
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.engine.motion.joint_path import TooManySteps
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.queue import Ticket
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.motion_planner import LINE, PTP, ArchHeights, MotionPlanner, Plans
from orinkit.virtual.rc8.robot.target import NO_FRAME, FrameContext, Joints, check_reach, figure_of
from orinkit.virtual.rc8.robot.tools import Matrix
from orinkit.virtual.rc8.robot.waiting_calls import PendingMotions
from orinkit.virtual.rc8.variables.table import VariableTable

ARC: Final = 3
CURVE: Final = 4

_NO_OPTIONS: Final = MotionOptions()
_RAISED_LEVEL: Final = 3
_LONGEST_PATH: Final = 5000
_PATHS: Final = 20
_OF_TOOL: Final = "H"
_NORMALS: Final = {"XY": 2, "YZ": 0, "ZX": 1}  # index of the axis perpendicular to the plane

T = TypeVar("T")

OfTool: TypeAlias = Callable[[Matrix], Matrix]
"""Returns a vector of the base frame; its argument is the tool frame at the start."""


class Moves:
    """Plans motions for an arm and puts them into its queue.

    Every motion function returns the plans of its motions, which :meth:`begin` executes. Callers first check the
    conditions (:mod:`orinkit.virtual.rc8.robot.conditions`).

    Args:
        arm: The arm.
        cycles: The control loop, which is the lock of the controller.
        lane: The thread in which motions are planned.
        variables: Global variables, for poses and speeds that refer to a variable.
        report: Callback that raises an error of the controller; invoked with code and detail of a planning error whose
            level stops the robot.
    """

    def __init__(
        self, arm: RC8Arm, cycles: ControlLoop, lane: Lane, variables: VariableTable,
        report: Callable[[int, str], None],
    ) -> None:  # fmt: skip
        self._arm = arm
        self._cycles = cycles
        self._lane = lane
        self._variables = variables
        self._report = report
        self._paths: dict[int, list[Target]] = {}

    @property
    def _space(self) -> FrameContext:
        return self._arm.space

    # --- motions ------------------------------------------------------------------------------------------------

    def begin(self, plans: Plans, then: Callable[[Sequence[Ticket]], T], *, pauses: bool = False) -> T | Deferred[T]:
        """Plan motions in sequence, and queue them if all of them are possible.

        A single PTP motion or line is planned immediately if this takes a few milliseconds at most. Other motions are
        planned in a thread. Until they are queued, the arm is busy, as if they were queued already. A stop discards
        them: the Deferred then fails with the code of the stop, or its result is ``None`` after a skip.

        Args:
            plans: The motions.
            then: Callback invoked inside the lock of the controller with the tickets of the motions.
            pauses: True to run no cycles until the motions are queued.

        Returns:
            The result of ``then``; from a thread as a Deferred (``brief``).

        Raises:
            CallError: ROBOT_MOVING if the queue has not enough room; STOPPING_MOTION; errors of planning, unless there
                is a thread.
        """
        arm = self._arm
        if arm.companions:
            raise error_for(hresult.ROBOT_MOVING, tr("a cooperative motion is in progress. Try: wait for its end"))
        if arm.room < len(plans.makes):
            raise error_for(
                hresult.ROBOT_MOVING,
                tr("the motion queue is full"),
            )
        arm.queue.require_accepting()
        if plans.quick and not arm.planning:
            planned = plans.planned(arm.queue.end_joints)
            if not isinstance(planned, TooManySteps):
                return then(self._queue(planned))
        plans.planner.capture()
        if self._lane.immediate:
            return then(self._queue(plans.planned(arm.queue.end_joints)))
        return self._begin_in_thread(plans, then, pauses=pauses)

    def _begin_in_thread(self, plans: Plans, then: Callable[[Sequence[Ticket]], T], *, pauses: bool) -> Deferred[T]:
        arm, cycles = self._arm, self._cycles
        pending = PendingMotions(len(plans.makes), Deferred(brief=True))

        def job() -> T | None:
            with cycles:  # after the caller has left the lock
                start = arm.queue.end_joints
            planned = plans.planned(start)
            with cycles:
                return then(self._queue(planned)) if arm.forget_motions(pending) else None

        self._lane.submit(job, pending.done)
        arm.expect_motions(pending)
        if pauses:
            cycles.suspend()
            pending.done.add_done_callback(cycles.resume)
        return pending.done

    def collect(
        self, plans: Plans, plan: Callable[[], list[T] | Exception], then: Callable[[list[T]], None]
    ) -> Deferred[None] | None:
        """Plan motions that do not begin yet.

        Args:
            plans: The motions; everything that they depend on is read now.
            plan: Function that plans them, without the lock.
            then: Callback invoked inside the lock with the planned motions, unless a stop has discarded them.

        Returns:
            ``None``, or a Deferred (``brief``) if the motions are planned in a thread.

        Raises:
            CallError: Errors of planning, unless there is a thread.
        """
        plans.planner.capture()
        if self._lane.immediate:
            then(self._require_planned(plan()))
            return None
        arm, cycles = self._arm, self._cycles
        pending = PendingMotions(len(plans.makes), Deferred(brief=True))

        def job() -> None:
            planned = plan()
            with cycles:
                if arm.forget_motions(pending):
                    then(self._require_planned(planned))

        self._lane.submit(job, pending.done)
        arm.expect_motions(pending)
        return pending.done

    def _queue(self, planned: list[Motion] | Exception) -> Sequence[Ticket]:
        motions = self._require_planned(planned)
        self._arm.hardware.force.require_slow(motions)
        return [self._arm.enqueue(motion) for motion in motions]

    def _require_planned(self, planned: list[T] | Exception) -> list[T]:
        """Return what has been planned, or raise the error of planning."""
        if isinstance(planned, CallError):
            raise self._report_error(planned)
        if isinstance(planned, Exception):
            raise planned
        return planned

    def move(self, interpolation: int, targets: Sequence[Target], options: MotionOptions) -> Plans:
        """Move with an interpolation (RC8 3.3.4): 1 PTP, 2 linear, 3 arc, 4 free curve.

        PTP and linear move to each of the poses in turn. An arc moves through the first pose to the second. A free
        curve moves through all poses to the last one.

        Raises:
            CallError: INTERPOLATION_NOT_SUPPORTED, E_INVALIDARG.
        """
        planner = self._planner(options, targets)
        if interpolation in (PTP, LINE):
            make = planner.ptp_to if interpolation == PTP else planner.line_to
            makes = [partial(make, target) for target in targets]
            return Plans(planner, makes, quick=len(makes) == 1)
        if interpolation == ARC:
            if len(targets) != 2:
                raise error_for(
                    hresult.E_INVALIDARG,
                    tr("an arc requires 2 poses, the via point and the end point; got {count}", count=len(targets)),
                )
            if (targets[0].kind or "P") != (targets[1].kind or "P"):
                raise error_for(hresult.E_INVALIDARG, tr("the two poses of an arc must have the same type"))
            return Plans(planner, [partial(planner.arc, targets[0], targets[1])])
        if interpolation == CURVE:
            return Plans(planner, [partial(planner.curve, targets, targets[-1].mark)])
        raise self._report_error(
            error_for(
                hresult.INTERPOLATION_NOT_SUPPORTED,
                tr(
                    "interpolation {interpolation} does not exist. Try: 1 (PTP), 2 (linear), 3 (arc) or 4 (free curve)",
                    interpolation=interpolation,
                ),
            )
        )  # fmt: skip

    def follow(self, number: int, mark: PassMark | None, options: MotionOptions) -> Plans:
        """Move along a stored path, as a free curve.

        Raises:
            CallError: E_INVALIDARG if the path does not exist or has no points.
        """
        planner = self._planner(options)
        return Plans(planner, [partial(planner.curve, self._stored(number), mark)])

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, options: MotionOptions,
        extra: Extra | None = None,
    ) -> Plans:  # fmt: skip
        """Move to a position ``distance`` mm from a pose: in the -Z direction of the tool there, by a SCARA upwards."""
        planner = self._planner(options, (target,))
        make = partial(planner.approach, interpolation, target, distance, mark, extra=extra)
        return Plans(planner, [make], quick=True)

    def depart(
        self, interpolation: int, distance: float, mark: PassMark | None, options: MotionOptions,
        extra: Extra | None = None,
    ) -> Plans:  # fmt: skip
        """Move by ``distance`` mm in the -Z direction of the tool, by a SCARA upwards, with the smallest change of joints."""
        planner = self._planner(options)
        return Plans(planner, [partial(planner.depart, interpolation, distance, mark, extra=extra)], quick=True)

    def draw(self, interpolation: int, vector: Target, options: MotionOptions) -> Plans:
        """Move by a vector of the work frame, mm, with the smallest change of the joints."""
        planner = self._planner(options, (vector,))
        return Plans(planner, [partial(planner.draw, interpolation, vector)], quick=True)

    def arch(self, target: Target, heights: ArchHeights, options: MotionOptions) -> Plans:
        """Move up, across and down to a pose, on lines that are blended into each other.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if a height is negative.
        """
        for height in heights:
            if height < 0:
                raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("the height {height:g} mm is negative", height=height))
        planner = self._planner(options, (target,))
        first: list[Joints] = []

        def make(stage: int, start: Joints) -> Motion:
            if stage == 0:
                first[:] = [start]
            return planner.arch(target, heights, stage, first[0], start)

        return Plans(planner, [partial(make, stage) for stage in range(3)])

    def drive(
        self, pairs: Sequence[tuple[int, float]], absolute: bool, mark: PassMark | None, options: MotionOptions,
        extra: Extra | None = None,
    ) -> Plans:  # fmt: skip
        """Move axes by distances, or with ``absolute`` to positions, in deg (mm for linear axes).

        Each pair is the number of an axis, counted from 1, and its distance or position.

        Raises:
            CallError: E_INVALIDARG if an axis does not exist.
        """
        count = len(self._arm.model.axes)
        for axis, _ in pairs:
            if not 1 <= axis <= count:
                raise error_for(
                    hresult.E_INVALIDARG,
                    tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=axis, count=count),
                )
        planner = self._planner(options)
        return Plans(planner, [partial(planner.drive, pairs, absolute, mark, extra=extra)], quick=True)

    def rotate(
        self, axis: Matrix | OfTool, point: Matrix | OfTool, angle: float, options: MotionOptions,
        extra: Extra | None = None,
    ) -> Plans:  # fmt: skip
        """Rotate by ``angle`` deg about an axis through a point (RC8 provider guide, Rotate).

        The direction of the axis and the point (mm) are vectors of the base frame, three numbers each. They may depend
        on the tool frame at the start.
        """
        planner = self._planner(options)

        def make(start: Joints) -> Motion:
            tcp = planner.tcp(start)
            direction, origin = (part(tcp) if callable(part) else part for part in (axis, point))
            return planner.rotate(direction, origin, angle, start, extra)

        return Plans(planner, [make])

    def rotate_hand(
        self, angle: float, mark: PassMark | None, options: MotionOptions, extra: Extra | None = None
    ) -> Plans:
        """Rotate by an angle (deg) about the tool's Z axis."""
        rotation = MotionOptions(
            options.speed, options.accel, options.decel, options.time, options.next, mark or options.mark
        )
        return self.rotate(lambda tcp: tcp[:3, 2], lambda tcp: tcp[:3, 3], angle, rotation, extra)

    def home(self) -> Plans:
        """Move to the home pose by PTP."""
        planner = self._planner(_NO_OPTIONS)
        return Plans(planner, [partial(planner.ptp, self._arm.model.home, None)], quick=True)

    def plane(self, name: str) -> Matrix | OfTool:
        """Return the normal of a plane, in the base frame: XY, YZ, ZX of the work frame, or XYH, YZH, ZXH of the tool.

        Raises:
            CallError: E_INVALIDARG if there is no plane of this name.
        """
        word = name.strip().upper()
        normal = _NORMALS.get(word.removesuffix(_OF_TOOL))
        if normal is None:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("plane {name} does not exist. Try: XY, YZ, ZX, XYH, YZH or ZXH", name=quoted(name)),
            )
        if word.endswith(_OF_TOOL):
            return lambda tcp: np.asarray(tcp[:3, normal])
        return np.asarray(self._space.works.matrix()[:3, normal])

    def pivot(self, plane: str, target: Target | None) -> Matrix | OfTool:
        """Return the pivot of a rotation, in the base frame.

        The pivot is a pose or a vector in the frame of the plane. Without a pivot, it is the tool's origin.

        Raises:
            CallError: As for :meth:`point`.
        """
        of_tool = plane.strip().upper().endswith(_OF_TOOL)
        if target is not None and not of_tool:
            return self.point(target)
        values = self.vector(target) if target is not None else (0.0, 0.0, 0.0)
        return lambda tcp: np.asarray((tcp @ np.array([*values[:3], 1.0]))[:3])

    def vector(self, target: Target) -> Sequence[float]:
        """Return the first three numbers of a vector or a position; if it refers to a variable, those of the variable.

        Raises:
            CallError: VARIABLE_INDEX_INVALID; DISP_E_TYPEMISMATCH for a joint position; TARGET_OUT_OF_RANGE.
        """
        if target.kind == "J":
            raise error_for(
                hresult.DISP_E_TYPEMISMATCH,
                tr("{target} is not a vector. Try: V1 or V(x, y, z)", target=target),
            )
        values = target.value
        if isinstance(values, int):
            values = self._space.read_variable(target.kind or "P", values)
        check_reach(*values[:3])
        return values[:3]

    def point(self, target: Target) -> Matrix:
        """Return the position of a pose, or of a vector in the work frame, as a point in the base frame, mm.

        Raises:
            CallError: As for :meth:`FrameContext.resolve`.
        """
        if target.kind == "V":
            return np.asarray((self._space.works.matrix() @ np.array([*self.vector(target), 1.0]))[:3])
        start = self._arm.queue.end_joints
        kind, values = self._space.resolve(target, start)
        frame = (
            self._space.tcp(self._space.joints(target, start))
            if kind == "J"
            else self._space.frame_in_base(kind, values)
        )
        return np.asarray(frame[:3, 3])

    # --- stored paths -------------------------------------------------------------------------------------------

    def add_path_point(self, number: int, target: Target) -> None:
        """Add a pose to a stored path for free curves.

        Raises:
            CallError: E_INVALIDARG if the path does not exist; E_OUTOFMEMORY if the path is full; errors of the pose.
        """
        path = self._paths.setdefault(_path(number), [])
        if len(path) >= _LONGEST_PATH:
            raise error_for(hresult.E_OUTOFMEMORY, tr("a path holds at most {most} points", most=_LONGEST_PATH))
        kind, values = self._space.resolve(target, self._arm.queue.end_joints)
        path.append(Target(kind, values))

    def clear_path(self, number: int) -> None:
        """Remove the poses of a stored path."""
        self._paths.pop(_path(number), None)

    def set_path(self, number: int, points: Sequence[Target]) -> None:
        """Replace the poses of a stored path.

        Raises:
            CallError: E_INVALIDARG if the path does not exist; E_OUTOFMEMORY if there are too many poses.
        """
        if len(points) > _LONGEST_PATH:
            raise error_for(hresult.E_OUTOFMEMORY, tr("a path holds at most {most} points", most=_LONGEST_PATH))
        self._paths[_path(number)] = list(points)

    def path_point(self, number: int, point: int) -> list[float]:
        """Return a pose of a stored path as P: seven numbers; points are counted from 1.

        Raises:
            CallError: E_INVALIDARG if the path does not exist; VALUE_OUT_OF_RANGE if the point does not exist.
        """
        path = self._paths.get(_path(number), [])
        if not 1 <= point <= len(path):
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("path {number} has {count} points, not {point}", number=number, count=len(path), point=point),
            )
        return self.as_position(path[point - 1])

    def path_targets(self, number: int) -> list[Target]:
        """Return all poses of a stored path.

        Raises:
            CallError: E_INVALIDARG if the path does not exist.
        """
        return list(self._paths.get(_path(number), ()))

    def as_position(self, target: Target) -> list[float]:
        """Return a pose of a stored path as P: seven numbers."""
        start = self._arm.queue.end_joints
        kind, values = self._space.resolve(target, start)
        if kind == "J":
            return self._space.position(self._space.joints(target, start))
        frame = self._space.frame_in_base(kind, values, NO_FRAME)
        return [*frames.position_of_matrix(frame).tolist(), float(figure_of(kind, values))]

    def path_length(self, number: int) -> int:
        """Return the number of poses of a stored path."""
        return len(self._paths.get(_path(number), ()))

    # --- helpers ------------------------------------------------------------------------------------------------

    def _planner(self, options: MotionOptions, targets: Sequence[Target] = ()) -> MotionPlanner:
        return MotionPlanner(self._arm.space, self._arm.speeds, self._variables, options, targets)

    def _stored(self, number: int) -> tuple[Target, ...]:
        points = self._paths.get(_path(number))
        if not points:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("path {number} has no points. Try: AddPathPoint", number=number),
            )  # fmt: skip
        return tuple(points)  # points may be added while the motion is planned

    def _report_error(self, error: CallError) -> CallError:
        """Return an error of planning; if its level stops the robot, first report it to the controller.

        An error of a program is not reported here, because the controller raises it later, with the line of the
        program.
        """
        holder = self._arm.holder
        stops = error.code >> 24 & 0xF >= _RAISED_LEVEL and error.info.family is hresult.CodeFamily.MOTION
        if stops and not (holder is not None and holder.program):
            self._report(error.code, error.detail)
        return error


def _path(number: int) -> int:
    if not 1 <= number <= _PATHS:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("path {number} does not exist; valid paths: 1 to {most}", number=number, most=_PATHS),
        )
    return number
