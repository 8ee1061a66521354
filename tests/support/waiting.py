"""Waiting for events in other threads or processes, tests of short time-outs, and interrupting calls."""

from __future__ import annotations

import functools
import inspect
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

PATIENCE = 30.0
"""Time-out in seconds for any operation on a busy machine."""


class TooSlow(Exception):
    """A time-out under test has expired too early: the test has not reached the step that it checks."""


def with_longer_times(*times: float) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Pass a short time to a test as argument ``short``, and repeat it with the next time if it raises :class:`TooSlow`.

    ::

        @with_longer_times(0.1, 1.0, 10.0)
        def test_a_call_times_out(short: float) -> None:
            ...
            if not came:  # the machine stalled before the request had been sent
                raise TooSlow

    Args:
        times: The times, s; with the last one, :class:`TooSlow` is a failure.
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
        vars(run)["__signature__"] = signature.replace(parameters=fixtures)  # the fixtures requested from pytest
        return run

    return decorate


def until(condition: Callable[[], object], seconds: float = PATIENCE) -> None:
    """Wait until a condition is true; fail after a time-out."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.002)


def interrupted_at(point: int, call: Callable[[], object], files: tuple[str, ...]) -> bool:
    """Raise KeyboardInterrupt at the n-th point at which Python checks for signals; return True if it was raised.

    Python checks at the start of a function, and after each call of a C function.

    Args:
        point: the number of the point, from 1.
        call: the function to interrupt.
        files: suffixes of the file names in which points are counted.
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
