"""An hour of mixed load under attack (``make soak``; ``ORINKIT_SOAK_SECONDS`` makes it shorter).

Memory, descriptors and threads stay constant, no acknowledged write is lost, and the arm stays within its limits.
"""

from __future__ import annotations

import os
import random
import threading
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import pytest

from orinkit.arms import load_model
from orinkit.values.poses import J
from support.attacked import PATIENT, Attackers, Crowd, Served, served
from support.attackers import ATTACKS

pytestmark = pytest.mark.soak

SECONDS = float(os.environ.get("ORINKIT_SOAK_SECONDS", "3600"))
WARM = max(20.0, SECONDS / 12)
PERIOD = 0.008
MIB = 1024  # KiB


class Mover:
    """Moves the arm, and checks with the control log that every command position was within the limits."""

    def __init__(self, target: Served) -> None:
        self._target = target
        self._axes = load_model("VS-050").axes
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.moves = 0
        self.commands = 0
        self.wrong: list[str] = []
        self.errors: list[BaseException] = []

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(PATIENT)

    def _run(self) -> None:
        chance = random.Random(1)
        try:
            with self._target.connect() as controller, controller.robot("Arm") as robot, robot.arm():
                while not self._ended.wait(1.0):
                    joints = [chance.uniform(0.3 * axis.lower, 0.3 * axis.upper) for axis in self._axes]
                    robot.execute("ClearLog")  # otherwise up to 12,500 old records would be read again
                    robot.execute("StartLog")
                    robot.move(J(*joints))
                    robot.execute("StopLog")
                    count = robot.execute("GetLogCount")
                    self._check([robot.execute("GetLogRecord", index) for index in range(count)])
                    self.moves += 1
        except BaseException as error:  # noqa: BLE001 - reported by the test
            self.errors.append(error)

    def _check(self, records: list[list[Any]]) -> None:
        commands = [record[0:32:4] for record in records]
        self.commands += len(commands)
        for before, now in pairwise(commands):
            for number, axis in enumerate(self._axes):
                velocity = abs(now[number] - before[number]) / PERIOD
                if velocity > axis.velocity * 1.001 or not axis.lower - 1e-6 <= now[number] <= axis.upper + 1e-6:
                    self.wrong.append(f"J{number + 1}: {before[number]} -> {now[number]}")


def written(target: Served, values: dict[str, int]) -> None:
    with target.connect() as controller:
        for name, value in values.items():
            controller.variable(name).value = value


@pytest.mark.timeout(SECONDS + 1800)
def test_an_hour_among_attackers(tmp_path: Path) -> None:
    state = tmp_path / "state"
    kept = {f"I{number}": number for number in range(80, 100)}
    with served(tmp_path, "--state", str(state)) as target:
        with (
            Crowd(target, 10, pause=0.05) as crowd,
            Mover(target) as mover,
            Attackers(target, tuple(ATTACKS)) as attackers,
        ):
            time.sleep(WARM)
            before = target.figures()
            seen = [before]
            end = time.monotonic() + SECONDS - WARM
            while time.monotonic() < end:
                time.sleep(min(30.0, SECONDS / 20))
                kept["I80"] += 1
                written(target, kept)
                seen.append(target.figures())
        last = calm(target, before)
        print(
            f"\nclients {crowd.calls} calls, slowest {crowd.slowest:.2f} s; {mover.moves} moves, {mover.commands} commands"
        )
        print(f"attackers: {attackers.did}")
        print(f"memory {before[0] / MIB:.0f} MB, at most {max(seen)[0] / MIB:.0f}, at the end {last[0] / MIB:.0f}")
        print(f"descriptors {before[1]} to {last[1]}, threads {before[2]} to {last[2]}")
        third = len(seen) // 3
        growth = max(each[0] for each in seen[-third:]) - max(each[0] for each in seen[:third])
        problems = {
            "errors of the other clients": crowd.errors,
            "errors of the client that moves the arm": mover.errors,
            "command positions beyond the limits": mover.wrong,
            # A motion and its log take about 3 s on an idle machine. One per minute shows that the arm remains usable.
            "too few motions": [] if mover.moves > SECONDS / 60 else [mover.moves],
            "no command positions checked": not mover.commands,
            "the server has ended": target.process.poll() is not None,
            "memory has grown (KiB)": growth >= 30 * MIB and growth,
            "descriptors left": last[1] > 40 and last[1],
            "threads left": last[2] > before[2] and last[2],
        }
    with served(tmp_path, "--state", str(state)) as target, target.connect() as controller:
        lost = {name: value for name, value in kept.items() if controller.variable(name).value != value}
    problems["acknowledged writes lost"] = lost
    assert {name: found for name, found in problems.items() if found} == {}  # all checks, even if some of them fail


def calm(target: Served, before: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the figures after all clients have disconnected; half a minute is enough for every time-out."""
    end = time.monotonic() + 30
    while (figures := target.figures())[1] > before[1] - 10 and time.monotonic() < end:
        time.sleep(0.5)
    return figures
