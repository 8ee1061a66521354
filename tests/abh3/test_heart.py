"""When a keep-alive beats and when it ends, and what has it beat."""

from __future__ import annotations

import asyncio
import gc
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from weakref import ref

import pytest

from orinkit import language
from orinkit.abh3.heart import End, Heart
from orinkit.abh3.keeping import AsyncKeeper, Keeper
from orinkit.errors import InvalidValue

LONG = 60.0  # nothing here takes as long as that
GREAT = pytest.param(10**5000, id="great")

# --- times ------------------------------------------------------------------------------------------------------------


def test_it_is_due_one_period_after_what_was_sent_last() -> None:
    heart = Heart(0.1, 0.5, None, 10.0)
    assert heart.due == pytest.approx(10.1)
    heart.sent(10.25, answered=True)
    assert heart.due == pytest.approx(10.35)
    heart.sent(10.5, answered=False)  # it does not send any faster to a driver that is silent
    assert heart.due == pytest.approx(10.6)
    heart.called(20.0)
    assert heart.due == pytest.approx(10.6)


def test_it_ends_when_the_driver_is_silent() -> None:
    heart = Heart(0.1, 0.5, None, 10.0)
    assert heart.end(10.0) is None
    assert heart.end(10.5) is None
    assert heart.end(10.51) is End.SILENT
    heart.sent(10.5, answered=False)
    assert heart.end(10.51) is End.SILENT
    heart.called(10.5)
    assert heart.end(10.51) is End.SILENT
    heart.sent(10.5, answered=True)
    assert heart.end(11.0) is None
    assert heart.end(11.01) is End.SILENT


def test_it_ends_when_the_program_does_not_call() -> None:
    heart = Heart(0.1, 0.5, 2.0, 10.0)
    heart.sent(12.0, answered=True)
    assert heart.end(12.0) is None
    assert heart.end(12.01) is End.IDLE
    heart.called(12.0)
    assert heart.end(12.01) is None
    heart.sent(13.9, answered=True)
    assert heart.end(14.0) is None
    assert heart.end(14.01) is End.IDLE
    assert heart.end(14.6) is End.SILENT  # the driver's silence counts first: nothing can be told to it


def test_a_program_that_need_not_call() -> None:
    heart = Heart(0.1, 0.5, None, 0.0)
    heart.sent(1e6, answered=True)
    assert heart.end(1e6) is None


def test_a_command_that_comes_too_late_is_not_sent_again() -> None:
    """The driver may have stopped by itself meanwhile; it must not start again by itself."""
    heart = Heart(0.1, 0.5, None, 10.0)
    assert heart.too_late(10.5) is None
    assert heart.too_late(10.51) is End.SILENT
    heart.sent(10.5, answered=False)
    assert heart.too_late(10.51) is End.SILENT
    heart.sent(10.5, answered=True)
    assert heart.too_late(11.0) is None
    slow = Heart(2.0, 0.5, None, 10.0)  # its beats are further apart than its patience
    assert slow.too_late(12.0) is None
    assert slow.too_late(13.0) is None
    assert slow.too_late(13.01) is End.SILENT


def test_why_it_ends() -> None:
    assert [end.value for end in End] == ["silent", "idle"]


@pytest.mark.parametrize("name", ["period", "patience", "idle"])
@pytest.mark.parametrize("seconds", [0, -1.0, math.nan, math.inf, -math.inf, "1", True, 10**400, GREAT])
def test_times_that_are_none(name: str, seconds: Any) -> None:
    for tongue in ("en", "ja"):
        language.use(tongue)
        with pytest.raises(InvalidValue, match=name) as caught:
            Heart(**{"period": 0.1, "patience": 0.5, "idle": 2.0, "now": 0.0, name: seconds})
        assert len(str(caught.value)) < 120


@pytest.mark.parametrize("name", ["period", "patience", "idle"])
def test_any_time_above_zero_will_do(name: str) -> None:
    for seconds in (1e-9, 1, 1e9):
        assert (
            getattr(Heart(**{"period": 0.1, "patience": 0.5, "idle": None, "now": 0.0, name: seconds}), name) == seconds
        )


# --- a thread ---------------------------------------------------------------------------------------------------------


class Beating:
    """Counts its beats; the last of the pauses is repeated."""

    def __init__(self, *pauses: float | None) -> None:
        self.pauses = pauses
        self.beats = 0
        self.seen = threading.Semaphore(0)
        self.thread: threading.Thread | None = None

    def beat(self) -> float | None:
        self.thread = threading.current_thread()
        pause = self.pauses[min(self.beats, len(self.pauses) - 1)]
        self.beats += 1
        self.seen.release()
        return pause

    async def async_beat(self) -> float | None:
        return self.beat()

    async def beaten(self, beats: int) -> None:
        await _until(lambda: self.beats >= beats)

    def wait(self, beats: int) -> None:
        """Until there were so many more."""
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
    keeper = Keeper(heart.beat, "a-name")
    heart.wait(5)
    assert heart.thread is not None
    assert (heart.thread.name, heart.thread.daemon) == ("a-name", True)
    keeper.stop()
    assert not heart.thread.is_alive()
    beats = heart.beats
    keeper.stop()  # once more does no harm
    assert heart.beats == beats


def test_it_beats_at_once_and_waits_then() -> None:
    heart = Beating(LONG)
    keeper = Keeper(heart.beat, "x")
    heart.wait(1)
    keeper.stop()  # does not wait for the pause to pass
    assert heart.beats == 1
    assert ended(heart.thread)


def test_it_ends_when_there_is_no_next_time() -> None:
    heart = Beating(0.0, 0.001, None)
    keeper = Keeper(heart.beat, "x")
    heart.wait(3)
    assert ended(heart.thread)
    assert heart.beats == 3
    keeper.stop()


def test_it_ends_with_the_thread_that_began_it() -> None:
    heart = Beating(0.005)
    kept: list[Keeper] = []
    owner = threading.Thread(target=lambda: kept.append(Keeper(heart.beat, "x")))
    owner.start()
    owner.join(LONG)
    assert len(kept) == 1
    heart.seen.acquire(timeout=0.2)  # there may have been a beat before it ended
    assert kept[0]._thread is not threading.main_thread()
    assert ended(kept[0]._thread)
    beats = heart.beats
    kept[0].stop()
    assert heart.beats == beats


def test_it_ends_with_the_object() -> None:
    heart = Beating(0.005)
    keeper = Keeper(heart.beat, "x")
    heart.wait(2)
    thread, seen = heart.thread, ref(heart)
    del heart
    assert ended(thread)
    gc.collect()
    assert seen() is None
    keeper.stop()


def test_it_does_not_keep_its_object_while_it_waits() -> None:
    heart = Beating(LONG)
    keeper = Keeper(heart.beat, "x")
    heart.wait(1)
    seen = ref(heart)
    del heart
    deadline = time.monotonic() + LONG
    while seen() is not None and time.monotonic() < deadline:  # the thread may be about to let go of it
        gc.collect()
        time.sleep(0.001)
    assert seen() is None
    keeper.stop()


class StopsItself(Beating):
    """Calls stop() while it beats, as one that closes itself does."""

    keeper: Keeper | AsyncKeeper | None = None
    ready: threading.Event = threading.Event()

    def beat(self) -> float | None:
        assert self.ready.wait(LONG)
        assert self.keeper is not None
        self.keeper.stop()
        return super().beat()


def test_it_can_be_stopped_from_within() -> None:
    heart = StopsItself(0.0)
    heart.ready = threading.Event()
    heart.keeper = keeper = Keeper(heart.beat, "x")
    heart.ready.set()
    heart.wait(1)
    assert ended(heart.thread)
    assert heart.beats == 1
    keeper.stop()


def test_a_beat_that_is_at_work_is_waited_for() -> None:
    at_work, go_on = threading.Event(), threading.Event()

    class Slow:
        done = False

        def beat(self) -> float | None:
            at_work.set()
            assert go_on.wait(LONG)
            self.done = True
            return 0.0

    slow = Slow()
    keeper = Keeper(slow.beat, "x")
    assert at_work.wait(LONG)
    threading.Timer(0.05, go_on.set).start()
    keeper.stop()
    assert slow.done


PROGRAM = """
import sys, threading
from orinkit.abh3.keeping import Keeper

class Heart:
    def beat(self):
        print("beat", flush=True)
        return 0.005

heart = Heart()
keeper = Keeper(heart.beat, "x")
if "other" in sys.argv:  # a thread that is none of ours keeps the process alive

    def other():
        threading.main_thread().join()
        print("over", flush=True)
        sys.stdin.read()

    threading.Thread(target=other).start()
"""


def test_it_does_not_outlive_the_program() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, timeout=LONG, check=True)
    assert set(done.stdout.split()) <= {b"beat"}


def test_it_does_not_outlive_the_main_thread() -> None:
    """Where other threads keep the process alive there is no more than the one beat that was at work."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "other"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert "over\n" in iter(process.stdout.readline, "")
        time.sleep(0.3)  # time for many more beats
        assert process.poll() is None
        process.stdin.close()
        assert process.stdout.read().count("beat") <= 2
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
        keeper = AsyncKeeper(heart.async_beat, "a-name")
        assert heart.beats == 0
        assert [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()] == ["a-name"]
        await _until(lambda: heart.beats >= 3)
        keeper.stop()
        beats = heart.beats
        await _until(keeper._task.done)
        assert keeper._task.cancelled()
        assert heart.beats == beats
        keeper.stop()

    asyncio.run(run())


def test_a_task_ends_when_there_is_no_next_time() -> None:
    async def run() -> None:
        heart = Beating(0.0, 0.001, None)
        keeper = AsyncKeeper(heart.async_beat, "x")
        await _until(keeper._task.done)
        assert heart.beats == 3
        assert keeper._task.result() is None

    asyncio.run(run())


def test_a_task_ends_with_the_object() -> None:
    async def run() -> None:
        heart = Beating(0.001)
        keeper = AsyncKeeper(heart.async_beat, "x")
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
        keeper = AsyncKeeper(heart.async_beat, "x")
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
        heart.keeper = keeper = AsyncKeeper(heart.async_beat, "x")
        await _until(keeper._task.done)
        assert not keeper._task.cancelled()  # the beat itself is not torn off
        assert heart.beats == 2

    asyncio.run(run())


def test_a_task_can_be_stopped_after_its_loop() -> None:
    async def run() -> AsyncKeeper:
        return AsyncKeeper(heart.async_beat, "x")

    heart = Beating(LONG)
    keeper = asyncio.run(run())
    keeper.stop()  # no loop is running
    assert keeper._task.cancelled()


def test_a_task_needs_a_loop() -> None:
    with pytest.raises(RuntimeError, match="no running event loop"):
        AsyncKeeper(Beating(LONG).async_beat, "x")
