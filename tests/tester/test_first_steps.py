"""The first steps of a new user, who knows only the README: from ``git clone`` to jogging the arm with two commands."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from support.browser import needs_browser, user
from support.waiting import PATIENCE, until

pytestmark = [needs_browser, pytest.mark.soak]

ROOT = Path(__file__).parents[2]
COMMAND = "make tester"  # in README.md, section "Try it"
LIMIT = 180.0  # s


@pytest.mark.skipif(
    not (ROOT / ".git").exists() or not shutil.which("git") or not shutil.which("make"), reason="requires git and make"
)
@pytest.mark.timeout(1200)
def test_the_arm_is_jogged_within_three_minutes_of_git_clone(browser, tmp_path):
    assert f"{COMMAND} " in (ROOT / "README.md").read_text("utf-8").partition("## Try it")[2].partition("\n## ")[0]
    hidden = ("VIRTUAL_ENV", "PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY", "MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"XDG_CONFIG_HOME": f"{tmp_path / 'config'}", "ORINKIT_LANG": "en"}
    started = time.monotonic()
    subprocess.run(["git", "clone", "--quiet", ROOT, tmp_path / "orinkit"], check=True, timeout=PATIENCE)
    cloned = time.monotonic()
    output = tmp_path / "output.txt"
    with output.open("wb") as sink:
        process = subprocess.Popen(
            COMMAND.split(), cwd=tmp_path / "orinkit", env=environment, stdout=sink, stderr=sink, start_new_session=True
        )
    try:
        until(lambda: "in a browser" in output.read_text() or process.poll() is not None, 2 * LIMIT)
        assert process.poll() is None, output.read_text()
        ready = time.monotonic()
        page_of_hint = re.search(r"open (http://\S+)", output.read_text())
        assert page_of_hint, output.read_text()
        with user(browser) as page:
            page.goto(page_of_hint[1])
            jog(page)
            jogged = time.monotonic()
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(PATIENCE)
    print(
        f"git clone {cloned - started:.1f} s, {COMMAND} {ready - cloned:.1f} s, "
        f"from the page to the motion {jogged - ready:.1f} s, total {jogged - started:.1f} s"
    )
    assert jogged - started < LIMIT


def jog(page):
    """Press "Motor on" and "Enable jogging", then hold a button until the displayed joint changes."""
    page.get_by_role("button", name="Motor on").click()
    page.locator('[data-testid="chip-motor"].ok-good').wait_for()
    page.get_by_role("button", name="Enable jogging").click()
    page.locator('[data-testid="jog-j1+"][aria-disabled="false"]').wait_for()
    page.locator('[data-testid="scene"][data-ready]').wait_for()
    joint = page.get_by_test_id("joint-1")
    before = joint.inner_text()
    page.get_by_test_id("jog-j1+").hover()
    page.mouse.down()
    page.wait_for_function(
        "before => document.querySelector('[data-testid=\"joint-1\"]').innerText !== before", arg=before
    )
    page.mouse.up()
