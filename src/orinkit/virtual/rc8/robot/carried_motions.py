"""The motions of the followers of a cooperative motion (SyncMoveStart)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import AT_COMMAND
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.engine.motion.cartesian_path import measured
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.profile import Array
from orinkit.virtual.rc8.robot.target import FrameContext, Joints

_PARTS = 1024  # in which the path of a follower is measured
_OVERLAPPING = ("P", "n")


@dataclass(slots=True)
class FollowingArm:
    """An arm that follows.

    Attributes:
        space: Its frames and kinematics; base frame 0 is its place in the world.
        joints: Its joint position at the start of the next motion.
    """

    space: FrameContext
    joints: Joints


class Carrier:
    """The leader of a cooperative motion.

    Args:
        space: Its frames and kinematics; base frame 0 is its place in the world.
    """

    def __init__(self, space: FrameContext) -> None:
        self._space = space

    def carry(self, motion: Motion, followers: Sequence[FollowingArm]) -> list[Motion]:
        """Return the motion of the leader and those of the followers, all with the same progress over time.

        The joint positions of the followers become those at the end. The next motion of an arm never begins before the
        end of the present one, because the paths of the arms would then differ.

        Raises:
            CallError: INTERPOLATION_NOT_SUPPORTED for a PTP motion; errors of planning of a follower.
        """
        if motion.length is None:
            raise error_for(
                hresult.INTERPOLATION_NOT_SUPPORTED,
                tr("a cooperative motion cannot be PTP. Try: a line, an arc or a free curve"),
            )
        carried = [self._carried(motion, follower) for follower in followers]
        duration = max(each.duration for each in (motion, *carried))
        profile = motion.profile.stretched(duration)
        mark = AT_COMMAND if motion.mark.mode in _OVERLAPPING else motion.mark
        for follower, each in zip(followers, carried, strict=True):
            follower.joints = each.end
        return [Motion(each.path, profile, each.rates, mark, each.length) for each in (motion, *carried)]

    def _carried(self, motion: Motion, follower: FollowingArm) -> Motion:
        space, start = self._space, follower.joints
        between = frames.inverse_of(follower.space.bases.matrix(0)) @ space.bases.matrix(0)
        grasp = frames.inverse_of(between @ space.tcp(motion.start)) @ follower.space.tcp(start)
        tool = space.tools.matrix()

        def poses(u: Array) -> Array:
            return np.asarray(between @ space.kinematics.forward(motion.path.sampled(u)[0]) @ tool @ grasp)

        course = measured(poses, _PARTS)
        return planner.plan_carried(follower.space.kinematics, start, course, follower.space.tools.matrix(), motion)
