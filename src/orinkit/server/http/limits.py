"""uvicorn's HTTP/1.1 protocol with limits on the number of connections and on the time that a client may take.

uvicorn itself waits indefinitely for the rest of a request, and until a client has read its response. If a client has
sent data after a request in progress, uvicorn does not detect that the client disconnects.
"""

from __future__ import annotations

import asyncio
import logging
import math
import sys
from collections.abc import Callable, Hashable, Iterable
from enum import Enum
from functools import cached_property
from itertools import chain
from typing import Final, Protocol, cast

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.server import ServerState

from orinkit.core.i18n import tr
from orinkit.server.capacity import CallMemory, default_per_address
from orinkit.server.context import ServerContext
from orinkit.server.http.flow_control import HELD, BoundedFlowControl
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.address import network_of
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.tcp_keepalive import prepare

logger = logging.getLogger("orinkit.server")

LONGEST_HEADER: Final = 32 * 1024
"""Limit on the request line and the headers, bytes."""
KEPT_ALIVE: Final = 75.0
"""Seconds after a response after which a connection without another request is closed."""

PROGRESS: Final = 64 * 1024
"""Number of bytes that a client must read of a response within the time of :class:`Stage`."""

_LONG_HEADER: Final = 431
_PIECE: Final = 64 * 1024  # bytes parsed at a time; uvloop reads up to 256 KiB
_MIN_CONNECTIONS: Final = 85  # smallest limit on connections; 64 of them may come from one address
_own = logging.getLogger("orinkit.server.uvicorn")
_own.setLevel(logging.ERROR)  # uvicorn's warnings concern requests; orinkit logs them in more detail


class Stage(Enum):
    """State of a connection: the event that the server waits for, and the time limit for that event in s."""

    NEW = "a request", 10.0
    HEADER = "the rest of a request's header", 10.0
    BODY = "the rest of a request's body", 30.0
    WORK = "the response to a request", math.inf
    TAKING = "the client to read more of its response", 30.0
    REST = "another request", KEPT_ALIVE
    LEAVING = "the client to read its last response", 30.0

    def __init__(self, awaited: str, seconds: float) -> None:
        self.awaited = awaited
        self.seconds = seconds


class LimitedConnection(Protocol):
    """A connection that a :class:`ConnectionLimiter` counts."""

    @property
    def network(self) -> str:
        """The network of the client's address; see :func:`~orinkit.transport.address.network_of`."""

    @property
    def has_call(self) -> bool:
        """True if a complete request is in progress."""

    def abort(self) -> None:
        """Close the connection immediately."""


class DisconnectObserver(Protocol):
    """A client that is notified when one of its connections is closed."""

    def disconnected(self, connection: Hashable) -> None:
        """Handle the end of a connection that has carried requests of the client."""


class ConnectionLimiter:
    """Counts the connections of a listener. When the limit is exceeded, an idle connection is evicted.

    If the limit of one address is exceeded, a connection of that address is evicted. The limiter first evicts the
    oldest of the connections on which no response has been sent, so that peers that only connect displace each other
    and not clients. If there is no such connection, it evicts the one whose last response is the oldest.

    Args:
        context: the state shared by all clients of the server.

    Attributes:
        context: the state shared by all clients of the server.
        limit: limit on connections. It is higher than the limit on clients, because a client that opens a connection
            for each call may have several connections for a short time.
        per_address: limit on connections of one address.
    """

    def __init__(self, context: ServerContext) -> None:
        self.context = context
        self.limit = max(_MIN_CONNECTIONS, context.clients + context.clients // 2)
        self.per_address = max(default_per_address(self.limit), context.per_address)
        self._unproven: dict[LimitedConnection, None] = {}  # no response has been sent; the oldest connection first
        self._proven: dict[LimitedConnection, None] = {}  # in the order of their last responses, the oldest first

    def __len__(self) -> int:
        """Return the number of connections."""
        return len(self._unproven) + len(self._proven)

    def admit(self, connection: LimitedConnection) -> bool:
        """Count a new connection; return False if the limit is reached and no connection is idle."""
        of_address = [each for each in chain(self._unproven, self._proven) if each.network == connection.network]
        full = len(of_address) >= self.per_address
        if full or len(self) >= self.limit:
            candidates = of_address if full else chain(self._unproven, self._proven)
            oldest = next((each for each in candidates if not each.has_call), None)
            if oldest is None:
                return False
            self.discard(oldest)
            oldest.abort()
        self._unproven[connection] = None
        return True

    def mark_replied(self, connection: LimitedConnection) -> None:
        """Record that a response has been sent on a connection."""
        if connection in self._unproven or connection in self._proven:
            self.discard(connection)
            self._proven[connection] = None

    def discard(self, connection: LimitedConnection) -> None:
        """Stop counting a connection."""
        self._unproven.pop(connection, None)
        self._proven.pop(connection, None)


class HeaderCoalescer(h11.Connection):
    """Joins the header of a response with the data that follows, so that one packet is sent instead of two."""

    def __init__(self) -> None:
        super().__init__(h11.SERVER, LONGEST_HEADER)
        self._header: list[bytes] = []

    def send_with_data_passthrough(self, event: h11.Event) -> list[bytes] | None:
        """Return the bytes to send for an event of h11; the bytes of a header are returned with the next event."""
        pieces = super().send_with_data_passthrough(event)
        if type(event) is h11.Response:
            self._header = pieces or []
            return []
        if self._header and pieces is not None:
            pieces = self._header + pieces
            self._header = []
        return pieces


class LimitedProtocol(H11Protocol, asyncio.BufferedProtocol):
    """The connection of an HTTP client, with limits on time and on buffered data.

    This is a BufferedProtocol, because for a plain Protocol asyncio allocates a block of 256 KiB for each chunk of
    received data.

    Args:
        guard: the connection limiter.
        config: loaded configuration of uvicorn.
        state: server state of uvicorn.

    Attributes:
        is_closed: True if the connection has been closed.
        carried: the clients that have sent requests on this connection; they are notified when it ends.
    """

    def __init__(self, guard: ConnectionLimiter, config: Config, state: ServerState) -> None:
        super().__init__(config, state, {"connection": self}, asyncio.get_running_loop())
        self.conn = HeaderCoalescer()
        self.logger = _own
        self.access_log = False
        self._on_closed: Callable[[], None] | None = None
        self._guard = guard
        self._context = guard.context
        self._stage = Stage.NEW
        self._until = self._armed = math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._unsent = 0
        self.is_closed = False
        self._half_closed = False  # True if the client has closed its side of the connection
        self.carried: set[DisconnectObserver] = set()
        self._response: CallMemory | None = None
        self._response_at = 0.0
        self._early: list[bytes] | None = []  # data received before connection_made, which TLS allows

    @property
    def name(self) -> str:
        """The name of the connection in the log."""
        host, port = self.client or ("", 0)
        return f"{host}:{port}/http"

    @cached_property
    def network(self) -> str:
        """The network of the client's address; see :func:`~orinkit.transport.address.network_of`."""
        return network_of(self.host)

    @property
    def host(self) -> str:
        """The client's address without the port."""
        return self.client[0] if self.client else ""

    @property
    def has_call(self) -> bool:
        """True if a complete request is in progress."""
        return self._stage is Stage.WORK

    @property
    def _exchange(self) -> RequestResponseCycle | None:
        return self.cycle  # uvicorn's annotation omits None

    @property
    def on_closed(self) -> Callable[[], None] | None:
        """Callback invoked if the connection is closed during a long-running call; ``None`` if no such call runs."""
        return self._on_closed

    @on_closed.setter
    def on_closed(self, callback: Callable[[], None] | None) -> None:
        self._on_closed = callback
        if callback is not None and not self.is_closed:
            self.handle_events()
            if self._half_closed:  # the server cannot determine if the client has disconnected; assume that it has
                self.transport.close()

    @property
    def _whole(self) -> bool:
        cycle = self._exchange
        return cycle is not None and not cycle.response_complete and not cycle.more_body

    # --- asyncio calls these --------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Admit or refuse a client that has connected."""
        if self.is_closed:
            return
        super().connection_made(cast("asyncio.Transport", transport))
        self.flow = self._flow = BoundedFlowControl(self.transport, self._held)
        prepare(self.transport.get_extra_info("socket"), self._context.dead_after)
        CLIENT.set(self.host)
        keep_from_children(self)
        if self.scheme == "http":  # for https, TlsAcceptor has decremented the count
            self._context.opening -= 1
        early, self._early = self._early, None
        self._context.all.add(self)
        if self._context.closing:
            self.transport.abort()
        elif not self._guard.admit(self):
            level = self._context.refusal_level(self.loop.time())
            logger.log(level, "%s refused: %d connections are busy", self.name, len(self._guard))
            self.transport.abort()
        else:
            self._enter(Stage.NEW)
            for data in early or ():
                self.data_received(data)

    def _held(self) -> int:
        return len(self.conn.trailing_data[0])

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - declared by the base
        """Return the receive buffer; all connections share it, because the data is processed immediately."""
        return self._context.view

    def buffer_updated(self, nbytes: int) -> None:
        """Process received data."""
        self.data_received(bytes(self._context.view[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """Process received data; called directly by uvloop."""
        CLIENT.set(self.host)
        if self._early is not None:
            self._early.append(data)
            return
        try:
            super().data_received(data[:_PIECE])
            for start in range(_PIECE, len(data), _PIECE):  # h11 checks the length of the header after each piece
                if not self.transport.is_closing():
                    super().data_received(data[start : start + _PIECE])
        except Exception:
            logger.exception("%s: error while reading a request", self.name)
            self.transport.abort()
        self._update_stage()

    def eof_received(self) -> bool:  # type: ignore[override]  # uvicorn always closes
        """Handle the end of the client's data; return True if the connection is not to be closed yet.

        Without TLS, the connection stays open until a call in progress has completed, unless it is a long-running call.
        """
        self._half_closed = self._early is None and self.scheme == "http" and self._whole and self._on_closed is None
        return self._half_closed

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop counting the connection, and notify the clients that have sent requests on it."""
        self.is_closed = True
        if self._early is not None:  # closed before connection_made
            return
        self._guard.discard(self)
        self._context.memory.discard_slow_reader(self)
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        if self._on_closed is not None:
            self._on_closed()
        carried, self.carried = self.carried, set()
        for client in carried:
            client.disconnected(self)
        self._context.discard(self)

    def pause_writing(self) -> None:
        """Note that the client does not read its response."""
        super().pause_writing()
        self._update_stage()
        if self._response is not None and self.loop.time() >= self._response_at + Stage.TAKING.seconds:
            self._context.memory.add_slow_reader(self)

    def resume_writing(self) -> None:
        """Note that the client has read most of its response."""
        super().resume_writing()
        self._update_stage()

    def begin_response(self, memory: CallMemory) -> None:
        """Note that a response begins, and the memory that it requires."""
        self._response, self._response_at = memory, self.loop.time()

    def drop(self) -> None:
        """Close the connection of a slow reader, because the memory of its response is required for another client."""
        if self._response is not None:
            self._response.release()
        logger.info("%s: closed: response not read within %g s", self.name, Stage.TAKING.seconds)
        self.transport.abort()

    # --- uvicorn calls these --------------------------------------------------------------------------------------

    def handle_events(self) -> None:
        """Process received data; while a request is in progress, only buffer the data, up to a limit."""
        if not self._whole:
            super().handle_events()
        if not self._whole:
            self._flow.resume_if_possible()
        elif self._on_closed is not None and self._held() < HELD:
            self.flow.resume_reading()  # a disconnection is detected only while reading
        elif self._held():
            self.flow.pause_reading()

    def on_response_complete(self) -> None:
        """Handle the end of a response."""
        self._response = None
        self._context.memory.discard_slow_reader(self)
        self._guard.mark_replied(self)
        super().on_response_complete()
        if self._half_closed and not self._whole:
            self.transport.close()
        self._update_stage()

    def send_400_response(self, msg: str) -> None:
        """Refuse data that is not HTTP, or a request whose header is too long."""
        error = sys.exception()  # the exception that uvicorn has caught; its status is not passed to this method
        too_long = isinstance(error, h11.RemoteProtocolError) and error.error_status_hint == _LONG_HEADER
        level = self._context.refusal_level(self.loop.time())
        logger.log(level, "%s: closed: %s", self.name, "the header is too long" if too_long else msg)
        if too_long:
            text = tr("the header of the request is too long")
            self._respond("431 Request Header Fields Too Large", text)
        else:
            self._respond("400 Bad Request", tr("not an HTTP/1.1 request"))

    def _should_upgrade(self) -> bool:
        return False  # other protocols are not supported; the response is HTTP/1.1

    # --- time -----------------------------------------------------------------------------------------------------

    def _update_stage(self) -> None:
        """Determine the stage of the connection."""
        cycle = self._exchange
        if self.transport.is_closing():
            stage = Stage.LEAVING
        elif self.flow.write_paused:
            stage = Stage.TAKING
        elif cycle is not None and not cycle.response_complete:
            stage = Stage.BODY if cycle.more_body else Stage.WORK
        elif self.conn.trailing_data[0]:
            stage = Stage.HEADER
        else:
            stage = Stage.NEW if cycle is None else Stage.REST
        if stage is not self._stage:
            self._enter(stage)

    def _enter(self, stage: Stage) -> None:
        self._stage = stage
        self._until = self.loop.time() + stage.seconds
        self._unsent = self.transport.get_write_buffer_size() if stage in (Stage.TAKING, Stage.LEAVING) else 0
        if self._until < self._armed:  # a timer that expires too early costs less than a new timer for each request
            self._arm()

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._armed = self._until
        self._timer = self.loop.call_at(self._until, self._on_timer) if self._until < math.inf else None

    def _on_timer(self) -> None:
        self._timer = None
        self._armed = math.inf
        if self.loop.time() < self._until:
            self._arm()
        elif self.transport.get_write_buffer_size() <= self._unsent - PROGRESS:
            self._enter(self._stage)  # the client is slow, but reads its response
        else:
            self._give_up()

    def _give_up(self) -> None:
        level = logging.DEBUG if self._stage in (Stage.NEW, Stage.REST) else logging.INFO
        logger.log(level, "%s: closed: waited %g s for %s", self.name, self._stage.seconds, self._stage.awaited)
        if self._stage in (Stage.HEADER, Stage.BODY):
            self._respond("408 Request Timeout", tr("the request was not received in time"))
        else:
            self.transport.abort()

    # --- closing --------------------------------------------------------------------------------------------------

    def _respond(self, status: str, text: str) -> None:
        """Send a response to an incomplete request, and close the connection."""
        cycle = self._exchange
        if cycle is not None and not cycle.response_complete:
            begun = cycle.response_started
            cycle.disconnected = True  # prevents a response from the application
            cycle.message_event.set()
        else:
            begun = False
        if not begun:
            body = f"{text}\n".encode()
            header = f"HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {len(body)}\r\n"
            self.transport.write(f"{header}Connection: close\r\n\r\n".encode() + body)
        self.transport.close()
        self._update_stage()

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptor that a forked child replaces by the null device."""
        return (self.transport.get_extra_info("socket").fileno(),)

    def close(self) -> None:
        """Close the connection after the request in progress has completed; called when the server is closing."""
        if self._stage is Stage.WORK:
            self.cycle.keep_alive = False
        elif self._stage is Stage.BODY:
            self._respond("503 Service Unavailable", server_closing_message())
        else:
            self.transport.close()
            self._update_stage()

    def abort(self) -> None:
        """Close the connection immediately."""
        self.transport.abort()


def server_closing_message() -> str:
    """Return the message for clients while the server is closing."""
    return tr("the server is closing")
