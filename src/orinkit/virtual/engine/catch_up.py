"""From the present command to a set-point over several cycles, where set-points in between were missed."""

from __future__ import annotations

from orinkit.arms import ArmModel
from orinkit.virtual.engine.motion.joint_path import Joints


def gentlest(model: ArmModel, before: Joints, now: Joints, goal: Joints, most: int) -> list[Joints]:
    """Return the commands to a set-point: those of the cycles that a punctual controller would have needed on the way.

    With the present velocity ``v``, the k-th of n commands is ``q + v k T + a (k T)^2 / 2``; ``a`` is such that the n-th is
    the set-point. How many set-points are missing nobody knows: n is the number that needs the least acceleration, of those
    with which no command is beyond the range of an axis. It is 1 if the client goes on from where it was, and as many as
    there is time if it went on meanwhile.

    Args:
        model: of the arm, for its accelerations.
        before: the command one cycle ago, deg or mm.
        now: the present command, q.
        goal: the set-point.
        most: how many commands there is time for, 1 or more.
    """
    ways = [b - a for a, b in zip(before, now, strict=True)]

    def bend(count: int) -> list[float]:
        return [2.0 * (c - b - count * way) / count**2 for b, c, way in zip(now, goal, ways, strict=True)]

    def peak(count: int) -> float:
        part = 0.5 if count == 1 else 1.0  # the first of the commands has only half of it behind it
        return part * max(abs(each) / axis.acceleration for each, axis in zip(bend(count), model.axes, strict=True))

    def commands(count: int) -> list[Joints]:
        curve = bend(count)
        return [
            *(
                tuple([b + way * k + each * k * k / 2.0 for b, way, each in zip(now, ways, curve, strict=True)])
                for k in range(1, count)
            ),
            goal,
        ]

    for count in sorted(range(1, most + 1), key=peak):
        found = commands(count)
        if all(_within(model, now, each) for each in found[:-1]):
            return found
    raise AssertionError("one command is always possible")


def _within(model: ArmModel, now: Joints, joints: Joints) -> bool:
    """Whether joints are in the range of each axis; one that is beyond its range now may come back."""
    return all(
        min(axis.lower, b) <= value <= max(axis.upper, b)
        for axis, b, value in zip(model.axes, now, joints, strict=True)
    )
