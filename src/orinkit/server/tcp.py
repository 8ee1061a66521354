"""b-CAP server on TCP: the connection of a client, and the listener."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from typing import Final, Self, cast

from orinkit.bcap.actions import Execute
from orinkit.bcap.profiles import STREAM, BcapProfile
from orinkit.cao.outcomes import CallReply
from orinkit.cao.provider import ClientInfo
from orinkit.server.accepting import ONE_AT_A_TIME, StreamListener, start
from orinkit.server.capacity import CallMemory
from orinkit.server.context import ServerContext
from orinkit.server.end_watch import EndWatch
from orinkit.server.log_limiter import CLIENT
from orinkit.server.peer import BYTE, LONG, Peer
from orinkit.transport.address import Address
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.tcp_keepalive import prepare
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.server")

PATIENCE: Final = 10.0
"""Time in s that a client has for its first call, for sending each packet, and for reading its replies."""
PROGRESS: Final = 64 * 1024
"""If a client sends or reads this many bytes within :data:`PATIENCE`, the time starts again.

This permits long packets on slow lines.
"""

_REFUSAL_TIME: Final = 5.0  # s in which a refused client can make one call and receive E_MAX_CONNECT
_MAX_REFUSED: Final = 64  # maximum number of refused clients in this state; others are disconnected immediately


class TcpConnection(Peer, asyncio.BufferedProtocol):
    """A client on TCP, or on another byte stream.

    This is a BufferedProtocol, because for a plain Protocol asyncio allocates a block of 256 KiB for each chunk of
    received data. The allocation would take longer than the rest of a call.
    """

    def __init__(self, context: ServerContext, loop: asyncio.AbstractEventLoop, profile: BcapProfile = STREAM) -> None:
        super().__init__(context, loop, profile)
        self._kind = profile.name
        context.opening += 1
        self._idle_timer: asyncio.TimerHandle | None = None
        self._partial = 0  # bytes of the incomplete packet that ServerContext.partial includes
        self._begun = 0.0  # time from which PATIENCE is measured for the incomplete packet; 0 if there is none
        self._unsent = CallMemory(context.memory)  # of the reply that the client does not read
        self._unread = 0  # bytes of unsent replies at the time from which PATIENCE is measured
        self._reading_timer: asyncio.TimerHandle | None = None
        self._paused = False  # reading
        self._fresh: bytes | None = None  # received data that step() processes next, if nothing is waiting
        self._end_watch: EndWatch | None = None
        self._seen = 0, 0  # at that time: the number of complete packets, and the bytes of the incomplete packet

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Admit or refuse a client that has connected."""
        self._transport = transport = cast("asyncio.Transport", transport)  # uvloop's class is not a subclass of it
        self._send = transport.write
        self._is_closing = transport.is_closing
        prepare(transport.get_extra_info("socket"), self._context.dead_after)
        host, port = (transport.get_extra_info("peername") or ("", 0))[:2]
        self._peername = (host, port)
        self._name = f"{host}:{port}"
        self._host = str(host)
        self._heard = self._loop.time()
        self._context.opening -= 1
        keep_from_children(self)
        self._context.all.add(self)
        if self._context.closing:
            transport.abort()
        elif self._admit() is not None:
            self._idle_timer = self._loop.call_at(self._heard + PATIENCE, self._check_progress)
        elif len(self._context.turned_away) < _MAX_REFUSED:
            self._context.turned_away.add(self)
            self._alarm = self._loop.call_later(_REFUSAL_TIME, transport.abort)
        else:
            transport.abort()

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return the receive buffer; all connections share it, because the data is processed immediately."""
        return self._context.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Process received data: now, or when it is the client's turn; until then, stop reading."""
        data = bytes(self._context.view[:nbytes])
        now = self._loop.time()
        if self._waiting or self._paused or self._begun:
            self._process(data, now)
        else:
            self._process_directly(data, now)
        if self._waiting:
            self._pause_reading()

    def _process_directly(self, data: bytes, now: float) -> None:
        """As :meth:`_process`, for a client whose earlier data has been processed; :meth:`step` tries the direct path."""
        self._heard = now
        self._fresh = data
        self._queue.serve(self, BYTE * len(data) if len(data) <= LONG else BYTE * LONG)
        if self._fresh is not None:  # other clients are served first
            self._fresh = None
            self._waiting.append(self._conversation.receive(data, now))

    def step(self) -> bool:
        """Process the next packet: on the direct path if that is possible, otherwise on the path of all transports."""
        data = self._fresh
        if data is not None:
            self._fresh = None
            if self._serve_directly(data):
                return False
            self._waiting.append(self._conversation.receive(data, self._heard))
        return super().step()

    def _serve_directly(self, data: bytes) -> bool:
        """Execute the call in received data, and send the reply, if the data is exactly one packet with a usual call.

        Return False, and change nothing, if the data is anything else, or if the client is in an unusual state. If the
        call has no result yet, or a large one, it continues on the usual path.
        """
        session = self._session
        if session is None or self._needs_secret or self._is_closing():
            return False
        conversation = self._conversation
        call = conversation.take_directly(data, self._heard)
        if call is None:
            return False
        CLIENT.set(self._host)  # requires no reset, because every entry point of a connection sets it
        if conversation.max_silence is not None:
            self._mark_alive()
        function_id, arguments = call[2], call[3]
        if type(arguments) is int:
            outcome = session.invoke_on_handle(function_id, arguments)
        else:
            outcome = session.invoke(function_id, cast("list[Variant]", arguments))
        if type(outcome) is CallReply:
            reply = conversation.reply_directly(call, outcome.code, outcome.result)
            if reply is not None:
                self._send(reply)
                if self._slow:
                    self._on_reply_sent()
                return True
        self._complete(session, conversation.continue_call(call), outcome)
        return True

    def _pause_reading(self) -> None:
        self._paused = True
        self._transport.pause_reading()
        if self._session is not None:
            if self._end_watch is None:
                self._end_watch = EndWatch(self._loop, self._transport, lambda: self._paused, self._handle_early_end)
            self._end_watch.start()

    def _handle_early_end(self) -> None:
        """Disconnect a client that has closed the connection while its arm moves; do not process its further requests.

        If its arm does not move, all requests that it has sent before are processed first, as usual. The client does
        not wait for its call in progress.
        """
        if self._session is not None and self._session.is_moving():
            logger.debug("%s has closed the connection; its remaining requests are discarded", self._name)
            self._transport.abort()
        else:
            self._abandon_call()

    def _on_processed(self) -> None:
        incomplete = self._conversation.incomplete_bytes
        if incomplete:
            if self._is_closing():  # bytes that were counted after connection_lost would be counted forever
                return
            self._count(incomplete)
            self._await_packet(self._loop.time())
        elif self._begun:
            self._begun = 0.0
            if self._partial:
                self._count(0)
        if self._paused:
            self._paused = False
            self._transport.resume_reading()

    def pause_writing(self) -> None:
        """Stop reading, because the client does not read its replies."""
        self._slow = True
        self._pause_reading()
        self._unread = self._transport.get_write_buffer_size()
        self._reading_timer = self._loop.call_later(PATIENCE, self._check_reading)

    def resume_writing(self) -> None:
        """Resume reading, after the requests that have been received are processed."""
        self._slow = False
        self._stop_waiting_for_reader()
        self._resume()

    def _hold(self) -> None:
        self._held = True
        self._pause_reading()

    def _unhold(self) -> None:
        self._held = False
        if self._partial:
            self._count(self._conversation.incomplete_bytes)
        self._resume()

    def _resume(self) -> None:
        if self._waiting:
            self._continue()
        elif not (self._slow or self._held):
            self._on_processed()

    def connection_lost(self, exc: Exception | None) -> None:
        """Release the client's objects after it has disconnected."""
        if self._idle_timer is not None:
            self._idle_timer.cancel()
            self._idle_timer = None
        self._waiting.clear()
        self._fresh = None
        self._context.partial.change(self._partial, 0)
        self._partial = 0
        self._stop_waiting_for_reader()
        if self._end_watch is not None:
            self._end_watch.close()
        self._leave(exc)
        self._context.discard(self)

    def _count(self, incomplete: int) -> None:
        """Count the bytes of the incomplete packet; close the connection if the limit for all clients is exceeded."""
        before, self._partial = self._partial, incomplete
        if self._context.partial.change(before, incomplete) or self._is_closing():
            return
        self._send(self._conversation.packet_too_long_reply())
        level = self._context.refusal_level(self._loop.time(), "partial")
        logger.log(level, "%s: closed: incomplete packets have %d bytes", self._name, self._context.partial.bytes)
        self.close()

    # --- slow readers -------------------------------------------------------------------------------------------

    def _on_reply_sent(self) -> None:
        super()._on_reply_sent()
        if self._slow:
            self._unread = self._transport.get_write_buffer_size()
            if not self._unsent.set(self._unread):  # more than estimated
                self._give_up("reply not read; the memory is required for other clients")

    def _check_reading(self) -> None:
        """Close the connection if the client reads too slowly; otherwise close it only if its memory is required."""
        unsent = self._transport.get_write_buffer_size()
        if self._unread - unsent < PROGRESS:
            self._reading_timer = None
            self._give_up(f"{PROGRESS} bytes of replies not read within {PATIENCE:g} s")
        else:
            self._unread = unsent
            self._unsent.set(unsent)
            self._context.memory.add_slow_reader(self)
            self._reading_timer = self._loop.call_later(PATIENCE, self._check_reading)

    def _stop_waiting_for_reader(self) -> None:
        self._unsent.release()
        self._context.memory.discard_slow_reader(self)
        if self._reading_timer is not None:
            self._reading_timer.cancel()
            self._reading_timer = None

    def drop(self) -> None:
        """Close the connection of a slow reader, because the memory of its reply is required for another client."""
        self._stop_waiting_for_reader()
        self._give_up(f"reply not read within {PATIENCE:g} s; the memory is required for other clients")

    # --- time ---------------------------------------------------------------------------------------------------

    def _await_packet(self, now: float) -> None:
        """Start the timer for the rest of a packet."""
        if not self._begun or self._conversation.packets != self._seen[0]:
            self._mark(now)
        if self._idle_timer is None and not self._is_closing():
            self._idle_timer = self._loop.call_at(self._begun + PATIENCE, self._check_progress)

    def _mark(self, now: float) -> None:
        self._begun = now
        self._seen = self._conversation.packets, self._conversation.incomplete_bytes

    def _check_progress(self) -> None:
        """Close the connection if the first call or the rest of a packet is overdue; otherwise restart the timer."""
        self._idle_timer = None
        now = self._loop.time()
        if self._held or self.is_queued:  # the server is still processing packets; the client is not late
            self._idle_timer = self._loop.call_at(now + PATIENCE, self._check_progress)
        elif not self._conversation.calls:
            self._give_up(f"no call received within {PATIENCE:g} s")
        elif self._begun:
            # If the client does not read its replies, the server has stopped reading; the client is not late either.
            if self._slow or self._conversation.incomplete_bytes - self._seen[1] >= PROGRESS:
                self._mark(now)
            if now < self._begun + PATIENCE:
                self._await_packet(now)
            else:
                self._give_up(f"incomplete packet: rest not received within {PATIENCE:g} s")

    def _give_up(self, reason: str) -> None:
        level = self._context.refusal_level(self._loop.time(), "silent")
        logger.log(level, "%s: closed: %s", self._name, reason)
        self._transport.abort()

    # --- methods of Peer ------------------------------------------------------------------------------------------

    def _about(self) -> ClientInfo:
        host, port = self._peername
        return ClientInfo(host, self._kind, port, self.when_input_processed, disconnect=self.disconnect)

    def _refuse(self, call: Execute) -> None:
        super()._refuse(call)
        self.close()

    def evict(self) -> None:
        """Disconnect this client to make room for another one."""
        super().evict()
        self._transport.abort()

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptor that a forked child replaces by the null device."""
        return (self._transport.get_extra_info("socket").fileno(),)

    def close(self) -> None:
        """Close the connection after pending data has been sent, but after at most 10 s."""
        self._transport.close()
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        self._idle_timer = self._loop.call_later(PATIENCE, self._transport.abort)

    def abort(self) -> None:
        """Close the connection immediately and drop pending data."""
        self._transport.abort()


class TcpListener(StreamListener):
    """Accepts TCP clients at one address."""

    @classmethod
    async def open(cls, address: Address, context: ServerContext) -> Self:
        """Open a listening socket.

        Raises:
            OSError: If the address cannot be used.
            ValueError: If the host is not a valid host name.
        """
        loop = asyncio.get_running_loop()
        server = await loop.create_server(
            lambda: TcpConnection(context, loop),
            address.host,
            address.port,
            backlog=ONE_AT_A_TIME,
            reuse_address=True,
            start_serving=False,
        )
        await start(server)
        return cls(server, str(address._replace(port=server.sockets[0].getsockname()[1])))
