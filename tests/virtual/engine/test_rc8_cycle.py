"""The 8 ms cycle and its clock: order of steps, catching up, failures, threads."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest

from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.engine.control_loop import PERIOD, ControlLoop
from orinkit.virtual.rc8 import VirtualRC8

SOON = 20.0
"""Seconds that a busy computer may need for something that takes none."""


class Steps:
    """A task that is busy for a number of cycles."""

    def __init__(self, todo: int = 0, log: list[str] | None = None, name: str = "") -> None:
        self.todo = todo
        self.done = 0
        self.idle = threading.Event()
        self.then: Callable[[], None] = lambda: None
        self._log = [] if log is None else log
        self._name = name

    def step(self) -> bool:
        self.done += 1
        self.todo = max(0, self.todo - 1)
        self._log.append(self._name)
        self.then()
        if not self.todo:
            self.idle.set()
        return self.todo > 0


def fail(error: Exception) -> None:
    raise AssertionError from error


def made(clock: Clock, *parts: Steps, on_error: Callable[[Exception], None] = fail) -> ControlLoop:
    cycles = ControlLoop(clock)
    cycles.add(*parts, on_error=on_error)
    return cycles


def wake(cycles: ControlLoop, part: Steps, todo: int) -> None:
    with cycles:
        part.idle.clear()
        part.todo += todo
        cycles.wake()


# --- with a clock that stands still -----------------------------------------------------------------------------------


def test_nothing_happens_while_there_is_nothing_to_do():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    clock.advance(10)
    assert (part.done, cycles.busy) == (0, False)
    assert cycles.last_cycle_time == pytest.approx(10)


def test_one_step_in_each_cycle_from_the_next_on():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    clock.advance(1.0)
    wake(cycles, part, 5)
    assert (part.done, cycles.busy, cycles.number) == (0, True, 125)
    clock.advance(PERIOD / 2)
    assert part.done == 0
    clock.advance(PERIOD / 2)
    assert (part.done, cycles.number) == (1, 126)
    clock.advance(3 * PERIOD)
    assert part.done == 4
    clock.advance(1.0)
    assert (part.done, cycles.busy) == (5, False)
    assert cycles.number == 130
    wake(cycles, part, 1)
    assert cycles.number == 254  # skipped cycles count
    clock.advance(PERIOD)
    assert part.done == 6


def test_waking_again_does_not_make_it_faster():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    for _ in range(10):
        wake(cycles, part, 1)
    clock.advance(4 * PERIOD)
    assert part.done == 4


def test_catching_up_misses_nothing():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    wake(cycles, part, 10_000)
    clock.advance(20.0)
    assert (part.done, cycles.number) == (2500, 2500)
    for _ in range(1000):
        clock.advance(0.0079)
    assert part.done == int((20 + 7.9) / PERIOD + 1e-9)
    assert cycles.last_cycle_time <= clock.now() < cycles.last_cycle_time + PERIOD


def test_tasks_step_in_order_while_one_of_them_is_busy():
    clock, log = ManualClock(), []
    first, second, third = Steps(2, log, "a"), Steps(0, log, "b"), Steps(3, log, "c")
    cycles = made(clock, first, second)
    cycles.add(third, on_error=fail)
    with cycles:
        cycles.wake()
    clock.advance(1.0)
    assert log == list("abc") * 3
    assert not cycles.busy


def test_entering_the_lock_runs_due_cycles():
    """A clock may not call in time; entering the lock runs the cycles that are due."""
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    wake(cycles, part, 100)
    clock._seconds += 10 * PERIOD
    with cycles:
        assert part.done == 10
        with cycles:
            assert part.done == 10


def test_a_task_may_enter_the_lock_and_wake_the_cycle():
    """A task woken in the last step of all is run, although that step returned False."""
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)

    def then() -> None:
        with cycles:
            if part.done == 3:
                part.idle.clear()
                cycles.wake()

    part.then = then
    wake(cycles, part, 3)
    clock.advance(1.0)
    assert part.done == 4
    assert not cycles.busy


def test_patience_has_an_end():
    """A device that could not keep up lags; it does not jump."""
    clock, part = ManualClock(), Steps()
    clock.patience = 0.25
    cycles = made(clock, part)
    wake(cycles, part, 100_000)
    clock.advance(0.25)
    assert part.done == 31
    clock.advance(10.0)
    assert part.done == 31 + 31
    assert cycles.last_cycle_time == cycles.number * PERIOD  # the remaining time does not exist for the controller
    clock.advance(0.08)
    assert part.done == 31 + 31 + 10
    assert cycles.number == part.done


def test_a_task_that_raises_stops_neither_the_others_nor_time(caplog):
    clock, told = ManualClock(), []
    bad, good = Steps(), Steps()
    cycles = made(clock, bad, good, on_error=told.append)

    def then() -> None:
        if bad.done in (1, 3):
            raise ZeroDivisionError(str(bad.done))

    bad.then = then
    wake(cycles, good, 5)
    clock.advance(1.0)
    assert (bad.done, good.done) == (5, 5)
    assert [str(error) for error in told] == ["1", "3"]
    assert [record.exc_info[0] for record in caplog.records if record.exc_info] == [ZeroDivisionError] * 2


def test_the_error_callback_may_wake_the_cycle_and_may_raise(caplog):
    """An arm that was moving when an error occurred is still brought to rest."""
    clock, told = ManualClock(), []

    def failed(error: Exception) -> None:
        told.append(error)
        cycles.wake()
        raise RuntimeError("too")

    bad = Steps()
    cycles = made(clock, bad, on_error=failed)

    def then() -> None:
        if bad.done == 1:
            raise ValueError

    bad.then = then
    wake(cycles, bad, 0)
    with caplog.at_level(logging.CRITICAL, "orinkit.rc8"):
        clock.advance(1.0)
    assert bad.done == 2
    assert len(told) == 1
    assert not cycles.busy


def test_the_lock_is_released_after_any_exception_of_a_step():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)

    def then() -> None:
        if part.done == 1:
            raise KeyboardInterrupt

    part.then = then
    wake(cycles, part, 3)
    with pytest.raises(KeyboardInterrupt):
        clock.advance(PERIOD)
    entered = threading.Event()

    def enter() -> None:
        with cycles:
            entered.set()

    other = threading.Thread(target=enter, daemon=True)
    other.start()
    assert entered.wait(SOON)
    other.join(SOON)
    clock.advance(1.0)
    assert not cycles.busy


def test_after_close_nothing_steps():
    clock, part = ManualClock(), Steps()
    cycles = made(clock, part)
    wake(cycles, part, 100)
    clock.advance(3 * PERIOD)
    cycles.close()
    clock.advance(1.0)
    wake(cycles, part, 5)
    with cycles:
        clock.advance(1.0)
    assert part.done == 3
    assert not cycles.busy
    cycles.close()


def test_an_arm_that_breaks_in_the_middle_of_a_move_is_an_error_of_the_controller(caplog, threads):
    clock = ManualClock()
    rc8 = VirtualRC8(clock=clock, motor=True)
    rc8.state.cycles.add(part := Steps(), on_error=rc8.state._crashed)

    def then() -> None:
        if part.done == 1:
            raise OSError("broken")

    part.then = then
    with caplog.at_level(logging.CRITICAL, "orinkit.rc8"), rc8.state.cycles:
        rc8.state.cycles.wake()
    clock.advance(1.0)
    assert rc8.state.faults.code == 0x83500115
    assert "broken" in rc8.state.faults.message
    assert not rc8.state.arm.motor.on
    rc8.close()


# --- with time that passes by itself ----------------------------------------------------------------------------------


def running() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "orinkit-device"}


Threads = Callable[[], set[threading.Thread]]


@pytest.fixture(autouse=True)
def threads() -> Iterator[Threads]:
    """Yield the threads that drive the devices of a test; none may be left at its end."""
    before = running()
    yield lambda: running() - before
    for thread in running() - before:
        thread.join(SOON)
        assert not thread.is_alive()


@pytest.mark.parametrize("scale", [1, 20, 200])
def test_cycles_run_by_themselves_at_the_pace_of_the_clock(scale):
    clock, part = Clock(scale), Steps()
    cycles = made(clock, part)
    began = clock.now()
    wake(cycles, part, 25)
    assert part.idle.wait(SOON)
    assert clock.now() - began >= 24 * PERIOD
    with cycles:
        assert part.done == 25
        assert not cycles.busy
    cycles.close()


def test_the_thread_ends_when_idle_and_is_started_again(threads):
    clock, part = Clock(50), Steps()
    cycles = made(clock, part)
    assert not threads()
    for _ in range(3):
        with cycles:
            part.idle.clear()
            part.todo = 10
            cycles.wake()
            (thread,) = threads()
        assert thread.daemon
        assert part.idle.wait(SOON)
        thread.join(SOON)
        assert not thread.is_alive()
        assert not cycles.busy
    assert part.done == 30
    cycles.close()


def test_waking_from_many_threads_loses_nothing(threads):
    clock, part = Clock(100), Steps()
    cycles = made(clock, part)
    go = threading.Barrier(8)

    def work() -> None:
        go.wait(SOON)
        for _ in range(50):
            with cycles:
                part.idle.clear()
                part.todo += 2
                cycles.wake()

    workers = [threading.Thread(target=work) for _ in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(SOON)
    assert part.idle.wait(SOON)
    with cycles:
        assert part.todo == 0
        assert part.done == 800
    assert len(threads()) <= 1
    cycles.close()


def test_a_clock_much_too_fast_leaves_time_for_others():
    """It runs as fast as possible without blocking other threads."""
    clock, part = Clock(1_000_000), Steps()
    cycles = made(clock, part)
    wake(cycles, part, 1_000_000_000)
    began = time.monotonic()
    for _ in range(20):
        before = part.done
        with cycles:
            assert part.done > 0
        assert part.done - before < 1_000_000
    assert time.monotonic() - began < SOON
    cycles.close()


def test_closing_does_not_wait_for_a_slow_clock(threads):
    clock, part = Clock(0.001), Steps()  # a cycle is 8 s
    cycles = made(clock, part)
    wake(cycles, part, 10)
    (thread,) = threads()
    began = time.monotonic()
    cycles.close()
    assert time.monotonic() - began < 7
    assert not thread.is_alive()


# --- drivers ----------------------------------------------------------------------------------------------------------


def test_a_driver_does_nothing_before_it_is_woken(threads):
    clock = Clock()
    driver = clock.drive(lambda: pytest.fail("not woken"))
    assert not threads()
    driver.close()


def test_waking_while_the_device_is_at_work_calls_it_again(threads):
    calls: list[int] = []
    inside, go_on, twice = threading.Event(), threading.Event(), threading.Event()

    def advance() -> None:
        calls.append(len(calls))
        if len(calls) == 1:
            inside.set()
            go_on.wait(SOON)
        else:
            twice.set()

    driver = Clock().drive(advance)
    driver.wake()
    assert inside.wait(SOON)
    driver.wake()
    driver.wake()
    go_on.set()
    assert twice.wait(SOON)
    for thread in threads():
        thread.join(SOON)
    assert len(calls) == 2
    driver.close()


def test_waking_ends_a_pause():
    calls: list[int] = []
    paused, again = threading.Event(), threading.Event()

    def advance() -> float | None:
        calls.append(0)
        if len(calls) == 1:
            paused.set()
            return 1e9
        again.set()
        return None

    driver = Clock().drive(advance)
    driver.wake()
    assert paused.wait(SOON)
    driver.wake()
    assert again.wait(SOON)
    driver.close()


def test_pauses_are_of_the_devices_time():
    moments: list[float] = []
    done = threading.Event()
    clock = Clock(1000)

    def advance() -> float | None:
        moments.append(clock.now())
        if len(moments) == 5:
            done.set()
            return None
        return 2.0

    driver = clock.drive(advance)
    driver.wake()
    assert done.wait(SOON)
    assert all(later - earlier >= 1.9 for earlier, later in pairwise(moments))
    driver.close()


def test_closing_waits_for_the_call_in_progress(threads):
    inside, finished = threading.Event(), []

    def advance() -> float:
        inside.set()
        threading.Event().wait(0.05)  # it takes a while
        finished.append(True)
        return 0.0

    driver = Clock().drive(advance)
    driver.wake()
    assert inside.wait(SOON)
    driver.close()
    assert finished
    count = len(finished)
    driver.wake()
    driver.close()
    assert len(finished) == count
    assert not threads()


def test_a_device_may_close_its_driver_itself():
    closed = threading.Event()

    def advance() -> float:
        driver.close()
        closed.set()
        return 0.0

    driver = Clock().drive(advance)
    driver.wake()
    assert closed.wait(SOON)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_device_that_raises_can_be_woken_again(threads):
    calls: list[int] = []
    again = threading.Event()

    def advance() -> None:
        calls.append(0)
        if len(calls) == 1:
            raise ZeroDivisionError
        again.set()

    driver = Clock().drive(advance)
    driver.wake()
    for thread in threads():
        thread.join(SOON)
    driver.wake()
    assert again.wait(SOON)
    driver.close()


def test_a_manual_clock_drives_all_its_devices_in_order(threads):
    clock, log = ManualClock(), []
    drivers = [clock.drive(lambda name=name: log.append(name)) for name in "abc"]
    drivers[0].wake()  # nothing happens until the clock is moved
    assert not log
    clock.advance(0)
    assert log == ["a", "b", "c"]
    drivers[1].close()
    drivers[1].close()
    clock.advance(1)
    assert log[3:] == ["a", "c"]
    assert not threads()


def test_a_device_of_a_manual_clock_may_close_while_the_clock_is_moved():
    clock, log = ManualClock(), []
    first = clock.drive(lambda: (log.append("a"), first.close()))
    clock.drive(lambda: log.append("b"))
    clock.advance(1)
    clock.advance(1)
    assert log == ["a", "b", "b"]


@pytest.mark.parametrize("step", [-1e-9, float("nan"), float("inf"), float("-inf")])
def test_a_manual_clock_advances_by_finite_steps(step):
    clock = ManualClock()
    with pytest.raises(ValueError, match="clock"):
        clock.advance(step)
    assert clock.now() == 0
