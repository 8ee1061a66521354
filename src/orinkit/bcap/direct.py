"""The direct path of a call: packets of prepared calls, and the values of the most frequent replies. No I/O.

A direct call does without the generator of :class:`~orinkit.bcap.client.BcapConversation`: the client creates the
request, sends it, receives once, and reads the reply. This path ends with the first unusual event. The generator
:meth:`~orinkit.bcap.client.BcapConversation.resume` then continues the call, so that its behaviour has one definition.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from orinkit.bcap import packet
from orinkit.cao.table import Function
from orinkit.core.speedups import native_request, native_template
from orinkit.values.types import R8_ARRAY, VarType

MOST_ITEMS: Final = 64
"""Largest number of elements of the lists for which layouts are stored."""

Layout: TypeAlias = tuple[Callable[..., bytes], bytes, bytes]
"""Layout of a packet: the packing function, the bytes before the serial, and the bytes between serial and values."""

_ARGUMENT: Final = struct.Struct("<IHI").pack  # length of the rest, type, count
_REST: Final = struct.Struct("<HIH").pack  # reserved, function id or return code, argument count
_START: Final = struct.Struct("<BI").pack
_FIXED: Final = 5 + 2 + 1  # bytes before the serial, serial, EOT
_NONE: Final = type(None)
_SCALARS: Final[dict[type, tuple[int, str]]] = {float: (VarType.R8, "d"), int: (VarType.I4, "i")}


class RequestTemplate:
    """The packets of a call whose last argument alone varies, or of a call without varying arguments.

    The layouts of the packets are stored by the types in the varying argument, so that a further call with the same
    types only fills in the serial and the numbers.

    Args:
        function: an entry of the table of functions.
        count: number of arguments, including the varying one.
        constants: the encoded constant arguments.
        varies: True if there is a varying argument, of type VARIANT.
        most: largest size of a packet, bytes.

    Attributes:
        native: the template of the extension in C; ``None`` without it.
    """

    __slots__ = ("_constants", "_count", "_function_id", "_layouts", "_most", "_varies", "native")

    def __init__(self, function: Function[..., Any], count: int, constants: bytes, *, varies: bool, most: int) -> None:
        self._function_id = function.id
        self._count = count
        self._constants = constants
        self._varies = varies
        self._most = most
        self._layouts: dict[object, Layout | None] = {}
        self.native = native_template(function, count, constants, varies, most)

    def request(self, serial: int, value: Any = None) -> bytes | None:
        """Return the packet of a call; ``None`` if there is no layout for the types in ``value``.

        The extension in C needs no layouts, and returns the packet for more types.

        Args:
            serial: serial of the request.
            value: varying argument; ``None`` for VT_EMPTY, and for a call without a varying argument.
        """
        if native_request is not None:
            return native_request(self.native, serial, value)
        kind: Any = type(value)
        if kind is list or kind is tuple:
            kinds = tuple(map(type, value))
            layout = self._layouts.get(kinds) or self._learn(kinds)
            if layout is None:
                return None
            pack, start, middle = layout
            return pack(start, serial, middle, *value, packet.EOT)
        layout = self._layouts.get(kind) or self._learn(kind)
        if layout is None:
            return None
        pack, start, middle = layout
        if value is None:
            return pack(start, serial, middle, packet.EOT)
        try:
            return pack(start, serial, middle, value, packet.EOT)
        except struct.error:  # an integer beyond the range of VT_I4
            return None

    def _learn(self, key: Any) -> Layout | None:
        """Store and return the layout for a type, or for a list with these types; ``None`` if there is no layout.

        Layouts exist for ``None``, ``int``, ``float``, and lists of ``float``.
        """
        if key is _NONE:
            head = _ARGUMENT(6, VarType.EMPTY, 1) if self._varies else b""
            return self._store(key, head, "", 0)
        if not self._varies:
            return None
        if key in _SCALARS:
            return self._store(key, *_argument(*_SCALARS[key]))
        if type(key) is tuple and 0 < len(key) <= MOST_ITEMS and key.count(float) == len(key):
            return self._store(key, *_argument(R8_ARRAY, f"{len(key)}d", len(key)))
        return None

    def _store(self, key: object, head: bytes, code: str, size: int) -> Layout | None:
        """Store and return a layout; return ``None`` if the packet exceeds the limit.

        Args:
            key: types for which the layout is valid.
            head: length, type and count of the varying argument.
            code: format of its numbers.
            size: size of its numbers, bytes.
        """
        middle = _REST(0, self._function_id, self._count) + self._constants + head
        length = _FIXED + len(middle) + size
        if length > self._most:
            return None
        layout = struct.Struct(f"<5sH{len(middle)}s{code}B").pack, _START(packet.SOH, length), middle
        self._layouts[key] = layout
        return layout


def _argument(vt: int, code: str, count: int = 1) -> tuple[bytes, str, int]:
    """Return the head of an argument, the format of its numbers, and their size in bytes."""
    size = struct.calcsize(f"<{code}")
    return _ARGUMENT(6 + size, vt, count), code, size


# --- replies ----------------------------------------------------------------------------------------------------------

Reply: TypeAlias = tuple[Callable[[bytes], tuple[Any, ...]], bytes, bytes]
"""Layout of a reply: the unpacking function, the bytes before the serial, and the bytes between serial and value."""


def _reply(vt: int, code: str, count: int = 1) -> Reply:
    head, code, size = _argument(vt, code, count)
    middle = _REST(0, 0, 1) + head
    length = _FIXED + len(middle) + size
    return struct.Struct(f"<5sH{len(middle)}s{code}B").unpack, _START(packet.SOH, length), middle


NUMBERS: Final = {26 + 8 * count: _reply(R8_ARRAY, f"{count}d", count) for count in range(2, MOST_ITEMS + 1)}
"""Replies with S_OK and an array of VT_R8, by their size in bytes."""

SCALAR: Final = {
    26 + struct.calcsize(f"<{code}"): (_reply(vt, code), convert)
    for vt, code, convert in ((VarType.I4, "i", None), (VarType.R8, "d", None), (VarType.BOOL, "h", bool))
}
"""Replies with S_OK and a single value, with the conversion of the value, by their size in bytes.

No size is also in :data:`NUMBERS`.
"""
