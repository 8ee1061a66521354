"""Slave mode through a gateway in a separate process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

import orinkit
from orinkit import Lateness, StreamResult
from orinkit.values.poses import J
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from support.gateways import PATIENCE
from support.hand import Hand

GATEWAY = """
import sys
import orinkit
from orinkit.gateway import RemoteProvider
with orinkit.serve(RemoteProvider(sys.argv[1]), "tcp://127.0.0.1:0") as server:
    print("ready", server.url, flush=True)
    sys.stdin.read()
"""
CONTROLLER = ["-m", "orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0", "--motor-on"]
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
SECONDS = 3.0
PERIOD = 0.008


@contextmanager
def process(*arguments: str) -> Iterator[str]:
    """Run a Python program in a separate process; yield the address that it serves."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as served:
        try:
            assert served.stdout is not None
            yield served.stdout.readline().split()[1]
        finally:
            served.terminate()
            served.wait(PATIENCE)


def trajectory(seconds: float) -> list[tuple[float, ...]]:
    count = round(seconds / PERIOD)
    return [(*HOME[:5], 20.0 * (number / count) ** 2 * (3 - 2 * number / count)) for number in range(count + 1)]


def stream_through(url: str, points: list[tuple[float, ...]]) -> StreamResult:
    """Stream a trajectory, and check that all set-points have arrived."""
    with orinkit.connect(url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor():
            robot.move(J(*HOME), "@E")
            with robot.slave_mode() as stream:
                result = stream.run(points)
            assert result.underflows == 0
            assert result.sent >= len(points)
            assert abs(robot.joints[5] - 20.0) < 0.01
        assert rc8.errors() == []
    return result


def test_no_underflow_through_a_gateway() -> None:
    """The test advances the controller's clock, but never past a set-point that has not arrived."""
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as controller, process("-c", GATEWAY, controller.url) as url:
        hand = Hand(device, clock)
        try:
            result = stream_through(url, trajectory(SECONDS))
        finally:
            hand.close()
    assert result.late == Lateness()


@pytest.mark.soak
def test_a_minute_through_a_gateway_in_real_time() -> None:
    with process(*CONTROLLER) as controller, process("-c", GATEWAY, controller) as url:
        stream_through(url, trajectory(60.0))
