"""Performance of the virtual RC8: programs, kinematics, motions. Part of ``make bench``; the reference is plain Python."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from orinkit.arms import load_model
from orinkit.arms.kinematics import Kinematics
from orinkit.cao.provider import ClientInfo
from orinkit.rc8.task_modes import TaskMode
from orinkit.values.poses import AT_COMMAND
from orinkit.values.variant import variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.motion import planner
from orinkit.virtual.rc8 import VirtualRC8

COUNTING = """Sub Main
  Dim n As Integer
  For n = 1 To 1000000
    I1 = I1 + 1
  Next
End Sub
"""
SECONDS = 2.0
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)


def statements(seconds: float = SECONDS) -> Callable[[], float]:
    """Return a function that runs a program for ``seconds`` of the controller's clock.

    The function returns the number of statements per real second.
    """
    clock = ManualClock()
    rc8 = VirtualRC8(clock=clock, samples=False)
    rc8.state.files.write("Count.pcs", COUNTING.encode())
    task = rc8.state.tasks.find("Count")
    rc8.state.tasks.start(task, rc8.state.tasks.load(task), TaskMode.CONTINUOUS)
    counter: Any = rc8.connect("", "", "", ClientInfo()).get_variable("I1", "")

    def run() -> float:
        before, begin = counter.get_value().plain, time.perf_counter()
        for _ in range(round(seconds / PERIOD)):
            clock.advance(PERIOD)
        spent = time.perf_counter() - begin
        return float(2 * (counter.get_value().plain - before) / spent)  # an iteration consists of two statements

    return run


def plain_statements() -> float:
    """Return the number of statements per second of the same loop in plain Python."""
    values, begin = {"I1": 0}, time.perf_counter()
    for _ in range(200_000):
        values["I1"] = values["I1"] + 1
    return 400_000 / (time.perf_counter() - begin)


def kinematics() -> dict[str, Callable[[], object]]:
    """Return the functions to measure for a VS-050, by name."""
    kin = Kinematics(load_model("VS-050"))
    flange = kin.forward(HOME)
    near = np.asarray(HOME)
    end = kin.forward((20.0, 50.0, 80.0, 10.0, 40.0, 15.0))
    tool = np.eye(4)
    rates = planner.Rates()
    return {
        "forward kinematics": lambda: kin.forward(HOME),
        "inverse kinematics": lambda: kin.inverse(flange, 5, near),
        "planning a line": lambda: planner.plan_line(kin, HOME, end, tool, rates, AT_COMMAND),
    }


def sines() -> object:
    """Compute twelve sines and cosines, the minimum for forward kinematics, as the reference."""
    return [(math.sin(angle), math.cos(angle)) for angle in HOME]


def cycle() -> Callable[[], object]:
    """Return a function that runs one cycle of the controller while the arm moves."""
    clock = ManualClock()
    rc8 = VirtualRC8(clock=clock, motor=True, samples=False)
    robot: Any = rc8.connect("", "", "", ClientInfo()).get_robot("", "")
    robot.execute("TakeArm", variant([0, 0]))

    def run() -> None:
        if not rc8.state.arm.busy:
            side = -90 if rc8.state.arm.queue.joints[0] > 0 else 90
            robot.move(1, variant(f"J({side}, 45, 90, 0, 45, 0)"), "SPEED=5,NEXT")
        clock.advance(PERIOD)

    return run
