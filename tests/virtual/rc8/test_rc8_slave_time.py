"""Slave mode of the virtual RC8 in a server that is late: its delays are not blamed on the client.

Time is strict here, so that each case is visible; elastic time (``test_rc8_elastic_time.py``) would wait for the
client.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit.arms import load_model
from orinkit.cao.functions import controller_connect, controller_get_variable_names
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.core import hresult
from orinkit.server.aio_server import AsyncServer
from orinkit.values.variant import variant
from orinkit.virtual.engine.catch_up import gentlest_path
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.robot.motor import MotorState
from support.late_cell import MOVING, POSES, LateCell, moving
from support.peers import RawClient
from support.slave_cell import HOME, J0, J1, J2, SlaveCell, sine

VS050 = load_model("VS-050")
SOON = 20.0
STALL = 0.05


@pytest.fixture(params=[J0, J2], ids=["mode 0", "mode 2"])
def late(request) -> Iterator[LateCell]:
    made = LateCell(request.param)
    yield made
    made.close()


NEXT = POSES[MOVING]


# --- modes 0 and 2 ----------------------------------------------------------------------------------------------------


def test_a_stall_with_a_set_point_that_waits_is_no_error(late):
    """The server did not run for 50 ms; the set-point is in the socket."""
    moving(late)
    number = late.cycles_.number
    late.wire.arrived.append(lambda: late.call(NEXT))
    late.drive(STALL)
    assert (late.cycles_.number, len(late.wire.asked)) == (number, 1)
    late.read()
    assert (late.cycles_.number, late.arm.queue.joints, late.error) == (number + 1, NEXT, 0)
    assert late.due_in == pytest.approx(PERIOD)
    late.stream(POSES[MOVING + 1 :])
    assert (late.error, late.on) == (0, True)


def test_cycles_without_a_chance_of_a_set_point_are_left_out(late):
    """The buffer was full when the server stood still; it is not played at once afterwards."""
    moving(late)
    for pose in POSES[MOVING : MOVING + 3]:
        late.call(pose)
    number, seconds = late.cycles_.number, late.rc8.state.last_cycle_time
    pause = late.drive(STALL)
    assert late.cycles_.number == number + 1
    assert late.arm.queue.joints == POSES[MOVING]
    assert not late.wire.asked
    assert pause == pytest.approx(PERIOD)
    assert late.rc8.state.last_cycle_time == pytest.approx(seconds + PERIOD)
    late.drive(PERIOD / 2)
    assert late.cycles_.number == number + 1
    late.drive(PERIOD / 2)
    assert (late.cycles_.number, late.arm.queue.joints) == (number + 2, POSES[MOVING + 1])
    late.stream(POSES[MOVING + 3 :])
    assert late.error == 0


def test_a_buffer_that_is_truly_empty_is_an_error(late):
    moving(late)
    pause = late.drive(PERIOD)
    assert (late.error, len(late.wire.asked)) == (0, 1)
    assert pause == PERIOD  # the wait is not for the thread
    late.hand.seconds += 0.0005
    late.read()
    assert (late.error, late.on) == (hresult.COMMAND_DELAY, False)
    for _ in range(100):
        late.drive(PERIOD)
    bends = np.diff(np.array(late.commands), 2, axis=0)[MOVING - 1 :, 0] / PERIOD**2
    assert np.abs(bends).max() <= VS050.axes[0].acceleration * (1 + 1e-6)
    assert late.arm.motor.state is MotorState.OFF
    assert not late.wire.asked


def test_draining_is_requested_once(late):
    moving(late)
    late.drive(PERIOD)
    for _ in range(20):
        with late.rc8.guard:
            pass
        late.drive(PERIOD / 100)
    assert len(late.wire.asked) == 1
    assert late.error == 0
    late.read()
    assert late.error == hresult.COMMAND_DELAY


def test_a_set_point_handled_during_draining_is_accepted(late):
    """A set-point that arrived on time but was not read yet: the cycle continues with it and the grid stays."""
    moving(late)
    boundary = late.hand.seconds + late.due_in
    late.wire.arrived.append(lambda: late.call(NEXT))
    late.drive(late.due_in + 0.0003)
    assert late.arm.queue.joints == POSES[MOVING - 1]
    late.hand.seconds += 0.0005
    late.read()
    assert (late.arm.queue.joints, late.error) == (NEXT, 0)
    assert late.hand.seconds + late.due_in == pytest.approx(boundary + PERIOD)
    late.stream(POSES[MOVING + 1 :])
    assert late.error == 0


def test_a_set_point_before_the_end_of_draining_is_accepted_at_once(late):
    moving(late)
    late.drive(PERIOD)
    late.call(NEXT)
    late.drive()
    assert (late.arm.queue.joints, late.error) == (NEXT, 0)
    late.read()  # a reply to a call that has ended
    assert (late.arm.queue.joints, late.error) == (NEXT, 0)


def test_a_client_that_could_not_be_answered_gets_a_period(late):
    """50 ms after the last set-point nothing has arrived: its reply may have been late. This is accepted only once."""
    moving(late)
    late.drive(STALL)
    late.read()
    assert (late.error, late.on) == (0, True)
    late.hand.seconds += PERIOD / 2
    late.call(NEXT)
    late.drive()
    assert late.due_in == pytest.approx(PERIOD)
    assert (late.arm.queue.joints, late.error) == (NEXT, 0)
    late.drive(STALL)
    late.read()
    late.drive(PERIOD)
    assert (late.error, len(late.wire.asked)) == (0, 1)
    late.read()
    assert late.error == hresult.COMMAND_DELAY


def test_slow_draining_is_a_delay_of_the_server(late):
    """The clock's thread was on time, the reading thread was not."""
    moving(late)
    late.drive(PERIOD)
    late.drive(STALL)
    late.read()
    assert late.error == 0
    late.drive(PERIOD)
    late.drive(STALL)
    late.read()
    assert late.error == hresult.COMMAND_DELAY


def test_without_anybody_to_ask_it_is_decided_at_once():
    cell = moving(LateCell(wired=False))
    cell.drive(PERIOD)
    assert cell.error == hresult.COMMAND_DELAY
    cell.close()


def test_draining_may_end_at_once(late):
    """Without input in transit: it calls back before it returns."""
    moving(late)
    late.wire.when_input_processed = None
    pace = late.cycles_.pace
    pace._when_input_processed = lambda handled: handled()
    late.drive(PERIOD)
    assert late.error == hresult.COMMAND_DELAY


def test_draining_that_delivers_the_set_point_at_once():
    cell = moving(LateCell())

    def look(handled: Callable[[], None]) -> None:
        cell.call(NEXT)
        handled()

    cell.cycles_.pace._when_input_processed = look
    cell.drive(PERIOD)
    assert (cell.arm.queue.joints, cell.error) == (NEXT, 0)
    cell.close()


def test_draining_that_never_ends_is_given_up(late):
    """The loop was closed while the input was drained."""
    moving(late)
    late.hand.patience = 20.0
    late.drive(PERIOD)
    for _ in range(4):
        late.drive(1.0)
    assert (late.error, len(late.wire.asked)) == (0, 1)
    for _ in range(3):
        late.drive(1.0)
    assert late.error == hresult.COMMAND_DELAY


def test_standstill_needs_no_draining(late):
    late.stream([POSES[0], POSES[0]])
    for _ in range(20):
        late.drive(STALL)
    assert (late.wire.asked, late.error, late.on) == ([], 0, True)
    late.call(HOME)
    late.drive(PERIOD)
    assert late.arm.queue.joints == HOME


def test_leaving_needs_no_draining(late):
    moving(late)
    with late.rc8.guard:
        leaving = late.robot.execute("slvChangeMode", variant(0))
    for _ in range(100):
        late.drive(PERIOD)
    assert leaving.done()
    assert (late.wire.asked, late.error, late.on) == ([], 0, False)


def test_a_client_that_disconnects_during_draining(late):
    moving(late)
    late.drive(PERIOD)
    with late.rc8.guard:
        late.robot.release()
        late.controller.release()
    assert not late.on
    assert late.cycles_.pace is None
    for _ in range(100):
        late.drive(PERIOD)
    late.read()
    assert (late.error, late.arm.busy) == (0, False)


def test_an_emergency_stop_during_draining(late):
    moving(late)
    late.drive(PERIOD)
    late.rc8.pendant.emergency_stop()
    for _ in range(100):
        late.drive(PERIOD)
    late.read()
    assert (late.error, late.on, late.arm.motor.state) == (0, False, MotorState.OFF)


def test_draining_for_an_earlier_slave_mode_does_not_count(late):
    moving(late)
    late.drive(PERIOD)
    late.connect().get_robot("", "").halt("")
    for _ in range(100):
        late.drive(PERIOD)
    with late.rc8.guard:
        late.robot.execute("slvChangeMode", variant(J0))
    start = late.arm.queue.joints[0]
    stale, late.wire.asked = late.wire.asked, []
    late.stream([(start + pose[0], *HOME[1:]) for pose in POSES[:MOVING]])
    late.drive(PERIOD)
    for handled in stale:
        handled()
    assert (late.error, len(late.wire.asked)) == (0, 1)  # it still waits for its own
    late.read()
    assert late.error == hresult.COMMAND_DELAY


def test_draining_for_an_earlier_request_does_not_count(late):
    moving(late)
    late.drive(PERIOD)
    late.call(NEXT)
    late.drive()
    late.drive(PERIOD)
    first, second = late.wire.asked
    first()
    assert late.error == 0
    second()
    assert late.error == hresult.COMMAND_DELAY


def test_a_scaled_clock_is_the_same():
    """Only the duration of draining may depend on real time."""
    cell = moving(LateCell(scale=10.0))
    cell.hand.patience = 20.0
    cell.wire.arrived.append(lambda: cell.call(NEXT))
    cell.drive(STALL)
    cell.read()
    assert (cell.arm.queue.joints, cell.error, cell.due_in) == (NEXT, 0, pytest.approx(PERIOD))
    cell.drive(PERIOD)
    for _ in range(49):
        cell.drive(1.0)
    assert cell.error == 0
    cell.drive(1.1)  # draining is given up, and the client gets a period
    cell.drive(2 * PERIOD)
    assert cell.error == hresult.COMMAND_DELAY
    cell.close()


# --- the grid ---------------------------------------------------------------------------------------------------------


def test_a_thousand_cycles_on_time_do_not_drift(late):
    """Each set-point is late by slightly less than a quarter of a period."""
    circle = sine(1001, (0,))
    late.call(circle[0])
    late.drive(PERIOD)
    first = late.hand.seconds
    number = late.cycles_.number
    for index, pose in enumerate(circle[1:], 1):
        late.call(pose)
        delay = PERIOD / 4 * 0.99 * abs(math.sin(index))
        late.hand.seconds = first + index * PERIOD + delay
        late.drive()
        assert late.cycles_.number == number + index
        assert late.due_in == pytest.approx(PERIOD - delay, abs=1e-9)
    assert (late.error, late.arm.queue.joints) == (0, circle[-1])


@pytest.mark.parametrize(
    ("delay", "left"), [(0.0019, 0.0061), (0.0021, 0.008), (0.0079, 0.008), (0.0081, 0.008), (0.2, 0.008)]
)
def test_the_grid_moves_for_a_stall(late, delay, left):
    moving(late)
    late.call(NEXT)
    late.drive(late.due_in + delay)
    assert late.arm.queue.joints == NEXT
    assert late.due_in == pytest.approx(left)


def test_time_never_goes_back(late):
    moving(late)
    times = [late.rc8.state.last_cycle_time]
    for index in range(MOVING, 150):
        late.call(POSES[index])
        late.drive(PERIOD if index % 7 else STALL)
        late.wire.read()
        times.append(late.rc8.state.last_cycle_time)
    assert late.error == 0
    assert all(later > earlier for earlier, later in pairwise(times))


def test_a_clock_by_hand_leaves_nothing_out():
    """Steps by tests: several cycles at once count as several cycles."""
    cell = SlaveCell()
    cell.on(J0)
    for pose in POSES[:3]:
        cell.send(pose)
    number = cell.rc8.state.cycles.number
    cell.clock.advance(3 * PERIOD)
    assert cell.rc8.state.cycles.number == number + 3
    assert cell.arm.queue.joints == POSES[2]
    cell.clock.advance(3 * PERIOD)
    assert cell.error == hresult.COMMAND_DELAY
    cell.close()


def test_other_cycles_are_as_ever_when_it_is_off():
    cell = LateCell()
    with cell.rc8.guard:
        cell.robot.execute("slvChangeMode", variant(0))
        assert cell.cycles_.pace is None
        cell.robot.move(1, variant("J(20, 45, 90, 0, 45, 0)"), "NEXT")
    number = cell.cycles_.number
    cell.drive(10 * PERIOD)
    assert cell.cycles_.number == number + 10
    cell.close()


# --- mode 1 -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def newest() -> Iterator[LateCell]:
    made = LateCell(J1)
    yield made
    made.close()


def bends(commands: Any) -> Any:
    return np.abs(np.diff(np.array(commands)[:, 0], 2)).max() / PERIOD**2


@pytest.fixture
def every_cycle(newest, monkeypatch) -> list[tuple[float, ...]]:
    """The command of each cycle, even if several are run at once."""
    seen: list[tuple[float, ...]] = []
    step = newest.arm.servo.step
    monkeypatch.setattr(newest.arm.servo, "step", lambda command: (seen.append(command), step(command))[1])
    return seen


def test_set_points_that_were_overwritten_in_a_stall_are_bridged(newest, every_cycle):
    """Six cycles late while the client continued: the newest set-point is six steps ahead."""
    moving(newest)
    number, boundary = newest.cycles_.number, newest.hand.seconds + newest.due_in
    newest.wire.arrived.append(lambda: newest.call(POSES[MOVING + 5]))
    newest.drive(6 * PERIOD + 0.001)
    assert (newest.cycles_.number, len(newest.wire.asked)) == (number, 1)
    newest.read()
    assert newest.cycles_.number == number + 6
    assert every_cycle[-6:] == [pytest.approx(pose) for pose in POSES[MOVING : MOVING + 6]]
    assert every_cycle[-1] == POSES[MOVING + 5]
    assert newest.hand.seconds + newest.due_in == pytest.approx(boundary + 6 * PERIOD)
    newest.stream(POSES[MOVING + 6 :])
    assert newest.error == 0


def test_the_newest_set_point_is_waited_for_where_there_is_an_older_one(newest, every_cycle):
    """Three cycles late; one set-point has been read, the next two have not."""
    moving(newest)
    newest.call(NEXT)
    newest.wire.arrived += [lambda: newest.call(POSES[MOVING + 1]), lambda: newest.call(POSES[MOVING + 2])]
    newest.drive(3 * PERIOD)
    assert newest.arm.queue.joints == POSES[MOVING - 1]
    newest.read()
    assert every_cycle[-3:] == [pytest.approx(pose) for pose in POSES[MOVING : MOVING + 3]]


def test_a_client_that_could_not_send_continues_where_it_was(newest, every_cycle):
    """The client waited for its reply for 50 ms: the next set-point is one step ahead, and one cycle is run for it."""
    moving(newest)
    number = newest.cycles_.number
    newest.wire.arrived.append(lambda: newest.call(NEXT))
    newest.drive(STALL)
    newest.read()
    assert (newest.cycles_.number, newest.arm.queue.joints) == (number + 1, NEXT)
    assert newest.due_in == pytest.approx(PERIOD)
    newest.stream(POSES[MOVING + 1 : 90])
    assert newest.error == 0
    assert bends(every_cycle[MOVING:]) < 1


def test_a_client_with_a_fixed_schedule_catches_up(newest, every_cycle):
    """After a late set-point the client continues on schedule; the missed cycles are made up for."""
    moving(newest)
    number, began = newest.cycles_.number, newest.rc8.state.last_cycle_time
    newest.wire.arrived.append(lambda: newest.call(NEXT))
    newest.drive(6 * PERIOD)
    newest.read()
    newest.call(POSES[MOVING + 6])
    newest.drive(PERIOD)
    newest.read()
    assert newest.error == 0
    assert newest.cycles_.number == number + 7
    assert newest.rc8.state.last_cycle_time == pytest.approx(began + 7 * PERIOD)
    assert bends(every_cycle[MOVING:]) < 1
    newest.stream(POSES[MOVING + 7 : 90])
    assert newest.error == 0


def test_time_that_is_owed_is_forgotten_after_a_second(newest):
    moving(newest)
    newest.wire.arrived.append(lambda: newest.call(NEXT))
    newest.drive(STALL)
    newest.read()
    end = POSES[-1][0]
    newest.stream([*POSES[MOVING + 1 :], *((end + step, *HOME[1:]) for step in range(1, 11))])
    newest.call((end + 16.0, *HOME[1:]))
    newest.drive(PERIOD)
    newest.read()
    assert newest.error == hresult.SENT_SPEED_OVER_AXIS1


def test_nothing_new_is_holding_still(newest, every_cycle):
    """As with set-points on time: it stays in place, too abruptly for this velocity."""
    moving(newest)
    newest.drive(STALL)
    newest.read()  # it gets a period
    assert newest.error == 0
    newest.drive(PERIOD)
    newest.read()
    assert newest.error == hresult.COMMAND_ACCELERATION_OVER_AXIS1


def test_nothing_new_at_low_speed_is_no_error(newest, every_cycle):
    slow = [(0.01 * index, *HOME[1:]) for index in range(40)]
    newest.stream(slow[:20])
    for _ in range(2):
        newest.drive(STALL)
        newest.read()
    assert (newest.error, newest.arm.queue.joints, newest.on) == (0, slow[19], True)
    newest.stream(slow[20:])
    assert newest.error == 0


def test_input_of_a_slow_client_in_mode_1_is_drained_only_if_it_matters(newest):
    newest.stream([HOME])
    newest.drive(PERIOD)
    newest.drive(PERIOD / 2)
    assert not newest.wire.asked


def test_the_limits_are_larger_for_a_while(newest):
    """Limits twice as large for the late cycles and two more; then as before."""
    moving(newest)
    newest.wire.arrived.append(lambda: newest.call(POSES[MOVING + 5]))
    newest.drive(6 * PERIOD)
    newest.read()
    most = VS050.axes[0].slave_acceleration * 1.25 * PERIOD**2
    place = POSES[MOVING + 5][0]
    steps = [1.0 + 1.9 * most, 1.0 + 3.7 * most, 1.0 + 5.5 * most]
    for step, code in zip(steps, (0, 0, hresult.COMMAND_ACCELERATION_OVER_AXIS1), strict=True):
        place += step
        newest.call((place, *HOME[1:]))
        newest.drive(PERIOD)
        newest.read()
        assert newest.error == code


@pytest.mark.parametrize("ahead", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("most", [1, 2, 5, 8])
def test_a_bridge_takes_the_cycles_that_it_needs(ahead, most):
    """At constant velocity, as many cycles as the set-point is steps ahead."""
    before, now = (0.0,) * 6, (1.0, -0.5, 0.0, 0.2, 0.0, 0.0)
    goal = tuple(q + ahead * q for q in now)
    way = gentlest_path(VS050, before, now, goal, most)
    assert len(way) == min(ahead, most)
    assert way[-1] == goal
    if ahead <= most:
        assert np.diff(np.array([before, now, *way]), 2, axis=0) == pytest.approx(np.zeros((len(way), 6)), abs=1e-12)


def test_a_bridge_from_rest_takes_all_the_time_there_is():
    way = gentlest_path(VS050, HOME, HOME, (3.6, *HOME[1:]), 6)
    assert [joints[0] for joints in way] == pytest.approx([0.1, 0.4, 0.9, 1.6, 2.5, 3.6])


# --- over the network -------------------------------------------------------------------------------------------------


class Heard(Provider):
    """Records the callers and the requested variable names."""

    provider_names = ("*",)

    def __init__(self) -> None:
        self.client: ClientInfo | None = None
        self.names: list[str] = []

    def connect(self, name, machine, option, client):
        self.client = client
        heard = self.names

        class Controller(ControllerObject):
            def get_variable_names(self, option):
                heard.append(option)
                return []

        return Controller(name)


@pytest.mark.parametrize("ask_from_loop", [True, False])
def test_draining_over_tcp(ask_from_loop):
    """Input in the socket at the time of the request has been handled when draining ends."""
    provider = Heard()

    async def main() -> None:
        async with AsyncServer(provider, "tcp://127.0.0.1:0") as server:
            client = await asyncio.to_thread(RawClient, server.url)
            handle = await asyncio.to_thread(client.ask, controller_connect.id, "c", "x", "", "")
            assert provider.client.when_input_processed is not None
            for turn in range(100):
                over, seen = asyncio.Event(), []

                def handled(over=over, seen=seen) -> None:
                    seen.extend(provider.names)
                    over.set()

                client.request(controller_get_variable_names.id, handle, str(turn))  # this thread runs the loop
                if ask_from_loop:
                    provider.client.when_input_processed(handled)
                else:
                    asking = threading.Thread(target=provider.client.when_input_processed, args=(handled,))
                    asking.start()
                    asking.join(SOON)
                assert not seen
                await asyncio.wait_for(over.wait(), SOON)
                assert seen == [str(number) for number in range(turn + 1)]
                await asyncio.to_thread(client.packet)
            client.socket.close()

    asyncio.run(main())


def test_draining_when_the_loop_is_closed():
    provider = Heard()
    with orinkit.serve(provider, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, provider="x"):
        look = provider.client.when_input_processed
    called = []
    look(lambda: called.append(threading.current_thread()))
    assert called == [threading.current_thread()]


@pytest.mark.parametrize("mode", [J0, J2])
def test_a_stream_over_tcp_survives_a_server_that_stands_still(mode):
    """The controller is blocked for 50 ms repeatedly while set-points are streamed."""
    device = VirtualRC8(motor=True)
    stop = threading.Event()

    def disturb() -> None:
        while not stop.wait(0.07):
            with device.guard:
                threading.Event().wait(0.05)

    disturber = threading.Thread(target=disturb, daemon=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url) as rc8:
        robot = rc8.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        robot.execute("slvChangeMode", mode)
        disturber.start()
        try:
            for pose in [*sine(101, (0, 1)), HOME, HOME]:
                while True:
                    try:
                        robot.execute("slvMove", [*pose, 0.0, 0.0])
                        break
                    except orinkit.CallError as error:
                        assert error.code == hresult.E_BUF_FULL  # noqa: PT017 - not every case raises
                        threading.Event().wait(0.002)
            robot.execute("slvChangeMode", 0)
        finally:
            stop.set()
            disturber.join(SOON)
        assert robot.execute("slvGetMode") == 0
        assert rc8.variable("@ERROR_CODE").value == 0
        assert device.state.arm.queue.joints == pytest.approx(HOME)
        assert device.state.faults.log.newest is None or device.state.faults.code == 0


def test_a_client_that_stops_sending_over_tcp_is_an_error():
    device = VirtualRC8(motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url) as rc8:
        robot = rc8.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        robot.execute("slvChangeMode", J2)
        for pose in sine()[:30]:
            robot.execute("slvMove", [*pose, 0.0, 0.0])
        deadline = time.monotonic() + SOON
        while not device.state.faults.code and time.monotonic() < deadline:
            threading.Event().wait(0.01)
        assert device.state.faults.code == hresult.COMMAND_DELAY
        with pytest.raises(orinkit.CallError) as refused:
            robot.execute("slvMove", [*HOME, 0.0, 0.0])
        assert refused.value.code == hresult.COMMAND_DELAY


def test_a_disconnected_client_leaves_the_arm_at_standstill():
    device = VirtualRC8(motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        with orinkit.connect(server.url) as rc8:
            robot = rc8.robot("Arm")
            robot.execute("TakeArm", [0, 0])
            robot.execute("slvChangeMode", J2)
            for pose in sine()[:30]:
                robot.execute("slvMove", [*pose, 0.0, 0.0])
        deadline = time.monotonic() + SOON
        while (device.state.arm.busy or device.state.arm.slave.on) and time.monotonic() < deadline:
            threading.Event().wait(0.01)
        with device.guard:
            assert not device.state.arm.busy
            assert not device.state.arm.slave.on
            assert device.state.cycles.pace is None
