"""Noticing within seconds that the other side of a TCP connection is gone without a word: a cable pulled, a machine off.

The system's own limits are hours. Two of its timers are set, as neither is enough alone: probes of an idle connection
(keep-alive) only run while nothing waits to be acknowledged, and the limit on what waits only counts then.
"""

from __future__ import annotations

import math
import socket
import sys
from typing import Final, Protocol

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

DEAD_AFTER: Final = 10.0
"""Seconds after which a connection is given up whose other side does not answer."""

_LEAST: Final = 2.0  # s: systems count the seconds until a probe, and those until the next one
_MOST: Final = 7200.0  # s: that of the systems themselves
_TCP: Final = socket.IPPROTO_TCP
_IDLE: Final = ("TCP_KEEPIDLE", "TCP_KEEPALIVE")  # the second in macOS
_CONNECTION_DROP_TIME: Final = 0x80  # macOS: TCP_RXT_CONNDROPTIME, s
_MAXIMUM_RETRANSMISSION: Final = 5  # Windows: TCP_MAXRT, s


class Settable(Protocol):
    """A socket, or what an event loop shows of it."""

    def setsockopt(self, level: int, option: int, value: int, /) -> None:
        """Set an option."""


def check_dead_after(seconds: float) -> float:
    """Return the seconds after which a silent connection is given up.

    Raises:
        InvalidValue: it is no number from 2 to 7,200.
    """
    given: object = seconds
    if isinstance(given, bool) or not isinstance(given, int | float) or not _LEAST <= given <= _MOST:
        raise InvalidValue(
            tr(
                "dead_after must be {least:g} to {most:g} seconds, not {given!r:.40}",
                least=_LEAST,
                most=_MOST,
                given=given,
            )
        )
    return float(given)


def prepare(connection: Settable, dead_after: float) -> None:
    """Set the options of a TCP connection: packets are sent at once, and a dead peer is noticed.

    An option that the system does not have, or does not take, is left as it is.

    Args:
        connection: to be set.
        dead_after: seconds without an answer after which the system gives it up.
    """
    _set(connection, _TCP, "TCP_NODELAY", 1)
    _set(connection, socket.SOL_SOCKET, "SO_KEEPALIVE", 1)
    idle = max(1, int(dead_after * 0.4))
    interval = max(1, int(dead_after * 0.2))
    for name in _IDLE:
        if _set(connection, _TCP, name, idle):
            break
    _set(connection, _TCP, "TCP_KEEPINTVL", interval)
    _set(connection, _TCP, "TCP_KEEPCNT", math.ceil((dead_after - idle) / interval))
    if _set(connection, _TCP, "TCP_USER_TIMEOUT", round(dead_after * 1000)):
        return
    if sys.platform == "darwin":
        _set_number(connection, _TCP, _CONNECTION_DROP_TIME, math.ceil(dead_after))
    elif sys.platform == "win32":
        _set_number(connection, _TCP, _MAXIMUM_RETRANSMISSION, math.ceil(dead_after))


def _set(connection: Settable, level: int, name: str, value: int) -> bool:
    option = getattr(socket, name, None)
    return option is not None and _set_number(connection, level, option, value)


def _set_number(connection: Settable, level: int, option: int, value: int) -> bool:
    try:
        connection.setsockopt(level, option, value)
    except OSError:  # the other side has gone already, or the system does not know the option
        return False
    return True
