"""The text with the packets to send: :func:`check_text` finds what is invalid, and where (RC8 5.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from orinkit.bcap.dissect import Kind
from orinkit.bcap.profiles import BcapProfile
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.raw.packets import Problem, TypedPacket, TypedPackets, parse_packets
from orinkit.tester.state.packet_facts import summary
from orinkit.tester.state.packet_log import LoggedPacket

LONGEST_TEXT: Final = 300_000
"""Largest number of characters; longer texts are sent with ``orinkit raw``."""
SHOWN_PACKETS: Final = 30
"""Number of packets that are listed."""
SHOWN_PROBLEMS: Final = 10
"""Number of problems that are listed."""


class Place(NamedTuple):
    """A part of the text.

    Attributes:
        line: Line, from 1.
        column: Column, from 1.
        start: Position of the first character in the browser, which counts in UTF-16.
        end: Position after the last one.
    """

    line: int
    column: int
    start: int
    end: int


class FoundProblem(NamedTuple):
    """A problem: the number of the packet, from 1, the place, and a description."""

    number: int
    place: Place
    text: str
    prevents_sending: bool


class FoundPacket(NamedTuple):
    """A packet: its number, from 1, the place, the packet for display, and the packet in one line."""

    number: int
    place: Place
    logged: LoggedPacket
    summary: str


@dataclass(frozen=True, slots=True)
class CheckedText:
    """A text and what it contains.

    Attributes:
        packets: The first :data:`SHOWN_PACKETS` packets.
        problems: The first :data:`SHOWN_PROBLEMS` problems.
        refusal: Why nothing can be sent; ``""`` if all packets can be sent, malformed ones if the user wants so.
        malformed: Description of the first malformed packet; ``""`` if there is none.
    """

    packets: list[FoundPacket] = field(default_factory=list)
    problems: list[FoundProblem] = field(default_factory=list)
    refusal: str = ""
    malformed: str = ""
    _data: tuple[bytes, ...] = ()

    @property
    def count(self) -> int:
        """Number of packets."""
        return len(self._data)

    @property
    def size(self) -> int:
        """Number of bytes of all packets."""
        return sum(map(len, self._data))

    def sendable(self, *, as_is: bool) -> list[bytes]:
        """Return the packets to send.

        Args:
            as_is: True to send malformed packets, too.

        Raises:
            InvalidValue: If the text is not hex, is too long or empty, or a packet is malformed and ``as_is`` is False.
        """
        if self.refusal:
            raise InvalidValue(self.refusal)
        if self.malformed and not as_is:
            raise InvalidValue(tr('{problem}. Try: correct it, or select "Send as it is"', problem=self.malformed))
        return list(self._data)


def check_text(text: str, profile: BcapProfile, kind: Kind = "request") -> CheckedText:
    """Return what a text contains; this may take 1 s for a text of :data:`LONGEST_TEXT`.

    Args:
        text: Packets in hex, separated by blank lines.
        profile: Properties of the transport.
        kind: ``"reply"`` if the packets are replies, because this side is a server.
    """
    if len(text) > LONGEST_TEXT:
        too_long = tr(
            "the text exceeds {most} characters. Try: a shorter text, or orinkit raw", most=f"{LONGEST_TEXT:,}"
        )
        return CheckedText(refusal=too_long)
    found = parse_packets(text, profile, kind)
    packets = [_packet(text, each, number, profile, kind) for number, each in _numbered(found)[:SHOWN_PACKETS]]
    problems = [_problem(text, each) for each in found.problems[:SHOWN_PROBLEMS]]
    refusal = malformed = ""
    try:
        data = tuple(found.sendable())
    except InvalidValue as error:
        data, refusal = (), f"{error}"
    if found.problems:
        first = found.problems[0]
        malformed = tr("packet {number}: {text}", number=first.packet + 1, text=first.text)
    return CheckedText(packets, problems, refusal, malformed, data)


def _numbered(found: TypedPackets) -> list[tuple[int, TypedPacket]]:
    """Return the packets with their numbers; a packet that is not hex has a number, too."""
    missing = {each.packet for each in found.problems if each.kind.prevents_sending and each.kind.name != "TOO_LONG"}
    numbers = (number for number in range(len(found.packets) + len(missing)) if number not in missing)
    return [(number + 1, each) for number, each in zip(numbers, found.packets, strict=False)]


def _packet(text: str, packet: TypedPacket, number: int, profile: BcapProfile, kind: Kind) -> FoundPacket:
    data, start, end = packet
    logged = LoggedPacket(number, 0, "", profile.name, ">" if kind == "request" else "<", data)
    return FoundPacket(number, place_of(text, start, end), logged, summary(logged))


def _problem(text: str, problem: Problem) -> FoundProblem:
    place = place_of(text, problem.start, problem.end)
    return FoundProblem(problem.packet + 1, place, problem.text, problem.kind.prevents_sending)


def place_of(text: str, start: int, end: int) -> Place:
    """Return the place of a part of a text."""
    line = text.count("\n", 0, start) + 1
    column = start - text.rfind("\n", 0, start)
    first = _utf16(text[:start])
    return Place(line, column, first, first + _utf16(text[start:end]))


def _utf16(text: str) -> int:
    return len(text.encode("utf-16-le", "surrogatepass")) // 2
