"""One multi-packet message on its way, sent or received, without I/O and without a clock (J1939-21, connection mode).

Both directions are state machines with three inputs: :meth:`begin`, :meth:`take` (a frame has come) and :meth:`silent`
(the wait is over). Each returns a :class:`TransferStep`: what to send, and how long to wait. Hosts and drivers use the same.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.abh3.table.ids import CONTROL, TRANSFER, FrameId
from orinkit.abh3.table.transfer_fields import ABORT, BUSY, CTS, END, LATE, REASONS, RESENT, RESOURCES, RTS, SEQUENCE
from orinkit.can.frame import CanFrame
from orinkit.core.errors import DriverTimeout, InvalidValue, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief

SHORTEST: Final = 9
LONGEST: Final = 1785
SYN: Final = b"\x16"

_PGN: Final = b"\x00\xef\x00"
_SIZE: Final = 8
_CARRIED: Final = 7  # bytes of the message in one packet
_BURST: Final = 16  # packets that are asked for with one CTS, at most
_REPEATS: Final = 16  # packets may be asked for again so often in one message
_SPARE_GRANTS: Final = 32
_PATIENCE: Final = 0.6  # of the time-out; then missing packets are asked for again. 0.75 s of 1.25 s, as in J1939-21


class TransferStep(NamedTuple):
    """What a transfer wants next.

    Attributes:
        frames: to send.
        seconds: to wait from now on; ``None`` where the wait in force goes on.
        ended: the transfer is over once the frames are sent.
        error: why it has failed.
    """

    frames: tuple[CanFrame, ...] = ()
    seconds: float | None = None
    ended: bool = False
    error: OrinError | None = None


class TransferFrame(NamedTuple):
    """A frame of a multi-packet message.

    Attributes:
        kind: RTS, CTS, END, ABORT or another control byte; ``None`` of a data packet.
        destination: address that it is for.
        source: address that it is from.
        data: its 8 bytes.
    """

    kind: int | None
    destination: int
    source: int
    data: bytes


def packet_of(frame: CanFrame) -> TransferFrame | None:
    """Return what a frame says of a multi-packet message between hosts and drivers; ``None`` of any other frame."""
    parts = FrameId.parse(frame.id)
    if parts.reserved or parts.dp or len(frame.data) != _SIZE:
        return None
    if parts.pf == TRANSFER:
        return TransferFrame(None, parts.ps, parts.sa, frame.data)
    if parts.pf == CONTROL and frame.data[5:] == _PGN:
        return TransferFrame(frame.data[0], parts.ps, parts.sa, frame.data)
    return None


class TransferRoute(NamedTuple):
    """Who a message goes to.

    Attributes:
        own: address of this side.
        peer: address of the other side.
        priority: of the frames that this side sends.
    """

    own: int
    peer: int
    priority: int = 0

    def control(self, *head: int) -> CanFrame:
        """Return a control frame that begins with these bytes."""
        data = bytes(head).ljust(5, b"\xff") + _PGN
        return CanFrame(int(FrameId(CONTROL, self.peer, self.own, 0, self.priority)), data)

    def transfer(self, number: int, data: bytes) -> CanFrame:
        """Return a data packet."""
        data = bytes((number,)) + data.ljust(_CARRIED, b"\xff")
        return CanFrame(int(FrameId(TRANSFER, self.peer, self.own, 0, self.priority)), data)

    def heard(self, frame: CanFrame) -> TransferFrame | None:
        """Return what a frame says, if the other side has sent it to this one."""
        packet = packet_of(frame)
        return packet if packet and (packet.destination, packet.source) == (self.own, self.peer) else None

    def given_up(self, reason: int, error: OrinError) -> TransferStep:
        """Return the step that tells the other side that the transfer has failed here."""
        return TransferStep((self.control(ABORT, reason),), ended=True, error=error)

    def late(self, seconds: float) -> TransferStep:
        """Return the step after which nobody waits any more."""
        return self.given_up(LATE, DriverTimeout("abh3_can_trans", seconds, self.peer))

    def clash(self) -> TransferStep:
        """Return the step that refuses a message while another one is on its way."""
        text = tr("the other side began a message while another one was on its way. Try: again")
        return self.given_up(BUSY, ProtocolError(text))


class OutgoingTransfer:
    """A message that this side sends.

    Args:
        message: 1 to 1785 bytes; with less than 9 it is filled up with SYN, which the other side pays no attention to.
        route: who it goes to.
        seconds: time-out of each frame of the other side.
        pause: between two data packets, in s.
        answered: once all packets are sent, an RTS of the other side says too that the message has arrived.

    Raises:
        InvalidValue: the message is empty, too long, or no bytes.
    """

    def __init__(
        self, message: bytes, route: TransferRoute, seconds: float, pause: float = 0.0, *, answered: bool = False
    ) -> None:
        if not isinstance(message, bytes | bytearray):
            raise InvalidValue(tr("bytes are needed, not {message}", message=brief(message)))
        if not 1 <= len(message) <= LONGEST:
            raise InvalidValue(
                tr("a multi-packet message has 1 to {longest} bytes, not {count}", longest=LONGEST, count=len(message))
            )
        self._message = bytes(message).ljust(SHORTEST, SYN)
        self._total = _packets(len(self._message))
        self._route = route
        self._seconds = seconds
        self._pause = pause
        self._answered = answered
        self._next = 1
        self._last = 0  # of those that are to be sent now
        self._furthest = 0  # that was ever sent
        self._grants = 0

    def begin(self) -> TransferStep:
        """Return the first step: the RTS."""
        size = len(self._message)
        return TransferStep(
            (self._route.control(RTS, size & 0xFF, size >> 8, self._total, self._total),), self._seconds
        )

    def take(self, frame: CanFrame) -> TransferStep:
        """Return the step that follows a frame."""
        packet = self._route.heard(frame)
        kind = packet.kind if packet else None
        if packet is None or kind is None:
            return self._onwards()
        if kind == CTS:
            return self._granted(packet.data[1], packet.data[2])
        if kind == ABORT:
            return _aborted(packet)
        complete = self._furthest == self._total
        if kind == RTS and not (complete and self._answered):
            return self._route.clash()
        if kind in (END, RTS) and complete:  # the byte count of an END is wrong in some libraries
            return TransferStep(ended=True)
        return self._onwards()

    def silent(self) -> TransferStep:
        """Return the step that follows when the wait is over: the next data packet, or the end."""
        number = self._next
        if number > self._last:
            return self._route.late(self._seconds)
        self._next += 1
        self._furthest = max(self._furthest, number)
        data = self._message[(number - 1) * _CARRIED : number * _CARRIED]
        wait = self._pause if number < self._last else self._seconds
        return TransferStep((self._route.transfer(number, data),), wait)

    def _onwards(self) -> TransferStep:
        """A frame that changes nothing must not hold up packets that are to follow each other at once."""
        return self.silent() if self._next <= self._last and not self._pause else TransferStep()

    def _granted(self, count: int, first: int) -> TransferStep:
        self._grants += 1
        if self._grants > self._total + _SPARE_GRANTS:
            text = tr("the other side asked for the packets of one message too often")
            return self._route.given_up(RESENT, ProtocolError(text))
        if count == 0:  # it is not ready yet
            self._last = 0
            return TransferStep((), self._seconds)
        if not 1 <= first <= self._total:
            text = tr("the other side asked for packet {first} of {total}", first=first, total=self._total)
            return self._route.given_up(SEQUENCE, ProtocolError(text))
        self._next = first
        self._last = min(first + count - 1, self._total)
        return self.silent()


class IncomingTransfer:
    """A message that this side receives.

    Args:
        route: who it comes from.
        seconds: time-out of each frame of the other side.

    Attributes:
        message: once the transfer has ended without an error.
    """

    def __init__(self, route: TransferRoute, seconds: float) -> None:
        self.message = b""
        self._route = route
        self._seconds = seconds
        self._opening = b""  # the RTS
        self._size = 0
        self._total = 0
        self._burst = _BURST
        self._parts: dict[int, bytes] = {}
        self._first = 1  # of those that were asked for last
        self._last = 0
        self._repeats = 0
        self._reminded = False  # since the last new packet

    def begin(self) -> TransferStep:
        """Return the first step: waiting for an RTS."""
        return TransferStep((), self._seconds)

    def is_opened_by(self, packet: TransferFrame) -> bool:
        """Return whether this is the RTS that the message began with."""
        return packet.data == self._opening

    def take(self, frame: CanFrame) -> TransferStep:
        """Return the step that follows a frame."""
        packet = self._route.heard(frame)
        if packet is None:
            return TransferStep()
        if packet.kind is None:
            return self._stored(packet.data)
        if packet.kind == ABORT:
            return _aborted(packet)
        if packet.kind != RTS:
            return TransferStep()
        if not self._opening:
            return self._opened(packet.data)
        if not self.is_opened_by(packet):
            return self._route.clash()
        self._parts.clear()  # they may be of a message that was given up, and looked the same from outside
        return self._again()

    def silent(self) -> TransferStep:
        """Return the step that follows when the wait is over: packets are asked for once more, or the end."""
        if not self._opening or self._reminded:
            return self._route.late(self._seconds)
        self._reminded = True
        return self._again()

    def _opened(self, data: bytes) -> TransferStep:
        size, total = data[1] | data[2] << 8, data[3]
        if not SHORTEST <= size <= LONGEST or total != _packets(size):
            text = tr(
                "a message of {size} bytes in {total} packets cannot be; there are {shortest} to "
                "{longest} bytes, {carried} in each packet",
                size=size,
                total=total,
                shortest=SHORTEST,
                longest=LONGEST,
                carried=_CARRIED,
            )
            return self._route.given_up(RESOURCES, ProtocolError(text))
        self._opening = data
        self._size = size
        self._total = total
        self._burst = min(_BURST, data[4] or 1)
        return self._ask()

    def _stored(self, data: bytes) -> TransferStep:
        number = data[0]
        if not 1 <= number <= self._total:
            return TransferStep()
        new = number not in self._parts
        self._parts[number] = data[1:]
        self._reminded = self._reminded and not new
        if all(wanted in self._parts for wanted in range(self._first, self._last + 1)):
            return self._ask()
        if number == self._last:  # the burst is over, and some of it is missing
            return self._again()
        return TransferStep((), self._wait()) if new else TransferStep()

    def _again(self) -> TransferStep:
        self._repeats += 1
        if self._repeats > _REPEATS:
            text = tr(
                "packets {first} to {last} were asked for again too often. Try: is the bus overloaded?",
                first=self._first,
                last=self._last,
            )
            return self._route.given_up(RESENT, ProtocolError(text))
        return self._ask()

    def _ask(self) -> TransferStep:
        """Ask for the first packets that are missing; tell the other side if none are."""
        missing = [number for number in range(1, self._total + 1) if number not in self._parts]
        if not missing:
            self.message = b"".join(self._parts[number] for number in sorted(self._parts))[: self._size]
            return TransferStep(
                (self._route.control(END, self._size & 0xFF, self._size >> 8, self._total),), ended=True
            )
        self._first = self._last = missing[0]
        for number in missing[1 : self._burst]:  # none that is there already: it would come twice
            if number == self._last + 1:
                self._last = number
        return TransferStep((self._route.control(CTS, self._last - self._first + 1, self._first),), self._wait())

    def _wait(self) -> float:
        """The rest of the time-out, if packets were asked for again when the first part of it was over."""
        return self._seconds * (1 - _PATIENCE if self._reminded else _PATIENCE)


def _packets(size: int) -> int:
    return -(-size // _CARRIED)


def _aborted(packet: TransferFrame) -> TransferStep:
    reason = packet.data[1]
    text = tr(REASONS[reason]) if reason in REASONS else tr("unknown reason")
    return TransferStep(
        ended=True,
        error=ProtocolError(
            tr("the other side aborted the multi-packet message: {text} (reason {reason})", text=text, reason=reason)
        ),
    )
