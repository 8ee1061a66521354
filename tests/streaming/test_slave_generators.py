"""Generated trajectories: a sine on a joint, a line and a circle in space."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from orinkit.arms import load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.core.errors import InvalidValue
from orinkit.streaming.planning.limits import Limits
from orinkit.streaming.trajectory import generators
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.streaming.trajectory.preflight import find_violations

MODEL = load_model("VS-050")
HOME = MODEL.home
LIMITS = Limits.of_model(MODEL)
PERIOD = 0.008


def test_a_sine_moves_one_joint_around_its_starting_position():
    points = generators.sine(HOME, 2, 10.0, 2.0, 3)
    column = [point[1] for point in points]
    assert max(column) == pytest.approx(HOME[1] + 10.0, abs=0.01)
    assert min(column) == pytest.approx(HOME[1] - 10.0, abs=0.01)
    assert all(point[:1] + point[2:] == HOME[:1] + HOME[2:] for point in points)
    crossings = sum((a - HOME[1]) * (b - HOME[1]) < 0 for a, b in pairwise(column[1:-1]))
    assert crossings == 2 * 3 - 1
    assert (len(points) - 1) * PERIOD == pytest.approx(3 * 2.0 + 1.0)


@pytest.mark.parametrize(
    "points",
    [
        generators.sine(HOME, 1, -20.0, 4.0),
        generators.line(MODEL, HOME, (30.0, -20.0, 10.0), 4.0),
        generators.circle(MODEL, HOME, 30.0, "YZ", 4.0, 2),
    ],
)
def test_generated_trajectories_begin_and_end_at_standstill(points):
    assert points[0] == points[-1] == pytest.approx(HOME)
    assert find_violations(points, LIMITS, PERIOD) == []
    assert max(abs(a - b) for a, b in zip(points[0], points[1], strict=True)) < 0.001


def test_a_line_is_straight_and_keeps_the_orientation():
    frames = Kinematics(MODEL).forward(generators.line(MODEL, HOME, (40.0, 0.0, -30.0), 3.0))
    offsets = frames[:, :3, 3] - frames[0, :3, 3]
    far = np.linalg.norm(offsets, axis=1)
    assert far.max() == pytest.approx(50.0, abs=0.01)
    assert np.allclose(np.cross(offsets, (40.0, 0.0, -30.0)), 0.0, atol=1e-3)
    assert np.allclose(frames[:, :3, :3], frames[0, :3, :3], atol=1e-8)


@pytest.mark.parametrize(("plane", "first", "second"), [("XY", 0, 1), ("YZ", 1, 2), ("ZX", 2, 0)])
def test_a_circle_has_its_radius_and_its_plane(plane, first, second):
    frames = Kinematics(MODEL).forward(generators.circle(MODEL, HOME, 25.0, plane, 3.0))
    offsets = frames[:, :3, 3] - frames[0, :3, 3]
    assert np.allclose(np.hypot(offsets[:, first] + 25.0, offsets[:, second]), 25.0, atol=1e-6)
    assert np.allclose(offsets[:, 3 - first - second], 0.0, atol=1e-6)
    assert offsets[:, first].min() == pytest.approx(-50.0, abs=0.01)
    assert offsets[1 : len(offsets) // 4, second].min() > 0.0


@pytest.mark.parametrize(
    "generate",
    [
        lambda: generators.sine(HOME, 0, 10.0, 2.0),
        lambda: generators.sine(HOME, 7, 10.0, 2.0),
        lambda: generators.sine(HOME, 1, math.nan, 2.0),
        lambda: generators.sine(HOME, 1, 10.0, 0.0),
        lambda: generators.sine(HOME, 1, 10.0, 2.0, 0),
        lambda: generators.sine(HOME, 1, 10.0, 3600.0, 10_000),
        lambda: generators.circle(MODEL, HOME, -1.0, "XY", 2.0),
        lambda: generators.circle(MODEL, HOME, 1.0, "XX", 2.0),
        lambda: generators.line(MODEL, HOME, (math.inf, 0.0, 0.0), 2.0),
    ],
)
def test_invalid_parameters_are_refused(generate):
    with pytest.raises(InvalidValue):
        generate()


def test_a_line_out_of_reach_is_refused():
    with pytest.raises(TrajectoryError, match="cannot follow"):
        generators.line(MODEL, HOME, (5000.0, 0.0, 0.0), 2.0)


@pytest.mark.parametrize(("period", "cycles"), [(2.0, 375), (3.2, 600), (3.0, 563)])
def test_the_duration_is_the_smallest_sufficient_number_of_cycles(period, cycles):
    assert len(generators.sine(HOME, 1, 5.0, period)) == cycles + 1
