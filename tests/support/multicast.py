"""CAN buses over UDP multicast, private to one test process: other test runs on the machine do not interfere."""

from __future__ import annotations

import atexit
import random
import socket
from itertools import cycle

GROUP = "239.74.163.2"
_BLOCKS = range(10_000, 15_000, 50)  # below the ports of tests/test_docs.py, and of Linux's outgoing connections


def _hold() -> tuple[socket.socket, int]:
    """Reserve a block of ports by binding the TCP port of the same number; return the socket and the first port."""
    for port in random.sample(_BLOCKS, len(_BLOCKS)):
        lock = socket.socket()
        try:
            lock.bind(("127.0.0.1", port))
        except OSError:
            lock.close()
        else:
            return lock, port
    raise AssertionError("no free ports")


_lock, _first = _hold()
atexit.register(_lock.close)  # otherwise, the end of the process causes a ResourceWarning
_ports = cycle(range(_first, _first + _BLOCKS.step))


def free_port() -> int:
    """Return a UDP port of the block that this process has reserved."""
    return next(_ports)


def bus(port: int | None = None) -> str:
    """Return the URL of a bus, by default on a new port."""
    return f"can://udp_multicast/{GROUP}?port={port or free_port()}"
