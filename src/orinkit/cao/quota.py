"""Limits on the data that clients store on a server: tags, IDs, and parameters of commands."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, SIZES, VarType
from orinkit.values.variant import Variant

KEPT: Final = ("put_tag", "put_id", "put_parameters")
"""Methods whose value is stored with the object."""

MOST: Final = 64 * 1024
"""Limit on one value, bytes in a packet."""
MOST_OF_A_CLIENT: Final = 1024 * 1024
MOST_OF_ALL: Final = 16 * 1024 * 1024
"""Limit on the values of one client and of all clients of a server, bytes in packets; up to twelve times that in memory."""


class ByteQuota:
    """Counts the bytes stored for one client, or for all clients.

    Args:
        most: the limit, bytes.
        of_all: the quota of all clients, which is counted too.

    Attributes:
        bytes: number of stored bytes.
    """

    def __init__(self, most: int = MOST_OF_ALL, of_all: ByteQuota | None = None) -> None:
        self.bytes = 0
        self._most = most
        self._of_all = of_all

    def change(self, more: int) -> None:
        """Add to the count.

        Args:
            more: number of bytes, negative to subtract.

        Raises:
            CallError: E_OUTOFMEMORY if the limit would be exceeded; then nothing is counted.
        """
        if more > 0 and self.bytes + more > self._most:
            raise error_for(
                hresult.E_OUTOFMEMORY,
                tr(
                    "tags and parameters of {bytes} bytes exceed the limit of {most} bytes. Try: store less in tags, "
                    "or clear those no longer needed",
                    bytes=self.bytes + more,
                    most=self._most,
                ),
            )
        if self._of_all is not None:
            self._of_all.change(more)
        self.bytes += more


def size_to_keep(value: Variant) -> int:
    """Return the size of a value in a packet, bytes.

    Raises:
        CallError: E_TOO_MUCH_DATA if the size exceeds :data:`MOST`; counting stops at that point.
    """
    size = 0
    rest = [value]
    while rest:
        item = rest.pop()
        base = item.type & ~ARRAY
        items = item.value if item.type & ARRAY else (item.value,)
        size += _HEAD + len(items) * SIZES.get(base, 0)
        if base == VarType.BSTR:
            size += sum(_LENGTH + 2 * len(text) for text in items)
        if size > MOST:
            raise _too_much()
        if base == VarType.VARIANT:
            if _HEAD * len(items) > MOST:
                raise _too_much()
            rest += items
    return size


_HEAD: Final = 6  # type and count
_LENGTH: Final = 4


def _too_much() -> CallError:
    return error_for(
        hresult.E_TOO_MUCH_DATA,
        tr("a tag or a command's parameters exceed the limit of {most} bytes. Try: store less in one value", most=MOST),
    )
