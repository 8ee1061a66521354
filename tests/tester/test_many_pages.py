"""Many open pages, and pages that are open for a long time: nothing breaks, and memory stays flat."""

from __future__ import annotations

import sys
import time
from typing import Any

import pytest

from orinkit.tester.pages import PAGES
from support.browser import needs_browser
from support.footprint import PageFootprint, cpu_time, footprint, resident
from support.slave_page import generate, opened
from support.waiting import PATIENCE

pytestmark = [
    needs_browser,
    pytest.mark.soak,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

TABS = 20
MEASURED = 20.0  # s
MINUTES = 10
SETTLED = 3  # minutes until caches and histories of the pages are full
PER_TAB = 12.0  # MB of the Tester
GROWTH = 20.0  # MB of the Tester, from minute 3 to 10
HEAP_GROWTH = 12.0  # MB of the scripts of a page
NODE_GROWTH = 3_000


def open_page(context: Any, url: str, path: str) -> Any:
    page = context.new_page()
    page.script_errors = []
    page.on("pageerror", lambda error: page.script_errors.append(f"{path}: {error}"))
    page.goto(f"{url}{path}")
    page.locator(".ok-page-title").wait_for()
    return page


@pytest.mark.timeout(1200)
def test_twenty_tabs_are_open_at_once(page, bench):
    pid = bench.tester.process.pid
    page.goto(bench.tester.url)
    page.locator(".ok-page-title").wait_for()
    before = resident(pid)
    paths = [PAGES[number % len(PAGES)].path for number in range(TABS)]
    tabs = [open_page(page.context, bench.tester.url, path) for path in paths]
    opened_at, used = time.monotonic(), cpu_time(pid)
    page.wait_for_timeout(1000 * MEASURED)
    load = (cpu_time(pid) - used) / (time.monotonic() - opened_at)
    after = resident(pid)
    print(f"{TABS} tabs: Tester {before:.0f} MB -> {after:.0f} MB, {100 * load:.0f} % of a core")
    for tab in tabs:
        tab.bring_to_front()
        tab.get_by_test_id("controls").get_by_text("You hold the controls").wait_for()
        assert not tab.script_errors
        assert not tab.locator('.ok-error:visible, [role="alert"]:visible').filter(has_text="0x").count()
    tabs[-1].get_by_test_id("stop-all").click()
    tabs[-1].get_by_text("all motions are stopped").wait_for()
    assert after - before < TABS * PER_TAB
    for tab in tabs:
        tab.close()
    page.goto(f"{bench.tester.url}/arm")
    page.get_by_test_id("joint-1").wait_for()
    assert not bench.tester.errors


@pytest.mark.timeout(3600)
def test_memory_is_flat_while_a_stream_runs_for_ten_minutes(page, bench):
    context, url, pid = page.context, bench.tester.url, bench.tester.process.pid
    opened(page, url)
    generate(page, amplitude=10.0, period=4.0, repetitions=200)  # 13 minutes
    others = {path: open_page(context, url, path) for path in ("/arm", "/monitor", "/packets")}
    watch(others["/monitor"])
    page.bring_to_front()
    tester: list[float] = []
    pages: list[dict[str, PageFootprint]] = []
    runs = 0
    for minute in range(MINUTES + 1):
        end = time.monotonic() + (60 if minute else 0)
        while time.monotonic() < end or not minute:
            runs += keep_streaming(page, bench)
            page.wait_for_timeout(1000)
            if not minute:
                break
        tester.append(resident(pid))
        pages.append({path: footprint(each) for path, each in {"/slave-move": page, **others}.items()})
        figures = ", ".join(f"{path} {each.heap:.1f} MB {each.nodes} nodes" for path, each in pages[-1].items())
        print(f"minute {minute}: Tester {tester[-1]:.1f} MB; {figures}", flush=True)
    print(f"the stream was started {runs} times")
    stop = page.locator('[data-testid="stop"]:not(.disabled)')
    if stop.count():
        stop.click()
    assert tester[-1] - tester[SETTLED] < GROWTH, tester
    for path, last in pages[-1].items():
        first = pages[SETTLED][path]
        assert last.heap - first.heap < HEAP_GROWTH, (path, first, last)
        assert last.nodes - first.nodes < NODE_GROWTH, (path, first, last)
    assert not any(each.script_errors for each in others.values())
    assert not bench.tester.errors


def watch(page: Any) -> None:
    page.get_by_test_id("watch-name").fill("I1 I2 @MODE @CURRENT_TIME")
    page.get_by_test_id("watch-add").click()
    page.get_by_test_id("watch-I1").get_by_test_id("value").wait_for()


def keep_streaming(page: Any, bench: Any) -> int:
    """Start the stream if it does not run: a machine that stalls ends it. Return 1 if it was started."""
    start = page.locator('[data-testid="start"]:not(.disabled)')
    if not start.count():
        return 0
    print("the stream had ended:", page.get_by_test_id("outcome").inner_text(), flush=True)
    start.click()
    end = time.monotonic() + PATIENCE
    while bench.rc8.state.arm.slave.mode is None and time.monotonic() < end:
        page.wait_for_timeout(100)
    return 1
