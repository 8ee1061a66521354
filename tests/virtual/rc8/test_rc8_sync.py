"""Cooperative control: SyncTimeStart to SyncTimeEnd, and SyncMoveStart to SyncMoveEnd."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.cell import Cell
from support.codes import code_of
from support.two_arms import FAR, HOME, TwoArms

STILL = 1e-6  # mm, or the sine of an angle: the largest change of the grasp


@pytest.fixture
def cell() -> Iterator[TwoArms]:
    made = TwoArms().take()
    yield made
    made.close()


def collect(cell: TwoArms) -> None:
    """Collect a motion of each robot."""
    cell.of(0, "SyncTimeStart")
    for robot in (0, 1):
        assert cell.move_of(robot, 1, FAR[robot]) is None


def carry(cell: TwoArms, *vectors: str) -> None:
    """Collect lines of the first robot, which the second one follows."""
    cell.of(0, "SyncMoveStart", [1])
    for vector in vectors or ("V(40, 120, -60)",):
        assert cell.begin(0, "Draw", [2, vector]) is None


def grasp_error(cell: TwoArms, grasp: object) -> float:
    """Return the largest change of the grasp in all cycles."""
    return max(
        float(np.abs(np.linalg.inv(cell.tool(0, first)) @ cell.tool(1, second) - grasp).max())
        for first, second in zip(*cell.traces, strict=True)
    )


# --- SyncTime ---------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.99 SyncTimeStart", "5.2.28.100 SyncTimeEnd")
def test_the_motions_begin_in_the_same_cycle(cell):
    collect(cell)
    cell.cycle(50)
    assert cell.moved == [False, False]
    done = cell.begin(0, "SyncTimeEnd", 0)
    assert cell.moved == [False, False]
    cell.cycle()
    assert cell.moved == [True, True]
    cell.until_done(done)
    assert [arm.queue.joints for arm in cell.arms] == [(120, 20, 110, 40, 30, 90), (-60, 30, 100, 20, 40, 30)]
    cell.check_limits()


@pytest.mark.guide("5.2.28.100 SyncTimeEnd")
@pytest.mark.parametrize("option", [0, 1])
def test_the_end_waits_for_all_motions_unless_next(cell, option):
    collect(cell)
    done = cell.begin(1, "SyncTimeEnd", option)
    if option == 1:
        assert done is None
        assert all(arm.busy for arm in cell.arms)
        return
    waited = 0
    while not done.done():
        assert any(arm.busy for arm in cell.arms) or not all(arm.servo.settled for arm in cell.arms) or waited == 0
        cell.cycle()
        waited += 1
    assert not any(arm.busy for arm in cell.arms)
    assert code_of(lambda: cell.begin(0, "SyncTimeEnd", 2)) == hresult.VALUE_OUT_OF_RANGE


def test_after_next_the_motor_is_switched_off_at_the_end_of_the_motions(cell):
    """As after a motion with NEXT: no call waits for the motions."""
    collect(cell)
    assert cell.begin(0, "SyncTimeEnd", 1) is None
    cell.cycle(3)
    off = cell.begin(0, "Motor", [0, 0])
    cell.until_done(off)
    assert [arm.motor.on for arm in cell.arms] == [False, True]
    assert cell.arms[0].queue.joints == (120, 20, 110, 40, 30, 90)


def test_several_motions_of_one_robot_follow_each_other(cell):
    cell.of(1, "SyncTimeStart")
    cell.begin(0, "Draw", [2, "@P V(0, 60, 0)"])
    cell.begin(0, "Draw", [2, "V(0, 0, 60)"])
    cell.begin(1, "DriveEx", ["(1, 10)"])
    start = cell.tool(0)[:3, 3]
    cell.until_done(cell.begin(1, "SyncTimeEnd"))
    assert cell.tool(0)[:3, 3] - start == pytest.approx([0, 60, 60], abs=1e-2)
    assert cell.arms[1].queue.joints[0] == pytest.approx(10)
    cell.check_limits()


def test_a_block_without_motions_ends_at_once(cell):
    cell.of(0, "SyncTimeStart")
    assert cell.begin(0, "SyncTimeEnd") is None
    assert cell.moved == [False, False]


def test_motions_of_other_clients_are_not_collected(cell):
    cell.of(1, "GiveArm")
    other = cell.connect().get_robot("", "ID=1")
    other.execute("TakeArm", variant([0, 0]))
    cell.of(0, "SyncTimeStart")
    moving = other.move(1, variant(FAR[1]), "")
    cell.move_of(0, 1, FAR[0])
    cell.cycle(5)
    assert cell.moved == [False, True]
    cell.until_done(moving)


@pytest.mark.parametrize("block", ["SyncTime", "SyncMove"])
def test_nothing_moves_if_a_motion_of_the_block_was_refused(cell, block):
    (collect if block == "SyncTime" else carry)(cell)
    assert code_of(lambda: cell.move_of(0, 2, "P(5000, 0, 0, 0, 0, 0)"))
    cell.begin(0, "Draw", [2, "V(0, 5, 0)"])
    with pytest.raises(CallError, match="refused") as caught:
        cell.begin(0, f"{block}End")
    assert caught.value.code == hresult.E_FAIL
    cell.cycle(50)
    assert cell.moved == [False, False]


# --- what makes the collected motions invalid -------------------------------------------------------------------------


def _off_and_on(cell: TwoArms) -> None:
    cell.of(1, "Motor", [0, 0])
    cell.of(1, "Motor", [1, 0])


def _give_and_take(cell: TwoArms) -> None:
    cell.of(1, "GiveArm")
    cell.of(1, "TakeArm", [0, 1])


def _emergency(cell: TwoArms) -> None:
    cell.rc8.pendant.emergency_stop()
    cell.rc8.pendant.emergency_stop(False)
    for robot in (0, 1):
        cell.of(robot, "Motor", [1, 0])


def _mode(cell: TwoArms) -> None:
    cell.rc8.pendant.mode(1)
    cell.rc8.pendant.mode(3)
    for robot in (0, 1):
        cell.of(robot, "Motor", [1, 0])


def _error(cell: TwoArms) -> None:
    cell.rc8.pendant.raise_error(0x82204999)
    cell.rc8.pendant.clear_errors()


INTERRUPTIONS: dict[str, Callable[[TwoArms], None]] = {
    "halt": lambda cell: cell.run(cell.robots[1].halt("")),
    "halt of another client": lambda cell: cell.run(cell.connect().get_robot("", "ID=1").halt("")),
    "skip": lambda cell: cell.arms[1].stop(0),
    "motor": _off_and_on,
    "semaphore": _give_and_take,
    "emergency stop": _emergency,
    "mode": _mode,
    "error": _error,
    "moved": lambda cell: cell.arms[1].place((1.0, *HOME[1:])),
}


@pytest.mark.parametrize("block", ["SyncTime", "SyncMove"])
@pytest.mark.parametrize("cause", INTERRUPTIONS)
def test_nothing_moves_after_an_interruption(cell, cause, block):
    (collect if block == "SyncTime" else carry)(cell)
    INTERRUPTIONS[cause](cell)
    before = [arm.queue.joints for arm in cell.arms]
    assert cell.code_of(lambda: cell.begin(0, f"{block}End")) == hresult.STOPPED_DURING_PC_MOTION
    cell.cycle(20)
    assert [arm.queue.joints for arm in cell.arms] == before
    assert cell.code_of(lambda: cell.begin(0, f"{block}End")) == hresult.E_FAIL  # the block is over
    cell.of(0, f"{block}Start", [1] if block == "SyncMove" else None)


@pytest.mark.parametrize("block", ["SyncTime", "SyncMove"])
@pytest.mark.parametrize(
    ("state", "code"),
    [
        (lambda cell: cell.rc8.pendant.emergency_stop(), hresult.EMERGENCY_STOP_ON),
        (lambda cell: cell.of(1, "Motor", [0, 0]), hresult.MOTOR_NOT_ON),
        (lambda cell: cell.of(1, "GiveArm"), hresult.ARM_NOT_TAKEN),
        (lambda cell: cell.robots[1].hold(""), hresult.ROBOT_PAUSED),
        (lambda cell: cell.rc8.pendant.token("tp"), hresult.START_RIGHT_NOT_ETHERNET),
    ],
)
def test_the_conditions_of_a_motion_apply_to_both_arms_at_the_end(cell, state, code, block):
    (collect if block == "SyncTime" else carry)(cell)
    state(cell)
    assert cell.code_of(lambda: cell.begin(0, f"{block}End")) == code
    cell.cycle(20)
    assert cell.moved == [False, False]


@pytest.mark.parametrize("how", ["release", "silent"])
@pytest.mark.parametrize("block", ["SyncTime", "SyncMove"])
def test_a_lost_client_moves_nothing(cell, how, block):
    (collect if block == "SyncTime" else carry)(cell)
    if how == "release":
        for robot in cell.robots:
            robot.release()
        cell.controller.release()
    else:
        cell.controller.stop_moving()
        assert cell.code_of(lambda: cell.begin(0, f"{block}End")) == hresult.E_FAIL
    cell.cycle(100)
    assert cell.moved == [False, False]


def test_a_defect_at_the_start_moves_neither_arm(cell):
    collect(cell)
    cell.arms[1].enqueue = None  # type: ignore[method-assign]  # replaced by the test
    with pytest.raises(TypeError):
        cell.begin(0, "SyncTimeEnd")
    cell.cycle(20)
    assert cell.moved == [False, False]


# --- SyncMove ---------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.101 SyncMoveStart", "5.2.28.102 SyncMoveEnd")
@pytest.mark.parametrize("leader", [0, 1])
def test_the_followers_keep_the_pose_of_their_tools(cell, leader):
    cell.of(leader, "SyncMoveStart", [1 - leader])
    cell.begin(leader, "Draw", [2, "V(40, 120, -60)"])
    assert cell.move_of(leader, 3, "P(330, 20, 380, 180, 0, 170), P(330, -60, 300, 180, 0, 180)") is None
    before = cell.grasp
    cell.cycle(30)
    assert cell.moved == [False, False]
    done = cell.begin(leader, "SyncMoveEnd", 0)
    cell.cycle()
    assert cell.moved == [True, True]
    cell.until_done(done)
    assert grasp_error(cell, before) < STILL
    cell.check_limits()


@pytest.mark.guide("5.2.28.102 SyncMoveEnd")
def test_next_returns_before_the_end_of_the_cooperative_motion(cell):
    carry(cell)
    assert cell.begin(0, "SyncMoveEnd", 1) is None
    for robot in (0, 1):
        assert cell.code_of(lambda robot=robot: cell.move_of(robot, 1, FAR[robot], "NEXT")) == hresult.ROBOT_MOVING
    cell.cycle(400)
    assert not any(arm.busy for arm in cell.arms)
    cell.until_done(cell.move_of(1, 1, FAR[1]))  # afterwards each arm moves alone
    cell.until_done(cell.move_of(0, 1, FAR[0]))


def test_a_slower_follower_slows_the_leader_down(cell):
    """The follower turns about its own base, far from the axis of the leader's rotation."""
    alone = Cell().take()
    cycles = alone.cycles(alone.robot.execute("RotateH", variant([20.0])))
    alone.close()
    cell.of(0, "SyncMoveStart", [1])
    cell.begin(0, "RotateH", [20.0])
    before, done = cell.grasp, cell.begin(0, "SyncMoveEnd")
    cell.until_done(done)
    assert len(cell.traces[0]) > cycles * 1.1
    assert grasp_error(cell, before) < STILL
    cell.check_limits()


def test_a_follower_that_cannot_follow_refuses_the_motion(cell):
    cell.of(0, "SyncMoveStart", [1])
    code = cell.code_of(lambda: cell.begin(0, "RotateH", [-170.0]))
    assert code in (hresult.TARGET_OUT_OF_RANGE, hresult.OUT_OF_WORKING_RANGE, hresult.SINGULAR_POINT_REFUSED)
    cell.cycle(20)
    assert cell.moved == [False, False]


@pytest.mark.parametrize(
    "motion",
    [
        lambda cell: cell.move_of(0, 1, FAR[0]),
        lambda cell: cell.begin(0, "DriveEx", ["(1, 5)"]),
        lambda cell: cell.begin(0, "Draw", [1, "V(0, 10, 0)"]),
        lambda cell: cell.robots[0].go_home(),
    ],
)
def test_ptp_is_refused(cell, motion):
    cell.of(0, "SyncMoveStart", [1])
    assert cell.code_of(lambda: motion(cell)) == hresult.INTERPOLATION_NOT_SUPPORTED
    cell.cycle(20)
    assert cell.moved == [False, False]


def test_a_follower_cannot_be_commanded(cell):
    cell.of(0, "SyncMoveStart", [1])
    assert cell.code_of(lambda: cell.begin(1, "Draw", [2, "V(0, 10, 0)"])) == hresult.E_FAIL


STOPS: dict[str, Callable[[TwoArms], object]] = {
    "halt of the leader": lambda cell: cell.robots[0].halt(""),
    "halt of the follower": lambda cell: cell.robots[1].halt(""),
    "skip": lambda cell: cell.begin(1, "MotionSkip", [-1, 0]),
    "skip as set": lambda cell: cell.begin(0, "MotionSkip", [-1, 2]),
    "the client is lost": lambda cell: cell.controller.release(),
    "the objects of the follower are released": lambda cell: cell.robots[1].release(),
    "emergency stop": lambda cell: cell.rc8.pendant.emergency_stop(),
}


@pytest.mark.parametrize("after", [2, 11, 30])
@pytest.mark.parametrize("cause", STOPS)
def test_a_stop_of_one_arm_stops_both_on_their_paths(cell, cause, after):
    carry(cell, "V(20, 60, -30)", "V(20, 60, -30)")
    before, done = cell.grasp, cell.begin(0, "SyncMoveEnd")
    cell.cycle(after)
    STOPS[cause](cell)
    cell.cycle(150)
    assert done.done()
    assert bool(code_of(done.result)) is ("skip" not in cause)
    ends = [next(n for n, joints in enumerate(trace) if joints == trace[-1]) for trace in cell.traces]
    assert ends[0] == ends[1]  # in the same cycle
    assert 0 < np.linalg.norm(cell.tool(0)[:3, 3] - cell.tool(0, cell.traces[0][0])[:3, 3]) < 139
    assert grasp_error(cell, before) < STILL
    cell.check_limits()
    assert not any(arm.companions or arm.queue.coupling for arm in cell.arms)


@pytest.mark.parametrize("robot", [0, 1])
def test_a_pause_of_one_arm_pauses_both_on_their_paths(cell, robot):
    carry(cell)
    before, done = cell.grasp, cell.begin(0, "SyncMoveEnd")
    cell.cycle(15)
    cell.until_done(cell.robots[robot].hold(""))
    held = [arm.queue.joints for arm in cell.arms]
    cell.cycle(50)
    assert [arm.queue.joints for arm in cell.arms] == held
    assert all(arm.held for arm in cell.arms)
    cell.robots[1 - robot].unhold("")
    cell.until_done(done)
    assert grasp_error(cell, before) < STILL
    cell.check_limits()


def test_a_stop_during_a_pause_drops_both_motions(cell):
    carry(cell)
    done = cell.begin(0, "SyncMoveEnd")
    cell.cycle(15)
    cell.until_done(cell.robots[0].hold(""))
    cell.robots[1].halt("")
    cell.cycle(2)
    assert code_of(done.result) == hresult.STOPPED_DURING_PC_MOTION
    assert not any(arm.busy or arm.held for arm in cell.arms)
    cell.cycle(50)
    cell.check_limits()


def test_a_fault_of_the_follower_stops_both(cell):
    carry(cell)
    done = cell.begin(0, "SyncMoveEnd")
    cell.cycle(15)
    cell.arms[1]._fault(0x81204999, "a level that stops nothing by itself")
    cell.cycle(2)
    assert not done.done()
    cell.arms[1].stop_and_power_off(0x84204999)
    cell.cycle(150)
    assert code_of(done.result) == 0x84204999
    assert [arm.motor.on for arm in cell.arms] == [True, False]
    cell.check_limits()


def test_the_frames_of_the_bases_determine_the_path_of_the_follower(cell):
    """Both arms face each other: what is left for one is right for the other."""
    carry(cell, "V(0, 80, 0)")
    starts = [arm.space.kinematics.forward(arm.queue.joints)[:3, 3] for arm in cell.arms]
    cell.until_done(cell.begin(0, "SyncMoveEnd"))
    ends = [arm.space.kinematics.forward(arm.queue.joints)[:3, 3] for arm in cell.arms]
    assert ends[0] - starts[0] == pytest.approx([0, 80, 0], abs=1e-2)
    assert ends[1] - starts[1] == pytest.approx([0, -80, 0], abs=1e-2)


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.28.99 SyncTimeStart", "5.2.28.100 SyncTimeEnd")
@pytest.mark.guide("5.2.28.101 SyncMoveStart", "5.2.28.102 SyncMoveEnd")
@pytest.mark.parametrize("name", ["SyncTimeStart", "SyncTimeEnd", "SyncMoveStart", "SyncMoveEnd"])
def test_one_robot_has_no_cooperative_control(name):
    cell = Cell().take()
    with pytest.raises(CallError, match="second robot") as caught:
        cell.execute(name, [1])
    assert caught.value.code == hresult.E_NOTIMPL
    cell.close()


@pytest.mark.parametrize(
    "followers",
    [[0], [2], [-1], [1, 1], [1.5], [], None, "x"],
)
def test_followers_that_do_not_exist(cell, followers):
    assert cell.code_of(lambda: cell.begin(0, "SyncMoveStart", followers)) in (
        hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH,
    )  # fmt: skip
    assert cell.code_of(lambda: cell.begin(0, "SyncMoveEnd")) == hresult.E_FAIL


@pytest.mark.parametrize(
    "form",
    [
        Variant(VarType.I4, 1),
        Variant(VarType.I4 | ARRAY, [1]),
        variant([1]),
        variant([Variant(VarType.I4 | ARRAY, [1])]),
    ],
)
def test_forms_of_the_followers(cell, form):
    assert cell.run(cell.robots[0].execute("SyncMoveStart", form)) is None
    assert cell.begin(0, "SyncMoveEnd") is None


def test_starts_and_ends_must_match(cell):
    assert cell.code_of(lambda: cell.begin(0, "SyncTimeEnd")) == hresult.E_FAIL
    cell.of(0, "SyncTimeStart")
    for start in ("SyncTimeStart", "SyncMoveStart"):
        assert cell.code_of(lambda start=start: cell.begin(1, start, [0])) == hresult.E_FAIL
    assert cell.code_of(lambda: cell.begin(0, "SyncMoveEnd")) == hresult.E_FAIL
    cell.of(1, "SyncTimeEnd")


def test_the_arms_must_be_taken_and_at_standstill(cell):
    cell.of(1, "GiveArm")
    assert cell.code_of(lambda: cell.begin(1, "SyncTimeStart")) == hresult.ARM_NOT_TAKEN
    assert cell.code_of(lambda: cell.begin(0, "SyncMoveStart", [1])) == hresult.ARM_NOT_TAKEN
    cell.of(1, "TakeArm", [0, 1])
    cell.move_of(1, 1, FAR[1], "NEXT")
    assert cell.code_of(lambda: cell.begin(0, "SyncMoveStart", [1])) == hresult.ROBOT_MOVING
    cell.of(0, "SyncTimeStart")
    assert cell.code_of(lambda: cell.move_of(1, 1, FAR[1])) == hresult.ROBOT_MOVING


def test_a_block_has_room_for_as_many_motions_as_the_queue(cell):
    cell.of(0, "SyncTimeStart")
    for step in range(10):
        cell.begin(0, "DriveEx", [f"(1, {1 + step % 2})"])
    cell.until_done(cell.begin(0, "SyncTimeEnd"))
    cell.of(0, "SyncTimeStart")
    for _ in range(10):
        cell.begin(0, "DriveEx", ["(1, 1)"])
    assert cell.code_of(lambda: cell.begin(0, "DriveEx", ["(1, 1)"])) == hresult.ROBOT_MOVING


def test_motions_are_planned_in_the_thread_of_the_controller():
    """With the clock of the machine, the calls complete when the motions have been planned."""
    import orinkit
    from orinkit.virtual.clock import Clock
    from orinkit.virtual.rc8 import VirtualRC8

    rc8 = VirtualRC8(second_model="VS-060", second_joints=HOME, motor=True, clock=Clock(20.0))
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, timeout=60.0) as controller:
        first, second = controller.robot("Arm"), controller.robot("Arm", "ID=1")
        for robot in (first, second):
            robot.execute("TakeArm", [0, 0])
        second.execute("SetBaseDef", [0, "P(900, 0, 0, 0, 0, 180)"])
        first.execute("SyncMoveStart", [1])
        first.execute("Draw", [2, "V(0, 60, 0)"])
        first.execute("Draw", [2, "V(0, -30, 0)"])
        assert not rc8.state.robots.busy
        first.execute("SyncMoveEnd")
        ends = [robot.arm.space.tcp(robot.arm.queue.joints)[1, 3] for robot in rc8.state.robots]
        assert ends == pytest.approx([30, -30], abs=0.05)
    rc8.close()
