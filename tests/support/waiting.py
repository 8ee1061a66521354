"""Waiting for what happens in another thread or process, times that are too short, and interrupting what would wait."""

from __future__ import annotations

import functools
import inspect
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

PATIENCE = 30.0
"""Seconds that anything may take on a machine that does much else."""


class TooSlow(Exception):
    """A time-out that is meant to pass has passed before the test had come to what it is about: nothing was tested."""


def with_longer_times(*times: float) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a test a short time, its argument ``short``, and run it again with the next one when it raises :class:`TooSlow`.

    ::

        @with_longer_times(0.1, 1.0, 10.0)
        def test_a_call_times_out(short: float) -> None:
            ...
            if not came:  # the machine stood still before the request had been sent
                raise TooSlow

    Args:
        times: seconds; with the last one :class:`TooSlow` is a failure.
    """

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run(*arguments: Any, **named: Any) -> None:
            for short in times[:-1]:
                try:
                    return test(*arguments, **named, short=short)
                except TooSlow:
                    continue
            return test(*arguments, **named, short=times[-1])

        signature = inspect.signature(test)
        fixtures = [each for name, each in signature.parameters.items() if name != "short"]
        vars(run)["__signature__"] = signature.replace(parameters=fixtures)  # what pytest is to give it
        return run

    return decorate


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
