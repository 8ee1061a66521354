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
    while clock.now() < 1000:  # a millisecond of ours
        pass
    assert clock.wall() - datetime.now() > timedelta(seconds=900)


@pytest.mark.parametrize("scale", [0, -1, float("nan"), float("inf")])
def test_a_scale_is_positive(scale):
    with pytest.raises(ValueError, match="scale"):
        Clock(scale)


def test_a_manual_clock_moves_only_by_hand():
    clock = ManualClock(datetime(2030, 1, 2))
    assert (clock.now(), clock.wall()) == (0, datetime(2030, 1, 2))
    clock.advance(1.5)
    clock.advance(0)
    assert (clock.now(), clock.wall()) == (1.5, datetime(2030, 1, 2, 0, 0, 1, 500_000))
    for step in (-0.1, float("nan")):
        with pytest.raises(ValueError, match="back"):
            clock.advance(step)
    assert clock.now() == 1.5
