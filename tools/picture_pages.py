"""Contents of the pictures of the Tester: THE TABLE :data:`FILLS`, for tools/pictures.py.

A page without a row is taken as it opens. A row is a context manager: it fills the page, and ends what it has started
after the picture has been taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import orinkit
from orinkit import P
from orinkit.core.i18n import translate

LONG_STRING: Final = (
    "Server=192.168.0.1:5007, UDP=True, Timeout=800, TORetry=3, Provider=CaoProv.DENSO.VRC, Machine=192.168.0.1, "
    'Option="@EventDisable=False,Wpj=*", Message=True, Debug=True'
)
EARLIER_STRINGS: Final = [LONG_STRING, "Server=192.168.0.2:5007, UDP=False, Timeout=500, Provider=CaoProv.DENSO.VRC9"]
_COMMAND: Final = "Dev"
_HOME: Final = "J(0, 45, 90, 0, 45, 0)"
_HIDDEN_LINES: Final = ("[7]", "[6]", "[5]", "[3]")  # their values are constant
_HISTORY: Final = 14_000  # ms of values in the plot of the page Monitor
_ATTEMPTS_IN_REAL_TIME: Final = 3
_JOGGED: Final = 1_500  # ms


class NotShownError(Exception):
    """The page did not show what the picture requires; another attempt may succeed."""


@dataclass(frozen=True)
class Visit:
    """An open page of the Tester.

    Attributes:
        page: The page of Playwright.
        language: ``"en"`` or ``"ja"``.
        attempt: Number of this attempt, from 1.
        open_page: Function that opens another page of the Tester with the virtual RC8.
        folder: Directory for files.
    """

    page: Any
    language: Any
    attempt: int
    open_page: Callable[[str], AbstractContextManager[Any]]
    folder: Path

    def by(self, marker: str) -> Any:
        """Return the element with a ``data-testid``."""
        return self.page.get_by_test_id(marker)

    def text(self, english: str) -> str:
        """Return a text of the page in its language."""
        return translate(self.language, english)


Fill: TypeAlias = Callable[[Visit], AbstractContextManager[None]]


# --- the arm ----------------------------------------------------------------------------------------------------------


def motor_on(page: Any) -> None:
    """Switch the motor on, on the page Arm."""
    page.get_by_test_id("joint-1").wait_for()
    page.get_by_test_id("chip-motor").wait_for()
    if page.get_by_test_id("motor-on").is_enabled():
        page.get_by_test_id("motor-on").click()
    page.locator('[data-testid="chip-motor"].ok-good').wait_for()


def enable_jogging(page: Any) -> None:
    """Enable jogging, on the page Arm."""
    motor_on(page)
    if page.locator('[data-hold="1+"][aria-disabled="true"]').count():
        page.get_by_test_id("jog-enable").click()
    page.locator('[data-hold="1+"][aria-disabled="false"]').wait_for()


def rest(page: Any) -> None:
    """Move pointer and focus away from the elements."""
    page.mouse.move(0, 0)
    page.evaluate("document.activeElement?.blur()")


def set_slider(page: Any, marker: str, value: int) -> None:
    """Set a slider by pointer."""
    slider = page.get_by_test_id(marker)
    box = slider.bounding_box()
    page.mouse.click(box["x"] + box["width"] * value / 100, box["y"] + box["height"] / 2)


def press(page: Any, button: str) -> None:
    """Move the pointer to a jog button and press it."""
    page.get_by_test_id(f"jog-{button}").hover()
    page.mouse.down()


@contextmanager
def arm(visit: Visit) -> Iterator[None]:
    """Jog the tool, and hold a button while the picture is taken; on a slow machine, another client moves the arm."""
    move_home(visit)
    visit.page.bring_to_front()
    with _jogged(visit) if visit.attempt <= _ATTEMPTS_IN_REAL_TIME else _moved_by_client(visit):
        yield


@contextmanager
def _jogged(visit: Visit) -> Iterator[None]:
    page = visit.page
    enable_jogging(page)
    visit.by("jog-frame").get_by_role("button").nth(1).click()  # base
    visit.by("jog-z-").wait_for()
    set_slider(page, "jog-speed", 60)
    for button in ("y+", "z+", "y-"):
        press(page, button)
        page.wait_for_timeout(_JOGGED)
        page.mouse.up()
    press(page, "z-")
    page.wait_for_timeout(_JOGGED // 2)
    moving = page.locator('[data-testid="jog-state"].ok-warn')
    try:
        if not moving.count() or page.locator(".ok-jog-notice").count():
            raise NotShownError(visit.by("jog-message").inner_text())
        yield
        if not moving.count():
            raise NotShownError(visit.by("jog-message").inner_text())
    finally:
        page.mouse.up()
        if page.locator('[data-hold="1+"][aria-disabled="false"]').count():
            visit.by("jog-enable").click()
            page.locator('[data-hold="1+"][aria-disabled="true"]').wait_for()


@contextmanager
def _moved_by_client(visit: Visit) -> Iterator[None]:
    with orinkit.connect(url_of(visit)) as rc8, rc8.robot("Arm") as robot, robot.arm():
        trace_rectangle(robot)
        motion = robot.move_l(P(364, -150, 280, 180, 0, 180, 5), "@E", speed=1, wait=False)
        visit.page.locator('[data-testid="chip-moving"].ok-warn').wait_for()
        yield
        motion.halt()


def trace_rectangle(robot: Any) -> None:
    """Move the tool along three sides of a rectangle."""
    for y, z in ((150, 280), (150, 420), (-150, 420)):
        robot.move_l(P(364, y, z, 180, 0, 180, 5), "@E", speed=20)


def url_of(visit: Visit) -> str:
    """Return the address of the virtual RC8, which the page Connections displays."""
    with visit.open_page("/") as page:
        return str(page.get_by_text("tcp://127.0.0.1:").first.inner_text())


def move_home(visit: Visit) -> None:
    """Switch the motor on and move the arm to its first pose."""
    with visit.open_page("/arm") as page:
        motor_on(page)
    with orinkit.connect(url_of(visit)) as rc8, rc8.robot("Arm") as robot, robot.arm():
        robot.move(_HOME, "@E", speed=50)


# --- programs and variables -------------------------------------------------------------------------------------------


@contextmanager
def _running(page: Any) -> Iterator[None]:
    """Run the sample program that moves the arm; the page is Programs."""
    page.get_by_test_id("file-Pro1.pcs").click()
    page.get_by_test_id("editor-title").get_by_text("Pro1.pcs").wait_for()
    page.get_by_test_id("start-mode").click()
    page.get_by_role("option").nth(1).click()  # continuous
    page.get_by_test_id("stop-mode").click()
    page.get_by_role("option").nth(3).click()  # immediately, and reset: the arm is then free
    row = page.get_by_test_id("task-Pro1")
    row.get_by_test_id("start").click()
    row.locator('[data-testid="status"].ok-good').wait_for()
    rest(page)
    try:
        yield
    finally:
        row.get_by_test_id("stop").click()
        row.locator('[data-testid="status"]:not(.ok-good)').wait_for()


@contextmanager
def programs(visit: Visit) -> Iterator[None]:
    """Run a program."""
    with visit.open_page("/arm") as page:
        motor_on(page)
    with _running(visit.page):
        visit.page.wait_for_timeout(3000)
        yield


@contextmanager
def monitor(visit: Visit) -> Iterator[None]:
    """Watch variables while a program moves the arm, after an error."""
    page = visit.page
    with visit.open_page("/arm") as arm_page:
        motor_on(arm_page)
        arm_page.get_by_test_id("pendant-error-code").fill("0x83204071")
        arm_page.get_by_test_id("pendant-raise").click()
        arm_page.locator('[data-testid="chip-error"].ok-bad').wait_for()
        arm_page.get_by_test_id("pendant-clear").click()
        arm_page.locator('[data-testid="chip-error"].ok-good').wait_for()
        motor_on(arm_page)
    with visit.open_page("/programs") as programs_page, _running(programs_page):
        page.bring_to_front()
        visit.by("watch-name").fill("I10, IO128, @MODE, S1")
        visit.by("watch-add").click()
        visit.by("watch-I10").wait_for()
        visit.by("watch-kind").click()
        page.get_by_role("option").nth(1).click()  # robot
        visit.by("watch-name").fill("@CURRENT_ANGLE")
        visit.by("watch-add").click()
        row = page.locator('[data-testid^="watch-"]').filter(has_text="CURRENT_ANGLE").last
        row.locator('[data-testid="plot"]').click()
        visit.by("plot-window").click()
        page.get_by_role("option").first.click()
        rest(page)
        for name in _HIDDEN_LINES:
            page.locator(".q-chip").filter(has_text=name).locator(".q-chip__icon--remove").click()
        page.wait_for_timeout(_HISTORY)
        yield


# --- other pages ------------------------------------------------------------------------------------------------------


@contextmanager
def connections(visit: Visit) -> Iterator[None]:
    """Enter a connection string."""
    visit.by("string").fill(LONG_STRING)
    visit.page.locator('[data-testid="url"]').and_(visit.page.locator("input")).wait_for()
    visit.by("name").fill("RC8")
    visit.page.get_by_text(visit.text("More parameters")).click()
    visit.by("field-debug").click(trial=True)  # waits until the fields are completely unfolded
    rest(visit.page)
    yield


def _add(visit: Visit, kind: str, name: str) -> None:
    """Add an object below the selected one, which is then selected."""
    visit.by("kind").get_by_role("button", name=visit.text(kind), exact=True).click()
    visit.by(f"add-{kind}-name").fill(name)
    visit.by(f"add-{kind}").click()
    visit.by("object").get_by_text(name, exact=True).first.wait_for()


@contextmanager
def objects(visit: Visit) -> Iterator[None]:
    """Add objects, and compute a position with a command of the robot."""
    page = visit.page
    visit.by("object-handle").wait_for()
    controller = visit.by("tree").get_by_role("treeitem").nth(1)
    if not visit.by("tree").get_by_text("Arm", exact=True).count():
        for kind, name in (("Variable", "I10"), ("Variable", "IO128"), ("Task", "Pro1"), ("Robot", "Arm")):
            controller.click()
            _add(visit, kind, name)
        _add(visit, "Variable", "@CURRENT_POSITION")
    visit.by("tree").get_by_role("treeitem").filter(has_text="Arm").last.click()
    visit.by("tab-Execute").click()
    visit.by("command").fill(_COMMAND)
    visit.by("command-hint").filter(has_text=":").wait_for()
    visit.by("parameter").fill("P(400, 0, 300, 180, 0, 180, 5), P(0, 50, 20, 0, 0, 0)")
    page.wait_for_timeout(500)
    visit.by("execute").click()
    visit.by("result-value").wait_for()
    rest(page)
    yield


@contextmanager
def slave_move(visit: Visit) -> Iterator[None]:
    """Draw a circle in space."""
    page = visit.page
    move_home(visit)
    page.bring_to_front()
    visit.by("shape").get_by_role("button").nth(2).click()  # circle
    visit.by("radius").fill("40")
    visit.by("period").fill("4")
    visit.by("repetitions").fill("2")
    page.wait_for_timeout(2000)
    page.locator('[data-testid="check"].ok-good').wait_for()
    rest(page)
    if visit.attempt > _ATTEMPTS_IN_REAL_TIME:
        yield  # before the start: on a slow machine, the motion is stopped, because the browser is not heard
        return
    page.locator('[data-testid="start"]:not(.disabled)').click()
    page.locator('[data-testid="start"].disabled').wait_for()
    page.locator('[data-testid="start"]:not(.disabled)').wait_for()
    if not page.locator('[data-testid="step-give_arm"].ok-sm-done').count() or page.locator(".ok-sm-warned").count():
        raise NotShownError(visit.by("outcome").inner_text())
    rest(page)
    yield


@contextmanager
def packets(visit: Visit) -> Iterator[None]:
    """Select the request of the computation that the page Objects has made."""
    page = visit.page
    page.locator("[data-number]").first.wait_for()
    visit.by("filter-text").fill(_COMMAND)
    page.wait_for_timeout(1500)
    found = page.locator("[data-number]").last
    number = found.get_attribute("data-number")
    found.click()
    visit.by("packet-title").filter(has_text=f"#{number} ").wait_for()
    visit.by("filter-text").fill("")
    page.wait_for_timeout(1500)
    page.locator(f'[data-number="{number}"]').wait_for()
    field = visit.by("packet-bytes").locator("[data-field]").nth(9)
    rest(page)
    if field.count():
        field.hover()
    yield


FILLS: Final[dict[str, Fill]] = {
    "/objects": objects,
    "/programs": programs,
    "/monitor": monitor,
    "/slave-move": slave_move,
    "/arm": arm,
    "/packets": packets,
    "/": connections,
}
"""THE TABLE, by the path of the page, in the order in which the pictures are taken."""
