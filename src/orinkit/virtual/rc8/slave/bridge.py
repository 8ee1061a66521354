"""From the present command to a set-point over several cycles, where a late server missed the set-points in between."""

from __future__ import annotations

from orinkit.arms import Model
from orinkit.virtual.rc8.motion.path import Joints


def gentlest(model: Model, before: Joints, now: Joints, goal: Joints, most: int) -> list[Joints]:
    """Return the commands to a set-point: those of the cycles that a punctual controller would have needed on the way.

    With the present velocity ``v``, the k-th of n commands is ``q + v k T + a (k T)^2 / 2``; ``a`` is such that the n-th is
    the set-point. How many set-points are missing nobody knows: n is the number that needs the least acceleration. It is
    1 where the client goes on from where it was, and as many as there is time where it went on meanwhile.

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

    count = min(range(1, most + 1), key=peak)
    curve = bend(count)
    return [
        *(
            tuple([b + way * k + each * k * k / 2.0 for b, way, each in zip(now, ways, curve, strict=True)])
            for k in range(1, count)
        ),
        goal,
    ]
