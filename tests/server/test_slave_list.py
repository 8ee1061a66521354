"""List 4-1 of the RC8 document, bCapSlvMode.c, translated to Python: with a manual clock, and in real time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit import functions
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, plain
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from support.leaping import going
from support.waiting import PATIENCE

PERIOD, AMPLITUDE, TIMES = 100, 10, 3  # the names used in the list
S_OK, S_BUF_FULL, E_BUF_FULL = 0, 0x0F200501, 0x83201483
START = (45.0, 30.0, 120.0, 0.0, -60.0, 0.0)
CYCLE = 0.008

AsSent = Callable[[list[float]], Any]


@dataclass
class Run:
    """The replies that one run of the program received, and the motion of the arm."""

    codes: list[int] = field(default_factory=list)
    points: list[tuple[float, ...]] = field(default_factory=list)
    commands: list[tuple[float, ...]] = field(default_factory=list)
    error: CallError | None = None
    faults: int = 0
    """Number of errors that the controller has logged."""
    longest: float = 0.0
    """Longest time from the end of one call to the end of the next, including the pauses of the program, s."""


def as_r8(pose: list[float]) -> Any:
    return pose


def as_r4(pose: list[float]) -> Any:
    return Variant(VarType.R4 | ARRAY, np.array(pose, dtype=np.float32).tolist())


@dataclass
class Time:
    """The time base of the program.

    Attributes:
        pause: waits for the duration of one pause of the program.
        passing: advances the clock while the program waits for the controller.
    """

    pause: Callable[[], None]
    passing: Callable[[], AbstractContextManager[None]]


def program(url: str, run: Run, as_sent: AsSent, time_: Time, log: Callable[[], None]) -> None:
    """Execute list 4-1, statement by statement; ``log`` starts the controller's log."""
    with orinkit.connect(url, timeout=PATIENCE) as rc8:
        rc8.execute("ClearError")
        robot = rc8.robot("Robot")
        robot.execute("Takearm", [0, 1])
        robot.execute("ExtSpeed", [20.0])
        with time_.passing():
            robot.execute("Motor", 1)
            robot.move(1, "@E J(45, 30, 120, 0, -60, 0)")
        start = robot.execute("CurJnt")
        log()
        robot.execute("slvChangeMode", 2)
        ended = time.monotonic()
        for _ in range(TIMES):
            i = 0
            while i < PERIOD + 1:
                pose = list(start)
                pose[0] = start[0] - AMPLITUDE * math.cos(2 * math.pi * i / PERIOD) + AMPLITUDE
                pose[1] = start[1] - AMPLITUDE * math.cos(2 * math.pi * i / PERIOD) + AMPLITUDE
                try:
                    code, _value = rc8.client.request(functions.robot_execute, robot.handle, "slvMove", as_sent(pose))
                except CallError as error:
                    if error.code != E_BUF_FULL:
                        raise
                    code = error.code
                else:
                    run.points.append(tuple(plain(as_sent(pose)))[:6])
                    i += 1
                run.codes.append(code)
                now = time.monotonic()
                run.longest, ended = max(run.longest, now - ended), now
                if code != S_OK:
                    time_.pause()
        while True:  # "Stop robot": the last pose once more
            try:
                robot.execute("slvMove", as_sent(pose))
                break
            except CallError as error:
                if error.code != E_BUF_FULL:
                    raise
                time_.pause()
        run.points.append(run.points[-1])
        with time_.passing():
            robot.execute("slvChangeMode", 0)
            robot.execute("Motor", 0)
        robot.execute("Givearm")


def one_run(as_sent: AsSent, clock: Clock, time_: Time) -> Run:
    device = VirtualRC8(model="VS-050", joints=(43.0, *START[1:]), clock=clock)
    run = Run()
    log = device.state.arm.log

    def begin() -> None:
        with device.state.cycles:
            log.clear()
            log.running = True
            device.state.cycles.wake()

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        try:
            program(server.url, run, as_sent, time_, begin)
        except CallError as error:
            run.error = error
        with device.state.cycles:
            log.running = False
            run.commands = [tuple(log.record(index)[0:24:4]) for index in range(len(log))]
            run.faults = len(device.state.faults.log)
    device.close()
    return run


def with_manual_clock(as_sent: AsSent, wait: float) -> Run:
    """Run the program with a clock that advances only while the program waits."""
    clock = ManualClock()
    run = one_run(as_sent, clock, Time(lambda: clock.advance(wait), lambda: going(clock, CYCLE)))
    check(run)
    return run


def in_real_time(as_sent: AsSent, wait: float) -> Run:
    """Run the program in real time; if the machine caused a delay, repeat at half the speed."""
    for scale in (1.0, 0.5, 0.25, 0.125):
        run = one_run(as_sent, Clock(scale), Time(lambda scale=scale: time.sleep(wait / scale), nullcontext))
        if scale == 0.125 or run.longest < (wait + CYCLE) / scale:
            break
        try:
            check(run)
        except AssertionError:
            continue
        break
    check(run)
    return run


def check(run: Run) -> None:
    """Check that there was no error, and that each of the 303 + 1 set-points was consumed in order, exactly once."""
    assert run.error is None
    assert run.faults == 0
    points = run.points
    assert len(points) == TIMES * (PERIOD + 1) + 1 == 304
    # The arm is at the first set-point and at the last two anyway. Between them, each set-point takes one cycle, also at
    # the two transitions, where one sine ends and the next begins at the same pose.
    moved = [index for index, command in enumerate(run.commands) if command != points[0]]
    first, last = moved[0], moved[-1]
    assert points[0] == START
    assert run.commands[first - 1 : last + 3] == points
    assert len(run.commands) > last + 2
    assert run.commands[-1] == START


@pytest.mark.parametrize("as_sent", [as_r8, as_r4])
def test_list_4_1(as_sent: AsSent) -> None:
    """The program as printed; old clients send VT_R4 (reference: rc8 4.4).

    S_OK until the buffer is full, then S_BUF_FULL once per cycle. E_BUF_FULL does not occur: the program sleeps 8 ms
    after each S_BUF_FULL, in which at least one of the three set-points is consumed, so that there is room.
    """
    run = with_manual_clock(as_sent, CYCLE)
    assert run.codes == [S_OK] * 2 + [S_BUF_FULL] * 301
    if as_sent is as_r4:
        assert all(tuple(map(np.float32, command)) == command for command in run.commands)


@pytest.mark.parametrize("as_sent", [as_r8, as_r4])
def test_list_4_1_with_half_the_pause(as_sent: AsSent) -> None:
    """With half the pause, the buffer overflows (E_BUF_FULL), and the set-point is sent again."""
    run = with_manual_clock(as_sent, CYCLE / 2)
    assert run.codes == [S_OK] * 2 + [S_BUF_FULL] + [E_BUF_FULL, S_BUF_FULL] * 300


@pytest.mark.parametrize("wait", [CYCLE, CYCLE / 2])
@pytest.mark.parametrize("as_sent", [as_r8, as_r4])
def test_list_4_1_in_real_time(as_sent: AsSent, wait: float) -> None:
    """The number of full buffers depends on the machine here; the motion of the arm does not."""
    run = in_real_time(as_sent, wait)
    assert run.codes[:2] == [S_OK, S_OK]
    assert run.codes.count(S_BUF_FULL) > 0
    assert run.codes.count(S_OK) + run.codes.count(S_BUF_FULL) == 303
