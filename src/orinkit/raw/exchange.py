"""Sending raw packets and waiting for replies, in asyncio (RC8 5.2.2).

A :class:`RawExchange` is a client over TCP, UDP or a serial line, or a server over TCP or UDP. It sends bytes of any
kind, does not change them, and logs all packets of both directions.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import monotonic, time
from typing import Final, Literal, NamedTuple, Self

from orinkit.bcap import packet
from orinkit.bcap.profiles import DATAGRAM
from orinkit.core.errors import InvalidValue, LimitExceeded, OrinError
from orinkit.core.hresult import S_EXECUTING
from orinkit.core.i18n import tr
from orinkit.core.validation import whole
from orinkit.raw.channels import Channel, Peer, no_peer, open_channel
from orinkit.raw.options import RawOptions, Role
from orinkit.raw.pieces import MOST_BYTES, PieceFramer
from orinkit.transport.link_errors import closed, lost

LONGEST_WAIT: Final = 600.0
"""Maximum time to wait for a reply, s, even if the controller sends S_EXECUTING again and again."""
MOST_LOGGED: Final = 100_000
"""Maximum number of packets in the log."""
ALL: Final[Peer] = "*"
"""All clients of a server, in place of one of them."""
_DATAGRAM: Final = 65507  # bytes
_UNREAD: Final = 1000  # packets that wait for receive()


class RawPacket(NamedTuple):
    """A packet in the log.

    Attributes:
        time: Seconds since 1970.
        direction: ``">"`` sent, ``"<"`` received.
        peer: The other side: address of the controller, or ``HOST:PORT`` of a client.
        data: The bytes, which need not be a b-CAP packet.
    """

    time: float
    direction: Literal[">", "<"]
    peer: Peer
    data: bytes


@dataclass(frozen=True, slots=True)
class LoopProgress:
    """The state of a loop.

    Attributes:
        rounds: Number of completed rounds.
        count: Number of rounds of the loop.
        sent: Number of packets sent.
        replies: Number of replies received.
        seconds: Time since the beginning of the loop, s.
        reply: The last reply; ``None`` if the last packet had none.
        stopped: True if :meth:`RawExchange.stop` has ended the loop.
    """

    rounds: int
    count: int
    sent: int = 0
    replies: int = 0
    seconds: float = 0.0
    reply: bytes | None = None
    stopped: bool = False

    @property
    def rate(self) -> float:
        """Packets sent per second."""
        return self.sent / self.seconds if self.seconds > 0 else 0.0


class PacketLog:
    """The latest packets, bounded by their number and by 16 MiB.

    Args:
        most: Maximum number of packets.

    Attributes:
        dropped: Number of packets that were removed because of the bounds.
    """

    def __init__(self, most: int) -> None:
        self.dropped = 0
        self._most = most
        self._packets: deque[RawPacket] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._packets)

    def __iter__(self) -> Iterator[RawPacket]:
        return iter(self._packets)

    def __getitem__(self, index: int) -> RawPacket:
        return self._packets[index]

    def append(self, entry: RawPacket) -> None:
        """Add a packet, and remove the oldest ones if there are too many."""
        self._packets.append(entry)
        self._bytes += len(entry.data)
        while len(self._packets) > self._most or (self._bytes > MOST_BYTES and len(self._packets) > 1):
            self.pop_oldest()
            self.dropped += 1

    def pop_oldest(self) -> RawPacket:
        """Remove and return the oldest packet."""
        entry = self._packets.popleft()
        self._bytes -= len(entry.data)
        return entry

    def clear(self) -> None:
        """Remove all packets."""
        self._packets.clear()
        self._bytes = 0


class RawExchange:
    """A raw link; created by :meth:`open`.

    Args:
        options: Parameters of the link.
        on_packet: Callback invoked with every packet of the log.

    Attributes:
        options: Parameters of the link.
        log: The last packets in both directions, oldest first.
        url: Address of the controller, or the address that this server listens on.
    """

    def __init__(self, options: RawOptions, on_packet: Callable[[RawPacket], None] | None = None) -> None:
        self.options = options
        self.log = PacketLog(MOST_LOGGED)
        self.url = ""
        self._on_packet = on_packet
        self._channel: Channel | None = None
        self._framers: dict[Peer, PieceFramer] = {}
        self._peers: dict[Peer, None] = {}  # connected peers; the last one was active most recently
        self._unread = PacketLog(_UNREAD)
        self._lost: OrinError | None = None
        self._changed = asyncio.Event()
        self._sending = asyncio.Lock()
        self._stopped = False

    @classmethod
    async def open(cls, options: RawOptions | str, on_packet: Callable[[RawPacket], None] | None = None) -> Self:
        """Open a link, or listen for clients.

        Args:
            options: Parameters, a parameter string (table 5-2), or an address.
            on_packet: Callback invoked with every packet, sent or received.

        Raises:
            InvalidValue, InvalidAddress: If the parameters are invalid.
            ConnectFailed: If the link cannot be opened.
            MissingExtra: If the package for serial ports is not installed.
        """
        exchange = cls(RawOptions.parse(options) if isinstance(options, str) else options, on_packet)
        exchange._channel = await open_channel(exchange.options, exchange)
        exchange.url = exchange._channel.url
        return exchange

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def is_open(self) -> bool:
        """True if packets can be sent, or clients can connect."""
        return self._channel is not None and self._lost is None

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The connected peers; the last one was active most recently."""
        return tuple(self._peers)

    @property
    def error(self) -> OrinError | None:
        """The reason why the link is not open any more; ``None`` while it is open."""
        return self._lost

    def _stop_requested(self) -> bool:
        return self._stopped

    @property
    def _is_udp(self) -> bool:
        return self.options.role.profile is DATAGRAM

    # --- sending ------------------------------------------------------------------------------------------------------

    async def send(self, data: bytes, peer: Peer = "", *, wait: bool | None = None) -> bytes | None:
        """Send bytes and return the reply, or ``None`` if there is none in time.

        The reply is the next packet from this peer. If both are b-CAP packets, their serial numbers must match, except
        for a server, which receives the next request. After S_EXECUTING, the time-out begins again. An incomplete
        packet is returned after the time-out.

        Args:
            data: The bytes, at most 16 MiB; they are sent unchanged.
            peer: Peer of a server; by default the one that was active most recently. With :data:`ALL`, the bytes are
                sent to all clients without waiting for replies.
            wait: True to wait for the reply; by default the parameter ``Sync``.

        Raises:
            LimitExceeded: If there are too many bytes.
            ConnectionLost: If the peer has closed the connection, or no client has connected. With :data:`ALL`, the
                other clients have received the bytes.
            ConnectionClosed: If the exchange is closed.
        """
        async with self._sending:
            self._stopped = False
            return await self._send(data, peer, self.options.sync if wait is None else wait)

    async def _send(self, data: bytes, peer: Peer, wait: bool) -> bytes | None:
        channel = self._check()
        most = _DATAGRAM if self._is_udp else MOST_BYTES
        if len(data) > most:
            raise LimitExceeded(
                tr("packet of {length} bytes exceeds the limit of {most} bytes", length=len(data), most=most)
            )
        peer = peer or next(reversed(self._peers), "")
        if not peer or (peer == ALL and not self._peers):
            raise no_peer()
        if peer == ALL:
            await self._send_to_all(channel, bytes(data))
            return None
        if wait:
            self._unread.clear()  # they remain in the log
        data = bytes(data)
        self._record(">", peer, data)
        await channel.send(peer, data)
        return await self._reply(data, peer) if wait else None

    async def _send_to_all(self, channel: Channel, data: bytes) -> None:
        problem: OrinError | None = None
        for peer in self.peers:
            self._record(">", peer, data)
            try:
                await channel.send(peer, data)
            except OrinError as error:
                problem = problem or error
        if problem is not None:
            raise problem

    async def _reply(self, data: bytes, peer: Peer) -> bytes | None:
        serial = _serial(data)
        latest = monotonic() + LONGEST_WAIT
        end = min(monotonic() + self.options.timeout, latest)
        while True:
            while self._unread:
                found = self._unread.pop_oldest()
                if found.peer != peer or not self._may_answer(serial, _serial(found.data)):
                    continue  # a late reply to an earlier packet
                if _is_executing(found.data):
                    end = min(monotonic() + self.options.timeout, latest)
                    continue
                return found.data
            if peer not in self._peers:
                raise self._lost or lost(tr("closed by the peer"))
            if self._stop_requested() or not await self._wait(end):
                return self._incomplete(peer)

    def _may_answer(self, sent: int | None, received: int | None) -> bool:
        """Return False for a packet with another serial; a malformed request may be answered with serial 0."""
        return self.options.role.serves or sent is None or received in (sent, None, 0)

    def _incomplete(self, peer: Peer) -> bytes | None:
        """Return the beginning of an incomplete packet of a peer, and log it."""
        framer = self._framers.get(peer)
        if framer is None or not framer.pending:
            return None
        rest = framer.flush()
        self._record("<", peer, rest)
        return rest

    async def receive(self, seconds: float) -> RawPacket | None:
        """Return the next received packet that is not a reply, or ``None`` after the time-out, or after :meth:`stop`.

        Raises:
            ConnectionLost: If the controller has closed the connection; clients of a server may come and go.
            ConnectionClosed: If the exchange is closed.
        """
        self._stopped = False
        end = monotonic() + seconds
        while not self._unread:
            self._check()
            if not await self._wait(end) or self._stop_requested():
                return None
        return self._unread.pop_oldest()

    async def loop(
        self,
        packets: Sequence[bytes],
        count: int,
        progress: Callable[[LoopProgress], None] | None = None,
        peer: Peer = "",
        *,
        wait: bool | None = None,
    ) -> LoopProgress:
        """Send all packets ``count`` times, each after the reply to the previous one, or after its time-out.

        Args:
            packets: The packets.
            count: Number of rounds.
            progress: Callback invoked after every round.
            peer: Peer of a server, or :data:`ALL`, as for :meth:`send`.
            wait: True to wait for the replies; by default the parameter ``Sync``.

        Returns:
            The final state. After :meth:`stop`, the last round may be incomplete.

        Raises:
            InvalidValue: If ``count`` is not positive.
            ConnectionLost, ConnectionClosed, LimitExceeded: As for :meth:`send`; the loop has ended then.
        """
        number = whole(count)
        if number is None or number < 1 or not packets:
            raise InvalidValue(tr("a loop requires packets and a positive count"))
        async with self._sending:
            self._stopped = False
            begin = monotonic()
            sent = replies = rounds = 0
            reply: bytes | None = None
            while rounds < number and not self._stop_requested():
                for data in packets:
                    if self._stop_requested():
                        break
                    reply = await self._send(data, peer, self.options.sync if wait is None else wait)
                    sent, replies = sent + 1, replies + (reply is not None)
                else:
                    rounds += 1
                state = LoopProgress(rounds, number, sent, replies, monotonic() - begin, reply, self._stop_requested())
                if progress is not None:
                    progress(state)
                await asyncio.sleep(0)  # other tasks, such as one that calls stop(), get their turn
        return replace(state, stopped=rounds < number)

    def stop(self) -> None:
        """End a loop, and the wait for a reply or a packet."""
        self._stopped = True
        self._changed.set()

    async def close(self) -> None:
        """Close the link; a pending :meth:`send` or :meth:`receive` ends with ConnectionClosed."""
        channel, self._channel = self._channel, None
        self._peers.clear()
        self._lost = self._lost or closed()
        self._changed.set()
        if channel is not None:
            await channel.close()

    def _check(self) -> Channel:
        if self._channel is None:
            raise closed()
        if self._lost is not None:
            raise self._lost
        return self._channel

    async def _wait(self, end: float) -> bool:
        """Wait for an event; return False if the time has passed."""
        left = end - monotonic()
        if left <= 0:
            return False
        self._changed.clear()
        try:
            async with asyncio.timeout(left):
                await self._changed.wait()
        except TimeoutError:
            return False
        return True

    # --- events of the channel ----------------------------------------------------------------------------------------

    def connected(self, peer: Peer) -> None:
        """Remember a new peer; a UDP server has only the latest sender."""
        if self.options.role is Role.UDP_SERVER:
            self._peers.clear()
        self._peers[peer] = None
        self._changed.set()

    def received(self, peer: Peer, data: bytes) -> None:
        """Log received bytes; a datagram is one packet."""
        if peer in self._peers:
            del self._peers[peer]
            self._peers[peer] = None
        pieces = [data] if self._is_udp else self._framers.setdefault(peer, PieceFramer()).feed(data)
        for piece in pieces:
            self._unread.append(self._record("<", peer, piece))
        if pieces:
            self._changed.set()

    def disconnected(self, peer: Peer, error: OrinError | None) -> None:
        """Forget a peer; without its controller, a client is lost."""
        self._incomplete(peer)
        self._peers.pop(peer, None)
        self._framers.pop(peer, None)
        if not self.options.role.serves:
            self._lost = self._lost or error or lost(tr("closed by the peer"))
        self._changed.set()

    def _record(self, direction: Literal[">", "<"], peer: Peer, data: bytes) -> RawPacket:
        entry = RawPacket(time(), direction, peer, data)
        self.log.append(entry)
        if self._on_packet is not None:
            self._on_packet(entry)
        return entry


def _serial(data: bytes) -> int | None:
    """Return the serial of a b-CAP packet; ``None`` for other data."""
    if len(data) < packet.OVERHEAD or data[0] != packet.SOH:
        return None
    return int.from_bytes(data[5:7], "little")


def _is_executing(data: bytes) -> bool:
    return packet.is_whole(data) and packet.HEADER.unpack_from(data)[4] == S_EXECUTING
