"""Converts a set-point to a joint position of the arm."""

from __future__ import annotations

from typing import Final

import numpy as np

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.rc8.slave_formats import PoseKind, SetPoint
from orinkit.values.poses import Extra
from orinkit.virtual.engine.motion.soft_limits import check_end
from orinkit.virtual.rc8.robot.target import FrameContext, Joints, figure_of

# The arm is already moving, so the code of a stop replaces the code of a refused motion.
_AS_STOP: Final = {hresult.TARGET_OUT_OF_RANGE: hresult.OUT_OF_WORKING_RANGE}


def joints_of(space: FrameContext, kind: PoseKind, point: SetPoint, start: Joints) -> Joints:
    """Return the joint position of a set-point, all axes.

    For a pose without figure, the solution closest to the start is used. Extended joints move only if the set-point has
    values for them.

    Args:
        space: The frames of the arm, with the current tool and work frame.
        kind: Pose type of the set-point.
        point: The set-point.
        start: Joint position of the previous set-point.

    Raises:
        CallError: E_INVALIDARG for a malformed set-point: the extended joint does not exist, or the vectors of a T are
            not valid. OUT_OF_WORKING_RANGE, SINGULAR_POINT_STOP, FIGURE_INVALID, FIGURE_OUT_OF_RANGE or
            TARGET_OVER_SOFT_LIMIT_AXISn if the arm cannot reach the pose.
    """
    count = space.model.robot_axes
    robot = point.pose[:count] if kind == "J" else _solved(space, kind, point.pose, start)
    extra = Extra(True, point.extra) if point.extra else None
    joints = space.with_extra(extra, start, (*robot, *start[count:]))
    check_end(space.model, joints)
    return joints


def _solved(space: FrameContext, kind: PoseKind, values: tuple[float, ...], start: Joints) -> Joints:
    figure = figure_of(kind, values)
    try:
        flange = space.frame_in_base(kind, values) @ frames.inverse_of(space.tools.matrix())
        if figure < 0:
            found = space.kinematics.follow(flange[None], start)[0]
        else:
            found = space.kinematics.inverse(flange, figure, np.asarray(start))
    except CallError as error:
        raise error_for(_AS_STOP.get(error.code, error.code), error.detail) from None
    if space.kinematics.is_singular(found):
        raise error_for(hresult.SINGULAR_POINT_STOP)
    return tuple([float(angle) for angle in found])
