"""TCP options that detect within seconds that the peer is unreachable: a cable unplugged, a machine switched off.

With the default settings of operating systems, the detection takes hours. Two timers are set, because one alone is not
sufficient: keep-alive probes are sent only while all data is acknowledged, and the user time-out applies only while
data is unacknowledged.
"""

from __future__ import annotations

import math
import socket
import sys
from typing import Final, Protocol

from orinkit.core.validation import check_range

DEAD_AFTER: Final = 10.0
"""Default time in s after which a connection is considered lost if the peer does not respond."""

_LEAST: Final = 2.0  # s: operating systems have whole seconds for the time until the first probe and between probes
_MOST: Final = 7200.0  # s: the default setting of operating systems
_TCP: Final = socket.IPPROTO_TCP
_IDLE: Final = ("TCP_KEEPIDLE", "TCP_KEEPALIVE")  # two names of one option; the second one is for macOS
_CONNECTION_DROP_TIME: Final = 0x80  # macOS: TCP_RXT_CONNDROPTIME, s
_MAXIMUM_RETRANSMISSION: Final = 5  # Windows: TCP_MAXRT, s


class Settable(Protocol):
    """A socket, or the object by which an event loop gives access to a socket."""

    def setsockopt(self, level: int, option: int, value: int, /) -> None:
        """Set an option."""


def check_dead_after(seconds: float) -> float:
    """Check the time after which a connection is considered lost if the peer does not respond; return it as a float.

    Raises:
        InvalidValue: If the time is not a number from 2 to 7,200 s.
    """
    return check_range("dead_after", seconds, _LEAST, _MOST, seconds=True)


def prepare(connection: Settable, dead_after: float) -> None:
    """Set the options of a TCP connection: send packets immediately, and detect an unreachable peer.

    Options that the system does not have, or rejects, are skipped.

    Args:
        connection: The socket.
        dead_after: Time in s after which the system closes the connection if the peer does not respond.
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
    except OSError:  # the peer has already closed, or the system does not have the option
        return False
    return True
