"""The packets of all connections, in memory: :class:`PacketLog`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from time import time_ns
from typing import Final, Literal, TypeAlias

from orinkit.bcap import packet as bcap

Direction: TypeAlias = Literal[">", "<"]

CAPACITY: Final = 100_000
"""Maximum number of packets that are kept; the oldest ones are discarded."""
MAX_BYTES: Final = 128 * 1024 * 1024
"""Maximum number of bytes of all packets that are kept."""
_AWAITED: Final = 16  # requests per connection to which a reply is assigned by its serial


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
        request: If this packet is a reply, its request: the latest request with the same serial, otherwise the last
            packet that was sent before it. ``None`` if there is none.
        request_number: Number of that request; 0 if there is none.
    """

    number: int
    time_ns: int
    connection: str
    scheme: str
    direction: Direction
    data: bytes
    request: bytes | None = None
    request_number: int = 0


# The fields of a LoggedPacket. The garbage collector examines 100,000 objects again and again, but not tuples of values.
_Row: TypeAlias = tuple[int, int, str, str, Direction, bytes, bytes | None, int]
_NUMBER: Final = 0
_DATA: Final = 5


class PacketLog:
    """The latest packets of all connections. All methods must be called in the thread of the event loop.

    Attributes:
        total: Number of packets since the start.
        cleared: Number of times that the log was cleared.
        start_ns: Time of the first packet since the log was cleared, in ns since 1970; 0 if there is none.
        recording: False while new packets are not added.
    """

    def __init__(self, capacity: int = CAPACITY, max_bytes: int = MAX_BYTES) -> None:
        self._packets: deque[_Row] = deque()
        self._capacity, self._max_bytes = capacity, max_bytes
        self._bytes = 0
        self._last: dict[tuple[str, Direction], LoggedPacket] = {}
        self._awaited: dict[str, dict[int, LoggedPacket]] = {}
        self._replies: dict[int, int] = {}
        self.total = 0
        self.cleared = 0
        self.start_ns = 0
        self.recording = True

    def __len__(self) -> int:
        return len(self._packets)

    def __iter__(self) -> Iterator[LoggedPacket]:
        return (LoggedPacket(*row) for row in self._packets)

    @property
    def first_number(self) -> int:
        """The number of the oldest packet that is kept; ``total + 1`` if there is none."""
        return self._packets[0][_NUMBER] if self._packets else self.total + 1

    @property
    def connections(self) -> list[str]:
        """The names of all connections that have sent or received a packet since the log was cleared."""
        return list(dict.fromkeys(name for name, _ in self._last))

    def tracer(self, connection: str, scheme: str) -> Callable[[str, bytes], None]:
        """Return a callback for the argument ``trace`` of ``connect`` that adds the packets of a connection."""

        def trace(direction: str, data: bytes) -> None:
            self.add(connection, scheme, ">" if direction == ">" else "<", data)

        return trace

    def add(
        self, connection: str, scheme: str, direction: Direction, data: bytes, time: int | None = None
    ) -> LoggedPacket | None:
        """Add a packet; return it, or ``None`` while recording is off.

        Args:
            connection: Name of the connection.
            scheme: Scheme of its transport.
            direction: ``">"`` sent, ``"<"`` received.
            data: The bytes of the packet.
            time: Time of day in ns since 1970; by default now.
        """
        if not self.recording:
            return None
        self.total += 1
        sent = self._request_of(connection, data) if direction == "<" else None
        row: _Row = (
            self.total, time_ns() if time is None else time, connection, scheme, direction, bytes(data),
            sent.data if sent else None, sent.number if sent else 0,
        )  # fmt: skip
        packet = LoggedPacket(*row)
        self.start_ns = self.start_ns or packet.time_ns
        self._last[connection, direction] = packet
        if sent is not None:
            self._replies[sent.number] = packet.number
        elif direction == ">":
            self._await(packet)
        self._packets.append(row)
        self._bytes += len(packet.data)
        while len(self._packets) > self._capacity or (self._bytes > self._max_bytes and len(self._packets) > 1):
            oldest = self._packets.popleft()
            self._bytes -= len(oldest[_DATA])
            self._replies.pop(oldest[_NUMBER], None)
        return packet

    def get(self, number: int) -> LoggedPacket | None:
        """Return the packet with a number; ``None`` if it has been discarded, or does not exist yet."""
        index = number - self.first_number
        return LoggedPacket(*self._packets[index]) if 0 <= index < len(self._packets) else None

    def since(self, number: int, most: int | None = None) -> list[LoggedPacket]:
        """Return the packets after a number, oldest first; at most ``most`` of them, the newest ones."""
        count = min(self.total - number, len(self._packets))
        if most is not None:
            count = min(count, most)
        newest = [LoggedPacket(*row) for row in islice(reversed(self._packets), max(count, 0))]
        newest.reverse()
        return newest

    def last(self, connection: str, direction: Direction) -> LoggedPacket | None:
        """Return the last packet that a connection sent or received, even if it has been discarded from the log."""
        return self._last.get((connection, direction))

    def reply_number(self, number: int) -> int:
        """Return the number of the last reply to a request, 0 if there is none; S_EXECUTING counts as a reply."""
        return self._replies.get(number, 0)

    def clear(self) -> None:
        """Discard all packets; the numbers continue."""
        self._packets.clear()
        self._last.clear()
        self._awaited.clear()
        self._replies.clear()
        self._bytes = self.start_ns = 0
        self.cleared += 1

    def _await(self, packet: LoggedPacket) -> None:
        serial = _serial(packet.data)
        if serial is not None:
            awaited = self._awaited.setdefault(packet.connection, {})
            awaited.pop(serial, None)
            awaited[serial] = packet
            if len(awaited) > _AWAITED:
                del awaited[next(iter(awaited))]

    def _request_of(self, connection: str, data: bytes) -> LoggedPacket | None:
        serial = _serial(data)
        found = self._awaited.get(connection, {}).get(serial) if serial is not None else None
        return found or self._last.get((connection, ">"))


def _serial(data: bytes) -> int | None:
    """Return the serial of a b-CAP packet; ``None`` for other data, for example an e-CAP body."""
    if len(data) < bcap.OVERHEAD or data[0] != bcap.SOH:
        return None
    return int.from_bytes(data[5:7], "little")
