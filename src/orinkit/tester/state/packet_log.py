"""The packets of all connections, in memory: :class:`PacketLog`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from time import time_ns
from typing import Final, Literal, TypeAlias

Direction: TypeAlias = Literal[">", "<"]

CAPACITY: Final = 100_000
"""Maximum number of packets that are kept; the oldest ones are discarded."""
MAX_BYTES: Final = 128 * 1024 * 1024
"""Maximum number of bytes of all packets that are kept."""


@dataclass(frozen=True, slots=True)
class LoggedPacket:
    """A packet that was sent or received.

    Attributes:
        number: Number of the packet, from 1; numbers are never reused.
        time_ns: Time of day in ns since 1970.
        connection: Name of the connection.
        scheme: Scheme of its transport: tcp, udp, serial, http, can.
        direction: ``">"`` sent, ``"<"`` received.
        data: The bytes of the packet, or of the e-CAP body.
        request: If this packet is a reply, the last packet that was sent before it; otherwise ``None``.
    """

    number: int
    time_ns: int
    connection: str
    scheme: str
    direction: Direction
    data: bytes
    request: bytes | None = None


class PacketLog:
    """The latest packets of all connections.

    Attributes:
        total: Number of packets since the start.
        recording: False while new packets are not added.
    """

    def __init__(self, capacity: int = CAPACITY, max_bytes: int = MAX_BYTES) -> None:
        self._packets: deque[LoggedPacket] = deque()
        self._capacity, self._max_bytes = capacity, max_bytes
        self._bytes = 0
        self._last: dict[tuple[str, Direction], LoggedPacket] = {}
        self.total = 0
        self.recording = True

    def __len__(self) -> int:
        return len(self._packets)

    def __iter__(self) -> Iterator[LoggedPacket]:
        return iter(self._packets)

    @property
    def first_number(self) -> int:
        """The number of the oldest packet that is kept; ``total + 1`` if there is none."""
        return self._packets[0].number if self._packets else self.total + 1

    def tracer(self, connection: str, scheme: str) -> Callable[[str, bytes], None]:
        """Return a callback for the argument ``trace`` of ``connect`` that adds the packets of a connection."""

        def trace(direction: str, data: bytes) -> None:
            self.add(connection, scheme, ">" if direction == ">" else "<", data)

        return trace

    def add(self, connection: str, scheme: str, direction: Direction, data: bytes) -> None:
        """Add a packet."""
        if not self.recording:
            return
        self.total += 1
        sent = self._last.get((connection, ">")) if direction == "<" else None
        packet = LoggedPacket(
            self.total, time_ns(), connection, scheme, direction, bytes(data), sent.data if sent else None
        )
        self._last[connection, direction] = packet
        self._packets.append(packet)
        self._bytes += len(packet.data)
        while len(self._packets) > self._capacity or (self._bytes > self._max_bytes and len(self._packets) > 1):
            self._bytes -= len(self._packets.popleft().data)

    def get(self, number: int) -> LoggedPacket | None:
        """Return the packet with a number; ``None`` if it has been discarded, or does not exist yet."""
        index = number - self.first_number
        return self._packets[index] if 0 <= index < len(self._packets) else None

    def since(self, number: int, most: int | None = None) -> list[LoggedPacket]:
        """Return the packets after a number, oldest first; at most ``most`` of them, the newest ones."""
        count = min(self.total - number, len(self._packets))
        if most is not None:
            count = min(count, most)
        newest = list(islice(reversed(self._packets), max(count, 0)))
        newest.reverse()
        return newest

    def last(self, connection: str, direction: Direction) -> LoggedPacket | None:
        """Return the last packet that a connection sent or received, even if it has been discarded from the log."""
        return self._last.get((connection, direction))

    def clear(self) -> None:
        """Discard all packets; the numbers continue."""
        self._packets.clear()
        self._last.clear()
        self._bytes = 0
