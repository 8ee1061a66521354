"""What clients have servers keep for them, tags, IDs and parameters of commands: how much that may be."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, SIZES, VarType
from orinkit.values.variant import Variant

KEPT: Final = ("put_tag", "put_id", "put_parameters")
"""Methods whose value stays with the object."""

MOST: Final = 64 * 1024
"""Bytes of one value, as it is in a packet."""
MOST_OF_A_CLIENT: Final = 1024 * 1024
MOST_OF_ALL: Final = 16 * 1024 * 1024
"""Bytes of the values of one client, of all clients of a server. In memory a value takes up to about twelve times as much."""


class ByteQuota:
    """Counts the bytes that are kept for one client, or for all.

    Args:
        most: how many there may be.
        of_all: counts those of all clients too.

    Attributes:
        bytes: that are kept.
    """

    def __init__(self, most: int = MOST_OF_ALL, of_all: ByteQuota | None = None) -> None:
        self.bytes = 0
        self._most = most
        self._of_all = of_all

    def change(self, more: int) -> None:
        """Count so many more bytes, or fewer.

        Raises:
            CallError: E_OUTOFMEMORY, they would be too many; nothing has been counted.
        """
        if more > 0 and self.bytes + more > self._most:
            raise error_for(
                hresult.E_OUTOFMEMORY,
                tr(
                    "tags and parameters of {bytes} bytes, at most {most} are kept. Try: store less in tags, "
                    "or clear those no longer needed",
                    bytes=self.bytes + more,
                    most=self._most,
                ),
            )
        if self._of_all is not None:
            self._of_all.change(more)
        self.bytes += more


def size_to_keep(value: Variant) -> int:
    """Return how many bytes a value has in a packet.

    Raises:
        CallError: E_TOO_MUCH_DATA, more than :data:`MOST`; they are not counted to the end.
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
        tr("a tag, or the parameters of a command, of more than {most} bytes. Try: store less in one value", most=MOST),
    )
