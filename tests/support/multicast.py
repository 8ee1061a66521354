"""CAN buses by multicast that one process of the tests has for itself: other runs on the machine do not take part."""

from __future__ import annotations

import random
import socket
from itertools import cycle

GROUP = "239.74.163.2"
_BLOCKS = range(10_000, 15_000, 50)  # below the ports of tests/test_docs.py, and of Linux's outgoing connections


def _hold() -> tuple[socket.socket, int]:
    """Return the first port of a block that no other process has: who holds the TCP port of this number has the block."""
    for port in random.sample(_BLOCKS, len(_BLOCKS)):
        lock = socket.socket()
        try:
            lock.bind(("127.0.0.1", port))
        except OSError:
            lock.close()
        else:
            return lock, port
    raise AssertionError("no ports are free")


_lock, _first = _hold()
_ports = cycle(range(_first, _first + _BLOCKS.step))


def free_port() -> int:
    """Return a UDP port that no other process gets here."""
    return next(_ports)


def bus(port: int | None = None) -> str:
    """Return the URL of a bus, by default on a port of its own."""
    return f"can://udp_multicast/{GROUP}?port={port or free_port()}"
