"""Which arms may still move after the calls that a gateway has forwarded."""

from __future__ import annotations

from orinkit.cao import functions as f
from orinkit.gateway.moving_arms import MovingArms
from orinkit.values.variant import variant

FIRST, SECOND, AGAIN = 5, 6, 7
MOVE = (1, "J(1, 2, 3, 4, 5, 6)", "NEXT")


def two_robots() -> MovingArms:
    arms = MovingArms()
    for handle, option in ((FIRST, ""), (SECOND, "ID=1"), (AGAIN, "ID=0")):
        arms.connected(f.controller_get_robot, ("Arm", option), handle)
    return arms


def call(arms: MovingArms, function: object, handle: int, *arguments: object) -> None:
    arms.before(function, handle, arguments)  # type: ignore[arg-type]  # loosely typed by the table of the test
    arms.after(function, handle, arguments)  # type: ignore[arg-type]  # loosely typed by the table of the test


def test_a_halt_concerns_the_arm_of_its_robot() -> None:
    arms = two_robots()
    call(arms, f.robot_move, FIRST, *MOVE)
    call(arms, f.robot_move, SECOND, *MOVE)
    call(arms, f.robot_halt, SECOND, "")
    assert arms
    call(arms, f.robot_halt, AGAIN, "")  # another object of the first robot
    assert not arms


def test_the_end_of_a_block_begins_the_motions_of_all_arms() -> None:
    arms = two_robots()
    call(arms, f.robot_execute, FIRST, "SyncTimeEnd", variant(1))
    call(arms, f.robot_halt, FIRST, "")
    assert arms
    call(arms, f.robot_halt, SECOND, "")
    assert not arms


def test_an_end_that_waits_leaves_its_robot_at_standstill() -> None:
    arms = two_robots()
    call(arms, f.robot_move, FIRST, 1, "P1", "")
    call(arms, f.robot_execute, FIRST, "SyncTimeEnd", variant(0))
    assert not arms
    call(arms, f.robot_move, SECOND, *MOVE)  # not in the block
    call(arms, f.robot_execute, FIRST, "SyncTimeEnd", variant(0))
    assert arms


def test_a_call_without_a_reply_may_have_begun_a_motion() -> None:
    arms = two_robots()
    arms.before(f.robot_move, SECOND, (1, "J(1, 2, 3, 4, 5, 6)", ""))
    assert arms
    arms.clear()
    assert not arms
