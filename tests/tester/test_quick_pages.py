"""One quick test or two of each page, with one browser, one Tester and one user; the other tests run in ``make soak``.

The pages Raw packets and ABH3 have quick tests of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.cao import functions as f
from orinkit.rc8.task_modes import TaskStatus
from orinkit.values.variant import Variant, VarType
from support.browser import needs_browser, user
from support.jog_page import HIDE, JogPage
from support.objects_page import add, choose_type, expect, fill, open_objects, open_tab
from support.received import received_packets
from support.relay import Relay
from support.slave_page import HOME, complete, generate, opened, start, stopped
from support.streams import Arm
from support.waiting import until

pytestmark = needs_browser

ENDLESS = "Sub Main\n  Do While True\n    I[1] = I[1] + 1\n    Delay 10\n  Loop\nEnd Sub\n"


@pytest.fixture(scope="module")
def visitor(browser: Any, bench: Any) -> Iterator[Any]:
    """One user for all tests, because a new user would have to wait for the controls."""
    with user(browser) as page:
        page.goto(bench.tester.url)  # remains open, so that the user keeps the controls
        yield page.context


@pytest.fixture
def page(visitor: Any) -> Iterator[Any]:
    opened_page = visitor.new_page()
    yield opened_page
    opened_page.close()


@pytest.fixture
def arm(bench: Any) -> Iterator[Arm]:
    """The arm at its home position; after the test, it is at standstill and free."""
    arm = Arm(bench.rc8, bench.server.url)
    with orinkit.connect(bench.server.url) as controller, controller.robot() as robot, robot.arm():
        robot.move(orinkit.J(*HOME), "@E")
    arm.record()
    yield arm
    until(arm.free)
    assert not arm.errors


def test_connections(page, bench):
    page.goto(bench.tester.url)
    row = page.get_by_test_id(f"connection-{bench.server.url.removeprefix('tcp://')}")
    row.get_by_text("connected", exact=True).wait_for()
    assert bench.server.clients >= 1


def test_the_arm_moves_while_a_button_is_held_and_stops_when_the_page_is_hidden(page, bench, arm):
    jogging = JogPage(page, bench.tester.url, arm).enable()
    page.locator('[data-testid="scene"][data-ready]').wait_for()
    for _ in range(5):
        jogging.hold("j1+")
        page.mouse.up()
        assert jogging.moved() > 0
        if arm.mode:  # slave mode remains on, so that the next motion begins at once
            break
    else:  # a machine that stalls for longer than the heartbeat ends it, but not every time
        pytest.fail("slave mode was switched off each time the button was released")
    jogging.hold("j1-")
    page.evaluate(HIDE)
    assert jogging.moved() > 0


def test_the_arm_stops_when_the_network_fails_during_jogging(page, bench, arm):
    with Relay(bench.tester.url) as relay:
        jogging = JogPage(page, relay.url, arm).enable()
        jogging.hold()
        relay.cut()
        assert jogging.moved() > 0
        until(arm.free)


def test_a_variable_is_written_and_its_packet_is_shown(page, bench):
    with received_packets() as received:
        open_objects(page, bench.tester.url)
        add(page, "Variable", "I10")
        fill(page, "value", "4x")
        expect(page.get_by_test_id("object")).to_contain_text("expected a whole number")
        page.get_by_test_id("put").click()
        fill(page, "value", "4711")
        page.get_by_test_id("put").click()
        expect(page.get_by_test_id("value-result-code")).to_have_text("0x00000000 S_OK")
        (sent,) = received.of(f.variable_put_value)
    assert sent.arguments[1] == Variant(VarType.I4, 4711)
    page.goto(f"{bench.tester.url}/packets")
    page.get_by_test_id("filter-text").fill("4711")
    page.get_by_test_id("packet-count").filter(has_text=re.compile("^1 of ")).wait_for()
    page.locator("[data-number]").first.click()
    data = packet.encode(sent)
    page.wait_for_function("size => document.querySelectorAll('.ok-byte[data-byte]').length === size", arg=len(data))
    shown = page.locator('[data-testid="packet-bytes"] .ok-byte[data-byte]').all_text_contents()
    assert bytes.fromhex(" ".join(shown)) == data


def test_the_stop_button_stops_a_move_of_the_page_objects(page, bench, arm):
    with received_packets() as received:
        open_objects(page, bench.tester.url)
        add(page, "Robot", "Arm")
        open_tab(page, "Execute")
        fill(page, "command", "TakeArm")
        choose_type(page, "parameter", "ARRAY | I4")
        fill(page, "parameter", "0,1")
        page.get_by_test_id("execute").click()
        expect(page.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
        open_tab(page, "Move")
        fill(page, "pose", "@E J(90,0,90,0,90,0)")
        fill(page, "move-option", "SPEED=1")
        page.get_by_test_id("move").click()
        until(lambda: arm.arm.busy)
        page.get_by_test_id("stop-all").click()
        expect(page.get_by_test_id("result-error")).to_contain_text("0x8")
        assert received.of(f.robot_halt)
        page.get_by_role("button", name="Release Arm").click()  # gives the arm
        until(arm.free)
    assert arm.within_limits()


def test_a_variable_is_watched_and_written_in_place(page, bench):
    page.goto(f"{bench.tester.url}/monitor")
    page.get_by_test_id("watch-name").fill("I20")
    page.get_by_test_id("watch-add").click()
    row = page.get_by_test_id("watch-I20")
    row.get_by_test_id("value").get_by_text("0", exact=True).wait_for()
    row.get_by_test_id("edit").click()
    row.get_by_test_id("new-value").fill("42")
    row.get_by_test_id("write").click()
    row.get_by_test_id("value").get_by_text("42", exact=True).wait_for()
    with orinkit.connect(bench.server.url) as controller:
        assert controller.variable("I20").value == 42


def test_a_file_is_edited_and_its_task_is_stopped_when_the_page_is_closed(visitor, bench):
    page = visitor.new_page()
    files, tasks = bench.rc8.state.files, bench.rc8.state.tasks
    files.create("Endless.pcs")
    files.write("Endless.pcs", b"Sub Main\nEnd Sub\n")
    page.goto(f"{bench.tester.url}/programs")
    page.get_by_test_id("file-Endless.pcs").click()
    page.get_by_test_id("editor-title").get_by_text("Endless.pcs").wait_for()
    page.locator(".cm-content").click()
    page.keyboard.press("Control+A")
    page.keyboard.insert_text(ENDLESS)
    page.get_by_test_id("unsaved").wait_for()
    page.keyboard.press("Control+S")
    page.get_by_test_id("unsaved").wait_for(state="hidden")
    assert files.read("Endless.pcs").decode() == ENDLESS
    page.get_by_test_id("task-Endless").get_by_test_id("start").click()
    until(lambda: tasks.get_or_create("Endless").status is TaskStatus.RUNNING)
    page.close()
    until(lambda: tasks.get_or_create("Endless").status is not TaskStatus.RUNNING)


def test_a_trajectory_is_executed(page, bench, arm):
    opened(page, bench.tester.url)
    generate(page, amplitude=10.0, period=2.0, repetitions=1)
    complete(page)
    until(arm.free)
    swing = arm.commands[:, 0]
    assert swing.max() == pytest.approx(10.0, abs=0.5)
    assert swing.min() == pytest.approx(-10.0, abs=0.5)
    assert arm.within_limits()
    page.get_by_test_id("step-give_arm").get_by_text("done").wait_for()


def test_slave_move_stops_when_the_page_is_hidden(page, bench, arm):
    opened(page, bench.tester.url)
    generate(page)
    start(page, bench.rc8)
    page.evaluate(HIDE)
    until(arm.free)
    assert arm.within_limits()
    stopped(page, "the page is hidden")


def test_the_button_execute_does_not_move_while_the_hints_appear(page, bench):
    """Otherwise, a click is lost if a hint appears between press and release."""
    open_objects(page, bench.tester.url)
    add(page, "Robot", "Arm")
    open_tab(page, "Execute")
    button = page.get_by_test_id("execute")
    before = button.bounding_box()
    fill(page, "command", "TakeArm")
    expect(page.get_by_test_id("command-hint")).to_contain_text("arm group")
    fill(page, "parameter", "0,1")
    expect(page.get_by_test_id("parameter-description")).to_contain_text("2 elements")
    assert button.bounding_box() == before


@pytest.mark.parametrize("width", [1280, 520])
def test_the_button_put_does_not_move_while_an_error_disappears(page, bench, width):
    page.set_viewport_size({"width": width, "height": 900})
    open_objects(page, bench.tester.url)
    add(page, "Variable", "I10")
    button = page.get_by_test_id("put")
    before = button.bounding_box()
    fill(page, "value", "4x")
    expect(page.get_by_test_id("object")).to_contain_text("expected a whole number")
    assert button.bounding_box() == before
    fill(page, "value", "4711")
    expect(page.get_by_test_id("value-description")).to_contain_text("VT_I4")
    assert button.bounding_box() == before
