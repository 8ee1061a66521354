from __future__ import annotations

from datetime import datetime, timedelta

import pytest

from orinkit.virtual.clock import Clock, ManualClock


def test_a_clock_goes_forward_with_the_computers():
    clock = Clock()
    first = clock.now()
    assert 0 <= first <= clock.now()
    before = datetime.now()
    assert before <= clock.wall() <= datetime.now()


def test_a_scaled_clock_runs_by_its_scale():
    clock = Clock(scale=1_000_000)
    while clock.now() < 1000:  # a millisecond of real time
        pass
    assert clock.wall() - datetime.now() > timedelta(seconds=900)


@pytest.mark.parametrize("scale", [0, -1, float("nan"), float("inf"), 1e308, 1.1e6, 0.9e-6, 5e-324])
def test_a_scale_is_positive_and_sensible(scale):
    with pytest.raises(ValueError, match=r"scale must be positive, from 0\.000001 to 1000000, not "):
        Clock(scale)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_least_and_the_most_scale(scale):
    clock = Clock(scale)
    assert clock.scale == scale
    assert clock.now() >= 0
    assert clock.patience > 0


def test_only_advance_moves_a_manual_clock():
    clock = ManualClock(datetime(2030, 1, 2))
    assert (clock.now(), clock.wall()) == (0, datetime(2030, 1, 2))
    clock.advance(1.5)
    clock.advance(0)
    assert (clock.now(), clock.wall()) == (1.5, datetime(2030, 1, 2, 0, 0, 1, 500_000))
    for step in (-0.1, float("nan")):
        with pytest.raises(ValueError, match="0 or more"):
            clock.advance(step)
    assert clock.now() == 1.5
