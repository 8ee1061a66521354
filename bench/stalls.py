"""Detect stalls of the machine with a real-time process on each core: a stall that delays it delays all others, too.

``python bench/stalls.py CORE`` is such a process: it wakes every millisecond and prints each late wake-up.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

PRIORITY = 90  # priority with SCHED_FIFO, above the priority of the measured processes
TICK = 0.001
NOTICED = 0.0005  # s by which a wake-up must be late to be reported
LATE = 0.004  # s by which a watcher may be late: half a cycle of a controller


@dataclass(frozen=True, slots=True)
class Stall:
    """An interval (s of the monotonic clock) in which a core did not run a real-time process."""

    begin: float
    end: float


@dataclass
class Stalls:
    """The stalls that the watchers have detected.

    Attributes:
        real_time: True if the watchers have real-time priority; without it, other programs also delay them.
    """

    real_time: bool = True
    _seen: list[Stall] = field(default_factory=list)

    def between(self, begin: float, end: float, least: float = LATE) -> list[Stall]:
        """Return the stalls longer than ``least`` s that overlap an interval; each core is listed separately."""
        return [
            stall
            for stall in list(self._seen)
            if stall.end > begin and stall.begin < end and stall.end - stall.begin > least
        ]

    def text(self, begin: float, end: float) -> str:
        """Return the number and the longest of the stalls in an interval as text."""
        found = self.between(begin, end)
        longest = max((stall.end - stall.begin for stall in found), default=0.0)
        what = "stalls of the machine" if self.real_time else "stalls (watched without real-time priority)"
        return f"{what} {len(found)}, longest {longest * 1e3:.0f} ms" if found else f"{what} 0"

    def read(self, lines: Iterator[str]) -> None:
        """Read the output of a watcher."""
        for line in lines:
            if line.startswith("no"):
                self.real_time = False
            else:
                begin, end = map(float, line.split())
                self._seen.append(Stall(begin, end))


@contextmanager
def watched() -> Iterator[Stalls]:
    """Watch all cores while the ``with`` statement lasts."""
    stalls = Stalls()
    watchers = [
        subprocess.Popen([sys.executable, __file__, str(core)], stdout=subprocess.PIPE, text=True)
        for core in sorted(os.sched_getaffinity(0))
    ]
    readers = []
    for watcher in watchers:
        assert watcher.stdout is not None
        readers.append(threading.Thread(target=stalls.read, args=(iter(watcher.stdout.readline, ""),), daemon=True))
        readers[-1].start()
    try:
        yield stalls
    finally:
        for watcher, reader in zip(watchers, readers, strict=True):
            watcher.terminate()
            watcher.wait()
            reader.join()
            if watcher.stdout is not None:
                watcher.stdout.close()


def watch(core: int) -> None:
    """Watch one core until this process is terminated or its parent has ended."""
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        print("no real-time priority", flush=True)
    parent = os.getppid()
    expected = time.monotonic()
    while os.getppid() == parent:
        expected += TICK
        time.sleep(max(0.0, expected - time.monotonic()))
        now = time.monotonic()
        if now - expected > NOTICED:
            print(expected, now, flush=True)
            expected = now


if __name__ == "__main__":
    watch(int(sys.argv[1]))
