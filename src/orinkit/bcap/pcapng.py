"""Packets as a pcapng file, which Wireshark and tshark read.

A file consists of blocks: a section header, the description of one interface (LINKTYPE_RAW, times in ns), and one
enhanced packet block per IP packet. The IP, TCP and UDP headers are synthetic, because a program receives only their
contents. Sequence and acknowledgement numbers and all checksums are correct. There is no handshake: every IP packet of
the file carries data that was sent or received.

A UDP packet is one datagram. Data over TCP is divided into segments of at most :data:`LONGEST_SEGMENT` bytes. Packets of
a serial line are written as a TCP stream, see :data:`SERIAL_LINE`: unlike a datagram, a stream has no maximum size. HTTP
bodies are written as a TCP stream without HTTP headers.

>>> blocks = []
>>> writer = PcapngWriter(blocks.append)
>>> connection = CaptureConnection("udp", ("127.0.0.1", 50000), ("127.0.0.1", 5007))
>>> writer.packet(1_700_000_000_000_000_000, ">", bytes.fromhex("01100000000100000001000000000004"), connection=connection)
>>> [len(block) for block in blocks]
[72, 88]
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Final, Literal, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

Place: TypeAlias = tuple[str, int]
"""An IP address and a port, 0 to 65535."""

LINKTYPE_RAW: Final = 101
LONGEST_SEGMENT: Final = 65_495
"""Largest number of bytes of a TCP segment: an IPv4 packet has at most 65,535 bytes, of which 40 are headers."""
LONGEST_DATAGRAM: Final = 65_507
"""Largest number of bytes of a datagram: an IPv4 packet has at most 65,535 bytes, of which 28 are headers."""

_SECTION: Final = 0x0A0D0D0A
_INTERFACE: Final = 1
_ENHANCED_PACKET: Final = 6
_BYTE_ORDER: Final = 0x1A2B3C4D
_UNKNOWN_LENGTH: Final = -1
_END_OF_OPTIONS: Final = 0
_USER_APPLICATION: Final = 4
_RESOLUTION: Final = 9
_FLAGS: Final = 2
_NANOSECONDS: Final = 9
_DIRECTIONS: Final = {"<": 1, ">": 2}  # of epb_flags: inbound, outbound

_TCP: Final = 6
_UDP: Final = 17
_HOPS: Final = 64
_WINDOW: Final = 0xFFFF
_ACK: Final = 0x10
_PUSH: Final = 0x08
_TCP_HEADER: Final = struct.Struct(">HHIIBBHHH")
_UDP_HEADER: Final = struct.Struct(">HHHH")


@lru_cache(maxsize=1024)
def _address(host: str) -> IPv4Address | IPv6Address:
    try:
        return ip_address(host)
    except ValueError:
        raise InvalidValue(tr("{host!r:.80} is not an IP address", host=host)) from None


@dataclass(frozen=True, slots=True)
class CaptureConnection:
    """The connection of a captured packet.

    Attributes:
        transport: ``"tcp"`` or ``"udp"``.
        local: address and port of this program.
        remote: address and port of the peer; both addresses are IPv4, or both are IPv6.

    Raises:
        InvalidValue: If an address is not an IP address, a port is not 0 to 65535, or the IP versions differ.
    """

    transport: Literal["tcp", "udp"]
    local: Place
    remote: Place

    def __post_init__(self) -> None:
        if self.transport not in ("tcp", "udp"):
            raise InvalidValue(
                tr('the transport of a capture must be "tcp" or "udp", not {value!r}', value=self.transport)
            )
        versions = {_address(host).version for host, _ in (self.local, self.remote)}
        if len(versions) > 1:
            text = tr("{local} and {remote} have different IP versions", local=self.local[0], remote=self.remote[0])
            raise InvalidValue(text)
        for _, port in (self.local, self.remote):
            if not 0 <= port <= 0xFFFF:
                raise InvalidValue(tr("port {port} must be 0 to 65535", port=port))


SERIAL_LINE: Final = CaptureConnection("tcp", ("127.0.0.1", 5006), ("127.0.0.1", 5007))
"""The connection under which packets of a serial line are written: TCP from port 5006 to port 5007 of 127.0.0.1."""


class PcapngWriter:
    """Writes packets as the bytes of a pcapng file; the bytes are complete after every call.

    Args:
        write: callback invoked with the bytes of the file, in order; first with the header of the file.
        application: name of the program, which Wireshark shows.
    """

    def __init__(self, write: Callable[[bytes], object], application: str = "orinkit") -> None:
        self._write = write
        self._sequence: dict[tuple[Place, Place], int] = {}
        self._identification = 0
        header = struct.pack("<IHHq", _BYTE_ORDER, 1, 0, _UNKNOWN_LENGTH)
        interface = struct.pack("<HHI", LINKTYPE_RAW, 0, 0)
        self._write(
            _block(_SECTION, header + _options((_USER_APPLICATION, application.encode())))
            + _block(_INTERFACE, interface + _options((_RESOLUTION, bytes([_NANOSECONDS]))))
        )

    def packet(self, time_ns: int, direction: str, data: bytes, *, connection: CaptureConnection) -> None:
        """Write one packet; over TCP, a packet without data is not written.

        Args:
            time_ns: time, ns since 1970-01-01 UTC.
            direction: ``">"`` if the packet was sent, ``"<"`` if it was received.
            data: the bytes of the packet, without any header.
            connection: the connection on which the packet was sent or received.

        Raises:
            InvalidValue: If the direction is invalid, or a datagram has more than :data:`LONGEST_DATAGRAM` bytes.
        """
        if direction not in _DIRECTIONS:
            raise InvalidValue(tr("the direction of a packet must be > or <, not {value!r:.80}", value=direction))
        places = (connection.local, connection.remote)
        source, target = places if direction == ">" else places[::-1]
        if connection.transport == "udp":
            frames = [self._datagram(source, target, data)]
        else:
            frames = self._segments(source, target, bytes(data))
        for frame in frames:
            self._write(_packet_block(time_ns, frame, _DIRECTIONS[direction]))

    def _datagram(self, source: Place, target: Place, data: bytes) -> bytes:
        if len(data) > LONGEST_DATAGRAM:
            text = tr(
                "{size} bytes exceed the limit of {most} bytes of a datagram", size=len(data), most=LONGEST_DATAGRAM
            )
            raise InvalidValue(text)
        size = _UDP_HEADER.size + len(data)
        header = _UDP_HEADER.pack(source[1], target[1], size, 0)
        checksum = _transport_checksum(source, target, _UDP, header + data) or 0xFFFF  # 0 means: no checksum
        return self._ip(source, target, _UDP, _UDP_HEADER.pack(source[1], target[1], size, checksum) + data)

    def _segments(self, source: Place, target: Place, data: bytes) -> list[bytes]:
        pieces = [data[at : at + LONGEST_SEGMENT] for at in range(0, len(data), LONGEST_SEGMENT)]
        return [self._segment(source, target, piece, last=piece is pieces[-1]) for piece in pieces]

    def _segment(self, source: Place, target: Place, data: bytes, *, last: bool) -> bytes:
        sequence = self._sequence.get((source, target), 1)
        received = self._sequence.get((target, source), 1)
        self._sequence[source, target] = sequence + len(data) & 0xFFFF_FFFF
        flags = _ACK | _PUSH if last else _ACK
        length = _TCP_HEADER.size // 4 << 4

        def header(checksum: int) -> bytes:
            return _TCP_HEADER.pack(source[1], target[1], sequence, received, length, flags, _WINDOW, checksum, 0)

        checksum = _transport_checksum(source, target, _TCP, header(0) + data)
        return self._ip(source, target, _TCP, header(checksum) + data)

    def _ip(self, source: Place, target: Place, protocol: int, content: bytes) -> bytes:
        first, second = _address(source[0]), _address(target[0])
        if first.version == 6:
            head = struct.pack(">IHBB", 6 << 28, len(content), protocol, _HOPS)
            return head + first.packed + second.packed + content
        self._identification = self._identification + 1 & 0xFFFF
        size = 20 + len(content)

        def header(checksum: int) -> bytes:
            fixed = struct.pack(">BBHHHBBH", 0x45, 0, size, self._identification, 0x4000, _HOPS, protocol, checksum)
            return fixed + first.packed + second.packed

        return header(_checksum(header(0))) + content


def _transport_checksum(source: Place, target: Place, protocol: int, content: bytes) -> int:
    """Return the checksum of a TCP segment or a datagram with its pseudo-header (RFC 9293 3.1, RFC 8200 8.1)."""
    first, second = _address(source[0]), _address(target[0])
    return _checksum(first.packed + second.packed + struct.pack(">II", len(content), protocol) + content)


def _checksum(data: bytes) -> int:
    """Return the checksum of RFC 1071: the complement of the ones' complement sum of the 16-bit words."""
    number = int.from_bytes(data + b"\0" * (len(data) % 2), "big")
    return 0xFFFF - (number % 0xFFFF or 0xFFFF)  # the data is never all zeros, so the sum is never 0


def _packet_block(time_ns: int, frame: bytes, flags: int) -> bytes:
    head = struct.pack("<IIIII", 0, time_ns >> 32 & 0xFFFF_FFFF, time_ns & 0xFFFF_FFFF, len(frame), len(frame))
    return _block(_ENHANCED_PACKET, head + _padded(frame) + _options((_FLAGS, struct.pack("<I", flags))))


def _options(*options: tuple[int, bytes]) -> bytes:
    parts = [struct.pack("<HH", code, len(value)) + _padded(value) for code, value in options]
    return b"".join(parts) + struct.pack("<HH", _END_OF_OPTIONS, 0)


def _padded(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % 4)


def _block(kind: int, body: bytes) -> bytes:
    size = struct.pack("<I", 12 + len(body))
    return struct.pack("<I", kind) + size + body + size
