"""What every planner of a stream can do, and which one a stream has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from orinkit.rc8.slave_formats import PoseKind
from orinkit.streaming.planning.limits import Limits, PathLimits


class Planner(Protocol):
    """Makes commands that are within the limits, whatever is wanted."""

    command: tuple[float, ...]
    at_rest: bool

    def goto(self, target: Sequence[float]) -> tuple[float, ...]:
        """Go towards a live target."""

    def track(self, point: Sequence[float]) -> tuple[float, ...]:
        """Pass a set-point through, or approach it."""

    def check(self, point: Sequence[float]) -> None:
        """Check that a set-point would be passed through.

        Raises:
            InvalidValue: it would not; what it breaks.
        """

    def stop(self) -> tuple[float, ...]:
        """Come to rest, and stay there."""


def planner_for(limits: Limits | PathLimits, period: float, start: Sequence[float], kind: PoseKind) -> Planner:
    """Return the planner of joints, or that of positions.

    Args:
        limits: of the arm, or of the tool.
        period: seconds of a cycle.
        start: where the arm stands.
        kind: what the set-points are.
    """
    if isinstance(limits, Limits):
        from orinkit.streaming.planning.joint_planner import JointPlanner  # ruckig is needed for streaming only

        return JointPlanner(limits, period, start)
    from orinkit.streaming.planning.pose_planner import PosePlanner

    assert kind != "J"
    return PosePlanner(limits, period, start, kind)
