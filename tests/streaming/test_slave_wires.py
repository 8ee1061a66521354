"""Slave mode over UDP and over serial lines behaves as over TCP."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import orinkit
from orinkit.core.errors import CallTimeout, ConnectionLost, OrinError
from orinkit.values.poses import J
from support.stream_programs import came_to_rest, gone, program
from support.streams import HOME, Arm, served
from support.waiting import until

WIRES = ["udp://127.0.0.1:0", "pty://"]


@pytest.fixture(params=WIRES, ids=["udp", "serial"])
def arm(request: pytest.FixtureRequest) -> Iterator[Arm]:
    with served(listen=request.param, joints=HOME) as served_arm:
        yield served_arm


def test_a_live_target(arm: Arm) -> None:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.slave_mode() as stream:
            stream.target = J(20, 45, 90, 0, 45, 0)
            until(lambda: stream.latest is not None and stream.latest.joints[0] == pytest.approx(20, abs=1e-3))
            with pytest.raises(OrinError):
                robot.execute("CurJnt")
    assert arm.errors == []
    assert arm.within_limits()


def test_kill_9_of_the_program(arm: Arm) -> None:
    """The streaming process, which has the connection, stops the arm and leaves slave mode."""
    with program(arm.url, "target") as (process, streamer):
        until(lambda: arm.arm.queue.joints[0] > 5)
        process.kill()
        until(arm.standing)
        until(lambda: gone(streamer))
    came_to_rest(arm)
    until(
        arm.free, 5.0
    )  # the streaming process has closed the connection; over UDP the server would detect silence only after 10 s


def test_the_server_goes_away() -> None:
    with served(listen="udp://127.0.0.1:0", joints=HOME) as arm:
        rc8 = orinkit.connect(arm.url)
        robot = rc8.robot()
        robot.arm().__enter__()
        stream = robot.slave_mode().__enter__()
        stream.target = J(20, 45, 90, 0, 45, 0)
        until(lambda: arm.arm.queue.joints[0] > 1)
    until(lambda: stream.error is not None)
    assert isinstance(stream.error, ConnectionLost | CallTimeout)
    with pytest.raises(OrinError):
        stream.target = J(*HOME)
    stream.__exit__(OrinError, stream.error, None)
    rc8.close()


@pytest.mark.parametrize("listen", [*WIRES, "tcp://127.0.0.1:0"], ids=["udp", "serial", "tcp"])
def test_a_client_that_closes_while_it_streams(listen: str) -> None:
    with served(listen=listen, joints=HOME) as arm:
        rc8 = orinkit.connect(arm.url)
        robot = rc8.robot()
        robot.arm().__enter__()
        stream = robot.slave_mode().__enter__()
        stream.target = J(20, 45, 90, 0, 45, 0)
        until(lambda: arm.arm.queue.joints[0] > 1)
        rc8.client.close()
        until(arm.free, 5.0)
        assert arm.within_limits()
        stream.__exit__(OrinError, OrinError(), None)
