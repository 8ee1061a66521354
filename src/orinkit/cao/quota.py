"""Limits on the data that clients store on a server: tags, IDs, and parameters of commands."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, SIZES, VarType
from orinkit.values.variant import Variant

STORING_METHODS: Final = ("put_tag", "put_id", "put_parameters")
"""Names of the methods whose argument the server stores with the object."""

VALUE_LIMIT: Final = 64 * 1024
"""Limit on the size of one value, as it is encoded in a packet, bytes."""
CLIENT_LIMIT: Final = 1024 * 1024
TOTAL_LIMIT: Final = 16 * 1024 * 1024
"""Limits on the total size of the values of one client (CLIENT_LIMIT) and of all clients of a server (TOTAL_LIMIT).

The sizes are those of the values as encoded in packets, bytes. In memory, values require up to twelve times as much.
"""


class ByteQuota:
    """Counts the bytes stored for one client, or for all clients.

    Args:
        limit: the limit, bytes.
        total: for the quota of one client, the quota of all clients, which counts the same bytes; otherwise ``None``.

    Attributes:
        bytes: number of stored bytes.
    """

    def __init__(self, limit: int = TOTAL_LIMIT, total: ByteQuota | None = None) -> None:
        self.bytes = 0
        self._limit = limit
        self._total = total

    def change(self, more: int) -> None:
        """Add to the count.

        Args:
            more: number of bytes, negative to subtract.

        Raises:
            CallError: E_OUTOFMEMORY if the limit would be exceeded. The count is then unchanged.
        """
        if more > 0 and self.bytes + more > self._limit:
            raise error_for(
                hresult.E_OUTOFMEMORY,
                tr(
                    "tags and parameters of {bytes} bytes exceed the limit of {most} bytes. Try: store less in tags, "
                    "or clear those no longer needed",
                    bytes=self.bytes + more,
                    most=self._limit,
                ),
            )
        if self._total is not None:
            self._total.change(more)
        self.bytes += more


def stored_size(value: Variant) -> int:
    """Return the size of a value in a packet, bytes.

    Raises:
        CallError: E_TOO_MUCH_DATA if the size exceeds :data:`VALUE_LIMIT`; counting stops at that point.
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
        if size > VALUE_LIMIT:
            raise _too_much()
        if base == VarType.VARIANT:
            if _HEAD * len(items) > VALUE_LIMIT:
                raise _too_much()
            rest += items
    return size


_HEAD: Final = 6  # bytes of type and count
_LENGTH: Final = 4


def _too_much() -> CallError:
    return error_for(
        hresult.E_TOO_MUCH_DATA,
        tr(
            "a tag or a command's parameters exceed the limit of {most} bytes. Try: store less in one value",
            most=VALUE_LIMIT,
        ),
    )
