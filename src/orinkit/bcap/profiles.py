"""Transport profiles of b-CAP: stream (TCP), datagrams (UDP), serial line (b-CAP/COM).

A :class:`BcapProfile` describes the differences. Over TCP, nothing is lost, and data that is not a packet ends the
connection. On the other two transports, a packet may be lost, so a client repeats a request without a reply. Each
attempt has a new serial. The reserved field of every attempt contains the serial of the first one, so that a server
recognizes the request (:mod:`orinkit.bcap.duplicate_filter`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

from orinkit.bcap import packet
from orinkit.bcap.serial_framer import LineFramer
from orinkit.cao.transport_profile import TransportProfile
from orinkit.core.record import record, replaced
from orinkit.core.validation import check_whole
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

SILENCE: Final = 0.05
"""Seconds without a byte after which a partial packet on a serial line is abandoned."""


class Framing(Protocol):
    """Extracts packets from received data.

    Attributes:
        limits: limits of a packet.
        skipped_bytes: number of bytes received outside any packet and skipped.
        is_searching: True if the search for a packet was interrupted; :meth:`next_frame` continues it.
    """

    limits: PacketLimits
    skipped_bytes: int
    is_searching: bool

    @property
    def pending(self) -> int:
        """Number of buffered bytes of an incomplete packet."""

    @property
    def is_empty(self) -> bool:
        """True if no received bytes are buffered, and no error has ended the stream."""

    @property
    def partial_serial(self) -> int:
        """Probable serial of the incomplete packet; 0 if unknown."""

    def feed(self, data: bytes) -> bytes | None:
        """Add received data and return the first complete packet; :meth:`next_frame` returns the others."""

    def next_frame(self) -> bytes | None:
        """Return the next complete packet, or ``None`` if more bytes are needed."""

    def resync(self) -> bytes | None:
        """Return the first complete packet after the header of an incomplete packet; ``None`` if there is none."""

    def discard_incomplete(self) -> bytes | None:
        """Abandon the incomplete packet; return the first complete packet after its first byte, or ``None``."""


class DatagramFramer:
    """Accepts datagrams that contain exactly one packet, and drops all others.

    Attributes:
        skipped_bytes: number of bytes of dropped datagrams.
    """

    pending = 0
    is_empty = True
    partial_serial = 0
    is_searching = False

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS) -> None:
        self.limits = limits
        self.skipped_bytes = 0

    def feed(self, data: bytes) -> bytes | None:
        """Return the packet in a datagram; ``None`` if the datagram is dropped.

        A packet that is too long is not dropped, so that the server can reply to it.
        """
        if packet.is_whole(data):
            return data
        self.skipped_bytes += len(data)
        return None

    def next_frame(self) -> bytes | None:
        """Return None: a datagram contains only one packet."""
        return None

    def resync(self) -> bytes | None:
        """Return None: no packet is ever incomplete."""
        return None

    def discard_incomplete(self) -> bytes | None:
        """Return None: no packet is ever incomplete."""
        return None


@record(kw_only=True)
class BcapProfile(TransportProfile):
    """A transport profile of b-CAP.

    Attributes:
        framer: function that creates the framer of a client from the limits of a packet.
        server_framer: function that creates the framer of a server from the limits of a packet.
        crc: True if packets have a CRC (VE026A 3.1).
    """

    framer: Callable[[PacketLimits], Framing]
    server_framer: Callable[[PacketLimits], Framing]
    crc: bool = False

    @property
    def tail(self) -> int:
        """Number of bytes of a packet after its last argument."""
        return 3 if self.crc else 1

    def bound(self, limits: PacketLimits) -> PacketLimits:
        """Return limits with the packet size reduced to the limit of the transport; the other limits are unchanged."""
        return limits if limits.packet <= self.packet else replaced(limits, packet=self.packet)


LONGEST_DATAGRAM: Final = 503
"""Limit on the bytes of a packet over UDP, and of a packet that DENSO's libraries accept on a serial line."""
LONGEST_ON_LINE: Final = 65536
"""Limit on the bytes of a packet on a serial line, between programs of orinkit."""
LEAST_ON_LINE: Final = 128

STREAM: Final = BcapProfile("tcp", framer=packet.Framer, server_framer=packet.Framer)
DATAGRAM: Final = BcapProfile(
    "udp", framer=DatagramFramer, server_framer=DatagramFramer,
    lossy=True, session_timeout=10.0, packet=LONGEST_DATAGRAM, timeout=0.5,
)  # fmt: skip
LINE: Final = BcapProfile(
    "serial", framer=LineFramer, server_framer=partial(LineFramer, reports_too_long=True, in_slices=True),
    crc=True, lossy=True, shared=True, packet=LONGEST_ON_LINE, timeout=0.5,
)  # fmt: skip
"""The profile of serial lines; the time-out of 500 ms is from RC8 table 5-1."""

LEAST_TRIES: Final = 1
MOST_TRIES: Final = 7
DEFAULT_TRIES: Final = 5
"""Total number of attempts per request on unreliable transports (RC8 table 5-1: TORetry)."""


def line_profile(longest: int) -> BcapProfile:
    """Return the profile of a serial line with another limit on the bytes of a packet.

    Raises:
        InvalidValue: If the limit is not from 128 to 65,536.
    """
    check_whole("serial_packet", longest, LONGEST_ON_LINE, LEAST_ON_LINE)
    return LINE if longest == LINE.packet else replaced(LINE, packet=longest)
