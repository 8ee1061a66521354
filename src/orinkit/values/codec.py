"""Binary encoding of VARIANTs in packet arguments and VARIANT arrays (VE026A 3.2, figures 3-2 and 3-3).

An argument is ``length u32 | type u16 | count u32 | data``, little-endian. The length field does not include its own
four bytes. An element of a VARIANT array has the same layout without the length. A read never exceeds the bytes that
are present or the limits of :class:`PacketLimits`.

The optional extension in C (:mod:`orinkit.core.speedups`) replaces the functions that are marked. It handles the usual
values, and calls the function here for all others.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import InvalidValue, LimitExceeded, ProtocolError
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.speedups import EXTENSION, replaced_in_c
from orinkit.values import conversions
from orinkit.values.type_row import TypeRow
from orinkit.values.types import ARRAY, FORMATS, R8_ARRAY, ROWS, UI1_ARRAY, VARIANT_ARRAY, VarType, misfit, type_name
from orinkit.values.variant import Value, Variant, nested_too_deep, trusted, variant

_HEAD: Final = struct.Struct("<HI")  # type, count
_ARGUMENT: Final = struct.Struct("<IHI")  # length of the rest, type, count
_ARGUMENT_AT: Final = _ARGUMENT.unpack_from
_LENGTH: Final = struct.Struct("<I")


@record
class PacketLimits:
    """Limits of one packet; this project chose the defaults that the documents do not specify.

    Attributes:
        packet: Largest size of a packet and of one argument in bytes (VE026A table 3-5: 16 MBytes).
        depth: Largest nesting depth of VARIANT arrays.
        variants: Largest number of elements of all arrays in one packet, weighted by the time to read and release
            them: an element of a VARIANT, BSTR, DATE or CY array counts as one, 16 elements of an array of another type
            count as one, and the elements of a byte array do not count.
        vt_error_size: Size of a VT_ERROR in bytes: 4, or 2 in packets of a VE026A (VE026A table 3-1).
    """

    packet: int = 16 * 1024 * 1024
    depth: int = 16
    variants: int = 50_000
    vt_error_size: int = 4


DEFAULT_LIMITS: Final = PacketLimits()

if EXTENSION is not None:
    EXTENSION.set_codec(
        Variant,
        PacketLimits,
        DEFAULT_LIMITS,
        conversions.amount_to_wire,
        conversions.date_to_wire,
        conversions.amount_from_wire,
        conversions.to_datetime,
        conversions.lossless_datetime,
    )


# --- to bytes ---------------------------------------------------------------------------------------------------------


# These type codes are used for every set-point; plain numbers are faster than members of the enum.
_BSTR: Final = int(VarType.BSTR)
_SHORT: Final = 64
_SUPPLEMENTARY: Final = re.compile("[\U00010000-\U0010ffff]")
_SURROGATE_PAIR: Final = re.compile("[\ud800-\udbff][\udc00-\udfff]")
_SLICE: Final = 4096  # elements that are converted at a time, because the conversion blocks other threads


@lru_cache(maxsize=1024)
def _packer(vt: int, count: int) -> struct.Struct:
    """Return the :class:`struct.Struct` for a whole argument: length, type, count, elements."""
    return struct.Struct(f"<IHI{count}{FORMATS[vt & ~ARRAY]}")


@lru_cache(maxsize=256)
def _real_packer(count: int) -> Callable[..., bytes]:
    return partial(_packer(R8_ARRAY, count).pack, 6 + 8 * count, R8_ARRAY, count)


@lru_cache(maxsize=256)
def _real_unpacker(count: int) -> Callable[..., tuple[Any, ...]]:
    return struct.Struct(f"<{count}d").unpack_from


@lru_cache(maxsize=4096)
def _short_string(text: str) -> bytes:
    return _long_string(text)


def _long_string(text: str) -> bytes:
    data = text.encode("utf-16-le", "surrogatepass")
    return b"%b%b%b" % (_ARGUMENT.pack(len(data) + 10, _BSTR, 1), _LENGTH.pack(len(data)), data)


@replaced_in_c
def encode_string(text: str) -> bytes:
    """Return a string as one packet argument; short strings, for example names of commands, are cached.

    Raises:
        InvalidValue: If the value is not a string.
    """
    if type(text) is not str and not isinstance(text, str):
        raise misfit(VarType.BSTR, text)
    return _short_string(text) if len(text) < _SHORT else _long_string(text)


@replaced_in_c
def encode_integer(number: int) -> bytes:
    """Return a VT_I4 as one packet argument.

    Raises:
        InvalidValue: If the value is not a whole number, or exceeds the range of VT_I4.
    """
    try:
        return _I4_PACK(10, 3, 1, number)
    except (struct.error, TypeError):
        raise misfit(VarType.I4, number) from None


encode_handle: Final = lru_cache(maxsize=4096, typed=True)(encode_integer)
"""Cached variant of :func:`encode_integer`, for numbers that occur repeatedly."""


@replaced_in_c
def encode_single(number: float) -> bytes:
    """Return a VT_R4 as one packet argument.

    Raises:
        InvalidValue: If the value is not a number, or exceeds the range of VT_R4.
    """
    try:
        return _R4_PACK(10, 4, 1, number)
    except (struct.error, TypeError, OverflowError):
        raise misfit(VarType.R4, number) from None


@replaced_in_c
def encode(value: Value) -> bytes:
    """Return a value as one packet argument: length, type, count, data (VE026A 3.2).

    Raises:
        InvalidValue: If the value cannot be converted to a VARIANT.
    """
    exact_type = type(value)
    known: Any = value  # type checkers do not derive the type of value from exact_type
    if exact_type is list or exact_type is tuple:
        items: Sequence[Any] = known
        count = len(items)
        if count and list(map(type, items)).count(float) == count:
            return (
                _real_packer(count)(*items)
                if count <= _SHORT
                else _packer(R8_ARRAY, count).pack(6 + 8 * count, R8_ARRAY, count, *items)
            )
    elif exact_type is str:
        return encode_string(known)
    elif exact_type is int:
        return encode_integer(known)
    return encode_variant(variant(value))


_I4_PACK: Final = struct.Struct("<IHIi").pack
_R4_PACK: Final = struct.Struct("<IHIf").pack


@replaced_in_c
def encode_variant(item: Variant, vt_error_size: int = 4) -> bytes:
    """Return a :class:`Variant` as one packet argument; for ``vt_error_size`` see :class:`PacketLimits`.

    Raises:
        InvalidValue: If arrays are nested too deep, or a VT_ERROR does not fit ``vt_error_size``.
    """
    parts = [b""]
    try:
        _append(item.type, item.value, parts, vt_error_size)
    except RecursionError:
        raise nested_too_deep() from None
    parts[0] = _LENGTH.pack(sum(map(len, parts)))
    return b"".join(parts)


def _append(vt: int, value: Any, parts: list[bytes], vt_error_size: int) -> None:
    """Append type, count and data of a value to ``parts``, in the layout of an element inside a VARIANT array.

    b-CAP has no VT_VARIANT except as the type of an array; the value that it contains is written instead.
    """
    base = vt & ~ARRAY
    if vt == VarType.VARIANT:
        _append(value.type, value.value, parts, vt_error_size)
        return
    row = ROWS[base]
    items = value if vt & ARRAY else (value,)
    parts.append(_HEAD.pack(vt, len(items)))
    if base == VarType.VARIANT:
        for item in items:
            _append(item.type, item.value, parts, vt_error_size)
    elif base == VarType.BSTR:
        for text in items:
            data = _utf_16(text)
            parts.append(_LENGTH.pack(len(data)))
            parts.append(data)
    elif vt == UI1_ARRAY:
        parts.append(value)
    elif base == VarType.ERROR and vt_error_size == _SHORT_ERROR:
        parts.append(_short_errors(items))
    elif row.format is not None:
        convert = row.to_wire
        for at in range(0, len(items), _SLICE):
            piece = items[at : at + _SLICE]
            parts.append(struct.pack(f"<{len(piece)}{row.format}", *(map(convert, piece) if convert else piece)))


def _utf_16(text: str) -> bytes:
    if len(text) <= _SLICE:
        return text.encode("utf-16-le", "surrogatepass")
    return b"".join([_utf_16_slice(text[at : at + _SLICE]) for at in range(0, len(text), _SLICE)])


def _utf_16_slice(text: str) -> bytes:
    try:
        return text.encode("utf-16-le")
    except UnicodeEncodeError:  # there are unpaired surrogates, for each of which "surrogatepass" takes microseconds
        units = _SUPPLEMENTARY.sub(_split_pair, text)
        return struct.pack(f"<{len(units)}H", *map(ord, units))


def _split_pair(found: re.Match[str]) -> str:
    number = ord(found[0]) - 0x10000
    return chr(0xD800 | number >> 10) + chr(0xDC00 | number & 0x3FF)


def _short_errors(items: Sequence[int]) -> bytes:
    try:
        return struct.pack(f"<{len(items)}H", *items)
    except struct.error:
        raise InvalidValue(
            tr("a VT_ERROR in packets of a VE026A has 2 bytes: it must be 0 to 0xFFFF, not {code:#x}", code=max(items))
        ) from None


_SHORT_ERROR: Final = 2


# --- from bytes -------------------------------------------------------------------------------------------------------


def _packet_error(text: str, code: int = hresult.E_INVALIDRCVPACKET) -> ProtocolError:
    return ProtocolError(text, code)


@replaced_in_c
def decode(data: bytes, position: int = 0, end: int | None = None, limits: PacketLimits = DEFAULT_LIMITS, *, exact: bool = False, budget: list[int] | None = None) -> tuple[Any, int]:  # fmt: skip
    """Read one packet argument; return its value and the position after it.

    Args:
        data: The bytes.
        position: Position of the argument's length field.
        end: Position that the argument must not exceed; the end of ``data`` by default.
        limits: Limits of the packet.
        exact: True to return a :class:`Variant` instead of a plain value.
        budget: Number of further elements that the packet may contain, as a list of one number, which this function
            decrements; :attr:`PacketLimits.variants` by default.

    Raises:
        ProtocolError: If the bytes are not a valid argument; its ``code`` is the return code that a server sends to the
            client (VE026A table 3-5).
    """
    if end is None:
        end = len(data)
    if end - position < 10:
        raise _packet_error(
            tr(
                "an argument requires 10 bytes or more, {left} are left at offset {position}",
                left=end - position,
                position=position,
            ),
        )
    length, vt, count = _ARGUMENT_AT(data, position)
    stop = position + 4 + length
    if vt == R8_ARRAY and not exact and length == 6 + 8 * count and stop <= end and length <= limits.packet:
        return list(_real_unpacker(count)(data, position + 10)), stop  # the most frequent case: set-points
    if exact and stop <= end and length <= limits.packet:
        frequent = _frequent(data, position + 10, length, vt, count, [limits.variants] if budget is None else budget)
        if frequent is not None:
            return frequent, stop
    if length > limits.packet:
        raise LimitExceeded(
            tr(
                "argument of {length} bytes at offset {position}, at most {most} are allowed",
                length=length,
                position=position,
                most=limits.packet,
            ),
            hresult.E_ARGSIZEOVER,
        )
    if stop > end or length < 6:
        raise _packet_error(
            tr(
                "argument length {length} at offset {position} does not match the {present} bytes that follow",
                length=length,
                position=position,
                present=end - position - 4,
            ),
        )
    reader = _ValueReader(data, stop, limits, exact)
    if budget is not None:
        reader.left = budget[0]
    value, after = reader.read(vt, count, position + 10, 0)
    if budget is not None:
        budget[0] = reader.left
    if after != stop:
        raise _count_mismatch(vt, count, position, length - 6)
    return (trusted(vt, value) if exact else value), stop


_I4: Final = int(VarType.I4)
_I4_AT: Final = struct.Struct("<i").unpack_from
_LENGTH_AT: Final = _LENGTH.unpack_from


def _frequent(data: bytes, at: int, length: int, vt: int, count: int, budget: list[int]) -> Variant | None:
    """Return a VT_I4, VT_BSTR, VT_EMPTY or short array of VT_R8, the usual arguments; ``None`` for anything else.

    The result is that of :class:`_ValueReader`; invalid data is not read here.
    """
    if vt == _I4:
        return trusted(vt, _I4_AT(data, at)[0]) if length == 10 and count == 1 else None  # counts as 0 elements
    if vt == _EMPTY:
        return trusted(vt, None) if length == _NO_DATA and count == 1 else None
    if vt == R8_ARRAY:
        cost = count // _REALS_PER_UNIT
        if length != 6 + 8 * count or count > _SHORT or budget[0] < cost:
            return None
        budget[0] -= cost
        return trusted(vt, list(_real_unpacker(count)(data, at)))
    if vt == _BSTR and count == 1 and 10 <= length <= _FEW_BYTES and budget[0] > 0:
        (size,) = _LENGTH_AT(data, at)
        if size + 10 == length and not size % 2:
            budget[0] -= 1
            return trusted(vt, data[at + 4 : at + 4 + size].decode("utf-16-le", "surrogatepass"))
    return None


_EMPTY: Final = int(VarType.EMPTY)
_NO_DATA: Final = 6
_REALS_PER_UNIT: Final = ROWS[VarType.R8].elements_per_unit
_FEW_BYTES: Final = 1024


def _count_mismatch(vt: int, count: int, position: int, present: int) -> ProtocolError:
    return _packet_error(
        tr(
            "at offset {position}, {present} bytes of data do not match {count} x {type}",
            count=count,
            type=type_name(vt),
            position=position,
            present=present,
        ),
    )


def _text(data: bytes) -> str:
    if len(data) <= 2 * _SLICE:
        return data.decode("utf-16-le", "surrogatepass")
    pieces = []
    at = 0
    while at < len(data):
        end = at + 2 * _SLICE
        if end < len(data) and 0xD8 <= data[end - 1] <= 0xDB:  # the first half of a surrogate pair
            end -= 2
        pieces.append(_text_slice(data[at:end]))
        at = end
    return "".join(pieces)


def _text_slice(data: bytes) -> str:
    try:
        return data.decode("utf-16-le")
    except UnicodeDecodeError:  # an unpaired surrogate
        return _SURROGATE_PAIR.sub(_join_pair, "".join(map(chr, struct.unpack(f"<{len(data) // 2}H", data))))


def _join_pair(found: re.Match[str]) -> str:
    high, low = map(ord, found[0])
    return chr(0x10000 + ((high & 0x3FF) << 10 | low & 0x3FF))


def _unpacked(code: str, data: bytes, position: int, count: int) -> Sequence[Any]:
    if count <= _SLICE:
        return struct.unpack_from(f"<{count}{code}", data, position)
    items: list[Any] = []
    size = struct.calcsize(f"<{code}")
    for at in range(0, count, _SLICE):
        items += struct.unpack_from(f"<{min(_SLICE, count - at)}{code}", data, position + at * size)
    return items


class _ValueReader:
    """Reads the data of one argument, up to the end of the argument."""

    __slots__ = ("data", "end", "exact", "left", "limits")

    def __init__(self, data: bytes, end: int, limits: PacketLimits, exact: bool) -> None:
        self.data, self.end, self.limits, self.exact = data, end, limits, exact
        self.left = limits.variants

    def read(self, vt: int, count: int, position: int, depth: int) -> tuple[Any, int]:
        base = vt & ~ARRAY
        array = bool(vt & ARRAY)
        if not array and count != 1:
            raise _count_mismatch(vt, count, position, self.end - position)
        row = ROWS.get(base)
        if row is not None and row.format is not None:
            size = self.limits.vt_error_size if base == VarType.ERROR else row.size
            after = position + size * count
            if after > self.end:
                raise _count_mismatch(vt, count, position, self.end - position)
            self._spend(count // row.elements_per_unit)
            return self._fixed(row, row.format, array, count, position), after
        if base == VarType.BSTR:
            return self._strings(array, count, position)
        if base == VarType.VARIANT and array:
            return self._variants(count, position, depth)
        if row is not None and row.empty and not array:
            return None, position
        raise _packet_error(
            tr("unknown type {type} at offset {position}", type=type_name(vt), position=position),
            hresult.E_INVALIDARGTYPE,
        )

    def _fixed(self, row: TypeRow, layout: str, array: bool, count: int, position: int) -> Any:
        if array and row.code == VarType.UI1:
            with memoryview(self.data) as view:
                return bytes(view[position : position + count])
        if row.code == VarType.ERROR and self.limits.vt_error_size == _SHORT_ERROR:
            layout = "H"
        items = _unpacked(layout, self.data, position, count)
        convert = (row.from_wire_exact if self.exact else None) or row.from_wire
        if convert is not None:
            items = list(map(convert, items))
        if array:
            return items if isinstance(items, list) else list(items)
        (item,) = items
        return item

    def _spend(self, count: int) -> None:
        self.left -= count
        if self.left < 0:
            raise LimitExceeded(
                tr("more than {most} elements in one packet", most=self.limits.variants),
                hresult.E_ARGSIZEOVER,
            )

    def _strings(self, array: bool, count: int, position: int) -> tuple[Any, int]:
        self._spend(count)
        texts = []
        for _ in range(count):
            if position + 4 > self.end:
                raise _count_mismatch(VarType.BSTR, count, position, self.end - position)
            (length,) = _LENGTH.unpack_from(self.data, position)
            after = position + 4 + length
            if after > self.end or length % 2:
                raise _packet_error(
                    tr(
                        "the length of the string at offset {position} must be even and at most {present} bytes, "
                        "not {length}",
                        length=length,
                        position=position,
                        present=self.end - position - 4,
                    ),
                )
            texts.append(_text(self.data[position + 4 : after]))
            position = after
        return (texts if array else texts[0]), position

    def _variants(self, count: int, position: int, depth: int) -> tuple[Any, int]:
        if depth >= self.limits.depth:
            raise LimitExceeded(
                tr("VARIANT arrays nested deeper than {depth}", depth=self.limits.depth),
                hresult.E_INVALIDARGTYPE,
            )
        self._spend(count)
        items = []
        for _ in range(count):
            if position + 6 > self.end:
                raise _count_mismatch(VARIANT_ARRAY, count, position, self.end - position)
            vt, inner = _HEAD.unpack_from(self.data, position)
            value, position = self.read(vt, inner, position + 6, depth + 1)
            items.append(trusted(vt, value) if self.exact else value)
        return items, position
