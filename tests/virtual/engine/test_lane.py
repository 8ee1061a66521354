"""The thread for long work: order of its jobs, errors, and closing."""

from __future__ import annotations

import threading

import pytest

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.engine.lane import Lane, LaneLimits
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
    monkeypatch.setattr("orinkit.virtual.engine.lane._IDLE_TIME", 0.001)
    lane, threads = Lane("test", Clock()), list[threading.Thread]()
    for _ in range(3):
        until(lane.run(lambda: threads.append(threading.current_thread())).done)
        until(lambda: not threads[-1].is_alive())
    assert len(set(threads)) == 3


def test_with_a_manual_clock_jobs_are_run_immediately():
    lane = Lane("test", ManualClock())
    assert lane.run(lambda: threading.current_thread()) is threading.current_thread()
