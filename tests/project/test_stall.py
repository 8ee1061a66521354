"""tools/stall.py: processes of a command are stopped and always continued, and its exit status is the command's."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.paths import ROOT
from support.waiting import PATIENCE, until

STALL = ROOT / "tools" / "stall.py"

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux only")


def stalled(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(STALL), *words], capture_output=True, text=True, timeout=PATIENCE, check=False, **options
    )


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("true",), 0),
        (("--", "false"), 1),
        (("--seed", "3", "sh", "-c", "exit 7"), 7),
        (("sh", "-c", "kill -9 $$"), 128 + 9),
        (("no-such-command",), 2),
        ((), 2),
    ],
)
def test_the_exit_status_is_that_of_the_command(words, status):
    assert stalled(*words).returncode == status


def test_the_end_is_detected_if_the_system_reaps_children():
    done = subprocess.run(
        ["sh", "-c", f"trap '' CHLD; exec {sys.executable} {STALL} sh -c 'exit 5'"], timeout=PATIENCE, check=False
    )
    assert done.returncode == 5


def test_processes_are_stopped_and_continued():
    done = stalled("sh", "-c", "sleep 3 & sleep 3; wait")
    assert done.returncode == 0
    assert int(done.stderr.split("stall.py: ")[1].split()[0]) > 2


def state(number: int) -> str:
    return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGUSR1])
def test_nothing_stays_stopped_when_it_is_ended(number):
    program = subprocess.Popen(
        [sys.executable, str(STALL), sys.executable, "-c", "import os, time; print(os.getpid(), flush=True); time.sleep(60)"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert program.stdout is not None
    child = int(program.stdout.readline())
    try:
        until(lambda: state(child) == "T")
        program.send_signal(number)
        program.wait(PATIENCE)
        if number == signal.SIGKILL:
            time.sleep(0.2)
            until(lambda: state(child) == "S")  # another injector may be at work, which stops it for a while
        else:
            until(lambda: not Path(f"/proc/{child}").exists())
    finally:
        program.stdout.close()
        if Path(f"/proc/{child}").exists():
            os.kill(child, signal.SIGKILL)
