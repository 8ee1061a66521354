"""Ctrl-C, SIGTERM and SIGHUP, for commands that must bring a motion to standstill before they end."""

from __future__ import annotations

import signal
from time import monotonic, sleep
from types import FrameType
from typing import Any, Final, Self

_NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP")
_POLL: Final = 0.02  # s


def termination_signals() -> list[signal.Signals]:
    """Return the signals that end a program, except those that are ignored because of nohup."""
    known = [getattr(signal.Signals, name) for name in _NAMES if hasattr(signal, name)]
    return [each for each in known if each == signal.SIGINT or signal.getsignal(each) != signal.SIG_IGN]


class Interrupts:
    """Records the first signal that would end the program, for :meth:`check`; the second one interrupts immediately.

    Signals that are ignored because of nohup remain ignored.

    Attributes:
        resting: True while motors are being stopped, for a few seconds at most; signals do not interrupt the stop.
    """

    def __init__(self) -> None:
        self.resting = False
        self._noted = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in termination_signals():
            self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has arrived."""
        if self._noted:
            raise KeyboardInterrupt

    def wait(self, until: float) -> None:
        """Wait until a time of the monotonic clock; raise KeyboardInterrupt as soon as a signal has arrived."""
        self.check()
        while (left := until - monotonic()) > 0:
            sleep(min(left, _POLL))
            self.check()

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        if self._noted and not self.resting:
            raise KeyboardInterrupt
        self._noted = True
