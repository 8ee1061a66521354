"""The raw connection of an open page: :class:`RawLink` (RC8 5.2)."""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import ConnectionClosed, InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import whole
from orinkit.raw.exchange import LoopProgress, RawExchange, RawPacket
from orinkit.raw.options import RawOptions
from orinkit.raw.pieces import MOST_BYTES
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.packet_log import Direction, LoggedPacket
from orinkit.tester.state.workspace import Workspace

logger = logging.getLogger("orinkit.tester")

MOST_ROUNDS: Final = 1_000_000
"""Largest number of rounds of a loop."""
SHOWN_PACKETS: Final = 12
"""Number of latest packets that the page lists."""
_CHECK: Final = 0.05  # s between two checks whether the user is present and the link is open
_AWAITED: Final = 16  # requests to which replies are assigned by peer and serial
_BACKGROUND: Final[set[asyncio.Task[None]]] = set()


@dataclass(frozen=True, slots=True)
class RawEntry:
    """A packet that was sent or received.

    Attributes:
        number: Number of the packet on this link, from 1.
        packet: The packet.
        is_request: True for the packets of the clients, False for those of the server.
        request: For a packet of the server, the bytes of its request, if there is one.
    """

    number: int
    packet: RawPacket
    is_request: bool
    request: bytes | None

    @property
    def is_sent(self) -> bool:
        """True if this side has sent the packet."""
        return self.packet.direction == ">"

    def logged(self, scheme: str) -> LoggedPacket:
        """Return the packet in the form that the explanation requires."""
        direction: Direction = ">" if self.is_request else "<"
        nanoseconds = int(self.packet.time * 1e9)
        return LoggedPacket(
            self.number, nanoseconds, self.packet.peer, scheme, direction, self.packet.data, self.request
        )  # fmt: skip


class RawLink:
    """The raw connection of one open page. While it is open, it belongs to ``workspace.motions``.

    A raw packet may start a motion. Therefore, the connection is closed if the user of the page is absent, or the stop
    button is pressed; the controller then stops the motion.

    Args:
        workspace: The state that all pages share.
        absent: Function that returns why the user counts as absent; ``""`` if the user is present and holds the
            controls.

    Attributes:
        state: The state.
        error: Why connecting failed, or the connection was lost.
        notice: Why the Tester has closed the connection; ``""`` if the user has.
        version: Counts the changes of the state, and the packets.
        options: The parameters of the latest connection.
        sent: Number of packets sent since the connection was opened.
        received: Number of packets received since the connection was opened.
        latest: The latest packets, oldest first.
        last_received: The last packet received.
        progress: The state of the current loop, or of the last one.
        interruption: Why the last loop was stopped; ``""`` if it was not.
    """

    def __init__(self, workspace: Workspace, absent: Callable[[], str]) -> None:
        self._workspace = workspace
        self._absent = absent
        self._exchange: RawExchange | None = None
        self._awaited: OrderedDict[tuple[str, bytes], bytes] = OrderedDict()
        self._last_request: dict[str, bytes] = {}
        self._unattended: Callable[[], str] = str
        self._is_sending = False
        self._attempt = 0
        self.state = ConnectionState.CLOSED
        self.error: Exception | None = None
        self.notice = ""
        self.version = 0
        self.options: RawOptions | None = None
        self._reset()

    def _reset(self) -> None:
        self.sent = self.received = 0
        self.latest: deque[RawEntry] = deque(maxlen=SHOWN_PACKETS)
        self.last_received: RawEntry | None = None
        self.progress: LoopProgress | None = None
        self.interruption = ""
        self._awaited.clear()
        self._last_request.clear()

    @property
    def is_open(self) -> bool:
        """True if packets can be sent, or clients can connect."""
        return self.state is ConnectionState.OPEN

    @property
    def is_sending(self) -> bool:
        """True while packets are being sent, or replies awaited."""
        return self._is_sending

    @property
    def serves(self) -> bool:
        """True in the server roles."""
        return self.options is not None and self.options.role.serves

    @property
    def scheme(self) -> str:
        """The scheme of the transport: tcp, udp, serial."""
        return self.options.role.profile.name if self.options else "tcp"

    @property
    def url(self) -> str:
        """Address of the controller, or the address that the server listens on."""
        return self._exchange.url if self._exchange else ""

    @property
    def peers(self) -> tuple[str, ...]:
        """The connected clients in the server roles."""
        return self._exchange.peers if self._exchange and self.serves else ()

    # --- connecting ---------------------------------------------------------------------------------------------------

    async def open(self, options: RawOptions) -> None:
        """Connect, or listen.

        Raises:
            InvalidValue: If the link is open, or the Tester uses the serial line.
            OrinError: If it cannot be opened; :attr:`error` is then the exception.
        """
        if self.state in (ConnectionState.OPEN, ConnectionState.CONNECTING):
            raise InvalidValue(tr("the raw connection is open. Try: disconnect it first"))
        self._check_line(options)
        self.options = options
        self._reset()
        self._attempt += 1
        attempt = self._attempt
        self._workspace.motions.add(self)
        self._set(ConnectionState.CONNECTING)
        try:
            exchange = await RawExchange.open(options, self._note)
        except BaseException as error:
            if attempt == self._attempt:
                self._workspace.motions.discard(self)
                self._set(ConnectionState.CLOSED, error if isinstance(error, Exception) else None)
            raise
        if attempt != self._attempt:
            await exchange.close()
            raise ConnectionClosed(tr("the raw connection was closed before it was open"))
        self._exchange = exchange
        self._set(ConnectionState.OPEN)
        task = asyncio.create_task(self._watch(exchange))
        _BACKGROUND.add(task)
        task.add_done_callback(_BACKGROUND.discard)

    def _check_line(self, options: RawOptions) -> None:
        """Check that no connection of the Tester uses the same serial line."""
        for each in self._workspace:
            if each.is_open and each.spec.scheme == options.address.scheme == "serial":
                used = RawOptions.parse(each.spec.url).address
                if getattr(used, "path", "") == getattr(options.address, "path", ""):
                    raise InvalidValue(
                        tr("{name} uses this serial line. Try: disconnect it on the page Connections", name=each.name)
                    )

    async def close(self, reason: str = "") -> None:
        """Close the connection, which ends a loop; do nothing if it is closed.

        Args:
            reason: Why, if the user has not closed it.
        """
        exchange, self._exchange = self._exchange, None
        self._attempt += 1  # an attempt to connect that is in progress is in vain
        self._workspace.motions.discard(self)
        if self.state in (ConnectionState.OPEN, ConnectionState.CONNECTING):
            self._set(ConnectionState.CLOSED, notice=reason)
        if exchange is not None:
            await exchange.close()

    async def stop(self, reason: str) -> None:
        """Close the connection, so that the controller stops a motion that a packet has started."""
        logger.info("raw connection: closed: %s", reason)
        self.stop_sending(reason)
        await self.close(reason)

    async def _watch(self, exchange: RawExchange) -> None:
        """Close the connection if the user is absent, stop a loop that nobody attends, detect the loss of the link."""
        while self._exchange is exchange:
            if reason := self._absent():
                await self.stop(reason)
            elif not exchange.is_open:
                logger.warning("raw connection: lost: %s", exchange.error)
                await self.close()
                self._set(ConnectionState.LOST, exchange.error)
            elif self._is_sending and (reason := self._unattended()):
                self.stop_sending(reason)
            await asyncio.sleep(_CHECK)

    def _set(self, state: ConnectionState, error: Exception | None = None, notice: str = "") -> None:
        self.state, self.error, self.notice = state, error, notice
        self.version += 1

    # --- sending ------------------------------------------------------------------------------------------------------

    async def send(
        self, packets: Sequence[bytes], count: int = 1, peer: str = "", unattended: Callable[[], str] = str
    ) -> LoopProgress:
        """Send packets, each after the reply to the previous one; a server does not wait for replies.

        Args:
            packets: The packets, in order.
            count: Number of times to send all of them.
            peer: In the server roles the client, or :data:`orinkit.raw.exchange.ALL`.
            unattended: Function that returns why a loop must stop; ``""`` while it may continue.

        Returns:
            The final state.

        Raises:
            InvalidValue: If the link is not open, is sending already, or ``count`` is invalid.
            OrinError: If the connection is lost.
        """
        exchange = self._exchange
        if exchange is None or not self.is_open:
            raise InvalidValue(tr("the raw connection is not open. Try: press Connect"))
        if self._is_sending:
            raise InvalidValue(tr("packets are being sent. Try: press Stop"))
        if (whole(count) or 0) not in range(1, MOST_ROUNDS + 1):
            raise InvalidValue(tr("the count must be 1 to {most}", most=f"{MOST_ROUNDS:,}"))
        self._is_sending, self.interruption, self._unattended = True, "", unattended
        self.progress = LoopProgress(0, count)
        self.version += 1
        try:
            wait = False if self.serves else None
            self.progress = await exchange.loop(packets, count, self._advance, peer, wait=wait)
        finally:
            self._is_sending = False
            self.version += 1
        return self.progress

    def stop_sending(self, reason: str) -> None:
        """End a loop, and the wait for a reply."""
        if self._is_sending and self._exchange is not None:
            self.interruption = self.interruption or reason
            self._exchange.stop()

    def _advance(self, progress: LoopProgress) -> None:
        self.progress = progress
        if reason := self._absent() or self._unattended():
            self.stop_sending(reason)

    def clear(self) -> None:
        """Forget the packets, and set the counters to zero."""
        progress = self.progress
        self._reset()
        self.progress = progress
        self.version += 1

    # --- packets ------------------------------------------------------------------------------------------------------

    def _note(self, packet: RawPacket) -> None:
        """Count a packet, and assign a reply to its request."""
        is_sent = packet.direction == ">"
        is_request = is_sent != self.serves
        entry = RawEntry(self.sent + self.received + 1, packet, is_request, self._request_of(packet, is_request))
        if is_sent:
            self.sent += 1
        else:
            self.received += 1
            self.last_received = entry
        self._keep(entry)
        self.version += 1
        if not self.serves:  # the page Packets regards what was sent as requests
            self._workspace.packets.add(
                f"raw {packet.peer}", self.scheme, packet.direction, packet.data, int(packet.time * 1e9)
            )

    def _keep(self, entry: RawEntry) -> None:
        self.latest.append(entry)
        while len(self.latest) > 1 and sum(len(each.packet.data) for each in self.latest) > MOST_BYTES:
            self.latest.popleft()

    def _request_of(self, packet: RawPacket, is_request: bool) -> bytes | None:
        key = packet.peer, packet.data[5:7]
        if not is_request:
            return self._awaited.get(key) or self._last_request.get(packet.peer)
        self._awaited.pop(key, None)
        self._awaited[key] = packet.data
        self._last_request = {packet.peer: packet.data}
        if len(self._awaited) > _AWAITED:
            self._awaited.popitem(last=False)
        return None
