"""Multi-packet messages: up to 1785 bytes between a host and a driver, in frames of 8 bytes (J1939-21, connection mode).

The side that has a message says so (RTS), the other one asks for its packets, some at a time (CTS), and says in the end
that it has them all (EndOfMsgACK). Either side may give up at any time (Abort). A driver answers a message with one of
its own; :func:`exchange` is both of them for a host, :class:`Responder` both of them for a virtual driver.

A packet that is lost is asked for again, one that comes twice is taken once. A message is never sent twice: one that
was lost on its way ends in an exception. Announcements to everybody (BAM) are passed over.
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
    TransferFrame,
    TransferRoute,
    TransferStep,
    packet_of,
)
from orinkit.abh3.table.ids import EVERYONE, check_address, check_priority
from orinkit.abh3.table.transfer_fields import ABORT, BUSY, LATE, RTS
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

TIMEOUT: Final = 1.25
"""Seconds that either side waits for a frame of the other one."""
PAUSE: Final = 0.001
"""Seconds from one data packet of a host to the next: interfaces have room for few frames, and a driver may abort."""


def send_message(
    message: bytes, *, host: int, driver: int, priority: int = 0, seconds: float = TIMEOUT, pause: float = PAUSE
) -> CanOperation[None]:
    """Send a message to a driver.

    Args:
        message: 1 to 1785 bytes; a shorter one than 9 is filled up with SYN, which drivers pay no attention to.
        host: address of this side.
        driver: address of the driver.
        priority: of the frames, 0 to 7.
        seconds: time-out of each frame of the driver.
        pause: between two data packets, in s.

    Raises:
        InvalidValue: message, address or priority cannot be; nothing was sent.
        DriverTimeout: the driver was silent; it was told so (Abort 3).
        ProtocolError: the driver gave up, or answered something else; the text says why.
    """
    return _send(OutgoingTransfer(message, _route(host, driver, priority), seconds, pause))


def receive_message(*, host: int, driver: int, priority: int = 0, seconds: float = TIMEOUT) -> CanOperation[bytes]:
    """Receive a message that a driver sends.

    Args:
        host: address of this side.
        driver: address of the driver.
        priority: of the frames, 0 to 7.
        seconds: time-out of each frame of the driver.

    Returns:
        9 to 1785 bytes, among them the SYN that a short message was filled up with.

    Raises:
        InvalidValue: address or priority cannot be; nothing was sent.
        DriverTimeout: the driver was silent; it was told so (Abort 3).
        ProtocolError: the driver gave up, or sent something else; the text says why.
    """
    return _receive(IncomingTransfer(_route(host, driver, priority), seconds))


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
    """Send a message to a driver and receive its answer.

    Args:
        message: 1 to 1785 bytes; a shorter one than 9 is filled up with SYN, which drivers pay no attention to.
        host: address of this side.
        driver: address of the driver.
        priority: of the frames, 0 to 7.
        seconds: time-out of each frame of the driver.
        pause: between two data packets, in s.
        afresh: an exchange before this one may not have come to its end: the driver is told first that it was given up (Abort).

    Returns:
        9 to 1785 bytes, among them the SYN that a short answer was filled up with.

    Raises:
        InvalidValue: message, address or priority cannot be; nothing was sent.
        DriverTimeout: the driver was silent, and was told so (Abort 3); whether it has read the message is not known.
        ProtocolError: the driver gave up, or sent something else; the text says why.
    """
    route = _route(host, driver, priority)
    sending = OutgoingTransfer(message, route, seconds, pause, answered=True)
    return _exchange(sending, IncomingTransfer(route, seconds), (route.control(ABORT, LATE),) if afresh else ())


class Responder:
    """A driver's side: takes messages of any host, one at a time, and sends the answers.

    Frames are fed to it with the time, by any clock that runs evenly; it returns the frames that are to be sent.

    Args:
        address: of the driver.
        handler: is given a message and the address of the host, and returns the answer, 1 to 1785 bytes; ``None`` or
            nothing for no answer. What it raises comes out of :meth:`receive`, and the message is not answered.
        priority: of the frames, 0 to 7.
        seconds: time-out of each frame of the host.
        pause: between two data packets, in s; with 0 those that were asked for are returned together.

    Raises:
        InvalidValue: address or priority cannot be.
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
        """When :meth:`tick` is to be called; ``None`` while no message is on its way."""
        return self._next_time

    def receive(self, frame: CanFrame, now: float) -> list[CanFrame]:
        """Take a frame, whatever it is.

        Args:
            frame: as it came from the bus; those that are not for this driver are passed over.
            now: in s.

        Returns:
            What is to be sent now.

        Raises:
            InvalidValue: the handler's answer is too long.
        """
        packet = packet_of(frame)
        if packet is None or packet.destination != self._address or packet.source in (self._address, EVERYONE):
            return []
        if packet.kind == RTS and not self._is_underway(packet):
            if self._transfer is not None and packet.source != self._host:
                return [self._route(packet.source).control(ABORT, BUSY)]
            self._host = packet.source  # one that begins anew has given up what was before
            self._transfer = IncomingTransfer(self._route(packet.source), self._seconds)
        if self._transfer is None:
            return []
        return self._after(self._transfer, self._transfer.take(frame), now)

    def tick(self, now: float) -> list[CanFrame]:
        """Return what is to be sent because of the time, in s."""
        if self._transfer is None or self._next_time is None or now < self._next_time:
            return []
        return self._after(self._transfer, self._transfer.silent(), now)

    def _route(self, host: int) -> TransferRoute:
        return TransferRoute(self._address, host, self._priority)

    def _is_underway(self, packet: TransferFrame) -> bool:
        transfer = self._transfer
        return isinstance(transfer, IncomingTransfer) and packet.source == self._host and transfer.is_opened_by(packet)

    def _after(self, transfer: OutgoingTransfer | IncomingTransfer, step: TransferStep, now: float) -> list[CanFrame]:
        frames = list(step.frames)
        while step.seconds == 0 and not step.ended:  # packets that follow each other at once
            step = transfer.silent()
            frames.extend(step.frames)
        if step.seconds is not None:
            self._next_time = now + step.seconds
        if not step.ended:
            return frames
        self._transfer = self._next_time = None
        if isinstance(transfer, IncomingTransfer) and step.error is None:
            frames.extend(self._answered(transfer.message, now))
        return frames

    def _answered(self, message: bytes, now: float) -> list[CanFrame]:
        answer = self._handler(message, self._host)
        if not answer:
            return []
        self._transfer = OutgoingTransfer(answer, self._route(self._host), self._seconds, self._pause)
        return self._after(self._transfer, self._transfer.begin(), now)


def _route(host: int, driver: int, priority: int) -> TransferRoute:
    if host == driver:
        raise InvalidValue(tr("driver and host have the same address {host}", host=host))
    return TransferRoute(check_address("host", host), check_address("driver", driver), check_priority(priority))


def _send(sending: OutgoingTransfer) -> CanOperation[None]:
    yield from _driven(sending, sending.begin(), fresh=True)


def _receive(receiving: IncomingTransfer) -> CanOperation[bytes]:
    yield from _driven(receiving, receiving.begin())
    return receiving.message


def _exchange(
    sending: OutgoingTransfer, receiving: IncomingTransfer, before: tuple[CanFrame, ...]
) -> CanOperation[bytes]:
    step = sending.begin()
    last = yield from _driven(sending, step._replace(frames=before + step.frames), fresh=True)
    opened = receiving.take(last)  # where the driver's END was lost, this is the RTS of its answer
    yield from _driven(receiving, opened if opened.frames else receiving.begin())
    return receiving.message


def _driven(
    transfer: OutgoingTransfer | IncomingTransfer, step: TransferStep, *, fresh: bool = False
) -> CanOperation[CanFrame]:
    """Carry a transfer through; returns the frame that ended it."""
    frame: CanFrame | None = None
    while not step.ended:
        frame = yield OperationStep(step.frames, step.seconds, fresh)
        fresh = False
        step = transfer.silent() if frame is None else transfer.take(frame)
    if step.frames:
        yield OperationStep(step.frames, 0.0)
    if step.error is not None:
        raise step.error
    assert frame is not None  # silence ends a transfer with an error
    return frame
