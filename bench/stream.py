"""Streaming in slave mode while the program itself is busy: ``make bench``.

The program that streams has busy pure-Python threads, and one that makes garbage. What is measured is what goes out over
the wire: the gaps between two set-points, and whether the controller's buffer ran dry (0x84201482), against the plain way,
a thread of the same program that sends slvMove itself. A virtual RC8 in a process of its own is the controller; its
clock runs faster for cycles of 4 and 1 ms.
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
from pathlib import Path

import orinkit
from orinkit import hresult
from orinkit.errors import CallError
from orinkit.streaming import Progress, StreamResult, Timing

START = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
PERIOD = 0.008
AMPLITUDE = 10.0  # deg
CYCLE = 250  # set-points of one sine
GIGABYTE = 1 << 30
PIECE = 1 << 25
LISTENING = {"tcp": ("--tcp", "127.0.0.1:0"), "udp": ("--udp", "127.0.0.1:0"), "pty": ("--pty",)}
PRIORITY = 70  # of SCHED_FIFO, below that of the streaming process


@contextmanager
def controller(scale: float = 1.0, wire: str = "tcp") -> Iterator[str]:
    """A virtual RC8 in a process of its own, with a clock so many times as fast; yields its address."""
    command = [
        sys.executable,
        "-m",
        "orinkit",
        "serve",
        "rc8",
        *LISTENING[wire],
        "--motor-on",
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
    """Give the controller a priority above the busy program, where that is permitted: a real one has its own processor."""
    for thread in Path(f"/proc/{process}/task").iterdir():
        try:
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError:
            return


@contextmanager
def busy(threads: int) -> Iterator[list[int]]:
    """So many threads that count, and one that makes a gigabyte of garbage each second; yields how much was made."""
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
            circle.append(circle)  # for the collector to find
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
    """A set-point of a sine of two joints that begins and ends at rest."""
    sway = AMPLITUDE * (1 - math.cos(2 * math.pi * number / CYCLE))
    return (START[0] + sway, START[1] + sway, *START[2:])


def trajectory(seconds: float) -> list[tuple[float, ...]]:
    """Whole sines for about so many seconds of the controller's time."""
    count = max(1, round(seconds / PERIOD / CYCLE)) * CYCLE
    return [point(number) for number in range(count + 1)]


def ours(url: str, seconds: float, mode: int) -> StreamResult:
    """Stream with orinkit; what an underflow has ended has no samples and no gaps."""
    sent = 0

    def note(progress: Progress) -> None:
        nonlocal sent
        sent = progress.sent

    try:
        with orinkit.connect(url) as rc8:
            robot = rc8.robot()
            with robot.arm(), robot.motor():
                robot.move(orinkit.J(*START), "@E")
                with robot.slave_mode(mode=mode) as stream:
                    return stream.run(trajectory(seconds), progress=note)
    except CallError as error:
        if error.code != hresult.COMMAND_DELAY:
            raise
        return StreamResult(sent, 1, (), 0, Timing())


def plain(url: str, seconds: float) -> tuple[Timing, int, int]:
    """Send slvMove from a thread of this program, mode 0, 8 ms by the clock; returns gaps, underflows and set-points."""
    sent: list[float] = []
    gaps: list[float] = []
    underflows = 0

    def stream(robot: orinkit.Robot, points: list[tuple[float, ...]]) -> None:
        robot.execute("slvChangeMode", 0x002)
        tick = time.monotonic()
        for number in (*range(len(points)), len(points) - 1, len(points) - 1):
            while True:
                try:
                    robot.execute("slvMove", [*points[number], 0.0, 0.0])
                except CallError as error:
                    if error.code != 0x83201483:
                        raise
                    time.sleep(PERIOD / 8)
                else:
                    break
            sent.append(time.monotonic())
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
        robot.execute("slvChangeMode", 0)

    end = time.monotonic() + seconds
    count = 0
    while time.monotonic() < end:
        with orinkit.connect(url) as rc8:
            robot = rc8.robot()
            rc8.execute("ClearError")
            with robot.arm(), robot.motor():
                robot.move(orinkit.J(*START), "@E")
                sent.clear()
                failed: list[BaseException] = []

                def work() -> None:
                    try:
                        stream(robot, trajectory(min(seconds, 10.0)))  # noqa: B023 - joined in this very turn
                    except CallError as error:
                        failed.append(error)  # noqa: B023

                thread = threading.Thread(target=work)
                thread.start()
                thread.join()
                count += len(sent)
                gaps += [b - a for a, b in itertools.pairwise(sent)]
                underflows += len(failed)
                rc8.execute("ClearError")
                robot.execute("Motor", [1, 0])
        if failed:
            break
    return Timing(tuple(gaps)), underflows, count


def late(timing: Timing, cycle: float) -> int:
    """Gaps that a buffer of three set-points does not outlast."""
    return sum(gap > 3 * cycle for gap in timing.gaps)


def show(what: str, timing: Timing, cycle: float, underflows: int, count: int, own: str = "") -> None:
    """Print one line."""
    print(
        f"{what:<46} {count:>6} set-points, underflows {underflows}, gaps p50 {timing.p50 * 1e3:5.2f} "
        f"p99 {timing.p99 * 1e3:5.2f} max {timing.max * 1e3:6.2f} ms, above 3 cycles: {late(timing, cycle)}{own}",
        flush=True,
    )


def show_ours(what: str, result: StreamResult, cycle: float) -> None:
    """Print one line, with what the streaming process itself needs: from an answer to the next set-point (mode 2)."""
    if not result.samples:
        print(f"{what:<46} {result.sent:>6} set-points, underflows {result.underflows}, which ended it", flush=True)
        return
    own = Timing(tuple(b.sent - a.answered for a, b in itertools.pairwise(result.samples) if b.number == a.number + 1))
    text = f"; answer to next set-point p50 {own.p50 * 1e3:.2f} p99 {own.p99 * 1e3:.2f} max {own.max * 1e3:.2f} ms"
    show(what, result.timing, cycle, result.underflows, result.sent, text)


def long_run(seconds: float) -> None:
    """8 ms for ten minutes with one, then four busy threads, and the plain way in the same run."""
    for threads in (1, 4):
        with controller() as url, busy(threads) as made:
            began, before = time.monotonic(), made[0]
            timing, underflows, count = plain(url, min(seconds, 20.0))
            show(f"plain thread, 8 ms, {threads} busy", timing, PERIOD, underflows, count)
            result = ours(url, seconds, 2)
            rate = (made[0] - before) / GIGABYTE / (time.monotonic() - began)
            show_ours(f"orinkit, 8 ms, mode 2, {threads} busy, {rate:.1f} GB/s of garbage", result, PERIOD)


def short_cycles(seconds: float) -> None:
    """The other modes at 8 ms, and cycles of 4 and 1 ms, with four busy threads."""
    for mode, scale in ((0, 1.0), (1, 1.0), (2, 2.0), (2, 8.0)):
        with controller(scale) as url, busy(4):
            result = ours(url, seconds * scale, mode)
            cycle = PERIOD / scale
            show_ours(f"orinkit, {cycle * 1e3:.0f} ms, mode {mode}, 4 busy", result, cycle)


def other_wires(seconds: float) -> None:
    """8 ms over UDP and over a pseudo-terminal, with a busy thread."""
    for wire in ("udp", "pty"):
        with controller(wire=wire) as url, busy(1):
            show_ours(f"orinkit, 8 ms, mode 2, {wire}, 1 busy", ours(url, seconds, 2), PERIOD)


def latency(seconds: float) -> None:
    """From ``stream.target = ...`` to the wire."""
    for threads in (0, 1):
        with controller() as url, busy(threads), orinkit.connect(url) as rc8:
            robot = rc8.robot()
            with robot.arm(), robot.motor(), robot.slave_mode() as stream:
                delays: list[float] = []
                added: list[float] = []
                answered = 0.0
                end = time.monotonic() + seconds
                number = 0
                while time.monotonic() < end:
                    number += 1
                    stream.target = orinkit.J(*point(number))
                    time.sleep(0.005 + 0.011 * (number * 0.618 % 1))  # at any moment of the cycle
                    for sample in stream.samples():
                        if sample.delay is not None:
                            delays.append(sample.delay)
                            added.append(sample.sent - max(sample.sent - sample.delay, answered))
                        answered = sample.answered
                for what, seconds_ in (("target to the wire", delays), ("of that without the controller", added)):
                    timing = Timing(tuple(seconds_))
                    print(
                        f"{f'{what}, 8 ms, mode 2, {threads} busy':<58} {len(seconds_):>5} targets, "
                        f"p50 {timing.p50 * 1e3:.2f} p99 {timing.p99 * 1e3:.2f} max {timing.max * 1e3:.2f} ms",
                        flush=True,
                    )


def main() -> None:
    """Run everything."""
    from gateway import slave_through_gateway  # which is made of what is above

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes, to see that it runs")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each long run")
    arguments = parser.parse_args()
    seconds = 4.0 if arguments.quick else arguments.minutes * 60
    print("Streaming in slave mode; gaps are those between two set-points on the wire.")
    latency(min(20.0, seconds))
    short_cycles(min(30.0, seconds))
    other_wires(min(60.0, seconds))
    slave_through_gateway(min(60.0, seconds))
    long_run(seconds)


if __name__ == "__main__":
    main()
