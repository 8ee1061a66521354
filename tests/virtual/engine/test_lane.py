"""The thread for long work: order of its jobs, errors, and closing."""

from __future__ import annotations

import threading

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.engine.lane import Lane, LaneLimits
from orinkit.virtual.shared_clock import WORKERS, SharedClock
from support.busy import occupy
from support.waiting import PATIENCE, until


def failure(deferred: Deferred[object]) -> int:
    """Return the return code of a call that fails."""
    until(deferred.done)
    with pytest.raises(CallError) as raised:
        deferred.result()
    return raised.value.code


def test_jobs_are_run_one_at_a_time_in_their_order():
    lane, log = Lane("test", Clock()), list[int]()
    results = [lane.submit(lambda number=number: log.append(number) or number, Deferred()) for number in range(50)]
    until(results[-1].done)
    assert [each.result() for each in results] == log == list(range(50))
    lane.close(waits=True)


def test_an_exception_belongs_to_its_job_alone():
    lane = Lane("test", Clock())
    wrong, right = lane.run(lambda: 1 // 0), lane.run(lambda: 1)
    until(right.done)
    assert right.result() == 1
    with pytest.raises(ZeroDivisionError):
        wrong.result()
    lane.close(waits=True)


def test_a_job_whose_result_is_set_is_not_run():
    lane, going, ran = Lane("test", Clock()), threading.Event(), list[int]()
    lane.run(lambda: going.wait(PATIENCE))
    dropped = lane.submit(lambda: ran.append(1), Deferred())
    dropped.set_result()
    last = lane.run(lambda: None)
    going.set()
    until(last.done)
    assert not ran
    lane.close(waits=True)


def occupied(limits: LaneLimits | None = None) -> tuple[Lane, threading.Event]:
    """Return a lane whose thread is occupied until the event is set."""
    lane, going = Lane("test", Clock(), limits), threading.Event()
    occupy(lane, going)
    return lane, going


def test_clients_take_turns_and_the_jobs_of_each_are_run_in_their_order():
    lane, going = occupied()
    log = list[str]()
    jobs = [*("a1", "a2", "a3", "a4"), *("b1", "b2"), "c1"]
    calls = [lane.submit(lambda job=job: log.append(job), Deferred(), job[0]) for job in jobs]
    going.set()
    until(lambda: all(call.done() for call in calls))
    assert log == ["a1", "b1", "c1", "a2", "b2", "a3", "a4"]
    lane.close(waits=True)


def test_a_client_with_one_job_waits_for_one_job_of_another_client():
    lane, going = occupied()
    log = list[str]()
    lane.submit(lambda: lane.submit(lambda: log.append("small"), Deferred(), "b"), Deferred(), "a")
    for number in range(5):
        last = lane.submit(lambda number=number: log.append(f"large {number}"), Deferred(), "a")
    going.set()
    until(last.done)
    assert log.index("small") <= 1
    lane.close(waits=True)


def test_waiting_jobs_are_limited():
    lane, going = occupied(LaneLimits(jobs=3, of_client=2, seconds=PATIENCE))
    first = lane.submit(lambda: None, Deferred(), "a")
    lane.submit(lambda: None, Deferred(), "a")
    with pytest.raises(CallError) as of_client:
        lane.submit(lambda: None, Deferred(), "a")
    lane.submit(lambda: None, Deferred(), "b")
    with pytest.raises(CallError) as of_all:
        lane.submit(lambda: None, Deferred(), "c")
    assert of_client.value.code == of_all.value.code == hresult.E_BUSY_PROC
    first.set_result()  # a job that will not be run does not count
    last = lane.submit(lambda: None, Deferred(), "a")
    going.set()
    until(last.done)
    assert not lane._jobs
    lane.close(waits=True)


def test_a_job_that_has_waited_too_long_is_not_run(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("orinkit.virtual.engine.lane.monotonic", lambda: now[0])
    lane, going = occupied(LaneLimits(jobs=3, of_client=3, seconds=10.0))
    late = lane.submit(lambda: 1, Deferred())
    now[0] = 0.1
    in_time = lane.submit(lambda: 2, Deferred())
    now[0] = 10.05
    going.set()
    until(in_time.done)
    assert failure(late) == hresult.E_BUSY_PROC
    assert in_time.result() == 2
    lane.close(waits=True)


def test_closing_discards_the_waiting_jobs_and_waits_for_the_one_in_progress():
    lane, going, begun = Lane("test", Clock()), threading.Event(), threading.Event()
    running = lane.run(lambda: begun.set() or going.wait(PATIENCE))
    waiting = lane.run(lambda: None)
    assert begun.wait(PATIENCE)
    closing = threading.Thread(target=lambda: lane.close(waits=True))
    closing.start()
    assert failure(waiting) == hresult.E_ABORT
    assert closing.is_alive()
    going.set()
    closing.join(PATIENCE)
    assert running.result() is True
    with pytest.raises(CallError):
        lane.run(lambda: None)


def test_the_thread_ends_without_jobs_and_starts_again(monkeypatch):
    monkeypatch.setattr("orinkit.virtual.workers.IDLE_TIME", 0.001)
    lane, threads = Lane("test", Clock()), list[threading.Thread]()
    for _ in range(3):
        until(lane.run(lambda: threads.append(threading.current_thread())).done)
        until(lambda: not threads[-1].is_alive())
    assert len(set(threads)) == 3


def test_with_a_manual_clock_jobs_are_run_immediately():
    lane = Lane("test", ManualClock())
    assert lane.run(lambda: threading.current_thread()) is threading.current_thread()


# --- lanes of several controllers with one clock -----------------------------------------------------------------------


def test_lanes_of_a_shared_clock_share_a_few_threads():
    clock, going = SharedClock(), threading.Event()
    lanes = [Lane("test", clock) for _ in range(10 * WORKERS)]
    threads, lock = set[threading.Thread](), threading.Lock()

    def job() -> None:
        with lock:
            threads.add(threading.current_thread())
        assert going.wait(PATIENCE)

    results = [lane.run(job) for lane in lanes]
    until(lambda: len(threads) == WORKERS)
    going.set()
    until(lambda: all(result.done() for result in results))
    for result in results:
        result.result()
    assert len(threads) == WORKERS
    for lane in lanes:
        lane.close(waits=True)


def test_the_long_jobs_of_one_controller_occupy_one_of_the_shared_threads():
    clock, going = SharedClock(), threading.Event()
    slow, others = Lane("test", clock), [Lane("test", clock) for _ in range(10)]
    waiting = [slow.run(lambda: going.wait(PATIENCE)) for _ in range(10 * WORKERS)]
    results = [lane.run(lambda: None) for lane in others]
    until(lambda: all(result.done() for result in results))
    assert not any(each.done() for each in waiting)
    going.set()
    until(waiting[-1].done)
    for lane in (slow, *others):
        lane.close(waits=True)


def test_each_controller_waits_for_one_job_of_every_other_one():
    """Even if only one thread is left, because the other ones are occupied."""
    clock, going = SharedClock(), threading.Event()
    occupying = [Lane("test", clock) for _ in range(WORKERS - 1)]
    for lane in occupying:
        occupy(lane, going)
    lanes, log = [Lane("test", clock) for _ in range(5)], list[int]()
    gate = threading.Event()
    occupy(lanes[0], gate)
    results = [
        lane.run(lambda number=number: log.append(number)) for number, lane in enumerate(lanes) for _ in range(20)
    ]
    gate.set()
    until(lambda: all(result.done() for result in results))
    assert log == [1, 2, 3, 4, 0] * 20
    going.set()
    for lane in (*occupying, *lanes):
        lane.close(waits=True)


def test_closing_a_lane_leaves_the_jobs_of_other_lanes():
    clock, going = SharedClock(), threading.Event()
    one, other = Lane("test", clock), Lane("test", clock)
    running = other.run(lambda: going.wait(PATIENCE))
    later = other.run(lambda: 1)
    one.close(waits=True)
    going.set()
    until(later.done)
    assert (running.result(), later.result()) == (True, 1)
    other.close(waits=True)


def test_idle_threads_end_when_a_lane_is_closed(monkeypatch):
    monkeypatch.setattr("orinkit.virtual.workers.IDLE_TIME", 10 * PATIENCE)
    lane, threads = Lane("test", SharedClock()), list[threading.Thread]()
    until(lane.run(lambda: threads.append(threading.current_thread())).done)
    lane.close(waits=True)
    threads[0].join(PATIENCE)
    assert not threads[0].is_alive()
