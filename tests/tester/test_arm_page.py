"""The page Arm: jogging moves the arm of the controller and stops in every case in which the user is gone."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.tester.ui.hold import HEARTBEAT
from orinkit.virtual.rc8 import VirtualRC8
from support.browser import ARGUMENTS, CHROMIUM, TesterProcess, needs_browser, user
from support.jog_page import HIDE, JogPage
from support.relay import Relay
from support.stopping import stopped
from support.streams import Arm
from support.waiting import PATIENCE, until

pytestmark = [needs_browser, pytest.mark.soak]


@pytest.fixture(scope="module")
def first_user(browser: Any) -> Iterator[Any]:
    with user(browser) as page:
        yield page.context


@pytest.fixture
def page(first_user: Any) -> Iterator[Any]:
    """A page of the same user for all tests, because a new user would have to wait for the controls."""
    page = first_user.new_page()
    yield page
    page.close()


@pytest.fixture
def arm(bench: Any) -> Iterator[Arm]:
    arm = Arm(bench.rc8, bench.server.url)
    yield arm
    until(arm.free)


@pytest.fixture
def jogging(page: Any, bench: Any, arm: Arm) -> JogPage:
    return JogPage(page, bench.tester.url, arm).enable()


def test_the_arm_moves_while_a_button_is_held_and_stops_at_release(jogging):
    jogging.hold("j1+")
    until(lambda: jogging.arm.arm.queue.joints[0] > 2)
    jogging.page.mouse.up()
    assert jogging.moved() > 2
    assert jogging.arm.mode  # slave mode remains on, so that the next motion begins at once
    first = jogging.arm.commands[-1]
    jogging.page.get_by_test_id("jog-frame").get_by_text("Base").click()
    jogging.button("z-").wait_for()
    jogging.hold("z-")
    jogging.page.mouse.move(0, 0)  # the pointer leaves the button
    jogging.moved()
    assert abs(jogging.arm.commands[-1] - first).max() > 0
    jogging.finish()


def test_the_arm_stops_when_the_page_is_hidden(jogging):
    jogging.hold()
    jogging.page.evaluate(HIDE)
    assert jogging.moved() > 0
    until(jogging.arm.free)


def test_the_arm_stops_when_the_tester_is_killed(browser, tmp_path):
    rc8 = VirtualRC8(motor=True)
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
        TesterProcess(server.url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        jogging = JogPage(page, tester.url, Arm(rc8, server.url)).enable()
        jogging.hold()
        os.kill(tester.process.pid, signal.SIGKILL)
        assert jogging.moved() > 0
        until(jogging.arm.free)


def test_every_user_can_press_the_emergency_stop(browser, tmp_path):
    with TesterProcess("--virtual", "rc8", folder=tmp_path) as tester, user(browser) as first, user(browser) as second:
        first.goto(f"{tester.url}/arm")
        first.get_by_test_id("chip-mode").wait_for()
        second.goto(f"{tester.url}/arm")
        second.get_by_test_id("emergency-stop").click()
        first.locator('[data-testid="emergency-stop"][aria-pressed="true"]').wait_for()
        second.get_by_test_id("emergency-stop").click()  # only the user who holds the controls can release it
        second.get_by_test_id("error-pendant").get_by_text("another user holds the controls").wait_for()
        first.get_by_test_id("emergency-stop").click()
        second.locator('[data-testid="emergency-stop"][aria-pressed="false"]').wait_for()


# --- soak ------------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_the_arm_stops_when_the_page_is_closed(jogging):
    jogging.hold()
    jogging.page.close()
    assert jogging.moved() > 0
    until(jogging.arm.free)


@pytest.mark.soak
@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_the_arm_moves_while_a_key_is_held(jogging, key):
    before = jogging.arm.arm.queue.joints
    jogging.button("j2-").focus()
    jogging.page.keyboard.down(key)
    until(lambda: jogging.arm.arm.queue.joints[1] < before[1] - 1)
    jogging.page.keyboard.up(key)
    assert jogging.moved() > 1
    jogging.finish()


@pytest.mark.soak
def test_the_arm_stops_when_the_browser_is_killed(browser, bench, arm):
    own = browser.browser_type.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
    page = own.new_page()
    page.set_default_timeout(PATIENCE * 1000)
    jogging = JogPage(page, bench.tester.url, arm).enable()
    jogging.hold()
    processes = own.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    os.kill(next(each["id"] for each in processes if each["type"] == "browser"), signal.SIGKILL)
    assert jogging.moved() > 0
    until(arm.free)


@pytest.mark.soak
def test_the_arm_stops_when_the_network_fails(page, bench, arm):
    with Relay(bench.tester.url) as relay:
        jogging = JogPage(page, relay.url, arm).enable()
        jogging.hold()
        relay.cut()
        assert jogging.moved() > 0
        until(jogging.arm.free)


@pytest.mark.soak
def test_the_arm_stops_when_the_user_leaves_the_page(jogging, bench):
    jogging.hold()
    jogging.page.goto(bench.tester.url)
    assert jogging.moved() > 0
    until(jogging.arm.free)


@pytest.mark.soak
def test_the_arm_stops_when_the_browser_hangs(jogging):
    jogging.hold()
    jogging.page.evaluate("setTimeout(() => { const end = Date.now() + 5000; while (Date.now() < end); }, 0)")
    assert jogging.moved() > 0
    until(jogging.arm.free)


@pytest.mark.soak
def test_the_arm_stops_when_the_tester_hangs(browser, tmp_path):
    rc8 = VirtualRC8(motor=True)
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
        TesterProcess(server.url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        jogging = JogPage(page, tester.url, Arm(rc8, server.url)).enable()
        jogging.hold()
        with stopped(tester.process.pid):
            assert jogging.moved() > 0
            time.sleep(2 * HEARTBEAT)  # after a shorter time, the arm may continue, because the button is held
        until(jogging.arm.free)
        assert jogging.arm.within_limits()


@pytest.mark.soak
def test_another_user_takes_over(browser, jogging, bench):
    with user(browser) as other:
        other.goto(f"{bench.tester.url}/arm")
        other.get_by_test_id("controls").wait_for()
        jogging.hold()
        jogging.page.get_by_test_id("controls").locator("xpath=..").get_by_role("button").dispatch_event("click")
        assert jogging.moved() > 0
    until(jogging.arm.free)


@pytest.mark.soak
def test_the_stop_button_ends_jogging(jogging):
    jogging.hold()
    jogging.page.keyboard.press("Escape")
    assert jogging.moved() > 0
    until(jogging.arm.free)
    jogging.page.get_by_test_id("jog-state").get_by_text("Off").wait_for()


@pytest.mark.soak
def test_a_step_has_its_length(jogging):
    jogging.page.get_by_test_id("jog-frame").get_by_text("Base").click()
    jogging.page.get_by_test_id("jog-step").get_by_text("5", exact=True).click()
    before = jogging.arm.arm.space.kinematics.forward(jogging.arm.arm.queue.joints)
    jogging.hold("y+")
    jogging.page.mouse.up()
    jogging.moved()
    after = jogging.arm.arm.space.kinematics.forward(jogging.arm.arm.queue.joints)
    assert list((after - before)[:3, 3]) == pytest.approx([0, 5, 0], abs=0.01)
    jogging.finish()


@pytest.mark.soak
def test_the_arm_stops_before_its_limit(jogging):
    jogging.page.get_by_test_id("jog-step").get_by_text("Hold").click()
    set_slider(jogging.page, "jog-speed", 100)
    message = jogging.page.get_by_test_id("jog-message")
    while True:
        jogging.hold("j5+")
        until(lambda: "joint 5 is at its limit" in message.inner_text() or jogging.ended)
        jogging.moved()
        if not jogging.ended:
            break
        jogging.page.mouse.up()  # a busy machine has delayed the heartbeats
        jogging.enable_again()
    assert 119 < jogging.arm.arm.queue.joints[4] <= 120
    jogging.page.mouse.up()
    jogging.finish()


@pytest.mark.soak
def test_a_pose_is_saved_and_reached(page, bench, arm):
    jogging = JogPage(page, bench.tester.url, arm)
    saved = arm.arm.queue.joints
    page.get_by_test_id("pose-name").fill("<b>Home</b>")
    page.get_by_test_id("pose-save").click()
    page.get_by_text("<b>Home</b>").wait_for()
    jogging.enable()
    jogging.hold("j1-")
    page.mouse.up()
    jogging.moved()
    page.get_by_test_id("pose-move").click()  # ends jogging
    until(lambda: arm.free() and arm.arm.queue.joints == pytest.approx(saved, abs=1e-3))
    page.get_by_test_id("pose-delete").click()
    page.get_by_text("No pose is saved").wait_for()


def set_slider(page: Any, marker: str, value: int) -> None:
    page.get_by_test_id(marker).locator("xpath=descendant-or-self::*[@tabindex]").first.focus()
    page.keyboard.press("End" if value == 100 else "Home")
