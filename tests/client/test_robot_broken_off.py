"""An interrupted motion stops, on all transports; on those without connections, the client sends a closing request."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from io import FileIO
from types import FrameType

import pytest

import orinkit
import orinkit.aio
from orinkit.client._sync import client, connection, objects
from orinkit.core.speedups import PURE
from orinkit.values.poses import J
from orinkit.virtual.rc8 import VirtualRC8
from support.waiting import PATIENCE, until

GOAL = J(150, 45, 90, 0, 45, 0)


@pytest.fixture
def device() -> VirtualRC8:
    return VirtualRC8(motor=True)


@pytest.fixture
def url(listen_at: str, device: VirtualRC8) -> Iterator[str]:
    with orinkit.serve(device, listen_at, alive=60.0) as server:  # a busy machine may delay signs of life by 2 s
        yield server.url


def stands(device: VirtualRC8) -> bool:
    arm = device.state.arm
    return not arm.busy and arm.holder is None


def is_on_its_way(device: VirtualRC8) -> bool:
    return device.state.arm.queue.joints[0] > 1.0


def check(device: VirtualRC8) -> None:
    until(lambda: stands(device))
    assert 1.0 < device.state.arm.queue.joints[0] < 100, "it went on, and nobody waited for it"


def test_ctrl_c(url: str, device: VirtualRC8) -> None:
    def interrupt() -> None:
        until(lambda: is_on_its_way(device))
        os.kill(os.getpid(), signal.SIGINT)

    interrupting = threading.Thread(target=interrupt)
    with pytest.raises(KeyboardInterrupt), orinkit.connect(url) as rc8, rc8.robot() as robot, robot.arm():
        interrupting.start()
        robot.move(GOAL, "@E", speed=1)
    interrupting.join()
    check(device)


def test_ctrl_c_the_moment_the_call_has_been_sent(
    url: str, device: VirtualRC8, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This includes UDP, where a link that is closed immediately could not send the closing request."""
    # the extension in C sends and receives in one step
    monkeypatch.setattr(connection, "call", PURE["call"])
    monkeypatch.setattr(client, "call_prepared", PURE["call_prepared"])
    monkeypatch.setattr(objects, "call_prepared_by_client", PURE["call_prepared_by_client"])

    def interrupt(_frame: FrameType, event: str, function: object) -> None:
        sender = isinstance(getattr(function, "__self__", None), socket.socket | FileIO)
        if event == "c_return" and sender and getattr(function, "__name__", "") in ("sendall", "send", "write"):
            sys.setprofile(None)
            until(lambda: is_on_its_way(device))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), orinkit.connect(url) as rc8, rc8.robot() as robot, robot.arm():
        try:
            sys.setprofile(interrupt)
            robot.move(GOAL, "@E", speed=1)
        finally:
            sys.setprofile(None)
    check(device)


def test_a_task_that_is_cancelled(url: str, device: VirtualRC8) -> None:
    async def move() -> None:
        async with orinkit.aio.connect(url) as rc8, await rc8.robot() as robot, robot.arm():
            async with asyncio.timeout(PATIENCE) as limit:
                passing = asyncio.create_task(pass_on_its_way(limit))
                await robot.move(GOAL, "@E", speed=1)
            await passing

    async def pass_on_its_way(limit: asyncio.Timeout) -> None:
        while not is_on_its_way(device):  # noqa: ASYNC110 - a thread moves it
            await asyncio.sleep(0.002)
        limit.reschedule(0.0)

    with pytest.raises(TimeoutError):
        asyncio.run(move())
    check(device)
