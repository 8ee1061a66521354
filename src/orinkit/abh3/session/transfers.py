"""The transfer of one multi-packet message, sent or received, without I/O and clock (J1939-21, connection mode).

Each direction is a state machine with three inputs: :meth:`begin`, :meth:`take` (a frame has arrived) and
:meth:`silent` (the wait has expired). Each input returns a :class:`TransferStep`: the frames to send, and the time to
wait. Hosts and drivers use the same classes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.abh3.table.ids import CONTROL, TRANSFER, FrameId
from orinkit.abh3.table.transfer_fields import ABORT, BUSY, CTS, END, LATE, REASONS, RESENT, RESOURCES, RTS, SEQUENCE
from orinkit.can.frame import CanFrame
from orinkit.core.errors import DriverTimeout, InvalidValue, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.core.validation import brief

SHORTEST: Final = 9
LONGEST: Final = 1785
SYN: Final = b"\x16"

_PGN: Final = b"\x00\xef\x00"
_SIZE: Final = 8
_PACKET_SIZE: Final = 7  # bytes of the message in one packet
_BURST: Final = 16  # maximum number of packets requested by one CTS
_MAX_REPEATS: Final = 16  # maximum number of repeated requests for packets of one message
_SPARE_GRANTS: Final = 32
_PATIENCE: Final = (
    0.6  # fraction of the time-out after which missing packets are requested again; J1939-21: 0.75 s of 1.25 s
)


class TransferStep(NamedTuple):
    """The next step of a transfer.

    Attributes:
        frames: Frames to send.
        seconds: Seconds to wait from now on; ``None`` to continue the current wait.
        ended: True if the transfer ends when the frames have been sent.
        error: The error with which the transfer has failed; ``None`` if it has not failed.
    """

    frames: tuple[CanFrame, ...] = ()
    seconds: float | None = None
    ended: bool = False
    error: OrinError | None = None


class TransferFrame(NamedTuple):
    """A frame of a multi-packet message.

    Attributes:
        kind: RTS, CTS, END, ABORT or another control byte; ``None`` for a data packet.
        destination: Address of the receiver.
        source: Address of the sender.
        data: The 8 bytes of the frame.
    """

    kind: int | None
    destination: int
    source: int
    data: bytes


def parse_transfer_frame(frame: CanFrame) -> TransferFrame | None:
    """Parse a frame of a multi-packet message between a host and a driver; return ``None`` for any other frame."""
    parts = FrameId.parse(frame.id)
    if parts.reserved or parts.dp or len(frame.data) != _SIZE:
        return None
    if parts.pf == TRANSFER:
        return TransferFrame(None, parts.ps, parts.sa, frame.data)
    if parts.pf == CONTROL and frame.data[5:] == _PGN:
        return TransferFrame(frame.data[0], parts.ps, parts.sa, frame.data)
    return None


class TransferAddresses(NamedTuple):
    """The addresses and the priority of a transfer.

    Attributes:
        own: Address of this side.
        peer: Address of the peer.
        priority: Priority of the frames that this side sends.
    """

    own: int
    peer: int
    priority: int = 0

    def control(self, *head: int) -> CanFrame:
        """Return a control frame for the peer that begins with the bytes ``head``."""
        data = bytes(head).ljust(5, b"\xff") + _PGN
        return CanFrame(int(FrameId(CONTROL, self.peer, self.own, 0, self.priority)), data)

    def transfer(self, number: int, data: bytes) -> CanFrame:
        """Return the data packet with a number, from 1, and up to 7 bytes of the message."""
        data = bytes((number,)) + data.ljust(_PACKET_SIZE, b"\xff")
        return CanFrame(int(FrameId(TRANSFER, self.peer, self.own, 0, self.priority)), data)

    def parse_from_peer(self, frame: CanFrame) -> TransferFrame | None:
        """Parse a frame from the peer to this side; return ``None`` for any other frame."""
        packet = parse_transfer_frame(frame)
        return packet if packet and (packet.destination, packet.source) == (self.own, self.peer) else None

    def abort_step(self, reason: int, error: OrinError) -> TransferStep:
        """Return the step that aborts a transfer that failed on this side."""
        return TransferStep((self.control(ABORT, reason),), ended=True, error=error)

    def timeout_step(self, seconds: float) -> TransferStep:
        """Return the step that aborts a transfer after a time-out."""
        return self.abort_step(LATE, DriverTimeout("abh3_can_trans", seconds, self.peer))

    def refuse_step(self) -> TransferStep:
        """Return the step that aborts this transfer because the peer has begun another message."""
        text = tr("the peer began a message during the transfer of another one. Try: repeat the call")
        return self.abort_step(BUSY, ProtocolError(text))


class OutgoingTransfer:
    """A message that this side sends.

    Args:
        message: 1 to 1785 bytes; if shorter than 9 bytes, it is padded with SYN, which the peer ignores.
        addresses: Addresses and priority.
        seconds: Time-out for each frame of the peer, in s.
        pause: Pause between data packets, in s.
        replied: True if the peer replies to the message. After the last packet, an RTS of the peer (the beginning of
            its reply) then also counts as an acknowledgement.

    Raises:
        InvalidValue: If the message is empty, too long, or not bytes.
    """

    def __init__(
        self, message: bytes, addresses: TransferAddresses, seconds: float, pause: float = 0.0, *, replied: bool = False
    ) -> None:
        if not isinstance(message, bytes | bytearray):
            raise InvalidValue(tr("the message must be bytes, not {message}", message=brief(message)))
        if not 1 <= len(message) <= LONGEST:
            raise InvalidValue(
                tr("a multi-packet message has 1 to {longest} bytes, not {count}", longest=LONGEST, count=len(message))
            )
        self._message = bytes(message).ljust(SHORTEST, SYN)
        self._total = _packets(len(self._message))
        self._addresses = addresses
        self._seconds = seconds
        self._pause = pause
        self._replied = replied
        self._next = 1
        self._last = 0  # last packet to send now
        self._furthest = 0  # highest number of a packet sent so far
        self._grants = 0

    def begin(self) -> TransferStep:
        """Return the first step: the RTS."""
        size = len(self._message)
        return TransferStep(
            (self._addresses.control(RTS, size & 0xFF, size >> 8, self._total, self._total),), self._seconds
        )

    def take(self, frame: CanFrame) -> TransferStep:
        """Process a frame and return the next step."""
        packet = self._addresses.parse_from_peer(frame)
        kind = packet.kind if packet else None
        if packet is None or kind is None:
            return self._ignore()
        if kind == CTS:
            return self._grant(packet.data[1], packet.data[2])
        if kind == ABORT:
            return _aborted(packet)
        complete = self._furthest == self._total
        if kind == RTS and not (complete and self._replied):
            return self._addresses.refuse_step()
        if kind in (END, RTS) and complete:  # the byte count in END may be wrong
            return TransferStep(ended=True)
        return self._ignore()

    def silent(self) -> TransferStep:
        """Process the end of the wait: return the step that sends the next data packet or aborts the transfer."""
        number = self._next
        if number > self._last:
            return self._addresses.timeout_step(self._seconds)
        self._next += 1
        self._furthest = max(self._furthest, number)
        data = self._message[(number - 1) * _PACKET_SIZE : number * _PACKET_SIZE]
        wait = self._pause if number < self._last else self._seconds
        return TransferStep((self._addresses.transfer(number, data),), wait)

    def _ignore(self) -> TransferStep:
        """Return the next step after an irrelevant frame.

        If there is no pause between data packets, the step sends the next one, which the frame must not delay.
        """
        return self.silent() if self._next <= self._last and not self._pause else TransferStep()

    def _grant(self, count: int, first: int) -> TransferStep:
        self._grants += 1
        if self._grants > self._total + _SPARE_GRANTS:
            text = tr("the peer requested the packets of one message too often")
            return self._addresses.abort_step(RESENT, ProtocolError(text))
        if count == 0:  # the peer is not ready yet
            self._last = 0
            return TransferStep((), self._seconds)
        if not 1 <= first <= self._total:
            text = tr(
                "the peer requested packet {first}, which does not exist; the message has {total} packets",
                first=first,
                total=self._total,
            )
            return self._addresses.abort_step(SEQUENCE, ProtocolError(text))
        self._next = first
        self._last = min(first + count - 1, self._total)
        return self.silent()


class IncomingTransfer:
    """A message that this side receives.

    Args:
        addresses: Addresses and priority.
        seconds: Time-out for each frame of the peer, in s.

    Attributes:
        message: The message, once the transfer has ended without an error.
    """

    def __init__(self, addresses: TransferAddresses, seconds: float) -> None:
        self.message = b""
        self._addresses = addresses
        self._seconds = seconds
        self._rts = b""  # data of the RTS; empty before it
        self._size = 0
        self._total = 0
        self._burst = _BURST
        self._parts: dict[int, bytes] = {}
        self._first = 1  # first and last packet of the latest request
        self._last = 0
        self._repeats = 0
        self._reminded = False  # missing packets were requested again since the last new packet

    def begin(self) -> TransferStep:
        """Return the first step: wait for an RTS."""
        return TransferStep((), self._seconds)

    def is_opened_by(self, packet: TransferFrame) -> bool:
        """Return True if a frame is the RTS of the current message."""
        return packet.data == self._rts

    def take(self, frame: CanFrame) -> TransferStep:
        """Process a frame and return the next step."""
        packet = self._addresses.parse_from_peer(frame)
        if packet is None:
            return TransferStep()
        if packet.kind is None:
            return self._store(packet.data)
        if packet.kind == ABORT:
            return _aborted(packet)
        if packet.kind != RTS:
            return TransferStep()
        if not self._rts:
            return self._open(packet.data)
        if not self.is_opened_by(packet):
            return self._addresses.refuse_step()
        self._parts.clear()  # these packets may belong to an abandoned message with an identical RTS
        return self._request_again()

    def silent(self) -> TransferStep:
        """Process the end of the wait: return the step that requests packets again or aborts the transfer."""
        if not self._rts or self._reminded:
            return self._addresses.timeout_step(self._seconds)
        self._reminded = True
        return self._request_again()

    def _open(self, data: bytes) -> TransferStep:
        size, total = data[1] | data[2] << 8, data[3]
        if not SHORTEST <= size <= LONGEST or total != _packets(size):
            text = tr(
                "a message of {size} bytes in {total} packets is not valid; a message has {shortest} to "
                "{longest} bytes, {carried} in each packet",
                size=size,
                total=total,
                shortest=SHORTEST,
                longest=LONGEST,
                carried=_PACKET_SIZE,
            )
            return self._addresses.abort_step(RESOURCES, ProtocolError(text))
        self._rts = data
        self._size = size
        self._total = total
        self._burst = min(_BURST, data[4] or 1)
        return self._request_missing()

    def _store(self, data: bytes) -> TransferStep:
        number = data[0]
        if not 1 <= number <= self._total:
            return TransferStep()
        new = number not in self._parts
        self._parts[number] = data[1:]
        self._reminded = self._reminded and not new
        if all(wanted in self._parts for wanted in range(self._first, self._last + 1)):
            return self._request_missing()
        if number == self._last:  # the end of a burst with missing packets
            return self._request_again()
        return TransferStep((), self._wait()) if new else TransferStep()

    def _request_again(self) -> TransferStep:
        self._repeats += 1
        if self._repeats > _MAX_REPEATS:
            text = tr(
                "packets {first} to {last} were requested again too often. Try: check the load of the bus",
                first=self._first,
                last=self._last,
            )
            return self._addresses.abort_step(RESENT, ProtocolError(text))
        return self._request_missing()

    def _request_missing(self) -> TransferStep:
        """Request the first missing packets, or acknowledge the complete message."""
        missing = [number for number in range(1, self._total + 1) if number not in self._parts]
        if not missing:
            self.message = b"".join(self._parts[number] for number in sorted(self._parts))[: self._size]
            return TransferStep(
                (self._addresses.control(END, self._size & 0xFF, self._size >> 8, self._total),), ended=True
            )
        self._first = self._last = missing[0]
        for number in missing[1 : self._burst]:  # up to the next packet that has arrived
            if number == self._last + 1:
                self._last = number
        return TransferStep((self._addresses.control(CTS, self._last - self._first + 1, self._first),), self._wait())

    def _wait(self) -> float:
        """Return the time in s to wait for the next packet.

        Missing packets are then requested again. If they already were, the time is the rest of the time-out.
        """
        return self._seconds * (1 - _PATIENCE if self._reminded else _PATIENCE)


def _packets(size: int) -> int:
    return -(-size // _PACKET_SIZE)


def _aborted(packet: TransferFrame) -> TransferStep:
    reason = packet.data[1]
    text = tr(REASONS[reason]) if reason in REASONS else tr("unknown reason")
    return TransferStep(
        ended=True,
        error=ProtocolError(
            tr("the peer aborted the multi-packet message: {text} (reason {reason})", text=text, reason=reason)
        ),
    )
