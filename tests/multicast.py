"""CAN buses by multicast that one process of the tests has for itself: other runs on the machine do not take part."""

from __future__ import annotations

import random
import socket

GROUP = "239.74.163.2"
_PORTS = range(10_000, 15_000)  # below those of tests/test_docs.py, and of Linux's outgoing connections
_held: list[socket.socket] = []


def free_port() -> int:
    """Return a UDP port that no other process gets here: the TCP port of the same number is held as long as this one runs."""
    for port in random.sample(_PORTS, len(_PORTS)):
        lock = socket.socket()
        try:
            lock.bind(("127.0.0.1", port))
        except OSError:
            lock.close()
        else:
            _held.append(lock)
            return port
    raise AssertionError("no port is free")


def bus(port: int | None = None) -> str:
    """Return the URL of a bus, by default on a port of its own."""
    return f"can://udp_multicast/{GROUP}?port={port or free_port()}"
