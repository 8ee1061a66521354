"""Multi-packet messages of up to 1785 bytes between a host and a driver (J1939-21, connection mode).

The sender announces a message (RTS). The receiver requests its packets in bursts (CTS) and finally acknowledges the
message (EndOfMsgACK). Either side may abort at any time (Abort). A driver replies to a message with another message.
:func:`exchange` sends a message and receives the reply, for a host. :class:`Responder` receives messages and sends the
replies, for a virtual driver.

A lost packet is requested again, and a packet that arrives twice is ignored. A message is never sent twice: if it is
lost, an exception is raised. Announcements to all nodes (BAM) are ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from orinkit.abh3.session.transfers import LONGEST as LONGEST
from orinkit.abh3.session.transfers import SHORTEST as SHORTEST
from orinkit.abh3.session.transfers import SYN as SYN
from orinkit.abh3.session.transfers import (
    IncomingTransfer,
    OutgoingTransfer,
    TransferAddresses,
    TransferFrame,
    TransferStep,
    parse_transfer_frame,
)
from orinkit.abh3.table.ids import EVERYONE, check_address, check_priority
from orinkit.abh3.table.transfer_fields import ABORT, BUSY, LATE, RTS
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

TIMEOUT: Final = 1.25
"""Seconds that each side waits for a frame of its peer."""
PAUSE: Final = 0.001
"""Seconds between data packets of a host. Without a pause, an interface may lose frames and a driver may abort."""


def send_message(
    message: bytes, *, host: int, driver: int, priority: int = 0, seconds: float = TIMEOUT, pause: float = PAUSE
) -> CanOperation[None]:
    """Send a message to a driver.

    Args:
        message: 1 to 1785 bytes; if shorter than 9 bytes, it is padded with SYN, which drivers ignore.
        host: Address of this side.
        driver: Address of the driver.
        priority: Priority of the frames, 0 to 7.
        seconds: Time-out for each frame of the driver, in s.
        pause: Pause between data packets, in s.

    Raises:
        InvalidValue: If the message, an address or the priority is not valid; nothing was sent.
        DriverTimeout: If the driver sent no frame in time; an Abort with reason 3 (time-out) was sent to it.
        ProtocolError: If the driver aborted or replied with an unexpected packet; the text of the exception contains
            the reason.
    """
    return _send(OutgoingTransfer(message, _addresses(host, driver, priority), seconds, pause))


def receive_message(*, host: int, driver: int, priority: int = 0, seconds: float = TIMEOUT) -> CanOperation[bytes]:
    """Receive a message that a driver sends.

    Args:
        host: Address of this side.
        driver: Address of the driver.
        priority: Priority of the frames, 0 to 7.
        seconds: Time-out for each frame of the driver, in s.

    Returns:
        9 to 1785 bytes, including the SYN that pads a short message.

    Raises:
        InvalidValue: If an address or the priority is not valid; nothing was sent.
        DriverTimeout: If the driver sent no frame in time; an Abort with reason 3 (time-out) was sent to it.
        ProtocolError: If the driver aborted or sent an unexpected packet; the text of the exception contains the
            reason.
    """
    return _receive(IncomingTransfer(_addresses(host, driver, priority), seconds))


def exchange(
    message: bytes,
    *,
    host: int,
    driver: int,
    priority: int = 0,
    seconds: float = TIMEOUT,
    pause: float = PAUSE,
    afresh: bool = False,
) -> CanOperation[bytes]:
    """Send a message to a driver and receive its reply; the arguments are those of :func:`send_message`.

    With ``afresh``, an Abort is sent first, in case a previous exchange is incomplete.

    Returns:
        9 to 1785 bytes, including the SYN that pads a short reply.

    Raises:
        InvalidValue: If the message, an address or the priority is not valid; nothing was sent.
        DriverTimeout: If the driver sent no frame in time; an Abort with reason 3 (time-out) was sent to it. The driver
            may still have read the message.
        ProtocolError: If the driver aborted or sent an unexpected packet; the text of the exception contains the
            reason.
    """
    addresses = _addresses(host, driver, priority)
    sending = OutgoingTransfer(message, addresses, seconds, pause, replied=True)
    return _exchange(sending, IncomingTransfer(addresses, seconds), (addresses.control(ABORT, LATE),) if afresh else ())


class Responder:
    """The driver's side: receives messages from any host, one at a time, and sends the replies.

    The caller passes in frames with the time of a monotonic clock. The methods return the frames that the caller must
    send.

    Args:
        address: Address of the driver.
        handler: Called with a message and the address of the host; returns the reply, 1 to 1785 bytes, or ``None`` or
            ``b""`` for no reply. Its exceptions propagate from :meth:`receive`, and the message gets no reply.
        priority: Priority of the frames, 0 to 7.
        seconds: Time-out for each frame of the host, in s.
        pause: Pause between data packets, in s; with 0, all requested packets are returned together.

    Raises:
        InvalidValue: If the address or the priority is not valid.
    """

    def __init__(
        self,
        address: int,
        handler: Callable[[bytes, int], bytes | None],
        *,
        priority: int = 0,
        seconds: float = TIMEOUT,
        pause: float = 0.0,
    ) -> None:
        self._address = check_address("address", address)
        self._handler = handler
        self._priority = check_priority(priority)
        self._seconds = seconds
        self._pause = pause
        self._host = EVERYONE
        self._transfer: OutgoingTransfer | IncomingTransfer | None = None
        self._next_time: float | None = None

    @property
    def next_time(self) -> float | None:
        """Time at which to call :meth:`tick`; ``None`` while no transfer is in progress."""
        return self._next_time

    def receive(self, frame: CanFrame, now: float) -> list[CanFrame]:
        """Process a frame of any kind.

        Args:
            frame: A frame from the bus; frames for other nodes are ignored.
            now: Current time in s.

        Returns:
            The frames to be sent now.

        Raises:
            InvalidValue: If the handler's reply is too long.
        """
        packet = parse_transfer_frame(frame)
        if packet is None or packet.destination != self._address or packet.source in (self._address, EVERYONE):
            return []
        if packet.kind == RTS and not self._is_underway(packet):
            if self._transfer is not None and packet.source != self._host:
                return [self._addresses(packet.source).control(ABORT, BUSY)]
            self._host = packet.source  # a host that announces another message has abandoned its previous one
            self._transfer = IncomingTransfer(self._addresses(packet.source), self._seconds)
        if self._transfer is None:
            return []
        return self._apply(self._transfer, self._transfer.take(frame), now)

    def tick(self, now: float) -> list[CanFrame]:
        """Return the frames that are due at the time ``now``, in s."""
        if self._transfer is None or self._next_time is None or now < self._next_time:
            return []
        return self._apply(self._transfer, self._transfer.silent(), now)

    def _addresses(self, host: int) -> TransferAddresses:
        return TransferAddresses(self._address, host, self._priority)

    def _is_underway(self, packet: TransferFrame) -> bool:
        transfer = self._transfer
        return isinstance(transfer, IncomingTransfer) and packet.source == self._host and transfer.is_opened_by(packet)

    def _apply(self, transfer: OutgoingTransfer | IncomingTransfer, step: TransferStep, now: float) -> list[CanFrame]:
        frames = list(step.frames)
        while step.seconds == 0 and not step.ended:  # packets that follow without a pause
            step = transfer.silent()
            frames.extend(step.frames)
        if step.seconds is not None:
            self._next_time = now + step.seconds
        if not step.ended:
            return frames
        self._transfer = self._next_time = None
        if isinstance(transfer, IncomingTransfer) and step.error is None:
            frames.extend(self._reply(transfer.message, now))
        return frames

    def _reply(self, message: bytes, now: float) -> list[CanFrame]:
        answer = self._handler(message, self._host)
        if not answer:
            return []
        self._transfer = OutgoingTransfer(answer, self._addresses(self._host), self._seconds, self._pause)
        return self._apply(self._transfer, self._transfer.begin(), now)


def _addresses(host: int, driver: int, priority: int) -> TransferAddresses:
    if host == driver:
        raise InvalidValue(tr("driver and host have the same address {host}", host=host))
    return TransferAddresses(check_address("host", host), check_address("driver", driver), check_priority(priority))


def _send(sending: OutgoingTransfer) -> CanOperation[None]:
    yield from _run(sending, sending.begin(), fresh=True)


def _receive(receiving: IncomingTransfer) -> CanOperation[bytes]:
    yield from _run(receiving, receiving.begin())
    return receiving.message


def _exchange(
    sending: OutgoingTransfer, receiving: IncomingTransfer, before: tuple[CanFrame, ...]
) -> CanOperation[bytes]:
    step = sending.begin()
    last = yield from _run(sending, step._replace(frames=before + step.frames), fresh=True)
    opened = receiving.take(last)  # if the EndOfMsgACK was lost, "last" is the RTS of the driver's reply
    yield from _run(receiving, opened if opened.frames else receiving.begin())
    return receiving.message


def _run(
    transfer: OutgoingTransfer | IncomingTransfer, step: TransferStep, *, fresh: bool = False
) -> CanOperation[CanFrame]:
    """Run a transfer to its end and return the frame that ended it."""
    frame: CanFrame | None = None
    while not step.ended:
        frame = yield OperationStep(step.frames, step.seconds, fresh)
        fresh = False
        step = transfer.silent() if frame is None else transfer.take(frame)
    if step.frames:
        yield OperationStep(step.frames, 0.0)
    if step.error is not None:
        raise step.error
    assert frame is not None  # after a time-out, the error was raised above
    return frame
