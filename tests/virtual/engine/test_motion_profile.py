from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.virtual.engine.motion.profile import SMOOTHING, MotionProfile

limits = st.floats(-4, 4).map(lambda exponent: 10**exponent)
profiles = st.builds(MotionProfile.trapezoid, limits, limits, limits)


def samples(profile: MotionProfile, count: int = 2001):
    return profile.states_at(np.linspace(-0.1, profile.duration + 0.1, count))


@given(limits, limits, limits)
def test_it_goes_from_rest_to_rest_within_its_limits(velocity, acceleration, deceleration):
    profile = MotionProfile.trapezoid(velocity, acceleration, deceleration)
    position, rate, change = samples(profile)
    assert (position[0], position[-1]) == (0, 1)
    assert np.all(np.diff(position) >= -1e-12)
    assert np.all(position <= 1)
    assert rate.min() >= -1e-7 * velocity
    assert rate.max() <= velocity * (1 + 1e-7)
    assert change.max() <= acceleration * (1 + 1e-7)
    assert change.min() >= -deceleration * (1 + 1e-7)
    last = profile.knots[-1]
    t = profile.duration - last.time
    assert last.position + t * (last.velocity + t * (last.acceleration / 2 + t * last.jerk / 6)) == pytest.approx(
        1, abs=1e-6
    )
    assert last.velocity + t * (last.acceleration + t * last.jerk / 2) == pytest.approx(0, abs=1e-6 * velocity)


@given(limits, limits, limits)
def test_the_jerk_is_limited(velocity, acceleration, deceleration):
    profile = MotionProfile.trapezoid(velocity, acceleration, deceleration)
    assert max(abs(knot.jerk) for knot in profile.knots) <= (acceleration + deceleration) / SMOOTHING * (1 + 1e-9)


@pytest.mark.parametrize(
    ("velocity", "acceleration", "deceleration", "trapezoid"),
    [
        (1.0, 1.0, 1.0, 2.0),  # no time at full speed: 1 s up, 1 s down
        (10.0, 1.0, 1.0, 2.0),
        (0.5, 1.0, 1.0, 2.5),
        (0.5, 1.0, 0.5, 2.75),
        (10.0, 2.0, 0.5, math.sqrt(2 * (1 / 2 + 1 / 0.5))),
    ],
)
def test_it_is_as_long_as_the_trapezoid_and_its_smoothing(velocity, acceleration, deceleration, trapezoid):
    profile = MotionProfile.trapezoid(velocity, acceleration, deceleration)
    assert profile.duration == pytest.approx(trapezoid + SMOOTHING)
    assert MotionProfile.trapezoid(velocity, acceleration, deceleration, 0.2).duration == pytest.approx(trapezoid + 0.2)


def test_it_is_the_moving_average_of_a_trapezoid():
    profile = MotionProfile.trapezoid(0.5, 1.0, 0.5, 0.3)
    times = np.linspace(0, 3.5, 35_001)
    trapezoid = np.clip(np.minimum(times, np.minimum(0.5, (2.75 - times) * 0.5)), 0, None)
    way = np.concatenate(([0], np.cumsum((trapezoid[1:] + trapezoid[:-1]) / 2 * 1e-4)))
    average = [
        way[max(0, n - 3000) : n + 1].mean() if n > 3000 else way[: n + 1].sum() / 3001 for n in range(0, 35_001, 500)
    ]
    assert profile.states_at(times[::500])[0] == pytest.approx(np.array(average), abs=2e-4)


@given(profiles, st.floats(-0.5, 1.5))
def test_one_moment_and_many_are_the_same(profile, part):
    time = profile.duration * part
    position, rate, _ = profile.states_at(np.array([time]))
    assert profile.at(time) == position[0]
    assert profile.rate(time) == rate[0]


@given(profiles)
def test_the_end_is_exact(profile):
    assert profile.at(profile.duration) == profile.at(profile.duration + 1e9) == 1.0
    assert profile.at(0) == profile.at(-1) == 0.0
    assert profile.rate(profile.duration) == profile.rate(0) == 0.0
    assert profile.at(math.nextafter(profile.duration, 0)) <= 1.0


@given(profiles)
def test_it_begins_to_slow_down_at_slowing(profile):
    _, _, change = profile.states_at(np.linspace(0, profile.slowing * (1 - 1e-9), 500))
    assert change.min() >= -1e-6 * np.abs([knot.acceleration for knot in profile.knots]).max()
    _, _, change = profile.states_at(np.linspace(profile.slowing + SMOOTHING, profile.duration, 500))
    assert change.max() <= 1e-6 * np.abs([knot.acceleration for knot in profile.knots]).max()


@given(profiles, st.floats(1, 1000))
def test_stretched_is_the_same_profile_slower(profile, factor):
    slow = profile.stretched(profile.duration * factor)
    assert slow.duration == pytest.approx(profile.duration * factor)
    assert slow.slowing == pytest.approx(profile.slowing * factor)
    parts = np.linspace(0, 1, 101)
    position, rate, change = profile.states_at(parts * profile.duration)
    slow_position, slow_rate, slow_change = slow.states_at(parts * slow.duration)
    assert slow_position == pytest.approx(position, abs=1e-9)
    assert slow_rate * factor == pytest.approx(rate, abs=1e-6 * rate.max())
    assert slow_change * factor**2 == pytest.approx(change, abs=1e-6 * np.abs(change).max())


def test_stretched_never_makes_it_faster():
    profile = MotionProfile.trapezoid(1, 1, 1)
    assert profile.stretched(0.1) is profile
    assert profile.stretched(-1) is profile
    with pytest.raises(ValueError, match="duration"):
        profile.stretched(math.nan)


@given(profiles)
def test_moments_is_the_inverse_of_the_profile(profile):
    parts = np.linspace(0, 1, 101)
    assert profile.states_at(profile.moments(parts))[0] == pytest.approx(parts, abs=1e-4)


def test_a_motion_of_length_0_takes_no_time():
    profile = MotionProfile.instant()
    assert (profile.duration, profile.at(0), profile.at(1), profile.rate(0)) == (0, 1, 1, 0)
    position, rate, change = profile.states_at(np.array([-1.0, 0.0, 1.0]))
    assert (position.tolist(), rate.tolist(), change.tolist()) == ([0, 1, 1], [0, 0, 0], [0, 0, 0])
    assert profile.stretched(5) is profile


@pytest.mark.parametrize("wrong", [0, -1, math.nan, math.inf, 1e-300])
@pytest.mark.parametrize("place", range(4))
def test_limits_are_finite_and_above_0(wrong, place):
    values = [1.0, 1.0, 1.0, 0.04]
    values[place] = wrong
    with pytest.raises(ValueError, match="limit"):
        MotionProfile.trapezoid(*values)


@pytest.mark.parametrize("ratio", [1e-12, 1e-6, 1e6, 1e12])
def test_very_different_limits(ratio):
    profile = MotionProfile.trapezoid(1e6, 1e-3, 1e-3 * ratio)
    position, rate, change = samples(profile)
    assert math.isfinite(profile.duration)
    assert np.all(np.diff(position) >= -1e-9)
    assert change.max() <= 1e-3 * (1 + 1e-6)
    assert change.min() >= -1e-3 * ratio * (1 + 1e-6)
    assert rate.min() >= -1e-6 * rate.max()
