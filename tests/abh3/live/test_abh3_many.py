"""Several drivers, threads and tasks on one bus: every reply comes from the right driver."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from orinkit import abh3
from orinkit.can.server import serve_can
from support.abh3_wires import PATIENCE, Echo, Hosts, Place
from support.both import Both

PATIENT = {"timeout": PATIENCE}
TIMES = {"virtual": 1500, "udp_multicast": 600, "slcan": 150, "serial": 300}


async def asks(both: Both, driver: Any, times: int) -> int:
    """Command a series of velocities; return how many replies were those of the driver to the command."""
    right = 0
    for number in range(times):
        ay, bx = number % 6000 + driver.address / 5, -(number % 5000) - driver.address / 5
        answer = await both.now(driver.command(ay, bx))
        right += (answer.a_velocity, answer.b_velocity, answer.y_velocity) == (ay, bx, driver.address)
        if number % 10 == 0:
            pulses = await both.now(driver.pulses())
            right -= (pulses.a_pulses, pulses.b_pulses) != (driver.address, driver.host.commanded)
    return right


def test_two_drivers_at_the_same_time(both: Both, hosts: Hosts, bare: Place) -> None:
    """Thousands of exchanges of two tasks, or threads, over one bus."""
    times = TIMES[bare.kind]
    with serve_can(Echo(1), Echo(7), at=bare.far):
        bus = hosts.open_bus(bare.near)
        drivers = [bus.driver(address=address, **PATIENT) for address in (1, 7)]
        assert both.side_by_side(*(asks(both, driver, times) for driver in drivers)) == [times, times]
        both.run(bus.close())


@pytest.mark.parametrize("bare", ["virtual", "slcan"], indirect=True)
def test_ten_drivers_and_a_listener(both: Both, hosts: Hosts, bare: Place) -> None:
    addresses = range(10, 20)
    with serve_can(*map(Echo, addresses), at=bare.far):
        bus = hosts.open_bus(bare.near)
        drivers = [bus.driver(address=address, **PATIENT) for address in addresses]

        async def all_of_them() -> int:
            return sum([len(await both.now(bus.request_all(4, seconds=PATIENCE, count=10))) for _ in range(5)])

        found = both.side_by_side(*(asks(both, driver, 40) for driver in drivers), all_of_them())
        assert found == [40] * 10 + [50]
        both.run(bus.close())


@pytest.mark.parametrize("bare", ["virtual", "udp_multicast"], indirect=True)
def test_one_driver_of_several_tasks(both: Both, hosts: Hosts, bare: Place) -> None:
    """Calls on one driver run one at a time; each gets its own reply."""
    with serve_can(Echo(1), at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)

        async def body(first: float) -> bool:
            answers = [await both.now(driver.command(ay=first + n / 5)) for n in range(100)]
            return [answer.a_velocity for answer in answers] == [first + n / 5 for n in range(100)]

        assert both.side_by_side(*(body(100.0 * n) for n in range(1, 6))) == [True] * 5
        both.run(driver.close())


@pytest.mark.parametrize("bare", ["virtual", "udp_multicast"], indirect=True)
def test_two_buses_of_one_program(both: Both, hosts: Hosts, bare: Place) -> None:
    """The bus is opened twice: replies to the other host are ignored."""
    with serve_can(Echo(1), Echo(7), at=bare.far):
        one = hosts.connect(bare.near, address=1, **PATIENT)
        seven = hosts.connect(bare.near, address=7, host=3, **PATIENT)
        assert both.side_by_side(asks(both, one, 200), asks(both, seven, 200)) == [200, 200]
        both.run(one.close())
        both.run(seven.close())


def test_threads_come_and_go(tmp_path: Path) -> None:
    """The thread that reads for all may leave at any time; no other thread keeps waiting."""
    url = "can://virtual/threads-come-and-go"
    wrong: list[object] = []
    with serve_can(*map(Echo, range(10, 16)), at=url), abh3.open_bus(url) as bus:

        def comes_and_goes(address: int) -> None:
            try:
                for _ in range(15):
                    driver = bus.driver(address=address, **PATIENT)
                    answers = {driver.command(number, 1.0).y_velocity for number in range(5)}
                    if answers != {address}:
                        wrong.append(answers)
                    driver.close()
            except Exception as error:  # noqa: BLE001 - checked below
                wrong.append(error)

        threads = [threading.Thread(target=comes_and_goes, args=(address,)) for address in range(10, 16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE * 2)
        assert not any(thread.is_alive() for thread in threads)
    assert wrong == []
