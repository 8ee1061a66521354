"""Ctrl-C, SIGTERM and the end of the terminal, for commands that have to bring something to rest before they end."""

from __future__ import annotations

import signal
from time import monotonic, sleep
from types import FrameType
from typing import Any, Final, Self

_NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP")
_LOOK: Final = 0.02  # s


def ending() -> list[signal.Signals]:
    """Return the signals that end a program; what nohup has switched off stays so."""
    known = [getattr(signal.Signals, name) for name in _NAMES if hasattr(signal, name)]
    return [each for each in known if each == signal.SIGINT or signal.getsignal(each) != signal.SIG_IGN]


class Interrupts:
    """Signals that end a program are noted instead of breaking off a call; the second one breaks it off.

    What nohup has switched off stays so.

    Attributes:
        resting: something is being brought to rest: nothing breaks that off, it takes a few seconds at most.
    """

    def __init__(self) -> None:
        self.resting = False
        self._noted = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in ending():
            self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was one."""
        if self._noted:
            raise KeyboardInterrupt

    def wait(self, until: float) -> None:
        """Wait until a time of the clock; raises KeyboardInterrupt as soon as there was a signal."""
        self.check()
        while (left := until - monotonic()) > 0:
            sleep(min(left, _LOOK))
            self.check()

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        if self._noted and not self.resting:
            raise KeyboardInterrupt
        self._noted = True
