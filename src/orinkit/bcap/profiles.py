"""How packets travel: in a stream (TCP), one to a datagram (UDP), or over a serial line (b-CAP/COM).

A :class:`BcapProfile` has all that differs. On a stream nothing is lost, and anything but packets ends the connection. On the other two a packet may be, so that a client
repeats a request that is not answered: with a new serial, and with the serial of its first try in the reserved field, by
which a server knows it again (:mod:`orinkit.bcap.duplicate_filter`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Protocol

from orinkit.bcap import packet
from orinkit.bcap.serial_framer import LineFramer
from orinkit.cao.transport_profile import TransportProfile
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

SILENCE: Final = 0.05
"""Seconds without a byte after which a packet that has begun on a serial line is not coming to its end any more."""


class Framing(Protocol):
    """Cuts packets out of what is received.

    Attributes:
        skipped: bytes received outside any packet that were passed over.
    """

    skipped: int

    @property
    def pending(self) -> int:
        """How many bytes are kept that are no whole packet yet."""

    @property
    def partial_serial(self) -> int:
        """Serial of the packet that they seem to be the beginning of; 0 where that cannot be told."""

    def feed(self, data: bytes) -> bytes | None:
        """Take what was received and return the first whole packet; :meth:`next_frame` gives the others."""

    def next_frame(self) -> bytes | None:
        """Return the next whole packet, ``None`` when more bytes are needed."""

    def resync(self) -> bytes | None:
        """Return a whole packet behind the head of one that is not whole."""

    def timeout(self) -> bytes | None:
        """Nothing more comes for what has begun; returns a whole packet that is found inside it."""


class DatagramFramer:
    """One datagram, one packet; anything else is dropped.

    Attributes:
        skipped: bytes of dropped datagrams.
    """

    pending = 0
    partial_serial = 0

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS) -> None:
        self.limits = limits
        self.skipped = 0

    def feed(self, data: bytes) -> bytes | None:
        """Return the packet that a datagram is; one that is too long too, for it is to be answered."""
        if packet.is_whole(data):
            return data
        self.skipped += len(data)
        return None

    def next_frame(self) -> bytes | None:
        """Return nothing: there is only one packet."""
        return None

    def resync(self) -> bytes | None:
        """Return nothing: no packet is ever incomplete."""
        return None

    def timeout(self) -> bytes | None:
        """Return nothing: no packet is ever incomplete."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class BcapProfile(TransportProfile):
    """One way for packets to travel.

    Attributes:
        framer: cuts packets out of what is received, within limits.
        server_framer: the same for a server.
        crc: packets have a checksum (VE026A 3.1).
    """

    framer: Callable[[PacketLimits], Framing]
    server_framer: Callable[[PacketLimits], Framing]
    crc: bool = False

    @property
    def tail(self) -> int:
        """Bytes of a packet behind its last argument."""
        return 3 if self.crc else 1

    def bound(self, limits: PacketLimits) -> PacketLimits:
        """Return limits of which none is beyond what can travel."""
        return limits if limits.packet <= self.packet else replace(limits, packet=self.packet)


STREAM: Final = BcapProfile("tcp", framer=packet.Framer, server_framer=packet.Framer)
DATAGRAM: Final = BcapProfile(
    "udp", framer=DatagramFramer, server_framer=DatagramFramer,
    lossy=True, memory=10.0, packet=488 + packet.OVERHEAD, timeout=0.5,
)  # fmt: skip
LINE: Final = BcapProfile(
    "serial", framer=LineFramer, server_framer=partial(LineFramer, tells=True),
    crc=True, lossy=True, shared=True, watched=False, packet=65536, timeout=0.5,
)  # fmt: skip
"""Time-outs of 500 ms: RC8 table 5-1."""

LEAST_TRIES: Final = 1
MOST_TRIES: Final = 7
DEFAULT_TRIES: Final = 5
"""How often a request is sent in all where packets may be lost (RC8 table 5-1: TORetry)."""
