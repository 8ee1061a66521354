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
from orinkit.values.types import R8_ARRAY, VarType

MOST_ITEMS: Final = 64
"""Largest number of elements of the lists for which layouts are stored."""

Layout: TypeAlias = tuple[Callable[..., bytes], bytes, bytes]
"""Layout of a packet: the packing function, the bytes before the serial, and the bytes between serial and values."""

_ARGUMENT: Final = struct.Struct("<IHI").pack  # length of the rest, type, count
_REST: Final = struct.Struct("<HIH").pack  # reserved, function id or return code, argument count
_START: Final = struct.Struct("<BI").pack
_SCALARS: Final[dict[type, tuple[int, str]]] = {float: (VarType.R8, "d"), int: (VarType.I4, "i")}


class RequestTemplate:
    """The packets of a call whose last argument alone varies, or of a call without varying arguments.

    The layouts of the packets are stored by the types in the varying argument, so that a further call with the same
    types only fills in the serial and the numbers.

    Args:
        function_id: ID of the function.
        count: number of arguments, including the varying one.
        constants: the encoded constant arguments.
        varies: whether there is a varying argument, of type VARIANT.
        most: largest size of a packet, bytes.
    """

    __slots__ = ("_constants", "_count", "_function_id", "_layouts", "_most", "_whole")

    def __init__(self, function_id: int, count: int, constants: bytes, *, varies: bool, most: int) -> None:
        self._function_id = function_id
        self._count = count
        self._constants = constants
        self._most = most
        self._layouts: dict[object, Layout] = {}
        self._whole: Layout | None = None
        if varies:
            empty = _ARGUMENT(6, VarType.EMPTY, 1)
            self._whole = self._layout(empty, "", 0)
            for kind, (vt, code) in _SCALARS.items():
                self._store(kind, vt, 1, code)
        else:
            self._whole = self._layout(b"", "", 0)

    def request(self, serial: int, value: Any = None) -> bytes | None:
        """Return the packet of a call; ``None`` if no layout is stored for the types in ``value``.

        Args:
            serial: serial of the request.
            value: varying argument; ``None`` for VT_EMPTY, and for a call without a varying argument.
        """
        kind = type(value)
        if kind is list or kind is tuple:
            kinds = tuple(map(type, value))
            layout = self._layouts.get(kinds) or self._learn(kinds)
            if layout is None:
                return None
            pack, start, middle = layout
            return pack(start, serial, middle, *value, packet.EOT)
        if value is None:
            layout = self._whole
            if layout is None:
                return None
            pack, start, middle = layout
            return pack(start, serial, middle, packet.EOT)
        layout = self._layouts.get(kind)
        if layout is None:
            return None
        pack, start, middle = layout
        try:
            return pack(start, serial, middle, value, packet.EOT)
        except struct.error:  # an integer beyond the range of VT_I4
            return None

    def _learn(self, kinds: tuple[type, ...]) -> Layout | None:
        """Store and return the layout for a list of ``float``; return ``None`` for any other list."""
        count = len(kinds)
        if not self._layouts or not 0 < count <= MOST_ITEMS or kinds.count(float) != count:
            return None
        return self._store(kinds, R8_ARRAY, count, f"{count}d")

    def _store(self, key: object, vt: int, count: int, code: str) -> Layout | None:
        size = struct.calcsize(f"<{code}")
        layout = self._layout(_ARGUMENT(6 + size, vt, count), code, size)
        if layout is not None:
            self._layouts[key] = layout
        return layout

    def _layout(self, head: bytes, code: str, size: int) -> Layout | None:
        """Return the layout of a packet; ``None`` if the packet exceeds the limit."""
        middle = _REST(0, self._function_id, self._count) + self._constants + head
        length = 5 + 2 + len(middle) + size + 1
        if length > self._most:
            return None
        return struct.Struct(f"<5sH{len(middle)}s{code}B").pack, _START(packet.SOH, length), middle


# --- replies ----------------------------------------------------------------------------------------------------------

Reply: TypeAlias = tuple[Callable[[bytes], tuple[Any, ...]], bytes, bytes]
"""Layout of a reply: the unpacking function, the bytes before the serial, and the bytes between serial and value."""


def _reply(vt: int, count: int, code: str) -> Reply:
    size = struct.calcsize(f"<{code}")
    middle = _REST(0, 0, 1) + _ARGUMENT(6 + size, vt, count)
    length = 5 + 2 + len(middle) + size + 1
    return struct.Struct(f"<5sH{len(middle)}s{code}B").unpack, _START(packet.SOH, length), middle


NUMBERS: Final = {26 + 8 * count: _reply(R8_ARRAY, count, f"{count}d") for count in range(2, MOST_ITEMS + 1)}
"""Replies with S_OK and an array of VT_R8, by their size in bytes."""

NUMBER: Final = {
    26 + struct.calcsize(f"<{code}"): _reply(vt, 1, code) for vt, code in ((VarType.I4, "i"), (VarType.R8, "d"))
}
"""Replies with S_OK and a single number, by their size in bytes. No size is also in :data:`NUMBERS`."""
