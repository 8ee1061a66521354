"""The page Slave Move: the procedure of RC8 5.1.1, the check, and every way in which the user can be lost."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit.streaming.trajectory import generators
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.arm_log import ArmLog, logged
from support.browser import CHROMIUM, TesterProcess, needs_browser, user
from support.relay import Relay
from support.slave_page import HOME, UNHEARD, complete, generate, opened, outcome_of, ready, start, stopped
from support.stopping import stopped as suspended
from support.waiting import PATIENCE, until

pytestmark = [needs_browser, pytest.mark.soak]

START = (3.0, *HOME[1:])


def written(path: Path, points: list[tuple[float, ...]], names: str = "J{} command") -> str:
    """Write a control log as another program would, and return its path."""
    header = ",".join(["Time[ms]", *(names.format(joint) for joint in range(1, 7))])
    rows = (",".join([f"{8 * number}", *(f"{value:.9f}" for value in point)]) for number, point in enumerate(points))
    path.write_text("\n".join(["Control log", header, *rows]))
    return str(path)


def assert_stopped_and_released(rc8: VirtualRC8, log: ArmLog) -> None:
    arm = rc8.state.arm
    until(lambda: arm.holder is None and arm.slave.mode is None and not arm.busy)
    with rc8.state.cycles:
        log.check_limits()
        assert arm.motor.on


@pytest.fixture(scope="module")
def visitor(browser: Any) -> Iterator[Any]:
    """A user whose pages several tests use, so that they need not wait for the controls."""
    context = browser.new_context(locale="en-US")
    context.set_default_timeout(PATIENCE * 1000)
    yield context
    context.close()


@pytest.fixture
def page(visitor: Any, bench: Any) -> Iterator[Any]:
    opened_page = visitor.new_page()
    yield opened_page
    opened_page.close()


@pytest.fixture(autouse=True)
def _at_home(request: pytest.FixtureRequest) -> None:
    """Move the arm of the bench to its home position, so that each test begins there."""
    if "bench" in request.fixturenames:
        bench = request.getfixturevalue("bench")
        until(lambda: bench.rc8.state.arm.holder is None)
        with orinkit.connect(bench.server.url) as controller, controller.robot() as robot, robot.arm():
            robot.move(orinkit.J(*HOME), "@E")


def test_the_procedure_of_the_document(page, bench, tmp_path):
    """RC8 5.1.1: (2) specify the control log, (3) press Start; steps 3.1 to 3.6 are executed."""
    points = generators.sine(START, 1, 2.0, 0.5)
    opened(page, bench.tester.url)
    page.get_by_test_id("tab-log").click()
    page.locator("input[type=file]").set_input_files(written(tmp_path / "log.csv", points))
    page.get_by_test_id("log-rows").get_by_text(f"{len(points)} rows").wait_for()
    page.get_by_test_id("use-columns").click()
    page.get_by_test_id("trajectory-name").get_by_text("log.csv").wait_for()
    ready(page)
    with logged(bench.rc8) as log:
        complete(page)
        assert_stopped_and_released(bench.rc8, log)
    executed = {tuple(round(value, 6) for value in command[:6]) for command in log.commands}
    assert executed >= {tuple(round(value, 6) for value in point) for point in points}
    for step in ("take_arm", "first_pose", "enter", "stream", "leave", "give_arm"):
        page.get_by_test_id(f"step-{step}").get_by_text("done").wait_for()
    assert page.get_by_test_id("progress").inner_text() == "100 %"
    shown = page.get_by_test_id("set-point").inner_text().split()
    assert [float(value) for value in shown] == pytest.approx([*points[-1], 0.0, 0.0], abs=0.001)
    assert f"{len(points)} set-points" in page.get_by_test_id("result").inner_text()
    with page.expect_download() as download:
        page.get_by_test_id("download-csv").click()
    assert "J1_command" in Path(download.value.path()).read_text()


def test_a_trajectory_beyond_the_limits_cannot_be_started(page, bench):
    opened(page, bench.tester.url)
    ready(page)
    with logged(bench.rc8) as log:
        page.get_by_test_id("amplitude").fill("90")
        page.get_by_test_id("period").fill("0.5")
        page.get_by_test_id("check").get_by_text("limit violations").wait_for()
        row = page.get_by_test_id("violations").locator("tbody tr").first.inner_text()
        assert re.search(r"\d+\s+0\.\d{3}\s+J1\s+acceleration\s+[\d.]+ deg/s\^2\s+[\d.]+ deg/s\^2", row)
        page.locator('[data-testid="start"].disabled').wait_for()
        page.get_by_test_id("retime").click()
        ready(page)
        assert not log.moved
    page.get_by_test_id("period").fill("-1")
    page.get_by_text("0.1 to 3600 s").wait_for()
    page.locator('[data-testid="start"].disabled').wait_for()


def test_the_button_stop_ends_a_repeated_trajectory(page, bench):
    opened(page, bench.tester.url)
    generate(page)
    page.get_by_test_id("repeat").click()
    with logged(bench.rc8) as log:
        start(page, bench.rc8)
        page.get_by_test_id("stop").click()
        stopped(page, "the button Stop was pressed")
        assert_stopped_and_released(bench.rc8, log)
    page.get_by_test_id("step-stream").get_by_text("stopped").wait_for()
    page.get_by_test_id("step-give_arm").get_by_text("done").wait_for()


# --- without a user ---------------------------------------------------------------------------------------------------

HIDE = """Object.defineProperty(document, 'hidden', {get: () => true, configurable: true});
document.dispatchEvent(new Event('visibilitychange'))"""


@contextmanager
def moving(page: Any, bench: Any, url: str = "") -> Iterator[ArmLog]:
    """Start a long, repeated motion, and check after the block that the arm has stopped within its limits."""
    opened(page, url or bench.tester.url)
    generate(page)
    page.get_by_test_id("repeat").click()
    with logged(bench.rc8) as log:
        start(page, bench.rc8)
        yield log
        assert_stopped_and_released(bench.rc8, log)


def reason_of(browser: Any, bench: Any) -> str:
    """Return the reason that a new page shows."""
    with user(browser) as page:
        page.goto(f"{bench.tester.url}/slave-move")
        outcome = page.get_by_test_id("outcome")
        outcome.get_by_text("Stopped").wait_for()
        return outcome.inner_text()


def test_a_hidden_page_stops_the_arm(page, bench):
    with moving(page, bench):
        page.evaluate(HIDE)
    stopped(page, "the page is hidden")


@pytest.mark.soak
def test_a_closed_page_stops_the_arm(browser, bench):
    with user(browser) as page, moving(page, bench):
        page.close()
    assert "Stopped: the " in reason_of(browser, bench)


@pytest.mark.soak
def test_leaving_the_page_stops_the_arm(browser, bench):
    with user(browser) as page:
        with moving(page, bench):
            page.goto(bench.tester.url)
        assert "Stopped: the " in reason_of(browser, bench)


@pytest.mark.soak
def test_exit_stops_the_arm(page, bench):
    with moving(page, bench):
        page.get_by_test_id("exit").click()
    page.get_by_test_id("connection-form").wait_for()


@pytest.mark.soak
def test_a_browser_that_hangs_stops_the_arm(browser, bench):
    with user(browser) as page:
        with moving(page, bench):
            page.evaluate("setTimeout(() => { const end = Date.now() + 8000; while (Date.now() < end); }, 0)")
        stopped(page, "the page is hidden")


@pytest.mark.soak
def test_giving_up_the_controls_stops_the_arm(page, bench):
    with moving(page, bench):
        page.get_by_role("button", name="Give up").click()
    stopped(page, "the controls were given up")


@pytest.mark.soak
def test_the_stop_button_of_the_header_stops_the_arm(page, bench):
    with moving(page, bench):
        page.get_by_test_id("stop-all").click()
    stopped(page, "the stop button was pressed")


@pytest.mark.soak
def test_another_user_may_stop_the_arm(browser, page, bench):
    opened(page, bench.tester.url)  # the first user holds the controls
    with user(browser) as other:
        other.goto(f"{bench.tester.url}/slave-move")
        with moving(page, bench):
            button = other.get_by_test_id("stop")
            until(lambda: button.is_enabled() or outcome_of(page))  # a busy machine may have ended the motion
            button.dispatch_event("click")
    stopped(page, "the button Stop was pressed")


@pytest.mark.soak
def test_closing_the_connection_stops_the_arm(browser, page, bench):
    name = bench.server.url.removeprefix("tcp://")
    with moving(page, bench), page.context.expect_page() as second:
        page.evaluate("window.open('/')")
        row = second.value.get_by_test_id(f"connection-{name}")
        row.get_by_role("button", name="Disconnect").click()
    stopped(page, "the connection was closed")
    row.get_by_role("button", name="Connect", exact=True).click()
    row.get_by_text("connected", exact=True).wait_for()
    second.value.close()  # otherwise its user keeps the controls


@pytest.mark.soak
def test_a_killed_browser_stops_the_arm(browser, bench, tmp_path):
    from playwright.sync_api import Error

    killed = subprocess.Popen(
        [
            CHROMIUM, "--headless", "--no-sandbox", "--window-size=1360,900", "--remote-debugging-port=0",
            f"--user-data-dir={tmp_path}",
        ],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert killed.stderr is not None
        address = next(line.split()[-1] for line in killed.stderr if line.startswith("DevTools listening"))
        reader = threading.Thread(target=killed.stderr.read, daemon=True)
        reader.start()
        remote = browser.browser_type.connect_over_cdp(address)
        page = remote.contexts[0].new_page()
        page.set_default_timeout(PATIENCE * 1000)
        with moving(page, bench):
            os.killpg(killed.pid, signal.SIGKILL)
        with pytest.raises(Error):
            page.title()
    finally:
        if killed.poll() is None:
            os.killpg(killed.pid, signal.SIGKILL)
        killed.wait(PATIENCE)
        reader.join(PATIENCE)
        killed.stderr.close()
    assert "Stopped" in reason_of(browser, bench)


@pytest.mark.soak
def test_a_cut_network_stops_the_arm(browser, bench):
    with Relay(bench.tester.url) as relay:
        with user(browser) as page, moving(page, bench, relay.url):
            relay.cut()
        assert UNHEARD in reason_of(browser, bench)


@pytest.mark.soak
def test_a_tester_that_hangs_stops_the_arm(browser, bench, tmp_path):
    with TesterProcess(bench.server.url, folder=tmp_path) as tester, user(browser) as page:
        with moving(page, bench, tester.url), suspended(tester.process.pid):
            until(lambda: bench.rc8.state.arm.slave.mode is None)
        page.get_by_test_id("start").wait_for()


@pytest.mark.soak
def test_kill_9_of_the_tester_stops_the_arm(browser, bench, tmp_path):
    with TesterProcess(bench.server.url, folder=tmp_path) as tester, user(browser) as page:
        with moving(page, bench, tester.url):
            tester.process.kill()
        tester.process.wait(PATIENCE)


@pytest.mark.soak
def test_the_end_of_the_tester_stops_the_arm(browser, bench, tmp_path):
    with TesterProcess(bench.server.url, folder=tmp_path) as tester, user(browser) as page:
        with moving(page, bench, tester.url):
            tester.process.send_signal(signal.SIGTERM)
        tester.process.wait(PATIENCE)


# --- VE026A -----------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_a_ve026a_on_a_serial_line_executes_the_set_points(browser, tmp_path):
    arm = VirtualVE026A(motor=True)
    with (
        orinkit.serve(arm, "pty://") as server,
        TesterProcess(server.url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        opened(page, tester.url)
        generate(page, amplitude=5.0, period=3.2, repetitions=1)
        seen: list[float] = []
        page.get_by_test_id("start").click()
        outcome = page.get_by_test_id("outcome").get_by_text("Complete")
        until(lambda: seen.append(arm.joints[0]) or outcome.count())
        assert max(seen) == pytest.approx(5.0, abs=1.0)
        assert min(seen) == pytest.approx(-5.0, abs=1.0)
        assert not arm.slave_mode
        page.get_by_test_id("chooser").wait_for()
        page.get_by_test_id("generate").click()  # the connection can be used again
        ready(page)
