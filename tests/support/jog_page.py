"""Operation of the page Arm in a browser."""

from __future__ import annotations

from typing import Any

from support.streams import Arm
from support.waiting import until

HIDE = """Object.defineProperty(document, 'hidden', {value: true, configurable: true});
document.dispatchEvent(new Event('visibilitychange'))"""


class JogPage:
    """The page Arm of a user, and the arm that it moves."""

    def __init__(self, page: Any, url: str, arm: Arm) -> None:
        self.page, self.arm = page, arm
        page.goto(f"{url}/arm")
        page.get_by_test_id("joint-1").wait_for()

    def enable(self) -> JogPage:
        until(self.takes_controls)
        self.page.get_by_test_id("jog-enable").click()
        self.button("j1+").and_(self.page.locator('[aria-disabled="false"]')).wait_for()
        self.arm.record()
        return self

    def takes_controls(self) -> bool:
        """Take the controls if they are free; return True if this user holds them."""
        text = self.page.get_by_test_id("controls")
        if text.inner_text() == "The controls are free":
            text.locator("xpath=..").get_by_role("button").click()
        self.page.wait_for_timeout(50)
        return str(text.inner_text()) == "You hold the controls"

    def button(self, name: str) -> Any:
        return self.page.get_by_test_id(f"jog-{name}")

    def hold(self, name: str = "j1+") -> None:
        """Press a button and wait until the arm moves; again if a busy machine has delayed the heartbeats."""
        before = self.arm.arm.queue.joints
        while True:
            self.button(name).hover()
            self.page.mouse.down()
            until(lambda: self.arm.arm.queue.joints != before or self.ended)
            if self.arm.arm.queue.joints != before:
                return
            self.page.mouse.up()
            self.enable_again()

    def enable_again(self) -> None:
        """Enable jogging that the page has ended."""
        until(self.arm.free)
        self.enable()

    @property
    def ended(self) -> bool:
        """True if the page has ended jogging."""
        return bool(self.page.get_by_test_id("jog-state").inner_text() == "Off")

    def moved(self) -> float:
        """Wait for standstill; return the largest motion of a joint since the start of the log, after checking the limits."""
        until(self.standing)
        commands = self.arm.commands
        assert self.arm.within_limits(), self.arm.peaks()
        assert not self.arm.errors
        return float(abs(commands - commands[0]).max())

    def standing(self) -> bool:
        commands = self.arm.commands
        return len(commands) > 20 and bool((commands[-20:] == commands[-1]).all())

    def finish(self) -> None:
        """End jogging, so that the arm is free for the next test."""
        switch = self.page.get_by_test_id("jog-enable")
        if self.arm.arm.holder is not None:
            switch.click()
        until(self.arm.free)
