"""Plans the motions of one call.

In a thread, motions are planned without the lock of the controller. Before, :meth:`MotionPlanner.capture` reads
everything that the motions depend on, as it was when the call arrived: tool, work, speeds, and the variables to which
the call refers. Only the joint position at the start is added later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, Generic, NamedTuple, TypeVar

import numpy as np

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.motion_options import MotionOptions, VariableRef, resolve
from orinkit.values.poses import AT_COMMAND, FIG_WITHIN_LIMITS, Extra, PassMark, Target
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.engine.motion.joint_path import MAX_STEPS
from orinkit.virtual.engine.motion.planner import Motion, Rates
from orinkit.virtual.rc8.robot.speeds import FULL, Speeds, SpeedSet
from orinkit.virtual.rc8.robot.target import FrameContext, Goal, Joints, check_reach
from orinkit.virtual.rc8.robot.tools import IDENTITY, Matrix
from orinkit.virtual.rc8.variables.table import VariableTable
from orinkit.virtual.rc8.variables.types import CLASSES

PTP: Final = 1
LINE: Final = 2

_KEEP_ORIENTATION: Final = 2
_QUICK_STEPS: Final = 512  # of the table of a line; more steps may take more than a few milliseconds
_LEAST_RATE: Final = 1e-15  # slower than any valid motion, but not rounded to 0

T = TypeVar("T")


class Captured(Generic[T]):
    """The result of a function, or its error.

    The error is not raised until the result is required, because other errors may precede it.
    """

    __slots__ = ("_error", "_value")

    def __init__(self, read: Callable[[], T]) -> None:
        self._error: CallError | None = None
        try:
            self._value = read()
        except CallError as error:
            self._error = error

    def get(self) -> T:
        """Return the result, or raise the error."""
        if self._error is not None:
            raise error_for(self._error.code, self._error.detail)
        return self._value


class MotionPlanner:
    """Plans the motions of one call.

    Args:
        space: Frames and kinematics of the arm.
        speeds: Speeds of the arm.
        variables: Global variables.
        options: Options of the call.
        targets: The poses of the call.
    """

    def __init__(
        self, space: FrameContext, speeds: Speeds, variables: VariableTable, options: MotionOptions,
        targets: Sequence[Target] = (),
    ) -> None:  # fmt: skip
        self._space = space
        self._axes = space.model.robot_axes
        self._options = options
        self._targets = targets
        self._most_steps = _QUICK_STEPS
        self._joint_rates: Callable[[], Rates] = lambda: _rates(speeds.joint, speeds, options, variables)
        self._path_rates: Callable[[], Rates] = lambda: _rates(speeds.path, speeds, options, variables)

    def capture(self) -> None:
        """Read everything that the motions depend on, so that they can be planned in another thread, without haste."""
        read = self._space.read_variable
        captured: dict[tuple[str, int], Captured[tuple[float, ...]]] = {
            (kind, each.value): Captured(partial(read, kind, each.value))
            for each in self._targets
            if isinstance(each.value, int) and (kind := each.kind or "P")
        }
        self._space = self._space.copy(lambda kind, index: captured[kind, index].get())
        self._most_steps = MAX_STEPS
        self._joint_rates = Captured(self._joint_rates).get
        self._path_rates = Captured(self._path_rates).get

    # --- motions ------------------------------------------------------------------------------------------------

    def ptp_to(self, target: Target, start: Joints) -> Motion:
        """Plan a PTP motion to a pose."""
        return self.ptp(self._space.joints(target, start), target.mark or self._options.mark, start)

    def line_to(self, target: Target, start: Joints) -> Motion:
        """Plan a linear motion to a pose."""
        goal = self._space.path_goal(target, start)
        return self._line(goal.tcp, goal.extra, target.mark or self._options.mark, start)

    def ptp(self, end: Joints, mark: PassMark | None, start: Joints) -> Motion:
        """Plan a PTP motion to a joint position."""
        rates = self._joint_rates()
        return planner.plan_ptp(self._space.kinematics, start, end, rates, mark or AT_COMMAND, self._tool())

    def arc(self, via: Target, target: Target, start: Joints) -> Motion:
        """Plan an arc through a pose to another pose."""
        middle, end = self._space.path_goal(via, start), self._space.path_goal(target, start)
        return planner.plan_arc(
            self._space.kinematics, start, middle.tcp, end.tcp, self._tool(), self._path_rates(),
            target.mark or via.mark or self._options.mark or AT_COMMAND, end.extra,
        )  # fmt: skip

    def curve(self, targets: Sequence[Target], mark: PassMark | None, start: Joints) -> Motion:
        """Plan a free curve through poses to the last one."""
        goals = [self._space.path_goal(target, start) for target in targets]
        return planner.plan_curve(
            self._space.kinematics, start, [goal.tcp for goal in goals], self._tool(), self._path_rates(),
            mark or self._options.mark or AT_COMMAND, goals[-1].extra,
        )  # fmt: skip

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, start: Joints,
        extra: Extra | None = None,
    ) -> Motion:  # fmt: skip
        """Plan a motion to the position ``distance`` mm from a pose, away from it (see :meth:`_retreat`)."""
        goal = self._with_extra(self._space.goal(target, start), extra, start)
        return self._retreat(interpolation, goal, distance, mark or target.mark, start)

    def depart(
        self, interpolation: int, distance: float, mark: PassMark | None, start: Joints, extra: Extra | None = None
    ) -> Motion:
        """Plan a motion by ``distance`` mm (see :meth:`_retreat`), with the smallest change of the joints."""
        goal = self._with_extra(self._here(start), extra, start)
        return self._retreat(interpolation, goal, distance, mark, start)

    def draw(self, interpolation: int, vector: Target, start: Joints) -> Motion:
        """Plan a motion by a vector of the work frame, mm, with the smallest change of the joints."""
        values = vector.value
        if isinstance(values, int):
            values = self._space.read_variable("V", values)
        check_reach(*values)
        here = self._here(start)
        end = here.tcp.copy()
        end[:3, 3] += self._space.works.matrix()[:3, :3] @ np.asarray(values)
        return self._go(interpolation, end, here, vector.mark, start)

    def arch(self, target: Target, heights: ArchHeights, stage: int, first: Joints, start: Joints) -> Motion:
        """Plan one of the three lines of an arch: up, across, and down to a pose.

        Args:
            target: The pose at the end of the arch.
            heights: The shape of the arch.
            stage: 0 up, 1 across, 2 down.
            first: Joint position at the start of the arch.
            start: Joint position at the start of the line.
        """
        goal = self._space.path_goal(target, first)
        begin, up = self._space.tcp(first), self._space.works.matrix()[:3, 2]
        top = max(begin[:3, 3] @ up, goal.tcp[:3, 3] @ up) + heights.top
        end = (begin if stage == 0 else goal.tcp).copy()
        if stage == 2:
            return self._line(end, goal.extra, target.mark or self._options.mark, start)
        lift = float(top - end[:3, 3] @ up)
        check_reach(lift)
        end[:3, 3] += lift * up
        vertical = heights.start if stage == 0 else heights.end
        mark = PassMark("n", lift - vertical) if 0 < vertical < lift else AT_COMMAND
        return self._line(end, start[self._axes :] if stage == 0 else goal.extra, mark, start)

    def drive(
        self, pairs: Sequence[tuple[int, float]], absolute: bool, mark: PassMark | None, start: Joints,
        extra: Extra | None = None,
    ) -> Motion:  # fmt: skip
        """Plan a motion of axes, which must exist, by distances or to positions, in deg (mm for linear axes)."""
        joints = list(start)
        for axis, value in pairs:
            joints[axis - 1] = value if absolute else joints[axis - 1] + value
        end = self._space.with_extra(extra, start, tuple(joints))
        return self.ptp(end, mark or self._options.mark, start)

    def rotate(self, axis: Matrix, point: Matrix, angle: float, start: Joints, extra: Extra | None = None) -> Motion:
        """Plan a rotation by ``angle`` deg about an axis through a point, vectors of the base frame in mm."""
        return planner.plan_rotation(
            self._space.kinematics, start, axis, point, angle, self._tool(), self._path_rates(),
            self._options.mark or AT_COMMAND, keep_orientation=self._options.pose == _KEEP_ORIENTATION,
            extra_end=self._space.with_extra(extra, start, start)[self._axes :],
        )  # fmt: skip

    def tcp(self, start: Joints) -> Matrix:
        """Return the tool frame at a joint position, in the base frame."""
        return self._space.tcp(start)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _tool(self) -> Matrix:
        return self._space.tools.matrix()

    def _line(self, end: Matrix, extra: Joints, mark: PassMark | None, start: Joints) -> Motion:
        rates = self._path_rates()
        return planner.plan_line(
            self._space.kinematics, start, end, self._tool(), rates, mark or AT_COMMAND, extra, self._most_steps
        )

    def _here(self, start: Joints) -> Goal:
        return Goal(self._space.tcp(start), FIG_WITHIN_LIMITS, start[self._axes :])

    def _with_extra(self, goal: Goal, extra: Extra | None, start: Joints) -> Goal:
        if extra is None:
            return goal
        return goal._replace(extra=self._space.with_extra(extra, start, start)[self._axes :])

    def _retreat(self, interpolation: int, goal: Goal, distance: float, mark: PassMark | None, start: Joints) -> Motion:
        """Plan a motion to the position ``distance`` mm behind a goal: against Z of the tool, by a SCARA upwards.

        Programs for SCARAs expect this direction, in which Z of the flange points.
        """
        check_reach(distance)
        if self._space.model.is_scara:
            end = goal.tcp.copy()
            end[2, 3] += distance
            return self._go(interpolation, end, goal, mark, start)
        back = IDENTITY.copy()
        back[2, 3] = -distance
        return self._go(interpolation, goal.tcp @ back, goal, mark, start)

    def _go(self, interpolation: int, end: Matrix, goal: Goal, mark: PassMark | None, start: Joints) -> Motion:
        """Plan a motion to a frame near a goal, by PTP or on a line, with the figure and the extended joints of the goal."""
        mark = mark or self._options.mark
        if interpolation == PTP:
            solved = self._space.solve(end, goal.figure, start)
            return self.ptp((*solved, *goal.extra), mark, start)
        if interpolation != LINE:
            raise error_for(
                hresult.INTERPOLATION_NOT_SUPPORTED,
                tr(
                    "interpolation {interpolation} is not supported for approach, depart and draw motions. Try: 1 "
                    "(PTP) or 2 (linear)",
                    interpolation=interpolation,
                ),
            )
        self._space.check_figure(goal, start)
        return self._line(end, goal.extra, mark, start)


class ArchHeights(NamedTuple):
    """The shape of an arch motion (ArchMove), mm, in the direction of Z of the work frame.

    Attributes:
        top: Height of the arch above the higher one of its ends.
        start: Height above the start from which the tool may also move across; 0 for the whole way up.
        end: Height above the end from which the tool only moves down; 0 for the whole way down.
    """

    top: float
    start: float
    end: float


class Plans(NamedTuple):
    """The motions of one call, which are still to be planned.

    Attributes:
        planner: The planner.
        makes: For each motion a function that plans it, from the joint position at its start.
        quick: True if there is one motion, and planning takes a few milliseconds at most. For a line, this applies only
            before :meth:`MotionPlanner.capture`; if planning would take longer, the error is ``TooManySteps``.
    """

    planner: MotionPlanner
    makes: Sequence[Callable[[Joints], Motion]]
    quick: bool = False

    def planned(self, start: Joints) -> list[Motion] | Exception:
        """Return the motions from a joint position, or the error of planning."""
        motions: list[Motion] = []
        try:
            for make in self.makes:
                motions.append(make(motions[-1].end if motions else start))
        except Exception as error:  # noqa: BLE001 - the caller raises it inside the lock
            return error
        return motions


def _rates(internal: SpeedSet, speeds: Speeds, options: MotionOptions, variables: VariableTable) -> Rates:
    external = speeds.external

    def amount(given: float | VariableRef | None, default: float) -> float:
        if given is None:
            return default
        return resolve(given, lambda kind, index: _number(variables, kind, index))

    speed, accel, decel = (
        amount(given, default)
        for given, default in (
            (options.speed, internal.speed), (options.accel, internal.accel), (options.decel, internal.decel)
        )
    )  # fmt: skip
    time = None if options.time is None else max(_LEAST_RATE, amount(options.time, 0.0) / 1000)
    speed, accel, decel = (
        max(_LEAST_RATE, part / FULL**2)
        for part in (speed * external.speed, accel * external.accel, decel * external.decel)
    )
    return Rates(speed, accel, decel, time, speeds.avoid_singular)


def _number(variables: VariableTable, kind: str, index: int) -> Any:
    return variables.read(CLASSES[kind], index).value
