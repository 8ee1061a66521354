"""uvicorn's HTTP/1.1 protocol with limits on the number of connections and on the time that a client may take.

uvicorn itself waits indefinitely for the rest of a request, and until a client has read its response. If a client has
sent data after a request in progress, uvicorn does not detect that the client disconnects.
"""

from __future__ import annotations

import asyncio
import logging
import re
import sys
from collections import deque
from collections.abc import Callable, Iterable
from contextvars import Context, copy_context
from functools import cached_property
from typing import Any, Final, Protocol, TypeVar, cast

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.server import ServerState

from orinkit.core.i18n import tr
from orinkit.server.capacity import CallMemory
from orinkit.server.fair_queue import QueuedClient, queue_of
from orinkit.server.http.connection_limiter import ConnectionLimiter
from orinkit.server.http.flow_control import HELD, BoundedFlowControl
from orinkit.server.http.h11_connection import LONGEST_HEADER, StepwiseConnection
from orinkit.server.http.stage import Stage, StageTimer
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.address import network_of
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.tcp_keepalive import prepare

logger = logging.getLogger("orinkit.server")

T = TypeVar("T")

LONGEST_TRAILERS: Final = 1024
"""Limit on the part of the trailers of a chunked body that has been received before their end, bytes."""
MOST_LINES: Final = 256
"""Limit on the lines of the header of a request."""

_LONG_HEADER: Final = 431
_PIECE: Final = 8 * 1024  # bytes that h11 receives at a time; then it checks the length of the header
_EVENTS: Final = 8  # events that a step processes: header, body and end of a usual request, and few chunks of a body
_BYTE: Final = 1e-6  # s to parse a byte of chunks of one byte
_MAX_BYTES: Final = 2048  # of received data for the estimate of its time: most larger data consists of large chunks
_END_OF_HEADER: Final = re.compile(rb"\n\r?\n")
_TOO_MANY_LINES: Final = re.compile(rb"(?:[^\n]*\n(?!\r?\n)){%d}" % MOST_LINES)
_own = logging.getLogger("orinkit.server.uvicorn")
_own.setLevel(logging.ERROR)  # uvicorn's warnings concern requests; orinkit logs them in more detail


class DisconnectObserver(Protocol):
    """A client that is notified when one of its connections is closed."""

    def disconnected(self, connection: LimitedProtocol) -> None:
        """Handle the end of a connection that has carried requests of the client."""


class _Job:
    """A function that is called when it is the client's turn."""

    __slots__ = ("_context", "_function", "done")

    def __init__(self, function: Callable[[], Any], loop: asyncio.AbstractEventLoop) -> None:
        self._function = function
        self._context: Context = copy_context()
        self.done: asyncio.Future[Any] = loop.create_future()

    def run(self) -> None:
        """Call the function, unless the caller does not wait any more."""
        if self.done.done():
            return
        try:
            self.done.set_result(self._context.run(self._function))
        except Exception as error:  # noqa: BLE001 - raised in the caller
            self.done.set_exception(error)


class LimitedProtocol(QueuedClient, H11Protocol, asyncio.BufferedProtocol):
    """The connection of an HTTP client, with limits on time and on buffered data.

    The loop's :class:`~orinkit.server.fair_queue.FairQueue` processes received data, a few events of h11 in each step, and
    calls functions on behalf of requests (:meth:`run`).

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
        self.conn = self._h11 = StepwiseConnection()
        self.logger = _own
        self.access_log = False
        self._on_closed: Callable[[], None] | None = None
        self._guard = guard
        self._context = guard.context
        self._stages = StageTimer(self.loop, self._unsent_bytes, lambda: self.is_queued, self._give_up)
        self.is_closed = False
        self._half_closed = False  # True if the client has closed its side of the connection
        self.carried: set[DisconnectObserver] = set()
        self._response: CallMemory | None = None
        self._response_at = 0.0
        self._early: list[bytes] | None = []  # data received before connection_made, which TLS allows
        self._queue = queue_of(self.loop)
        self._inbox: deque[bytes] = deque()  # received data that h11 has not received yet
        self._job: _Job | None = None

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
        return self.stage is Stage.WORK

    @property
    def stage(self) -> Stage:
        """The stage of the connection."""
        return self._stages.stage

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
            self._stages.enter(Stage.NEW)
            for data in early or ():
                self.data_received(data)

    @property
    def _unparsed(self) -> int:
        return len(self._h11.trailing_data[0])

    def _unsent_bytes(self) -> int:
        return self.transport.get_write_buffer_size()

    def _held(self) -> int:
        return self._unparsed + sum(map(len, self._inbox)) if self._inbox else self._unparsed

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the receive buffer; all connections share it, because the data is processed immediately."""
        return self._context.view

    def buffer_updated(self, nbytes: int) -> None:
        """Process received data."""
        self.data_received(bytes(self._context.view[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """Process received data; called directly by uvloop."""
        if self._early is not None:
            self._early.append(data)
            return
        if len(data) <= _PIECE:
            self._inbox.append(data)
        else:
            self._inbox.extend(data[start : start + _PIECE] for start in range(0, len(data), _PIECE))
        self._serve(_BYTE * min(len(data), _MAX_BYTES))

    # --- the queue of the loop --------------------------------------------------------------------------------------

    def _serve(self, expected: float = 0.0) -> None:
        """Process received data: now, or when it is the client's turn; until then, stop reading.

        ``expected`` is the time that the data may take, s.
        """
        self._queue.serve(self, expected)
        if self.is_queued:
            self._flow.set_queued(queued=True)

    def step(self) -> bool:
        """Call the function of a request, or process some events of the received data, unless a request is in progress.

        Returns:
            True if there is more data to process now.
        """
        job = self._job
        if job is not None:
            self._job = None
            job.run()
            if not self._flow.is_queued:  # nothing was received meanwhile
                return False
        CLIENT.set(self.host)
        if job is None and not self._whole and not self.transport.is_closing():
            self._process_events()
        if self.is_closed:
            return False
        if self._has_events and not self._whole and not self.transport.is_closing():
            return True
        if self._flow.is_queued:
            self._flow.set_queued(queued=False)
        self._regulate()
        if self._half_closed:
            self._close_if_half_closed()
        self._update_stage()
        return False

    @property
    def _has_events(self) -> bool:
        return self._h11.is_interrupted or bool(self._inbox)

    def _process_events(self) -> None:
        conn = self._h11
        if self._inbox and not conn.is_interrupted:
            conn.receive_data(self._inbox.popleft())
        conn.is_interrupted = False
        conn.events = _EVENTS
        try:
            if conn.their_state is h11.IDLE and _is_too_long(conn.trailing_data[0]):
                self._refuse_header()
                return
            super().handle_events()
            if conn.their_state is h11.SEND_BODY and not conn.is_interrupted and self._unparsed > LONGEST_TRAILERS:
                self._refuse_header()
        except Exception:
            logger.exception("%s: error while reading a request", self.name)
            self.transport.abort()

    async def run(self, function: Callable[[], T], expected: float = 0.0) -> T:
        """Call a function on behalf of the request in progress: now, or when it is the client's turn.

        Args:
            function: the function.
            expected: time in s that it may take; a rough upper limit.

        Returns:
            The result of the function.
        """
        self._job = job = _Job(function, self.loop)
        self._queue.serve(self, expected)
        result: T = await job.done
        return result

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
        self._inbox.clear()
        self._context.memory.discard_slow_reader(self)
        self._stages.cancel()
        super().connection_lost(exc)
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
        """Process buffered data; while a request is in progress, only buffer the data, up to a limit."""
        if self._unparsed:
            self._h11.is_interrupted = True
        if self._has_events:
            self._serve()
        else:
            self._regulate()

    def _regulate(self) -> None:
        """Pause or resume reading."""
        if not self._whole:
            self._flow.resume_if_possible()
        elif self._on_closed is not None and self._held() < HELD:
            self.flow.resume_reading()  # a disconnection is detected only while reading
        elif self._held():
            self.flow.pause_reading()

    def on_response_complete(self) -> None:
        """Handle the end of a response, without uvicorn's timer for idle connections: :attr:`Stage.REST` limits the time."""
        self._response = None
        self._context.memory.discard_slow_reader(self)
        self._guard.mark_replied(self)
        if not self.transport.is_closing():
            self._flow.resume_reading()
            if self._h11.our_state is h11.DONE and self._h11.their_state is h11.DONE:
                self._h11.start_next_cycle()
                self.handle_events()
        if not self.is_queued:
            self._close_if_half_closed()
        self._update_stage()

    def _close_if_half_closed(self) -> None:
        if self._half_closed and not self._whole:
            self.transport.close()

    def send_400_response(self, msg: str) -> None:
        """Refuse data that is not HTTP, or a request whose header is too long."""
        error = sys.exception()  # the exception that uvicorn has caught; its status is not passed to this method
        too_long = isinstance(error, h11.RemoteProtocolError) and error.error_status_hint == _LONG_HEADER
        if too_long:
            self._refuse_header()
        else:
            self._log_refusal(msg)
            self._respond("400 Bad Request", tr("not an HTTP/1.1 request"))

    def _refuse_header(self) -> None:
        self._log_refusal("the header is too long")
        self._respond("431 Request Header Fields Too Large", tr("the header of the request is too long"))

    def _log_refusal(self, reason: str) -> None:
        level = self._context.refusal_level(self.loop.time())
        logger.log(level, "%s: closed: %s", self.name, reason)

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
        elif self._h11.trailing_data[0]:
            stage = Stage.HEADER
        else:
            stage = Stage.NEW if cycle is None else Stage.REST
        if stage is not self.stage:
            self._stages.enter(stage)

    def _give_up(self) -> None:
        level = logging.DEBUG if self.stage in (Stage.NEW, Stage.REST) else logging.INFO
        logger.log(level, "%s: closed: waited %g s for %s", self.name, self.stage.seconds, self.stage.awaited)
        if self.stage in (Stage.HEADER, Stage.BODY):
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
        if self.stage is Stage.WORK:
            self.cycle.keep_alive = False
        elif self.stage is Stage.BODY:
            self._respond("503 Service Unavailable", server_closing_message())
        else:
            self.transport.close()
            self._update_stage()

    def abort(self) -> None:
        """Close the connection immediately."""
        self.transport.abort()


def _is_too_long(data: bytes) -> bool:
    """Return True if the header at the beginning of received data is too long, or has too many lines.

    h11 checks the length only of a header that is still incomplete.
    """
    if len(data) > LONGEST_HEADER and _END_OF_HEADER.search(data, 0, LONGEST_HEADER) is None:
        return True
    return data.count(b"\n") >= MOST_LINES and _TOO_MANY_LINES.match(data) is not None


def server_closing_message() -> str:
    """Return the message for clients while the server is closing."""
    return tr("the server is closing")
