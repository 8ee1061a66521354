"""Converts poses of clients to joint positions or to frames in the base frame, using work, tool and figure."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from orinkit.arms import ArmModel, frames
from orinkit.arms.kinematics import Kinematics
from orinkit.arms.kinematics.figures import COBOTTA_BIT, HIGHEST
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import Extra, Kind, Target
from orinkit.virtual.rc8.robot.tools import (
    FIXED_TOOL,
    IDENTITY,
    FrameSet,
    Matrix,
    base_frames,
    tool_frames,
    work_frames,
)
from orinkit.virtual.rc8.variables.table import VariableTable
from orinkit.virtual.rc8.variables.types import CLASSES

_LEAST_VALUES: Final = {"P": 6, "T": 9, "J": 1}
_ALL_BITS: Final = -1
_VERTICAL: Final = 1 - 1e-12  # cosine of a tilt of less than 1e-4 deg
_FIGURE_AT: Final = {"P": 6, "T": 9}
_BY_LENGTH: Final[dict[int, Kind]] = {7: "P", 8: "J", 9: "T", 10: "T"}  # type of an untyped pose by its length
NO_FRAME: Final = -2
"""Number of a work frame that means none: a pose is converted in its own frame."""

_FIGURE_AUTO: Final = -1
_FIGURE_LEAST: Final = -3
_FARTHEST: Final = 1e6  # mm; beyond the reach of any arm, and small enough for calculations

Joints = tuple[float, ...]
ReadVariable: TypeAlias = Callable[[str, int], tuple[float, ...]]
"""Returns the value of a global variable of class P, J, T or V; its arguments are the class and the index."""


class Goal(NamedTuple):
    """The destination that a pose describes.

    Attributes:
        tcp: Tool frame in the base frame.
        figure: Figure of the pose; negative if the arm chooses it.
        extra: Extended joints.
        path_bits: Bits of the figure that a path to this destination cannot change. Of a J whose joint 5 is 0, FLIP and
            NONFLIP are the same.
    """

    tcp: Matrix
    figure: int
    extra: Joints
    path_bits: int = _ALL_BITS


class FrameContext:
    """The frames and the kinematics of the arm, which define the meaning of a pose.

    Attributes:
        tools, works: The tool frames and the work frames, each with the number of the current frame.
        bases: The base frames; number 0 is the place of the arm in the world, in which works are defined.
        kinematics: Kinematics of the arm.
        read_variable: Function that returns the value of a global variable.
    """

    def __init__(self, model: ArmModel, variables: VariableTable) -> None:
        self.model = model
        self.kinematics = Kinematics(model)
        self.tools: FrameSet = tool_frames()
        self.works: FrameSet = work_frames()
        self.bases: FrameSet = base_frames()
        self.read_variable: ReadVariable = lambda kind, index: tuple(variables.read(CLASSES[kind], index).value)

    def copy(self, read_variable: ReadVariable) -> FrameContext:
        """Return a copy with the present frames, which another thread may use, and another source of variables."""
        copied = copy.copy(self)
        copied.tools, copied.works = self.tools.copy(), self.works.copy()
        copied.read_variable = read_variable
        return copied

    def define_base(self, number: int, values: Sequence[float], attribute: int) -> None:
        """Set a base frame; number 0 moves the arm in the world, so that the works move against the arm.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        self.bases.define(number, values, attribute)
        base = self.bases.matrix(0)
        self.works.place_origin(None if np.array_equal(base, IDENTITY) else frames.inverse_of(base))

    # --- from joints to a pose ----------------------------------------------------------------------------------

    def complete(self, joints: Sequence[float]) -> Joints:
        """Return a joint position with all axes; omitted extended joints are at home.

        Raises:
            ValueError: If there are fewer joints than the arm has, or more than axes, or if a joint is outside its
                limits.
        """
        axes, robot_axes = len(self.model.axes), self.model.robot_axes
        position = (*map(float, joints), *self.model.home[len(joints) :])
        complete = len(joints) >= robot_axes and len(position) == axes and all(map(math.isfinite, position))
        if not complete or self.kinematics.limits_exceeded(position):
            raise ValueError(
                tr(
                    "joint position {joints} is not valid for {name}. Try: {count} joints within their limits",
                    name=self.model.name,
                    joints=", ".join(f"{value:g}" for value in joints),
                    count=robot_axes if axes == robot_axes else f"{robot_axes}-{axes}",
                )
            )
        return position

    def tcp(self, joints: Sequence[float]) -> Matrix:
        """Return the tool frame at a joint position, in the base frame."""
        return np.asarray(self.kinematics.forward(joints) @ self.tools.matrix())

    def in_work(self, tcp: Matrix) -> Matrix:
        """Convert a frame from the base frame to the current work frame.

        If the tool is fixed (attribute of the work), return the fixed tool in the frame that the arm holds.
        """
        if self.works.attribute() == FIXED_TOOL:
            return np.asarray(frames.inverse_of(tcp) @ self.works.matrix())
        return np.asarray(frames.inverse_of(self.works.matrix()) @ tcp)

    def position(self, joints: Sequence[float]) -> list[float]:
        """Return a joint position as P: X, Y, Z in mm, RX, RY, RZ in deg, Fig, in the current work frame."""
        return [*self.values(self.tcp(joints)), float(self.figure(joints))]

    def values(self, tcp: Matrix) -> list[float]:
        """Convert a frame from the base frame to X, Y, Z (mm), RX, RY, RZ (deg) in the current work frame."""
        return [float(value) for value in frames.position_of_matrix(self.in_work(tcp))]

    def trans(self, joints: Sequence[float]) -> list[float]:
        """Return a joint position as T: X, Y, Z in mm, orient and approach vector, Fig, in the current work frame."""
        values = frames.trans_of_matrix(self.in_work(self.tcp(joints)))
        return [*map(float, values), float(self.figure(joints))]

    def figure(self, joints: Sequence[float]) -> int:
        """Return the figure that the controller reports at a joint position."""
        return self.kinematics.figure(joints) | self.model.figure_bits

    # --- from a pose to joints ----------------------------------------------------------------------------------

    def resolve(self, target: Target, start: Joints) -> tuple[Kind, tuple[float, ...]]:
        """Return type and values of a pose; if it refers to a variable, return the current values of the variable.

        Raises:
            CallError: VARIABLE_INDEX_INVALID; E_INVALIDARG if there are too few values; FIGURE_OUT_OF_RANGE if Fig is
                not valid; DISP_E_TYPEMISMATCH if the target is not a pose.
        """
        values = target.value
        kind: Kind = target.kind or ("P" if isinstance(values, int) else _BY_LENGTH.get(len(values), ""))
        if not kind:  # mistaking joints for a position would move the arm to an unexpected place
            raise error_for(
                hresult.E_INVALIDARG,
                tr("{target} may be a joint position or a position. Try: J(...) or P(...)", target=target),
            )
        if kind not in _LEAST_VALUES:
            raise error_for(
                hresult.DISP_E_TYPEMISMATCH,
                tr("{target} is not a pose of type P, T or J", target=target),
            )
        if isinstance(values, int):
            values = self.read_variable(kind, values)
        elif kind == "J":  # joints that are not given keep their positions
            values = (*values, *start[len(values) :])
        if len(values) < _LEAST_VALUES[kind]:
            raise error_for(
                hresult.E_INVALIDARG,
                tr(
                    "{target} has {count} values, expected at least {least}",
                    target=target,
                    count=len(values),
                    least=_LEAST_VALUES[kind],
                ),
            )
        if kind != "J":
            figure_of(kind, values)
        return kind, values

    def joints(self, target: Target, start: Joints, tool: int = -1, work: int = -1) -> Joints:
        """Return the joint position, with all axes, at the end of a point-to-point motion to a pose.

        Args:
            target: The pose.
            start: Joint position at the start; used to choose a solution if the pose has no figure.
            tool: Number of the tool of the pose, -1 for the current one.
            work: Number of the work frame of the pose, -1 for the current one.

        Raises:
            CallError: TARGET_OUT_OF_RANGE, FIGURE_INVALID, FIGURE_OUT_OF_RANGE; otherwise as for :meth:`resolve`.
        """
        kind, values = self.resolve(target, start)
        if kind == "J":
            count = len(self.model.axes)
            ends = (*values[:count], *start[len(values) :])
            if len(values) <= self.model.robot_axes:
                ends = (*ends[: self.model.robot_axes], *start[self.model.robot_axes :])
            return self.with_extra(target.extra, start, ends[:count])
        tcp = self.frame_in_base(kind, values, work, tool)
        solved = self.solve(tcp, figure_of(kind, values), start, tool)
        return self.with_extra(target.extra, start, (*solved, *start[self.model.robot_axes :]))

    def goal(self, target: Target, start: Joints) -> Goal:
        """Return the tool frame and the extended joints of a pose.

        Raises:
            CallError: As for :meth:`resolve` and :meth:`with_extra`.
        """
        kind, values = self.resolve(target, start)
        if kind == "J":
            joints = self.joints(target, start)
            figure, bits = self.kinematics.figure(joints), self.kinematics.path_bits(joints)
            return Goal(self.tcp(joints), figure, joints[self.model.robot_axes :], bits)
        extra = self.with_extra(target.extra, start, start)[self.model.robot_axes :]
        return Goal(self.frame_in_base(kind, values), figure_of(kind, values), extra)

    def path_goal(self, target: Target, start: Joints) -> Goal:
        """Return the destination of a path (line, arc or curve) to a pose.

        Raises:
            CallError: FIGURE_MISMATCH if pose and arm have different figures; otherwise as for :meth:`goal`.
        """
        goal = self.goal(target, start)
        self.check_figure(goal, start)
        return goal

    def check_figure(self, goal: Goal, start: Joints) -> None:
        """Check that a path from a joint position can end with the figure of a pose; only its DOUBLE bits may differ.

        Raises:
            CallError: FIGURE_MISMATCH if the figures differ.
        """
        present = self.kinematics.figure(start)
        kept = goal.path_bits & self.kinematics.path_bits(start)
        if goal.figure >= 0 and goal.figure & kept != present & kept:
            raise error_for(
                hresult.FIGURE_MISMATCH,
                tr(
                    "the pose has figure {figure}, the arm has figure {present}; a path cannot change the figure",
                    figure=goal.figure,
                    present=present,
                ),
            )

    def solve(self, tcp: Matrix, figure: int, start: Joints, tool: int = -1) -> Joints:
        """Return the positions of the robot axes at which the tool frame is ``tcp`` (in the base frame).

        A negative ``figure`` is a rule by which the solution is chosen (:meth:`Kinematics.choose`). Tool -1 is the
        current tool.

        Raises:
            CallError: TARGET_OUT_OF_RANGE, FIGURE_INVALID, FIGURE_OUT_OF_RANGE.
        """
        flange = tcp @ frames.inverse_of(self.tools.matrix(tool))
        near = np.asarray(start[: self.model.robot_axes])
        try:
            if figure < 0:
                found = self.kinematics.choose(flange, figure, near)
            else:
                found = self.kinematics.inverse(flange, figure, near)
        except CallError as error:
            if error.code == hresult.OUT_OF_WORKING_RANGE:  # no motion has begun: a refusal, not a stop
                raise error_for(hresult.TARGET_OUT_OF_RANGE, error.detail) from None
            raise
        return tuple(float(angle) for angle in found)

    def with_extra(self, extra: Extra | None, start: Joints, ends: Joints) -> Joints:
        """Return ``ends`` with the extended joints moved by the distances of ``EX`` or to the positions of ``EXA``.

        The distances are relative to ``start``. If ``extra`` is ``None``, return ``ends`` unchanged.

        Raises:
            CallError: E_INVALIDARG if the arm does not have one of the extended joints.
        """
        if extra is None:
            return ends
        joints = list(ends)
        for number, value in extra.joints:
            if not self.model.robot_axes < number <= len(joints):
                raise error_for(
                    hresult.E_INVALIDARG,
                    tr("{name} has no extended joint {number}", name=self.model.name, number=number),
                )  # fmt: skip
            joints[number - 1] = value if extra.absolute else start[number - 1] + value
        return tuple(joints)

    def frame_in_base(self, kind: str, values: Sequence[float], work: int = -1, tool: int = -1) -> Matrix:
        """Convert P or T values in a work frame to a frame in the base frame.

        Work -1 is the current one, :data:`NO_FRAME` none. If the tool is fixed (attribute of the work), the values are
        the pose of the fixed tool in the frame that the arm holds. RX and RY of a P have no influence if the arm is a
        SCARA: they are those of tool number ``tool``, -1 for the current one.

        Raises:
            CallError: TARGET_OUT_OF_RANGE if the position is beyond the reach of any arm; E_INVALIDARG if the vectors
                of a T are not valid.
        """
        check_reach(*values[:3])
        if kind == "P" and self.model.is_scara:
            values = self._upright(values, work, tool)
        make = frames.matrix_of_position if kind == "P" else frames.matrix_of_trans
        frame = np.asarray(make(values[: _FIGURE_AT[kind]]))
        if work == NO_FRAME:
            return frame
        if self.works.attribute(work) == FIXED_TOOL:
            return np.asarray(self.works.matrix(work) @ frames.inverse_of(frame))
        return np.asarray(self.works.matrix(work) @ frame)

    def _upright(self, values: Sequence[float], work: int, tool: int) -> Sequence[float]:
        """Return a P with RX and RY of the tool in a work frame; unchanged if the work frame is tilted or its tool fixed."""
        held = self.tools.matrix(tool)
        if work != NO_FRAME:
            if self.works.attribute(work) == FIXED_TOOL:
                return values
            frame = self.works.matrix(work)
            if abs(frame[2, 2]) < _VERTICAL:
                return values
            held = frames.inverse_of(frame) @ held
        rx, ry = frames.position_of_matrix(held)[3:5]
        return (*values[:3], float(rx), float(ry), *values[5:])


def check_reach(*lengths: float) -> None:
    """Raise an exception if a length (mm) is beyond the reach of any arm.

    Raises:
        CallError: TARGET_OUT_OF_RANGE.
    """
    for length in lengths:
        if not abs(length) <= _FARTHEST:
            raise error_for(
                hresult.TARGET_OUT_OF_RANGE,
                tr("{length:g} mm exceeds the reach of any arm", length=length),
            )


def figure_of(kind: str, values: Sequence[float]) -> int:
    """Return the figure of a P or T; -1 if it is not given.

    Raises:
        CallError: FIGURE_OUT_OF_RANGE if the figure is not valid.
    """
    at = _FIGURE_AT[kind]
    given = values[at] if len(values) > at else _FIGURE_AUTO
    figure = int(given)
    if figure != given or not (_FIGURE_LEAST <= figure < 0 or 0 <= figure & ~COBOTTA_BIT <= HIGHEST):
        raise error_for(
            hresult.FIGURE_OUT_OF_RANGE,
            tr("figure {given:g} is not valid; expected -3 to {highest}", given=given, highest=HIGHEST),
        )
    return figure
