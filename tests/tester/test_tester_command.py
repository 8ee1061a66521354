"""``orinkit tester``: start, address, access over HTTP, signals, child processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.browser import TesterProcess
from support.waiting import PATIENCE, until


def get(url: str, **headers: str) -> tuple[int, str]:
    request = urllib.request.Request(url, headers={name.replace("_", "-"): value for name, value in headers.items()})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as reply:
            return reply.status, reply.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def children_of(number: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{number}/task/{number}/children").read_text().split()]


def alive(number: int) -> bool:
    return (
        Path(f"/proc/{number}").exists()
        and "Z" not in Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    )


def test_pages_and_refusals(tmp_path):
    with TesterProcess(folder=tmp_path) as tester:
        assert get(tester.url)[0] == 200
        assert get(tester.url, Host="evil.example")[0] == 403
        assert get(tester.url, Origin="http://evil.example")[0] == 403
        code, text = get(f"{tester.url}/_nicegui_ws/socket.io/?EIO=4&transport=polling", Origin="http://evil.example")
        assert (code, "other web pages" in text) == (403, True)
        assert get(tester.url, Origin="http://[::1")[0] == 403
        with urllib.request.urlopen(f"{tester.url}/arm", timeout=PATIENCE) as reply:  # no page may show it in a frame
            assert reply.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
            assert reply.headers["X-Frame-Options"] == "DENY"
        _status, page = get(tester.url)
        assert "http://" not in page.replace(tester.url, "").replace("http://www.w3.org/", "")


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGINT, marks=pytest.mark.soak),
        pytest.param(signal.SIGHUP, marks=pytest.mark.soak),
    ],
)
def test_a_signal_ends_the_tester_and_its_virtual_controllers(tmp_path, number):
    with TesterProcess("--virtual", "rc8", folder=tmp_path) as tester:
        (child,) = children_of(tester.process.pid)
        tester.process.send_signal(number)
        assert tester.process.wait(PATIENCE) == 0
        assert not alive(child)


def test_a_killed_tester_leaves_no_process_behind(tmp_path):
    with TesterProcess("--virtual", "rc8", folder=tmp_path) as tester:
        (child,) = children_of(tester.process.pid)
        tester.process.kill()
        tester.process.wait(PATIENCE)
        until(lambda: not alive(child))


def test_a_used_port(tmp_path):
    with TesterProcess(folder=tmp_path) as tester:
        again = subprocess.run(
            [sys.executable, "-m", "orinkit", "tester", "--no-browser", "--http", tester.url.removeprefix("http://")],
            capture_output=True, text=True, timeout=PATIENCE, env={**os.environ, "ORINKIT_LANG": "en"}, check=False,
        )  # fmt: skip
        assert again.returncode == 1
        assert "cannot listen" in again.stderr
        assert "--http 127.0.0.1:0" in again.stderr


def test_an_address_for_other_machines_requires_the_token(tmp_path):
    with TesterProcess(folder=tmp_path, http="0.0.0.0:0") as tester:
        address, _, token = tester.url.replace("0.0.0.0", "127.0.0.1").partition("/?token=")
        assert token
        assert get(address)[0] == 403
        assert get(f"{address}/?token=wrong")[0] == 403
        assert get(f"{address}/?token={token}")[0] == 200
        assert get(address, Cookie=f"orinkit_token={token}")[0] == 200


@contextmanager
def run_with_browser(folder: Path, *words: str, **environment: str) -> Iterator[tuple[str, str]]:
    """Run the Tester as a user does; yield its address and the hint for the user."""
    given = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")}
    process = subprocess.Popen(
        [sys.executable, "-m", "orinkit", "tester", "--http", "127.0.0.1:0", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**given, "XDG_CONFIG_HOME": str(folder), "ORINKIT_LANG": "en", "PYTHONUNBUFFERED": "1", **environment},
    )  # fmt: skip
    with process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = process.stdout.readline()
        if not first:
            raise AssertionError(process.stderr.read())
        yield first.split()[1], process.stderr.readline()
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0


@pytest.mark.parametrize(("words", "path"), [(("--virtual", "rc8"), "/arm"), ((), "/")])
def test_the_browser_opens_at_the_arm_if_a_controller_is_connected(tmp_path, words, path):
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > "{tmp_path}/opened"\n')
    browser.chmod(0o700)
    with run_with_browser(tmp_path, *words, BROWSER=f"{browser} %s") as (url, hint):
        assert (tmp_path / "opened").read_text().strip() == url + path
        assert f"shows {url}{path}" in hint


def test_without_a_graphical_browser_the_address_is_printed(tmp_path):
    with run_with_browser(tmp_path) as (url, hint):
        port = url.rpartition(":")[2]
        assert hint.startswith(f"orinkit: no browser could be opened. Try: open {url}/ in a browser")
        assert f"ssh -L {port}:localhost:{port}" in hint


@pytest.mark.parametrize(
    "words", [["--http", "nowhere"], ["--http", "127.0.0.1:99999"], ["--virtual", "rc9"], ["tcp://"]]
)
def test_wrong_arguments(words):
    done = subprocess.run(
        [sys.executable, "-m", "orinkit", "tester", "--no-browser", *words],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("orinkit: ")
