"""Clients of e-CAP. They have no connection of their own: a cookie tells who it is, or the address that a request is from.

A client that keeps cookies is known by its cookie. Of those that keep none (``curl``, a PLC) there is one for each address:
whoever sends no cookie from there is that client. Service_Start does not tell which kind it is of: its session can be
reached either way, until it shows. One that has been used without its cookie cannot be reached by it any more, so that
nobody's objects are ever mixed up with another's.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Hashable
from inspect import iscoroutine
from typing import Final

from orinkit.cao.provider import BlockingCall, ClientInfo
from orinkit.cao.results import begin_call
from orinkit.cao.service_options import ServiceOptions
from orinkit.cao.session import CallReply, Pending, Session
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.server.call_runner import result_of
from orinkit.server.context import ServerContext
from orinkit.server.liveness import LivenessMonitor
from orinkit.transport.address import network_of

logger = logging.getLogger("orinkit.server")

CALLS: Final = 8
"""How many calls of one client may be at work at a time."""
_MOST_CALLS: Final = 8 * CALLS  # those that it waits for no more too
FORGOTTEN_AFTER: Final = 10.0
"""Seconds of silence after which a client is forgotten whose connection broke while its call was at work, or whose cookie
never came back."""

_SERVICE_START: Final = 1
_YOUNG: Final = 1.0  # s in which a client may show its cookie before another one takes its place


class RunningCall:
    """A call that takes its time.

    Args:
        loop: the event loop that it lives in.
        cancellable: whether its work can be cancelled.

    Attributes:
        reply: what its client is to be told; ``None`` where the client has gone.
        task: does the work.
    """

    __slots__ = ("cancellable", "reply", "task", "told")

    task: asyncio.Task[None]

    def __init__(self, loop: asyncio.AbstractEventLoop, *, cancellable: bool) -> None:
        self.reply: asyncio.Future[CallReply | None] = loop.create_future()
        self.cancellable = cancellable
        self.told = True

    def answer(self, reply: CallReply | None) -> None:
        """Say what its client is to be told, unless that has been said."""
        if not self.reply.done():
            self.reply.set_result(reply)

    def give_up(self, reply: CallReply | None = None) -> None:
        """Wait for it no more. The work goes on, but its client will never hear what came of it.

        Args:
            reply: what the client is told instead; ``None`` where it has gone.
        """
        self.told = False
        self.answer(reply)


class HttpSession:
    """One client.

    Args:
        sessions: where it is found.
        key: value of its cookie.
        address: host address of the client.
        port: that its first request came from.

    Attributes:
        key: value of its cookie.
        address: host address of the client.
        session: its objects.
        invoke_timeout: seconds that its calls may take.
        known: its cookie has come back.
        plain: it has been used without a cookie.
        ended: it is nobody's any more.
        behind: the client of the same address whose Service_Start this may be as well.
    """

    def __init__(self, sessions: HttpSessions, key: str, address: str, port: int) -> None:
        shared = sessions.shared
        self.key = key
        self.address = address
        self.session = Session(shared.host, ClientInfo(address, "http", port), shared.numbers)
        self.invoke_timeout = shared.invoke_timeout
        self.known = False
        self.plain = False
        self.behind: HttpSession | None = None
        self._sessions = sessions
        self._shared = shared
        self._loop = sessions.loop
        self._name = f"{address}:{port}/http"
        self._calls: set[RunningCall] = set()
        self._waiting = 0  # requests that are being answered
        self._broken = False
        self._closing = False
        self.ended = False
        self.promise: float | None = None
        self.heard = self._heard = self._loop.time()
        self._connections: dict[Hashable, bool] = {}  # that are open, and whether one has carried several requests
        self._vigil = LivenessMonitor(self._loop, self)
        self._timer = self._loop.call_at(self._heard + self._patience(), self._look_at_the_time)
        logger.info("%s connected", self._name)

    # --- requests -------------------------------------------------------------------------------------------------

    def enter(self, connection: Hashable = None) -> None:
        """A request of it has come.

        Args:
            connection: that it came on; :meth:`disconnected` is to be told of its end.
        """
        self._waiting += 1
        self._broken = False
        self.heard = self._loop.time()
        if connection is not None:
            self._connections[connection] = connection in self._connections
        self._vigil.attend()

    def disconnected(self, connection: Hashable) -> None:
        """A connection has ended. With the last one that was kept for several requests its client has gone, if its arm moves."""
        kept = self._connections.pop(connection, False)
        if kept and not self.plain and not self._keeps_one and not self.ended and self.session.is_moving():
            self.end("its last connection has ended while its arm moves")

    @property
    def _keeps_one(self) -> bool:
        return any(self._connections.values())

    # --- signs of life: orinkit.server.liveness ------------------------------------------------------------------------

    @property
    def answered(self) -> float:
        """When it was last answered."""
        return self._heard

    @property
    def at_work(self) -> bool:
        """Whether a request of it is being answered."""
        return self._waiting > 0

    @property
    def patience(self) -> float | None:
        """Seconds that it may be silent while its motions run; no limit as long as it keeps a connection."""
        return None if self._keeps_one and not self.plain else self._shared.alive

    def give_up(self, reason: str) -> None:
        """It is taken to have gone."""
        logger.warning("%s: %s", self._name, reason)
        self.end(reason)

    def leave(self, *, broken: bool = False) -> None:
        """A request of it has been answered.

        Args:
            broken: it could not, as the connection is gone.
        """
        self._waiting -= 1
        self._heard = self._loop.time()
        if self._closing and not self._waiting:
            self.end()
        elif broken and not self.ended:
            self._broken = True
            self._be_watched()

    @property
    def busy(self) -> bool:
        """Whether as many of its calls are at work as may be; those that it has given up count less."""
        waited_for = sum(call.told for call in self._calls)
        return waited_for >= CALLS or len(self._calls) >= _MOST_CALLS

    @property
    def network(self) -> str:
        """Where it is from; see :class:`~orinkit.server.context.Client`."""
        return network_of(self.address)

    def idle_since(self) -> float | None:
        """Return when it was last heard of; ``None`` where it has objects, or anything is at work for it."""
        return self._heard if self.idle else None

    def give_way(self) -> None:
        """Be forgotten: another client has come, and this one holds nothing."""
        self.end("idle, it has made way for another client")

    @property
    def idle(self) -> bool:
        """Whether it has no objects and nothing is at work for it."""
        return not (self._waiting or self._calls or len(self.session))

    def set_options(self, options: ServiceOptions) -> None:
        """Take what it has asked for with Service_Start."""
        default = self._shared.invoke_timeout
        self.promise = options.alive
        self.invoke_timeout = default if options.invoke_timeout is None else options.invoke_timeout
        if self.behind is not None:
            self.behind.set_options(options)

    def begin(self, pending: Pending) -> RunningCall:
        """Have work done whose result comes later. It goes on when the connection breaks, until the session ends."""
        call = RunningCall(self._loop, cancellable=type(pending.work) is not BlockingCall)
        call.task = task = self._loop.create_task(self._finish(pending, call))
        self._calls.add(call)
        self._shared.tasks.add(task)

        def done(_: object) -> None:
            self._shared.tasks.discard(task)
            if iscoroutine(pending.work):
                pending.work.close()  # one that was cancelled before it began would complain

        task.add_done_callback(done)
        return call

    async def _finish(self, pending: Pending, call: RunningCall) -> None:
        begin_call(lambda: not call.told)
        try:
            result = await result_of(pending.work)
        except BaseException as error:
            if isinstance(error, asyncio.CancelledError) and self.ended:
                raise  # it is the client that has gone
            reply = self.session.fail(pending, error)
        else:
            reply = self.session.complete(pending, result, told=call.told)
        finally:
            self._calls.discard(call)
        call.answer(reply)

    # --- its end --------------------------------------------------------------------------------------------------

    def replaced(self) -> None:
        """It can be reached by its cookie only from now on."""
        self._be_watched()

    def _patience(self) -> float:
        idle = self._sessions.idle
        fleeting = self._broken or not (self.known or self._sessions.is_at_its_address(self))
        return min(idle, FORGOTTEN_AFTER) if fleeting else idle

    def _be_watched(self) -> None:
        self._timer.cancel()
        self._timer = self._loop.call_at(self._heard + self._patience(), self._look_at_the_time)

    def _look_at_the_time(self) -> None:
        now = self._loop.time()
        if self._waiting:
            self._heard = now
        if now < self._heard + self._patience():
            self._be_watched()
        else:
            self.end("nothing heard")

    def seems_lost(self) -> bool:
        """Whether it holds nothing and its cookie should have come back by now, if it ever does."""
        fleeting = self.idle and not self.known and not self._sessions.is_at_its_address(self)
        return fleeting and self._loop.time() >= self._heard + _YOUNG

    def end(self, reason: object = None) -> None:
        """Forget it: whatever it held is released, what it waits for is cancelled.

        Work in a thread goes on, as a thread cannot be cancelled; an object that it makes is released then.
        """
        if self.ended:
            return
        self.ended = True
        self._timer.cancel()
        self._vigil.end()
        self._sessions.forget(self)
        self._shared.open.discard(self)
        calls, self._calls = self._calls, set()
        for call in calls:
            call.give_up(CallReply(hresult.E_ABORT, detail=tr("the session has ended")))
            if call.cancellable:
                call.task.cancel()
        logger.info("%s disconnected%s", self._name, f": {reason}" if reason else "")
        self.session.close()
        self._shared.discard(self)

    def close(self) -> None:
        """End it as soon as its calls have been answered: the server is closing."""
        self._closing = True
        if not self._waiting:
            self.end()

    def abort(self) -> None:
        """End it."""
        self.end()


class HttpSessions:
    """The clients at one address of a server.

    Args:
        shared: what all clients of the server share.
        idle: seconds of silence after which one is forgotten.
    """

    def __init__(self, shared: ServerContext, idle: float) -> None:
        self.shared = shared
        self.loop = asyncio.get_running_loop()
        self.idle = idle
        self._by_key: dict[str, HttpSession] = {}  # the oldest first
        self._by_address: dict[str, HttpSession] = {}

    def by_key(self, key: str) -> HttpSession | None:
        """Return the client whose cookie this is: it keeps cookies, so it is not its address's any more."""
        found = self._by_key.get(key)
        if found is not None and not found.known:
            found.known = True
            found.behind = None
            if self.is_at_its_address(found):
                del self._by_address[found.address]
        return found

    def at(self, address: str) -> HttpSession | None:
        """Return the client of an address: of those who keep no cookies."""
        return self._by_address.get(address)

    def is_at_its_address(self, session: HttpSession) -> bool:
        """Whether a client is found by its address."""
        return self._by_address.get(session.address) is session

    def newcomer(self, address: str, port: int) -> HttpSession | None:
        """Return a new client, found by its cookie only; ``None`` where there is no room."""
        shared = self.shared
        if not shared.closing and len(shared.open) >= shared.clients:
            self._make_room()
        reason = shared.make_room(network_of(address))
        if reason:
            logger.log(shared.refusal_level(self.loop.time()), "%s:%d/http refused: %s", address, port, reason)
            return None
        made = HttpSession(self, secrets.token_urlsafe(18), address, port)
        self._by_key[made.key] = made
        shared.open.add(made)
        shared.all.add(made)
        return made

    def beginning(self, address: str, port: int) -> HttpSession | None:
        """Return the client that a Service_Start without a cookie is from; ``None`` where there is no room for it.

        It is a new one, for it may be one that keeps cookies and has none yet. It may also be the address's: its place is
        taken, unless another one has shown that it is that; then both have begun.
        """
        there = self._by_address.get(address)
        made = self.newcomer(address, port)
        if made is None:
            return None if there is None else self._be_plain(there)
        if there is None or not there.plain:
            self._by_address[address] = made
            if there is not None:
                there.replaced()
        else:
            there.enter()
            there.leave()
            made.behind = there
        return made

    def without_cookie(self, address: str, port: int) -> HttpSession | None:
        """Return the client that any other request without a cookie is from; ``None`` where there is no room for it."""
        there = self._by_address.get(address)
        if there is None:
            there = self.newcomer(address, port)
            if there is None:
                return None
            self._by_address[address] = there
        return self._be_plain(there)

    def _be_plain(self, session: HttpSession) -> HttpSession:
        session.plain = True
        self._by_key.pop(session.key, None)
        return session

    def _make_room(self) -> None:
        lost = next((each for each in self._by_key.values() if each.seems_lost()), None)
        if lost is not None:
            lost.end("its cookie never came back")

    def forget(self, session: HttpSession) -> None:
        """Find a client no more."""
        self._by_key.pop(session.key, None)
        if self.is_at_its_address(session):
            del self._by_address[session.address]
