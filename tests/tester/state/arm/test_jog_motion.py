"""Jogging without a controller: the set-points stay within the limits, and end before obstacles."""

from __future__ import annotations

import numpy as np
import pytest

from orinkit.arms import load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.core.errors import InvalidValue
from orinkit.streaming.planning.limits import Limits
from orinkit.tester.state.arm.jog_motion import JogMotion
from orinkit.tester.state.arm.jog_path import JogRequest, JointPath, ToolPath

PERIOD = 0.008
START = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
MODEL = load_model("VS-050")
KINEMATICS = Kinematics(MODEL)
LIMITS = Limits.of_model(MODEL)


def motion(request: JogRequest, start: tuple[float, ...] = START) -> JogMotion:
    path = (
        JointPath(MODEL, start, request)
        if request.frame == "joint"
        else ToolPath(KINEMATICS, start, np.eye(4), request)
    )
    return JogMotion(path, start, LIMITS, PERIOD, request.speed, request.step)


def run(moving: JogMotion, release_after: int = 10**6, start: tuple[float, ...] = START) -> np.ndarray:
    """Return all set-points until standstill, after checking them against the limits."""
    points = [start, start]
    while not moving.ended:
        if len(points) == release_after:
            moving.release()
        points.append(moving.next())
        assert len(points) < 20_000
    rows = np.array([*points, points[-1]])
    assert np.all(np.abs(np.diff(rows, axis=0)) <= np.array(LIMITS.velocity) * PERIOD * (1 + 1e-9))
    assert np.all(np.abs(np.diff(rows, n=2, axis=0)) <= np.array(LIMITS.acceleration) * PERIOD**2 * (1 + 1e-9))
    return rows


SOME = [(1, 1), (6, -1)]
OTHERS = [(axis, sign) for axis in range(1, 7) for sign in (1, -1) if (axis, sign) not in SOME]
DIRECTIONS = [*SOME, *(pytest.param(*each, marks=pytest.mark.soak) for each in OTHERS)]


@pytest.mark.parametrize("frame", ["joint", "base", "tool"])
@pytest.mark.parametrize(("axis", "sign"), DIRECTIONS)
def test_a_released_motion_stops_within_the_limits(frame, axis, sign):
    rows = run(motion(JogRequest(frame, axis, sign, 100)), release_after=60)
    assert abs(rows[-1] - rows[0]).max() > 1


def test_the_tool_moves_on_a_straight_line():
    rows = run(motion(JogRequest("base", 2, 1, 100)), release_after=80)
    places = KINEMATICS.forward(rows)
    assert np.allclose(places[:, [0, 2], 3], places[0, [0, 2], 3], atol=0.01)
    assert np.allclose(places[:, :3, :3], places[0, :3, :3], atol=1e-4)
    assert places[-1, 1, 3] - places[0, 1, 3] > 50


@pytest.mark.parametrize(("axis", "sign"), DIRECTIONS)
def test_a_joint_stops_before_its_limit(axis, sign):
    moving = motion(JogRequest("joint", axis, sign, 100))
    end = run(moving)[-1][axis - 1]
    limits = MODEL.axes[axis - 1]
    assert limits.lower <= end <= limits.upper
    assert min(end - limits.lower, limits.upper - end) < 5
    assert f"joint {axis} is at its limit" in moving.obstacle


@pytest.mark.parametrize("frame", ["base", "tool"])
@pytest.mark.parametrize(("axis", "sign"), DIRECTIONS)
def test_the_tool_stops_before_obstacles(frame, axis, sign):
    moving = motion(JogRequest(frame, axis, sign, 100))
    end = run(moving)[-1]
    assert not KINEMATICS.limits_exceeded(end)
    assert moving.obstacle


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_the_tool_does_not_start_at_a_singular_point(frame):
    start = (0.0, 45.0, 90.0, 0.0, 0.0, 0.0)
    moving = motion(JogRequest(frame, 2, 1, 50), start)
    assert np.allclose(run(moving, start=start), start)
    assert "singular" in moving.obstacle


@pytest.mark.parametrize(
    ("frame", "axis", "step"), [("joint", 3, 1.0), ("base", 1, 10.0), ("tool", 6, 5.0), ("base", 3, 0.1)]
)
def test_a_step_has_its_length(frame, axis, step):
    rows = run(motion(JogRequest(frame, axis, 1, 40, step)))
    if frame == "joint":
        assert rows[-1][axis - 1] - START[axis - 1] == pytest.approx(step, abs=1e-6)
    elif axis < 4:
        moved = KINEMATICS.forward(rows[-1])[axis - 1, 3] - KINEMATICS.forward(START)[axis - 1, 3]
        assert moved == pytest.approx(step, abs=1e-3)
    else:
        assert abs(rows[-1] - START).max() == pytest.approx(step, abs=1e-3)


def test_a_released_step_stops_early():
    rows = run(motion(JogRequest("joint", 1, 1, 20, 50)), release_after=100)
    assert 0.1 < rows[-1][0] < 49


@pytest.mark.parametrize(
    "request_",
    [JogRequest("joint", 7, 1, 10), JogRequest("base", 0, 1, 10), JogRequest("tool", 1, 1, 0), JogRequest("tool", 1, 2, 10),
     JogRequest("base", 1, 1, float("nan")), JogRequest("base", 1, 1, 10, 1000), JogRequest("wrong", 1, 1, 10)],
)  # fmt: skip
def test_invalid_requests_are_refused(request_):
    with pytest.raises(InvalidValue):
        request_.check(6)


# --- SCARA ------------------------------------------------------------------------------------------------------------

SCARA = Kinematics(load_model("HSR065"))
SCARA_START = (0.0, 60.0, 100.0, -60.0)


def jogged(request: JogRequest, release_after: int) -> np.ndarray:
    path = (
        JointPath(SCARA.model, SCARA_START, request)
        if request.frame == "joint"
        else ToolPath(SCARA, SCARA_START, np.eye(4), request)
    )
    moving = JogMotion(path, SCARA_START, Limits.of_model(SCARA.model), PERIOD, request.speed, request.step)
    points = []
    while not moving.ended:
        if len(points) == release_after:
            moving.release()
        points.append(moving.next())
    assert not SCARA.limits_exceeded(points[-1])
    return np.array(points)


@pytest.mark.parametrize("frame", ["joint", "base", "tool"])
def test_a_scara_jogs_up_and_down_in_mm(frame):
    rows = jogged(JogRequest(frame, 3, -1, 100), 60)
    assert rows[-1][2] < SCARA_START[2] - 10
    assert rows[-1][[0, 1, 3]] == pytest.approx([0, 60, -60], abs=1e-6)


def test_a_scara_turns_its_tool_in_place():
    rows = jogged(JogRequest("base", 6, 1, 100), 60)
    assert rows[-1][3] > SCARA_START[3] + 5
    assert rows[-1][:3] == pytest.approx(SCARA_START[:3], abs=1e-6)


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_scara_stops_at_the_end_of_its_reach_and_of_its_stroke(frame):
    x = jogged(JogRequest(frame, 1, 1, 100), 10**6)
    assert 0 < x[-1][1] < 45  # almost stretched out
    z = jogged(JogRequest(frame, 3, 1, 100), 10**6)
    assert 205 < z[-1][2] <= 220


@pytest.mark.parametrize("axis", [4, 5])
def test_a_scara_does_not_tilt_its_tool(axis):
    with pytest.raises(InvalidValue, match="tilt"):
        JogRequest("base", axis, 1, 10).check(4)
    JogRequest("base", axis, 1, 10).check(6)
