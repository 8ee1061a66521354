"""How long a client has patience with a call: in all, and with what comes meanwhile that is no answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from orinkit.core.errors import CallTimeout, ProtocolError
from orinkit.core.i18n import tr

Clock: TypeAlias = Callable[[], float]
"""Gives seconds, from any beginning."""

PER_SECOND: Final = 1000
"""Packets that are no answer, such as S_EXECUTING, that may come each second."""
AT_ONCE: Final = 10_000
"""How many of them may come beyond that, as when the client's program stood still."""


def standing() -> float:
    """Return a time that stands still, for conversations without a clock."""
    return 0.0


class CallTimer:
    """Of one call.

    Args:
        function: the document's name of the function.
        seconds: that the call may take in all, ``None`` without such a limit.
        clock: tells the time.
    """

    __slots__ = ("_begun", "_bounded", "_clock", "_executing", "_function", "_level", "_seconds", "_seen")

    def __init__(self, function: str, seconds: float | None, clock: Clock) -> None:
        self._function = function
        self._seconds = seconds
        self._clock = clock
        self._begun = self._seen = clock()
        self._level = 0.0
        self._executing = False
        self._bounded = False

    def bound(self, seconds: float | None) -> float | None:
        """Return how long to wait, where the call could wait so many seconds; ``None`` if the wait in force goes on."""
        if seconds is None or self._seconds is None:
            return seconds
        left = max(0.0, self._begun + self._seconds - self._clock())
        self._bounded = left < seconds
        return min(left, seconds)

    def heard(self, count: int, *, executing: bool) -> None:
        """Note what has come that is no answer.

        Args:
            count: packets, or other signs.
            executing: whether one of them says that the controller is at work.

        Raises:
            ProtocolError: there are too many. It is fatal: they would go on.
        """
        now = self._clock()
        self._executing = self._executing or executing
        self._level = max(0.0, self._level - PER_SECOND * (now - self._seen)) + count
        self._seen = now
        if self._level > AT_ONCE:
            raise ProtocolError(
                tr(
                    "{function}: the other side sends without end, but no answer: more than {per_second:,} "
                    "packets per second. The connection was closed. Try: is that a controller, and is "
                    "nothing else sending to this port?",
                    function=self._function,
                    per_second=PER_SECOND,
                ),
                fatal=True,
            )

    def end(self, tries: int = 1) -> CallTimeout | None:
        """Return the error of a wait that has ended, if it was the limit of the call that has ended it.

        Args:
            tries: how often the request was sent.
        """
        if not self._bounded or self._seconds is None:
            return None
        return CallTimeout(self._function, self._seconds, tries, executing=self._executing)
