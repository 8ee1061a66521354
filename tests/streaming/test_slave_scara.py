"""A SCARA over a connection: motions, a stream of each pose type within the limits, and a retimed trajectory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.arms import load_model
from orinkit.core import hresult
from orinkit.core.errors import CallError, StreamError
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.trajectory import generators
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.streaming.trajectory.preflight import find_violations
from orinkit.streaming.trajectory.retime import retime
from orinkit.values.poses import J, P, T
from support.both import Both
from support.streams import PERIOD, Arm, served

pytestmark = pytest.mark.slow
HOME = (0.0, 60.0, 100.0, -60.0)
MODEL = load_model("HSR065")


@pytest.fixture
def arm() -> Iterator[Arm]:
    with served(model="HSR065") as served_arm:
        yield served_arm


@pytest.fixture(params=["sync", "async"])
def both(request: Any) -> Iterator[Both]:
    instance = Both(request.param)
    yield instance
    instance.close()


@pytest.fixture
def robot(both: Both, arm: Arm) -> Iterator[Any]:
    controller = both.connect(arm.url)
    robot = both.run(controller.robot("Arm"))
    both.run(robot.execute("TakeArm", [0, 0]))
    yield robot
    both.run(controller.close())


def sway(count: int, *amplitudes: float) -> list[tuple[float, ...]]:
    """Return set-points from home and back, with an amplitude for each joint."""
    parts = [(1 - math.cos(2 * math.pi * number / count)) / 2 for number in range(count + 1)]
    return [tuple(h + a * part for h, a in zip(HOME, amplitudes, strict=True)) for part in parts]


def test_motions(both, arm, robot):
    both.run(robot.move(J(20, 40, 50, 10)))
    assert arm.arm.queue.joints == pytest.approx((20, 40, 50, 10))
    both.run(robot.move_l(P(450, 50, 80, 180, 0, 30), "@E"))
    assert both.run(robot.get_position()) == pytest.approx(P(450, 50, 80, 0, 0, 30, 0), abs=1e-3)
    assert both.run(robot.get_joints())[4:] == (0, 0, 0, 0)
    both.run(robot.depart(20))
    assert both.run(robot.get_position())[2] == pytest.approx(100, abs=1)
    with pytest.raises(CallError) as caught:
        both.run(robot.move(T(450, 50, 80, 0, 1, 0, 0, 0, -1)))
    assert caught.value.code == hresult.TARGET_OUT_OF_RANGE


def test_a_stream_of_joints(both, arm, robot):
    points = sway(200, 20, 10, 60, -90)

    def body(stream: Any) -> None:
        assert len(stream.limits.lower) == 4
        both.run(stream.run(points))

    arm.record()
    both.within(robot.slave_mode(), body)
    assert max(row[2] for row in arm.commands) == pytest.approx(160, abs=1e-3)
    assert not arm.errors
    assert both.run(robot.get_joints())[:4] == pytest.approx(HOME, abs=1e-2)


def test_a_target_of_four_joints(both, arm, robot):
    def body(stream: Any) -> None:
        stream.target = (30.0, 40.0, 200.0, 90.0)
        both.run(stream.wait())

    both.within(robot.slave_mode(2), body)
    assert arm.arm.queue.joints == pytest.approx((30, 40, 200, 90), abs=1e-6)


def test_targets_beyond_the_range_end_at_the_limit(both, arm, robot):
    def body(stream: Any) -> None:
        stream.target = (0.0, 60.0, 500.0, -60.0)
        both.run(stream.wait())

    both.within(robot.slave_mode(), body)
    assert arm.arm.queue.joints == pytest.approx((0, 60, 220, -60), abs=1e-6)


@pytest.mark.parametrize("kind", ["P", "T"])
def test_a_stream_of_poses(both, arm, robot, kind):
    def body(stream: Any) -> None:
        x, y, z = 512.5, 238.157, 100.0
        goal = P(x - 60, y - 40, z + 50, 0, 0, 45) if kind == "P" else T(x - 60, y - 40, z + 50, -0.6, 0.8, 0, 0, 0, 1)
        stream.target = goal
        both.run(stream.wait())

    both.within(robot.slave_mode(pose=kind), body)
    position = both.run(robot.get_position())
    assert position[:3] == pytest.approx([452.5, 198.157, 150], abs=0.01)
    assert position[5] == pytest.approx(45 if kind == "P" else math.degrees(math.atan2(0.6, 0.8)), abs=0.01)
    assert not arm.errors


def test_a_stream_that_tilts_the_tool_ends_in_an_error(both, arm, robot):
    def body(stream: Any) -> None:
        stream.target = T(512.5, 238.157, 100, 0, 0.8, 0.6, 0, -0.6, 0.8)
        both.run(stream.wait())

    with pytest.raises((StreamError, CallError)):
        both.within(robot.slave_mode(pose="T"), body)
    assert hresult.OUT_OF_WORKING_RANGE in arm.errors


def test_units_of_violations():
    limits = Limits.of_model(MODEL)
    found = find_violations([HOME, (0.0, 60.0, 130.0, -60.0), (0.0, 70.0, 300.0, -60.0)], limits, PERIOD)
    units = {(each.axis, each.unit) for each in found}
    assert {(2, "deg/s"), (3, "mm"), (3, "mm/s"), (3, "mm/s^2")} <= units


def test_trajectories_of_a_scara():
    points = generators.circle(MODEL, HOME, 40.0, "XY", 4.0)
    assert len(points[0]) == 4
    assert points[0] == points[-1] == HOME
    fast = retime(points[::20], Limits.of_model(MODEL), PERIOD, "J")
    assert 0 < len(fast) < len(points)


def test_trajectories_that_a_scara_cannot_follow():
    with pytest.raises(TrajectoryError, match="cannot follow"):
        generators.line(MODEL, HOME, (400.0, 0.0, 0.0), 3.0)
