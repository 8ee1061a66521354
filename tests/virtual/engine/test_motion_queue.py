from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.poses import PassMark
from orinkit.virtual.engine.motion.planner import Motion, Rates, plan_arc, plan_line, plan_ptp
from orinkit.virtual.engine.motion.queue import CYCLE, ROOM, MotionQueue, QueueState, TicketState

VS050 = load_model("VS-050")
ARM = Kinematics(VS050)
COBOTTA = Kinematics(load_model("COBOTTA"))
TOOL = np.array([[1.0, 0, 0, 10], [0, 1, 0, 0], [0, 0, 1, 80], [0, 0, 0, 1]])
HOME = (0.0, 20.0, 100.0, 0.0, 60.0, 0.0)
AT, PASS = PassMark("0"), PassMark("P")
PATIENCE = 5000  # cycles, 40 s


class Recorder:
    """Steps a queue and keeps every command, from rest to rest."""

    def __init__(self, queue: MotionQueue, kinematics: Kinematics = ARM) -> None:
        self.queue = queue
        self.kinematics = kinematics
        self.commands = [queue.joints] * 3

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.queue.step()
            self.commands.append(self.queue.joints)

    def until(self, *states: QueueState) -> int:
        """Step until the queue is in one of the states; return the number of cycles."""
        for cycles in range(PATIENCE):
            if self.queue.state in states:
                return cycles
            self.step()
        raise AssertionError(f"still {self.queue.state} after {PATIENCE} cycles")

    @property
    def joints(self) -> np.ndarray:
        return np.array(self.commands)

    @property
    def tips(self) -> np.ndarray:
        return (self.kinematics.forward(self.joints) @ TOOL)[:, :3, 3]

    def check_limits(self, speed: float = 1.0, accel: float = 1.0) -> None:
        axes = self.kinematics.model.axes
        joints = np.concatenate((self.joints, self.joints[-1:], self.joints[-1:]))
        velocity = np.diff(joints, axis=0) / CYCLE
        acceleration = np.diff(velocity, axis=0) / CYCLE
        assert np.all(np.abs(velocity).max(0) <= np.array([axis.velocity for axis in axes]) * speed * (1 + 1e-6))
        assert np.all(
            np.abs(acceleration).max(0) <= np.array([axis.acceleration for axis in axes]) * accel * (1 + 1e-6)
        )


def recorder(joints=HOME, kinematics: Kinematics = ARM) -> Recorder:
    return Recorder(MotionQueue(kinematics.model, joints), kinematics)


def ptp(queue: MotionQueue, end, rates=Rates(), mark=AT) -> Motion:  # noqa: B008 - it is frozen
    return plan_ptp(ARM, queue.end_joints, end, rates, mark, TOOL)


def line(queue: MotionQueue, way, rates=Rates(), mark=AT) -> Motion:  # noqa: B008 - frozen
    frame = ARM.forward(np.array(queue.end_joints)) @ TOOL
    frame[:3, 3] += way
    return plan_line(ARM, queue.end_joints, frame, TOOL, rates, mark)


def some_joints(dice: random.Random, model=VS050) -> tuple[float, ...]:
    return tuple(dice.uniform(axis.lower, axis.upper) for axis in model.axes)


def some_rates(dice: random.Random) -> Rates:
    if dice.random() < 0.4:
        return Rates()
    return Rates(dice.uniform(0.05, 1), dice.uniform(0.05, 1), dice.uniform(0.05, 1))


def some_mark(dice: random.Random) -> PassMark:
    return dice.choice([AT, PassMark("E"), PASS, PASS, PassMark("n", dice.uniform(0.1, 200))])


def some_motion(queue: MotionQueue, dice: random.Random) -> Motion:
    """Return a PTP motion, or a short line or arc if it is possible."""
    rates, mark, start = some_rates(dice), some_mark(dice), queue.end_joints
    near = [
        min(max(angle + dice.gauss(0, 15), axis.lower), axis.upper)
        for angle, axis in zip(start, VS050.axes, strict=True)
    ]
    kind = dice.random()
    try:
        if kind < 0.3:
            return plan_line(ARM, start, ARM.forward(np.array(near)) @ TOOL, TOOL, rates, mark)
        if kind < 0.5:
            frame = ARM.forward(np.array(start)) @ TOOL
            via, end = frame.copy(), frame.copy()
            via[:3, 3] += [dice.uniform(5, 60), dice.uniform(-60, 60), 0]
            end[:3, 3] += [dice.uniform(-60, 60), dice.uniform(5, 60), dice.uniform(-60, 60)]
            return plan_arc(ARM, start, via, end, TOOL, rates, mark)
    except CallError:
        pass
    return plan_ptp(ARM, start, near if dice.random() < 0.6 else some_joints(dice), rates, mark, TOOL)


# --- one motion ---------------------------------------------------------------------------------------------------


def test_a_motion_takes_its_time_and_ends_exactly():
    run = recorder()
    motion = ptp(run.queue, (30, 40, 80, -50, 20, 123.456))
    ticket = run.queue.add(motion)
    assert (run.queue.state, ticket.state) == (QueueState.MOVING, TicketState.RUNNING)
    cycles = run.until(QueueState.IDLE)
    assert motion.duration <= cycles * CYCLE < motion.duration + CYCLE
    assert run.queue.joints == (30, 40, 80, -50, 20, 123.456)
    planned = np.array([motion.joints_at(n * CYCLE) for n in range(1, cycles + 1)])
    assert run.joints[3:] == pytest.approx(planned, abs=1e-9)
    assert (ticket.state, ticket.progress) == (TicketState.DONE, 1.0)
    run.check_limits()


def test_a_motion_to_where_the_arm_is_takes_a_cycle():
    run = recorder()
    ticket = run.queue.add(ptp(run.queue, HOME))
    run.step()
    assert (ticket.state, run.queue.state, run.queue.joints) == (TicketState.DONE, QueueState.IDLE, HOME)


def test_progress_target_and_speed():
    run = recorder()
    ticket = run.queue.add(ptp(run.queue, (90, *HOME[1:])))
    assert (ticket.progress, run.queue.target, run.queue.moving) == (0, (90, *HOME[1:]), True)
    progress = [ticket.progress]
    while run.queue.moving:
        run.step()
        velocity, acceleration = run.queue.velocity_and_acceleration()
        a, b, c = run.commands[-3:]
        assert velocity[0] == pytest.approx((c[0] - b[0]) / CYCLE)
        assert acceleration[0] == pytest.approx((c[0] - 2 * b[0] + a[0]) / CYCLE**2, abs=1e-6)
        assert velocity[1:] == acceleration[1:] == (0,) * 5
        progress.append(ticket.progress)
    assert progress == sorted(progress)
    assert progress[-1] == 1
    run.step(2)
    assert run.queue.velocity_and_acceleration() == ((0,) * 6, (0,) * 6)
    assert (run.queue.target, run.queue.moving) == (run.queue.joints, False)


def test_callbacks_see_the_queue_in_order():
    run = recorder()
    seen = []

    def note(ticket):
        seen.append((names[ticket], ticket.state, run.queue.state, run.queue.full))
        if names[ticket] == "second" and ticket.state is TicketState.DONE:
            run.queue.add(ptp(run.queue, HOME)).on_change = lambda ticket: seen.append(("third", ticket.state))

    names = {
        run.queue.add(ptp(run.queue, (10, *HOME[1:]), mark=PASS)): "first",
        run.queue.add(ptp(run.queue, (20, *HOME[1:]))): "second",
    }
    for ticket in names:
        ticket.on_change = note
    run.until(QueueState.IDLE)
    assert seen == [
        ("first", TicketState.RUNNING, QueueState.MOVING, False),
        ("first", TicketState.PASSED, QueueState.MOVING, False),
        ("second", TicketState.RUNNING, QueueState.MOVING, False),
        ("first", TicketState.DONE, QueueState.MOVING, False),
        ("second", TicketState.DONE, QueueState.IDLE, False),
        ("third", TicketState.RUNNING),
        ("third", TicketState.DONE),
    ]
    assert run.queue.joints == HOME


# --- the queue ----------------------------------------------------------------------------------------------------


def test_there_is_room_for_ten():
    run = recorder()
    tickets = []
    while not run.queue.full:
        tickets.append(run.queue.add(ptp(run.queue, (float(len(tickets)), *HOME[1:]))))
    assert len(tickets) == ROOM == 10
    with pytest.raises(ValueError, match="full"):
        run.queue.add(ptp(run.queue, HOME))
    while run.queue.full:
        run.step()
    run.queue.add(ptp(run.queue, HOME))
    run.until(QueueState.IDLE)
    assert all(ticket.state is TicketState.DONE for ticket in tickets)
    assert run.queue.joints == HOME
    run.check_limits()


def test_a_motion_starts_where_the_one_before_it_ends():
    run = recorder()
    run.queue.add(ptp(run.queue, (10, *HOME[1:])))
    with pytest.raises(ValueError, match="must start at"):
        run.queue.add(plan_ptp(ARM, HOME, HOME, Rates()))
    assert run.queue.end_joints == (10, *HOME[1:])


def test_every_target_without_passing_is_reached():
    run = recorder()
    targets = [(10.0, *HOME[1:]), (10.0, 30.0, *HOME[2:]), HOME]
    for target in targets:
        run.queue.add(ptp(run.queue, target, mark=PassMark("E") if target is HOME else AT))
    run.until(QueueState.IDLE)
    assert [target in run.commands for target in targets] == [True] * 3
    run.check_limits()


def test_the_command_can_be_placed_only_at_rest():
    run = recorder()
    run.queue.place((1, 2, 3, 4, 5, 6))
    assert (run.queue.joints, run.queue.end_joints) == ((1, 2, 3, 4, 5, 6),) * 2
    assert run.queue.velocity_and_acceleration() == ((0,) * 6, (0,) * 6)
    with pytest.raises(ValueError, match="6 axes"):
        run.queue.place((1, 2, 3))
    run.queue.add(ptp(run.queue, HOME))
    with pytest.raises(ValueError, match="motions"):
        run.queue.place(HOME)


@pytest.mark.parametrize("cycle", [0, -1, math.nan, math.inf])
def test_an_invalid_cycle(cycle):
    with pytest.raises(ValueError, match="cycle"):
        MotionQueue(VS050, HOME, cycle)


def test_the_same_motions_are_the_same_sample_by_sample():
    runs = []
    for _ in range(2):
        dice = random.Random(11)
        run = recorder()
        for _ in range(6):
            run.queue.add(some_motion(run.queue, dice))
        run.step(37)
        run.queue.hold()
        run.step(60)
        run.queue.unhold()
        run.until(QueueState.IDLE)
        runs.append(run.commands)
    assert runs[0] == runs[1]


# --- passing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", [PASS, PassMark("n", 30)])
def test_passing_is_faster_and_ends_exactly(mark):
    cycles = {}
    for each in (AT, mark):
        run = recorder()
        run.queue.add(line(run.queue, (80, 0, 0), mark=each))
        last = run.queue.add(line(run.queue, (0, 80, 0)))
        cycles[each] = run.until(QueueState.IDLE)
        run.check_limits()
        assert run.queue.joints == last.motion.end
    assert cycles[mark] < cycles[AT] - 2


@pytest.mark.parametrize("radius", [1.0, 5.0, 20.0, 40.0])
@pytest.mark.parametrize("way", [(0, 90, 0), (60, 60, 0), (-50, 60, 0), (-90, 0, 0)])
def test_the_path_leaves_the_corner_within_the_radius(radius, way):
    run = recorder()
    begin = run.tips[0]
    first = run.queue.add(line(run.queue, (90, 0, 0), mark=PassMark("n", radius)))
    run.queue.add(line(run.queue, way))
    run.until(QueueState.IDLE)
    run.check_limits()
    corner = (ARM.forward(np.array(first.motion.end)) @ TOOL)[:3, 3]
    tips = run.tips
    off_first = np.linalg.norm(np.cross(tips - begin, [1, 0, 0]), axis=1) > 0.01
    backwards = np.diff(tips[:, 0], prepend=tips[0, 0]) < -1e-9
    left = int(np.argmax(off_first | backwards))
    assert np.linalg.norm(tips[left - 1] - corner) <= radius + 0.01
    assert run.queue.end_joints == run.queue.joints


def test_a_small_radius_comes_nearer_to_the_corner():
    distances = []
    for radius in (2.0, 10.0, 30.0):
        run = recorder()
        first = run.queue.add(line(run.queue, (90, 0, 0), mark=PassMark("n", radius)))
        run.queue.add(line(run.queue, (0, 90, 0)))
        run.until(QueueState.IDLE)
        corner = (ARM.forward(np.array(first.motion.end)) @ TOOL)[:3, 3]
        distances.append(np.linalg.norm(run.tips - corner, axis=1).min())
    assert distances == sorted(distances)
    assert distances[0] < 2
    assert distances[0] < distances[-1] - 1


def test_a_pass_without_a_follower_ends_at_its_target():
    run = recorder()
    motion = ptp(run.queue, (40, *HOME[1:]), mark=PASS)
    ticket = run.queue.add(motion)
    while ticket.state is TicketState.RUNNING:
        run.step()
    assert ticket.state is TicketState.PASSED
    assert motion.pass_time <= ticket.elapsed < motion.pass_time + CYCLE
    run.until(QueueState.IDLE)
    assert run.queue.joints == motion.end
    assert ticket.state is TicketState.DONE


@pytest.mark.parametrize("late", range(0, 60, 3))
def test_a_follower_may_come_late(late):
    run = recorder()
    first = run.queue.add(ptp(run.queue, (40, *HOME[1:]), mark=PASS))
    while first.state is TicketState.RUNNING:
        run.step()
    run.step(late)
    last = run.queue.add(ptp(run.queue, (40, 60, *HOME[2:])))
    run.until(QueueState.IDLE)
    assert (first.state, last.state, run.queue.joints) == (TicketState.DONE, TicketState.DONE, (40, 60, *HOME[2:]))
    run.check_limits()


@pytest.mark.parametrize("seed", range(60))
def test_motions_of_all_kinds_pass_within_the_limits(seed):
    dice = random.Random(seed)
    run = recorder(some_joints(dice))
    motions = []
    for _ in range(dice.randint(2, 6)):
        motions.append(some_motion(run.queue, dice))
        run.queue.add(motions[-1])
        run.step(dice.choice([0, 0, dice.randrange(40)]))
        if run.queue.state is QueueState.IDLE:
            break
    run.until(QueueState.IDLE)
    assert run.queue.joints == motions[-1].end
    run.check_limits(
        max(motion.rates.speed for motion in motions),
        max(max(motion.rates.accel, motion.rates.decel) for motion in motions),
    )
    low, high = (np.array(side) for side in zip(*((axis.lower, axis.upper) for axis in VS050.axes), strict=True))
    assert np.all((run.joints >= low - 1e-5) & (run.joints <= high + 1e-5))


def test_many_short_passes_are_one_smooth_motion():
    cycles = {}
    for mark in (AT, PASS):
        run = recorder()
        for n in range(10):
            run.queue.add(ptp(run.queue, (2.0 * (n + 1), *HOME[1:]), mark=mark))
        cycles[mark] = run.until(QueueState.IDLE)
        run.check_limits()
        assert run.queue.joints == (20.0, *HOME[1:])
        assert np.all(np.diff(run.joints[:, 0]) >= -1e-12)
    assert cycles[PASS] < 0.8 * cycles[AT]


# --- stops --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(40))
def test_every_halt_is_within_the_limits(seed):
    dice = random.Random(seed)
    run = recorder(some_joints(dice))
    tickets = [run.queue.add(some_motion(run.queue, dice)) for _ in range(dice.randint(1, 5))]
    run.step(dice.randrange(1, int(sum(ticket.motion.duration for ticket in tickets) / CYCLE) + 2))
    run.queue.halt()
    cycles = run.until(QueueState.IDLE)
    assert cycles * CYCLE <= 0.5
    run.check_limits()
    states = [ticket.state for ticket in tickets]
    assert set(states) <= {TicketState.DONE, TicketState.STOPPED}
    assert states == sorted(states, key=[TicketState.DONE, TicketState.STOPPED].index)
    assert run.queue.end_joints == run.queue.joints
    stood = run.queue.joints
    run.queue.add(ptp(run.queue, HOME))
    run.until(QueueState.IDLE)
    assert stood in run.commands
    assert run.queue.joints == HOME
    run.check_limits()


@pytest.mark.parametrize("when", range(0, 100, 2))
def test_a_full_speed_motion_can_be_stopped_anywhere(when):
    run = recorder((0.0,) * 6)
    run.queue.add(ptp(run.queue, (160, 100, -100, 200, 100, -300)))
    run.step(when)
    before = run.joints[-1, 0]
    run.queue.halt()
    cycles = run.until(QueueState.IDLE)
    run.check_limits()
    assert cycles <= 30  # the slowest joint takes 0.2 s from its full velocity to standstill
    axis = VS050.axes[0]
    assert run.joints[-1, 0] - before <= axis.velocity**2 / axis.acceleration / 2 + axis.velocity * 2 * CYCLE
    assert np.all(np.diff(run.joints[:, 0]) >= 0)


@pytest.mark.parametrize("when", range(2, 90, 4))
@pytest.mark.parametrize("mark", [PASS, PassMark("n", 60)])
def test_a_blend_can_be_stopped_anywhere(when, mark):
    run = recorder()
    run.queue.add(line(run.queue, (90, 0, 0), mark=mark))
    run.queue.add(line(run.queue, (0, 120, 0), mark=mark))
    run.queue.add(ptp(run.queue, HOME))
    run.step(when)
    run.queue.halt()
    assert run.until(QueueState.IDLE) * CYCLE <= 0.5
    run.check_limits()


def test_a_stopping_arm_accepts_no_motion():
    run = recorder()
    run.queue.add(ptp(run.queue, (90, *HOME[1:])))
    run.step(30)
    run.queue.halt()
    run.step()
    with pytest.raises(CallError) as caught:
        run.queue.add(plan_ptp(ARM, run.queue.end_joints, HOME, Rates()))
    assert caught.value.code == hresult.STOPPING_MOTION
    run.queue.unhold()
    run.queue.hold()
    assert run.queue.state is QueueState.STOPPING
    run.until(QueueState.IDLE)


def test_nothing_to_stop_or_hold():
    run = recorder()
    for do in (run.queue.halt, run.queue.hold, run.queue.unhold, run.queue.halt, run.queue.halt):
        do()
        assert run.queue.state is QueueState.IDLE
    run.step(3)
    assert run.queue.joints == HOME


# --- hold ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("when", [1, 2, 4, 7, 10, 15, 22, 30, 40, 50, 60, 65, 68, 70])
def test_a_held_line_stays_on_the_line(when):
    run = recorder()
    begin = run.tips[0]
    motion = line(run.queue, (120, 90, -50), Rates(0.3, 0.8, 0.6))
    ticket = run.queue.add(motion)
    run.step(when)
    run.queue.hold()
    run.until(QueueState.HELD)
    held = run.queue.joints
    run.step(20)
    assert run.queue.joints == held
    assert run.queue.velocity_and_acceleration() == ((0,) * 6, (0,) * 6)
    assert ticket.state is TicketState.RUNNING
    run.queue.unhold()
    assert run.queue.state is QueueState.RESUMING
    run.until(QueueState.IDLE)
    assert run.queue.joints == motion.end
    run.check_limits()
    way = np.array([120, 90, -50]) / np.linalg.norm([120, 90, -50])
    assert np.linalg.norm(np.cross(run.tips - begin, way), axis=1).max() < 0.01
    assert np.all(np.diff((run.tips - begin) @ way) >= -1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_holding_again_and_again_changes_nothing_but_the_time(seed):
    dice = random.Random(seed)
    run = recorder(some_joints(dice))
    tickets = [run.queue.add(some_motion(run.queue, dice)) for _ in range(dice.randint(1, 4))]
    while run.queue.state is not QueueState.IDLE and len(run.commands) < PATIENCE:
        run.step(dice.randrange(1, 50))
        run.queue.hold()
        run.step(dice.randrange(40))
        run.queue.unhold()
    assert run.queue.state is QueueState.IDLE
    assert run.queue.joints == tickets[-1].motion.end
    assert all(ticket.state is TicketState.DONE for ticket in tickets)
    run.check_limits()


def test_unhold_is_as_gentle_as_the_motion():
    rates = Rates(0.5, 0.1, 0.1)
    run = recorder()
    run.queue.add(ptp(run.queue, (150, *HOME[1:]), rates))
    run.step(100)
    run.queue.hold()
    run.until(QueueState.HELD)
    held = len(run.commands)
    run.queue.unhold()
    run.until(QueueState.IDLE)
    run.commands = run.commands[held:]
    run.check_limits(0.5, 0.1)


def test_motions_can_be_added_and_dropped_while_held():
    run = recorder()
    first = run.queue.add(ptp(run.queue, (40, *HOME[1:]), mark=PASS))
    run.step(10)
    run.queue.hold()
    run.until(QueueState.HELD)
    second = run.queue.add(ptp(run.queue, (80, *HOME[1:])))
    run.step(5)
    assert (first.state, second.state) == (TicketState.RUNNING, TicketState.QUEUED)
    run.queue.halt()
    assert (first.state, second.state, run.queue.state) == (TicketState.STOPPED, TicketState.STOPPED, QueueState.IDLE)
    run.queue.add(ptp(run.queue, HOME))
    run.until(QueueState.IDLE)
    run.check_limits()


def test_a_hold_between_two_motions_holds_the_next():
    run = recorder()
    first = run.queue.add(ptp(run.queue, (10, *HOME[1:])))
    second = run.queue.add(ptp(run.queue, HOME))
    while first.state is not TicketState.DONE:
        run.step()
    run.queue.hold()
    assert run.until(QueueState.HELD) == 1
    run.step(10)
    assert (second.state, second.progress) == (TicketState.RUNNING, 0)
    assert run.queue.joints == (10, *HOME[1:])
    run.queue.unhold()
    run.until(QueueState.IDLE)
    assert run.queue.joints == HOME
    run.check_limits()


@pytest.mark.parametrize("before_end", range(1, 8))
def test_a_hold_just_before_the_end(before_end):
    run = recorder()
    motion = ptp(run.queue, (40, *HOME[1:]))
    run.queue.add(motion)
    run.step(math.ceil(motion.duration / CYCLE) - before_end)
    run.queue.hold()
    run.until(QueueState.IDLE, QueueState.HELD)
    run.step(5)
    run.queue.unhold()
    run.until(QueueState.IDLE)
    assert run.queue.joints == motion.end
    run.check_limits()


# --- all of it ----------------------------------------------------------------------------------------------------


actions = st.lists(
    st.tuples(st.sampled_from(["add", "add", "add", "hold", "unhold", "halt", "step"]), st.integers(0, 60)), max_size=25
)


@settings(max_examples=200, deadline=None)
@given(actions, st.integers(0, 1000))
def test_random_operations_stay_within_the_limits(actions, seed):
    dice = random.Random(seed)
    run = recorder(some_joints(dice))
    tickets = []
    for what, cycles in actions:
        queue = run.queue
        if what == "add" and queue.state is not QueueState.STOPPING and not queue.full:
            tickets.append(queue.add(some_motion(queue, dice)))
        elif what in ("hold", "unhold", "halt"):
            getattr(queue, what)()
        run.step(cycles)
    run.queue.halt()
    run.until(QueueState.IDLE)
    run.check_limits()
    assert all(ticket.state in (TicketState.DONE, TicketState.STOPPED) for ticket in tickets)


@pytest.mark.parametrize("seed", range(6))
def test_another_arm(seed):
    dice = random.Random(seed)
    run = recorder(COBOTTA.model.home, COBOTTA)
    for _ in range(3):
        start = run.queue.end_joints
        frame = COBOTTA.forward(np.array(start)) @ TOOL
        frame[:3, 3] += [dice.uniform(-40, 40) for _ in range(3)]
        run.queue.add(plan_line(COBOTTA, start, frame, TOOL, some_rates(dice), PASS))
    run.step(dice.randrange(60))
    run.queue.hold()
    run.until(QueueState.HELD, QueueState.IDLE)
    run.queue.unhold()
    run.until(QueueState.IDLE)
    run.check_limits()
