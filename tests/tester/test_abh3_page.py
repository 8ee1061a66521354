"""The page ABH3: what the virtual driver receives while a button is held, and in every case in which the user is gone."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from orinkit.can.server import PSEUDO_TERMINAL, serve_can
from orinkit.tester.state.abh3.parameters import LONGEST_ENTRY
from support import multicast
from support.browser import ARGUMENTS, CHROMIUM, TesterProcess, needs_browser, user
from support.drivers import RecordedDriver, served_driver
from support.relay import Relay
from support.waiting import PATIENCE, until

pytestmark = needs_browser

FAST = {"acceleration_time": 0.1, "deceleration_time": 0.1}
HIDE = """Object.defineProperty(document, 'hidden', {value: true, configurable: true});
document.dispatchEvent(new Event('visibilitychange'))"""


class DrivePage:
    """The page ABH3 of a user, and the driver that it drives."""

    def __init__(self, page: Any, url: str, driver: RecordedDriver) -> None:
        self.page, self.driver = page, driver
        page.goto(f"{url}/abh3")
        self.part("drive").wait_for()

    def part(self, marker: str) -> Any:
        return self.page.get_by_test_id(marker)

    def enable(self) -> DrivePage:
        until(self.takes_controls)
        until(self.enabled)
        return self

    def enabled(self) -> bool:
        """Enable driving if it is disabled, also again after a stall of this machine; return True if it is enabled."""
        switch = self.part("drive-enable")
        if switch.is_enabled() and switch.inner_text() == "Enable driving":
            switch.click()
        self.page.wait_for_timeout(50)
        return bool(self.part("drive-ay+").get_attribute("aria-disabled") == "false")

    def takes_controls(self) -> bool:
        """Take the controls if they are free; return True if this user holds them."""
        text = self.part("controls")
        if text.inner_text() == "The controls are free":
            text.locator("xpath=..").get_by_role("button").click()
        self.page.wait_for_timeout(50)
        return str(text.inner_text()) == "You hold the controls"

    def hold(self, name: str = "ay+", reached: Callable[[Any], bool] = lambda state: bool(state.moving)) -> None:
        """Press a button and wait for a state; try again if a stall of this machine has disabled driving."""
        button = self.part(f"drive-{name}")
        button.hover()
        self.page.mouse.down()
        until(lambda: reached(self.driver.state()) or button.get_attribute("aria-disabled") == "true")
        if not reached(self.driver.state()):
            self.page.mouse.up()
            self.enable().hold(name, reached)

    def is_idle(self) -> bool:
        """Return True if the latest command is 0, without the input start."""
        last = self.driver.commands[-1]
        return (last.ay_command, last.bx_command, last.inputs["start"]) == (0, 0, False)

    def stopped(self) -> None:
        """Wait until the driver has received commands of 0, with start and servo off, and the motors stand still."""
        until(lambda: self.driver.stopped)

    def says_why(self) -> bool:
        """Return True if the page states why driving has ended: it is hidden, or a stall of this machine came first."""
        message, error = self.part("drive-message").inner_text(), self.part("error-drive")
        return "the page is hidden" in message or "nothing was received" in message or bool(error.is_visible())

    def disable(self) -> None:
        def disabled() -> bool:
            """Disable driving if it is enabled, also if a stall has ended it just before the click, which then enables it."""
            if self.part("drive-enable").inner_text() == "Disable driving":
                self.part("drive-enable").click()
            self.page.wait_for_timeout(200)
            return self.driver.stopped

        until(disabled)

    def open_tab(self, name: str, marker: str) -> None:
        self.part("abh3-tabs").get_by_text(name, exact=True).click()
        self.part(marker).wait_for()


@pytest.fixture(scope="module")
def driver_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RecordedDriver, TesterProcess]]:
    """A virtual ABH3 of this process, and a Tester that is connected to it."""
    with (
        served_driver(**FAST) as (driver, url),
        TesterProcess(url, folder=tmp_path_factory.mktemp("tester")) as tester,
    ):
        yield driver, tester


@pytest.fixture(scope="module")
def first_user(browser: Any) -> Iterator[Any]:
    with user(browser, permissions=["clipboard-read", "clipboard-write"]) as page:
        yield page.context


@pytest.fixture
def page(first_user: Any) -> Iterator[Any]:
    """A page of the same user for all tests, because a new user would have to wait for the controls."""
    page = first_user.new_page()
    yield page
    page.close()


@pytest.fixture
def drive(page: Any, driver_bench: Any) -> Iterator[DrivePage]:
    driver, tester = driver_bench
    yield DrivePage(page, tester.url, driver)
    page.close()
    until(lambda: driver.stopped)


def test_the_motor_turns_while_a_button_is_held(drive):
    drive.enable()
    drive.part("set-point-ay").fill("98.1")
    drive.part("drive").get_by_text("sends 98.2 min⁻¹ (code 491)").wait_for()
    drive.hold("ay-", lambda state: state.ay_velocity == -98.2)
    drive.page.mouse.up()
    until(lambda: drive.is_idle() and not drive.driver.state().moving)  # the input start is off first, then the command
    drive.part("value-BR5-main_voltage").get_by_text("24.0").wait_for()
    drive.part("flag-control-4").and_(drive.page.locator('[aria-label="A/Y data select 0: on"]')).wait_for()
    drive.disable()


def test_the_motor_stops_when_the_page_is_hidden(drive):
    drive.enable().hold("both+")
    drive.page.evaluate(HIDE)
    drive.stopped()
    until(drive.says_why)


@pytest.mark.soak
def test_a_virtual_driver_is_started_and_vanishes(browser, tmp_path):
    with TesterProcess(folder=tmp_path) as tester, user(browser) as page:
        page.goto(f"{tester.url}/abh3")
        page.get_by_test_id("start-abh3-here").click()
        page.get_by_test_id("value-BR5-main_voltage").get_by_text("24.0").wait_for()
        os.kill(simulator_of(tester), signal.SIGKILL)
        page.get_by_test_id("no-driver-text").get_by_text("does not reply any more").wait_for()
        page.get_by_test_id("connect-again").click()
        page.get_by_test_id("error-connect").get_by_text("has ended").wait_for()
        page.get_by_test_id("start-abh3-here").click()
        page.get_by_test_id("value-BR5-main_voltage").get_by_text("24.0").wait_for()


def simulator_of(tester: TesterProcess) -> int:
    """Return the process that serves the virtual driver of a Tester."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == tester.process.pid and b"abh3" in (folder / "cmdline").read_bytes().split(b"\0"):
                return int(folder.name)
        except OSError:
            continue
    raise AssertionError("there is no virtual driver")


# --- soak ------------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_the_motor_stops_when_the_page_is_closed(drive):
    drive.enable().hold()
    drive.page.close()
    drive.stopped()


@pytest.mark.soak
@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_the_motor_turns_while_a_key_is_held(drive, key):
    drive.enable()
    drive.part("drive-bx-").focus()
    drive.page.keyboard.down(key)
    until(lambda: drive.driver.state().bx_velocity == -100)
    drive.page.keyboard.up(key)
    until(lambda: not drive.driver.state().moving)
    drive.disable()


@pytest.mark.soak
def test_the_motor_stops_when_the_pointer_leaves_the_button(drive):
    drive.enable().hold()
    drive.page.mouse.move(0, 0)
    until(lambda: not drive.driver.state().moving)
    assert drive.driver.commands[-1].inputs["servo_on"]
    drive.page.mouse.up()
    drive.disable()


@pytest.mark.soak
def test_the_motor_stops_when_the_browser_is_killed(browser, driver_bench):
    driver, tester = driver_bench
    own = browser.browser_type.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
    page = own.new_page()
    page.set_default_timeout(PATIENCE * 1000)
    DrivePage(page, tester.url, driver).enable().hold()
    processes = own.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    os.kill(next(each["id"] for each in processes if each["type"] == "browser"), signal.SIGKILL)
    until(lambda: driver.stopped)


@pytest.mark.soak
def test_the_motor_stops_when_the_network_fails(page, driver_bench):
    driver, tester = driver_bench
    with Relay(tester.url) as relay:
        drive = DrivePage(page, relay.url, driver).enable()
        drive.hold()
        relay.cut()
        drive.stopped()


@pytest.mark.soak
def test_the_motor_stops_when_the_controls_are_given_up(drive):
    drive.enable().hold()
    drive.part("controls").locator("xpath=..").get_by_role("button").dispatch_event("click")
    drive.stopped()
    drive.part("drive-message").get_by_text("another user holds the controls").wait_for()


@pytest.mark.soak
def test_another_user_can_stop_but_not_drive(browser, drive, driver_bench):
    drive.enable().hold()
    with user(browser) as other:
        watching = DrivePage(other, driver_bench[1].url, drive.driver)
        watching.part("drive-ay+").and_(other.locator('[aria-disabled="true"]')).wait_for()
        watching.part("stop-all").click()
        drive.stopped()


@pytest.mark.soak
def test_the_motor_stops_when_the_tester_is_killed(browser, tmp_path):
    with (
        served_driver(**FAST) as (driver, url),
        TesterProcess(url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        DrivePage(page, tester.url, driver).enable().hold()
        os.kill(tester.process.pid, signal.SIGKILL)
        until(lambda: not driver.state().moving)  # by itself, because of its command time-out
        tester.process.wait(PATIENCE)


@pytest.mark.soak
def test_the_motor_stops_when_the_tester_ends(browser, tmp_path):
    with served_driver(**FAST) as (driver, url), user(browser) as page:
        with TesterProcess(url, folder=tmp_path) as tester:
            DrivePage(page, tester.url, driver).enable().hold()
        until(lambda: driver.stopped)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("text", "message"), [("6553.5", "6553.4"), ("abc", "not a number"), ("1" * 100, "not a number")]
)
def test_an_invalid_set_point_is_refused_beside_its_field(drive, text, message):
    drive.enable()
    before = len(drive.driver.commands)
    drive.part("set-point-bx").fill(text)
    drive.part("drive").locator('[role="alert"]').get_by_text(message).first.wait_for()

    def refused() -> bool:
        drive.enabled()
        drive.part("drive-bx+").hover()
        drive.page.mouse.down()
        drive.page.wait_for_timeout(50)
        drive.page.mouse.up()
        return bool(drive.part("error-drive").get_by_text("B/X").is_visible())

    until(refused)
    drive.part("set-point-bx").fill("100")
    drive.hold("bx+")
    drive.page.mouse.up()
    sent = drive.driver.commands[before:]
    assert {each.bx_command for each in sent} == {0, 100}
    drive.disable()


@pytest.mark.soak
def test_inputs_are_switched_and_shown(drive):
    drive.enable()
    drive.part("input-4").click()
    until(lambda: "ay_select_0" in drive.driver.state().inputs)
    drive.part("input-4").and_(drive.page.locator('[aria-checked="true"]')).wait_for()
    assert drive.part("input-1").get_attribute("aria-disabled") == "true"  # start is on only while a button is held
    drive.part("input-24").click()
    until(lambda: "ay_torque" in drive.driver.state().inputs)
    drive.part("drive").get_by_text("sends 0.00 % (code 0)").wait_for()  # the number would mean something else
    drive.part("inputs-word").get_by_text(re.compile("0x010010(01|11)")).wait_for()
    drive.disable()
    drive.part("input-4").and_(drive.page.locator('[aria-checked="false"][aria-disabled="true"]')).wait_for()


@pytest.mark.soak
def test_errors_are_shown_and_reset(drive):
    drive.enable()
    drive.driver.inject("a_overcurrent")
    drive.part("flag-errors-6").and_(drive.page.locator('[data-on="1"]')).wait_for()
    drive.part("fault-chip").get_by_text("A axis overcurrent").wait_for()
    drive.part("flag-io-0").and_(drive.page.get_by_label("an error is present: on")).locator(".ok-led-bad").wait_for()
    drive.part("reset-errors").click()
    drive.part("flag-errors-6").and_(drive.page.locator('[data-on="0"]')).wait_for()
    until(lambda: not drive.driver.state().errors["a_overcurrent"])


@pytest.mark.soak
def test_frames_are_listed_filtered_and_copied(drive):
    drive.open_tab("CAN frames", "frame-list")
    drive.part("filter-text").fill("00EF0102")

    def first_is_shown() -> bool:
        drive.part("frame-list").press("Home")
        drive.page.wait_for_timeout(50)
        return bool(drive.page.locator('[data-number="1"]').get_by_text("DP0S 2 -> 1").is_visible())

    until(first_is_shown)
    drive.page.locator('[data-number="1"]').click()
    drive.part("frame-title").get_by_text("#1 sent: DP0S 2 -> 1").wait_for()
    shown = bytes.fromhex(
        " ".join(drive.page.locator('[data-testid="frame-bytes"] .ok-byte[data-byte]').all_text_contents())
    )
    assert shown == bytes.fromhex("00EF0102") + drive.driver.received[0].data
    drive.part("copy-frame").click()
    drive.page.get_by_text("copied").wait_for()
    assert "00EF0102#0000000000000000 DP0S 2 -> 1" in drive.page.evaluate("navigator.clipboard.readText()")
    drive.part("filter-hex").fill("xyz")
    drive.page.get_by_text("these are not hex digits").wait_for()
    drive.part("filter-hex").fill("")
    drive.part("filter-text").fill("BR5")
    drive.part("filter-polled").click()
    drive.page.locator("[data-number]").get_by_text("main supply voltage = 24.0 V").first.wait_for()
    drive.part("copy-list").click()
    until(lambda: "main supply voltage" in drive.page.evaluate("navigator.clipboard.readText()"))
    drive.part("clear").click()
    drive.part("frame-count").get_by_text(re.compile(r"of \d{1,2} frames")).wait_for()


@pytest.mark.soak
def test_parameters_are_read_and_written(drive):
    drive.open_tab("Parameters", "parameter-table")
    until(drive.takes_controls)
    drive.part("parameter-filter").fill("4117")
    drive.part("read-parameters").click()
    drive.part("parameter-4117").get_by_text("500").wait_for()
    drive.part("edit-4117").click()
    field = drive.part("parameter-value")
    field.fill("1.5")
    drive.part("write-parameter").click()
    drive.page.get_by_text("is not a whole number").wait_for()
    assert drive.driver.parameters.command_timeout == 500
    field.fill("1" * 10_000)
    assert len(field.input_value()) == LONGEST_ENTRY + 1
    field.fill("450")
    drive.part("write-parameter").click()
    drive.part("choose-write").click()
    drive.part("parameter-4117").get_by_text("450").wait_for()
    assert drive.driver.parameters.command_timeout == 450


@pytest.mark.soak
def test_a_driver_that_returns_is_connected_again(browser, tmp_path):
    url = multicast.bus()
    driver = RecordedDriver(**FAST)
    with (
        serve_can(driver, at=url),
        TesterProcess(url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        drive = DrivePage(page, tester.url, driver).enable()
        drive.hold()
        driver.mute = True
        page.get_by_test_id("no-driver-text").get_by_text("does not reply any more").wait_for()
        page.mouse.up()
        until(lambda: not driver.state().moving)
        driver.mute = False
        page.get_by_test_id("connect-again").click()
        drive.part("value-BR5-main_voltage").get_by_text("24.0").wait_for()
        drive.enable().hold()
        page.mouse.up()
        drive.disable()


@pytest.mark.soak
def test_a_page_of_a_controller_offers_the_driver(browser, tmp_path):
    with (
        serve_can(RecordedDriver(), at=PSEUDO_TERMINAL) as server,
        TesterProcess("--virtual", "rc8", server.url, folder=tmp_path) as tester,
        user(browser) as page,
    ):
        page.goto(f"{tester.url}/abh3?connection=Virtual RC8")
        page.get_by_test_id("no-driver-text").get_by_text("is a robot controller").wait_for()
        page.get_by_test_id("use-driver").click()
        page.get_by_test_id("drive").wait_for()
