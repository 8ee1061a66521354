"""Packets typed in hex, without I/O: parsing, checking, assembling (RC8 5.2.2).

Packets are separated by blank lines. Spaces, line ends, commas, brackets and quotes may separate bytes, and each byte
may have a prefix such as ``0x``. :func:`parse_packets` reports problems with their positions in the text. Only a text
that is not hex prevents sending: a malformed packet is a warning, because it may be sent on purpose.

>>> typed = parse_packets("01100000 00010000 00010000 00000004")
>>> typed.packets[0].data.hex(), typed.problems
('01100000000100000001000000000004', [])
>>> [(each.start, each.end, each.kind.name) for each in parse_packets("0111 00 00 00 01 0G").problems]
[(17, 19, 'NOT_HEX')]
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, NamedTuple

from orinkit.bcap import packet
from orinkit.bcap.dissect import Kind, explain
from orinkit.bcap.profiles import STREAM, BcapProfile
from orinkit.bcap.requests import encode_request
from orinkit.cao.argument_text import read_argument
from orinkit.cao.functions import FUNCTIONS, find
from orinkit.cao.table import Function
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.raw.hex_text import PREFIXES, masked
from orinkit.values.codec import DEFAULT_LIMITS

MOST_PROBLEMS: Final = 50
"""Maximum number of problems that are reported for one text."""
_EXPLAINED: Final = 64 * 1024  # largest packet whose arguments are checked, bytes; a larger one would take too long
_BLANK_LINES: Final = re.compile(r"\n(?:[ \t\r\f\v]*\n)+")
_WORD: Final = re.compile(r"\S+")
_DIGITS: Final = re.compile(r"[0-9A-Fa-f]+")


class ProblemKind(Enum):
    """Kinds of problems."""

    NOT_HEX = "not-hex"
    ODD_DIGITS = "odd-digits"
    TOO_LONG = "too-long"
    TOO_SHORT = "too-short"
    SOH = "soh"
    LENGTH = "length"
    EOT = "eot"
    CRC = "crc"
    FUNCTION = "function"
    ARGUMENTS = "arguments"

    @property
    def prevents_sending(self) -> bool:
        """True if no bytes can be sent."""
        return self in (ProblemKind.NOT_HEX, ProblemKind.ODD_DIGITS, ProblemKind.TOO_LONG)


class Problem(NamedTuple):
    """A problem in a text.

    Attributes:
        kind: Kind of the problem.
        start: Position of its first character in the text.
        end: Position after its last character.
        text: Description, in the current language.
        packet: Index of the packet, from 0.
    """

    kind: ProblemKind
    start: int
    end: int
    text: str
    packet: int


class TypedPacket(NamedTuple):
    """A packet in a text: its bytes, and the positions of its first character and after its last one."""

    data: bytes
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class TypedPackets:
    """The packets of a text, and the problems in it, in the order of their positions.

    Attributes:
        packets: The packets; one that is not hex is omitted.
        problems: At most :data:`MOST_PROBLEMS` problems.
        is_complete: False if there are more problems; the packets after them are omitted.
    """

    packets: list[TypedPacket] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    is_complete: bool = True

    @property
    def can_be_sent(self) -> bool:
        """True if there are packets and no problem prevents sending."""
        prevented = any(problem.kind.prevents_sending for problem in self.problems)
        return bool(self.packets) and self.is_complete and not prevented

    def sendable(self) -> list[bytes]:
        """Return the packets.

        Raises:
            InvalidValue: If a problem prevents sending, there are too many problems, or the text contains no packet.
        """
        for problem in self.problems:
            if problem.kind.prevents_sending:
                raise InvalidValue(
                    tr("packet {number}: {text}", number=problem.packet + 1, text=problem.text),
                )
        if not self.is_complete:
            raise InvalidValue(
                tr("the text has more than {most} problems. Try: correct these first", most=MOST_PROBLEMS)
            )
        if not self.packets:
            raise InvalidValue(tr("no packet given. Try: the bytes of a packet in hex"))
        return [each.data for each in self.packets]


def parse_packets(text: str, profile: BcapProfile = STREAM, kind: Kind = "request") -> TypedPackets:
    """Return the packets of a text and their problems.

    Args:
        text: Hex text; packets are separated by blank lines.
        profile: Properties of the transport: packets of a serial line have a CRC, datagrams are short.
        kind: ``"reply"`` if the packets are replies, whose code is not a function id.
    """
    packets: list[TypedPacket] = []
    problems: list[Problem] = []
    is_complete = True
    plain = masked(text)
    for number, (start, end) in enumerate(_paragraphs(plain)):
        if len(problems) >= MOST_PROBLEMS:
            is_complete = False
            break
        try:
            data = bytes.fromhex(plain[start:end])
        except ValueError:
            problems.extend(_not_hex(plain, text, start, end, number))
        else:
            packets.append(TypedPacket(data, start, end))
            for name, first, stop, description in check(data, profile, kind):
                at = _position(plain, start, end, first, len(data))
                until = _position(plain, start, end, max(stop - 1, first), len(data)) + 2
                problems.append(Problem(name, at, min(until, end), description, number))
    return TypedPackets(packets, problems[:MOST_PROBLEMS], is_complete and len(problems) <= MOST_PROBLEMS)


def _paragraphs(plain: str) -> Iterator[tuple[int, int]]:
    """Yield the positions of the text of each packet, without surrounding white space."""
    start = 0
    for blank in _BLANK_LINES.finditer(plain):
        yield from _trimmed(plain, start, blank.start())
        start = blank.end()
    yield from _trimmed(plain, start, len(plain))


def _trimmed(plain: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    piece = plain[start:end]
    content = piece.strip()
    if content:
        first = start + len(piece) - len(piece.lstrip())
        yield first, first + len(content)


def _not_hex(plain: str, text: str, start: int, end: int, number: int) -> Iterator[Problem]:
    """Yield the words that are not hex, at most :data:`MOST_PROBLEMS`."""
    count = 0
    for word in _WORD.finditer(plain, start, end):
        begin = word.start() - 2 if text[word.start() - 2 : word.start()] in PREFIXES else word.start()
        shown = text[begin : word.end()]
        if _DIGITS.fullmatch(word[0]) and len(word[0]) % 2 == 0:
            continue
        if _DIGITS.fullmatch(word[0]):
            kind = ProblemKind.ODD_DIGITS
            description = tr("{text!r:.40} has an odd number of hex digits ({count})", text=shown, count=len(word[0]))
        else:
            kind, description = ProblemKind.NOT_HEX, tr("{text!r:.40} is not hex", text=shown)
        yield Problem(kind, begin, word.end(), description, number)
        count += 1
        if count >= MOST_PROBLEMS:
            return


def _position(plain: str, start: int, end: int, byte: int, count: int) -> int:
    """Return the position of a byte in the text of a packet; count from the end that is nearer."""
    if byte <= count // 2:
        left, step, at = 2 * byte, 1, start
    else:
        left, step, at = 2 * (count - 1 - byte) + 1, -1, end - 1
    while left or plain[at].isspace():
        left -= not plain[at].isspace()
        at += step
    return at


# --- checks -----------------------------------------------------------------------------------------------------------


class PacketProblem(NamedTuple):
    """A problem of a packet: the kind, the first byte, the byte after the last one, and a description."""

    kind: ProblemKind
    start: int
    end: int
    text: str


def check(data: bytes, profile: BcapProfile = STREAM, kind: Kind = "request") -> list[PacketProblem]:
    """Return the problems of one packet, in the order of the fields; for the arguments see :func:`parse_packets`."""
    most = min(DEFAULT_LIMITS.packet, profile.packet)
    if len(data) > DEFAULT_LIMITS.packet:
        return [PacketProblem(ProblemKind.TOO_LONG, 0, 1, _exceeds(len(data), most, profile))]
    found = list(_frame_problems(data, profile, kind))
    if len(data) > most:
        found.append(PacketProblem(ProblemKind.LENGTH, 0, 1, _exceeds(len(data), most, profile)))
    if not found and len(data) <= _EXPLAINED:
        found += [
            PacketProblem(ProblemKind.ARGUMENTS, each.offset, each.offset + max(len(each.raw), 1), each.meaning)
            for each in explain(data, kind)
            if each.error
        ]
    return [each._replace(start=min(each.start, len(data) - 1)) for each in found]


def _frame_problems(data: bytes, profile: BcapProfile, kind: Kind) -> Iterator[PacketProblem]:
    least = packet.OVERHEAD + (profile.tail - 1)
    if data[0] != packet.SOH:
        yield PacketProblem(ProblemKind.SOH, 0, 1, tr("a packet must begin with SOH 01, not {byte:02x}", byte=data[0]))
    if len(data) >= 5:
        (length,) = packet.LENGTH.unpack_from(data, 1)
        if length != len(data):
            description = tr(
                "the length is {length}, but {present} bytes are present", length=length, present=len(data)
            )
            yield PacketProblem(ProblemKind.LENGTH, 1, 5, description)
    if len(data) < least:
        description = tr("{count} bytes are present, but a packet has at least {least}", count=len(data), least=least)
        yield PacketProblem(ProblemKind.TOO_SHORT, 0, len(data), description)
        return
    code = packet.HEADER.unpack_from(data)[4]
    if kind == "request" and code not in FUNCTIONS:
        description = tr("function id {code} is unknown; a server returns E_NOTIMPL", code=code)
        yield PacketProblem(ProblemKind.FUNCTION, 9, 13, description)
    last = len(data) - 1
    if profile.crc and data[last] == packet.EOT and not packet.has_correct_crc(data):
        right = packet.checksum(data[1:-3]).to_bytes(2, "little").hex(" ")
        yield PacketProblem(
            ProblemKind.CRC, last - 2, last, tr("the CRC is wrong; the correct value is {right}", right=right)
        )
    if data[last] != packet.EOT:
        description = tr("a packet must end with EOT 04, not {byte:02x}", byte=data[last])
        yield PacketProblem(ProblemKind.EOT, last, last + 1, description)


def _exceeds(count: int, most: int, profile: BcapProfile) -> str:
    return tr(
        "the packet of {count} bytes exceeds the limit of {most} bytes over {name}",
        count=count,
        most=most,
        name=profile.name,
    )


# --- assembling -------------------------------------------------------------------------------------------------------


def assemble(
    function: str | int, arguments: Sequence[str] = (), serial: int = 1, profile: BcapProfile = STREAM
) -> bytes:
    """Return the packet of a request.

    Args:
        function: Id, name or Python name of the function: ``101``, ``Variable_GetValue``, ``variable_get_value``.
        arguments: Arguments in VARIANT notation, including the handle; optional ones may be omitted.
        serial: Serial number, 1 to 65535. On UDP and serial lines, it is repeated in the reserved field.
        profile: Properties of the transport; packets of a serial line have a CRC.

    Raises:
        InvalidValue: If the function is unknown, or an argument does not fit.
        NotationError: If an argument is invalid VARIANT notation.
    """
    try:
        entry = find(str(function))
    except KeyError as error:
        raise InvalidValue(str(error.args[0])) from None
    if len(arguments) > len(entry.arguments):
        most = len(entry.arguments)
        raise InvalidValue(
            tr("{name} takes {count} arguments, got {given}", name=entry.name, count=most, given=len(arguments))
        )
    values = [read_argument(row, text) for row, text in zip(entry.arguments, arguments, strict=False)]
    return assemble_request(entry, values, serial, profile)


def assemble_request(
    function: Function[..., Any], values: Sequence[Any], serial: int = 1, profile: BcapProfile = STREAM
) -> bytes:
    """Return the packet of a request, as :func:`assemble`, but from values.

    Raises:
        InvalidValue: If an argument is missing or does not fit, or the serial is invalid.
    """
    _check_serial(serial)
    try:
        bound = function.bind(tuple(values), {})
    except TypeError as error:
        raise InvalidValue(str(error)) from None
    return encode_request(function, bound, serial, serial if profile.lossy else 0, crc=profile.crc)


def assemble_reply(code: int, values: Sequence[Any] = (), serial: int = 1, profile: BcapProfile = STREAM) -> bytes:
    """Return the packet of a reply.

    Args:
        code: Return code, signed or unsigned.
        values: The results: none, or one.
        serial: Serial number of the request. On UDP and serial lines, it is repeated in the reserved field.
        profile: Properties of the transport; packets of a serial line have a CRC.

    Raises:
        InvalidValue: If the return code or the serial is invalid, or a value cannot be converted to a VARIANT.
    """
    _check_serial(serial)
    if not -0x8000_0000 <= code <= 0xFFFF_FFFF:
        raise InvalidValue(tr("return code {code} does not fit into 32 bits", code=code))
    found = packet.Packet(serial, code & 0xFFFF_FFFF, list(values), serial if profile.lossy else 0)
    return packet.encode(found, crc=profile.crc)


def _check_serial(serial: int) -> None:
    if not 0 <= serial <= 0xFFFF:
        raise InvalidValue(tr("serial {serial} is not 0 to 65535", serial=serial))


def with_crc(data: bytes) -> bytes:
    """Return a packet with a correct CRC, for a serial line; its length field is corrected, too.

    Raises:
        ProtocolError: If the bytes are not a packet without a CRC.
    """
    packet.check_frame(data)
    _, _, serial, reserved, code, count = packet.HEADER.unpack_from(data)
    return packet.pack(serial, code, count, data[packet.HEADER.size : -1], reserved, crc=True)
