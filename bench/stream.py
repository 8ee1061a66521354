"""Streaming in slave mode while the program itself is busy: ``make bench``.

The streaming program has busy pure-Python threads, and one that produces garbage. The measurement is made on the
connection to the controller: the gaps between two set-points, and buffer underflows of the controller (0x84201482). The
reference is a thread of the same program that calls slvMove itself. The controller is a virtual RC8 with strict time in
a separate process; its clock runs faster for cycles of 4 and 1 ms.

Three figures are reported separately:

* underflows: the queue between the program and the streaming process was empty, and how many of these had no stall near;
* failures: the controller ended the stream, which is then restarted;
* stalls of the machine: an otherwise idle real-time process was not woken in time either.

A failure within 0.3 s of a stall is attributed to the machine.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import orinkit
from orinkit import Progress, Timing
from orinkit.core import hresult
from orinkit.core.errors import CallError, OrinError
from results import BUILD, Results, Row, judged
from stalls import Stalls, watched

START = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
PERIOD = 0.008
AMPLITUDE = 10.0  # deg
CYCLE = 250  # number of set-points of one sine
GIGABYTE = 1 << 30
PIECE = 1 << 25
LISTENING = {"tcp": ("--tcp", "127.0.0.1:0"), "udp": ("--udp", "127.0.0.1:0"), "pty": ("--pty",)}
PRIORITY = 70  # priority with SCHED_FIFO, below the priority of the streaming process
PIECE_SECONDS = 20.0  # duration of a trajectory, s of the controller's clock
NEAR_A_STALL = 0.3  # s within which the program receives the failure that a stall causes
LATE = ("COMMAND_DELAY", "SLAVE_MODE_OFF")  # the return codes for a late set-point and for the next one
RESULTS = Results()
PATIENCE = 20.0  # s within which the motor of a controller can be switched on again after an error


@contextmanager
def controller(scale: float = 1.0, wire: str = "tcp") -> Iterator[str]:
    """Run a virtual RC8 in a separate process, with its clock scaled; yield its address."""
    command = [
        sys.executable,
        "-m",
        "orinkit",
        "serve",
        "rc8",
        *LISTENING[wire],
        "--motor-on",
        "--strict-time",
        "--time-scale",
        str(scale),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        try:
            ready = server.stdout.readline()  # "ready URL"
            as_if_elsewhere(server.pid)
            yield ready.split()[1]
        finally:
            server.terminate()


def as_if_elsewhere(process: int) -> None:
    """Give the controller a higher priority than the busy program, if permitted.

    A real controller has its own processor.
    """
    for thread in Path(f"/proc/{process}/task").iterdir():
        try:
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError:
            return


@contextmanager
def busy(threads: int) -> Iterator[list[int]]:
    """Run threads that count, and one that produces 1 GB of garbage per second; yield a list with the bytes so far."""
    end = threading.Event()
    made = [0]

    def count() -> None:
        number = 0
        while not end.is_set():
            for _ in range(10_000):
                number += 1

    def litter() -> None:
        began = time.monotonic()
        while not end.is_set():
            b"x" * PIECE
            circle: list[object] = []
            circle.append(circle)  # only the garbage collector can free it
            made[0] += PIECE
            ahead = made[0] / GIGABYTE - (time.monotonic() - began)
            if ahead > 0:
                time.sleep(ahead)

    workers = [threading.Thread(target=count, daemon=True) for _ in range(threads)]
    if threads:
        workers.append(threading.Thread(target=litter, daemon=True))
    for worker in workers:
        worker.start()
    try:
        yield made
    finally:
        end.set()
        for worker in workers:
            worker.join()


def point(number: int) -> tuple[float, ...]:
    """Return a set-point of a sine of two joints that begins and ends at standstill."""
    sway = AMPLITUDE * (1 - math.cos(2 * math.pi * number / CYCLE))
    return (START[0] + sway, START[1] + sway, *START[2:])


def trajectory(seconds: float) -> list[tuple[float, ...]]:
    """Return whole sines for about ``seconds`` of the controller's clock."""
    count = max(1, round(seconds / PERIOD / CYCLE)) * CYCLE
    return [point(number) for number in range(count + 1)]


@dataclass
class Outcome:
    """Result of a measurement.

    Attributes:
        sent: Number of set-points.
        underflows: Number of times that the queue was empty while the arm moved.
        dry: Time (monotonic, s) at which the program noticed each underflow.
        failures: Time (monotonic, s) and error of each stream that the controller or the connection ended.
        gaps: Times between two set-points in s, for complete trajectories.
        own: Times from a reply to the next set-point in s.
        began, ended: Beginning and end (monotonic, s).
    """

    sent: int = 0
    underflows: int = 0
    dry: list[float] = field(default_factory=list)
    failures: list[tuple[float, str]] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    own: list[float] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)
    ended: float = 0.0

    def unexplained(self, stalls: Stalls, least: float) -> int:
        """Return the number of underflows without a stall longer than ``least`` s near them; the goal is 0."""
        return sum(not stalls.between(moment - NEAR_A_STALL, moment, least) for moment in self.dry)

    def excused(self, stalls: Stalls) -> int:
        """Return the number of failures that coincide with a stall of the machine."""
        return sum(bool(stalls.between(moment - NEAR_A_STALL, moment)) for moment, _ in self.failures)


def ours(url: str, seconds: float, mode: int) -> Outcome:
    """Stream with orinkit for ``seconds`` of the controller's clock; restart after a failure."""
    outcome = Outcome()
    wanted = round(seconds / PERIOD)
    while outcome.sent < wanted and len(outcome.failures) < 100:
        before = outcome.sent
        try:
            _stream(url, mode, wanted, outcome)
        except OrinError as error:
            outcome.failures.append((time.monotonic(), str(error)))
            if outcome.sent == before and len(outcome.failures) > 2:  # no stream could send a set-point
                break
    outcome.ended = time.monotonic()
    return outcome


def _stream(url: str, mode: int, wanted: int, outcome: Outcome) -> None:
    with orinkit.connect(url) as rc8:
        robot = rc8.robot()
        recover(rc8, robot)
        with robot.arm(), robot.motor():
            robot.move(orinkit.J(*START), "@E")
            with robot.slave_mode(mode=mode) as stream:
                while outcome.sent < wanted:
                    before, dry = outcome.sent, stream.underflows - len(outcome.dry)

                    def note(progress: Progress, before: int = before, dry: int = dry) -> None:
                        outcome.sent = before + progress.sent
                        outcome.dry += [time.monotonic()] * (stream.underflows - dry - len(outcome.dry))

                    result = stream.run(trajectory(min(PIECE_SECONDS, (wanted - before) * PERIOD)), progress=note)
                    outcome.underflows += result.underflows
                    outcome.dry += [time.monotonic()] * (outcome.underflows - len(outcome.dry))
                    outcome.gaps += result.timing.gaps
                    outcome.own += [
                        b.sent - a.replied for a, b in itertools.pairwise(result.samples) if b.number == a.number + 1
                    ]


def recover(rc8: orinkit.Controller, robot: orinkit.Robot) -> None:
    """Clear the error of an earlier failure and switch the motor on; retry while it is still switching off."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            rc8.execute("ClearError")
            robot.execute("Motor", [1, 0])
        except CallError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
        else:
            return


def plain(url: str, seconds: float) -> Outcome:
    """Send slvMove in mode 0 from a thread of this program, every 8 ms by the clock; restart after a failure."""
    outcome = Outcome()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with orinkit.connect(url) as rc8:
            robot = rc8.robot()
            recover(rc8, robot)
            with robot.arm(), robot.motor():
                robot.move(orinkit.J(*START), "@E")
                points = trajectory(min(PIECE_SECONDS, seconds))
                thread = threading.Thread(target=_by_the_clock, args=(robot, points, outcome))
                thread.start()
                thread.join()
                recover(rc8, robot)
    outcome.ended = time.monotonic()
    return outcome


def _by_the_clock(robot: orinkit.Robot, points: list[tuple[float, ...]], outcome: Outcome) -> None:
    """Send a set-point every 8 ms by the clock, as a simple program would."""
    sent: list[float] = []
    try:
        robot.execute("slvChangeMode", 0x002)
        tick = time.monotonic()
        for number in (*range(len(points)), len(points) - 1, len(points) - 1):
            while not _taken(robot, points[number]):
                time.sleep(PERIOD / 8)
            sent.append(time.monotonic())
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
        robot.execute("slvChangeMode", 0)
    except OrinError as error:
        outcome.failures.append((time.monotonic(), str(error)))
    outcome.sent += len(sent)
    outcome.gaps += [b - a for a, b in itertools.pairwise(sent)]


def _taken(robot: orinkit.Robot, joints: tuple[float, ...]) -> bool:
    try:
        robot.execute("slvMove", [*joints, 0.0, 0.0])
    except CallError as error:
        if error.code != hresult.E_BUF_FULL:
            raise
        return False
    return True


def show(what: str, outcome: Outcome, cycle: float, stalls: Stalls, own: str = "") -> None:
    """Print one line."""
    timing = Timing(tuple(outcome.gaps))
    late = sum(gap > 3 * cycle for gap in timing.gaps)  # longer than the controller's buffer of three set-points lasts
    print(
        f"{what:<46} {outcome.sent:>6} set-points, underflows {outcome.underflows} "
        f"({outcome.unexplained(stalls, cycle / 2)} without a stall), "
        f"failures {len(outcome.failures)} ({outcome.excused(stalls)} with a stall), "
        f"{stalls.text(outcome.began, outcome.ended)}, gaps p50 {timing.p50 * 1e3:5.2f} "
        f"p99 {timing.p99 * 1e3:5.2f} max {timing.max * 1e3:6.2f} ms, above 3 cycles: {late}{own}",
        flush=True,
    )
    without = outcome.unexplained(stalls, cycle / 2)
    note = f"{outcome.sent} set-points; {stalls.text(outcome.began, outcome.ended)}"
    RESULTS.rows += [
        Row(f"{what}: gaps between set-points", timing.p50 * 1e3, "ms", timing.p99 * 1e3, cycle * 1e3, note=note),
        Row(f"{what}: underflows without a stall", without, "", goal="0", met=judged(not without)),
        Row(f"{what}: failures without a stall", len(outcome.failures) - outcome.excused(stalls), ""),
    ]
    others = {text for _, text in outcome.failures if not any(name in text for name in LATE)}
    for text in sorted(others)[:3]:
        print(f"    {text:.200}", flush=True)


def show_ours(what: str, outcome: Outcome, cycle: float, stalls: Stalls) -> None:
    """Print one line; in mode 2, include the delay of the streaming process from a reply to the next set-point."""
    own = Timing(tuple(outcome.own))
    text = f"; reply to next set-point p50 {own.p50 * 1e3:.2f} p99 {own.p99 * 1e3:.2f} max {own.max * 1e3:.2f} ms"
    show(what, outcome, cycle, stalls, text if outcome.own else "")


def long_run(seconds: float, stalls: Stalls) -> None:
    """Measure cycles of 8 ms with one and with four busy threads, and the plain thread in the same run."""
    for threads in (1, 4):
        with controller() as url, busy(threads) as made:
            began, before = time.monotonic(), made[0]
            show(f"plain thread, 8 ms, {threads} busy", plain(url, min(seconds, 20.0)), PERIOD, stalls)
            outcome = ours(url, seconds, 2)
            rate = (made[0] - before) / GIGABYTE / (time.monotonic() - began)
            show_ours(f"orinkit, 8 ms, mode 2, {threads} busy, {rate:.1f} GB/s of garbage", outcome, PERIOD, stalls)


def short_cycles(seconds: float, stalls: Stalls) -> None:
    """Measure the other modes at 8 ms, and cycles of 4 and 1 ms, with four busy threads."""
    for mode, scale in ((0, 1.0), (1, 1.0), (2, 2.0), (2, 8.0)):
        with controller(scale) as url, busy(4):
            outcome = ours(url, seconds * scale, mode)
            cycle = PERIOD / scale
            show_ours(f"orinkit, {cycle * 1e3:.0f} ms, mode {mode}, 4 busy", outcome, cycle, stalls)


def other_wires(seconds: float, stalls: Stalls) -> None:
    """Measure cycles of 8 ms over UDP and over a pseudo-terminal, with a busy thread."""
    for wire in ("udp", "pty"):
        with controller(wire=wire) as url, busy(1):
            show_ours(f"orinkit, 8 ms, mode 2, {wire}, 1 busy", ours(url, seconds, 2), PERIOD, stalls)


@dataclass
class Delays:
    """Delays from setting live targets to sending the first set-points towards them.

    Attributes:
        all: Delay of each target in s.
        added: Delay of each target in s, without the time spent waiting for the controller.
        failures: Number of streams that the controller ended.
    """

    all: list[float] = field(default_factory=list)
    added: list[float] = field(default_factory=list)
    failures: int = 0


def latency(seconds: float) -> None:
    """Measure the delay from ``stream.target = ...`` to sending the first set-point towards the target."""
    for threads in (0, 1):
        delays = Delays()
        with controller() as url, busy(threads):
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                try:
                    _follow_targets(url, end, delays)
                except OrinError:
                    delays.failures += 1
        for what, values in (
            ("target to the wire", delays.all),
            ("the same without waiting for the controller", delays.added),
        ):
            timing = Timing(tuple(values))
            print(
                f"{f'{what}, 8 ms, mode 2, {threads} busy':<58} {len(values):>5} targets, "
                f"p50 {timing.p50 * 1e3:.2f} p99 {timing.p99 * 1e3:.2f} max {timing.max * 1e3:.2f} ms, "
                f"failures {delays.failures}",
                flush=True,
            )


def _follow_targets(url: str, end: float, delays: Delays) -> None:
    with orinkit.connect(url) as rc8:
        robot = rc8.robot()
        recover(rc8, robot)
        with robot.arm(), robot.motor():
            robot.move(orinkit.J(*START), "@E")
            with robot.slave_mode() as stream:
                answered = 0.0
                number = 0
                while time.monotonic() < end:
                    number += 1
                    stream.target = orinkit.J(*point(number))
                    time.sleep(0.005 + 0.011 * (number * 0.618 % 1))  # targets are set at varying times within a cycle
                    for sample in stream.new_samples():
                        if sample.delay is not None:
                            delays.all.append(sample.delay)
                            delays.added.append(sample.sent - max(sample.sent - sample.delay, answered))
                        answered = sample.replied


def main() -> None:
    """Run all measurements."""
    from gateway import slave_through_gateway  # imported here, because gateway imports this module

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="run seconds instead of minutes, to check that it runs")
    parser.add_argument("--minutes", type=float, default=10.0, help="duration of each long run")
    parser.add_argument("--cycles", action="store_true", help="only cycles of 8, 4 and 1 ms, 5 s each")
    parser.add_argument("--csv", type=Path, default=BUILD / "stream.csv", help="file for the results")
    arguments = parser.parse_args()
    seconds = 4.0 if arguments.quick else arguments.minutes * 60
    print("Streaming in slave mode, strict time; gaps are those between two set-points on the wire.")
    with watched() as stalls:
        if arguments.cycles:
            short_cycles(5.0, stalls)
            RESULTS.write(arguments.csv)
            return
        latency(min(20.0, seconds))
        short_cycles(min(30.0, seconds), stalls)
        other_wires(min(60.0, seconds), stalls)
        slave_through_gateway(min(60.0, seconds), stalls=stalls)
        long_run(seconds, stalls)
    RESULTS.write(arguments.csv)


if __name__ == "__main__":
    main()
