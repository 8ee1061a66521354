"""Dissection of packets into fields with readable meanings (VE026A 3.1, 3.2).

:func:`explain` accepts any bytes. It dissects a malformed packet up to the error and marks the position of the error.
:func:`one_line` summarizes a packet in one line; :func:`split` finds the packets in a sequence of bytes.

>>> start = bytes.fromhex("01100000000100000001000000000004")
>>> one_line(start)
'Service_Start()'
>>> [(field.offset, field.name, field.raw.hex()) for field in explain(start)][:2]
[(0, 'start (SOH)', '01'), (1, 'length', '10000000')]
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from datetime import datetime
from typing import Any, Final, Literal, TypeAlias

from orinkit.bcap import packet
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import ProtocolError
from orinkit.core.i18n import printable, tr
from orinkit.core.record import record
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.notation import format_variant
from orinkit.values.types import ARRAY, EMPTIES, SIZES, VarType, type_name
from orinkit.values.variant import Variant

Kind: TypeAlias = Literal["request", "reply"]

LONGEST_MEANING: Final = 400
"""Maximum number of characters of a value that :func:`explain` shows; the raw bytes are always complete."""
LONGEST_VALUE: Final = 80
"""Maximum number of characters of a value that :func:`show` returns."""
LAST_FUNCTION_ID: Final = 255
"""Codes from 1 to this number are function ids; all others are return codes."""
_CRC_SIZE: Final = 2

_U16: Final = struct.Struct("<H")
_U32: Final = struct.Struct("<I")
_HEAD: Final = struct.Struct("<HI")  # type, count
_ARGUMENT: Final = struct.Struct("<IHI")  # length of the rest, type, count


@record
class PacketField:
    """A field of a packet and its meaning. The concatenated bytes of all fields are the packet.

    Attributes:
        offset: position of the field, counted from the first byte of the packet.
        raw: bytes of the field; empty for an error that has no bytes, for example missing bytes.
        name: name of the field, in the current language.
        meaning: meaning of the field; for a value its VARIANT notation, for an error its description.
        error: True if the field is an error.
        level: 0 for a field of the packet itself, 1 for a field of an argument, one more for each array around it.
    """

    offset: int
    raw: bytes
    name: str
    meaning: str
    error: bool = False
    level: int = 0


def explain(frame: bytes, kind: Kind | None = None, request: bytes | None = None) -> list[PacketField]:
    """Return the fields of one packet.

    Args:
        frame: a packet, possibly malformed.
        kind: ``"request"`` or ``"reply"``; by default, the code in the packet determines this: 1 to 255 is a function
            id, any other code is a return code.
        request: if ``frame`` is a reply, the packet of its request; ``None`` if that packet is unknown.
    """
    dissector = _Dissector(bytes(frame), kind or ("reply" if request is not None else None), _function_of(request))
    dissector.packet()
    return dissector.fields


def kind_of(code: int) -> Kind:
    """Return the kind of a packet, from its code: 1 to 255 is a function id, 0 and all others are return codes."""
    return "request" if 1 <= code <= LAST_FUNCTION_ID else "reply"


def one_line(frame: bytes, request: bytes | None = None) -> str:
    """Return a packet in one line: ``Controller_GetVariable(2, "IO150", "")``, ``S_OK -> 3``.

    Args:
        frame: a packet, possibly malformed.
        request: if ``frame`` is a reply, the packet of its request; ``None`` if that packet is unknown.
    """
    try:
        found = packet.decode(frame, exact=True)
    except ProtocolError as error:
        return tr("not a packet: {error}", error=error)
    values = ", ".join(map(show, found.arguments))
    if request is None and kind_of(found.code) == "request":
        function = FUNCTIONS.get(found.code)
        name = function.name if function else tr("unknown function {code}", code=found.code)
        return f"{name}({values})"
    info = hresult.lookup(found.code)
    if info.failed:
        return f"{_code_name(found.code)}: {info.text}"
    return f"{info.name} -> {values}" if found.arguments else info.name


def show(value: Any) -> str:
    """Return a short text for a value: ``"IO150"``, ``3``, ``[1.5, 2.0]``, ``VT_EMPTY``."""
    text = _show(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 1]}…"


def split(data: bytes) -> list[bytes]:
    """Split bytes into packets and the data between them; the concatenated pieces are the input."""
    pieces: list[bytes] = []
    start = at = 0
    while 0 <= at < len(data):
        size = _packet_size(data, at)
        if size:
            pieces += [piece for piece in (data[start:at], data[at : at + size]) if piece]
            start = at = at + size
        else:
            at = data.find(packet.SOH, at + 1)
    return [*pieces, data[start:]] if start < len(data) else pieces


def _packet_size(data: bytes, at: int) -> int:
    """Return the length of the packet at position ``at``, bytes; 0 if there is no packet."""
    if data[at] != packet.SOH or at + packet.OVERHEAD > len(data):
        return 0
    size: int = _U32.unpack_from(data, at + 1)[0]
    fits = packet.OVERHEAD <= size <= len(data) - at
    return size if fits and data[at + size - 1] == packet.EOT else 0


def _function_of(request: bytes | None) -> Function[..., Any] | None:
    if request is None or len(request) < packet.OVERHEAD:
        return None
    return FUNCTIONS.get(packet.HEADER.unpack_from(request)[4])


# --- values as text ---------------------------------------------------------------------------------------------------


def _show(value: Any) -> str:
    if isinstance(value, Variant):
        if value.type in EMPTIES:
            return type_name(value.type)
        value = value.value
    if isinstance(value, str):
        return f'"{printable(value)}"'
    if isinstance(value, bytes):
        return f"<{value.hex(' ')}>"
    if isinstance(value, list):
        return f"[{', '.join(map(_show, value))}]"
    if isinstance(value, datetime):
        return value.isoformat(" ")
    if type(value) is int and -(2**31) <= value < 0 and hresult.unsigned(value) in hresult.CODES:
        return f"{value} (0x{hresult.unsigned(value):08X})"
    return str(value)


def _code_name(code: int) -> str:
    name = hresult.lookup(code).name
    return name if name.startswith("0x") else f"0x{code:08X} {name}"


def _notation(vt: int, count: int, data: bytes) -> str:
    """Return the VARIANT notation of a value, from its bytes."""
    value, _ = codec.decode(_ARGUMENT.pack(_HEAD.size + len(data), vt, count) + data, exact=True)
    return printable(format_variant(value), LONGEST_MEANING)


# --- dissection -------------------------------------------------------------------------------------------------------


class _Dissector:
    """Dissects one packet in a single pass.

    The decoder (:mod:`orinkit.values.codec`) decides whether an argument is valid, and describes its errors; this class
    locates the fields.
    """

    def __init__(self, frame: bytes, kind: Kind | None, function: Function[..., Any] | None) -> None:
        self.frame = frame
        self.kind = kind
        self.function = function
        self.fields: list[PacketField] = []
        self.at = 0

    def take(self, size: int, name: str, meaning: str, *, error: bool = False, level: int = 0) -> bytes:
        """Add a field with the next ``size`` bytes, and return these bytes."""
        raw = self.frame[self.at : self.at + size]
        self.fields.append(PacketField(self.at, raw, name, meaning, error, level))
        self.at += len(raw)
        return raw

    def wrong(self, end: int, name: str, meaning: str, level: int = 0) -> None:
        """Add an error field with all bytes from the current position up to ``end``."""
        self.take(max(end - self.at, 0), name, meaning, error=True, level=level)

    def packet(self) -> None:
        """Dissect the whole packet."""
        frame = self.frame
        if not frame or frame[0] != packet.SOH:
            name, outside = (
                tr("not a packet"),
                tr("a packet must begin with SOH 01"),
            )
            self.wrong(len(frame), name, outside)
            return
        if len(frame) < packet.HEADER.size:
            self.take(1, tr("start (SOH)"), "")
            needed = tr("the header of {size} bytes is incomplete", size=packet.HEADER.size)
            self.wrong(len(frame), tr("header"), needed)
            return
        stop = self._stop()
        count = self._header()
        closed = stop > packet.HEADER.size and frame[stop - 1] == packet.EOT
        end = stop - 1 if closed or packet.LENGTH.unpack_from(frame, 1)[0] == stop > packet.HEADER.size else stop
        self._arguments(count, end)
        self._tail(end)
        self._end(end, stop)

    def _stop(self) -> int:
        """Return the end of the packet from its length field, or the end of all bytes if no EOT is at that end."""
        (length,) = packet.LENGTH.unpack_from(self.frame, 1)
        fits = packet.OVERHEAD <= length <= len(self.frame) and self.frame[length - 1] == packet.EOT
        return length if fits else len(self.frame)

    def _header(self) -> int:
        _, length, serial, reserved, code, count = packet.HEADER.unpack_from(self.frame)
        self.take(1, tr("start (SOH)"), "")
        self._length(length)
        self.take(2, tr("serial"), str(serial))
        retry = tr("{serial}: serial of the first attempt", serial=reserved)
        self.take(2, tr("reserved"), retry if reserved else "0")
        self.kind = self.kind or kind_of(code)
        if self.kind == "request":
            self.function = FUNCTIONS.get(code)
            unknown = tr("unknown function; a server returns E_NOTIMPL")
            meaning = f"{self.function.name}: {self.function.text}" if self.function else unknown
            self.take(4, tr("function id"), f"{code} {meaning}")
        else:
            self.take(4, tr("return code"), f"{_code_name(code)}: {hresult.lookup(code).text}")
        self.take(2, tr("arguments"), str(count))
        return int(count)

    def _length(self, length: int) -> None:
        name = tr("length")
        present = len(self.frame)
        if length > DEFAULT_LIMITS.packet:
            most = DEFAULT_LIMITS.packet
            description = tr("{length} bytes exceed the limit of {most} bytes", length=length, most=most)
        elif length != present:
            description = tr("{length}, but the packet has {present}", length=_bytes(length), present=_bytes(present))
        else:
            self.take(4, name, _bytes(length))
            return
        self.take(4, name, description, error=True)

    def _arguments(self, count: int, end: int) -> None:
        for index in range(count):
            if not self._argument(self._argument_name(index), end, count - index):
                return

    def _argument_name(self, index: int) -> str:
        function = self.function
        if self.kind == "request":
            if function is not None and index < len(function.arguments):
                return function.arguments[index].name
            return tr("argument {index}", index=index + 1)
        if index == 0:
            creates = function.creates if function is not None else ""
            return tr("{interface} handle", interface=creates) if creates else tr("result")
        return tr("result {index}", index=index + 1)

    def _argument(self, name: str, end: int, missing: int) -> bool:
        """Dissect one argument; return False if the argument after it cannot be located."""
        start = self.at
        wrong: ProtocolError | None = None
        try:
            codec.decode(self.frame, start, end)
        except ProtocolError as error:
            wrong = error
        if end - start < _ARGUMENT.size:
            more = tr(" ({missing} missing according to the argument count)", missing=missing)
            self.wrong(self._before_crc(end), name, f"{wrong}{more}", 1)
            return False
        length, vt, count = _ARGUMENT.unpack_from(self.frame, start)
        fits = _HEAD.size <= length <= end - start - 4
        self.take(4, _part(name, tr("length")), _bytes(length) if fits else str(wrong), error=not fits, level=1)
        self._type_and_count(name, vt, count, 1)
        if not fits:
            end = self._before_crc(end)
            self._data(name, vt, count, end, 1)
            if self.at < end:
                self.wrong(end, name, tr("the length is invalid, so the end of this value is unknown"), 1)
            return False
        stop = start + 4 + length
        self._data(name, vt, count, stop, 1)
        if wrong is not None:
            self.wrong(stop, name, str(wrong), 1)
        return True

    def _type_and_count(self, name: str, vt: int, count: int, level: int) -> None:
        self.take(2, _part(name, tr("data type")), f"{type_name(vt)} ({vt})", level=level)
        self.take(4, _part(name, tr("element count")), str(count), level=level)

    def _data(self, name: str, vt: int, count: int, stop: int, level: int) -> bool:
        """Dissect the valid part of the data of an argument or array element; return True if all of it is valid."""
        base, array = vt & ~ARRAY, bool(vt & ARRAY)
        if not array and count != 1:
            return False
        if base in SIZES:
            return self._value(name, vt, count, SIZES[base] * count, stop, level)
        if base == VarType.BSTR:
            names = (f"{name}[{index}]" for index in range(count)) if array else [name]
            return all(self._string(each, stop, level + array) for each in names)
        if base == VarType.VARIANT and array:
            return level <= DEFAULT_LIMITS.depth and self._elements(name, count, stop, level + 1)
        return vt in EMPTIES

    def _value(self, name: str, vt: int, count: int, size: int, stop: int, level: int) -> bool:
        if self.at + size > stop:
            return False
        if size:
            self.take(size, name, _notation(vt, count, self.frame[self.at : self.at + size]), level=level)
        return True

    def _string(self, name: str, stop: int, level: int) -> bool:
        if self.at + 4 > stop:
            return False
        (length,) = _U32.unpack_from(self.frame, self.at)
        if self.at + 4 + length > stop or length % 2:
            return False
        self.take(4, _part(name, tr("string length")), _bytes(length), level=level)
        if length:
            data = self.frame[self.at - 4 : self.at + length]
            self.take(length, name, _notation(VarType.BSTR, 1, data), level=level)
        return True

    def _elements(self, name: str, count: int, stop: int, level: int) -> bool:
        for index in range(count):
            if self.at + _HEAD.size > stop:
                return False
            vt, inner = _HEAD.unpack_from(self.frame, self.at)
            each = f"{name}[{index}]"
            self._type_and_count(each, vt, inner, level)
            if not self._data(each, vt, inner, stop, level):
                return False
        return True

    # After the arguments

    def _before_crc(self, end: int) -> int:
        """Return the position of the CRC, or ``end`` if there is none."""
        start = end - _CRC_SIZE
        if end == len(self.frame) or start < self.at:  # bytes of an argument are never a CRC, even if they match
            return end
        return start if _U16.unpack_from(self.frame, start)[0] == packet.checksum(self.frame[1:start]) else end

    def _tail(self, end: int) -> None:
        crc = self._before_crc(end)
        if self.at < crc:
            area = crc - self.at
            description = tr("{size} after the arguments", size=_bytes(area))
            if area == _CRC_SIZE and crc == end:
                right = _U16.pack(packet.checksum(self.frame[1 : self.at])).hex(" ")
                description = tr(
                    "{said}; if these bytes are a CRC, the correct value is {right}", said=description, right=right
                )
            self.take(area, tr("reserved area"), description)
        if self.at == crc < end:
            self.take(_CRC_SIZE, "CRC", tr("correct (serial line)"))

    def _end(self, end: int, stop: int) -> None:
        name = tr("end (EOT)")
        if end < stop and self.frame[end] == packet.EOT:
            self.take(1, name, "")
        else:
            self.wrong(stop, name, tr("the final EOT 04 is missing"))
        if stop < len(self.frame):
            rest = _bytes(len(self.frame) - stop)
            description = tr("{size} after the end of the packet", size=rest)
            self.wrong(len(self.frame), tr("not a packet"), description)


def _bytes(count: int) -> str:
    return tr("1 byte") if count == 1 else tr("{count} bytes", count=count)


def _part(name: str, part: str) -> str:
    return f"{name}: {part}"


def first_error(fields: Iterable[PacketField]) -> PacketField | None:
    """Return the first field that is an error, or ``None`` if the packet is valid."""
    return next((field for field in fields if field.error), None)
