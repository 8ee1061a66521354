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
"""Number of bytes of a packet without arguments, including its CRC."""

_MAX_WORK: Final = 1 << 20  # if wrong checksums were computed over more bytes than this, the buffer is discarded
_MAX_POSITIONS: Final = 500  # number of positions after which a sliced search is interrupted; they take less than 1 ms
_CANDIDATE: Final = 64  # bytes of work that a possible header counts in a search inside an incomplete packet
_LAST_FUNCTION: Final = len(FUNCTIONS)
_MAX_ARGUMENTS: Final = 8
_HEAD: Final = packet.HEADER.size


class LineFramer(packet.FramerBase):
    """Finds packets between noise: each packet must be complete and have a correct CRC.

    If a sequence of bytes is not a packet, the search continues immediately after its first byte, so that noise before
    a packet does not cause the loss of the packet. Noise may look like a header and announce bytes that never arrive.
    Therefore the caller calls :meth:`discard_incomplete` after a period of silence on the line.

    Args:
        limits: limits of a packet.
        reports_too_long: True to raise an exception if the header of a request announces a packet above the limit, so
            that a server can send a reply. False to treat such a header as noise, for a client.
        in_slices: True to interrupt a long search for a packet, so that a server can serve other clients meanwhile.

    Attributes:
        limits: limits of a packet.
        skipped_bytes: number of bytes received outside any packet.
        is_searching: True if the last search was interrupted; :meth:`next_frame` continues it.
    """

    def __init__(
        self, limits: PacketLimits = DEFAULT_LIMITS, *, reports_too_long: bool = False, in_slices: bool = False
    ) -> None:
        super().__init__(limits)
        self.skipped_bytes = 0
        self.is_searching = False
        self._positions = 0
        self._in_slices = in_slices
        self._reports_too_long = reports_too_long
        self._reported = False  # LimitExceeded was raised for the buffered data
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
            LimitExceeded: If the header of a request announces a packet above the limit. The first byte of the header
                is skipped. The exception is raised only once for the same buffered data.
        """
        self._positions = 0
        return self._search()

    def _search(self) -> bytes | None:
        buffer = self._buffer
        self.is_searching = False
        while buffer:
            self._positions += 1
            if self._positions > _MAX_POSITIONS and self._in_slices:
                self.is_searching = True
                return None
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
        """Return a complete packet that follows the header of an incomplete packet; ``None`` if there is none.

        All bytes before the returned packet are skipped. Noise may look like a header. If the line is never silent,
        :meth:`discard_incomplete` is not called, and this method finds the packets after the false header. However, the
        incomplete packet may also be valid, and contain the returned packet in its arguments. Therefore call this
        method only if a packet remains incomplete for far too long. If the search takes too long, the buffer is
        discarded.
        """
        buffer = self._buffer
        work = 0
        start = buffer.find(packet.SOH, 1)
        while 0 < start <= len(buffer) - LEAST:
            if work > _MAX_WORK:
                self._skip(len(buffer))
                return None
            (length,) = packet.LENGTH.unpack_from(buffer, start + 1)
            end = start + length
            work += _CANDIDATE
            if length >= LEAST and end <= len(buffer) and buffer[end - 1] == packet.EOT:
                frame = bytes(buffer[start:end])
                work += length
                if packet.has_correct_crc(frame):
                    self._skip(start)
                    del buffer[:length]
                    return frame
            start = buffer.find(packet.SOH, start + 1)
        return None

    def discard_incomplete(self) -> bytes | None:
        """Abandon the incomplete packet, and return the first complete packet in the bytes after its first byte.

        Return ``None`` if there is none, or if the search was interrupted. The incomplete packet may have been noise
        that looks like a header.

        Raises:
            LimitExceeded: See :meth:`next_frame`.
        """
        self._positions = 0
        while self._buffer:
            self._skip(1)
            frame = self._search()
            if frame is not None or self.is_searching:
                return frame
        return None

    def _whole(self, length: int) -> bytes | None:
        """Return the packet at the beginning of the buffer. If it is invalid, skip its first byte and return None."""
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
        """Skip the first byte of a header that announces a packet above the limit.

        A header that does not look like that of a request is noise. Otherwise, an exception may be raised: see
        :meth:`next_frame`.
        """
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
