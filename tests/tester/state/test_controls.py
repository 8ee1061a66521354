"""The controls: one user operates, the others watch."""

from __future__ import annotations

import pytest

from orinkit.tester.state.controls import GRACE, Controls, ControlsHeld


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_first_user_holds_the_controls():
    controls = Controls()
    controls.enter("a")
    controls.enter("b")
    assert controls.held_by("a")
    with pytest.raises(ControlsHeld):
        controls.require("b")
    controls.give_up("b")
    assert controls.held_by("a")


def test_free_controls_go_to_the_next_who_operates():
    controls = Controls()
    controls.enter("a")
    controls.enter("b")
    controls.give_up("a")
    assert controls.holder == ""
    controls.require("b")
    with pytest.raises(ControlsHeld):
        controls.take("a")


def test_a_user_who_reloads_the_page_keeps_the_controls():
    clock = Clock()
    controls = Controls(clock)
    controls.enter("a")
    controls.leave("a")
    clock.now = GRACE - 0.1
    controls.enter("b")
    controls.enter("a")
    clock.now = 10 * GRACE
    assert controls.held_by("a")


def test_a_user_who_has_left_loses_the_controls():
    clock = Clock()
    controls = Controls(clock)
    controls.enter("a")
    controls.enter("a")
    controls.leave("a")
    clock.now = 10 * GRACE
    assert controls.held_by("a")  # another page is open
    controls.leave("a")
    clock.now = 11 * GRACE
    controls.require("b")
    assert controls.held_by("b")
