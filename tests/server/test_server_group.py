"""Servers on consecutive ports in one event loop, and many virtual controllers with one thread for their cycles."""

from __future__ import annotations

import asyncio
import socket
import threading

import pytest

import orinkit
from orinkit import aio
from orinkit.cao.provider import Deferred
from orinkit.core.errors import ConnectFailed, InvalidAddress
from orinkit.transport.address import consecutive_addresses, parse_address
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.shared_clock import SharedClock
from support.busy import occupy
from support.waiting import PATIENCE, until


def test_consecutive_addresses() -> None:
    assert consecutive_addresses("tcp://127.0.0.1:5007", 3) == [
        f"tcp://127.0.0.1:{port}" for port in (5007, 5008, 5009)
    ]
    assert consecutive_addresses("tcp://127.0.0.1:0", 2) == ["tcp://127.0.0.1:0"] * 2
    assert consecutive_addresses("http://[::1]:80/rc8", 2) == ["http://[::1]:80/rc8", "http://[::1]:81/rc8"]
    assert consecutive_addresses("tcp://127.0.0.1:65535", 1) == ["tcp://127.0.0.1:65535"]


def test_addresses_without_consecutive_ports_are_refused() -> None:
    with pytest.raises(InvalidAddress, match="65535"):
        consecutive_addresses("tcp://127.0.0.1:65535", 2)
    with pytest.raises(InvalidAddress, match="port"):
        consecutive_addresses("serial:///dev/ttyUSB0", 2)


def _free_ports(count: int) -> int:
    """Return the first of ``count`` consecutive ports that are free at the moment."""
    for first in range(20_000, 30_000, count):
        opened: list[socket.socket] = []
        try:
            opened.extend(socket.create_server(("127.0.0.1", port)) for port in range(first, first + count))
        except OSError:
            continue
        finally:
            for each in opened:
                each.close()
        return first
    raise AssertionError("no free ports")


def test_each_arm_has_its_own_port_and_its_own_state() -> None:
    first = _free_ports(3)
    clock = SharedClock()
    arms = [VirtualRC8(clock=clock, samples=False) for _ in range(3)]
    with orinkit.serve_many(arms, f"tcp://127.0.0.1:{first}") as server:
        assert server.urls == [f"tcp://127.0.0.1:{port}" for port in range(first, first + 3)]
        for number, url in enumerate(server.urls):
            with orinkit.connect(url) as rc8:
                rc8.variable("I1").value = number
        for number, url in enumerate(server.urls):
            with orinkit.connect(url) as rc8:
                assert rc8.variable("I1").value == number


def test_long_work_of_one_arm_does_not_hold_up_another_one() -> None:
    clock, going = SharedClock(scale=20.0), threading.Event()
    arms = [VirtualRC8(clock=clock, motor=True, samples=False) for _ in range(2)]
    with orinkit.serve_many(arms, "tcp://127.0.0.1:0") as server:
        busy = [arms[0].state.planning, arms[0].state.compiling, arms[0].state.disk]
        for lane in busy:
            occupy(lane, going)
        waiting = [
            lane.submit(lambda: going.wait(PATIENCE), Deferred(), number) for lane in busy for number in range(8)
        ]
        try:
            with orinkit.connect(server.urls[1], timeout=PATIENCE) as rc8:
                rc8.file("Pro1.pcs", create=True).value = "Sub Main\nI5 = 7\nEnd Sub"
                rc8.task("Pro1").start(1)
                until(lambda: rc8.variable("I5").value == 7)
                robot = rc8.robot()
                robot.execute("TakeArm", [0, 0])
                robot.move(4, "P(330, 0, 300, 180, 0, 180)")  # a free curve is planned in a thread
                assert robot.variable("@CURRENT_POSITION").value[0] == pytest.approx(330, abs=0.1)
            assert not any(each.done() for each in waiting)
        finally:
            going.set()


def test_many_moving_arms_share_a_thread() -> None:
    before = set(threading.enumerate())
    clock = SharedClock(scale=20.0)
    arms = [VirtualRC8(clock=clock, motor=True, samples=False) for _ in range(8)]
    with orinkit.serve_many(arms, "tcp://127.0.0.1:0") as server:
        controllers = [orinkit.connect(url) for url in server.urls]
        robots = [controller.robot() for controller in controllers]
        for robot in robots:
            robot.execute("TakeArm", [0, 0])
            robot.move(1, "J(30, 45, 90, 0, 45, 0)", "NEXT")
        drivers = {each.name for each in set(threading.enumerate()) - before if "device" in each.name}
        assert drivers <= {"orinkit-devices", "orinkit-devices-watch"}
        for robot in robots:
            robot.move(1, "J(-30, 45, 90, 0, 45, 0)")
            assert robot.variable("@CURRENT_ANGLE").value[0] == pytest.approx(-30, abs=0.1)
        for controller in controllers:
            controller.close()


def test_if_one_address_is_taken_nothing_stays_open() -> None:
    first = _free_ports(3)

    async def run() -> None:
        with socket.create_server(("127.0.0.1", first + 2)):
            arms = [VirtualRC8(samples=False) for _ in range(3)]
            group = aio.serve_many(arms, f"tcp://127.0.0.1:{first}")
            with pytest.raises(ConnectFailed):
                await group.start()
        for port in range(first, first + 3):
            socket.create_server(("127.0.0.1", port)).close()
        await group.close()

    asyncio.run(run())


def test_a_group_requires_a_provider() -> None:
    with pytest.raises(ValueError, match="no provider"):
        aio.serve_many([])


def test_parameters_apply_to_each_server() -> None:
    async def run() -> None:
        arms = [VirtualRC8(samples=False) for _ in range(2)]
        async with aio.serve_many(arms, "tcp://127.0.0.1:0", clients=1, per_address=1) as group:
            ports = [parse_address(url) for url in group.urls]
            async with aio.connect(str(ports[0])), aio.connect(str(ports[1])):
                assert group.clients == 2
                with pytest.raises(orinkit.CaoError):
                    await aio.connect(str(ports[0]))

    asyncio.run(run())
