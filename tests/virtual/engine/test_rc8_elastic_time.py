"""Elastic time in slave mode: a virtual controller waits for a late set-point, counts it, and reports it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.arms import load_model
from orinkit.cao.provider import ClientInfo
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.rc8.slave_lateness import Lateness
from orinkit.values.variant import variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a.codes import SET_POINT_MISSED
from support.cell import Cell
from support.late_cell import LateCell, moving
from support.slave_cell import HOME, J0, J1, J2, P0, SlaveCell, straight
from support.ve_cell import ASYNC, SYNC, VeCell, turned

pytestmark = pytest.mark.longest_wait

AXIS = load_model("VS-050").axes[0]
POSES = list(straight(1.0, 150))
MOVING = 30
QUEUES = pytest.mark.parametrize("mode", [J0, J2], ids=["mode 0", "mode 2"])
MODES = pytest.mark.parametrize("mode", [J0, J1, J2], ids=["mode 0", "mode 1", "mode 2"])
LATE = pytest.mark.parametrize("late", [0.020, 0.100, 0.249])


def elastic(mode: int, **options: Any) -> SlaveCell:
    """An arm that moves by 1 deg in each cycle; its buffer is empty and the next set-point is due."""
    cell = SlaveCell(strict_time=False, **options).on(mode)
    cell.stream(POSES[:MOVING])
    cell.clock.advance(PERIOD)
    assert (cell.error, cell.arm.queue.joints) == (0, POSES[MOVING - 1])
    return cell


@pytest.fixture
def cells() -> Iterator[Callable[..., SlaveCell]]:
    made: list[SlaveCell] = []

    def make(mode: int, **options: Any) -> SlaveCell:
        made.append(elastic(mode, **options))
        return made[-1]

    yield make
    for cell in made:
        cell.rc8.close()


# --- waiting ----------------------------------------------------------------------------------------------------------


@MODES
@LATE
def test_a_late_set_point_is_waited_for_and_counted(cells, mode, late):
    cell = cells(mode)
    number = cell.rc8.state.cycles.number
    cell.clock.advance(late)
    assert cell.rc8.state.cycles.number == number
    cell.stream(POSES[MOVING:90])
    assert (cell.error, cell.mode, cell.arm.queue.joints) == (0, mode, POSES[89])
    assert cell.rc8.set_point_lateness == Lateness(1, pytest.approx(late), pytest.approx(late))


@QUEUES
def test_after_250_ms_it_is_an_error(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.251)
    assert (cell.error, cell.arm.slave.on) == (hresult.COMMAND_DELAY, False)
    with pytest.raises(CallError) as refused:
        cell.send(POSES[MOVING])
    assert refused.value.code == hresult.COMMAND_DELAY
    assert cell.rc8.set_point_lateness == Lateness(1, pytest.approx(0.25), pytest.approx(0.25))
    assert "250 ms" in cell.rc8.state.faults.log.newest.message or "250 ms" in str(cell.rc8.state.faults.log.newest)


@QUEUES
@pytest.mark.parametrize("steps", [1, 7, 31, 251])
def test_the_end_of_the_wait_does_not_depend_on_how_the_clock_moves(cells, mode, steps):
    """The arm brakes from the end of the wait."""
    cell = cells(mode)
    began = cell.clock.now()
    for step in range(1, steps + 1):
        cell.clock.advance(began + 0.330 * step / steps - cell.clock.now())
    assert cell.error == hresult.COMMAND_DELAY
    assert cell.rc8.state.cycles.number == pytest.approx((began + 0.330 - 0.250) / PERIOD, abs=1.1)
    cell.rest()


@MODES
def test_strict_time_does_not_wait(mode):
    cell = SlaveCell(strict_time=True).on(mode)
    cell.stream(POSES[:MOVING])
    cell.clock.advance(PERIOD)
    expected = hresult.COMMAND_ACCELERATION_OVER_AXIS1 if mode == J1 else hresult.COMMAND_DELAY
    assert (cell.error, cell.arm.slave.on) == (expected, False)
    assert cell.rc8.set_point_lateness.count == (mode == J1)
    assert "strict time" in str(cell.rc8.state.faults.log.newest)


def test_strict_time_counts_what_mode_1_does_not_report():
    """At low velocity, stopping in place is not an error; the late set-point is only counted."""
    cell = SlaveCell(strict_time=True).on(J1)
    slow = [(0.01 * index, *HOME[1:]) for index in range(40)]
    cell.stream(slow[:20])
    cell.clock.advance(PERIOD + 0.1)
    assert (cell.error, cell.rc8.set_point_lateness, cell.arm.queue.joints) == (0, Lateness(), slow[19])
    cell.stream(slow[20:])
    assert (cell.error, cell.arm.queue.joints) == (0, slow[39])
    assert cell.rc8.set_point_lateness == Lateness(1, pytest.approx(0.1, abs=PERIOD), pytest.approx(0.1, abs=PERIOD))
    cell.rc8.close()


def test_mode_1_stops_in_place_after_250_ms(cells):
    """At this velocity that exceeds the acceleration limit; at low velocity it is not an error."""
    cell = cells(J1)
    cell.clock.advance(0.251)
    assert cell.error == hresult.COMMAND_ACCELERATION_OVER_AXIS1
    slow = SlaveCell(strict_time=False).on(J1)
    slow.stream([(0.01 * index, *HOME[1:]) for index in range(20)])
    slow.clock.advance(PERIOD + 0.251)
    assert (slow.error, slow.mode, slow.arm.queue.joints[0]) == (0, J1, pytest.approx(0.19))
    assert slow.rc8.set_point_lateness == Lateness(1, pytest.approx(0.25), pytest.approx(0.25))
    slow.rc8.close()


def test_a_repeated_set_point_of_mode_1_is_no_new_one_at_speed(cells):
    """A client that waits for the controller's time repeats set-points; this must not stop the arm abruptly."""
    cell = cells(J1)
    cell.send(POSES[MOVING - 1])
    cell.clock.advance(0.1)
    assert cell.error == 0
    cell.stream(POSES[MOVING:60])
    assert (cell.error, cell.rc8.set_point_lateness.count) == (0, 1)


def test_a_repeated_set_point_of_mode_1_stops_a_slow_arm_at_once():
    cell = SlaveCell(strict_time=False).on(J1)
    slow = [(0.01 * index, *HOME[1:]) for index in range(20)]
    cell.stream([*slow, slow[-1], slow[-1]])
    cell.clock.advance(1.0)
    assert (cell.error, cell.arm.busy, cell.rc8.set_point_lateness) == (0, False, Lateness())
    cell.rc8.close()


@MODES
def test_an_arm_that_stands_is_not_waited_for(mode):
    cell = SlaveCell(strict_time=False).on(mode)
    cell.stream([HOME, HOME])
    number = cell.rc8.state.last_cycle_time
    cell.clock.advance(1.0)
    assert cell.rc8.state.last_cycle_time == pytest.approx(number + 1.0, abs=PERIOD)
    assert (cell.error, cell.rc8.set_point_lateness) == (0, Lateness())
    cell.rc8.close()


@QUEUES
def test_less_than_a_quarter_of_a_period_is_not_late(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.0019)
    cell.stream(POSES[MOVING:60])
    assert (cell.error, cell.rc8.set_point_lateness) == (0, Lateness())


@MODES
def test_every_case_is_counted(cells, mode):
    cell = cells(mode)
    for index, late in enumerate((0.02, 0.1, 0.05, 0.24)):
        cell.clock.advance(late)
        cell.stream(POSES[MOVING + 5 * index : MOVING + 5 * index + 5])  # at its end the next one is due
    assert cell.error == 0
    assert cell.rc8.set_point_lateness == Lateness(4, pytest.approx(0.24), pytest.approx(0.41))


@pytest.mark.parametrize("strict", [False, True])
@QUEUES
def test_a_sender_that_is_always_a_little_too_slow_is_counted(mode, strict):
    """A real controller's buffer would run empty."""
    cell = SlaveCell(strict_time=strict).on(mode)
    for pose in straight(0.3, 300):
        try:
            cell.send(pose)
        except CallError:
            break
        cell.clock.advance(PERIOD + 0.0018)
    if strict:
        assert cell.error == hresult.COMMAND_DELAY
    else:
        assert cell.error == 0
        assert cell.rc8.set_point_lateness.total == pytest.approx(0.0018 * 300, abs=0.04)
        assert cell.rc8.set_point_lateness.count > 100
    cell.rc8.close()


def test_any_number_of_cases_is_counted(cells, monkeypatch):
    cell = cells(J0)
    cases = cell.arm.slave._pace._cases
    for _ in range(12_000):
        cases.add(0.003)
    cases.add(0.2)
    assert cell.rc8.set_point_lateness == Lateness(12_001, 0.2, pytest.approx(36.2))
    assert cell.arm.slave.lateness(12_000) == Lateness(1, 0.2, 0.2)
    assert cell.arm.slave.lateness(12_001) == Lateness()
    assert cell.arm.slave.lateness(99_999) == Lateness()


# --- time stands still ------------------------------------------------------------------------------------------------


@MODES
def test_limits_hold_across_the_pause(mode):
    cell = SlaveCell(strict_time=False)
    cell.execute("StartLog")
    cell.on(mode)
    cell.stream(POSES[:MOVING])
    cell.clock.advance(PERIOD)
    logged = len(cell.arm.log)
    began = cell.rc8.state.last_cycle_time
    seen: list[tuple[float, ...]] = []
    step = cell.arm.servo.step
    cell.arm.servo.step = lambda command: (seen.append(command), step(command))[1]
    for index in range(MOVING, 100, 5):
        cell.clock.advance(0.060)
        cell.stream(POSES[index : index + 5])
    assert cell.error == 0
    bends = np.diff(np.array([POSES[MOVING - 2], POSES[MOVING - 1], *seen])[:, 0], 2) / PERIOD**2
    assert np.abs(bends).max() < AXIS.acceleration
    assert len(seen) == 70
    assert cell.rc8.state.last_cycle_time == pytest.approx(began + 70 * PERIOD)
    assert len(cell.arm.log) == logged + 70
    cell.rc8.close()


def commands(cell: SlaveCell) -> list[float]:
    """Return the executed commands of J1 until an error, with the two before them."""
    seen = [cell.arm.queue.previous_joints[0], cell.arm.queue.joints[0]]
    step = cell.arm.servo.step
    cell.arm.servo.step = lambda command: (seen.append(command[0]) if not cell.error else None, step(command))[1]
    return seen


@given(late=st.sampled_from([0.015, 0.05, 0.1, 0.24]), far=st.lists(st.floats(-60, 100), min_size=1, max_size=6))
def test_limits_hold_in_mode_1_after_a_pause(late, far):
    """The client was late, so the limits are those of any other cycle."""
    cell = elastic(J1)
    seen = commands(cell)
    for way in far:
        cell.clock.advance(late)
        if cell.error:
            break
        goal = cell.arm.queue.joints[0] + way
        cell.send((min(max(goal, AXIS.lower), AXIS.upper), *HOME[1:]))
        cell.clock.advance(PERIOD)
    assert np.abs(np.diff(seen, 2)).max(initial=0.0) <= 1.2501 * AXIS.slave_acceleration * PERIOD**2
    assert np.abs(np.diff(seen)).max(initial=0.0) <= 1.2501 * AXIS.velocity * PERIOD
    cell.rc8.close()


@pytest.mark.parametrize("back", [0.2, 1.0, 5.0])
def test_the_path_to_a_set_point_after_a_pause_stays_within_the_range(back):
    """Near the end of the range at high velocity: the path back must not leave the range."""
    cell = SlaveCell(strict_time=False)
    cell.stand(129.0, *HOME[1:])
    cell.on(J1)
    joint, step = 129.0, 0.0
    while joint < 169.0:
        step = min(step + 0.136, 2.0)
        joint = min(joint + step, 169.99)
        cell.send((joint, *HOME[1:]))
        cell.cycle()
    assert cell.error == 0
    seen = commands(cell)
    cell.clock.advance(PERIOD + 0.24)
    cell.send((cell.arm.queue.joints[0] - back, *HOME[1:]))
    cell.clock.advance(PERIOD)
    assert all(AXIS.lower <= each <= AXIS.upper for each in seen)
    cell.rc8.close()


@MODES
def test_a_jump_after_the_pause_is_refused_as_ever(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.015)
    cell.send((POSES[MOVING][0] + 20.0, *HOME[1:]))
    cell.cycle()
    assert cell.error in (hresult.SENT_SPEED_OVER_AXIS1, hresult.COMMAND_ACCELERATION_OVER_AXIS1)


def test_the_time_stamp_of_the_answer_stands_still(cells):
    cell = cells(J0)
    times = []
    for late in (0.0, 0.1, 0.1):
        cell.clock.advance(late)
        times.append(cell.rc8.state.last_cycle_time)
    assert len(set(times)) == 1
    assert cell.rc8.state.seconds == pytest.approx(times[0] + PERIOD)


@QUEUES
def test_a_client_by_the_clock_fills_its_buffer_again(cells, mode):
    """It sends the delayed set-points at once; none is lost, and none is too fast."""
    cell = cells(mode)
    cell.clock.advance(0.100)
    for pose in POSES[MOVING : MOVING + 3]:
        cell.send(pose)
    cell.cycle(3)
    assert (cell.error, cell.arm.queue.joints) == (0, POSES[MOVING + 2])


def test_a_client_by_the_clock_in_mode_1_is_led_to_where_it_is_by_now(cells):
    """After 48 ms it continues six set-points ahead; the controller has six cycles to catch up."""
    cell = cells(J1)
    cell.clock.advance(6 * PERIOD)
    cell.stream(POSES[MOVING : MOVING + 1])
    cell.stream(POSES[MOVING + 7 : MOVING + 30])
    assert (cell.error, cell.arm.queue.joints, cell.rc8.set_point_lateness.count) == (0, POSES[MOVING + 29], 1)


def test_two_controllers_do_not_wait_for_each_other():
    clock = ManualClock()
    waiting, other = (VirtualRC8(clock=clock, motor=True) for _ in range(2))
    robots = []
    for device in (waiting, other):
        robot = device.connect("c", "", "", ClientInfo("192.168.0.7", "tcp")).get_robot("Arm", "")
        robot.execute("TakeArm", variant([0, 0]))
        robot.execute("slvChangeMode", variant(J0))
        robots.append(robot)
    for pose in POSES[:MOVING]:
        for robot in robots:
            robot.execute("slvMove", variant([*pose, 0.0, 0.0]))
        clock.advance(PERIOD)
    numbers = [device.state.cycles.number for device in (waiting, other)]
    for pose in POSES[MOVING : MOVING + 20]:
        robots[1].execute("slvMove", variant([*pose, 0.0, 0.0]))
        clock.advance(PERIOD)
    assert waiting.state.cycles.number == numbers[0]
    assert other.state.cycles.number == numbers[1] + 20
    assert (waiting.state.faults.code, other.state.faults.code) == (0, 0)
    assert other.set_point_lateness == Lateness()
    for device in (waiting, other):
        device.close()


# --- what ends the wait -----------------------------------------------------------------------------------------------


@MODES
def test_an_emergency_stop_does_not_wait(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.1)
    cell.rc8.emergency_stop(True)
    assert not cell.arm.slave.on
    place = cell.arm.queue.joints[0]
    cell.clock.advance(PERIOD)
    assert 1.0 < cell.arm.queue.joints[0] - place < 2.0  # two cycles: it brakes from now on, without a jump
    cell.rest()


@MODES
def test_leaving_does_not_wait(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.1)
    number = cell.rc8.state.cycles.number
    leaving = cell.robot.execute("slvChangeMode", variant(0))
    cell.clock.advance(PERIOD)
    assert cell.rc8.state.cycles.number <= number + 2
    cell.run(leaving)
    assert (cell.error, cell.arm.slave.on) == (0, False)
    assert cell.rc8.set_point_lateness.count == 1


@MODES
def test_a_client_that_disconnects_is_not_waited_for(cells, mode):
    cell = cells(mode)
    cell.clock.advance(0.1)
    cell.robot.release()
    number = cell.rc8.state.cycles.number
    cell.clock.advance(PERIOD)
    assert cell.rc8.state.cycles.number <= number + 2
    cell.rest()
    assert cell.arm.holder is None


# --- telling of it ----------------------------------------------------------------------------------------------------


def test_it_is_logged_once_for_each_stream(cells, caplog):
    cell = cells(J0)
    for index in range(4):
        cell.clock.advance(0.020 + 0.010 * index)
        cell.stream(POSES[MOVING + 5 * index : MOVING + 5 * index + 5])
    assert caplog.records == []
    with caplog.at_level(logging.WARNING):
        cell.execute("slvChangeMode", 0)
        cell.on(J0)
        cell.execute("slvChangeMode", 0)
    (record,) = caplog.records
    assert "4 late set-points, by up to 50 ms" in record.getMessage()
    assert "--strict-time" in record.getMessage()
    assert cell.rc8.set_point_lateness == Lateness()  # of the stream that followed


def test_a_client_can_ask_for_it_while_slave_mode_is_on(cells):
    cell = cells(J0)
    for index, late in enumerate((0.02, 0.1, 0.05)):
        cell.clock.advance(late)
        cell.stream(POSES[MOVING + 5 * index : MOVING + 5 * index + 5])
    assert cell.execute("slvGetLateness") == pytest.approx([3.0, 0.1, 0.17])
    assert cell.execute("slvGetLateness", 2) == pytest.approx([1.0, 0.05, 0.05])
    assert cell.execute("slvGetLateness", [3]) == [0.0, 0.0, 0.0]
    assert cell.execute("slvGetLateness", 99) == [0.0, 0.0, 0.0]
    assert cell.execute("slvGetLateness", -1) == pytest.approx([3.0, 0.1, 0.17])
    cell.send(POSES[MOVING + 15])
    other = cell.connect().get_robot("Arm", "")
    assert variant(other.execute("slvGetLateness", variant(None))).value == pytest.approx([3.0, 0.1, 0.17])


def test_before_any_stream_there_is_none():
    cell = Cell()
    assert cell.execute("slvGetLateness") == [0.0, 0.0, 0.0]
    assert cell.rc8.set_point_lateness == Lateness()
    cell.rc8.close()


# --- a clock that runs by itself --------------------------------------------------------------------------------------


@QUEUES
def test_the_servers_own_stall_is_not_the_clients(mode):
    """The server was delayed by 200 ms while it waited, and the client by 30 ms: the client is late by some 40 ms."""
    cell = moving(LateCell(mode, strict=False))
    cell.drive(PERIOD)
    cell.read()
    for _ in range(3):
        cell.drive(0.010)
        cell.read()
    cell.drive(0.2)
    cell.call(POSES[MOVING])
    cell.drive()
    assert (cell.error, cell.arm.queue.joints) == (0, POSES[MOVING])
    assert 0.03 <= cell.rc8.set_point_lateness.longest <= 0.05
    cell.close()


@QUEUES
def test_a_set_point_that_has_arrived_ends_the_wait_before_its_time_is_up(mode):
    """It arrived while the server was busy; it counts, although 250 ms have passed."""
    cell = moving(LateCell(mode, strict=False))
    cell.drive(PERIOD)
    cell.read()
    for _ in range(30):
        cell.drive(PERIOD)
        cell.read()
    assert (cell.error, cell.on) == (0, True)
    cell.wire.arrived.append(lambda: cell.call(POSES[MOVING]))
    cell.drive(0.1)
    cell.read()
    cell.drive()
    assert (cell.error, cell.arm.queue.joints) == (0, POSES[MOVING])
    cell.close()


@QUEUES
@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_the_wait_is_real_time_for_any_scale(mode, scale):
    cell = moving(LateCell(mode, strict=False, scale=scale))
    pause = cell.drive(PERIOD)
    cell.read()
    waited = 0.0
    while cell.error == 0 and waited < 2.0:
        waited += pause / scale
        pause = cell.drive(pause)
        cell.read()
    assert cell.error == hresult.COMMAND_DELAY
    assert waited == pytest.approx(0.25, abs=0.02)
    cell.close()


# --- VE026A -----------------------------------------------------------------------------------------------------------


def ve026a(mode: int) -> VeCell:
    cell = VeCell(strict_time=False).on(mode)
    cell.stream([turned(0.5 * number) for number in range(1, 21)])
    cell.clock.advance(PERIOD)
    assert (cell.arm.error, cell.arm.slave_mode) == (0, mode)
    return cell


@LATE
def test_the_detector_of_a_ve026a_waits(late):
    cell = ve026a(SYNC)
    cell.clock.advance(late)
    cell.stream([turned(0.5 * number) for number in range(21, 30)])
    assert (cell.arm.error, cell.arm.slave_mode) == (0, SYNC)
    assert cell.arm.set_point_lateness == Lateness(1, pytest.approx(late), pytest.approx(late))
    assert cell.execute("slvGetLateness") == pytest.approx([1.0, late, late])
    assert cell.execute("slvGetLateness", 1) == [0.0, 0.0, 0.0]


def test_the_detector_of_a_ve026a_strikes_after_250_ms():
    cell = ve026a(SYNC)
    cell.clock.advance(0.249)
    assert cell.arm.error == 0
    cell.clock.advance(0.002)
    assert (cell.arm.error, cell.arm.slave_mode) == (SET_POINT_MISSED, 0)
    cell.rest()


def test_the_detector_of_a_strict_ve026a_strikes_at_once():
    cell = VeCell(strict_time=True).on(SYNC)
    cell.stream([turned(0.5 * number) for number in range(1, 21)])
    cell.clock.advance(PERIOD)
    assert (cell.arm.error, cell.arm.slave_mode) == (SET_POINT_MISSED, 0)


def test_asynchronous_mode_of_a_ve026a_has_no_detector():
    """Without a new set-point the arm stays at the last one; no set-point is late."""
    cell = ve026a(ASYNC)
    cell.clock.advance(1.0)
    assert (cell.arm.error, cell.arm.slave_mode, cell.arm.set_point_lateness) == (0, ASYNC, Lateness())


def test_a_ve026a_logs_it_once(caplog):
    cell = ve026a(SYNC)
    cell.clock.advance(0.05)
    cell.stream([turned(0.5 * number) for number in range(21, 30)])
    with caplog.at_level(logging.WARNING):
        cell.execute("slvChangeMode", 0)
    (record,) = [each for each in caplog.records if each.levelno == logging.WARNING]
    assert "1 late set-point, by 50 ms" in record.getMessage()


def test_positions_are_waited_for_too():
    """Elastic time is the same for every pose type."""
    cell = SlaveCell(strict_time=False)
    start = cell.execute("CurPos")
    cell.on(P0)
    for step in range(30):
        cell.robot.execute("slvMove", variant([start[0], start[1] + 0.02 * step * (step + 1) / 2, *start[2:]]))
        cell.cycle()
    cell.clock.advance(PERIOD + 0.1)
    assert (cell.error, cell.mode) == (0, P0)
    cell.rc8.close()
