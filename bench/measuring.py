"""Measure alternately with a bare reference; the peers run in separate processes."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from results import Row, padded

ROUNDS = 9
PATIENCE = 20.0  # s until a peer that does not end is killed
RECORDED: list[Row] = []  # the results that line() has printed
CORES = range(os.cpu_count() or 1)


def on_core(number: int) -> None:
    """Pin this process to a core, if the system permits it: sharing a core affects results more than anything else."""
    if hasattr(os, "sched_setaffinity") and len(CORES) > 1:
        os.sched_setaffinity(0, {CORES[number]})


@contextmanager
def process(target: Callable[[multiprocessing.connection.Connection], None]) -> Iterator[str]:
    """Run a peer in a separate process; yield its first message, which is its address."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    child = context.Process(target=target, args=(theirs,), daemon=True)
    child.start()
    theirs.close()  # if the peer fails immediately, recv() then raises an exception instead of blocking
    try:
        yield str(ours.recv())
    finally:
        child.terminate()
        child.join(PATIENCE)
        child.kill()
        child.join()


def each_us(action: Callable[[], object], count: int) -> float:
    """Return the mean time of one action in a tight loop, in microseconds."""
    begin = time.perf_counter()
    for _ in range(count):
        action()
    return (time.perf_counter() - begin) / count * 1e6


def alternate(ours: Callable[[], float], bare: Callable[[], float], rounds: int = ROUNDS) -> tuple[float, float, float]:
    """Alternate two measurements; return the median of each measurement, and the median of the ratios of the rounds."""
    pairs = [(ours(), bare()) for _ in range(rounds)]
    return (
        statistics.median(a for a, _ in pairs),
        statistics.median(b for _, b in pairs),
        statistics.median(a / b for a, b in pairs),
    )


def in_turn(ours: Callable[[], object], bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Alternate two actions, so that the conditions are the same for both; return both medians and their ratio."""
    clock = time.perf_counter
    times: tuple[list[float], list[float]] = ([], [])
    for number in range(count + count // 10):
        for action, samples in zip((ours, bare), times, strict=True):
            begin = clock()
            action()
            end = clock()
            if number >= count // 10:
                samples.append(end - begin)
    return medians(*times)


def medians(ours: list[float], bare: list[float]) -> tuple[float, float, float]:
    """Return the medians of two lists of seconds, in microseconds, and their ratio."""
    mine, other = statistics.median(ours) * 1e6, statistics.median(bare) * 1e6
    return mine, other, mine / other


def middle(results: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Return the median of each column."""
    ours, bare, ratio = (statistics.median(column) for column in zip(*results, strict=True))
    return ours, bare, ratio


def line(what: str, ours: float, bare: float, ratio: float, unit: str, aim: str = "") -> None:
    """Print one result, and keep it in ``RECORDED``."""
    RECORDED.append(Row(what, ours, unit, None, bare, ratio, ours - bare, note=aim))
    print(f"{padded(what, 58)} {ours:>9.2f} {unit:<4} bare {bare:>8.2f} {unit:<4} ratio {ratio:>5.2f}  {aim}")
