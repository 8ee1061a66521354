"""Slave mode of the virtual VE026A, cycle by cycle: set-points, limits, the time-out detector, the brake, a late server."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.values.variant import Variant, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.ve026a import VirtualVE026A
from orinkit.virtual.ve026a.codes import OUT_OF_RANGE_AXIS1, SET_POINT_MISSED, TOO_FAST_AXIS1
from support.late_cell import HandClock, Wire
from support.ve_cell import ASYNC, HOME, R4, SYNC, Person, VeCell, ramp, turned

MODEL = load_model("VE026A")
LAG = 3  # cycles by which the encoders lag
MOST = 180.0 * 1.25 * PERIOD  # deg that an axis may turn in a cycle


@pytest.fixture
def cell():
    cell = VeCell()
    yield cell
    cell.arm.close()


# --- set-points ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_the_arm_follows_the_set_points(cell, mode):
    poses = [turned(5.0 * (1 - math.cos(math.pi * n / 50))) for n in range(101)]
    cell.on(mode).stream(poses)
    if mode == ASYNC:
        cell.cycle(LAG)
    assert cell.path[1 + LAG :] == poses[: len(cell.path) - 1 - LAG]
    assert cell.arm.error == 0


def test_asynchronous_moves_are_answered_at_once_with_where_the_arm_is(cell):
    cell.on(ASYNC)
    for number, pose in enumerate(ramp(0.5, 10)):
        answer = cell.send(pose)
        expected = [*HOME, 0.0] if number <= LAG else [0.5 * (number - LAG), *HOME[1:], 0.0]
        assert answer == Variant(R4, expected)
        cell.cycle()


def test_synchronous_moves_are_answered_when_there_is_room(cell):
    cell.on(SYNC)
    poses = ramp(0.5, 20)
    assert isinstance(cell.send(poses[0]), Variant)
    for pose in poses[1:]:
        answer = cell.send(pose)
        assert isinstance(answer, Deferred)
        assert not answer.done()
        cell.cycle()
        assert answer.result().value[0] == pytest.approx(cell.arm.joints[0])
    cell.cycle()
    assert cell.arm.error == 0
    assert cell.path[1 + LAG :] == poses[: len(cell.path) - 1 - LAG]  # none is left out
    cell.cycle()
    assert cell.arm.error == SET_POINT_MISSED


def test_a_client_that_is_one_ahead_may_be_late_once(cell):
    cell.on(SYNC).send(HOME)
    answer = cell.send(HOME)
    cell.cycle()
    assert answer.done()
    cell.cycle()
    assert cell.arm.error == 0
    assert isinstance(cell.send(HOME), Variant)
    cell.cycle()
    assert cell.arm.error == 0
    cell.cycle()
    assert cell.arm.error == SET_POINT_MISSED


def test_a_cancelled_synchronous_move_is_not_executed(cell):
    cell.on(SYNC).send(HOME)
    cell.send(turned(1.0)).set_exception(TimeoutError())
    last = cell.send(turned(0.5))
    cell.cycle()
    assert last.done()
    for _ in range(LAG + 1):
        cell.send(turned(0.5))
        cell.cycle()
    assert cell.arm.joints == turned(0.5)
    assert max(joints[0] for joints in cell.path) == 0.5


def test_a_cycle_uses_the_newest_set_point_in_asynchronous_mode(cell):
    cell.on(ASYNC)
    for pose in (turned(1.0), turned(-1.0)):
        cell.send(pose)
    cell.cycle(1 + LAG)
    assert cell.arm.joints == turned(-1.0)
    assert min(cell.path) == turned(-1.0)
    assert max(cell.path) == HOME


def test_the_arm_stays_at_the_last_set_point_in_asynchronous_mode(cell):
    cell.on(ASYNC).stream(ramp(1.0, 10))
    cell.cycle(1000)
    assert (cell.arm.joints, cell.arm.error, cell.arm.slave_mode) == (turned(10.0), 0, ASYNC)
    assert set(cell.path[14:]) == {turned(10.0)}  # at once: no braking, no return
    cell.stream(ramp(1.0, 12)[10:])
    cell.cycle(LAG)
    assert cell.arm.joints == turned(12.0)


def test_set_points_may_come_a_few_cycles_apart_in_asynchronous_mode(cell):
    cell.on(ASYNC)
    for pose in ramp(1.5, 20):
        cell.send(pose)
        cell.cycle(5)
    assert (cell.arm.joints, cell.arm.error) == (turned(30.0), 0)


def test_small_and_large_steps_back_and_forth_end_where_the_last_one_was(cell):
    cell.on(ASYNC).stream([turned(1.0), turned(2.0), turned(1.0), turned(1.0 + 1e-7)])
    cell.cycle(20)
    assert cell.arm.joints[0] == pytest.approx(1.0, abs=1e-6)
    assert cell.path[-1] == cell.path[-10]


# --- the time-out detector ------------------------------------------------------------------------------------------------


def test_the_detector_waits_for_the_first_set_point(cell):
    cell.on(SYNC)
    cell.cycle(500)
    assert cell.arm.error == 0


def test_a_cycle_without_a_set_point_is_an_error_also_at_standstill(cell):
    cell.on(SYNC).send(HOME)
    cell.cycle()
    assert cell.arm.error == 0
    cell.cycle()
    assert (cell.arm.error, cell.arm.slave_mode) == (SET_POINT_MISSED, 0)
    assert cell.arm.joints == HOME


def test_a_set_point_of_every_cycle_keeps_it_quiet(cell):
    cell.on(SYNC).stream([HOME] * 500)
    assert (cell.arm.error, cell.arm.slave_mode) == (0, SYNC)


def test_the_arm_brakes_when_set_points_stay_away(cell):
    cell.on(SYNC).stream(ramp(1.0, 20))
    cell.cycle()
    assert cell.arm.error == SET_POINT_MISSED
    cell.rest()
    check_brake(cell.path, first=20 + LAG)
    assert cell.arm.joints[0] == pytest.approx(20.0 + 125.0**2 / 2 / 900.0, abs=1.0)


def test_the_motion_of_a_silent_client_is_stopped_and_that_of_others_is_not(cell):
    other = Person(cell.arm)
    assert not cell.client.controller.is_moving()
    cell.on(ASYNC).stream(ramp(1.0, 20))
    assert [person.controller.is_moving() for person in (cell.client, other)] == [True, False]
    other.controller.stop_moving()
    assert cell.arm.slave_mode == ASYNC
    cell.client.controller.stop_moving()
    assert cell.arm.slave_mode == 0
    cell.rest()
    check_brake(cell.path, first=20 + LAG)
    assert not cell.client.controller.is_moving()
    assert cell.arm.error == 0
    cell.on(ASYNC)  # it may move again


def test_slave_mode_0_stops_the_detector(cell):
    cell.on(SYNC).stream(ramp(0.5, 10))
    assert cell.execute("slvChangeMode", 0) is None
    cell.cycle(100)
    assert cell.arm.error == 0


def test_it_is_the_same_after_an_error_has_been_cleared(cell):
    for _ in range(3):
        cell.on(SYNC).stream([cell.arm.joints] * 5)
        cell.cycle()
        assert cell.arm.error == SET_POINT_MISSED
        assert cell.clear() == 0


# --- limits -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", range(7))
@pytest.mark.parametrize("side", [-1, 1])
def test_the_range_of_each_axis(axis, side):
    edge = MODEL.axes[axis].upper if side > 0 else MODEL.axes[axis].lower
    pose = (*HOME[:axis], edge, *HOME[axis + 1 :])
    cell = VeCell(joints=pose).on(ASYNC)
    cell.send(pose)
    cell.cycle()
    assert cell.arm.error == 0
    beyond = (*pose[:axis], edge + side * 0.01, *pose[axis + 1 :])
    assert cell.code(lambda: cell.send(beyond)) == OUT_OF_RANGE_AXIS1 + axis
    assert (cell.arm.error, cell.arm.slave_mode) == (OUT_OF_RANGE_AXIS1 + axis, 0)
    cell.cycle(10)
    assert cell.arm.joints == pose


def test_the_lowest_axis_out_of_range_is_reported(cell):
    cell.on(ASYNC)
    assert cell.code(lambda: cell.send((0, 200, 300, 400, 30, 0, 0))) == OUT_OF_RANGE_AXIS1 + 1


@pytest.mark.parametrize("value", [1e30, -1e300, 1e308])
def test_a_huge_set_point_is_out_of_range(cell, value):
    cell.on(SYNC)
    assert cell.code(lambda: cell.client("slvMove", [value, *HOME[1:]])) == OUT_OF_RANGE_AXIS1


def braked_beyond(axis, side):
    """Return a cell whose arm was fast near the limit of an axis and has come to rest beyond it, and the joints."""
    edge = MODEL.axes[axis].upper if side > 0 else MODEL.axes[axis].lower
    poses = [(*HOME[:axis], edge - side * 1.0 * count, *HOME[axis + 1 :]) for count in range(12, -1, -1)]
    cell = VeCell(joints=poses[0]).on(SYNC)
    cell.stream(poses)
    cell.cycle()
    assert cell.arm.error == SET_POINT_MISSED
    cell.rest()
    assert (cell.arm.joints[axis] - edge) * side > 2.0
    assert cell.clear() == 0
    return cell, edge, cell.client.robot.get_variable("@CURRENT_ANGLE", "").get_value().value[:7]


@pytest.mark.parametrize("axis", range(7))
@pytest.mark.parametrize("side", [-1, 1])
def test_an_arm_beyond_its_range_can_be_held_and_led_back(axis, side):
    cell, edge, angles = braked_beyond(axis, side)
    stood = cell.arm.joints
    cell.on(SYNC).stream([angles] * 10)
    assert cell.arm.joints == pytest.approx(stood, abs=1e-4)
    beyond = angles[axis] - edge
    angles = [*angles]
    for count in range(19, -2, -1):
        angles[axis] = edge + beyond * count / 20
        cell.stream([angles])
    cell.stream([angles] * LAG)
    assert (cell.arm.error, cell.arm.slave_mode) == (0, SYNC)
    assert cell.arm.joints == pytest.approx(angles)
    angles[axis] = edge + beyond / 20  # it is within the range again
    assert cell.code(lambda: cell.run(cell.send(angles))) == OUT_OF_RANGE_AXIS1 + axis


@pytest.mark.parametrize("axis", [0, 3, 6])
@pytest.mark.parametrize("side", [-1, 1])
def test_an_arm_beyond_its_range_goes_no_farther(axis, side):
    cell, _, angles = braked_beyond(axis, side)
    for which in range(7):
        cell.on(ASYNC).send(angles)
        cell.cycle()
        farther = [*angles]
        if which == axis:
            farther[which] += side * 0.001
        else:
            farther[which] = MODEL.axes[which].upper + 0.001
        assert cell.code(lambda farther=farther: cell.send(farther)) == OUT_OF_RANGE_AXIS1 + which
        assert cell.clear() == 0
    other = [*angles]
    other[axis] = MODEL.axes[axis].lower - 1.0 if side > 0 else MODEL.axes[axis].upper + 1.0
    cell.on(ASYNC)
    assert cell.code(lambda: cell.send(other)) == OUT_OF_RANGE_AXIS1 + axis
    stood = cell.arm.joints
    cell.cycle(20)
    assert cell.arm.joints == stood


def test_an_arm_that_moves_brakes_when_a_set_point_is_out_of_range(cell):
    cell.on(ASYNC).stream(ramp(1.0, 20))
    assert cell.code(lambda: cell.send(turned(-90.0))) == OUT_OF_RANGE_AXIS1
    cell.rest()
    check_brake(cell.path, first=20 + LAG)


@pytest.mark.parametrize("axis", range(7))
@pytest.mark.parametrize("mode", [SYNC, ASYNC])
@pytest.mark.parametrize("way", [-1, 1])
def test_as_fast_as_the_axis_can_and_no_faster(axis, mode, way):
    cell = VeCell().on(mode)
    cell.stream(ramp(way * MOST, 5, axis))
    assert cell.arm.error == 0
    cell.send(turned(way * (MOST * 6 + 0.002), axis))
    waits = cell.send(turned(way * MOST * 6, axis)) if mode == SYNC else None
    cell.cycle()
    assert (cell.arm.error, cell.arm.slave_mode) == (TOO_FAST_AXIS1 + axis, 0)
    if mode == SYNC:
        assert cell.code(lambda: waits) == TOO_FAST_AXIS1 + axis
    assert cell.code(lambda: cell.send(HOME)) == TOO_FAST_AXIS1 + axis
    cell.rest()
    check_brake(cell.path, first=5 + LAG)


def test_a_jump_from_standstill_is_not_carried_out(cell):
    cell.on(ASYNC).send(turned(2.0))
    cell.cycle(20)
    assert (cell.arm.error, cell.arm.joints) == (TOO_FAST_AXIS1, HOME)


def test_single_precision_does_not_matter(cell):
    cell.on(ASYNC).stream([Variant(R4, pose).value for pose in ramp(np.float32(MOST).item(), 40)])
    assert cell.arm.error == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([SYNC, ASYNC]))
def test_with_any_set_points_the_arm_stays_within_its_velocities_and_comes_to_rest(seed, mode):
    generator, cell = random.Random(seed), VeCell()
    cell.on(mode)
    pose = list(HOME)
    for _ in range(60):
        pose = [
            value + generator.choice((0.0, 0.3, 1.7, 3.0)) * generator.choice((-1, 0, 0, 0, 0, 0, 1)) for value in pose
        ]
        if cell.arm.slave_mode:
            cell.code(lambda pose=pose: 0 if isinstance(answer := cell.send(pose), Deferred) else answer)
        cell.cycle()
    if cell.arm.slave_mode:
        cell.client("slvChangeMode", 0)
    cell.rest()
    steps = np.diff(np.array(cell.path), axis=0)
    assert np.all(np.abs(steps) <= MOST + 0.001)
    assert cell.arm.slave_mode == 0


def check_brake(path: list[tuple[float, ...]], first: int) -> None:
    """Check that the arm decelerated evenly and straight, within the accelerations of its model, from a sample on."""
    steps = np.diff(np.array(path), axis=0)[first - 1 :]
    bends = np.diff(steps, axis=0) / PERIOD**2
    assert np.all(np.abs(bends) <= np.array([axis.acceleration for axis in MODEL.axes]) * (1 + 1e-6))
    speeds = steps @ steps[0] / (steps[0] @ steps[0])
    assert speeds[0] == 1.0
    assert speeds[-1] == 0.0
    assert np.all(np.diff(speeds) <= 1e-9)
    assert np.allclose(steps, speeds[:, None] * steps[0], atol=1e-9)


# --- a server that is late ------------------------------------------------------------------------------------------------------


class Late:
    """A virtual VE026A with a clock and a connection that a test controls; its client is in slave mode."""

    def __init__(self, mode: int) -> None:
        self.hand = HandClock()
        self.wire = Wire()
        self.arm = VirtualVE026A(clock=self.hand, motor=True, strict_time=True)
        self.client = Person(self.arm, ClientInfo("", "serial", 0, self.wire.when_input_processed))
        with self.arm.guard:
            assert self.client("slvChangeMode", mode) is None
        self.number = 0

    def send(self, step: float = 1.0) -> Any:
        """Send the next set-point of a ramp; it is read at once."""
        self.number += 1
        with self.arm.guard:
            return self.client("slvMove", variant([*turned(step * self.number)]))

    def arrive(self, count: int = 1) -> None:
        """Add arrived set-points that have not been read yet."""
        self.wire.arrived += [self.send] * count

    def pass_by(self, seconds: float) -> None:
        """Let time pass; the clock's thread runs the cycles that are due."""
        self.hand.seconds += seconds
        for advance in self.hand.driven:
            advance()


def test_a_set_point_that_has_arrived_counts_before_it_is_read():
    late = Late(SYNC)
    for _ in range(20):
        late.send()
        late.pass_by(PERIOD)
    assert late.arm.error == 0
    late.pass_by(0.0)
    late.arrive()
    late.pass_by(0.004)  # the cycle's time has not come
    late.pass_by(0.004)
    assert late.arm.error == 0  # the question is open
    late.wire.read()
    late.pass_by(0.0)
    assert (late.arm.error, late.arm.slave_mode) == (0, SYNC)
    assert late.number == 21


@pytest.mark.parametrize("stall", [0.02, 0.05, 0.2])
def test_a_stalled_server_is_not_held_against_a_client_that_waits_for_answers(stall):
    late = Late(SYNC)
    late.send()
    for turn in range(60):
        promise = late.send()
        late.pass_by(PERIOD if turn % 10 else stall)
        late.wire.read()
        late.pass_by(0.0)
        assert promise.done()
        promise.result()
    assert (late.arm.error, late.arm.slave_mode) == (0, SYNC)


def test_a_client_that_sends_nothing_is_still_detected():
    late = Late(SYNC)
    late.send()
    for _ in range(5):
        late.pass_by(PERIOD)
        late.wire.read()
    assert late.arm.error == SET_POINT_MISSED


@pytest.mark.parametrize("cycles", [2, 5, 20])
def test_set_points_of_a_stalled_server_are_caught_up_in_asynchronous_mode(cycles):
    late = Late(ASYNC)
    for _ in range(20):
        late.send()
        late.pass_by(PERIOD)
    late.hand.seconds += cycles * PERIOD
    late.arrive(cycles)  # one for each cycle that was not run; only the newest counts
    for advance in late.hand.driven:
        advance()
    late.wire.read()
    for _ in range(5):
        late.pass_by(0.0)
    for _ in range(10):
        late.send()
        late.pass_by(PERIOD)
        late.wire.read()
    assert (late.arm.error, late.arm.slave_mode) == (0, ASYNC)
    assert late.arm.joints[0] > 20.0 + cycles


def test_a_jump_is_too_fast_even_if_the_server_was_late():
    late = Late(ASYNC)
    for _ in range(5):
        late.send()
        late.pass_by(PERIOD)
    late.number += 30
    late.send()
    late.pass_by(PERIOD)
    late.wire.read()
    assert late.arm.error == TOO_FAST_AXIS1


@pytest.mark.parametrize("step", [0.0, 1.0])
def test_a_server_that_was_late_gives_its_client_a_period(step):
    late = Late(SYNC)
    for _ in range(20):
        late.send(step)
        late.pass_by(PERIOD)
        late.wire.read()
    late.pass_by(PERIOD * 1.75)
    late.wire.read()  # only now the client receives the reply, and half a cycle later it sends the next set-point
    late.pass_by(PERIOD * 0.5)
    late.send(step)
    late.pass_by(PERIOD * 0.5)
    late.wire.read()
    assert (late.arm.error, late.arm.slave_mode) == (0, SYNC)


@pytest.mark.parametrize("mode", [SYNC, ASYNC])
def test_the_limits_are_larger_for_a_moment_if_the_server_was_late(cell, mode):
    cell.on(mode)
    cell.arm._arm.slave.lenient_cycles = 2
    cell.stream([turned(2 * MOST), turned(0.0)])
    assert cell.arm.error == 0
    cell.send(turned(2 * MOST))
    cell.cycle()
    assert cell.arm.error == TOO_FAST_AXIS1


def test_the_larger_limits_end(cell):
    cell.on(ASYNC)
    cell.arm._arm.slave.lenient_cycles = 1
    cell.send(turned(2 * MOST + 0.01))
    cell.cycle()
    assert cell.arm.error == TOO_FAST_AXIS1
