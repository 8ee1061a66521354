"""Operation of the page Slave Move in a browser."""

from __future__ import annotations

import re
import time
from typing import Any

from orinkit.virtual.rc8 import VirtualRC8
from support.waiting import PATIENCE

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
UNHEARD = "nothing was received from the browser for 1.5 s"
BLOCKED = "the Tester was blocked for more than 1 s"
BUSY = re.compile(f"{UNHEARD}|{BLOCKED}")  # also occur on a busy machine


def opened(page: Any, url: str) -> Any:
    """Open the page, and wait until the user of the test before has lost the controls."""
    page.goto(f"{url}/slave-move")
    page.get_by_test_id("controls").get_by_text(re.compile("You hold|are free")).wait_for()
    page.get_by_test_id("timeout").fill("30000")  # a busy machine
    return page


def ready(page: Any) -> None:
    """Wait until the trajectory has passed the check."""
    page.get_by_test_id("check").get_by_text("check passed").wait_for()
    page.locator('[data-testid="start"]:not(.disabled)').wait_for()


def generate(page: Any, *, amplitude: float = 20.0, period: float = 4.0, repetitions: int = 50) -> None:
    page.get_by_test_id("amplitude").fill(f"{amplitude}")
    page.get_by_test_id("repetitions").fill(f"{repetitions}")
    page.get_by_test_id("period").fill(f"{period}")  # the last change determines the duration
    total = f"Total {repetitions * period + period / 2:.3f} s"
    page.get_by_test_id("total").get_by_text(total).wait_for()
    ready(page)


def start(page: Any, rc8: VirtualRC8) -> None:
    """Press Start, and wait until set-points move the arm; again if a busy machine has delayed the heartbeats."""
    arm = rc8.state.arm

    def moves() -> bool:
        return arm.slave.mode is not None and abs(arm.queue.joints[0] - HOME[0]) > 1.0

    end = time.monotonic() + 3 * PATIENCE
    while True:
        page.locator('[data-testid="start"]:not(.disabled)').click()
        page.locator('[data-testid="start"].disabled').wait_for()
        while not moves() and page.locator('[data-testid="start"].disabled').count():
            time.sleep(0.1)
        if moves():
            return
        assert BUSY.search(outcome_of(page)), (outcome_of(page), page.get_by_test_id("error-run").text_content())
        assert time.monotonic() < end


def outcome_of(page: Any) -> str:
    return page.get_by_test_id("outcome").text_content() or ""


def complete(page: Any) -> None:
    """Press Start, and wait until all set-points are sent; again if a busy machine has delayed the heartbeats."""
    while True:
        page.get_by_test_id("start").click()
        page.locator('[data-testid="start"].disabled').wait_for()
        page.locator('[data-testid="start"]:not(.disabled)').wait_for()
        page.get_by_test_id("outcome").get_by_text(re.compile("Complete|Stopped")).wait_for()
        if not BUSY.search(outcome_of(page)):
            break
    assert "Complete" in outcome_of(page)


def stopped(page: Any, reason: str) -> None:
    """Wait until the page shows why the arm was stopped; on a busy machine the heartbeats may be missed before."""
    page.get_by_test_id("outcome").get_by_text(re.compile(f"Stopped: ({re.escape(reason)}|{BUSY.pattern})")).wait_for()
