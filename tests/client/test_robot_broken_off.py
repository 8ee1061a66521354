"""A motion that is broken off stops, over every wire: where there is no connection, the client says goodbye."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from collections.abc import Iterator

import pytest

import orinkit
import orinkit.aio
from orinkit.poses import J
from orinkit.virtual.rc8 import VirtualRC8

GOAL = J(150, 45, 90, 0, 45, 0)


@pytest.fixture
def device() -> VirtualRC8:
    return VirtualRC8(motor=True)


@pytest.fixture
def url(listen_at: str, device: VirtualRC8) -> Iterator[str]:
    with orinkit.serve(device, listen_at) as server:
        yield server.url


def stands(device: VirtualRC8) -> bool:
    arm = device.state.arm
    return not arm.busy and arm.holder is None


def check(device: VirtualRC8) -> None:
    end = time.monotonic() + 5.0
    while not stands(device):
        assert time.monotonic() < end, "it goes on, and nobody waits for it"
        time.sleep(0.01)
    assert 0 < device.state.arm.queue.joints[0] < 100


def test_ctrl_c(url: str, device: VirtualRC8) -> None:
    timer = threading.Timer(0.8, os.kill, (os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt), orinkit.connect(url) as rc8, rc8.robot() as robot, robot.arm():
        timer.start()
        robot.move(GOAL, "@E", speed=5)
    check(device)


def test_a_task_that_is_cancelled(url: str, device: VirtualRC8) -> None:
    async def move() -> None:
        async with orinkit.aio.connect(url) as rc8, await rc8.robot() as robot, robot.arm():
            async with asyncio.timeout(0.8):
                await robot.move(GOAL, "@E", speed=5)

    with pytest.raises(TimeoutError):
        asyncio.run(move())
    check(device)
