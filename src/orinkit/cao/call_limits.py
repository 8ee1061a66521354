"""Limits of a call: its total duration, and the rate of packets that are not its reply."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from orinkit.core.errors import CallTimeout, ProtocolError
from orinkit.core.i18n import tr

Clock: TypeAlias = Callable[[], float]
"""Function that returns the time in seconds, from an arbitrary origin."""

PER_SECOND: Final = 1000
"""Limit on the packets per second that are not the reply to the call, for example S_EXECUTING packets."""
AT_ONCE: Final = 10_000
"""Limit on the packets that arrive in one burst and are not the reply to the call.

Bursts occur, for example, after the client's program was suspended.
"""


def no_clock() -> float:
    """Return a constant time, for conversations without a clock."""
    return 0.0


class CallTimer:
    """Limits of one call.

    Args:
        function: name of the function in the documents.
        seconds: limit on the duration of the call, s; ``None`` for no limit.
        clock: function that returns the time, s.
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
        """Return a waiting time, s, reduced to the time that remains until the limit of the call.

        Args:
            seconds: the waiting time, s; ``None`` continues the current wait and is returned unchanged.
        """
        if seconds is None or self._seconds is None:
            return seconds
        left = max(0.0, self._begun + self._seconds - self._clock())
        self._bounded = left < seconds
        return min(left, seconds)

    def count_other(self, count: int, *, executing: bool) -> None:
        """Count received packets that are not the reply.

        Args:
            count: number of received packets, datagrams without a packet, or signs that the call is executing.
            executing: whether a received packet or sign reports that the call is executing.

        Raises:
            ProtocolError: If there are too many such packets. The connection must then be closed, because the flood
                would continue.
        """
        now = self._clock()
        self._executing = self._executing or executing
        self._level = max(0.0, self._level - PER_SECOND * (now - self._seen)) + count
        self._seen = now
        if self._level > AT_ONCE:
            raise ProtocolError(
                tr(
                    "{function}: the peer sends more than {per_second:,} packets per second, but not the reply. "
                    "The connection was closed. Try: check that the peer is a controller and that nothing else "
                    "sends to this port",
                    function=self._function,
                    per_second=PER_SECOND,
                ),
                fatal=True,
            )

    def timeout_error(self, tries: int = 1) -> CallTimeout | None:
        """Return the exception for a call whose limit has ended the last wait; ``None`` if the limit has not ended it.

        Args:
            tries: number of attempts made.
        """
        if not self._bounded or self._seconds is None:
            return None
        return CallTimeout(self._function, self._seconds, tries, executing=self._executing)
