"""uvicorn's HTTP/1.1 connection, with bounds on how many there are and how long a client may take for what it has to do.

uvicorn itself waits for ever for a request that has begun, and for a client to take its answer; and it does not see the end
of a client that has sent something behind a request that is at work.
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
from orinkit.server.capacity import most_of_an_address
from orinkit.server.context import ServerContext
from orinkit.server.http.flow_control import HELD, BoundedFlowControl
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.address import network_of
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.tcp_keepalive import prepare

logger = logging.getLogger("orinkit.server")

LONGEST_HEADER: Final = 32 * 1024
"""Bytes of a request's line and headers."""
KEPT_ALIVE: Final = 75.0
"""Seconds that a connection is kept on which nothing is asked."""

_LONG_HEADER: Final = 431
_PIECE: Final = 64 * 1024  # bytes that are looked at together; uvloop reads up to 256 KiB
_FEWEST: Final = 85  # connections that there may always be; 64 of one address
_own = logging.getLogger("orinkit.server.uvicorn")
_own.setLevel(logging.ERROR)  # its warnings are about requests, and say less than ours


class Stage(Enum):
    """What a connection waits for, and how many seconds its client has for that."""

    NEW = "a request", 10.0
    HEADER = "the rest of a request's header", 10.0
    BODY = "the rest of a request's body", 30.0
    WORK = "the answer to a request", math.inf
    TAKING = "the client to take more of its answer", 30.0
    REST = "another request", KEPT_ALIVE
    LEAVING = "the client to take its last answer", 30.0

    def __init__(self, awaited: str, seconds: float) -> None:
        self.awaited = awaited
        self.seconds = seconds


class LimitedConnection(Protocol):
    """A connection that is counted."""

    @property
    def network(self) -> str:
        """Where it is from; see :func:`~orinkit.transport.address.network_of`."""

    @property
    def at_work(self) -> bool:
        """Whether a request has come whole and has not been answered."""

    def abort(self) -> None:
        """Close it at once."""


class HttpClientState(Protocol):
    """A client whose requests come on connections."""

    def disconnected(self, connection: Hashable) -> None:
        """One of them has ended."""


class ConnectionLimiter:
    """Counts the connections of a listener. Where there is one too many, one goes that has nothing at work.

    Where it is one too many of its address, one of that address goes. That is the oldest of those that have not been answered yet, so that many who only connect take each other's place and
    not that of clients; if there is none, the one whose last answer is oldest.

    Args:
        shared: what all clients of the server share.

    Attributes:
        shared: what all clients of the server share.
        most: how many connections there may be: clients that keep none open between calls have several for a moment.
        per_address: how many of one address.
    """

    def __init__(self, shared: ServerContext) -> None:
        self.shared = shared
        self.most = max(_FEWEST, shared.clients + shared.clients // 2)
        self.per_address = max(most_of_an_address(self.most), shared.per_address)
        self._strangers: dict[LimitedConnection, None] = {}  # the oldest first
        self._known: dict[LimitedConnection, None] = {}  # the one whose last answer is oldest first

    def __len__(self) -> int:
        """Return how many connections there are."""
        return len(self._strangers) + len(self._known)

    def admit(self, connection: LimitedConnection) -> bool:
        """Count a new connection; False where there are too many, all of them at work."""
        of_address = [each for each in chain(self._strangers, self._known) if each.network == connection.network]
        full = len(of_address) >= self.per_address
        if full or len(self) >= self.most:
            places = of_address if full else chain(self._strangers, self._known)
            oldest = next((each for each in places if not each.at_work), None)
            if oldest is None:
                return False
            self.discard(oldest)
            oldest.abort()
        self._strangers[connection] = None
        return True

    def answered(self, connection: LimitedConnection) -> None:
        """A connection has proved its worth."""
        if connection in self._strangers or connection in self._known:
            self.discard(connection)
            self._known[connection] = None

    def discard(self, connection: LimitedConnection) -> None:
        """Count a connection no more."""
        self._strangers.pop(connection, None)
        self._known.pop(connection, None)


class HeaderCoalescer(h11.Connection):
    """Gives the header of an answer together with what follows, so that one packet is sent and not two."""

    def __init__(self) -> None:
        super().__init__(h11.SERVER, LONGEST_HEADER)
        self._header: list[bytes] = []

    def send_with_data_passthrough(self, event: h11.Event) -> list[bytes] | None:
        """Return the pieces of an event; those of a header later."""
        pieces = super().send_with_data_passthrough(event)
        if type(event) is h11.Response:
            self._header = pieces or []
            return []
        if self._header and pieces is not None:
            pieces = self._header + pieces
            self._header = []
        return pieces


class LimitedProtocol(H11Protocol, asyncio.BufferedProtocol):
    """One connection.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB.

    Args:
        guard: counts it.
        config: of uvicorn, loaded.
        state: of uvicorn's server.

    Attributes:
        gone: the connection has been closed.
        carried: the clients whose requests have come on it; each is told of its end.
    """

    def __init__(self, guard: ConnectionLimiter, config: Config, state: ServerState) -> None:
        super().__init__(config, state, {"connection": self}, asyncio.get_running_loop())
        self.conn = HeaderCoalescer()
        self.logger = _own
        self.access_log = False
        self._when_gone: Callable[[], None] | None = None
        self._guard = guard
        self._shared = guard.shared
        self._stage = Stage.NEW
        self._until = self._armed = math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._unsent = 0
        self.gone = False
        self._said_all = False  # the client has closed its side
        self.carried: set[HttpClientState] = set()
        self._early: list[bytes] | None = []  # what has come before connection_made; with TLS something may

    @property
    def name(self) -> str:
        """Who it is, for the log."""
        host, port = self.client or ("", 0)
        return f"{host}:{port}/http"

    @cached_property
    def network(self) -> str:
        """Where it is from; see :func:`~orinkit.transport.address.network_of`."""
        return network_of(self.host)

    @property
    def host(self) -> str:
        """Its address without the port."""
        return self.client[0] if self.client else ""

    @property
    def at_work(self) -> bool:
        """Whether a request has come whole and has not been answered."""
        return self._stage is Stage.WORK

    @property
    def _exchange(self) -> RequestResponseCycle | None:
        return self.cycle  # which uvicorn declares as if there always were one

    @property
    def when_gone(self) -> Callable[[], None] | None:
        """Is called when the connection is gone; for the call that is being answered, if it takes its time."""
        return self._when_gone

    @when_gone.setter
    def when_gone(self, tell: Callable[[], None] | None) -> None:
        self._when_gone = tell
        if tell is not None and not self.gone:
            self.handle_events()
            if self._said_all:  # who asks what takes its time, and cannot be told from one that has gone
                self.transport.close()

    @property
    def _whole(self) -> bool:
        cycle = self._exchange
        return cycle is not None and not cycle.response_complete and not cycle.more_body

    # --- asyncio calls these --------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        if self.gone:
            return
        super().connection_made(cast("asyncio.Transport", transport))
        self.flow = self._flow = BoundedFlowControl(self.transport, self._held)
        prepare(self.transport.get_extra_info("socket"), self._shared.dead_after)
        CLIENT.set(self.host)
        keep_from_children(self)
        if self.scheme == "http":  # the entrance to TLS has been through this
            self._shared.opening -= 1
        early, self._early = self._early, None
        self._shared.all.add(self)
        if self._shared.closing:
            self.transport.abort()
        elif not self._guard.admit(self):
            level = self._shared.refusal_level(self.loop.time())
            logger.log(level, "%s refused: %d connections are at work", self.name, len(self._guard))
            self.transport.abort()
        else:
            self._enter(Stage.NEW)
            for data in early or ():
                self.data_received(data)

    def _held(self) -> int:
        return len(self.conn.trailing_data[0])

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - declared by the base
        """Where to put what comes next; all connections share it, for it is read at once."""
        return self._shared.view

    def buffer_updated(self, nbytes: int) -> None:
        """The client has sent something."""
        self.data_received(bytes(self._shared.view[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """The client has sent something; uvloop calls this one."""
        CLIENT.set(self.host)
        if self._early is not None:
            self._early.append(data)
            return
        try:
            super().data_received(data[:_PIECE])
            for place in range(_PIECE, len(data), _PIECE):  # a header is looked at in pieces, or its length is not seen
                if not self.transport.is_closing():
                    super().data_received(data[place : place + _PIECE])
        except Exception:
            logger.exception("%s: reading a request", self.name)
            self.transport.abort()
        self._watch()

    def eof_received(self) -> bool:  # type: ignore[override]  # uvicorn never keeps a connection open
        """The client will say no more; one that has asked something quick, without TLS, is answered before it is let go."""
        self._said_all = self._early is None and self.scheme == "http" and self._whole and self._when_gone is None
        return self._said_all

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone."""
        self.gone = True
        if self._early is not None:  # before it was there
            return
        self._guard.discard(self)
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        if self._when_gone is not None:
            self._when_gone()
        carried, self.carried = self.carried, set()
        for client in carried:
            client.disconnected(self)
        self._shared.discard(self)

    def pause_writing(self) -> None:
        """The client does not take its answer."""
        super().pause_writing()
        self._watch()

    def resume_writing(self) -> None:
        """It has taken most of it."""
        super().resume_writing()
        self._watch()

    # --- uvicorn calls these --------------------------------------------------------------------------------------

    def handle_events(self) -> None:
        """See what has come; behind a request that is at work it is only kept, up to a bound."""
        if not self._whole:
            super().handle_events()
        if not self._whole:
            self._flow.look()
        elif self._when_gone is not None and self._held() < HELD:
            self.flow.resume_reading()  # its end is to be told, and is not seen without reading
        elif self._held():
            self.flow.pause_reading()

    def on_response_complete(self) -> None:
        """A request has been answered."""
        self._guard.answered(self)
        super().on_response_complete()
        if self._said_all and not self._whole:
            self.transport.close()
        self._watch()

    def send_400_response(self, msg: str) -> None:
        """What has come is no HTTP."""
        error = sys.exception()  # what uvicorn has caught; it tells nobody of the status that goes with it
        too_long = isinstance(error, h11.RemoteProtocolError) and error.error_status_hint == _LONG_HEADER
        level = self._shared.refusal_level(self.loop.time())
        logger.log(level, "%s: closed: %s", self.name, "the header is too long" if too_long else msg)
        if too_long:
            text = tr("the header of the request is too long")
            self._say("431 Request Header Fields Too Large", text)
        else:
            self._say("400 Bad Request", tr("this is no HTTP/1.1 request"))

    def _should_upgrade(self) -> bool:
        return False  # whoever wants to speak something else is answered in HTTP/1.1

    # --- time -----------------------------------------------------------------------------------------------------

    def _watch(self) -> None:
        """See what the connection waits for now."""
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
        if self._until < self._armed:  # a timer that is too early is cheaper than one for each request
            self._arm()

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._armed = self._until
        self._timer = self.loop.call_at(self._until, self._time_is_up) if self._until < math.inf else None

    def _time_is_up(self) -> None:
        self._timer = None
        self._armed = math.inf
        if self.loop.time() < self._until:
            self._arm()
        elif self.transport.get_write_buffer_size() < self._unsent:
            self._enter(self._stage)  # it is slow, but takes its answer
        else:
            self._give_up()

    def _give_up(self) -> None:
        level = logging.DEBUG if self._stage in (Stage.NEW, Stage.REST) else logging.INFO
        logger.log(level, "%s: closed: waited %g s for %s", self.name, self._stage.seconds, self._stage.awaited)
        if self._stage in (Stage.HEADER, Stage.BODY):
            self._say("408 Request Timeout", tr("the request came too slowly"))
        else:
            self.transport.abort()

    # --- its end --------------------------------------------------------------------------------------------------

    def _say(self, status: str, text: str) -> None:
        """Answer a request that has not come whole, and close."""
        cycle = self._exchange
        if cycle is not None and not cycle.response_complete:
            begun = cycle.response_started
            cycle.disconnected = True  # nobody else answers it
            cycle.message_event.set()
        else:
            begun = False
        if not begun:
            body = f"{text}\n".encode()
            header = f"HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {len(body)}\r\n"
            self.transport.write(f"{header}Connection: close\r\n\r\n".encode() + body)
        self.transport.close()
        self._watch()

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return (self.transport.get_extra_info("socket").fileno(),)

    def close(self) -> None:
        """Close it once its request has been answered: the server is closing."""
        if self._stage is Stage.WORK:
            self.cycle.keep_alive = False
        elif self._stage is Stage.BODY:
            self._say("503 Service Unavailable", closing())
        else:
            self.transport.close()
            self._watch()

    def abort(self) -> None:
        """Close it at once."""
        self.transport.abort()


def closing() -> str:
    """Return what a client is told while the server is being closed."""
    return tr("the server is closing")
