"""A set-point as joints of the arm."""

from __future__ import annotations

from typing import Final

import numpy as np

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.rc8.slave_formats import PoseKind, SetPoint
from orinkit.values.poses import Extra
from orinkit.virtual.engine.motion.soft_limits import check_end
from orinkit.virtual.rc8.robot.target import ROBOT_AXES, FrameContext, Joints, figure_of

# where the arm moves already it is no refusal
_AS_STOP: Final = {hresult.TARGET_OUT_OF_RANGE: hresult.OUT_OF_WORKING_RANGE}


def joints_of(space: FrameContext, kind: PoseKind, point: SetPoint, start: Joints) -> Joints:
    """Return where a set-point puts the arm, all axes.

    A pose without figure is held as near to the start as it can be. Extra axes move only where the set-point names them.

    Args:
        space: the arm's frames; tool and work in use count.
        kind: of its pose.
        point: the set-point.
        start: joints of the one before.

    Raises:
        CallError: E_INVALIDARG, no such extra axis, the vectors of a T are none: the set-point is malformed.
            OUT_OF_WORKING_RANGE, SINGULAR_POINT_STOP, FIGURE_INVALID, FIGURE_OUT_OF_RANGE, TARGET_OVER_SOFT_LIMIT_AXISn:
            the arm cannot be there.
    """
    robot = point.pose[:ROBOT_AXES] if kind == "J" else _solved(space, kind, point.pose, start)
    extra = Extra(True, point.extra) if point.extra else None
    joints = space.with_extra(extra, start, (*robot, *start[ROBOT_AXES:]))
    check_end(space.model, joints)
    return joints


def _solved(space: FrameContext, kind: PoseKind, values: tuple[float, ...], start: Joints) -> Joints:
    figure = figure_of(kind, values)
    try:
        flange = space.pose(kind, values) @ frames.inverse_of(space.tools.matrix())
        if figure < 0:
            found = space.kinematics.follow(flange[None], start)[0]
        else:
            found = space.kinematics.inverse(flange, figure, np.asarray(start))
    except CallError as error:
        raise error_for(_AS_STOP.get(error.code, error.code), error.detail) from None
    if space.kinematics.is_singular(found):
        raise error_for(hresult.SINGULAR_POINT_STOP)
    return tuple([float(angle) for angle in found])
