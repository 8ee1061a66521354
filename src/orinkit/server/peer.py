"""A b-CAP client, server side: the shell around conversation and session that all kinds of connections share."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from itertools import chain
from typing import Final

from orinkit.bcap.profiles import BcapProfile
from orinkit.bcap.server import Action, Close, Decode, Encoded, Execute, Reset, Send, ServerConversation
from orinkit.cao.provider import BlockingCall, ClientInfo
from orinkit.cao.results import begin_call
from orinkit.cao.session import CallReply, Pending, Session
from orinkit.core import hresult
from orinkit.server.call_runner import result_of
from orinkit.server.context import ServerContext
from orinkit.server.large_values import is_large
from orinkit.server.liveness import LivenessMonitor
from orinkit.server.log_limiter import CLIENT
from orinkit.transport.address import network_of
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.server")

_TURNS_OF_A_LOOK: Final = 3


class Peer(ABC):
    """One client, or one who may become one.

    A kind of connection derives from it, sets the first three attributes once it is connected, and gives what it
    receives to :meth:`_act`.

    Args:
        shared: what all clients of the server share.
        loop: the event loop that it lives in.
        profile: how its packets travel.

    Attributes:
        _name: who it is, for the log.
        _host: the same without the port: one who comes again is the same client.
        _send: sends bytes, or drops them where nobody takes them; never waits.
        _is_gone: tells whether there is nobody any more to whom anything could be sent.
        _session: its objects; ``None`` while it is no client.
    """

    _name: str
    _host: str
    _send: Callable[[bytes | bytearray], None]
    _is_gone: Callable[[], bool]

    def __init__(self, shared: ServerContext, loop: asyncio.AbstractEventLoop, profile: BcapProfile) -> None:
        self._shared = shared
        self._loop = loop
        self._conversation = ServerConversation(shared.limits, shared.invoke_timeout, profile, shared.host.dialect)
        self._session: Session | None = None
        self._vigil: LivenessMonitor | None = None
        self._task: asyncio.Task[None] | None = None
        self._cancellable = False
        self._alarm: asyncio.TimerHandle | None = None
        self._waiting: Iterator[Action] | None = None
        self._slow = False
        self._heard = 0.0
        self._network: str | None = None
        self._held = False

    # --- who it is ------------------------------------------------------------------------------------------------

    def _admit(self) -> Session | None:
        """Make it a client, if there is room for one more."""
        shared = self._shared
        CLIENT.set(self._host)
        reason = shared.make_room(self.network)
        if reason:
            logger.log(shared.refusal_level(self._loop.time()), "%s refused: %s", self._name, reason)
            return None
        self._session = Session(shared.host, self._about())
        shared.open.add(self)
        logger.info("%s connected", self._name)
        return self._session

    def _leave(self, reason: object = None) -> None:
        """It is a client no more: whatever it held is released, what it waits for is cancelled.

        Work in a thread goes on, as a thread cannot be cancelled; an object that it makes is released then.
        """
        self._set_alarm(None)
        if self._vigil is not None:
            self._vigil.end()
        self._waiting = None
        self._shared.open.discard(self)
        session, self._session = self._session, None  # they know each other: without this only the collector ends them
        task, self._task = self._task, None
        if task is not None and self._cancellable:
            task.cancel()
        if session is not None:
            before = CLIENT.set(self._host)  # the server may be closing, in a task of the program
            logger.info("%s disconnected%s", self._name, f": {reason}" if reason else "")
            session.close()
            CLIENT.reset(before)

    @property
    def network(self) -> str:
        """Where it is from; see :class:`~orinkit.server.context.Client`."""
        if self._network is None:
            self._network = network_of(self._host)
        return self._network

    def idle_since(self) -> float | None:
        """Return when it was last heard of; ``None`` where it holds an object, or a call is at work."""
        session = self._session
        return None if session is None or len(session) or self._task is not None else self._heard

    def give_way(self) -> None:
        """Be a client no more: another one has come, and this one holds nothing."""
        self._rest("idle, it has made way for another client")

    # --- signs of life: orinkit.server.liveness ------------------------------------------------------------------------

    patience: float | None = None

    @property
    def heard(self) -> float:
        """When the last whole request came."""
        return self._conversation.heard

    @property
    def answered(self) -> float:
        """When it was last answered."""
        return self._conversation.answered

    @property
    def at_work(self) -> bool:
        """Whether a call of it is at work."""
        return self._conversation.busy

    @property
    def promise(self) -> float | None:
        """Seconds within which it wants to be heard."""
        return self._conversation.alive

    @property
    def session(self) -> Session | None:
        """Its objects."""
        return self._session

    def give_up(self, reason: str) -> None:
        """It is taken to have gone."""
        logger.warning("%s: closed: %s", self._name, reason)
        self.abort()

    def _attend(self) -> None:
        if self._vigil is None:
            self._vigil = LivenessMonitor(self._loop, self)
        self._vigil.attend()

    @abstractmethod
    def _about(self) -> ClientInfo:
        """Return who it is, for the device."""

    @abstractmethod
    def close(self) -> None:
        """Close it from this side, once what was written has been sent."""

    @abstractmethod
    def abort(self) -> None:
        """Close it at once, whatever was to be sent."""

    def drain_input(self, handled: Callable[[], None]) -> None:
        """Call back once everything that has arrived by now has been handled; may be called from any thread.

        The next turn of the loop asks for what has arrived, the one behind it has handled that. One more, because the
        loop may just have asked and not begun to handle. A loop that is closed handles nothing any more.
        """
        turns = iter(range(_TURNS_OF_A_LOOK - 1))

        def turn() -> None:
            if next(turns, None) is None:
                handled()
            else:
                self._loop.call_soon(turn)

        try:
            self._loop.call_soon_threadsafe(turn)
        except RuntimeError:  # the server has been closed
            handled()

    # --- what the conversation says ---------------------------------------------------------------------------------

    def _act(self, actions: Iterator[Action]) -> None:
        CLIENT.set(self._host)  # nobody resets it: every entry into a connection sets its own
        for action in actions:
            if self._is_gone():  # what else it asked for is for nobody
                return
            if type(action) is Execute:
                session = self._session
                if session is None:
                    session = self._newcomer()
                if session is None:
                    self._refuse(action)
                else:
                    self._execute(session, action)
            elif type(action) is Send:
                self._send(action.data)
            elif type(action) is Decode:
                self._hold()
                self._be_busy(self._decode(action), cancellable=True)
            elif type(action) is Close:
                level = self._shared.refusal_level(self._loop.time(), "closed")
                logger.log(level, "%s: closed: %s", self._name, action.reason)
                self.close()
                return
            elif type(action) is Reset:
                self._rest(action.reason)
            if self._slow or self._held:
                self._waiting = actions
                return

    def _newcomer(self) -> Session | None:
        """Return the session for a call of one who is no client; ``None`` refuses it."""
        return None

    def _rest(self, reason: object = None) -> None:
        """It is a client no more, but may become one again."""
        self._leave(reason)

    def _refuse(self, call: Execute) -> None:
        self._answer(call, CallReply(hresult.E_MAX_CONNECT))

    def _be_busy(self, work: Coroutine[object, object, None], *, cancellable: bool) -> None:
        """Have something done that takes its time, and the client told meanwhile that it is at work."""
        self._task = task = self._loop.create_task(work)
        self._cancellable = cancellable
        self._shared.tasks.add(task)
        task.add_done_callback(self._shared.tasks.discard)
        self._set_alarm(self._conversation.deadline())

    def _hold(self) -> None:  # noqa: B027 - not every kind of connection does it
        """DrainInput at no further request while one is read, or its result written, elsewhere.

        Where requests may be lost each is answered at once; its client sends it again.
        """

    def _let_go(self) -> None:  # noqa: B027
        """DrainInput at further requests again."""

    def _go_on(self) -> None:
        """Do what had to wait, unless it has to wait longer."""
        if not (self._slow or self._held):
            waiting, self._waiting = self._waiting, None
            if waiting is not None:
                self._conversation.go_on(self._loop.time())
                self._act(waiting)

    def _free(self) -> None:
        self._task = None
        self._set_alarm(None)

    async def _decode(self, action: Decode) -> None:
        session = self._session
        arguments = await self._shared.worker.run(action.read)
        if self._session is not session or self._is_gone():
            return
        self._free()
        self._let_go()
        waiting, self._waiting = self._waiting, None
        self._act(chain(self._conversation.decoded(action, arguments, self._loop.time()), waiting or ()))

    def _execute(self, session: Session, call: Execute) -> None:
        if self.patience is not None or self._conversation.alive is not None:
            self._attend()
        outcome = session.invoke(call.function_id, call.arguments)
        if type(outcome) is CallReply:
            self._answer(call, outcome)
        elif type(outcome) is Pending:
            self._be_busy(self._finish(session, call, outcome), cancellable=type(outcome.work) is not BlockingCall)

    async def _finish(self, session: Session, call: Execute, pending: Pending) -> None:
        begin_call(lambda: self._conversation.timed_out or not self._serves(session))
        try:
            result = await result_of(pending.work)
        except BaseException as error:
            if isinstance(error, asyncio.CancelledError) and not self._serves(session):
                raise  # it is the client that has gone
            reply = session.fail(pending, error)
        else:
            reply = session.complete(pending, result, told=not self._conversation.timed_out)
        if self._serves(session):
            self._free()
            self._conversation.go_on(self._loop.time())
            self._answer(call, reply)

    def _serves(self, session: Session) -> bool:
        """Whether the client whose session it is is still there; another one may have come in its place."""
        return self._session is session and not self._is_gone()

    def _answer(self, call: Execute, reply: CallReply) -> None:
        result = reply.result
        if result is not None and is_large(result):
            self._hold()
            self._be_busy(self._encode(call, reply.code, result), cancellable=True)
        else:
            self._deliver(call, reply.code, result)

    async def _encode(self, call: Execute, code: int, result: Variant) -> None:
        session = self._session
        encoded = await self._shared.worker.run(partial(self._conversation.encode, call, result))
        if self._session is session and not self._is_gone():
            self._free()
            self._let_go()
            self._conversation.go_on(self._loop.time())
            self._deliver(call, code, encoded)
            self._go_on()

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        data = self._conversation.finish(call, code, result)
        if data:
            self._send(data)

    def _set_alarm(self, when: float | None) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = None if when is None else self._loop.call_at(when, self._tick)

    def _tick(self) -> None:
        data = self._conversation.tick(self._loop.time())
        if data:
            self._send(data)
        self._set_alarm(self._conversation.deadline())


class ConnectionlessClient(Peer):
    """A client without a connection: its first call makes it one, until Service_Stop."""

    def _newcomer(self) -> Session | None:
        return self._admit()

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        data = self._conversation.finish(call, code, result)
        if self._conversation.stopped:
            self._rest()
        if data:
            self._send(data)
