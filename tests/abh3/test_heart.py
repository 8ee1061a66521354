"""The timing of a keep-alive, and the thread or task that calls it."""

from __future__ import annotations

import asyncio
import gc
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from typing import Any
from weakref import ref

import numpy as np
import pytest

from orinkit.abh3.api.keepalive_runner import AsyncPeriodicCall, PeriodicCall
from orinkit.abh3.session.host import Host
from orinkit.abh3.session.keepalive import KeepAliveEnd, KeepAliveTimer, report_commands
from orinkit.abh3.table.records import DP0R
from orinkit.can.frame import CanFrame, CanOperation
from orinkit.core import i18n
from orinkit.core.errors import DriverTimeout, InvalidValue

pytestmark = pytest.mark.core

LONG = 60.0  # longer than anything here takes
GREAT = pytest.param(10**5000, id="great")

# --- times ------------------------------------------------------------------------------------------------------------


def test_it_is_due_one_period_after_what_was_sent_last() -> None:
    heart = KeepAliveTimer(0.1, 0.5, None, 10.0)
    assert heart.next_time == pytest.approx(10.1)
    heart.sent(10.25, replied=True)
    assert heart.next_time == pytest.approx(10.35)
    heart.sent(10.5, replied=False)  # it does not send faster to a driver that does not reply
    assert heart.next_time == pytest.approx(10.6)
    heart.called(20.0)
    assert heart.next_time == pytest.approx(10.6)


def test_it_ends_when_the_driver_does_not_reply() -> None:
    heart = KeepAliveTimer(0.1, 0.5, None, 10.0)
    assert heart.end_reason(10.0) is None
    assert heart.end_reason(10.5) is None
    assert heart.end_reason(10.51) is KeepAliveEnd.SILENT
    heart.sent(10.5, replied=False)
    assert heart.end_reason(10.51) is KeepAliveEnd.SILENT
    heart.called(10.5)
    assert heart.end_reason(10.51) is KeepAliveEnd.SILENT
    heart.sent(10.5, replied=True)
    assert heart.end_reason(11.0) is None
    assert heart.end_reason(11.01) is KeepAliveEnd.SILENT


def test_it_ends_when_the_program_does_not_call() -> None:
    heart = KeepAliveTimer(0.1, 0.5, 2.0, 10.0)
    heart.sent(12.0, replied=True)
    assert heart.end_reason(12.0) is None
    assert heart.end_reason(12.01) is KeepAliveEnd.IDLE
    heart.called(12.0)
    assert heart.end_reason(12.01) is None
    heart.sent(13.9, replied=True)
    assert heart.end_reason(14.0) is None
    assert heart.end_reason(14.01) is KeepAliveEnd.IDLE
    assert (
        heart.end_reason(14.6) is KeepAliveEnd.SILENT
    )  # a driver that does not reply takes precedence: no stop can be sent to it


def test_without_an_idle_time() -> None:
    heart = KeepAliveTimer(0.1, 0.5, None, 0.0)
    heart.sent(1e6, replied=True)
    assert heart.end_reason(1e6) is None


def test_a_late_command_is_not_repeated() -> None:
    """The driver may have stopped on its own meanwhile; it must not start again."""
    heart = KeepAliveTimer(0.1, 0.5, None, 10.0)
    assert heart.end_reason_if_delayed(10.5) is None
    assert heart.end_reason_if_delayed(10.51) is KeepAliveEnd.SILENT
    heart.sent(10.5, replied=False)
    assert heart.end_reason_if_delayed(10.51) is KeepAliveEnd.SILENT
    heart.sent(10.5, replied=True)
    assert heart.end_reason_if_delayed(11.0) is None
    slow = KeepAliveTimer(0.4, 0.5, None, 10.0)  # the period is nearly as long as the patience
    assert slow.end_reason_if_delayed(10.6) is None
    assert slow.end_reason_if_delayed(10.61) is KeepAliveEnd.SILENT
    assert slow.end_reason(10.51) is KeepAliveEnd.SILENT


def test_a_reply_read_late_counts_from_its_command() -> None:
    """A program that was suspended reads the reply to an old command: the driver has stopped meanwhile."""
    heart = KeepAliveTimer(0.1, 0.5, None, 10.0)
    heart.sent(10.1, replied=True)  # read at 12.0
    assert heart.end_reason(12.0) is KeepAliveEnd.SILENT
    assert heart.end_reason_if_delayed(12.0) is KeepAliveEnd.SILENT


FEEDBACK = CanFrame(0x00EF0201, bytes.fromhex("F401000000000000"))


def carried_out(operation: CanOperation[Any], answers: Iterator[CanFrame | None]) -> Any:
    """Reply to each frame that is sent; let waits without a frame time out."""
    received = None
    try:
        while True:
            turn = operation.send(received)
            received = next(answers) if turn.frames else None
    except StopIteration as stop:
        return stop.value


def test_every_command_of_an_operation_counts_with_its_own_time() -> None:
    """Stopping takes longer than the patience, but the driver replies all the time."""
    host: Host[DP0R] = Host()
    heart = KeepAliveTimer(0.1, 0.5, 0.4, 0.0)
    times = iter((0.2, 0.5, 0.8, 1.1))
    operation = report_commands(host.stop_and_wait(2.0), heart, host, lambda: next(times))
    standing = CanFrame(0x00EF0201, bytes(8))
    carried_out(operation, iter((FEEDBACK, FEEDBACK, FEEDBACK, standing)))
    assert heart.next_time == pytest.approx(1.2)
    assert heart.end_reason_if_delayed(1.59) is None
    assert heart.end_reason(1.49) is None
    assert heart.end_reason(1.51) is KeepAliveEnd.IDLE
    assert heart.end_reason(1.61) is KeepAliveEnd.SILENT


def test_a_command_without_a_reply_does_not_count() -> None:
    host: Host[DP0R] = Host()
    heart = KeepAliveTimer(0.1, 0.5, None, 0.0)
    times = iter((0.2, 0.4))
    with pytest.raises(DriverTimeout):
        carried_out(report_commands(host.stop_and_wait(1.0), heart, host, lambda: next(times)), iter((FEEDBACK, None)))
    assert heart.next_time == pytest.approx(0.3)  # no reply to the second one
    assert heart.end_reason(0.69) is None
    assert heart.end_reason(0.71) is KeepAliveEnd.SILENT


def test_a_request_is_no_command() -> None:
    host: Host[DP0R] = Host()
    heart = KeepAliveTimer(0.1, 0.5, None, 0.0)
    answer = CanFrame(0x00FF2C01, bytes(8))
    carried_out(report_commands(host.request(4), heart, host, lambda: 1 / 0), iter((answer,)))
    assert heart.next_time == 0.1


def test_why_it_ends() -> None:
    assert [end.value for end in KeepAliveEnd] == ["silent", "idle"]


@pytest.mark.parametrize("name", ["period", "patience", "idle"])
@pytest.mark.parametrize("seconds", [0, -1.0, math.nan, math.inf, -math.inf, "1", True, 10**400, GREAT, 3600.1, 1j])
def test_invalid_times(name: str, seconds: Any) -> None:
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=name) as caught:
            KeepAliveTimer(**{"period": 0.1, "patience": 0.5, "idle": 2.0, "now": 0.0, name: seconds})
        assert len(str(caught.value)) < 120


@pytest.mark.parametrize("name", ["period", "patience", "idle"])
@pytest.mark.parametrize("seconds", [1, 0.25, Decimal("0.25"), Fraction(1, 4), np.float32(0.25), np.int64(1)])
def test_any_numeric_type_is_accepted(name: str, seconds: Any) -> None:
    heart = KeepAliveTimer(**{"period": 0.1, "patience": 2.0, "idle": None, "now": 0.0, name: seconds})
    found = getattr(heart, name)
    assert found == float(seconds)
    assert type(found) is float  # the result is a float


def test_shortest_and_longest_times() -> None:
    heart = KeepAliveTimer(0.001, 3600.0, 3600, 0.0)
    assert (heart.period, heart.patience, heart.idle) == (0.001, 3600.0, 3600.0)
    for tongue, text in (("en", "0.001 s or more"), ("ja", "0.001 秒以上")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            KeepAliveTimer(0.00099, 1.0, None, 0.0)


@pytest.mark.parametrize(("period", "patience"), [(0.5, 0.5), (2.0, 0.5), (Decimal("0.5"), Fraction(1, 2))])
def test_a_period_is_below_the_patience(period: Any, patience: Any) -> None:
    """Otherwise it would end before the second command, or wait longer than the driver does."""
    for tongue, text in (("en", "Try: a period of 0.1 s"), ("ja", "対処")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text) as caught:
            KeepAliveTimer(period, patience, None, 0.0)
        assert f"{float(period):g}" in str(caught.value)
        assert f"{float(patience):g}" in str(caught.value)


# --- a thread ---------------------------------------------------------------------------------------------------------


class Beating:
    """Counts its beats; the last of the pauses is repeated."""

    def __init__(self, *pauses: float | None) -> None:
        self.pauses = pauses
        self.beats = 0
        self.ends = 0
        self.seen = threading.Semaphore(0)
        self.thread: threading.Thread | None = None

    def beat(self) -> float | None:
        self.thread = threading.current_thread()
        pause = self.pauses[min(self.beats, len(self.pauses) - 1)]
        self.beats += 1
        self.seen.release()
        return pause

    def left(self) -> None:
        """Record that the calls ended unexpectedly."""
        self.ends += 1

    async def async_beat(self) -> float | None:
        return self.beat()

    async def beaten(self, beats: int) -> None:
        await _until(lambda: self.beats >= beats)

    def wait(self, beats: int) -> None:
        """Wait for a number of further beats."""
        for _ in range(beats):
            assert self.seen.acquire(timeout=LONG)


def ended(thread: threading.Thread | None) -> bool:
    assert thread is not None
    thread.join(LONG)
    return not thread.is_alive()


@pytest.fixture(autouse=True)
def _no_threads_are_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    for thread in set(threading.enumerate()) - before:
        assert ended(thread), thread


def test_it_beats_until_it_is_stopped() -> None:
    heart = Beating(0.001)
    keeper = PeriodicCall(heart.beat, heart.left, "a-name")
    heart.wait(5)
    assert heart.thread is not None
    assert (heart.thread.name, heart.thread.daemon) == ("a-name", True)
    keeper.stop()
    keeper.join()
    assert not heart.thread.is_alive()
    beats = heart.beats
    keeper.stop()  # a second call is harmless
    keeper.join()
    assert (heart.beats, heart.ends) == (beats, 0)


def test_it_beats_at_once_and_waits_then() -> None:
    heart = Beating(LONG)
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.wait(1)
    keeper.stop()
    keeper.join()  # does not wait for the end of the pause
    assert ended(heart.thread)
    assert (heart.beats, heart.ends) == (1, 0)


def test_it_ends_when_there_is_no_next_time() -> None:
    heart = Beating(0.0, 0.001, None)
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.wait(3)
    assert ended(heart.thread)
    assert (heart.beats, heart.ends) == (3, 0)  # the beat knows
    keeper.stop()


def test_it_ends_with_the_thread_that_began_it() -> None:
    heart = Beating(0.005)
    kept: list[PeriodicCall] = []
    owner = threading.Thread(target=lambda: kept.append(PeriodicCall(heart.beat, heart.left, "x")))
    owner.start()
    owner.join(LONG)
    assert len(kept) == 1
    heart.seen.acquire(timeout=0.2)  # there may have been a beat before it ended
    assert kept[0]._thread is not threading.main_thread()
    assert ended(kept[0]._thread)
    assert heart.ends == 1
    beats = heart.beats
    kept[0].stop()
    kept[0].join()
    assert (heart.beats, heart.ends) == (beats, 1)


def test_it_ends_with_the_object() -> None:
    heart = Beating(0.005)
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.wait(2)
    thread, seen = heart.thread, ref(heart)
    del heart
    assert ended(thread)
    gc.collect()
    assert seen() is None
    keeper.stop()


def test_it_does_not_keep_its_object_while_it_waits() -> None:
    heart = Beating(LONG)
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.wait(1)
    seen = ref(heart)
    del heart
    deadline = time.monotonic() + LONG
    while seen() is not None and time.monotonic() < deadline:  # the thread may still hold it for a moment
        gc.collect()
        time.sleep(0.001)
    assert seen() is None
    keeper.stop()


class StopsItself(Beating):
    """Calls stop() within a beat, as a driver that closes itself does."""

    keeper: PeriodicCall | AsyncPeriodicCall | None = None
    ready: threading.Event = threading.Event()

    def beat(self) -> float | None:
        assert self.ready.wait(LONG)
        assert self.keeper is not None
        self.keeper.stop()
        return super().beat()


def test_it_can_be_stopped_from_within() -> None:
    heart = StopsItself(0.0)
    heart.ready = threading.Event()
    heart.keeper = keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.ready.set()
    heart.wait(1)
    assert ended(heart.thread)
    assert (heart.beats, heart.ends) == (1, 0)
    keeper.stop()


class Slow(Beating):
    """Its beat takes as long as the test sets."""

    def __init__(self) -> None:
        super().__init__(0.0)
        self.at_work, self.go_on = threading.Event(), threading.Event()
        self.done = False

    def beat(self) -> float | None:
        self.at_work.set()
        assert self.go_on.wait(LONG)
        self.done = True
        return super().beat()


def test_only_join_waits_for_a_beat_in_progress() -> None:
    """After stop(), a driver may have to send something first."""
    heart = Slow()
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    assert heart.at_work.wait(LONG)
    keeper.stop()
    assert not heart.done
    heart.go_on.set()
    keeper.join()
    assert heart.done
    assert (heart.beats, heart.ends) == (1, 0)


def test_joining_has_a_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.abh3.api.keepalive_runner._JOIN_TIMEOUT", 0.05)
    heart = Slow()
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    assert heart.at_work.wait(LONG)
    keeper.stop()
    began = time.monotonic()
    keeper.join()
    assert time.monotonic() - began < LONG / 2
    assert not heart.done
    heart.go_on.set()


def test_a_beat_can_join_itself() -> None:
    class Joins(StopsItself):
        def beat(self) -> float | None:
            pause = super().beat()
            assert isinstance(self.keeper, PeriodicCall)
            self.keeper.join()
            return pause

    heart = Joins(0.0)
    heart.ready = threading.Event()
    heart.keeper = PeriodicCall(heart.beat, heart.left, "x")
    heart.ready.set()
    heart.wait(1)
    assert ended(heart.thread)


class Fails(Beating):
    """Its second beat raises."""

    def beat(self) -> float | None:
        if self.beats == 1:
            raise ZeroDivisionError("a bug")
        return super().beat()


def test_a_beat_that_raises_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The callback is called, and the exception goes to the hook for threads."""
    raised: list[object] = []
    monkeypatch.setattr(threading, "excepthook", lambda told: raised.append(told.exc_type))
    heart = Fails(0.0)
    keeper = PeriodicCall(heart.beat, heart.left, "x")
    assert ended(keeper._thread)
    assert (heart.beats, heart.ends) == (1, 1)
    assert raised == [ZeroDivisionError]


PROGRAM = """
import os, sys, threading
from orinkit.abh3.api.keepalive_runner import PeriodicCall

class Heart:
    def beat(self):
        os.write(1, b"beat\\n")
        return 0.005

    def left(self):
        os.write(1, b"left\\n")

heart = Heart()
keeper = PeriodicCall(heart.beat, heart.left, "x")
if "other" in sys.argv:  # another thread keeps the process alive

    def other():
        threading.main_thread().join()
        os.write(1, b"over\\n")  # print writes a line in two pieces, and others come in between
        sys.stdin.read()

    threading.Thread(target=other).start()
"""


def test_it_does_not_outlive_the_program() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, timeout=LONG, check=True)
    assert set(done.stdout.split()) <= {b"beat", b"left"}


def test_it_does_not_outlive_the_main_thread() -> None:
    """If other threads keep the process alive, only the beat in progress is completed."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "other"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        lines: list[str] = []
        while not {"over\n", "left\n"} <= set(lines):  # either may be the first
            lines.append(process.stdout.readline())
            assert lines[-1]
        time.sleep(0.3)  # enough for many more beats
        assert process.poll() is None
        process.stdin.close()
        assert process.stdout.read() == ""
        assert lines.count("left\n") == 1
        assert lines[lines.index("over\n") :].count("beat\n") <= 2
        assert process.wait(LONG) == 0


# --- a task -----------------------------------------------------------------------------------------------------------


async def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.001)


def test_a_task_beats_until_it_is_stopped() -> None:
    async def run() -> None:
        heart = Beating(0.001)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "a-name")
        assert heart.beats == 0
        assert [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()] == ["a-name"]
        await _until(lambda: heart.beats >= 3)
        keeper.stop()
        keeper.join()
        beats = heart.beats
        await _until(keeper._task.done)
        assert keeper._task.cancelled()
        assert (heart.beats, heart.ends) == (beats, 0)
        keeper.stop()

    asyncio.run(run())


def test_a_task_ends_when_there_is_no_next_time() -> None:
    async def run() -> None:
        heart = Beating(0.0, 0.001, None)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        await _until(keeper._task.done)
        assert (heart.beats, heart.ends) == (3, 0)
        assert keeper._task.result() is None

    asyncio.run(run())


def test_a_task_ends_with_the_object() -> None:
    async def run() -> None:
        heart = Beating(0.001)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        await heart.beaten(2)
        seen = ref(heart)
        del heart
        await _until(keeper._task.done)
        gc.collect()
        assert seen() is None
        assert keeper._task.result() is None

    asyncio.run(run())


def test_a_task_does_not_keep_its_object_while_it_waits() -> None:
    async def run() -> None:
        heart = Beating(LONG)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        await heart.beaten(1)
        seen = ref(heart)
        del heart
        gc.collect()
        assert seen() is None
        keeper.stop()

    asyncio.run(run())


def test_a_task_can_be_stopped_from_within() -> None:
    async def run() -> None:
        heart = StopsItself(0.0, None)
        heart.ready.set()
        heart.keeper = keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        await _until(keeper._task.done)
        assert not keeper._task.cancelled()  # the beat itself is not interrupted
        assert (heart.beats, heart.ends) == (2, 0)

    asyncio.run(run())


def test_a_task_can_be_stopped_after_its_loop() -> None:
    async def run() -> AsyncPeriodicCall:
        return AsyncPeriodicCall(heart.async_beat, heart.left, "x")

    heart = Beating(LONG)
    keeper = asyncio.run(run())
    keeper.stop()  # no loop is running
    assert keeper._task.cancelled()


def test_a_task_that_is_cancelled_from_outside() -> None:
    """As asyncio.run does with every task at its end; also before the task has started."""

    async def run(beats: int) -> Beating:
        heart = Beating(LONG)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        if beats:
            await heart.beaten(beats)
        keeper._task.cancel()
        await _until(keeper._task.done)
        assert keeper._task.cancelled()
        return heart

    for beats in (0, 1):
        heart = asyncio.run(run(beats))
        assert (heart.beats, heart.ends) == (beats, 1)


def test_a_task_ends_with_its_loop() -> None:
    async def run() -> Beating:
        heart = Beating(LONG)
        kept.append(AsyncPeriodicCall(heart.async_beat, heart.left, "x"))
        await heart.beaten(1)
        return heart

    kept: list[AsyncPeriodicCall] = []
    assert asyncio.run(run()).ends == 1


def test_a_beat_that_raises_ends_the_task() -> None:
    async def run() -> None:
        heart = Fails(0.0)
        keeper = AsyncPeriodicCall(heart.async_beat, heart.left, "x")
        await _until(keeper._task.done)
        assert (heart.beats, heart.ends) == (1, 1)
        assert isinstance(keeper._task.exception(), ZeroDivisionError)

    asyncio.run(run())


def test_a_task_needs_a_loop() -> None:
    heart = Beating(LONG)
    with pytest.raises(RuntimeError, match="no running event loop"):
        AsyncPeriodicCall(heart.async_beat, heart.left, "x")
