"""The interface of planners, and the choice of the planner for a stream."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from orinkit.rc8.slave_formats import PoseKind
from orinkit.streaming.planning.limits import Limits, PathLimits


class Planner(Protocol):
    """Computes commands within the limits, from set-points or from a live target.

    A command is the joint position or the pose that is sent to the controller. A live target is a goal of the motion
    that the program may change at any time.

    Attributes:
        command: The last command.
        at_rest: True if the last two commands are equal, and the set-point or target is reached.
    """

    command: tuple[float, ...]
    at_rest: bool

    def goto(self, target: Sequence[float]) -> tuple[float, ...]:
        """Return the next command of a motion to a live target."""

    def track(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return the set-point if it is within the limits, otherwise a command that approaches it."""

    def check(self, point: Sequence[float]) -> None:
        """Check that :meth:`track` would return a set-point unchanged.

        Raises:
            InvalidValue: If the set-point violates a limit; the message names the limit.
        """

    def stop(self) -> tuple[float, ...]:
        """Return the next command of a stop; at standstill, return the last command."""


def planner_for(limits: Limits | PathLimits, period: float, start: Sequence[float], kind: PoseKind) -> Planner:
    """Return a planner for joint positions or for poses.

    Args:
        limits: :class:`Limits` of the axes, for joint positions; or :class:`PathLimits` of the tool, for poses.
        period: Period of a cycle, s.
        start: The pose at which the arm stands.
        kind: Pose type of the set-points.
    """
    if isinstance(limits, Limits):
        from orinkit.streaming.planning.joint_planner import JointPlanner  # only streaming requires ruckig

        return JointPlanner(limits, period, start)
    from orinkit.streaming.planning.pose_planner import PosePlanner

    assert kind != "J"
    return PosePlanner(limits, period, start, kind)
