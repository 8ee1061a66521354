"""The check that reports all limit violations of a trajectory."""

from __future__ import annotations

import pytest

from orinkit.core import i18n
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory.limit_violations import TrajectoryError
from orinkit.streaming.trajectory.preflight import POSITION, find_violations
from orinkit.streaming.trajectory.trajectory import check_trajectory

PERIOD = 0.01
LIMITS = Limits((-100.0,) * 2, (100.0,) * 2, (100.0,) * 2, (1000.0,) * 2, (20000.0,) * 2)


def ramp(speeds):
    """Return the points of joint 1 for velocities in deg/s; joint 2 stays at 0."""
    place, points = 0.0, [(0.0, 0.0)]
    for speed in speeds:
        place += speed * PERIOD
        points.append((place, 0.0))
    return points


def test_a_trajectory_within_the_limits_has_no_violations():
    assert find_violations(ramp([5, 10, 10, 5, 0]), LIMITS, PERIOD) == []


def test_each_group_of_set_points_is_one_violation_with_its_largest_value():
    speeds = [*range(10, 130, 10), *range(110, 0, -10), 0, *range(10, 120, 10), *range(100, -10, -10)]
    found = find_violations(ramp(speeds), LIMITS, PERIOD)
    assert [(each.sample, each.last, each.axis, each.what) for each in found] == [
        (11, 13, 1, "velocity"), (35, 35, 1, "velocity"),
    ]  # fmt: skip
    assert found[0].value == pytest.approx(120.0)
    assert found[1].value == pytest.approx(110.0)
    assert [each.limit for each in found] == [100.0, 100.0]
    assert found[0].time == pytest.approx(0.11)


def test_the_first_violation_is_that_of_the_other_check():
    points = ramp([50, 50, 0])
    found = find_violations(points, LIMITS, PERIOD)
    with pytest.raises(TrajectoryError) as caught:
        check_trajectory(points, LIMITS, None, PERIOD)
    assert (found[0].sample, found[0].axis) == (caught.value.sample, caught.value.axis) == (1, 1)
    assert found[0].what == "acceleration"


def test_positions_beyond_both_ends_of_the_range_are_found():
    points = [(0.0, 101.5)] * 3 + [(0.0, 0.0)] * 2 + [(0.0, -100.5)]
    outside = [each for each in find_violations(points, LIMITS, PERIOD) if each.what == POSITION]
    assert [(each.sample, each.last, each.axis, each.value, each.limit) for each in outside] == [
        (0, 2, 2, 101.5, 100.0), (5, 5, 2, -100.5, -100.0),
    ]  # fmt: skip


def test_a_trajectory_that_ends_while_moving_violates_the_acceleration_at_the_stop():
    found = find_violations(ramp([10, 20, 30]), LIMITS, PERIOD)
    assert [(each.sample, each.what) for each in found] == [(4, "acceleration")]


def test_a_start_at_another_place_is_a_violation_of_the_first_set_point():
    assert find_violations([(0.0, 0.0)] * 3, LIMITS, PERIOD, start=(0.0, 5.0))[0].sample == 0


def test_tool_limits_apply_to_positions():
    limits = PathLimits(100.0, 1000.0, 20000.0, 90.0, 900.0, 18000.0)
    points = [(place, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0) for place in (0.0, 0.0, 2.0, 2.0, 2.0)]
    found = find_violations(points, limits, PERIOD, "P")
    assert {(each.axis, each.what) for each in found} == {(0, "tool velocity"), (0, "tool acceleration")}


def test_the_text_names_set_point_axis_value_and_limit_in_both_languages():
    violation = find_violations(ramp([10, 30, 10, 0]), LIMITS, PERIOD)[0]
    assert str(violation) == (
        "sample 2 (counted from 0, at 0.020 s), J1: acceleration 2000.000 deg/s^2, the limit is 1000"
    )
    i18n.use("ja")
    assert "2000.000" in str(violation)
    assert "the limit" not in str(violation)
