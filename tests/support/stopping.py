"""Stopping another process with SIGSTOP, and keeping it stopped."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.waiting import until

_PAUSE = 0.001  # s between two checks


def state_of(pid: int) -> str:
    """Return the state of a process as reported by the system: T is stopped; Z has ended or no longer exists."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


@contextmanager
def stopped(pid: int) -> Iterator[None]:
    """Stop a process for the duration of a block.

    It is stopped repeatedly, because ``tools/stall.py`` may continue it.
    """
    ending = threading.Event()

    def hold() -> None:
        while state_of(pid) != "Z":
            if state_of(pid) != "T":
                _send(pid, signal.SIGSTOP)
            if ending.wait(_PAUSE):
                return

    _send(pid, signal.SIGSTOP)
    thread = threading.Thread(target=hold, name="stopping")
    thread.start()
    try:
        until(lambda: state_of(pid) in "TZ")
        yield
    finally:
        ending.set()
        thread.join()
        _send(pid, signal.SIGCONT)


def _send(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass
