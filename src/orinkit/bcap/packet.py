"""b-CAP packets and how they lie in a byte stream (VE026A 3.1).

A packet is ``SOH | length u32 | serial u16 | reserved u16 | function id or return code u32 | argument count u16 |
arguments | [reserved area] | [CRC u16, on a serial line] | EOT``, little-endian; the length is that of the whole packet.
"""

from __future__ import annotations

import binascii
import re
import struct
from dataclasses import dataclass, field
from typing import Any, Final, cast

from orinkit.core import hresult
from orinkit.core.errors import LimitExceeded, ProtocolError
from orinkit.core.i18n import tr
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

SOH: Final = 0x01
EOT: Final = 0x04
OVERHEAD: Final = 16
"""Bytes of a packet without arguments and CRC."""

HEADER: Final = struct.Struct("<BIHHIH")
_BODY: Final = HEADER.size
LENGTH: Final = struct.Struct("<I")
_START: Final = struct.Struct("<BI").unpack_from
_CRC: Final = struct.Struct("<H")
_EOT: Final = bytes([EOT])
_COPIED: Final = 64 * 1024  # bytes of a packet that may be copied: 16 MiB would take 10 ms
_SHOWN: Final = 32  # bytes of what is no packet
_HTTP: Final = re.compile(rb"HTTP/\d|[A-Z]{3,7} [/*]")


@dataclass(slots=True)
class Packet:
    """One packet.

    Attributes:
        serial: 1 to 65535; the reply has the request's.
        code: function id of a request, return code of a reply; unsigned.
        arguments: plain values, or :class:`~orinkit.values.variant.Variant` objects if read with ``exact=True``.
        reserved: 0 on TCP; on UDP and serial lines the serial of the first try.
        trailer: the reserved area behind the arguments (VE026A 3.1), nearly always empty.
    """

    serial: int
    code: int
    arguments: list[Any] = field(default_factory=list)
    reserved: int = 0
    trailer: bytes = b""


def pack(serial: int, code: int, count: int, body: bytes, reserved: int = 0, *, crc: bool = False) -> bytes:
    """Return a packet from its parts; ``body`` are ``count`` encoded arguments."""
    if not crc:
        return b"%b%b\x04" % (HEADER.pack(SOH, len(body) + OVERHEAD, serial, reserved, code, count), body)
    head = HEADER.pack(SOH, len(body) + OVERHEAD + 2, serial, reserved, code, count)
    return b"%b%b%b\x04" % (head, body, _CRC.pack(checksum(head[1:] + body)))


def with_room(body: bytes) -> bytearray:
    """Return encoded arguments with room for what is around them in a packet, to be filled by :func:`pack_around`."""
    room = bytearray(_BODY + len(body) + 1)
    room[_BODY:-1] = body
    room[-1] = EOT
    return room


def pack_around(room: bytearray, serial: int, code: int, count: int, reserved: int = 0) -> bytearray:
    """Return what :func:`with_room` has made as a packet of ``count`` arguments, without a CRC; nothing is copied."""
    HEADER.pack_into(room, 0, SOH, len(room), serial, reserved, code, count)
    return room


def encode(packet: Packet, *, crc: bool = False) -> bytes:
    """Return a packet as bytes.

    Raises:
        InvalidValue: an argument cannot be a VARIANT.
    """
    body = b"".join(map(codec.encode, packet.arguments)) + packet.trailer
    return pack(packet.serial, packet.code, len(packet.arguments), body, packet.reserved, crc=crc)


def checksum(data: bytes) -> int:
    """Return the CRC of a serial line: CCITT, initial value 0xFFFF, over length field to last argument (VE026A 3.1)."""
    return binascii.crc_hqx(data, 0xFFFF)


def decode(frame: bytes, limits: PacketLimits = DEFAULT_LIMITS, *, exact: bool = False, crc: bool = False) -> Packet:
    """Read one whole packet, for example one that :class:`Framer` has cut out.

    Raises:
        ProtocolError: it is none; ``code`` is what a server answers.
    """
    check_frame(frame, limits, crc=crc)
    end = len(frame) - (3 if crc else 1)
    _, _, serial, reserved, code, count = HEADER.unpack_from(frame)
    arguments, position = decode_arguments(frame, count, end, limits, exact=exact)
    return Packet(serial, code, arguments, reserved, frame[position:end])


def decode_arguments(
    frame: bytes, count: int, end: int, limits: PacketLimits = DEFAULT_LIMITS, *, exact: bool = False
) -> tuple[list[Any], int]:
    """Read ``count`` arguments of a packet; returns them and the position behind the last.

    Raises:
        ProtocolError: they are not what count and lengths say.
    """
    if count * 10 > end - _BODY:
        raise ProtocolError(
            tr("{count} arguments cannot be in the {present} bytes present", count=count, present=end - _BODY)
        )
    arguments = []
    position = _BODY
    budget = [limits.variants]
    for _ in range(count):
        value, position = codec.decode(frame, position, end, limits, exact=exact, budget=budget)
        arguments.append(value)
    return arguments, position


def is_whole(frame: bytes) -> bool:
    """Whether bytes are one packet from SOH to EOT, whatever it holds; without a CRC."""
    return len(frame) >= OVERHEAD and frame[-1] == EOT and _START(frame) == (SOH, len(frame))


def is_right(frame: bytes) -> bool:
    """Whether the CRC of a packet is right."""
    return bool(_CRC.unpack_from(frame, len(frame) - 3)[0] == checksum(frame[1:-3]))


def check_frame(frame: bytes, limits: PacketLimits = DEFAULT_LIMITS, *, crc: bool = False) -> None:
    """Check a whole packet's outside: SOH, length, EOT, CRC.

    Raises:
        ProtocolError: one of them is wrong.
    """
    length = len(frame)
    smallest = OVERHEAD + 2 if crc else OVERHEAD
    if length < smallest or frame[-1] != EOT or _START(frame) != (SOH, length):
        raise ProtocolError(
            tr(
                "{count} bytes {begin}... are no packet: SOH 01, the length, and EOT 04 at its end are needed",
                count=len(frame),
                begin=frame[:8].hex(" "),
            ),
            fatal=True,
        )
    if length > limits.packet:
        raise _too_long(length, limits)
    if crc and not is_right(frame):
        raise ProtocolError(
            tr(
                "CRC {found} is wrong, {right} is right",
                found=frame[-3:-1].hex(),
                right=_CRC.pack(checksum(frame[1:-3])).hex(),
            )
        )


def _too_long(length: int, limits: PacketLimits) -> LimitExceeded:
    return LimitExceeded(
        tr("packet of {length} bytes, at most {most} are allowed", length=length, most=limits.packet),
        hresult.E_PACKETSIZEOVER,
        fatal=True,
    )


def _no_packet(data: bytes | bytearray) -> ProtocolError:
    """Return the exception for bytes of a stream that do not begin with SOH; it shows the first ones in printable form."""
    shown = ascii(bytes(data[:_SHOWN]))[1:] + ("..." if len(data) > _SHOWN else "")
    hint = tr(". This is HTTP. Try: an http:// address, and a server of e-CAP") if _HTTP.match(data) else ""
    return ProtocolError(
        tr(
            "{shown} is no b-CAP: a packet begins with SOH 01, not with {first:02x}{hint}",
            shown=shown,
            first=data[0],
            hint=hint,
        ),
        fatal=True,
    )


class Framer:
    """Cuts packets out of a byte stream that may be split anywhere.

    Every packet begins where the one before ends. Anything else is refused: a first byte other than SOH, a length that no
    packet can have, a last byte other than EOT. No packet is searched for behind it, because a web page can have a browser
    send bytes of its choice, but only behind an HTTP header. Every later call refuses too.
    """

    skipped = 0
    """Nothing is passed over in a stream."""

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS) -> None:
        self.limits = limits
        self._buffer = bytearray()
        self._error: ProtocolError | None = None

    @property
    def pending(self) -> int:
        """How many bytes are kept that are no whole packet yet."""
        return len(self._buffer)

    @property
    def partial_serial(self) -> int:
        """Nobody asks for it of a stream."""
        return 0

    def resync(self) -> bytes | None:
        """Return nothing: a stream has no other packet inside a packet."""
        return None

    def timeout(self) -> bytes | None:
        """Return nothing: in a stream the rest of a packet comes, however late."""
        return None

    def feed(self, data: bytes) -> bytes | None:
        """Take the next bytes of the stream and return the first whole packet; :meth:`next_frame` gives the others.

        Raises:
            ProtocolError: as :meth:`next_frame`.
        """
        if not self._buffer and self._error is None and len(data) >= OVERHEAD:
            soh, length = _START(data)
            if soh == SOH and length == len(data) and data[-1] == EOT and length <= self.limits.packet:
                return data  # nearly always one whole packet arrives: nothing to keep, nothing to copy
        if self._error is None:
            self._buffer += data
        return self.next_frame()

    def next_frame(self) -> bytes | None:
        """Return the next whole packet, ``None`` when more bytes are needed.

        Raises:
            ProtocolError: the stream is no longer a stream of packets (``fatal`` is set).
        """
        if self._error is not None:
            raise self._error
        buffer = self._buffer
        if not buffer:
            return None
        if buffer[0] != SOH:
            raise self._lost(_no_packet(buffer))
        if len(buffer) < 5:
            return None
        (length,) = LENGTH.unpack_from(buffer, 1)
        if not OVERHEAD <= length <= self.limits.packet:
            raise self._refuse_length(length)
        if len(buffer) < length:
            return None
        if buffer[length - 1] != EOT:
            raise self._lost(
                ProtocolError(
                    tr(
                        "a packet of {length} bytes ends with {last:02x}, not with EOT 04",
                        length=length,
                        last=buffer[length - 1],
                    ),
                    fatal=True,
                )
            )
        if len(buffer) == length and length > _COPIED:
            self._buffer = bytearray()
            return cast("bytes", buffer)  # is read like bytes, and nobody changes it any more
        with memoryview(buffer) as view:
            frame = bytes(view[:length])
        del buffer[:length]
        return frame

    def _refuse_length(self, length: int) -> ProtocolError:
        if length > self.limits.packet:
            return self._lost(_too_long(length, self.limits))
        return self._lost(
            ProtocolError(
                tr("a packet cannot be {length} bytes long; {least} is the least", length=length, least=OVERHEAD),
                fatal=True,
            )
        )

    def _lost(self, error: ProtocolError) -> ProtocolError:
        self._error = error
        self._buffer.clear()
        return error
