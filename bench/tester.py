"""The Tester in a browser: first paint, reaction to clicks, event loop, and a stream at the same time: ``make bench``.

A virtual RC8 with strict time and the Tester run as processes; the pages are displayed in a headless Chromium. Four
measurements follow each other:

* first paint of each page, with an empty cache of the browser: the time from the request until the contents of the page
  are displayed;
* the event loop of the Tester while one page is open, with a full log of packets;
* the heartbeats of the page Arm while the arm is jogged, beside the drawing of the arm;
* three open pages, each in a window of its own, a stream of set-points every 8 ms and 1,000 logged packets per second: missed
  cycles, and the time from a click until the page displays its reaction. The note contains the time until the contents
  of the page have changed; the rest is layout, drawing and composing by Chromium.

Chromium has the options with which it runs by itself on a computer without a graphics processor: only WebGL is drawn by
SwiftShader. If everything is drawn by SwiftShader, composing the pages takes a multiple of the processor time.

Figures that exceed their limits are marked. With ``--check``, the exit code is then 1.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from stalls import Stalls, watched
from stream import controller

KEPT = 100_000  # packets in the log
RATE = 1000.0  # packets per second
FIRST_PAINT = 1500.0  # ms
REACTION = 200.0  # ms
BLOCK = 20.0  # ms
HEARTBEAT = 500.0  # ms
WATCHED = "I1 I2 I3 I4 I5 D1 D2 IO128 IO129 @MODE"
PAGES = ("/", "/arm", "/objects", "/monitor", "/programs", "/slave-move", "/abh3", "/packets", "/raw")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome") or ""
ARGUMENTS = ("--no-sandbox", "--disable-background-networking", "--disable-component-update", "--disable-sync")
PATIENCE = 60.0  # s
TITLE = ".ok-page-title"

PAINTED = """
window.okShown = new Promise(resolve => {
  const look = () => {
    if (!document.querySelector('.ok-page-title')) return false;
    requestAnimationFrame(() => setTimeout(() => resolve(performance.now())));
    return true;
  };
  const observer = new MutationObserver(() => look() && observer.disconnect());
  observer.observe(document, {childList: true, subtree: true});
});
"""

CLICKED = """([test]) => {
  const met = new Function('return ' + test);
  window.okReaction = new Promise(resolve => {
    addEventListener('click', ({timeStamp}) => {
      const observer = new MutationObserver(() => {
        if (!met()) return;
        observer.disconnect();
        const changed = performance.now() - timeStamp;
        requestAnimationFrame(() => setTimeout(() => resolve([changed, performance.now() - timeStamp])));
      });
      observer.observe(document.body, {childList: true, subtree: true, attributes: true, characterData: true});
    }, {capture: true, once: true});
  });
}"""


@dataclass
class Report:
    """The table of the figures.

    Attributes:
        exceeded: Number of limits that are exceeded.
    """

    exceeded: int = 0
    _lines: list[str] = field(default_factory=list)

    def line(self, what: str, value: float, unit: str, limit: float | None = None, note: str = "") -> None:
        """Print one figure."""
        over = limit is not None and value > limit
        self.exceeded += over
        bound = "" if limit is None else f"limit {limit:g} {unit}" + (" EXCEEDED" if over else "")
        print(f"{what:<58} {value:>9.1f} {unit:<3} {bound:<26} {note}", flush=True)


class Tester:
    """The Tester in a process that measures itself.

    Args:
        url: Address of the controller.
        folder: Directory for the user's configuration.
    """

    def __init__(self, url: str, folder: str) -> None:
        script = Path(__file__).with_name("measured_tester.py")
        self._process = subprocess.Popen(
            [sys.executable, str(script), "tester", "--http", "127.0.0.1:0", "--no-browser", url],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "XDG_CONFIG_HOME": folder, "ORINKIT_LANG": "en"},
        )  # fmt: skip
        assert self._process.stdout is not None
        ready = self._process.stdout.readline().split()
        if len(ready) < 2:
            raise SystemExit("bench/tester.py: the Tester does not start; see the message above")
        self.url = ready[1]

    def do(self, command: str, *values: float) -> Any:
        """Execute a command, and return its result."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([command, *values]) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()


@contextmanager
def browser() -> Iterator[Any]:
    """Open a headless browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        try:
            yield opened
        finally:
            opened.close()


def missing() -> str:
    """Return what must be installed before the measurement; ``""`` if nothing is missing."""
    try:
        import nicegui  # noqa: F401 - only whether it exists
        import playwright  # noqa: F401 - only whether it exists
    except ImportError as error:
        return f"bench/tester.py needs {error.name}. Try: pip install 'orinkit[tester]' playwright"
    if not CHROMIUM:
        return "bench/tester.py needs a browser. Try: apt-get install chromium"
    return ""


def median(values: list[float]) -> float:
    """Return the middle value."""
    return sorted(values)[len(values) // 2]


def quantile(values: list[float], q: float) -> float:
    """Return a quantile."""
    return sorted(values)[min(len(values) - 1, int(q * len(values)))]


# --- first paint ------------------------------------------------------------------------------------------------------


def first_paints(opened: Any, tester: Tester, rounds: int, report: Report) -> None:
    """Measure each page with an empty cache, and once more with the files in the cache."""
    for path in PAGES:
        cold: list[float] = []
        warm: list[float] = []
        for _ in range(rounds):
            context = opened.new_context()
            context.set_default_timeout(PATIENCE * 1000)
            context.add_init_script(PAINTED)
            for times in (cold, warm):
                page = context.new_page()
                page.goto(f"{tester.url}{path}", wait_until="commit")
                times.append(float(page.evaluate("window.okShown")))
                page.close()
            context.close()
        note = f"longest {max(cold):.0f} ms; with cached files {median(warm):.0f} ms"
        report.line(f"first paint of {path}", median(cold), "ms", FIRST_PAINT, note)


# --- event loop -------------------------------------------------------------------------------------------------------


def loops(opened: Any, tester: Tester, seconds: float, report: Report) -> None:
    """Measure the event loop while one page is open."""
    tester.do("fill", KEPT)
    for path in PAGES:
        context = opened.new_context()
        context.set_default_timeout(PATIENCE * 1000)
        page = context.new_page()
        tester.do("reset")
        page.goto(f"{tester.url}{path}")
        page.locator(TITLE).wait_for()
        page.wait_for_timeout(500)
        building = tester.do("report")
        tester.do("reset")
        page.wait_for_timeout(seconds * 1000)
        shown = tester.do("report")
        context.close()
        note = f"{building['where']}"
        report.line(f"event loop, opening {path}: longest block", building["block"], "ms", BLOCK, note)
        note = f"delays p99 {shown['delay_p99']:.1f}, max {shown['delay']:.1f} ms; {shown['where']}"
        report.line(f"event loop, {path} open: longest block", shown["block"], "ms", BLOCK, note)


# --- jogging ----------------------------------------------------------------------------------------------------------


def jogging(opened: Any, tester: Tester, seconds: float, report: Report) -> None:
    """Measure the heartbeats while the arm is jogged beside its drawing."""
    context = opened.new_context(viewport={"width": 1360, "height": 900})
    context.set_default_timeout(PATIENCE * 1000)
    page = context.new_page()
    page.goto(f"{tester.url}/arm")
    page.locator('[data-testid="scene"][data-ready]').wait_for()
    page.get_by_test_id("jog-enable").click()
    page.locator('[data-testid="jog-j1+"][aria-disabled="false"]').wait_for()
    longest, stopped = 0.0, ""
    end = time.monotonic() + seconds
    for number in itertools.count():
        if time.monotonic() > end or stopped:
            break
        page.get_by_test_id(f"jog-j1{'+-'[number % 2]}").hover()
        page.mouse.down()
        page.wait_for_timeout(300)
        tester.do("reset")
        page.wait_for_timeout(3500)
        longest = max(longest, tester.do("report")["heartbeat"])
        if page.get_by_test_id("jog-state").inner_text() != "Moving":
            stopped = page.get_by_test_id("jog-message").inner_text()
        page.mouse.up()
        page.wait_for_timeout(700)
    if page.get_by_test_id("jog-state").inner_text() != "Off":
        page.get_by_test_id("jog-enable").click()
        page.get_by_test_id("jog-state").get_by_text("Off").wait_for()
    context.close()
    report.line("jogging: longest time between two heartbeats", longest, "ms", HEARTBEAT, stopped)


# --- everything at the same time --------------------------------------------------------------------------------------


class Clicks:
    """Clicks on one element that change the page back and forth.

    Args:
        page: The page.
        target: Function that returns the element to click, from the number of the click.
        tests: JavaScript expressions that are true after an even and an odd click.

    Attributes:
        changes: Times until the contents of the page had changed, ms.
        times: Times until the page displayed the change, ms.
    """

    def __init__(self, page: Any, target: Callable[[int], Any], tests: tuple[str, str]) -> None:
        self._page, self._target, self._tests = page, target, tests
        self.changes: list[float] = []
        self.times: list[float] = []

    def click(self) -> None:
        """Click, and measure the time until the page has reacted."""
        number = len(self.times)
        element = self._target(number)
        box = element.bounding_box()
        self._page.evaluate(CLICKED, [self._tests[number % 2]])
        self._page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        changed, displayed = self._page.evaluate("window.okReaction")
        self.changes.append(float(changed))
        self.times.append(float(displayed))


def windows(context: Any, count: int) -> list[Any]:
    """Open pages of one user, each in a window of its own.

    Chromium composes only the tab in front of each window; the pages of other tabs get one or two frames per second.
    """
    pages = [context.new_page()]
    while len(pages) < count:
        with context.expect_page() as opened:
            pages[0].evaluate("open('about:blank', '_blank', 'popup, noopener')")
        pages.append(opened.value)
    return pages


def clicks_of(context: Any, url: str) -> dict[str, Clicks]:
    """Open three pages; return clicks on each of them.

    The coordinates of jogging and the plot of a variable change when the Tester has replied, the others before.
    """
    arm, monitor, packets = windows(context, 3)
    arm.goto(f"{url}/arm")
    arm.get_by_test_id("jog-j1+").wait_for()
    arm.locator('[data-testid="scene"][data-ready]').wait_for()
    monitor.goto(f"{url}/monitor")
    monitor.get_by_test_id("watch-name").fill(WATCHED)
    monitor.get_by_test_id("watch-add").click()
    monitor.get_by_test_id("watch-I1").get_by_test_id("plot").click()
    monitor.get_by_test_id("watch-D1").get_by_test_id("plot").click()
    packets.goto(f"{url}/packets")
    packets.get_by_test_id("packet-count").get_by_text("packets").wait_for()
    frame, tabs = arm.get_by_test_id("jog-frame"), packets.get_by_test_id("packet-tabs")
    label = "document.querySelector('[data-testid=pause]').ariaLabel"
    plotted = "document.querySelector('[data-testid=watch-I2] [data-testid=plot]').ariaPressed"
    parts = "document.querySelector('.ok-packet-parts').classList.contains('hidden')"
    return {
        "Arm: coordinates of jogging": Clicks(
            arm, lambda number: frame.get_by_text(("Base", "Joint")[number % 2], exact=True),
            ("document.querySelector('[data-testid=\"jog-x+\"]')", "document.querySelector('[data-testid=\"jog-j1+\"]')"),
        ),
        "Monitor: pause of the plot": Clicks(
            monitor, lambda _: monitor.get_by_test_id("pause"), (f"{label} === 'Continue'", f"{label} === 'Pause'")
        ),
        "Monitor: plot of a variable": Clicks(
            monitor, lambda _: monitor.get_by_test_id("watch-I2").get_by_test_id("plot"),
            (f"{plotted} === 'true'", f"{plotted} === 'false'"),
        ),
        "Packets: tabs": Clicks(
            packets, lambda number: tabs.get_by_text(("Last sent and received", "All packets")[number % 2], exact=True),
            (parts, f"!{parts}"),
        ),
    }  # fmt: skip


def together(opened: Any, tester: Tester, seconds: float, count: int, stalls: Stalls, report: Report) -> None:
    """Measure three pages, a stream and logged packets at the same time."""
    from playwright.sync_api import Error

    context = opened.new_context(viewport={"width": 1360, "height": 900})
    context.set_default_timeout(PATIENCE * 1000)
    clicks = clicks_of(context, tester.url)
    tester.do("load", RATE)
    tester.do("stream", seconds)
    while not (stream := tester.do("report")["stream"])["sent"]:
        if stream["finished"]:
            raise SystemExit(f"bench/tester.py: the stream did not start: {stream['error']}")
        time.sleep(0.1)
    tester.do("reset")
    began = time.monotonic()
    pause = max(0.0, seconds * 0.8 / count)
    for number in range(count):
        due = began + number * pause
        time.sleep(max(0.0, due - time.monotonic()))
        for what, each in clicks.items():
            try:
                each.click()
            except Error as error:  # the page was loaded again, or does not react
                raise SystemExit(f"{what}, click {number}: {error}") from error
    figures = tester.do("report")
    while not (stream := tester.do("report")["stream"])["finished"]:
        time.sleep(0.1)
    ended = time.monotonic()
    tester.do("load", 0)
    context.close()
    note = f"{stream['sent']} set-points; gaps above 1.5 cycles: {stream['late_gaps']}, longest {stream['longest_gap']:.1f} ms"
    report.line("missed cycles of the streaming process", stream["missed"], "", 0, note)
    if stream["error"] not in ("", "None"):
        report.exceeded += 1
        print(f"    the stream was stopped: {stream['error']}")
    print(f"    {stalls.text(began, ended)}")
    for what, each in clicks.items():
        times = each.times
        note = (
            f"p50 {median(times):.0f}, p99 {quantile(times, 0.99):.0f} ms, {len(times)} clicks; "
            f"contents changed after p50 {median(each.changes):.0f}, max {max(each.changes):.0f} ms"
        )
        report.line(f"click, {what}: longest", max(times), "ms", REACTION, note)
    report.line("logged packets", figures["packets"], "/s", None, f"{figures['kept']} kept")
    note = f"delays p99 {figures['delay_p99']:.1f}, max {figures['delay']:.1f} ms; {figures['where']}"
    report.line("event loop: longest block", figures["block"], "ms", BLOCK, note)


def main() -> int:
    """Run all measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="run a short time, to check that it runs")
    parser.add_argument("--check", action="store_true", help="exit with 1 if a limit is exceeded")
    parser.add_argument("--only", choices=("paint", "loop", "jog", "together"), help="one of the measurements")
    arguments = parser.parse_args()
    problem = missing()
    if problem:
        print(problem)
        return 1 if arguments.check else 0
    quick, report = arguments.quick, Report()
    print("The Tester in headless Chromium without a graphics processor.")
    with (
        tempfile.TemporaryDirectory() as folder, controller() as url, Tester(url, folder) as tester, watched() as stalls,
        browser() as opened,
    ):  # fmt: skip
        if arguments.only in (None, "paint"):
            first_paints(opened, tester, 1 if quick else 5, report)
        if arguments.only in (None, "loop"):
            loops(opened, tester, 2.0 if quick else 10.0, report)
        if arguments.only in (None, "jog"):
            jogging(opened, tester, 5.0 if quick else 20.0, report)
        if arguments.only in (None, "together"):
            if tester.do("report")["kept"] < KEPT:
                tester.do("fill", KEPT)
            together(opened, tester, 8.0 if quick else 120.0, 5 if quick else 50, stalls, report)
    if report.exceeded:
        print(f"{report.exceeded} limits are exceeded.")
    return 1 if arguments.check and report.exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
