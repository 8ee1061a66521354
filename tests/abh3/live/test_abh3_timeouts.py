"""The time-outs of section 1: exactly, with a clock that the test moves, and roughly in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.can.server import serve_can
from orinkit.core.errors import DriverFault
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from orinkit.virtual.clock import ManualClock
from support.abh3_wires import FAST, PATIENCE, Hosts, Place, only_on
from support.both import Both
from support.waiting import until

PATIENT = {"timeout": PATIENCE}
COMMUNICATION = 1 << 22
GO = 0x3003

pytestmark = only_on("udp_multicast", because="the bus has no part in it")


class Bench:
    """A driver whose clock the test moves, and its host."""

    def __init__(self, both: Both, hosts: Hosts, bare: Place, **parameters: Any) -> None:
        self.both = both
        self.clock = ManualClock()
        self.device = VirtualABH3(Parameters(**parameters), clock=self.clock)
        self.server = serve_can(self.device, at=bare.far)
        self.driver = hosts.connect(bare.near, **PATIENT)

    def at(self, milliseconds: int) -> None:
        """Move the clock to a time."""
        self.clock.advance((milliseconds - round(self.clock.now() * 1000)) / 1000)

    @property
    def faults(self) -> tuple[int, int]:
        """Return errors and warnings, as the host receives them."""
        found = self.both.run(self.driver.errors())
        return int(found.errors), int(found.warnings)

    def call(self, result: Any) -> Any:
        return self.both.run(result)


@pytest.fixture
def bench(both: Both, hosts: Hosts, bare: Place) -> Iterator[Bench]:
    """Provide a driver with the parameters of section 1."""
    found = Bench(both, hosts, bare)
    yield found
    found.call(found.driver.close())
    found.server.close()


def test_a_host_that_stops_sending(bench: Bench) -> None:
    driver = bench.driver
    bench.call(driver.set_inputs(GO))
    bench.call(driver.command(1000.0, -1000.0))
    bench.at(400)
    feedback = bench.call(driver.command())
    assert (feedback.a_velocity, feedback.b_velocity) == (1000.0, -1000.0)
    bench.at(899)
    assert bench.faults == (0, 0)
    assert bench.call(driver.request_single()).a_velocity == 1000.0
    bench.at(900)  # 指令ゼロ: 500 ms
    assert bench.faults == (0, COMMUNICATION)
    bench.at(950)
    assert 0 < bench.call(driver.request_single()).a_velocity < 1000.0  # it decelerates
    bench.at(1399)
    assert bench.faults == (0, COMMUNICATION)
    assert bench.call(driver.request_single()).a_velocity == 0
    bench.at(1400)  # 異常判定: 1000 ms
    assert bench.faults == (COMMUNICATION, COMMUNICATION)
    assert driver.commands == (1000.0, -1000.0)  # the host does not know


def test_the_error_is_latched_and_reset_by_an_edge(bench: Bench) -> None:
    driver = bench.driver
    bench.at(5000)
    both_words = (COMMUNICATION, COMMUNICATION)
    for time_now in (5100, 5200, 5300):
        bench.call(driver.command(100.0))
        bench.call(driver.set_inputs(GO))
        assert bench.faults == both_words
        bench.at(time_now)
    assert bench.call(driver.command()).a_velocity == 0  # nothing moves
    bench.call(driver.init())
    bench.call(driver.set_input("error_reset", 1))
    assert bench.faults == both_words  # immediately after it they are still set
    bench.at(5310)
    assert bench.faults == (0, 0)
    bench.call(driver.command())
    bench.at(6400)
    assert bench.faults == both_words
    bench.call(driver.set_input("error_reset", 1))  # it stayed 1: no edge
    bench.at(6410)
    assert bench.faults == both_words
    bench.call(driver.set_input("error_reset", 0))
    bench.call(driver.set_input("error_reset", 1))
    bench.at(6420)
    assert bench.faults == (0, 0)


def test_a_warning_ends_with_the_next_command(bench: Bench) -> None:
    driver = bench.driver
    bench.call(driver.set_inputs(GO))
    bench.call(driver.command(1000.0))
    bench.at(600)
    assert bench.faults == (0, COMMUNICATION)
    assert bench.call(driver.request_single()).a_velocity < 1000.0
    bench.call(driver.command(500.0))
    assert bench.faults == (0, 0)
    bench.at(1000)
    assert bench.call(driver.command()).a_velocity == 500.0


def test_requests_do_not_restart_the_time_out(bench: Bench) -> None:
    driver = bench.driver
    bench.call(driver.set_inputs(GO))
    bench.call(driver.command(100.0))
    for milliseconds in range(50, 500, 50):
        bench.at(milliseconds)
        bench.call(driver.pulses())
        bench.call(driver.request_single())
        bench.call(driver.request_broadcast(2, everyone=True))
    assert bench.faults == (0, 0)
    bench.at(500)
    assert bench.faults == (0, COMMUNICATION)


def test_commands_restart_the_time_out(bench: Bench) -> None:
    driver = bench.driver
    bench.call(driver.set_inputs(GO))
    for milliseconds in range(400, 8000, 400):
        bench.call(driver.command(100.0))
        bench.at(milliseconds)
    assert bench.faults == (0, 0)
    assert bench.device.state().a_velocity == 100.0


def test_a_reset_without_effect(bench: Bench) -> None:
    """The clock stands still: the driver never resets, and the call raises."""
    bench.at(2000)
    with pytest.raises(DriverFault, match="CAN") as caught:
        bench.call(bench.driver.reset_errors(tries=2))
    assert (caught.value.errors, caught.value.warnings) == (COMMUNICATION, COMMUNICATION)
    bench.at(2010)
    assert bench.faults == (0, 0)


def test_time_outs_that_are_off(both: Both, hosts: Hosts, bare: Place) -> None:
    bench = Bench(both, hosts, bare, command_timeout=0, error_timeout=0)
    bench.call(bench.driver.set_inputs(GO))
    bench.call(bench.driver.command(100.0))
    bench.at(60_000)
    assert bench.faults == (0, 0)
    assert bench.device.state().a_velocity == 100.0
    bench.call(bench.driver.close())
    bench.server.close()


def test_in_real_time(both: Both, hosts: Hosts, bare: Place) -> None:
    device = VirtualABH3(Parameters(**FAST))
    with serve_can(device, at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        both.run(driver.reset_errors(tries=50))
        both.run(driver.set_inputs(GO))
        began = time.monotonic()
        both.run(driver.command(100.0))
        until(lambda: device.state().moving)
        until(lambda: device.state().warnings)
        assert time.monotonic() - began >= 0.5
        until(lambda: device.state().errors)
        assert time.monotonic() - began >= 1.0
        assert not device.state().moving
        both.run(driver.command(100.0))
        assert "can_communication" in both.run(driver.errors()).errors
        both.run(driver.reset_errors(tries=50))
        assert not device.state().moving
        both.run(driver.close())
