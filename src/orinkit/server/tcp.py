"""A b-CAP client's TCP connection, server side: the shell around conversation and session."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any, Final

from orinkit import hresult
from orinkit.bcap.server import Action, Close, Execute, Send, ServerConversation
from orinkit.cao.provider import Blocking, ClientInfo, Later
from orinkit.cao.session import Host, Pending, Reply, Session
from orinkit.variant_bytes import Limits

logger = logging.getLogger("orinkit.server")

_CHUNK: Final = 65536
_TURNS: Final = 100
_TURNS_OF_A_LOOK: Final = 3


class Connections:
    """What the connections of one server share.

    Args:
        host: the providers.
        limits: bounds on packets.
        clients: how many clients at a time; one more is answered with E_MAX_CONNECT and closed.
        invoke_timeout: seconds, see :class:`~orinkit.bcap.server.ServerConversation`.

    Attributes:
        open: the clients' connections.
        all: these, and the ones that are being refused.
        opening: how many connections have been accepted and are not in ``all`` yet.
        closing: no more connections.
        empty: is set when the last of ``all`` has gone.
        tasks: handlers at work, also those whose client has gone.
    """

    def __init__(self, host: Host, limits: Limits, clients: int, invoke_timeout: float) -> None:
        self.host = host
        self.limits = limits
        self.clients = clients
        self.invoke_timeout = invoke_timeout
        self.open: set[TcpConnection] = set()
        self.all: set[TcpConnection] = set()
        self.opening = 0
        self.closing = False
        self.empty = asyncio.Event()
        self.tasks: set[asyncio.Task[None]] = set()
        self.buffer = bytearray(_CHUNK)
        self.view = memoryview(self.buffer)

    def make(self) -> TcpConnection:
        """Return the protocol for a new connection."""
        self.opening += 1
        return TcpConnection(self)

    async def refuse(self) -> None:
        """Take no more connections, and see those through that are just being accepted.

        To be called before the listeners are closed: asyncio forgets a connection that it accepts meanwhile.
        """
        self.closing = True
        for turn in range(_TURNS):
            if turn > 2 and not self.opening:  # accepted, made, connected: a turn each
                break
            await asyncio.sleep(0)

    async def close(self, seconds: float) -> None:
        """Close all connections and let the handlers end; what is not done within the seconds is cut off."""
        for connection in list(self.all):
            connection.close()
        if self.all:
            self.empty.clear()
            try:
                async with asyncio.timeout(seconds):
                    await self.empty.wait()
            except TimeoutError:  # a client does not take its last answers
                for connection in list(self.all):
                    connection.abort()
        await asyncio.sleep(0)
        if self.tasks:
            await asyncio.wait(self.tasks, timeout=seconds)
        for task in self.tasks:
            task.cancel()
        await asyncio.sleep(0)


async def in_thread(function: Callable[[], Any]) -> Any:
    """Run a function in a thread of its own and return what it returns, or raise what it raises.

    Not in asyncio's executor: a daemon thread does not keep the program from ending, should the function never return;
    and what it raises may be anything, such as StopIteration, which no future can hold.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    outcome: list[tuple[bool, Any]] = []

    def run() -> None:
        try:
            outcome.append((True, function()))
        except BaseException as error:  # noqa: BLE001 - raised again where it is awaited
            outcome.append((False, error))
        try:
            loop.call_soon_threadsafe(finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    threading.Thread(target=run, name="orinkit-worker", daemon=True).start()
    await done
    succeeded, value = outcome[0]
    if succeeded:
        return value
    if isinstance(value, StopIteration):  # would end the coroutine instead of telling of the error
        raise RuntimeError(f"StopIteration: {value}") from value  # noqa: TRY004 - as Python itself does
    raise value


async def later(promise: Later[Any]) -> Any:
    """Wait for a result that the device has promised and return it, or raise what the call failed with."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def finish() -> None:
        if not done.done():
            done.set_result(None)

    def finish_from_anywhere() -> None:
        try:
            loop.call_soon_threadsafe(finish)
        except RuntimeError:  # the server has been closed meanwhile
            pass

    promise.when_done(finish_from_anywhere)
    await done
    return promise.result()


class TcpConnection(asyncio.BufferedProtocol):
    """One client.

    A buffered protocol, because asyncio gives a plain one every piece of data in a new block of 256 KiB, which costs
    more than everything else that is done for a call.
    """

    def __init__(self, shared: Connections) -> None:
        self._shared = shared
        self._conversation = ServerConversation(shared.limits, shared.invoke_timeout)
        self._session: Session | None = None  # None: one client too many
        self._task: asyncio.Task[None] | None = None
        self._cancellable = False
        self._alarm: asyncio.TimerHandle | None = None
        self._waiting: Iterator[Action] | None = None
        self._slow = False

    # --- asyncio calls these ------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        peer = transport.get_extra_info("socket")
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        address, port = (transport.get_extra_info("peername") or ("", 0))[:2]
        self._shared.opening -= 1
        self._shared.all.add(self)
        if self._shared.closing:
            transport.abort()
        elif len(self._shared.open) < self._shared.clients:
            self._session = Session(self._shared.host, ClientInfo(address, "tcp", port, self.look))
            self._shared.open.add(self)
            logger.info("%s:%s connected", address, port)
        else:
            self._alarm = self._loop.call_later(5.0, transport.abort)  # time to ask once and be told
            logger.warning("%s:%s refused: %d clients are connected", address, port, self._shared.clients)

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - declared by the base
        """Where to put what comes next; all connections share it, for it is read at once."""
        return self._shared.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """The client has sent something."""
        self._act(self._conversation.receive(bytes(self._shared.view[:nbytes]), self._loop.time()))

    def pause_writing(self) -> None:
        """The client does not take its answers: stop listening to it."""
        self._slow = True
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        """It takes them again."""
        self._slow = False
        self._transport.resume_reading()
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._conversation.go_on(self._loop.time())
            self._act(waiting)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone: whatever it held is released.

        Work in a thread goes on, as a thread cannot be cancelled; an object that it makes is released then.
        """
        self._set_alarm(None)
        self._waiting = None
        self._shared.open.discard(self)
        self._shared.all.discard(self)
        if not self._shared.all:
            self._shared.empty.set()
        if self._task is not None and self._cancellable:
            self._task.cancel()
        session, self._session = self._session, None  # they know each other: without this only the collector ends them
        if session is not None:
            logger.info(
                "%s:%s disconnected%s",
                session.client.address,
                session.client.port,
                f": {exc}" if exc else "",
            )
            session.close()

    def look(self, handled: Callable[[], None]) -> None:
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

    # --- what the conversation says -----------------------------------------------------------------------------

    def _act(self, actions: Iterator[Action]) -> None:
        for action in actions:
            if self._transport.is_closing():  # the client has gone; what else it asked for is for nobody
                return
            if type(action) is Execute:
                if self._session is None:
                    self._answer(action, Reply(hresult.E_MAX_CONNECT))
                    self._transport.close()
                    return
                self._execute(self._session, action)
            elif type(action) is Send:
                self._transport.write(action.data)
            elif type(action) is Close:
                logger.warning("%s: closed: %s", self._transport.get_extra_info("peername"), action.reason)
                self._transport.close()
                return
            if self._slow:
                self._waiting = actions
                return

    def _execute(self, session: Session, call: Execute) -> None:
        outcome = session.invoke(call.function_id, call.arguments)
        if type(outcome) is Reply:
            self._answer(call, outcome)
        elif type(outcome) is Pending:
            self._task = self._loop.create_task(self._finish(session, call, outcome))
            self._cancellable = type(outcome.work) is not Blocking
            self._shared.tasks.add(self._task)
            self._task.add_done_callback(self._shared.tasks.discard)
            self._set_alarm(self._conversation.deadline())

    async def _finish(self, session: Session, call: Execute, pending: Pending) -> None:
        try:
            result = await _awaitable(pending.work)
        except BaseException as error:
            if isinstance(error, asyncio.CancelledError) and self._transport.is_closing():
                raise  # it is the client that has gone
            reply = session.fail(pending, error)
        else:
            reply = session.complete(pending, result, told=not self._conversation.timed_out)
        self._task = None
        if not self._transport.is_closing():
            self._set_alarm(None)
            self._answer(call, reply)

    def _answer(self, call: Execute, reply: Reply) -> None:
        data = self._conversation.finish(call, reply.code, reply.result)
        if data:
            self._transport.write(data)

    def _set_alarm(self, when: float | None) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = None if when is None else self._loop.call_at(when, self._tick)

    def _tick(self) -> None:
        data = self._conversation.tick(self._loop.time())
        if data:
            self._transport.write(data)
        self._set_alarm(self._conversation.deadline())

    def close(self) -> None:
        """Close the connection from this side, once what was written has been sent."""
        self._transport.close()

    def abort(self) -> None:
        """Close the connection at once, whatever was to be sent."""
        self._transport.abort()


def _awaitable(work: Any) -> Any:
    if type(work) is Blocking:
        return in_thread(work.run)
    return later(work) if type(work) is Later else work
