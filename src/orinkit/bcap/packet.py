"""b-CAP packets, and their framing in a byte stream (VE026A 3.1).

A packet is ``SOH | length u32 | serial u16 | reserved u16 | function id or return code u32 | argument count u16 |
arguments | [reserved area] | [CRC u16, on a serial line] | EOT``, little-endian. The length is the number of bytes of
the whole packet.
"""

from __future__ import annotations

import binascii
import re
import struct
from functools import lru_cache
from typing import Any, Final, cast

from orinkit.core import hresult
from orinkit.core.errors import LimitExceeded, ProtocolError
from orinkit.core.i18n import tr
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import R8_ARRAY, Variant, VarType

SOH: Final = 0x01
EOT: Final = 0x04
OVERHEAD: Final = 16
"""Number of bytes of a packet without arguments and without CRC."""

HEADER: Final = struct.Struct("<BIHHIH")
_BODY: Final = HEADER.size
LENGTH: Final = struct.Struct("<I")
_START: Final = struct.Struct("<BI").unpack_from
_CRC: Final = struct.Struct("<H")
_EOT: Final = bytes([EOT])
_COPIED: Final = 64 * 1024  # largest packet that is copied, bytes; to copy 16 MiB would take 10 ms
_SHOWN: Final = 32  # bytes shown of data that is not a packet
_HTTP: Final = re.compile(rb"HTTP/\d|[A-Z]{3,7} [/*]")


class Packet:
    """A b-CAP packet.

    Attributes:
        serial: 1 to 65535; a reply has the serial of its request.
        code: function id of a request, return code of a reply; unsigned.
        arguments: plain values, or :class:`~orinkit.values.variant.Variant` objects if decoded with ``exact=True``.
        reserved: 0 on TCP; on UDP and serial lines the serial of the first attempt.
        trailer: the reserved area after the arguments (VE026A 3.1), nearly always empty.
    """

    __slots__ = ("arguments", "code", "reserved", "serial", "trailer")

    def __init__(
        self, serial: int, code: int, arguments: list[Any] | None = None, reserved: int = 0, trailer: bytes = b""
    ) -> None:
        self.serial = serial
        self.code = code
        self.arguments: list[Any] = [] if arguments is None else arguments
        self.reserved = reserved
        self.trailer = trailer

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Packet):
            return NotImplemented
        return self._fields() == other._fields()

    __hash__ = None  # type: ignore[assignment]  # a packet can be changed

    def __repr__(self) -> str:
        return "Packet(serial={}, code={}, arguments={!r}, reserved={}, trailer={!r})".format(*self._fields())

    def _fields(self) -> tuple[int, int, list[Any], int, bytes]:
        return self.serial, self.code, self.arguments, self.reserved, self.trailer


def pack(serial: int, code: int, count: int, body: bytes, reserved: int = 0, *, crc: bool = False) -> bytes:
    """Return a packet from its parts; ``body`` contains ``count`` encoded arguments."""
    if not crc:
        return b"%b%b\x04" % (HEADER.pack(SOH, len(body) + OVERHEAD, serial, reserved, code, count), body)
    head = HEADER.pack(SOH, len(body) + OVERHEAD + 2, serial, reserved, code, count)
    return b"%b%b%b\x04" % (head, body, _CRC.pack(checksum(head[1:] + body)))


_NO_RESULT: Final = struct.Struct("<BIHHIHB").pack
_SCALARS: Final = {
    int(vt): struct.Struct(f"<BIHHIHIHI{layout}B")
    for vt, layout in ((VarType.I4, "i"), (VarType.R8, "d"), (VarType.R4, "f"), (VarType.I2, "h"))
}
_BOOL: Final = int(VarType.BOOL)
_BSTR: Final = int(VarType.BSTR)
_I2: Final = int(VarType.I2)
_MOST_REALS: Final = 64
_LONGEST_TEXT: Final = 1000


@lru_cache(maxsize=_MOST_REALS + 1)
def _reals(count: int) -> struct.Struct:
    return struct.Struct(f"<BIHHIHIHI{count}dB")


def pack_reply(serial: int, code: int, result: Variant | None, reserved: int = 0) -> bytes | None:
    """Return the packet of a reply over TCP, packed in one step, or ``None`` if the result is not a simple one.

    Simple results are: none, VT_I2, VT_I4, VT_R4, VT_R8, VT_BOOL, a short VT_BSTR, and a short array of VT_R8. The bytes
    are those of :func:`pack` and :func:`orinkit.values.codec.encode_variant`.

    Raises:
        struct.error: If the value does not fit the type, which a :class:`Variant` never contains.
    """
    if result is None:
        return _NO_RESULT(SOH, OVERHEAD, serial, reserved, code, 0, EOT)
    vt, value = result.type, result.value
    layout = _SCALARS.get(vt)
    if layout is not None:
        size = layout.size
        return layout.pack(SOH, size, serial, reserved, code, 1, size - OVERHEAD - 4, vt, 1, value, EOT)
    if vt == R8_ARRAY and len(value) <= _MOST_REALS:
        count = len(value)
        layout = _reals(count)
        return layout.pack(SOH, layout.size, serial, reserved, code, 1, 6 + 8 * count, vt, count, *value, EOT)
    if vt == _BOOL:
        layout = _SCALARS[_I2]
        number = -1 if value else 0
        return layout.pack(SOH, layout.size, serial, reserved, code, 1, 8, vt, 1, number, EOT)
    if vt == _BSTR and len(value) <= _LONGEST_TEXT:
        return pack(serial, code, 1, codec.encode_string(value), reserved)
    return None


_ONE_HANDLE: Final = struct.Struct("<BIHHIHIHIiB")


def read_one_handle(data: bytes) -> tuple[int, int, int, int] | None:
    """Return serial, reserved field, function id and handle of a request whose only argument is a VT_I4.

    Return ``None`` for every other packet, complete or not.
    """
    if len(data) != _ONE_HANDLE.size:
        return None
    soh, length, serial, reserved, function_id, count, size, vt, elements, handle, eot = _ONE_HANDLE.unpack(data)
    if (soh, length, count, size, vt, elements, eot) != _HANDLE_FRAME:
        return None
    return serial, reserved, function_id, handle


_HANDLE_FRAME: Final = (SOH, _ONE_HANDLE.size, 1, 10, int(VarType.I4), 1, EOT)


def with_room(body: bytes) -> bytearray:
    """Return a buffer with encoded arguments, EOT, and room for the header, which :func:`pack_around` fills in."""
    room = bytearray(_BODY + len(body) + 1)
    room[_BODY:-1] = body
    room[-1] = EOT
    return room


def pack_around(room: bytearray, serial: int, code: int, count: int, reserved: int = 0) -> bytearray:
    """Complete a buffer from :func:`with_room` to a packet of ``count`` arguments, without CRC and without copying."""
    HEADER.pack_into(room, 0, SOH, len(room), serial, reserved, code, count)
    return room


def encode(packet: Packet, *, crc: bool = False) -> bytes:
    """Return a packet as bytes.

    Raises:
        InvalidValue: If an argument cannot be converted to a VARIANT.
    """
    body = b"".join(map(codec.encode, packet.arguments)) + packet.trailer
    return pack(packet.serial, packet.code, len(packet.arguments), body, packet.reserved, crc=crc)


def checksum(data: bytes) -> int:
    """Return the CRC for a serial line (VE026A 3.1): CCITT with the initial value 0xFFFF.

    The CRC covers the packet from the length to the last argument.
    """
    return binascii.crc_hqx(data, 0xFFFF)


def decode(frame: bytes, limits: PacketLimits = DEFAULT_LIMITS, *, exact: bool = False, crc: bool = False) -> Packet:
    """Decode one complete packet, for example one from :class:`Framer`.

    Raises:
        ProtocolError: If the bytes are not a valid packet. The ``code`` of the exception is the return code for
            the reply of a server.
    """
    check_frame(frame, limits, crc=crc)
    end = len(frame) - (3 if crc else 1)
    _, _, serial, reserved, code, count = HEADER.unpack_from(frame)
    arguments, position = decode_arguments(frame, count, end, limits, exact=exact)
    return Packet(serial, code, arguments, reserved, frame[position:end])


def decode_arguments(
    frame: bytes, count: int, end: int, limits: PacketLimits = DEFAULT_LIMITS, *, exact: bool = False
) -> tuple[list[Any], int]:
    """Decode ``count`` arguments of a packet; return them and the position after the last.

    Raises:
        ProtocolError: If the arguments do not match the count and the lengths.
    """
    if count * 10 > end - _BODY:
        raise ProtocolError(tr("{count} arguments do not fit into {present} bytes", count=count, present=end - _BODY))
    arguments = []
    position = _BODY
    budget = [limits.variants]
    for _ in range(count):
        value, position = codec.decode(frame, position, end, limits, exact=exact, budget=budget)
        arguments.append(value)
    return arguments, position


def is_whole(frame: bytes) -> bool:
    """Return True if the bytes begin with SOH and their own length, and end with EOT; nothing else is checked."""
    return len(frame) >= OVERHEAD and frame[-1] == EOT and _START(frame) == (SOH, len(frame))


def has_correct_crc(frame: bytes) -> bool:
    """Return True if the CRC of a packet is correct."""
    return bool(_CRC.unpack_from(frame, len(frame) - 3)[0] == checksum(frame[1:-3]))


def check_frame(frame: bytes, limits: PacketLimits = DEFAULT_LIMITS, *, crc: bool = False) -> None:
    """Check the frame of a complete packet: SOH, length, EOT, CRC.

    Raises:
        ProtocolError: If SOH, length, EOT or CRC is wrong.
    """
    length = len(frame)
    smallest = OVERHEAD + 2 if crc else OVERHEAD
    if length < smallest or frame[-1] != EOT or _START(frame) != (SOH, length):
        raise ProtocolError(
            tr(
                "{count} bytes {begin}... are not a packet: SOH 01 and the length must come first, EOT 04 last",
                count=len(frame),
                begin=frame[:8].hex(" "),
            ),
            fatal=True,
        )
    if length > limits.packet:
        raise _too_long(length, limits)
    if crc and not has_correct_crc(frame):
        raise ProtocolError(
            tr(
                "CRC {found} is wrong, expected {right}",
                found=frame[-3:-1].hex(),
                right=_CRC.pack(checksum(frame[1:-3])).hex(),
            )
        )


def _too_long(length: int, limits: PacketLimits) -> LimitExceeded:
    return LimitExceeded(
        tr("packet of {length} bytes exceeds the limit of {most} bytes", length=length, most=limits.packet),
        hresult.E_PACKETSIZEOVER,
        fatal=True,
    )


def _no_packet(data: bytes | bytearray) -> ProtocolError:
    """Return the exception for data that does not begin with SOH.

    The text of the exception shows the first bytes of the data in printable form.
    """
    shown = ascii(bytes(data[:_SHOWN]))[1:] + ("..." if len(data) > _SHOWN else "")
    hint = tr(". This is HTTP. Try: use an http:// address and an e-CAP server") if _HTTP.match(data) else ""
    return ProtocolError(
        tr(
            "{shown} is not b-CAP: a packet must begin with SOH 01, not {first:02x}{hint}",
            shown=shown,
            first=data[0],
            hint=hint,
        ),
        fatal=True,
    )


class FramerBase:
    """Base class of the framers: stores the limits and the received bytes."""

    def __init__(self, limits: PacketLimits) -> None:
        self.limits = limits
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Number of buffered bytes of an incomplete packet."""
        return len(self._buffer)

    @property
    def is_empty(self) -> bool:
        """True if no received bytes are buffered."""
        return not self._buffer


class Framer(FramerBase):
    """Extracts packets from a byte stream, which may arrive in pieces of any size.

    Every packet must begin where the previous one ends. A first byte other than SOH, an impossible length, or a last
    byte other than EOT raises an exception. All later calls raise the same exception: the framer does not search for
    another packet. This protects against web pages, which can make a browser send any bytes to a server. An HTTP header
    always precedes these bytes, and the header raises the exception.
    """

    skipped_bytes = 0
    """Always 0: no bytes are skipped in a byte stream."""
    is_searching = False
    """Always False: there is no search for packets in a byte stream."""

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS) -> None:
        super().__init__(limits)
        self._error: ProtocolError | None = None

    def has_whole(self, data: bytes) -> bool:
        """Return True if the next bytes of the stream are exactly one packet within the limits; do not add them.

        In this case, :meth:`feed` would return ``data`` itself, and would not change anything.
        """
        if self._buffer or self._error is not None or len(data) < OVERHEAD:
            return False
        soh, length = _START(data)
        return soh == SOH and length == len(data) and data[-1] == EOT and length <= self.limits.packet

    @property
    def is_empty(self) -> bool:
        """True if no received bytes are buffered, and the stream contained nothing but packets so far."""
        return not self._buffer and self._error is None

    @property
    def partial_serial(self) -> int:
        """Always 0: not used for a byte stream."""
        return 0

    def resync(self) -> bytes | None:
        """Return None: in a byte stream, an incomplete packet contains no other packet."""
        return None

    def discard_incomplete(self) -> bytes | None:
        """Return None: in a byte stream, the rest of a packet is never lost."""
        return None

    def feed(self, data: bytes) -> bytes | None:
        """Add the next bytes of the stream and return the first complete packet; :meth:`next_frame` returns the others.

        Raises:
            ProtocolError: See :meth:`next_frame`.
        """
        if self.has_whole(data):
            return data  # the usual case: exactly one packet, without buffering or copying
        if self._error is None:
            self._buffer += data
        return self.next_frame()

    def next_frame(self) -> bytes | None:
        """Return the next complete packet, or ``None`` if more bytes are needed.

        Raises:
            ProtocolError: If the data is not a packet; the ``fatal`` of the exception is True.
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
                        "a packet of {length} bytes must end with EOT 04, not {last:02x}",
                        length=length,
                        last=buffer[length - 1],
                    ),
                    fatal=True,
                )
            )
        if len(buffer) == length and length > _COPIED:
            self._buffer = bytearray()
            return cast("bytes", buffer)  # it can be read like bytes, and it is no longer modified
        with memoryview(buffer) as view:
            frame = bytes(view[:length])
        del buffer[:length]
        return frame

    def _refuse_length(self, length: int) -> ProtocolError:
        if length > self.limits.packet:
            return self._lost(_too_long(length, self.limits))
        return self._lost(
            ProtocolError(
                tr("packet of {length} bytes is below the minimum of {least} bytes", length=length, least=OVERHEAD),
                fatal=True,
            )
        )

    def _lost(self, error: ProtocolError) -> ProtocolError:
        self._error = error
        self._buffer.clear()
        return error
