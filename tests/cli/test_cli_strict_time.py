"""serve rc8 and serve ve026a: the controller waits for a late set-point unless --strict-time is given."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable, Iterator

import pytest

import orinkit
from orinkit.core.hresult import COMMAND_DELAY
from support.waiting import until

WAITED = "no set-point for 250 ms"
OPTIONS = pytest.mark.parametrize(("options", "waited"), [((), True), (("--strict-time",), False)])

Serve = Callable[..., "tuple[subprocess.Popen[str], str]"]


@pytest.fixture
def serve(program) -> Iterator[Serve]:
    """Start ``orinkit serve``, with the motor on; returns the process and its address."""
    started: list[subprocess.Popen[str]] = []

    def serve(*words: str) -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(
            [*program, "serve", *words, "--tcp", "127.0.0.1:0", "--motor-on"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        return process, process.stdout.readline().removeprefix("ready ").rstrip("\n")

    yield serve
    for process in started:
        process.kill()
        process.communicate()


def move_and_stop_sending(robot: orinkit.Robot, mode: int) -> None:
    """Stream some set-points, and then no more while the arm moves."""
    first, *others = robot.joints
    robot.execute("slvChangeMode", mode)
    with contextlib.suppress(orinkit.CallError):  # with strict time, an earlier set-point may be late
        for number in range(20):
            robot.execute("slvMove", [first + 0.01 * number**2, *others])


@OPTIONS
def test_a_late_set_point_for_an_rc8(serve, options, waited):
    _, url = serve("rc8", *options)
    with orinkit.connect(url) as controller, orinkit.connect(url) as other, controller.robot() as robot:
        robot.execute("TakeArm", [0, 1])
        move_and_stop_sending(robot, 0x202)
        until(other.errors)
        (error,) = other.errors()
        assert error.code == COMMAND_DELAY
        assert (WAITED in error.message) is waited
        count, longest, _ = robot.execute("slvGetLateness")
        assert (count >= 1 and longest >= 0.25) is waited


@OPTIONS
def test_a_late_set_point_for_a_ve026a(serve, options, waited):
    process, url = serve("ve026a", *options)
    with orinkit.connect(url, provider="") as controller, controller.robot() as robot:
        move_and_stop_sending(robot, 2)
        assert process.stderr is not None
        line = next(line for line in process.stderr if "0x80040201" in line)
        assert (WAITED in line) is waited
        controller.clear_error()


def test_both_have_the_option(run):
    for kind in ("rc8", "ve026a"):
        assert "--strict-time" in run("serve", kind, "--help").out
