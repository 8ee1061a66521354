"""Divides received bytes of any kind into packets and other data, without I/O."""

from __future__ import annotations

from typing import Final

from orinkit.bcap import packet
from orinkit.values.codec import DEFAULT_LIMITS

MOST_BYTES: Final = DEFAULT_LIMITS.packet
"""Maximum size of a piece, bytes."""
_ANNOUNCED: Final = 5  # bytes from SOH to the end of the length field


class PieceFramer:
    """Extracts pieces from a byte stream: b-CAP packets by their length field, and the data between them.

    Nothing is rejected. Data that does not begin like a packet is a piece that ends before the next possible packet.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Number of bytes of an incomplete packet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Add received bytes and return the complete pieces."""
        self._buffer += data
        pieces: list[bytes] = []
        at = 0
        while (size := self._size(at)) > 0:
            pieces.append(bytes(self._buffer[at : at + size]))
            at += size
        del self._buffer[:at]
        return pieces

    def flush(self) -> bytes:
        """Return the incomplete packet and forget it."""
        rest = bytes(self._buffer)
        self._buffer.clear()
        return rest

    def _size(self, at: int) -> int:
        """Return the size of the piece at a position; 0 if more bytes are needed."""
        left = len(self._buffer) - at
        if not left:
            return 0
        start = self._next_start(at)
        if start > at:
            return start - at
        if left < _ANNOUNCED:
            return 0
        (length,) = packet.LENGTH.unpack_from(self._buffer, at + 1)
        return int(length) if left >= length else 0

    def _next_start(self, at: int) -> int:
        """Return the position of the next SOH that may begin a packet; the end of the data if there is none."""
        start = self._buffer.find(packet.SOH, at)
        while 0 <= start <= len(self._buffer) - _ANNOUNCED:
            (length,) = packet.LENGTH.unpack_from(self._buffer, start + 1)
            if packet.OVERHEAD <= length <= MOST_BYTES:
                break
            start = self._buffer.find(packet.SOH, start + 1)
        return len(self._buffer) if start < 0 else start
