"""Waiting for what happens in another thread or process, and interrupting what would wait."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import FrameType

PATIENCE = 30.0
"""Seconds that anything may take on a machine that does much else."""


def until(condition: Callable[[], object], seconds: float = PATIENCE) -> None:
    """Wait for something that happens elsewhere; fails when it does not."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.002)


def interrupted_at(point: int, call: Callable[[], object], files: tuple[str, ...]) -> bool:
    """Raise KeyboardInterrupt where Python looks for signals for the n-th time; returns whether it came to that.

    That is where a function begins, and behind each of those in C.

    Args:
        point: from 1.
        call: is interrupted.
        files: ends of the names of those in which it counts.
    """
    passed = 0

    def look(frame: FrameType, event: str, _argument: object) -> None:
        nonlocal passed
        if event in ("call", "c_return") and frame.f_code.co_filename.endswith(files):
            passed += 1
            if passed == point:
                sys.setprofile(None)
                raise KeyboardInterrupt

    sys.setprofile(look)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)
    return False
