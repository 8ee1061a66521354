"""Filtering and searching the packets without blocking the event loop: :class:`PacketFilter`, :class:`PacketView`."""

from __future__ import annotations

import asyncio
from bisect import bisect_left
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_facts import LONGEST_DECODED, facts_of
from orinkit.tester.state.packet_log import LoggedPacket, PacketLog

LONGEST_TEXT: Final = 200
"""Maximum number of characters to search for."""
LONGEST_BYTES: Final = 256
"""Maximum number of bytes to search for."""
LONGEST_HEX: Final = 8 * LONGEST_BYTES
"""Maximum number of characters of bytes in hex, with separators."""
SLICE: Final = 0.004
"""Time in s for which a search occupies the event loop at a time."""
PAUSE: Final = 0.001
"""Time in s between two slices."""
_STEP: Final = 16  # packets between two looks at the clock
_SEARCHED: Final = 256 * 1024  # bytes searched at a time; this takes about 1 ms
_SEPARATORS: Final = str.maketrans("", "", " \t\r\n,;:-")


def read_bytes(text: str) -> bytes:
    """Return the bytes that a user has entered in hex, with or without separators and ``0x``.

    Raises:
        InvalidValue: If the text is not hex, or longer than :data:`LONGEST_BYTES`.
    """
    if len(text) > LONGEST_HEX:
        raise InvalidValue(tr("at most {most} bytes can be searched for", most=LONGEST_BYTES))
    digits = text.replace("0x", "").replace("0X", "").translate(_SEPARATORS)
    try:
        found = bytes.fromhex(digits)
    except ValueError:
        odd = len(digits) % 2 and all(each in "0123456789abcdefABCDEF" for each in digits)
        reason = tr("the number of hex digits is odd") if odd else tr("these are not hex digits")
        raise InvalidValue(tr("{reason}. Try: 01 10 00", reason=reason)) from None
    if len(found) > LONGEST_BYTES:
        raise InvalidValue(tr("at most {most} bytes can be searched for", most=LONGEST_BYTES))
    return found


def check_text(text: str) -> str:
    """Return a text to search for.

    Raises:
        InvalidValue: If the text is longer than :data:`LONGEST_TEXT`.
    """
    if len(text) > LONGEST_TEXT:
        raise InvalidValue(tr("at most {most} characters can be searched for", most=LONGEST_TEXT))
    return text.strip()


@dataclass(frozen=True, slots=True)
class PacketFilter:
    """Which packets a list shows. All conditions must hold; a condition with its default always holds.

    Attributes:
        connection: Name of the connection.
        direction: ``">"`` sent, ``"<"`` received.
        function: Id of the function; its replies match, too.
        errors: True for replies with an error code and for malformed packets only.
        text: Text in the summary, without regard to case. In packets that are too large for a summary, text in the data.
        data: Bytes in the packet.
    """

    connection: str = ""
    direction: str = ""
    function: int = 0
    errors: bool = False
    text: str = ""
    data: bytes = b""

    @property
    def accepts_all(self) -> bool:
        """True if every packet matches."""
        return self == PacketFilter()

    def matches(self, packet: LoggedPacket, summary: Callable[[LoggedPacket], str]) -> bool:
        """Return True if a packet matches; ``summary`` returns its summary."""
        examination = self.examine(packet, summary)
        while True:
            try:
                next(examination)
            except StopIteration as done:
                return bool(done.value)

    def examine(self, packet: LoggedPacket, summary: Callable[[LoggedPacket], str]) -> Generator[None, None, bool]:
        """Return a generator that returns whether a packet matches; it pauses often in a large packet."""
        if (self.connection and packet.connection != self.connection) or (
            self.direction and packet.direction != self.direction
        ):
            return False
        if self.function or self.errors:
            facts = facts_of(packet)
            if (self.function and facts.function != self.function) or (self.errors and not facts.is_error):
                return False
        if self.data and not (yield from _contains(packet.data, self.data)):
            return False
        if not self.text or self.text.casefold() in summary(packet).casefold():
            return True
        if len(packet.data) <= LONGEST_DECODED:
            return False
        encoded = (self.text.encode(each, "surrogatepass") for each in ("utf-16-le", "utf-8"))
        for part in encoded:
            if (yield from _contains(packet.data, part)):
                return True
        return False


def _contains(data: bytes, part: bytes) -> Generator[None, None, bool]:
    """Return a generator that returns whether bytes contain other bytes; it pauses after each :data:`_SEARCHED`."""
    for at in range(0, max(len(data), 1), _SEARCHED):
        if at:
            yield
        if data.find(part, at, at + _SEARCHED + len(part) - 1) >= 0:
            return True
    return False


class PacketView:
    """The packets of a log that match a filter, found incrementally.

    A position counts the matches from 0, including those that the log has discarded since. So the position of a packet
    never changes. The positions ``first`` to ``end - 1`` exist.

    Args:
        log: The log.
        condition: The filter.
        summary: Function that returns the summary of a packet.
    """

    def __init__(self, log: PacketLog, condition: PacketFilter, summary: Callable[[LoggedPacket], str]) -> None:
        self.condition = condition
        self._log = log
        self._summary = summary
        self._all = condition.accepts_all
        self._numbers: list[int] = []
        self._dropped = 0  # positions before _numbers[0]
        self._next = log.first_number  # the next packet to examine
        self._large: tuple[int, Generator[None, None, bool]] | None = None  # a large packet being examined

    @property
    def behind(self) -> int:
        """Number of packets that have not been examined yet."""
        return 0 if self._all else self._log.total + 1 - max(self._next, self._log.first_number)

    @property
    def first(self) -> int:
        """Position of the oldest match that the log still has."""
        oldest = self._log.first_number
        if self._all:
            return oldest - 1
        return self._dropped + bisect_left(self._numbers, oldest)

    @property
    def end(self) -> int:
        """Position after the last match."""
        return self._log.total if self._all else self._dropped + len(self._numbers)

    def __len__(self) -> int:
        return self.end - self.first

    def position(self, number: int) -> int:
        """Return the position of a packet; -1 if it does not match, or the log has discarded it."""
        if self._log.get(number) is None:
            return -1
        if self._all:
            return number - 1
        index = bisect_left(self._numbers, number)
        return self._dropped + index if self._numbers[index : index + 1] == [number] else -1

    def number(self, position: int) -> int:
        """Return the number of the packet at a position; 0 if there is none."""
        if not self.first <= position < self.end:
            return 0
        return position + 1 if self._all else self._numbers[position - self._dropped]

    def numbers(self) -> Sequence[int]:
        """Return the numbers of all matches found so far; later changes of the view do not affect the result."""
        return range(self.first + 1, self.end + 1) if self._all else self._numbers[self.first - self._dropped :]

    def window(self, position: int, count: int) -> Sequence[LoggedPacket]:
        """Return up to ``count`` packets from a position, which must not be before :attr:`first`."""
        stop = min(position + count, self.end)
        found = (self._log.get(self.number(each)) for each in range(max(position, self.first), stop))
        return [each for each in found if each is not None]

    def advance(self, seconds: float = SLICE) -> bool:
        """Examine further packets for a limited time; return True if some are left."""
        self._prune()
        if self._all:
            return False
        stop = perf_counter() + seconds
        self._next, total = max(self._next, self._log.first_number), self._log.total
        while self._next <= total:
            packet = self._log.get(self._next)
            assert packet is not None  # its number is between the first and the last
            if len(packet.data) > LONGEST_DECODED:
                self._advance_in_large(packet)
                if perf_counter() > stop:
                    break
            else:
                if self.condition.matches(packet, self._summary):
                    self._numbers.append(self._next)
                self._next += 1
                if self._next % _STEP == 0 and perf_counter() > stop:
                    break
        return self._next <= total

    def _advance_in_large(self, packet: LoggedPacket) -> None:
        """Continue to examine a large packet."""
        if self._large is None or self._large[0] != packet.number:
            self._large = packet.number, self.condition.examine(packet, self._summary)
        try:
            next(self._large[1])
        except StopIteration as done:
            if done.value:
                self._numbers.append(packet.number)
            self._large = None
            self._next += 1

    def _prune(self) -> None:
        """Forget the numbers of discarded packets, if they are many."""
        gone = bisect_left(self._numbers, self._log.first_number)
        if gone > len(self._numbers) // 2:
            del self._numbers[:gone]
            self._dropped += gone

    async def catch_up(self, is_current: Callable[[], bool] = lambda: True) -> None:
        """Examine all packets in slices; return early if ``is_current`` returns False."""
        while is_current() and self.advance():  # noqa: ASYNC110 - divides work
            await asyncio.sleep(PAUSE)


class LastPairs:
    """The last packet sent and the last one received of each connection, as a view (Overwrite in DENSO's tool)."""

    behind = 0
    first = 0

    def __init__(self, log: PacketLog, condition: PacketFilter, summary: Callable[[LoggedPacket], str]) -> None:
        self.condition = condition
        self._log = log
        self._summary = summary

    def _packets(self) -> list[LoggedPacket]:
        found = (
            self._log.last(name, direction)
            for name in self._log.connections
            for direction in (">", "<")
        )  # fmt: skip
        matches = (each for each in found if each is not None and self.condition.matches(each, self._summary))
        return sorted(matches, key=lambda each: each.number)

    @property
    def end(self) -> int:
        """Number of packets."""
        return len(self._packets())

    def __len__(self) -> int:
        return self.end

    def position(self, number: int) -> int:
        """Return the position of a packet; -1 if it is not one of the last."""
        return next((index for index, each in enumerate(self._packets()) if each.number == number), -1)

    def number(self, position: int) -> int:
        """Return the number of the packet at a position; 0 if there is none."""
        packets = self._packets()
        return packets[position].number if 0 <= position < len(packets) else 0

    def numbers(self) -> Sequence[int]:
        """Return the numbers of the packets."""
        return [each.number for each in self._packets()]

    def window(self, position: int, count: int) -> Sequence[LoggedPacket]:
        """Return up to ``count`` packets from a position."""
        return self._packets()[position : position + count]

    def advance(self, seconds: float = SLICE) -> bool:  # noqa: ARG002 - the packets are few
        """Return False: nothing has to be examined in advance."""
        return False

    async def catch_up(self, is_current: Callable[[], bool] = lambda: True) -> None:
        """Do nothing: nothing has to be examined in advance."""
