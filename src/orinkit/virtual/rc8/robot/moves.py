"""The motion functions of clients and programs: they plan motions and put them into the queue of the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.motion_options import MotionOptions, VariableRef, resolve
from orinkit.values.poses import AT_COMMAND, FIG_WITHIN_LIMITS, PassMark, Target
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.engine.motion.planner import Motion, Rates
from orinkit.virtual.engine.motion.queue import ROOM, Ticket
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.speeds import FULL, SpeedSet
from orinkit.virtual.rc8.robot.target import ROBOT_AXES, FrameContext, Goal, Joints, check_reach
from orinkit.virtual.rc8.robot.tools import IDENTITY, Matrix
from orinkit.virtual.rc8.variables.table import VariableTable
from orinkit.virtual.rc8.variables.types import CLASSES

PTP: Final = 1
LINE: Final = 2
ARC: Final = 3
CURVE: Final = 4

_NO_OPTIONS: Final = MotionOptions()
_AXES: Final = {"XY": (0.0, 0.0, 1.0), "YZ": (1.0, 0.0, 0.0), "ZX": (0.0, 1.0, 0.0)}
_KEEP_ORIENTATION: Final = 2
_RAISED_LEVEL: Final = 3
_LONGEST_PATH: Final = 5000
_PATHS: Final = 20
_LEAST_RATE: Final = 1e-15  # slower than any valid motion, but not rounded to 0

_Plan: TypeAlias = Callable[[Joints], Motion]
"""Plans a motion that starts from a joint position."""


class Moves:
    """Plans motions for an arm and puts them into its queue.

    Every method that begins motions returns their tickets. Callers first check the conditions
    (:mod:`orinkit.virtual.rc8.robot.conditions`).

    Args:
        arm: The arm.
        variables: Global variables, for poses and speeds that refer to a variable.
        report: Callback that raises an error of the controller; invoked with code and detail of a planning error whose
            level stops the robot.
    """

    def __init__(self, arm: RC8Arm, variables: VariableTable, report: Callable[[int, str], None]) -> None:
        self._arm = arm
        self._variables = variables
        self._report = report
        self._paths: dict[int, list[Target]] = {}

    @property
    def _space(self) -> FrameContext:
        return self._arm.space

    # --- motions ------------------------------------------------------------------------------------------------

    def move(self, interpolation: int, targets: Sequence[Target], options: MotionOptions) -> list[Ticket]:
        """Move with an interpolation (RC8 3.3.4): 1 PTP, 2 linear, 3 arc, 4 free curve.

        PTP and linear move to each of the poses in turn. An arc moves through the first pose to the second. A free
        curve moves through all poses to the last one.

        Raises:
            CallError: INTERPOLATION_NOT_SUPPORTED, E_INVALIDARG; errors of planning.
        """
        if interpolation in (PTP, LINE):
            make = self._ptp_to if interpolation == PTP else self._line_to
            return self._begin(*(partial(make, target, options) for target in targets))
        if interpolation == ARC:
            if len(targets) != 2:
                raise error_for(
                    hresult.E_INVALIDARG,
                    tr("an arc requires two poses: the via point and the end point"),
                )  # fmt: skip
            return self._begin(partial(self._arc, targets[0], targets[1], options))
        if interpolation == CURVE:
            return self._begin(partial(self._curve, targets, targets[-1].mark, options))
        raise self._report_error(
            error_for(
                hresult.INTERPOLATION_NOT_SUPPORTED,
                tr(
                    "interpolation {interpolation} does not exist. Try: 1 (PTP), 2 (linear), 3 (arc) or 4 (free curve)",
                    interpolation=interpolation,
                ),
            )
        )  # fmt: skip

    def follow(self, number: int, mark: PassMark | None, options: MotionOptions) -> list[Ticket]:
        """Move along a stored path, as a free curve.

        Raises:
            CallError: E_INVALIDARG if the path does not exist or has no points; errors of planning.
        """
        return self._begin(partial(self._curve, self._stored(number), mark, options))

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, options: MotionOptions
    ) -> list[Ticket]:
        """Move to a position ``distance`` mm from a pose, in the -Z direction of the tool at this pose."""
        mark = mark or target.mark

        def make(start: Joints) -> Motion:
            return self._retreat(interpolation, self._space.goal(target, start), distance, mark, options, start)

        return self._begin(make)

    def depart(
        self, interpolation: int, distance: float, mark: PassMark | None, options: MotionOptions
    ) -> list[Ticket]:
        """Move by ``distance`` mm in the -Z direction of the tool, with the smallest change of the joints."""

        def make(start: Joints) -> Motion:
            here = Goal(self._space.tcp(start), FIG_WITHIN_LIMITS, start[ROBOT_AXES:])
            return self._retreat(interpolation, here, distance, mark, options, start)

        return self._begin(make)

    def drive(
        self, pairs: Sequence[tuple[int, float]], absolute: bool, mark: PassMark | None, options: MotionOptions
    ) -> list[Ticket]:
        """Move axes by distances, or with ``absolute`` to positions, in deg (mm for linear axes).

        Each pair is the number of an axis, counted from 1, and its distance or position.

        Raises:
            CallError: E_INVALIDARG if an axis does not exist; errors of planning.
        """
        joints = list(self._arm.queue.end_joints)
        for axis, value in pairs:
            if not 1 <= axis <= len(joints):
                raise error_for(
                    hresult.E_INVALIDARG,
                    tr("axis {axis} does not exist; valid axes: 1 to {count}", axis=axis, count=len(joints)),
                )
            joints[axis - 1] = value if absolute else joints[axis - 1] + value
        return self._begin(partial(self._ptp, tuple(joints), mark or options.mark, options))

    def rotate(self, axis: Matrix, point: Matrix, angle: float, options: MotionOptions) -> list[Ticket]:
        """Rotate by ``angle`` deg about an axis through a point (RC8 provider guide, Rotate).

        The direction of the axis and the point (mm) are vectors of the base frame, three numbers each.
        """

        def make(start: Joints) -> Motion:
            return planner.plan_rotation(
                self._space.kinematics, start, axis, point, angle, self._tool, self._path_rates(options),
                options.mark or AT_COMMAND, keep_orientation=options.pose == _KEEP_ORIENTATION,
            )  # fmt: skip

        return self._begin(make)

    def rotate_hand(self, angle: float, mark: PassMark | None, options: MotionOptions) -> list[Ticket]:
        """Rotate by an angle (deg) about the tool's Z axis."""
        tcp = self._space.tcp(self._arm.queue.end_joints)
        rotation = MotionOptions(
            options.speed, options.accel, options.decel, options.time, options.next, mark or options.mark
        )
        return self.rotate(tcp[:3, 2], tcp[:3, 3], angle, rotation)

    def home(self) -> list[Ticket]:
        """Move to the home pose by PTP."""
        return self._begin(partial(self._ptp, self._arm.model.home, None, _NO_OPTIONS))

    def plane(self, name: str) -> Matrix:
        """Return the normal of a plane of the work frame, in the base frame.

        Raises:
            CallError: E_INVALIDARG if the name is not XY, YZ or ZX.
        """
        normal = _AXES.get(name.strip().upper())
        if normal is None:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("plane {name} does not exist. Try: XY, YZ or ZX", name=quoted(name)),
            )
        return np.asarray(self._space.works.matrix()[:3, :3] @ np.asarray(normal))

    def point(self, target: Target) -> Matrix:
        """Return the position of a pose, or of a vector in the work frame, as a point in the base frame, mm.

        Raises:
            CallError: As for :meth:`FrameContext.resolve`.
        """
        if target.kind == "V":
            values = target.value
            if isinstance(values, int):
                values = tuple(self._variables.read(CLASSES["V"], values).value)
            check_reach(*values)
            return np.asarray((self._space.works.matrix() @ np.array([*values, 1.0]))[:3])
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

    def path_length(self, number: int) -> int:
        """Return the number of poses of a stored path."""
        return len(self._paths.get(_path(number), ()))

    # --- helpers ------------------------------------------------------------------------------------------------

    @property
    def _tool(self) -> Matrix:
        return self._space.tools.matrix()

    def _ptp_to(self, target: Target, options: MotionOptions, start: Joints) -> Motion:
        return self._ptp(self._space.joints(target, start), target.mark or options.mark, options, start)

    def _line_to(self, target: Target, options: MotionOptions, start: Joints) -> Motion:
        goal = self._space.path_goal(target, start)
        return self._line(goal.tcp, goal.extra, target.mark or options.mark, options, start)

    def _ptp(self, end: Joints, mark: PassMark | None, options: MotionOptions, start: Joints) -> Motion:
        rates = self._rates(self._arm.speeds.joint, options)
        return planner.plan_ptp(self._space.kinematics, start, end, rates, mark or AT_COMMAND, self._tool)

    def _line(self, end: Matrix, extra: Joints, mark: PassMark | None, options: MotionOptions, start: Joints) -> Motion:
        rates = self._path_rates(options)
        return planner.plan_line(self._space.kinematics, start, end, self._tool, rates, mark or AT_COMMAND, extra)

    def _arc(self, via: Target, target: Target, options: MotionOptions, start: Joints) -> Motion:
        middle, end = self._space.path_goal(via, start), self._space.path_goal(target, start)
        return planner.plan_arc(
            self._space.kinematics, start, middle.tcp, end.tcp, self._tool, self._path_rates(options),
            target.mark or via.mark or options.mark or AT_COMMAND, end.extra,
        )  # fmt: skip

    def _curve(self, targets: Sequence[Target], mark: PassMark | None, options: MotionOptions, start: Joints) -> Motion:
        goals = [self._space.path_goal(target, start) for target in targets]
        return planner.plan_curve(
            self._space.kinematics, start, [goal.tcp for goal in goals], self._tool, self._path_rates(options),
            mark or options.mark or AT_COMMAND, goals[-1].extra,
        )  # fmt: skip

    def _stored(self, number: int) -> list[Target]:
        points = self._paths.get(_path(number))
        if not points:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("path {number} has no points. Try: AddPathPoint", number=number),
            )  # fmt: skip
        return points

    def _retreat(
        self, interpolation: int, goal: Goal, distance: float, mark: PassMark | None, options: MotionOptions,
        start: Joints,
    ) -> Motion:  # fmt: skip
        check_reach(distance)
        back = IDENTITY.copy()
        back[2, 3] = -distance
        end = goal.tcp @ back
        if interpolation == PTP:
            solved = self._space.solve(end, goal.figure, start)
            return self._ptp((*solved, *goal.extra), mark or options.mark, options, start)
        if interpolation != LINE:
            raise error_for(
                hresult.INTERPOLATION_NOT_SUPPORTED,
                tr(
                    "interpolation {interpolation} is not supported for approach and depart motions. Try: 1 (PTP) "
                    "or 2 (linear)",
                    interpolation=interpolation,
                ),
            )
        self._space.check_figure(goal, start)
        return self._line(end, goal.extra, mark or options.mark, options, start)

    def _begin(self, *plans: _Plan) -> list[Ticket]:
        """Plan motions in sequence, and queue them if all of them are possible."""
        queue = self._arm.queue
        if len(queue.tickets) + len(plans) > ROOM:
            raise error_for(
                hresult.ROBOT_MOVING,
                tr("the motion queue is full"),
            )
        motions: list[Motion] = []
        try:
            for make in plans:
                motions.append(make(motions[-1].end if motions else queue.end_joints))
        except CallError as error:
            raise self._report_error(error) from None
        return [self._arm.enqueue(motion) for motion in motions]

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

    def _path_rates(self, options: MotionOptions) -> Rates:
        return self._rates(self._arm.speeds.path, options)

    def _rates(self, internal: SpeedSet, options: MotionOptions) -> Rates:
        external = self._arm.speeds.external
        speed, accel, decel = (
            self._amount(given, default)
            for given, default in (
                (options.speed, internal.speed), (options.accel, internal.accel), (options.decel, internal.decel)
            )
        )  # fmt: skip
        time = None if options.time is None else max(_LEAST_RATE, self._amount(options.time, 0.0) / 1000)
        speed, accel, decel = (
            max(_LEAST_RATE, part / FULL**2)
            for part in (speed * external.speed, accel * external.accel, decel * external.decel)
        )
        return Rates(speed, accel, decel, time)

    def _amount(self, given: float | VariableRef | None, default: float) -> float:
        if given is None:
            return default
        return resolve(given, lambda kind, index: self._variables.read(CLASSES[kind], index).value)


def _path(number: int) -> int:
    if not 1 <= number <= _PATHS:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("path {number} does not exist; valid paths: 1 to {most}", number=number, most=_PATHS),
        )
    return number
