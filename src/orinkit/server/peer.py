"""The server's object for a b-CAP client, common to all transports: connects its conversation to its session."""

from __future__ import annotations

import asyncio
import logging
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from functools import partial
from typing import Any, Final

from orinkit.bcap.actions import Action, Close, Decode, Encoded, EndSession, Execute, Send
from orinkit.bcap.profiles import BcapProfile
from orinkit.bcap.server import ServerConversation
from orinkit.cao.outcomes import CallReply, Outcome, Pending
from orinkit.cao.provider import ClientInfo
from orinkit.cao.results import begin_call
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import ProtocolError
from orinkit.server.call_runner import abandon, is_cancellable, result_of
from orinkit.server.capacity import CallMemory
from orinkit.server.context import ServerContext
from orinkit.server.fair_queue import QueuedClient, queue_of
from orinkit.server.large_values import is_large, memory_of, out_of_memory
from orinkit.server.liveness import LivenessMonitor, log_disconnected
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.address import network_of
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.server")

_DRAIN_TURNS: Final = 3
BYTE: Final = 3e-7
"""Seconds to decode a byte of the slowest values (dates)."""
LONG: Final = 4000
"""Limit on the bytes of received data for the estimate of its time: more bytes usually consist of many packets."""


class Peer(QueuedClient):
    """A client, or a peer that may become a client.

    Each transport has a subclass. After a connection has been made, the subclass sets ``_name``, ``_host``, ``_send``
    and ``_is_closing``. It passes the actions that follow from received data to :meth:`_process`. The loop's
    :class:`~orinkit.server.fair_queue.FairQueue` then performs the actions, one in each step.

    Args:
        context: the state shared by all clients of the server.
        loop: the event loop of the connection.
        profile: the b-CAP transport profile.

    Attributes:
        _name: the client's name in the log.
        _host: the client's name without the port. The log limiter uses it, because the port changes with each
            connection.
        _send: callback that sends bytes without blocking, or drops them if the peer cannot receive them.
        _is_closing: callback that returns True if nothing can be sent to the peer any more.
        _session: the client's objects; ``None`` if the peer is not a client.
        connected_at: time of the event loop at which the client connected, s.
    """

    _name: str
    _host: str
    _send: Callable[[bytes | bytearray], None]
    _is_closing: Callable[[], bool]

    def __init__(self, context: ServerContext, loop: asyncio.AbstractEventLoop, profile: BcapProfile) -> None:
        self._context = context
        self._loop = loop
        self._conversation = ServerConversation(
            context.first_limits, context.invoke_timeout, profile, context.host.dialect
        )
        self._needs_secret = context.requires_secret
        self.connected_at = loop.time()
        self._session: Session | None = None
        self._memory = CallMemory(context.memory)
        self._liveness: LivenessMonitor | None = None
        self._task: asyncio.Task[None] | None = None
        self._cancellable = False
        self._work: Any = None  # Pending.work of the call in progress
        self._alarm: asyncio.TimerHandle | None = None
        self._queue = queue_of(loop)
        self._waiting: deque[Iterator[Action]] = deque()  # actions that follow from received data, in their order
        self._slow = False
        self._heard = 0.0
        self._network: str | None = None
        self._held = False
        self._stops: dict[asyncio.Task[None], Any] = {}  # calls beside the call in progress, with Pending.work of each

    # --- identity ------------------------------------------------------------------------------------------------

    def _admit(self) -> Session | None:
        """Open a session; return ``None`` if a limit on clients is reached."""
        context = self._context
        CLIENT.set(self._host)
        reason = context.make_room(self.network)
        if reason:
            logger.log(context.refusal_level(self._loop.time()), "%s refused: %s", self._name, reason)
            return None
        self._session = Session(context.host, self._about())
        context.open.add(self)
        logger.info("%s connected", self._name)
        return self._session

    def _leave(self, reason: object = None) -> None:
        """Close the session: release the client's objects and cancel the call in progress.

        A blocking call continues, because a thread cannot be cancelled. If it creates an object, the object is released
        afterwards.
        """
        self._set_alarm(None)
        if self._liveness is not None:
            self._liveness.end()
        self._context.open.discard(self)
        session, self._session = self._session, None  # breaks a reference cycle
        task, self._task = self._task, None
        self._abandon_call()
        self._abandon_stops()
        if task is not None and self._cancellable:
            task.cancel()
        if task is None or self._cancellable:  # otherwise, the call continues and still requires its memory
            self._memory.release()
        self._memory = CallMemory(self._context.memory)
        if session is not None:
            before = CLIENT.set(self._host)  # the server may close the session from another context
            log_disconnected(session, self._name, reason)
            CLIENT.reset(before)
            self._context.release(session, self._host, self.virtual_time)

    def _abandon_call(self) -> None:
        work, self._work = self._work, None
        abandon(work)

    def _abandon_stops(self) -> None:
        stops, self._stops = self._stops, {}
        for task, work in stops.items():
            abandon(work)
            if is_cancellable(work):
                task.cancel()

    @property
    def network(self) -> str:
        """The network of the client's address; see :class:`~orinkit.server.context.Client`."""
        if self._network is None:
            self._network = network_of(self._host)
        return self._network

    @property
    def holds_objects(self) -> bool:
        """True if the client holds an object."""
        return self._session is not None and len(self._session) > 0

    def idle_since(self) -> float | None:
        """Return the time of the last request; ``None`` if the client holds an object or has a call in progress.

        A large packet is not a call until it has been decoded.
        """
        session = self._session
        busy = self._task is not None and not self._held
        return None if session is None or len(session) or busy else self._heard

    def evict(self) -> None:
        """Disconnect this client to make room for another one."""
        self._end_session("disconnected to make room for another client")

    # --- signs of life: orinkit.server.liveness ------------------------------------------------------------------------

    default_silence_limit: float | None = None

    @property
    def name(self) -> str:
        """The client's name in the log."""
        return self._name

    @property
    def last_request_at(self) -> float:
        """The time of the last complete request; the current time while received data is queued: the server is late."""
        return self._loop.time() if self.is_queued else self._conversation.last_request_at

    @property
    def last_reply_at(self) -> float:
        """The time of the last reply."""
        return self._conversation.last_reply_at

    @property
    def has_call(self) -> bool:
        """True if a call is in progress."""
        return self._conversation.busy

    @property
    def requested_silence_limit(self) -> float | None:
        """The client's own limit on silence (``Alive``), s; ``None`` if the client has not set it."""
        return self._conversation.max_silence

    @property
    def session(self) -> Session | None:
        """The client's objects; ``None`` if the peer is not a client."""
        return self._session

    def give_up(self, reason: str) -> None:
        """Close the connection, because the peer has become unreachable."""
        logger.warning("%s: closed: %s", self._name, reason)
        self.abort()

    def disconnect(self, reason: str) -> None:
        """Close the connection, because the device requires it; may be called from any thread."""
        with suppress(RuntimeError):  # the server has been closed
            self._loop.call_soon_threadsafe(self.give_up, reason)

    def _mark_alive(self) -> None:
        if self._liveness is None:
            self._liveness = LivenessMonitor(self._loop, self)
        self._liveness.start()

    @abstractmethod
    def _about(self) -> ClientInfo:
        """Return information on the client, for the provider."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection after pending data has been sent."""

    @abstractmethod
    def abort(self) -> None:
        """Close the connection immediately and drop pending data."""

    def when_input_processed(self, handled: Callable[[], None]) -> None:
        """Invoke ``handled`` after all data received so far has been processed; may be called from any thread.

        The next turn of the loop polls for received data, and the turn after that processes the data. One more turn is
        necessary, because the current turn may have polled already. If the data is queued, ``handled`` is invoked when
        it has been processed. If the loop is closed, ``handled`` is invoked immediately.
        """
        turns = iter(range(_DRAIN_TURNS - 1))

        def turn() -> None:
            if next(turns, None) is not None:
                self._loop.call_soon(turn)
            elif self.is_queued:
                self._waiting.append(_marker(handled))
            else:
                handled()

        try:
            self._loop.call_soon_threadsafe(turn)
        except RuntimeError:  # the server has been closed
            handled()

    # --- actions of the conversation ---------------------------------------------------------------------------------

    def _process(self, data: bytes, now: float) -> None:
        """Process received data after all earlier data: now, or when it is the client's turn.

        The caller stops reading while :attr:`is_queued` is True.

        Args:
            data: the data.
            now: time of the event loop, s.
        """
        self._heard = now
        self._waiting.append(self._conversation.receive(data, now))
        if not (self._slow or self._held):
            self._queue.serve(self, BYTE * len(data) if len(data) <= LONG else BYTE * LONG)

    def _continue(self) -> None:
        """Perform the waiting actions, unless the client must wait."""
        if self._waiting and not (self._slow or self._held):
            self.resume()
            self._queue.serve(self)

    def resume(self) -> None:
        """Update the time of the conversation after the client has waited."""
        self._conversation.update_time(self._loop.time())

    def step(self) -> bool:
        """Perform the actions that follow from the next packet; return True if the client has more to process now."""
        CLIENT.set(self._host)  # requires no reset, because every entry point of a connection sets it
        waiting = self._waiting
        while waiting:
            if self._slow or self._held:
                return False
            action = next(waiting[0], None)
            if action is None:
                waiting.popleft()
                continue
            if self._is_closing():  # further replies cannot be sent
                waiting.clear()
                break
            if type(action) is Execute:
                session = self._session
                if session is None:
                    session = self._new_session()
                if session is None:
                    self._refuse(action)
                else:
                    self._execute(session, action)
            else:
                self._perform(action)
            # there may be another packet
            if self._conversation.incomplete_bytes or self._conversation.has_queued or len(waiting) > 1:
                return True
        self._on_processed()
        return False

    def _perform(self, action: Action) -> None:
        if type(action) is Send:
            self._send(action.data)
        elif type(action) is Decode:
            self._hold()
            self._run_task(self._decode(action), cancellable=True)
        elif type(action) is Close:
            level = self._context.refusal_level(self._loop.time(), "closed")
            logger.log(level, "%s: closed: %s", self._name, action.reason)
            self._waiting.clear()
            self.close()
        elif type(action) is EndSession:
            if action.keeps_replies:
                self._end_served_session(action.reason)
            else:
                self._end_session(action.reason)

    def _on_processed(self) -> None:
        """Handle that all received data has been processed, except the beginning of an incomplete packet."""

    def _new_session(self) -> Session | None:
        """Return a session for a call of a peer that is not a client, or ``None`` to refuse the call."""
        return None

    def _end_session(self, reason: object = None) -> None:
        """Close the session; the peer may become a client again."""
        self._leave(reason)

    def _end_served_session(self, reason: object = None) -> None:
        """Close the session; the replies that have not been transmitted yet belong to the same client."""
        self._end_session(reason)

    def _refuse(self, call: Execute) -> None:
        self._answer(call, CallReply(hresult.E_MAX_CONNECT))

    def _run_task(self, work: Coroutine[object, object, None], *, cancellable: bool) -> None:
        """Run a coroutine for the current call; until it ends, the client receives S_EXECUTING."""
        self._task = task = self._loop.create_task(work)
        self._cancellable = cancellable
        self._context.tasks.add(task)
        task.add_done_callback(self._context.tasks.discard)
        self._set_alarm(self._conversation.next_time())

    def _hold(self) -> None:
        """Stop reading requests while the worker decodes a request or encodes its result.

        Unreliable transports do not require this: a request during that time may be dropped, because the client repeats
        it.
        """

    def _unhold(self) -> None:
        """Resume reading requests, and process those that have been received."""
        self._continue()

    def _free(self) -> None:
        self._task = self._work = None
        self._set_alarm(None)

    def _resume_queue(self) -> None:
        """Execute the requests that have waited for the end of a call."""
        self._set_alarm(self._conversation.next_time())
        if self._conversation.has_queued:
            self._waiting.appendleft(self._conversation.resume(self._loop.time()))
            self._continue()

    async def _decode(self, action: Decode) -> None:
        session = self._session
        arguments, size = await self._context.worker.run(partial(_read, action))
        if self._session is not session or self._is_closing():
            return
        if not self._memory.set(size):
            self._log_out_of_memory()
            arguments = ProtocolError("", hresult.E_OUTOFMEMORY)
        self._free()
        self._waiting.appendleft(self._conversation.decoded(action, arguments, self._loop.time()))
        self._unhold()

    def _execute(self, session: Session, call: Execute) -> None:
        if self.default_silence_limit is not None or self._conversation.max_silence is not None:
            self._mark_alive()
        outcome = session.invoke(call.function_id, call.arguments)
        if self._needs_secret and len(session):
            self._needs_secret = False
            self.has_precedence = True
            self._conversation.set_limits(self._context.limits)
        self._complete(session, call, outcome)

    def _complete(self, session: Session, call: Execute, outcome: Outcome) -> None:
        """Send the reply to a call, or wait for its result."""
        if type(outcome) is CallReply:
            self._answer(call, outcome)
        elif type(outcome) is Pending:
            if self._conversation.is_stop(call):
                self._run_stop(session, call, outcome)
                return
            self._work = outcome.work
            self._run_task(self._finish(session, call, outcome, self._memory), cancellable=is_cancellable(outcome.work))

    def _run_stop(self, session: Session, call: Execute, pending: Pending) -> None:
        """Execute a stop beside the call in progress."""
        task = self._loop.create_task(self._finish_stop(session, call, pending))
        self._stops[task] = pending.work
        self._context.tasks.add(task)
        task.add_done_callback(self._context.tasks.discard)
        self._set_alarm(self._conversation.next_time())

    async def _finish_stop(self, session: Session, call: Execute, pending: Pending) -> None:
        reply = await self._reply_to(session, call, pending)
        task = asyncio.current_task()
        if self._serves(session) and task is not None:
            self._stops.pop(task, None)
            self._conversation.update_time(self._loop.time())
            self._deliver(call, reply.code, reply.result)
            self._set_alarm(self._conversation.next_time())

    async def _reply_to(self, session: Session, call: Execute, pending: Pending) -> CallReply:
        """Wait for the result of a call, and return the reply."""
        begin_call(lambda: self._conversation.gave_up(call) or not self._serves(session))
        try:
            result = await result_of(pending.work)
        except BaseException as error:
            if isinstance(error, asyncio.CancelledError) and not self._serves(session):
                raise  # cancelled because the client has disconnected
            return session.fail(pending, error)
        return session.complete(pending, result, client_waits=not self._conversation.gave_up(call))

    async def _finish(self, session: Session, call: Execute, pending: Pending, memory: CallMemory) -> None:
        reply = await self._reply_to(session, call, pending)
        if self._serves(session):
            self._free()
            self._conversation.update_time(self._loop.time())
            self._answer(call, reply)
            if self._task is None:  # otherwise the worker encodes the result first
                self._resume_queue()
        else:
            memory.release()

    def _serves(self, session: Session) -> bool:
        """Return True if the replies to a session's calls can still be sent.

        They cannot be sent if the client has disconnected meanwhile, even if another client now uses the connection.
        """
        return self._session is session and not self._is_closing()

    def _answer(self, call: Execute, reply: CallReply) -> None:
        result = reply.result
        if result is not None and is_large(result):
            call.arguments.clear()
            if self._memory.set(memory_of((result,))):
                self._hold()
                self._run_task(self._encode(call, reply.code, result), cancellable=True)
                return
            self._log_out_of_memory()
            session = self._session
            reply = (
                CallReply(hresult.E_OUTOFMEMORY)
                if session is None
                else session.refuse(call.function_id, out_of_memory())
            )
        self._deliver(call, reply.code, reply.result)
        if self._memory.bytes or self._slow:
            self._on_reply_sent()

    def _on_reply_sent(self) -> None:
        """Count no memory for the call, whose reply has been passed to the transport."""
        self._memory.release()

    def _log_out_of_memory(self) -> None:
        level = self._context.refusal_level(self._loop.time(), "memory")
        logger.log(level, "%s: call refused: calls and replies use %d bytes", self._name, self._context.memory.bytes)

    async def _encode(self, call: Execute, code: int, result: Variant) -> None:
        session = self._session
        encoded = await self._context.worker.run(partial(self._conversation.encode, call, result))
        if self._session is session and not self._is_closing():
            self._free()
            self._conversation.update_time(self._loop.time())
            self._deliver(call, code, encoded)
            self._on_reply_sent()
            self._resume_queue()
            self._unhold()

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        data = self._conversation.finish(call, code, result)
        if data:
            self._send(data)

    def _set_alarm(self, when: float | None) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = None if when is None else self._loop.call_at(when, self._tick)

    def _tick(self) -> None:
        now = self._loop.time()
        while data := self._conversation.tick(now):
            if self._conversation.timed_out:
                self._abandon_call()  # before E_TIMEOUT is sent, after which nothing may start
            self._send(data)
        self._set_alarm(self._conversation.next_time())


def _read(action: Decode) -> tuple[list[Variant] | ProtocolError, int]:
    """Return the arguments of a large packet, and the memory that they require, bytes."""
    arguments = action.read()
    return arguments, 0 if isinstance(arguments, ProtocolError) else max(memory_of(arguments), action.size)


def _marker(reached: Callable[[], None]) -> Iterator[Action]:
    """Return an iterator without actions that invokes a callback when it is requested for one."""
    reached()
    yield from ()
