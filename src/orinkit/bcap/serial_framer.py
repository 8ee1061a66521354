"""Packets on a serial line (b-CAP/COM, VE026A 3.1), where bytes may be lost, changed, or come from nowhere."""

from __future__ import annotations

from typing import Final

from orinkit.bcap import packet
from orinkit.core import hresult
from orinkit.core.errors import LimitExceeded
from orinkit.core.i18n import tr
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

LEAST: Final = packet.OVERHEAD + 2
"""Bytes of a packet without arguments."""

_MOST_WORK: Final = 1 << 20  # bytes to compute checksums of for nothing, before all that is kept is thrown away
_LAST_FUNCTION: Final = 137
_MOST_ARGUMENTS: Final = 8
_HEAD: Final = packet.HEADER.size


class LineFramer:
    """Finds packets between noise: each has to be whole and its checksum right.

    Where something is no packet the next one is looked for right behind its first byte, so that no packet is lost with
    the noise before it. A length that was made by noise may announce bytes that never come; :meth:`timeout` is told
    when the line has fallen silent.

    Args:
        limits: bounds on a packet.
        tells: raise where a request is announced that is longer than the limit, for a server to answer it; a client
            takes it for noise.

    Attributes:
        limits: bounds on a packet.
        skipped: bytes received outside any packet.
    """

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS, *, tells: bool = False) -> None:
        self.limits = limits
        self.skipped = 0
        self._tells = tells
        self._told = False  # of what is still kept
        self._buffer = bytearray()
        self._work = 0

    @property
    def pending(self) -> int:
        """How many bytes are kept that are no whole packet yet."""
        return len(self._buffer)

    @property
    def partial_serial(self) -> int:
        """Serial of the packet that they seem to be the beginning of; 0 where that cannot be told."""
        if len(self._buffer) < _HEAD:
            return 0
        serial: int = packet.HEADER.unpack_from(self._buffer)[2]
        return serial

    def feed(self, data: bytes) -> bytes | None:
        """Take the next bytes and return the first whole packet; :meth:`next_frame` gives the others.

        Raises:
            LimitExceeded: as :meth:`next_frame`.
        """
        self._buffer += data
        return self.next_frame()

    def next_frame(self) -> bytes | None:
        """Return the next whole packet, ``None`` when more bytes are needed.

        Raises:
            LimitExceeded: a request is announced that is longer than the limit; its first byte is passed over. Not told
                twice of the same noise.
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
        """Return a whole packet behind the head of one that is not whole, which is then passed over with all before it.

        For a head that noise has made, where the line never falls silent. A packet that carries others in its content
        looks the same, so it is to be asked for only when one takes far too long.
        """
        buffer = self._buffer
        start = buffer.find(packet.SOH, 1)
        while 0 < start <= len(buffer) - LEAST:
            (length,) = packet.LENGTH.unpack_from(buffer, start + 1)
            end = start + length
            if length >= LEAST and end <= len(buffer) and buffer[end - 1] == packet.EOT:
                frame = bytes(buffer[start:end])
                if packet.is_right(frame):
                    self._skip(start)
                    del buffer[:length]
                    return frame
            start = buffer.find(packet.SOH, start + 1)
        return None

    def timeout(self) -> bytes | None:
        """Give up what has begun, and return a whole packet that is found inside it.

        Raises:
            LimitExceeded: as :meth:`next_frame`.
        """
        while self._buffer:
            self._skip(1)
            frame = self.next_frame()
            if frame is not None:
                return frame
        return None

    def _whole(self, length: int) -> bytes | None:
        """Return the packet at the beginning of what is kept, or pass over its first byte if it is none."""
        buffer = self._buffer
        if buffer[length - 1] == packet.EOT:
            frame = bytes(buffer[:length])
            if packet.is_right(frame):
                del buffer[:length]
                self._work = 0
                self._told = False
                return frame
            self._work += length
        self._skip(len(buffer) if self._work > _MOST_WORK else 1)
        return None

    def _refuse(self, length: int) -> None:
        """Pass over the beginning of what is too long to be a packet; noise, unless it looks like a request."""
        _, _, serial, _, function, count = packet.HEADER.unpack_from(self._buffer)
        request = serial and 1 <= function <= _LAST_FUNCTION and count <= _MOST_ARGUMENTS
        self._skip(1)
        if not (self._tells and request) or self._told:
            return
        self._told = True
        raise LimitExceeded(
            tr(
                "a packet of {length} bytes is announced, at most {most} are allowed",
                length=length,
                most=self.limits.packet,
            ),
            hresult.E_PACKETSIZEOVER,
        )

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]
        if not self._buffer:
            self._work = 0
            self._told = False
