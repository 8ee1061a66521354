"""One thread drives the devices of a shared clock: order, isolation, long calls, closing."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter

import pytest

from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.shared_clock import PHASES, SharedClock

_PATIENCE = 10.0  # s; only for failing tests


class Device:
    """A device with a period, that counts its calls and records their threads."""

    def __init__(self, clock: SharedClock, period: float | None = 0.001, enough: int = 5) -> None:
        self.calls = 0
        self.threads: Counter[threading.Thread] = Counter()
        self.enough = threading.Event()
        self.period = period
        self._enough = enough
        self.driver = clock.drive(self.advance)

    def advance(self) -> float | None:
        self.calls += 1
        self.threads[threading.current_thread()] += 1
        if self.calls >= self._enough:
            self.enough.set()
        return self.period


def test_one_thread_drives_all_devices() -> None:
    clock = SharedClock()
    devices = [Device(clock, enough=20) for _ in range(50)]
    for device in devices:
        device.driver.wake()
    assert all(device.enough.wait(_PATIENCE) for device in devices)
    for device in devices:
        device.driver.close()
    calls = sum((device.threads for device in devices), Counter())
    # a further thread may have taken over while the machine was busy
    assert len(calls) < len(devices) / 5


@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_the_cycles_of_many_devices_are_due_at_the_same_time(scale: float) -> None:
    clock, phase = SharedClock(scale), PERIOD / PHASES
    for _ in range(5):
        before = clock.now()
        first = clock.first_cycle(PERIOD)
        assert before - phase <= first <= clock.now()
        assert first / phase == pytest.approx(round(first / phase))
        time.sleep(0.0007)


def test_a_device_without_work_is_not_called_until_it_is_woken() -> None:
    clock = SharedClock()
    idle, busy = Device(clock, None, enough=1), Device(clock, enough=30)
    idle.driver.wake()
    busy.driver.wake()
    assert idle.enough.wait(_PATIENCE)
    assert busy.enough.wait(_PATIENCE)
    assert idle.calls == 1
    idle.enough.clear()
    idle.driver.wake()
    assert idle.enough.wait(_PATIENCE)
    assert idle.calls == 2
    idle.driver.close()
    busy.driver.close()


def test_the_thread_ends_without_work_and_starts_again() -> None:
    clock = SharedClock()
    device = Device(clock, None, enough=1)
    device.driver.wake()
    assert device.enough.wait(_PATIENCE)
    (thread,) = device.threads
    thread.join(_PATIENCE)
    assert not thread.is_alive()
    device.enough.clear()
    device.driver.wake()
    assert device.enough.wait(_PATIENCE)
    device.driver.close()


def test_an_exception_of_one_device_does_not_affect_the_others(caplog: pytest.LogCaptureFixture) -> None:
    clock = SharedClock()
    other = Device(clock, enough=20)

    def fail() -> float | None:
        raise RuntimeError("broken")

    with caplog.at_level(logging.ERROR, "orinkit.rc8"):
        driver = clock.drive(fail)
        driver.wake()
        other.driver.wake()
        assert other.enough.wait(_PATIENCE)
    assert "broken" in caplog.text
    driver.close()
    other.driver.close()


def test_a_long_call_of_one_device_does_not_hold_up_the_others() -> None:
    clock = SharedClock()
    other = Device(clock, enough=50)
    began, end = threading.Event(), threading.Event()

    def take_long() -> float | None:
        began.set()
        end.wait(_PATIENCE)
        return 0.001

    slow = clock.drive(take_long)
    slow.wake()
    assert began.wait(_PATIENCE)
    other.driver.wake()
    assert other.enough.wait(_PATIENCE)
    assert not end.is_set()
    end.set()
    other.driver.close()
    slow.close()


def test_a_device_that_is_late_does_not_hold_up_the_others() -> None:
    clock = SharedClock()
    late, other = Device(clock, 0.0, enough=1), Device(clock, enough=20)
    late.driver.wake()
    other.driver.wake()
    assert other.enough.wait(_PATIENCE)
    late.driver.close()
    other.driver.close()


def test_close_waits_for_the_call_in_progress_and_ends_the_calls() -> None:
    clock = SharedClock()
    began = threading.Event()
    finished: list[float] = []

    def advance() -> float | None:
        began.set()
        time.sleep(0.05)
        finished.append(time.monotonic())
        return 0.0

    driver = clock.drive(advance)
    driver.wake()
    assert began.wait(_PATIENCE)
    driver.close()
    calls = len(finished)
    assert calls >= 1
    driver.wake()
    time.sleep(0.02)
    assert len(finished) == calls


def test_a_device_may_close_itself() -> None:
    clock = SharedClock()
    closed = threading.Event()

    def advance() -> float | None:
        driver.close()
        closed.set()
        return 0.0

    driver = clock.drive(advance)
    driver.wake()
    assert closed.wait(_PATIENCE)


def test_a_device_that_is_woken_during_its_call_is_called_again() -> None:
    clock = SharedClock()
    calls: list[int] = []
    again = threading.Event()

    def advance() -> float | None:
        calls.append(1)
        if len(calls) == 1:
            driver.wake()
        else:
            again.set()
        return None

    driver = clock.drive(advance)
    driver.wake()
    assert again.wait(_PATIENCE)
    driver.close()


def test_frequent_waking_leaves_no_entries_behind() -> None:
    clock = SharedClock()
    device = Device(clock, 1000.0, enough=1)
    for _ in range(2000):
        device.driver.wake()
    assert device.enough.wait(_PATIENCE)
    device.driver.close()
    assert len(clock._scheduler._due) < 100


def test_a_device_cannot_be_later_than_its_pause_by_the_scale() -> None:
    clock = SharedClock(scale=100.0)
    device = Device(clock, 0.1, enough=10)  # 1 ms of real time
    began = time.monotonic()
    device.driver.wake()
    assert device.enough.wait(_PATIENCE)
    assert time.monotonic() - began >= 0.009
    device.driver.close()
