"""Filtering and searching the packets without blocking the event loop: :class:`PacketFilter`, :class:`PacketView`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.entry_view import PAUSE, SLICE, EntryView
from orinkit.tester.state.packet_facts import LONGEST_DECODED, facts_of
from orinkit.tester.state.packet_log import LoggedPacket, PacketLog

LONGEST_TEXT: Final = 200
"""Maximum number of characters to search for."""
LONGEST_BYTES: Final = 256
"""Maximum number of bytes to search for."""
LONGEST_HEX: Final = 8 * LONGEST_BYTES
"""Maximum number of characters of bytes in hex, with separators."""
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


class PacketView(EntryView[LoggedPacket]):
    """The packets of a log that match a filter, found incrementally.

    Args:
        log: The log.
        condition: The filter.
        summary: Function that returns the summary of a packet.
    """

    def __init__(self, log: PacketLog, condition: PacketFilter, summary: Callable[[LoggedPacket], str]) -> None:
        super().__init__(log, accepts_all=condition.accepts_all)
        self.condition = condition
        self._summary = summary
        self._large: tuple[int, Generator[None, None, bool]] | None = None  # a large packet being examined

    def _examine(self, entry: LoggedPacket) -> bool | None:
        if len(entry.data) <= LONGEST_DECODED:
            return self.condition.matches(entry, self._summary)
        if self._large is None or self._large[0] != entry.number:
            self._large = entry.number, self.condition.examine(entry, self._summary)
        try:
            next(self._large[1])
        except StopIteration as done:
            self._large = None
            return bool(done.value)
        return None

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

    def advance(self, seconds: float = SLICE) -> bool:
        """Return False: nothing has to be examined in advance."""
        return False

    async def catch_up(self, is_current: Callable[[], bool] = lambda: True) -> None:
        """Do nothing: nothing has to be examined in advance."""
