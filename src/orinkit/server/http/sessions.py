"""Sessions of e-CAP clients. A client is identified by its cookie or its address, not by its HTTP connections.

A client that supports cookies is identified by its cookie. Clients without cookies (``curl``, a PLC) are identified by
their address: all requests from one address without a cookie belong to one session. The first request, Service_Start,
does not show if a client supports cookies. Its session can therefore be reached both by the cookie and by the address.
The second request contains the cookie or not; from then on, the session can be reached in only one way. A session that
has been used without its cookie can no longer be reached by the cookie, so that clients never share objects by
accident.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from contextlib import suppress
from inspect import iscoroutine
from typing import Any, Final, Protocol

from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import ClientInfo
from orinkit.cao.results import begin_call
from orinkit.cao.service_options import ServiceOptions
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.ecap.message import own_code
from orinkit.server.call_runner import abandon, is_cancellable, result_of
from orinkit.server.context import ServerContext
from orinkit.server.liveness import LivenessMonitor, log_disconnected
from orinkit.transport.address import network_of

logger = logging.getLogger("orinkit.server")

CALLS: Final = 8
"""Maximum number of calls in progress of one client."""
_MAX_CALLS: Final = 8 * CALLS  # including calls for whose result the client does not wait any more
IDLE_TIMEOUT: Final = 10.0
"""Idle time in s after which a session ends if its connection broke during a call, or if the client has never sent the
cookie."""

_SERVICE_START: Final = 1
_YOUNG: Final = 1.0  # s; a client must send its cookie within this time, or its session may be ended for a new client
_RECONNECT_TIME: Final = 0.3  # s; while its arm moves, a client must replace its last connection within this time


class Connection(Protocol):
    """A connection that carries requests of a client."""

    def abort(self) -> None:
        """Close the connection immediately."""


class RunningCall:
    """A long-running call.

    Args:
        loop: the event loop of the session.
        work: ``Pending.work`` of the call.

    Attributes:
        cancellable: True if the call can be cancelled.
        reply: future of the reply; its result is ``None`` if the client has disconnected.
        task: the task that executes the call.
        client_waits: True if the client will receive the result; False after a time-out or a disconnection.
    """

    __slots__ = ("_work", "cancellable", "client_waits", "reply", "task")

    task: asyncio.Task[None]

    def __init__(self, loop: asyncio.AbstractEventLoop, work: Any) -> None:
        self.reply: asyncio.Future[CallReply | None] = loop.create_future()
        self.cancellable = is_cancellable(work)
        self.client_waits = True
        self._work = work

    def answer(self, reply: CallReply | None) -> None:
        """Set the reply, unless it has been set already."""
        if not self.reply.done():
            self.reply.set_result(reply)

    def give_up(self, reply: CallReply | None = None) -> None:
        """Stop waiting for the result. The call continues, but its result is not sent to the client.

        Args:
            reply: the reply to send instead; ``None`` if the client has disconnected.
        """
        self.client_waits = False
        self.answer(reply)
        abandon(self._work)


class HttpSession:
    """The session of one e-CAP client.

    Args:
        sessions: the collection that contains this session.
        key: value of the cookie.
        address: host address of the client.
        port: source port of the client's first request.

    Attributes:
        key: value of the cookie.
        address: host address of the client.
        session: the client's objects.
        invoke_timeout: limit on the duration of a call, s.
        known: True if the client has sent the cookie.
        plain: True if the session has been used without a cookie.
        ended: True if the session has ended.
        address_session: the session of the client's address, to which the options of Service_Start also apply, because
            a client without cookies may have sent the Service_Start that created this session; otherwise ``None``.
        requested_silence_limit: the client's own limit on silence (``Alive``), s; ``None`` if the client has not set
            it.
        last_request_at: loop time of the last request, s.
        connected_at: loop time of the first request, s.
    """

    def __init__(self, sessions: HttpSessions, key: str, address: str, port: int) -> None:
        context = sessions.context
        self.key = key
        self.address = address
        self.session = Session(
            context.host, ClientInfo(address, "http", port, disconnect=self.disconnect), context.numbers, own_code
        )
        self.invoke_timeout = context.invoke_timeout
        self.known = False
        self.plain = False
        self.address_session: HttpSession | None = None
        self._sessions = sessions
        self._context = context
        self._loop = sessions.loop
        self._name = f"{address}:{port}/http"
        self._calls: set[RunningCall] = set()
        self._waiting = 0  # number of requests in progress
        self._broken = False
        self._closing = False
        self._proxied = False  # True after a request through a proxy, whose connections do not end with the client
        self._sends_signs = False  # True if the client is one of orinkit
        self.ended = False
        self.requested_silence_limit: float | None = None
        self.connected_at = self.last_request_at = self._heard = self._loop.time()
        self._connections: dict[Connection, bool] = {}  # the open ones; True after the second request on a connection
        self._liveness = LivenessMonitor(self._loop, self)
        self._timer = self._loop.call_at(self._heard + self._idle_limit(), self._check_idle_time)
        logger.info("%s connected", self._name)

    # --- requests -------------------------------------------------------------------------------------------------

    def begin_request(
        self, connection: Connection | None = None, *, proxied: bool = False, sends_signs: bool = False
    ) -> None:
        """Record the start of a request.

        Args:
            connection: the connection of the request; the caller calls :meth:`disconnected` when the connection ends.
                ``None`` if no connection is to be recorded.
            proxied: True if a proxy has forwarded the request.
            sends_signs: True if the client is one of orinkit, which sends signs of life while its motions run.
        """
        self._proxied = self._proxied or proxied
        self._sends_signs = self._sends_signs or sends_signs
        self._waiting += 1
        self._broken = False
        self.last_request_at = self._loop.time()
        if connection is not None:
            self._connections[connection] = connection in self._connections
        self._liveness.start()

    def disconnected(self, connection: Connection) -> None:
        """Handle the end of a connection; end the session soon if no persistent connection is left and the arm moves.

        A connection is persistent from the second request on. The session does not end immediately, because a client
        that cancels a call closes the connection and makes its next call over a new one.
        """
        kept = self._connections.pop(connection, False)
        if kept and not self.ended and not self._has_persistent:
            self._loop.call_later(_RECONNECT_TIME, self._check_reconnected)

    def _check_reconnected(self) -> None:
        if not (self.ended or self._connections or self.plain or self._proxied) and self.session.is_moving():
            self.end("its last connection was closed")

    @property
    def _has_persistent(self) -> bool:
        return any(self._connections.values())

    # --- signs of life: orinkit.server.liveness ------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The client's name in the log."""
        return self._name

    @property
    def last_reply_at(self) -> float:
        """The time of the last response."""
        return self._heard

    @property
    def has_call(self) -> bool:
        """True if a request is in progress."""
        return self._waiting > 0

    @property
    def default_silence_limit(self) -> float | None:
        """The server's limit on silence while motions run, s.

        ``None`` while a client with a cookie has a persistent connection whose end the server detects, and sends no
        signs of life. A proxy may keep a connection without its client; not every proxy adds a header.
        """
        must_call = self.plain or self._proxied or self._sends_signs
        return None if self._has_persistent and not must_call else self._context.alive

    def give_up(self, reason: str) -> None:
        """End the session, because the client has become unreachable."""
        logger.warning("%s: %s", self._name, reason)
        self.end(reason)

    def disconnect(self, reason: str) -> None:
        """End the session and close its connections, because the device requires it; may be called from any thread."""
        with suppress(RuntimeError):  # the server has been closed
            self._loop.call_soon_threadsafe(self._disconnect, reason)

    def _disconnect(self, reason: str) -> None:
        connections = list(self._connections)
        self.give_up(reason)
        for connection in connections:
            connection.abort()

    def end_request(self, *, broken: bool = False) -> None:
        """Record the end of a request.

        Args:
            broken: True if the connection was closed before the response was sent.
        """
        self._waiting -= 1
        self._heard = self._loop.time()
        if self._closing and not self._waiting:
            self.end()
        elif broken and not self.ended:
            self._broken = True
            self._restart_timer()

    @property
    def at_call_limit(self) -> bool:
        """True if the limit on calls in progress is reached, or the higher limit that includes abandoned calls."""
        awaited = sum(call.client_waits for call in self._calls)
        return awaited >= CALLS or len(self._calls) >= _MAX_CALLS

    @property
    def network(self) -> str:
        """The network of the client's address; see :class:`~orinkit.server.context.Client`."""
        return network_of(self.address)

    @property
    def holds_objects(self) -> bool:
        """True if the client holds an object."""
        return len(self.session) > 0

    def idle_since(self) -> float | None:
        """Return the time of the last response; ``None`` if the client has objects or a request in progress."""
        return self._heard if self.idle else None

    def evict(self) -> None:
        """End the session, to make room for another client."""
        self.end("disconnected to make room for another client")

    @property
    def idle(self) -> bool:
        """True if the client has neither objects nor a request in progress."""
        return not (self._waiting or self._calls or len(self.session))

    def set_options(self, options: ServiceOptions) -> None:
        """Apply the options of Service_Start."""
        default = self._context.invoke_timeout
        self.requested_silence_limit = options.max_silence
        self.invoke_timeout = default if options.invoke_timeout is None else options.invoke_timeout
        if self.address_session is not None:
            self.address_session.set_options(options)

    def start_call(self, pending: Pending) -> RunningCall:
        """Start a long-running call. If the connection breaks, the call continues until the session ends."""
        call = RunningCall(self._loop, pending.work)
        call.task = task = self._loop.create_task(self._finish(pending, call))
        self._calls.add(call)
        self._context.tasks.add(task)

        def done(_: object) -> None:
            self._context.tasks.discard(task)
            if iscoroutine(pending.work):
                pending.work.close()  # a coroutine that was cancelled before it began would cause a warning

        task.add_done_callback(done)
        return call

    async def _finish(self, pending: Pending, call: RunningCall) -> None:
        begin_call(lambda: not call.client_waits)
        try:
            result = await result_of(pending.work)
        except BaseException as error:
            if isinstance(error, asyncio.CancelledError) and self.ended:
                raise  # cancelled because the session has ended
            reply = self.session.fail(pending, error)
        else:
            reply = self.session.complete(pending, result, client_waits=call.client_waits)
        finally:
            self._calls.discard(call)
        call.answer(reply)

    # --- end of the session --------------------------------------------------------------------------------------------------

    def on_address_lost(self) -> None:
        """Restart the idle timer, because the session can now be reached only by its cookie."""
        self._restart_timer()

    def _idle_limit(self) -> float:
        idle = self._sessions.idle
        short_lived = self._broken or not (self.known or self._sessions.is_reachable_by_address(self))
        return min(idle, IDLE_TIMEOUT) if short_lived else idle

    def _restart_timer(self) -> None:
        self._timer.cancel()
        self._timer = self._loop.call_at(self._heard + self._idle_limit(), self._check_idle_time)

    def _check_idle_time(self) -> None:
        now = self._loop.time()
        if self._waiting:
            self._heard = now
        if now < self._heard + self._idle_limit():
            self._restart_timer()
        else:
            self.end("nothing received")

    def is_abandoned(self) -> bool:
        """Return True if the client is idle and has not sent its cookie in time."""
        short_lived = self.idle and not self.known and not self._sessions.is_reachable_by_address(self)
        return short_lived and self._loop.time() >= self._heard + _YOUNG

    def end(self, reason: object = None) -> None:
        """End the session: release the client's objects and cancel its calls.

        A blocking call continues, because a thread cannot be cancelled. If it creates an object, the object is released
        afterwards.
        """
        if self.ended:
            return
        self.ended = True
        self._timer.cancel()
        self._liveness.end()
        self._sessions.forget(self)
        self._context.open.discard(self)
        calls, self._calls = self._calls, set()
        for call in calls:
            call.give_up(CallReply(hresult.E_ABORT, detail=tr("the session has ended")))
            if call.cancellable:
                call.task.cancel()
        log_disconnected(self.session, self._name, reason)
        self._context.release(self.session, self.address, 0.0)
        self._context.discard(self)

    def close(self) -> None:
        """End the session after the requests in progress have completed; called when the server is closing."""
        self._closing = True
        if not self._waiting:
            self.end()

    def abort(self) -> None:
        """End the session immediately."""
        self.end()


class HttpSessions:
    """The sessions of one HTTP listener.

    Args:
        context: the state shared by all clients of the server.
        idle: idle time in s after which a session ends.
    """

    def __init__(self, context: ServerContext, idle: float) -> None:
        self.context = context
        self.loop = asyncio.get_running_loop()
        self.idle = idle
        self._by_key: dict[str, HttpSession] = {}  # the oldest session first
        self._by_address: dict[str, HttpSession] = {}

    def by_key(self, key: str) -> HttpSession | None:
        """Return the session that a cookie identifies; ``None`` if there is none.

        A client that sends the cookie supports cookies. Therefore the session can no longer be reached by the address.
        """
        found = self._by_key.get(key)
        if found is not None and not found.known:
            found.known = True
            found.address_session = None
            if self.is_reachable_by_address(found):
                del self._by_address[found.address]
        return found

    def by_address(self, address: str) -> HttpSession | None:
        """Return the session of an address, for clients without cookies; ``None`` if there is none."""
        return self._by_address.get(address)

    def is_reachable_by_address(self, session: HttpSession) -> bool:
        """Return True if requests without a cookie from the session's address reach this session."""
        return self._by_address.get(session.address) is session

    def create(self, address: str, port: int) -> HttpSession | None:
        """Create a session that can be reached only by its cookie; return ``None`` if the limit is reached."""
        context = self.context
        if not context.closing and len(context.open) >= context.clients:
            self._make_room()
        reason = context.make_room(network_of(address))
        if reason:
            logger.log(context.refusal_level(self.loop.time()), "%s:%d/http refused: %s", address, port, reason)
            return None
        made = HttpSession(self, secrets.token_urlsafe(18), address, port)
        self._by_key[made.key] = made
        context.open.add(made)
        context.all.add(made)
        return made

    def for_service_start(self, address: str, port: int) -> HttpSession | None:
        """Return the session for a Service_Start without a cookie; ``None`` if the limit is reached.

        The session is a new one, because the client may support cookies but have no cookie yet. The client may also be
        one without cookies. Therefore the new session becomes the session of the address, unless the current session of
        the address has already been used without a cookie. In that case, Service_Start applies to both sessions.
        """
        current = self._by_address.get(address)
        made = self.create(address, port)
        if made is None:
            return None if current is None else self._mark_plain(current)
        if current is None or not current.plain:
            self._by_address[address] = made
            if current is not None:
                current.on_address_lost()
        else:
            current.begin_request()
            current.end_request()
            made.address_session = current
        return made

    def without_cookie(self, address: str, port: int) -> HttpSession | None:
        """Return the session for a request without a cookie, except Service_Start; ``None`` if the limit is reached."""
        current = self._by_address.get(address)
        if current is None:
            current = self.create(address, port)
            if current is None:
                return None
            self._by_address[address] = current
        return self._mark_plain(current)

    def _mark_plain(self, session: HttpSession) -> HttpSession:
        session.plain = True
        self._by_key.pop(session.key, None)
        return session

    def _make_room(self) -> None:
        abandoned = next((each for each in self._by_key.values() if each.is_abandoned()), None)
        if abandoned is not None:
            abandoned.end("its cookie was never sent back")

    def forget(self, session: HttpSession) -> None:
        """Remove a session."""
        self._by_key.pop(session.key, None)
        if self.is_reachable_by_address(session):
            del self._by_address[session.address]
