"""User programs that stream, in separate processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from support.streams import HOME, Arm

PROGRAM = """
import orinkit, os, signal, sys, time
from orinkit.values.poses import J
url, feed, end = sys.argv[1:]
signal.signal(signal.SIGINT, signal.default_int_handler)

def moved(stream):
    while stream.latest.joints[0] < 8:
        time.sleep(0.001)

def points():
    angle, speed = 0.0, 0.0
    while True:
        speed = min(60.0, speed + 3.0)
        angle += speed * 0.008
        yield (angle, 45, 90, 0, 45, 0)

with orinkit.connect(url) as rc8:
    robot = rc8.robot("Arm")
    with robot.arm(), robot.motor():
        try:
            with robot.slave_mode() as stream:
                print("streaming", stream._streaming._process.pid, flush=True)
                if feed == "target":
                    stream.target = J(160, 45, 90, 0, 45, 0)
                    if end == "raise":
                        moved(stream)
                        raise RuntimeError("mine")
                    time.sleep(60)
                elif feed == "push":
                    for number, point in enumerate(points()):
                        if end == "raise" and number > 180:
                            moved(stream)
                            raise RuntimeError("mine")
                        stream.push(point)
                else:
                    def until_raised():
                        for number, point in enumerate(points()):
                            if end == "raise" and number > 100:
                                moved(stream)
                                raise RuntimeError("mine")
                            yield point
                            if number > 25:
                                time.sleep(0.006)
                    stream.run(until_raised())
        except BaseException as error:
            print("ended", type(error).__name__, error, "at", rc8.client.stray_replies, flush=True)
            raise
"""


@contextmanager
def program(url: str, feed: str, end: str = "") -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run a user program that streams; yields its process and the process id of its streaming process."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, url, feed, end], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, int(process.stdout.readline().split()[1])
        finally:
            process.kill()


def gone(pid: int) -> bool:
    """Return True if a process has ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def came_to_rest(arm: Arm) -> None:
    """Check the log of the controller: no errors, no limit violations, and standstill at the end."""
    assert arm.errors == []
    assert arm.within_limits()
    commands = arm.commands
    assert (commands[-3:] == commands[-1]).all()
    assert np.abs(commands - HOME).max() > 5
