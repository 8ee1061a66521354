"""The results of the calls with which clients move the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

from orinkit.cao.provider import Deferred
from orinkit.rc8.motion_options import MotionOptions
from orinkit.virtual.engine.motion.queue import Ticket
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.motion_planner import Plans

MotionResult: TypeAlias = Deferred[Any] | None
"""``None`` if the call completes immediately, otherwise a Deferred.

If the motions are planned in a thread, the Deferred is ``brief``. Its result is ``None`` for the option NEXT, otherwise
another Deferred, which resolves at the end of the motions.
"""


def begin_motions(caller: ClientContext, plans: Plans, options: MotionOptions) -> MotionResult:
    """Plan and queue the motions of a call; the call completes at their end, or immediately with the option NEXT.

    After SyncTimeStart or SyncMoveStart, the motions are only planned, and the call completes immediately.

    Raises:
        CallError: As for :meth:`~orinkit.virtual.rc8.robot.moves.Moves.begin`, or for :meth:`SyncBlock.add`.
    """
    robot, sync = caller.robot, caller.client.sync
    if sync is not None:
        return sync.add(robot, caller, plans)

    def completion(tickets: Sequence[Ticket]) -> MotionResult:
        return None if options.next else robot.arm.when_done(tickets[-1])

    return robot.moves.begin(plans, completion)


def switch_motor(caller: ClientContext, on: bool) -> Deferred[None]:
    """Begin to switch the motor on or off; return a Deferred that resolves when the motor is on or off."""
    arm = caller.robot.arm
    name = "Motor on" if on else "Motor off"
    require(name, arm, caller)
    return arm.switch_motor(on, caller, lambda: require(name, arm, caller))
