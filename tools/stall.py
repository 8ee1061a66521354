"""Run a command on a stalling machine: ``python tools/stall.py [--seed N] COMMAND [ARG ...]``.

Each process of the command's process tree is stopped (SIGSTOP) for 20 to 100 ms about once a second, independently of
the other processes, and then continued (SIGCONT). Orphaned daemons of the command belong to the tree until the command
ends. The exit status is the exit status of the command. Linux only.

A process that another program has stopped stays stopped. If another program stops a process during a stall, the process
is continued at the end of the stall. Therefore a test that stops a process must ensure that the process stays stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import heapq
import os
import random
import shutil
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

_PR_SET_CHILD_SUBREAPER: Final = 36
_RESCAN: Final = 0.05  # s between two searches for new processes
_STALL: Final = (0.020, 0.100)  # s for which a process is stopped
_PAUSE: Final = (0.5, 1.5)  # s for which a process runs between two stalls
_STOPPED: Final = ("T", "t", "Z", "X")
_FORWARDED: Final = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM)


@dataclass(frozen=True)
class Process:
    """A process; the start time distinguishes it from a later process with the same number."""

    number: int
    started: str


@dataclass
class Injector:
    """Stops and continues the descendants of this process.

    Attributes:
        stalls: Number of stalls.
        stalled: Total duration of the stalls in s.
    """

    chance: random.Random
    guard: Guard
    stalls: int = 0
    stalled: float = 0.0
    _known: set[Process] = field(default_factory=set)
    _stopped: set[Process] = field(default_factory=set)
    _plan: list[tuple[float, int, Process, float]] = field(
        default_factory=list
    )  # time, sequence number, process, duration of the stall in s; if it is 0, the process is continued
    _count: int = 0
    _rescan: float = 0.0

    def step(self) -> float:
        """Carry out the actions that are due; return the time until the next action in s."""
        now = time.monotonic()
        if now >= self._rescan:
            self._find(now)
            self._rescan = now + _RESCAN
        while self._plan and self._plan[0][0] <= now:
            _, _, process, seconds = heapq.heappop(self._plan)
            if seconds:
                self._stop(process, seconds)
            else:
                self._continue(process)
        following = min(self._rescan, self._plan[0][0]) if self._plan else self._rescan
        return max(0.0, following - time.monotonic())

    def end(self) -> None:
        """Continue all stopped processes."""
        for process in list(self._stopped):
            self._continue(process)

    def _find(self, now: float) -> None:
        running = {each for each in descendants(os.getpid()) if each.number != self.guard.number}
        for process in sorted(running - self._known, key=lambda each: each.number):
            self._schedule(now + self.chance.uniform(0.0, _PAUSE[1]), process, self.chance.uniform(*_STALL))
        self._known = running

    def _schedule(self, when: float, process: Process, seconds: float) -> None:
        self._count += 1
        heapq.heappush(self._plan, (when, self._count, process, seconds))

    def _stop(self, process: Process, seconds: float) -> None:
        state = state_of(process)
        if state is None:
            return
        now = time.monotonic()
        if state in _STOPPED:
            self._schedule(now + self.chance.uniform(*_PAUSE), process, seconds)
            return
        self.guard.notify(process, stopped=True)
        if send(process, signal.SIGSTOP):
            self._stopped.add(process)
            self.stalls += 1
            self.stalled += seconds
            self._schedule(now + seconds, process, 0.0)

    def _continue(self, process: Process) -> None:
        self._stopped.discard(process)
        continued = state_of(process) is not None and send(process, signal.SIGCONT)
        self.guard.notify(process, stopped=False)
        if continued:
            pause = self.chance.uniform(*_PAUSE)
            self._schedule(time.monotonic() + pause, process, self.chance.uniform(*_STALL))


def read_stat(number: int) -> tuple[str, int, str] | None:
    """Return state, parent and start time of a process; ``None`` if it has ended."""
    try:
        text = Path(f"/proc/{number}/stat").read_text(errors="replace")
    except OSError:
        return None
    fields = text.rpartition(")")[2].split()
    return fields[0], int(fields[1]), fields[19]


def state_of(process: Process) -> str | None:
    """Return the state of a process; ``None`` if it has ended."""
    stat = read_stat(process.number)
    return stat[0] if stat is not None and stat[2] == process.started else None


def send(process: Process, number: signal.Signals) -> bool:
    """Send a signal; return False if the process has ended or belongs to another user."""
    try:
        os.kill(process.number, number)
    except (ProcessLookupError, PermissionError):
        return False
    return True


def descendants(root: int) -> set[Process]:
    """Return all descendants of a process."""
    children: dict[int, list[Process]] = {}
    for entry in os.listdir("/proc"):  # noqa: PTH208 - ten times as fast as Path, and called twenty times a second
        stat = read_stat(int(entry)) if entry.isdigit() else None
        if stat is not None:
            children.setdefault(stat[1], []).append(Process(int(entry), stat[2]))
    found: set[Process] = set()
    waiting = [root]
    while waiting:
        for process in children.get(waiting.pop(), ()):
            found.add(process)
            waiting.append(process.number)
    return found


def adopt_orphans() -> None:
    """Become the subreaper: orphaned processes become children of this process and thus stay in the tree."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def reap(command: int) -> int | None:
    """Reap ended children; return the wait status of the command once it has ended."""
    while True:
        number, status = os.waitpid(-1, os.WNOHANG)
        if number == 0:
            return None
        if number == command:
            return status


class Guard:
    """A child process that continues the stopped processes if this program is killed.

    The pipe through which it is notified is closed when this program ends.
    """

    def __init__(self) -> None:
        theirs, self._pipe = os.pipe()
        self.number = os.fork()
        if self.number == 0:
            os.close(self._pipe)
            self._watch(theirs)
        os.close(theirs)

    def notify(self, process: Process, *, stopped: bool) -> None:
        """Report a process that is about to be stopped, or has been continued."""
        os.write(self._pipe, f"{'+' if stopped else '-'} {process.number} {process.started}\n".encode())

    def end(self) -> None:
        """End the child process."""
        os.close(self._pipe)
        os.waitpid(self.number, 0)

    @staticmethod
    def _watch(pipe: int) -> None:
        os.setsid()  # signals of the terminal do not reach this process
        stopped: set[Process] = set()
        with os.fdopen(pipe) as lines:
            for line in lines:
                sign, number, started = line.split()
                (stopped.add if sign == "+" else stopped.discard)(Process(int(number), started))
        for process in stopped:
            if state_of(process) is not None:
                send(process, signal.SIGCONT)
        os._exit(0)


class Command:
    """The command; signals are forwarded to it, except Ctrl-C, which it receives from the terminal."""

    def __init__(self, words: list[str]) -> None:
        self._number = 0
        forwarded = [number for number in _FORWARDED if signal.getsignal(number) is not signal.SIG_IGN]
        signal.pthread_sigmask(signal.SIG_BLOCK, forwarded)
        for number in forwarded:
            signal.signal(number, self._forward)
        signal.signal(signal.SIGINT, self._forward)
        default = {*forwarded, signal.SIGINT}
        self._number = os.posix_spawnp(words[0], words, os.environ, setsigmask=[], setsigdef=default)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, forwarded)

    def reap(self) -> int | None:
        """Return the wait status of the command once it has ended."""
        status = reap(self._number)
        if status is not None:
            self._number = 0
        return status

    def _forward(self, number: int, _: object) -> None:
        if self._number and number != signal.SIGINT:
            os.kill(self._number, number)


def run(words: list[str], seed: int) -> int:
    """Run a command with stalls; return its exit status, or 128 plus the number of the signal that ended it."""
    adopt_orphans()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # if SIGCHLD were ignored, the system would reap the children
    guard = Guard()
    try:
        command = Command(words)
        injector = Injector(random.Random(seed), guard)  # noqa: S311 - the numbers are not used for secrets
        try:
            while (status := command.reap()) is None:
                time.sleep(min(injector.step(), 0.02))
        finally:
            injector.end()
    finally:
        guard.end()
    with contextlib.suppress(OSError):
        print(f"stall.py: {injector.stalls} stalls, {injector.stalled:.1f} s in total, seed {seed}", file=sys.stderr)
    return os.waitstatus_to_exitcode(status) if os.WIFEXITED(status) else 128 + os.WTERMSIG(status)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="seed of the random numbers (default 1)")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND [ARG ...]")
    arguments = parser.parse_args()
    words = arguments.command[1:] if arguments.command[:1] == ["--"] else arguments.command
    if not words:
        parser.error("COMMAND is missing")
    if shutil.which(words[0]) is None:
        parser.error(f"command not found: {words[0]}")
    return run(words, arguments.seed)


if __name__ == "__main__":
    sys.exit(main())
