"""Framing on a serial line (b-CAP/COM, VE026A 3.1), where bytes may be lost, corrupted, or added by noise."""

from __future__ import annotations

from typing import Final

from orinkit.bcap import packet
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.core.errors import LimitExceeded
from orinkit.core.i18n import tr
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

LEAST: Final = packet.OVERHEAD + 2
"""Bytes of a packet without arguments."""

_MAX_WORK: Final = 1 << 20  # bytes of wrong checksums computed before the buffer is discarded
_LAST_FUNCTION: Final = len(FUNCTIONS)
_MAX_ARGUMENTS: Final = 8
_HEAD: Final = packet.HEADER.size


class LineFramer(packet.FramerBase):
    """Finds packets between noise: each must be complete and have a correct CRC.

    If a sequence of bytes is not a packet, the search continues right after its first byte, so that no packet is lost with
    the noise before it. A length caused by noise may announce bytes that never arrive; the caller calls :meth:`timeout`
    after a period of silence on the line.

    Args:
        limits: bounds on a packet.
        reports_too_long: raise an exception if a request is announced that exceeds the limit, so that a server can send a
            reply; a client treats it as noise.

    Attributes:
        limits: bounds on a packet.
        skipped_bytes: number of bytes received outside any packet.
    """

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS, *, reports_too_long: bool = False) -> None:
        super().__init__(limits)
        self.skipped_bytes = 0
        self._reports_too_long = reports_too_long
        self._reported = False  # whether the buffered data has been reported
        self._work = 0

    @property
    def partial_serial(self) -> int:
        """Probable serial of the incomplete packet; 0 if unknown."""
        if len(self._buffer) < _HEAD:
            return 0
        serial: int = packet.HEADER.unpack_from(self._buffer)[2]
        return serial

    def feed(self, data: bytes) -> bytes | None:
        """Add received bytes and return the first complete packet; :meth:`next_frame` returns the others.

        Raises:
            LimitExceeded: See :meth:`next_frame`.
        """
        self._buffer += data
        return self.next_frame()

    def next_frame(self) -> bytes | None:
        """Return the next complete packet, or ``None`` if more bytes are needed.

        Raises:
            LimitExceeded: If a request is announced that exceeds the limit; its first byte is skipped. Raised once for the
                same buffered data.
        """
        buffer = self._buffer
        while buffer:
            if buffer[0] != packet.SOH:
                start = buffer.find(packet.SOH)
                self._skip(len(buffer) if start < 0 else start)
                continue
            if len(buffer) < 5:
                return None
            (length,) = packet.LENGTH.unpack_from(buffer, 1)
            if length > self.limits.packet:
                if len(buffer) < _HEAD:
                    return None
                self._refuse(length)
            elif length < LEAST:
                self._skip(1)
            elif len(buffer) < length:
                return None
            elif (frame := self._whole(length)) is not None:
                return frame
        return None

    def resync(self) -> bytes | None:
        """Return a complete packet that follows the header of an incomplete one, and skip everything before it.

        This is for a header caused by noise, on a line that is never silent. A packet that contains other packets in its
        arguments looks the same, so call this only if a packet takes far too long.
        """
        buffer = self._buffer
        start = buffer.find(packet.SOH, 1)
        while 0 < start <= len(buffer) - LEAST:
            (length,) = packet.LENGTH.unpack_from(buffer, start + 1)
            end = start + length
            if length >= LEAST and end <= len(buffer) and buffer[end - 1] == packet.EOT:
                frame = bytes(buffer[start:end])
                if packet.has_correct_crc(frame):
                    self._skip(start)
                    del buffer[:length]
                    return frame
            start = buffer.find(packet.SOH, start + 1)
        return None

    def timeout(self) -> bytes | None:
        """Abandon the incomplete packet, and return a complete packet found inside it.

        Raises:
            LimitExceeded: See :meth:`next_frame`.
        """
        while self._buffer:
            self._skip(1)
            frame = self.next_frame()
            if frame is not None:
                return frame
        return None

    def _whole(self, length: int) -> bytes | None:
        """Return the packet at the beginning of the buffer; if it is not valid, skip its first byte."""
        buffer = self._buffer
        if buffer[length - 1] == packet.EOT:
            frame = bytes(buffer[:length])
            if packet.has_correct_crc(frame):
                del buffer[:length]
                self._work = 0
                self._reported = False
                return frame
            self._work += length
        self._skip(len(buffer) if self._work > _MAX_WORK else 1)
        return None

    def _refuse(self, length: int) -> None:
        """Skip the first byte of an announced packet that exceeds the limit: noise, unless it looks like a request."""
        _, _, serial, _, function, count = packet.HEADER.unpack_from(self._buffer)
        request = serial and 1 <= function <= _LAST_FUNCTION and count <= _MAX_ARGUMENTS
        self._skip(1)
        if not (self._reports_too_long and request) or self._reported:
            return
        self._reported = True
        raise LimitExceeded(
            tr(
                "the announced packet of {length} bytes exceeds the limit of {most} bytes",
                length=length,
                most=self.limits.packet,
            ),
            hresult.E_PACKETSIZEOVER,
        )

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        del self._buffer[:count]
        if not self._buffer:
            self._work = 0
            self._reported = False
