"""Arguments that take long to process: every VARIANT type at the largest size, as scalar, as array, and nested."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final

from orinkit.bcap import packet
from orinkit.values.codec import DEFAULT_LIMITS, encode
from orinkit.values.types import ARRAY, FORMATS, VarType
from support.peers import RawClient

MOST: Final = DEFAULT_LIMITS.packet - 1024
"""Size of the largest argument in bytes; leaves room for other arguments."""

_ELEMENTS: Final = DEFAULT_LIMITS.variants
_ARRAY_OF_VARIANTS: Final = int(VarType.VARIANT | ARRAY)
_TEXTS: Final = {
    "control characters": "\x1b", "letters": "a", "digits": "1", "kana": "\u3042", "emoji": "\U0001f600",
    "surrogates": "\ud800", "commas": ",", "brackets": "()", "quotes": '"', "blanks": " ", "poses": "P1,",
}  # fmt: skip


def argument(vt: int, count: int, data: bytes) -> bytes:
    """Return an argument in the format of packets."""
    return struct.pack("<IHI", len(data) + 6, vt, count) + data


def text(sign: str, size: int = MOST) -> bytes:
    """Return a VT_BSTR of about ``size`` bytes."""
    one = sign.encode("utf-16-le", "surrogatepass")
    data = one * ((size - 16) // len(one))
    return argument(VarType.BSTR, 1, struct.pack("<I", len(data)) + data)


def texts() -> Iterator[tuple[str, bytes]]:
    """Yield long texts with their descriptions."""
    for name, sign in _TEXTS.items():
        yield f"text of {name}", text(sign)


def arrays() -> Iterator[tuple[str, bytes]]:
    """Yield arrays of the largest size with their descriptions, including nested ones."""
    yield "VT_UI1", argument(VarType.UI1 | ARRAY, MOST, bytes(MOST))
    for vt, code in FORMATS.items():
        if vt != VarType.UI1:
            one = struct.pack("<" + code, 12345.678 if code in "fd" else 100 if code in "bB" else 30000)
            count = _ELEMENTS if vt in (VarType.CY, VarType.DATE) else min(16 * _ELEMENTS, MOST // len(one))
            yield VarType(vt).name, argument(vt | ARRAY, count, one * count)
    yield "dates out of range", argument(VarType.DATE | ARRAY, _ELEMENTS, struct.pack("<d", 1e300) * _ELEMENTS)
    yield "texts", argument(VarType.BSTR | ARRAY, _ELEMENTS, (struct.pack("<I", 2) + b"P\0") * _ELEMENTS)
    inner = struct.pack("<HI", VarType.EMPTY, 1)
    yield "nothings", argument(_ARRAY_OF_VARIANTS, _ELEMENTS, inner * _ELEMENTS)
    dated = struct.pack("<HId", VarType.DATE, 1, 45000.1)
    yield "dates in VARIANTs", argument(_ARRAY_OF_VARIANTS, _ELEMENTS // 2, dated * (_ELEMENTS // 2))
    for _ in range(14):
        inner = struct.pack("<HI", _ARRAY_OF_VARIANTS, 1) + inner
    yield "deep", argument(_ARRAY_OF_VARIANTS, _ELEMENTS // 16, inner * (_ELEMENTS // 16))


def ask(client: RawClient, function: int, *arguments: object) -> int:
    """Send a call and return its return code; arguments of type bytes are put into the packet unchanged."""
    body = b"".join(each if isinstance(each, bytes) else encode(each) for each in arguments)
    client.send(packet.pack(7, function, len(arguments), body))
    return int(packet.HEADER.unpack_from(client.frame())[4])
