"""Command positions that lead to a set-point in several cycles, after the set-points before it were missed."""

from __future__ import annotations

from orinkit.arms import ArmModel
from orinkit.virtual.engine.motion.joint_path import Joints


def gentlest_path(model: ArmModel, before: Joints, now: Joints, goal: Joints, most: int) -> list[Joints]:
    """Return the command positions that lead to a set-point with the least acceleration, one for each cycle.

    With the present command position ``q``, the present velocity ``v`` and the period ``T``, the k-th of n command
    positions is ``q + v k T + a (k T)^2 / 2``. The acceleration ``a`` is chosen so that the n-th command position is
    the set-point.

    n is unknown, because the number of missed set-points is unknown. Therefore every n from 1 to ``most`` is tried. Of
    those whose command positions stay within the range of every axis, the n with the least acceleration is used. If the
    client has continued from the present command position, this is 1; if it has continued by the clock, it is ``most``.

    Args:
        model: The arm model, for the range and the acceleration limit of each axis.
        before: The command position one cycle ago, deg or mm.
        now: The present command position, q.
        goal: The set-point.
        most: The largest n, 1 or more.
    """
    velocities = [b - a for a, b in zip(before, now, strict=True)]

    def accelerations(count: int) -> list[float]:
        return [2.0 * (c - b - count * v) / count**2 for b, c, v in zip(now, goal, velocities, strict=True)]

    def peak(count: int) -> float:
        share = 0.5 if count == 1 else 1.0  # the velocity changes by a T / 2 in the first cycle, by a T later
        return share * max(abs(a) / axis.acceleration for a, axis in zip(accelerations(count), model.axes, strict=True))

    def commands(count: int) -> list[Joints]:
        per_axis = accelerations(count)
        return [
            *(
                tuple([b + v * k + a * k * k / 2.0 for b, v, a in zip(now, velocities, per_axis, strict=True)])
                for k in range(1, count)
            ),
            goal,
        ]

    for count in sorted(range(1, most + 1), key=peak):
        candidate = commands(count)
        if all(_within(model, now, each) for each in candidate[:-1]):
            return candidate
    raise AssertionError("one command is always possible")


def _within(model: ArmModel, now: Joints, joints: Joints) -> bool:
    """Return True if ``joints`` are in the range of each axis; an axis outside its range at ``now`` may move back."""
    return all(
        min(axis.lower, b) <= value <= max(axis.upper, b)
        for axis, b, value in zip(model.axes, now, joints, strict=True)
    )
