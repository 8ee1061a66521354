"""TelABH3: the text protocol for reading and writing the parameters and monitors of a driver.

Over CAN, each text is one multi-packet message (:mod:`orinkit.abh3.session.multipacket`). A request consists of a
command of two letters, an address of four hexadecimal digits, a value of eight hexadecimal digits (only to write), and
a checksum of two hexadecimal digits. For example, ``CP000095`` reads parameter 0.

The checksum plus the sum of all preceding bytes is a multiple of 256. The header ``FFFF`` before the command is
included in this sum, but it is not sent over CAN. Over serial lines, the header is sent, and the text is enclosed in
STX and ETX.

The format of replies over CAN is not documented. Over serial lines, a reply consists of STX, a header of four
characters, the status, the data, the checksum and ETX. This module also creates replies, for virtual drivers. These
replies have no STX, no header and no ETX, like requests over CAN. :func:`parse_reply` reads all these forms.

A value is a 32-bit word that contains a PACK_FLOAT, a whole number, or flags. :data:`MONITORS` and :data:`PARAMETERS`
contain the type of each value. SYN characters at the end of a message are padding.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeAlias

from orinkit.abh3.table import packfloat
from orinkit.abh3.table.bits import Values
from orinkit.core.errors import InvalidValue, ParameterRefused, ProtocolError
from orinkit.core.i18n import N_, tr, translate
from orinkit.core.validation import brief, whole

Kind: TypeAlias = Literal["pack", "int", "bits"]

PARAMETER: Final = "CP"
"""The command that reads or writes a parameter."""
MONITOR: Final = "CM"
"""The command that reads a monitor."""
IDENTIFICATION: Final = "BI"
"""The command that reads an identification of the driver."""
IDENTIFICATIONS: Final = (0, 2, 4, 5, 8, 0xC)
"""Numbers of the known identifications."""
VERSION: Final = 2
"""Number of the identification that is the driver's version."""
_NAMES: Final = {
    PARAMETER: N_("parameter"),
    MONITOR: N_("monitor"),
    IDENTIFICATION: N_("identification"),
}
OFF: Final = 0x0000
"""Value that means off, for parameters that are switches."""
ON: Final = 0x8000
"""Value that means on, for parameters that are switches."""
ACK: Final = 0x06
"""Status of an executed request in replies that this module creates.

In replies of drivers, every status except NAK means that the request was executed.
"""
NAK: Final = 0x15
"""Status of a refused request."""

_HEADER: Final = b"FFFF"
_STX: Final = b"\x02"
_ETX: Final = b"\x03"
_SYN: Final = b"\x16"
_BLANK: Final = 0x20  # a byte below this is a status, not a character of the header
_WORDS: Final = range(1 << 32)
_ADDRESSES: Final = range(1 << 16)
_REQUEST: Final = re.compile(rb"([ -~]{4})?(CP|CM|BI)([0-9A-Fa-f]{4})([0-9A-Fa-f]{8})?([0-9A-Fa-f]{2})")
_HEX_BYTE: Final = re.compile(rb"[0-9A-Fa-f]{2}")
_HEX_WORD: Final = re.compile(r"[0-9A-Fa-f]{8}")
_PRINTABLE: Final = re.compile(r"[ -~]*")


# --- requests ---------------------------------------------------------------------------------------------------------


class TelRequest(NamedTuple):
    """A request of a host.

    Attributes:
        command: ``"CP"`` for a parameter, ``"CM"`` for a monitor, ``"BI"`` for an identification.
        address: Address of the parameter or the monitor, or number of the identification, 0 to 0xFFFF.
        value: The word to write; ``None`` for reading.
    """

    command: str
    address: int
    value: int | None = None

    def __str__(self) -> str:
        """Return a readable text, such as ``parameter 0x4102``; to write, such as ``parameter 0x4102 = 0x00000001``."""
        name = tr(_NAMES[self.command])
        return f"{name} 0x{self.address:04X}" + ("" if self.value is None else f" = 0x{self.value:08X}")

    def __bytes__(self) -> bytes:
        value = "" if self.value is None else f"{self.value:08X}"
        text = f"{self.command}{self.address:04X}{value}".encode("ascii")
        return text + checksum(_HEADER + text)


def checksum(data: bytes) -> bytes:
    """Return the two checksum digits for these bytes. For a text for CAN, they must begin with the header ``FFFF``."""
    return b"%02X" % (-sum(data) & 0xFF)


def read_parameter(address: int) -> bytes:
    """Return the request that reads a parameter.

    Raises:
        InvalidValue: If the address has more than 16 bits.
    """
    return bytes(TelRequest(PARAMETER, _in(_ADDRESSES, address)))


def write_parameter(address: int, word: int) -> bytes:
    """Return the request that writes a parameter.

    Raises:
        InvalidValue: If the address has more than 16 bits, or the word more than 32.
    """
    return bytes(TelRequest(PARAMETER, _in(_ADDRESSES, address), _in(_WORDS, word)))


def read_monitor(address: int) -> bytes:
    """Return the request that reads a monitor.

    Raises:
        InvalidValue: If the address has more than 16 bits.
    """
    return bytes(TelRequest(MONITOR, _in(_ADDRESSES, address)))


def read_identification(number: int) -> bytes:
    """Return the request that reads an identification, for example :data:`VERSION`.

    Raises:
        InvalidValue: If the number has more than 16 bits.
    """
    return bytes(TelRequest(IDENTIFICATION, _in(_ADDRESSES, number)))


def parse_request(message: bytes) -> TelRequest:
    """Parse a request, in the form for CAN or in the form for serial lines.

    Raises:
        ProtocolError: If the message is not a request, or its checksum is wrong.
    """
    body, _ = _strip_framing(message)
    found = _REQUEST.fullmatch(body)
    if found is None or (found[4] and found[2] != PARAMETER.encode()):
        raise _unreadable(message)
    _check(message, (b"" if found[1] else _HEADER) + body)
    return TelRequest(found[2].decode(), int(found[3], 16), int(found[4], 16) if found[4] else None)


# --- replies ----------------------------------------------------------------------------------------------------------


class TelReply(NamedTuple):
    """A reply of a driver.

    Attributes:
        refused: True if the driver refused the request.
        data: Text of an identification, or the digits of a value; empty if a parameter was written.
        asked: Description of the request, for error messages.
    """

    refused: bool
    data: str
    asked: str = ""

    def confirmed(self) -> str:
        """Return :attr:`data` if the driver executed the request.

        Raises:
            ParameterRefused: If the driver refused the request.
        """
        if self.refused:
            code = f" ({self.data})" if self.data else ""
            asked = f"{self.asked}: " if self.asked else ""
            raise ParameterRefused(
                tr(
                    "{asked}the driver refused the request{code}. Try: check that the address exists, can be written, "
                    "and allows the value",
                    asked=asked,
                    code=code,
                )
            )
        return self.data

    @property
    def word(self) -> int:
        """The value that was read, a 32-bit word.

        Raises:
            ParameterRefused: If the driver refused the request.
            ProtocolError: If the data is not a value.
        """
        digits = self.confirmed()[-8:]
        if _HEX_WORD.fullmatch(digits) is None:
            raise _unreadable(self.data.encode("ascii", "replace"))
        return int(digits, 16)


def reply(value: int | str = "") -> bytes:
    """Return the reply of a virtual driver to a request that it has executed.

    Args:
        value: The word that was read, the text of an identification, or nothing if a parameter was written.

    Raises:
        InvalidValue: If the word has more than 32 bits, or the text is not printable ASCII.
    """
    text = value if isinstance(value, str) else f"{_in(_WORDS, value):08X}"
    if _PRINTABLE.fullmatch(text) is None:
        raise InvalidValue(tr("the text is not printable ASCII: {text}", text=brief(text)))
    return _build_reply(ACK, text)


def refusal() -> bytes:
    """Return the reply of a virtual driver to a request that it refuses."""
    return _build_reply(NAK, "")


def parse_reply(message: bytes, asked: str = "") -> TelReply:
    """Parse the reply of a driver.

    A reply consists of a status, data and a checksum. A header of four characters may precede the status, and STX and
    ETX may enclose the reply. The checksum may include the header ``FFFF`` even if the reply does not contain the
    header.

    Args:
        message: The reply.
        asked: Description of the request, for error messages.

    Raises:
        ProtocolError: If the message is not a reply, or its checksum is wrong.
    """
    body, framed = _strip_framing(message)
    _check(message, body, _HEADER + body)
    text = body[:-2]
    header = 4 if text and _has_header(text, framed) else 0
    if len(text) <= header:
        raise _unreadable(message)
    return TelReply(text[header] == NAK, text[header + 1 :].decode("latin-1"), asked)


def _has_header(text: bytes, framed: bool) -> bool:
    return text[0] >= _BLANK and (framed or text.startswith(_HEADER) or (len(text) > 4 and text[4] < _BLANK))


def _build_reply(status: int, text: str) -> bytes:
    body = bytes((status,)) + text.encode("ascii")
    return body + checksum(_HEADER + body)


def _strip_framing(message: bytes) -> tuple[bytes, bool]:
    """Return a text without STX, ETX and padding, and True if the text began with STX."""
    body = bytes(message).rstrip(_SYN)
    framed = body.startswith(_STX)
    return (body[1:] if framed else body).partition(_ETX)[0], framed


def _check(message: bytes, *counted: bytes) -> None:
    """Check the two checksum digits at the end of the texts: at least one text must have a valid checksum.

    The texts are variants of one message, with and without the header.
    """
    for text in counted:
        if _HEX_BYTE.fullmatch(text[-2:]) and (sum(text[:-2]) + int(text[-2:], 16)) & 0xFF == 0:
            return
    raise ProtocolError(tr("the checksum of a TelABH3 text is wrong: {message!r:.80}", message=bytes(message)))


def _unreadable(message: bytes) -> ProtocolError:
    return ProtocolError(tr("not a valid TelABH3 text: {message!r:.80}", message=bytes(message)))


def _in(allowed: range, number: object) -> int:
    found = whole(number)
    if found is not None and found in allowed:
        return found
    raise InvalidValue(
        tr(
            "the number must be a whole number of 0 to 0x{highest:X}, not {number}",
            highest=allowed.stop - 1,
            number=brief(number),
        )
    )


# --- monitors and parameters ------------------------------------------------------------------------------------------


class TelItem(NamedTuple):
    """A monitor or a parameter.

    Attributes:
        address: The address for :func:`read_monitor` or :func:`read_parameter`.
        kind: ``"pack"`` for a PACK_FLOAT, ``"int"`` for a signed whole number, ``"bits"`` for flags.
        title: The name, in English, with placeholders.
        unit: Unit of the value; for a switch, its two valid values, for example ``"0x0000/0x8000"``.
        title_args: Values of the placeholders.
    """

    address: int
    kind: Kind
    title: str
    unit: str = ""
    title_args: Values = ()

    @property
    def text(self) -> str:
        """The name, in the current language."""
        return tr(self.title, **dict(self.title_args))

    @property
    def english(self) -> str:
        """The name, in English."""
        return translate("en", self.title, **dict(self.title_args))

    def decode(self, word: int) -> float:
        """Return the value of a word: a ``float`` for a PACK_FLOAT, otherwise an ``int``.

        Raises:
            InvalidValue: If the word has more than 32 bits or is negative.
        """
        if self.kind == "pack":
            return packfloat.to_float(word)
        number = _in(_WORDS, word)
        return number - (1 << 32) if self.kind == "int" and number >> 31 else number

    def encode(self, value: float) -> int:
        """Return the word of a value.

        Raises:
            InvalidValue: If the value is not a number of the required type, or does not fit in 32 bits.
        """
        if self.kind == "pack":
            word = packfloat.from_float(value)
            if not math.isfinite(packfloat.to_float(word)):
                raise InvalidValue(
                    tr("{name}: {value} cannot be written as a PACK_FLOAT", name=self.text, value=brief(value))
                )
            return word
        low, high = (-(1 << 31), (1 << 31) - 1) if self.kind == "int" else (0, (1 << 32) - 1)
        number = whole(value)
        if number is None or not low <= number <= high:
            raise InvalidValue(
                tr(
                    "{name} must be a whole number of {low} to {high}, not {value}",
                    name=self.text,
                    low=low,
                    high=high,
                    value=brief(value),
                )
            )
        return number & 0xFFFFFFFF


_SETS: Final = range(8)
_SWITCH: Final = "0x0000/0x8000"


def _monitors() -> Iterator[TelItem]:
    yield TelItem(0x0000, "bits", N_("error flags"))
    yield TelItem(0x0001, "bits", N_("warning flags"))
    yield TelItem(0x0002, "bits", N_("digital inputs"))
    yield TelItem(0x0003, "bits", N_("input control"))
    yield TelItem(0x0004, "bits", N_("digital outputs, bits 24 to 31"))
    yield TelItem(0x0005, "bits", N_("output control"))
    yield TelItem(0x1004, "pack", N_("main voltage"), "V")
    yield TelItem(0x1005, "pack", N_("control voltage"), "V")
    yield TelItem(0x1012, "pack", N_("A/Y velocity"), "min^-1")
    yield TelItem(0x1022, "pack", N_("B/X velocity"), "min^-1")
    yield TelItem(0x1031, "pack", N_("A axis torque"), "%")
    yield TelItem(0x103B, "pack", N_("A axis load"), "%")
    yield TelItem(0x1041, "pack", N_("B axis torque"), "%")
    yield TelItem(0x104B, "pack", N_("B axis load"), "%")
    yield TelItem(0x1054, "int", N_("A axis pulse count"), "pulse")
    yield TelItem(0x1064, "int", N_("B axis pulse count"), "pulse")


_OF_A_SET: Final[tuple[tuple[int, int, Kind, str, str], ...]] = (  # address of A/Y in data set 0, offset of B/X
    (0x5000, 0x08, "pack", N_("{axis} velocity #{number}"), "min^-1"),
    (0x5010, 0x08, "pack", N_("{axis} current #{number}"), "%"),
    (0x5020, 0x60, "pack", N_("{axis} acceleration time #{number}"), "s"),
    (0x5030, 0x60, "pack", N_("{axis} acceleration S-curve #{number}"), "%"),
    (0x5040, 0x60, "pack", N_("{axis} deceleration time #{number}"), "s"),
    (0x5050, 0x60, "pack", N_("{axis} deceleration S-curve #{number}"), "%"),
    (0x5060, 0x60, "pack", N_("{axis} P gain #{number}"), ""),
    (0x5070, 0x60, "pack", N_("{axis} I gain #{number}"), ""),
    (0x50E0, 0x10, "int", N_("{axis} data source #{number} (0: driver, 2: CAN)"), ""),
)
_SWITCHES: Final = (
    (0x5100, N_("{axis} servo on")),
    (0x5101, N_("{axis} start")),
    (0x5107, N_("{axis} data select 0")),
    (0x5108, N_("{axis} data select 1")),
    (0x5109, N_("{axis} data select 2")),
)
_CAN: Final = (
    (0x4100, N_("CAN function"), ""),
    (0x4101, N_("bit rate"), "bit/s"),
    (0x4102, N_("ABH3 address"), ""),
    (0x4103, N_("host address, -1 for any"), ""),
    (0x4105, N_("single packet 0 mode"), "ms"),
    (0x4107, N_("broadcast group"), ""),
    (0x4114, N_("single packet priority"), ""),
    (0x4115, N_("multi-packet priority"), ""),
    (0x4116, N_("broadcast priority"), ""),
    (0x4117, N_("command time-out after which the driver sets its commands to 0, 0 for none"), "ms"),
    (0x4118, N_("command time-out after which the driver reports an error, 0 for none"), "ms"),
    (0x4119, N_("wait in multi-packet data transfer"), "ms"),
    (0x411A, N_("logic of the control flags"), ""),
    (0x6180, N_("PDU format of single packets"), ""),
)


def _parameters() -> Iterator[TelItem]:
    yield from (TelItem(address, "int", title, unit) for address, title, unit in _CAN)
    yield from (
        TelItem(0x4108 + n, "int", N_("period of broadcast {number}, 0 for on request only"), "ms", (("number", n),))
        for n in range(8)
    )
    yield from (
        TelItem(0x4110 + n, "int", N_("broadcast reception {number}"), "", (("number", n + 1),)) for n in range(4)
    )
    for axis, name in enumerate(("A/Y", "B/X")):
        for first, offset, kind, title, unit in _OF_A_SET:
            base = first + axis * offset
            yield from (TelItem(base + n, kind, title, unit, (("axis", name), ("number", n))) for n in _SETS)
        for first, title in _SWITCHES:
            yield TelItem(first + axis * 0x20, "int", title, _SWITCH, (("axis", name),))
    for n in _SETS:
        yield TelItem(0x5180 + n, "bits", N_("digital output #{number}"), "0x00000000/0xFFFFFFFF", (("number", n),))


def _table(items: Iterator[TelItem]) -> Mapping[int, TelItem]:
    return MappingProxyType({item.address: item for item in sorted(items)})


MONITORS: Final = _table(_monitors())
"""The known monitors, by address."""
PARAMETERS: Final = _table(_parameters())
"""The known parameters, by address."""
