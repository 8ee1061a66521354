"""The ASGI application for e-CAP: checks a request, calls the function, and sends the response.

The reply of a function always has status 200 and a return code in its body. Any other status means that no function was
called.
"""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from typing import Final
from urllib.parse import quote

from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from orinkit.bcap.server import LARGE
from orinkit.cao.functions import robot_halt, robot_hold, task_stop
from orinkit.cao.service_options import ServiceOptions, read_options
from orinkit.cao.session import CallReply, Pending, Session
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.ecap.message import EcapRequest, read_request, write_reply
from orinkit.server.capacity import CallMemory, IncompleteRequests
from orinkit.server.context import ServerContext
from orinkit.server.http.access import (
    AccessCheck,
    Headers,
    ambiguous,
    closed,
    is_proxied,
    plain,
    too_long,
    too_many_guesses,
    too_many_request_bytes,
)
from orinkit.server.http.limits import LimitedProtocol
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.sessions import CALLS, HttpSession, HttpSessions, RunningCall
from orinkit.server.large_values import is_large, memory_of, out_of_memory
from orinkit.server.log_limiter import CLIENT

logger = logging.getLogger("orinkit.server")

_SERVICE_START: Final = 1
_SERVICE_STOP: Final = 2
_STOPPING: Final = (robot_halt.id, robot_hold.id, task_stop.id)  # permitted even if the client is busy
_CONNECT: Final = 3
_WITHOUT_HANDLE: Final = (_SERVICE_START, _SERVICE_STOP, _CONNECT)
_NO_TOKEN: Final = 401
_HELD: Final = 32  # maximum number of delayed replies to wrong tokens of one address
_SUSPICIOUS: Final = (_NO_TOKEN, 403, 421, 429)
_DO_NOT_READ: Final = -1  # a limit for Exchange.refuse: the body is not read before the refusal
_LONGEST_DETAIL: Final = 500  # maximum number of characters of an error description
_PIECE: Final = 64 * 1024  # bytes of a response that one call of send transfers; no more is unsent after the last call
_INTERVALS: Final = range(80, 60_001)  # valid intervals of keep-alive bytes, ms
_PLAIN: Final = "".join(chr(sign) for sign in range(0x20, 0x7F) if chr(sign) != "%")
_TEXT: Final = (b"content-type", b"text/plain; charset=utf-8")
_EXECUTING: Final = b"orinkit-executing"


class _Disconnected(Exception):
    """Raised when the client has closed its connection."""


class App:
    """The ASGI application of one HTTP listener.

    Args:
        context: the state shared by all clients of the server.
        options: options for HTTP.
        secure: True if the listener uses https.
    """

    def __init__(self, context: ServerContext, options: HttpOptions, *, secure: bool) -> None:
        self._context = context
        self._sessions = HttpSessions(context, options.idle)
        self._access = AccessCheck(options, secure=secure)
        self._secure = secure
        self._cookie = b""
        self._takes_start_options = context.host.dialect.takes_start_options
        self._code_replacements = context.host.dialect.code_replacements

    def listens_at(self, port: int) -> None:
        """Set the port of the listener.

        The name of the cookie contains the port, because a client sends a cookie to every port of the host.
        """
        self._cookie = b"orinkit-%d" % port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Process one request."""
        exchange = Exchange(scope, receive, send, CallMemory(self._context.memory))
        CLIENT.set(exchange.connection.host)
        try:
            unclear = ambiguous(scope["headers"])
            if unclear is not None:
                self._log(exchange, unclear.status_code)
                await exchange.refuse(unclear, _DO_NOT_READ)
                return
            refusal = self._refusal(scope["method"], exchange)
            if refusal is None:
                refusal = await self._serve(exchange)
            if refusal is not None:
                self._log(exchange, refusal.status_code)
                if refusal.status_code == _NO_TOKEN:
                    await self._slow_down(exchange)
                await exchange.refuse(refusal, self._context.limits.packet if exchange.has_room else _DO_NOT_READ)
        except _Disconnected:
            pass
        except asyncio.CancelledError:
            if not exchange.connection.is_closed:
                raise
            # If the connection is closed, the server is closing and the client has already disconnected.
        except Exception:
            logger.exception("%s: error while processing a request", exchange.connection.name)
            if not exchange.begun:
                text = tr("internal server error. Try: see the server's log")
                await exchange.refuse(plain(500, text), 0)

    def _refusal(self, method: str, exchange: Exchange) -> PlainTextResponse | None:
        """Return the response that refuses the request, or None if it is permitted."""
        if self._context.closing:
            return closed()
        if self._context.held[exchange.connection.network] >= _HELD and not self._session_of(exchange):
            return too_many_guesses()
        return self._access.refusal(method, exchange.headers)

    def _session_of(self, exchange: Exchange) -> HttpSession | None:
        """Return the session that the cookie of the request identifies; ``None`` if there is none."""
        key = self._key(exchange.headers.get(b"cookie", b""))
        return self._sessions.by_key(key) if key else None

    def _log(self, exchange: Exchange, status: int) -> None:
        level = logging.INFO
        if status in _SUSPICIOUS:
            level = self._context.refusal_level(asyncio.get_running_loop().time())
        logger.log(level, "%s: refused with status %d", exchange.connection.name, status)

    async def _slow_down(self, exchange: Exchange) -> None:
        """Delay the response to a wrong token if the client's address has sent several wrong tokens."""
        context = self._context
        network = exchange.connection.network
        failure = context.guesses.failed(network, asyncio.get_running_loop().time())
        if failure.failures_to_log:
            logger.warning("%s: %d HTTP requests with a wrong token or without one", network, failure.failures_to_log)
        if not failure.delay or context.closing:
            return
        context.held[network] += 1
        try:
            await asyncio.sleep(failure.delay)
        finally:
            context.held[network] -= 1
            if not context.held[network]:
                del context.held[network]

    async def _serve(self, exchange: Exchange) -> PlainTextResponse | None:
        """Process a permitted request and send the reply.

        Returns:
            The response to send instead of the reply if the body of the request is too long, or exceeds the limit on
            the bytes of incomplete requests; otherwise ``None``.
        """
        key = self._key(exchange.headers.get(b"cookie", b""))
        session = self._sessions.by_key(key) if key else None
        if session is not None:
            self._enter(session, exchange)
        try:
            try:
                body = await exchange.body(self._context.limits.packet, self._context.partial)
                if body is None:
                    return too_long(self._context.limits.packet) if exchange.has_room else too_many_request_bytes()
                request = await self._read(body)
                if len(body) > LARGE and not exchange.memory.set(max(memory_of(request.arguments), len(body))):
                    raise out_of_memory()
            except CallError as error:
                await self._answer(exchange, CallReply(error.code, detail=error.detail))
                return None
            finally:  # the body counts until the worker has decoded it
                exchange.give_room(self._context.partial)
            if session is None or session.ended:  # the session may have ended while the body was read
                session = self._find(exchange, request.function.id, keeps_cookies=bool(key))
                if session is not None:
                    self._enter(session, exchange)
            reply = await self._reply(exchange, session, request)
            if key and request.function.id == _SERVICE_STOP:
                exchange.add(b"set-cookie", self._set_cookie("", b"; Max-Age=0"))
            await self._answer(exchange, reply)
        finally:
            exchange.memory.release()
            if session is not None:
                session.end_request(broken=exchange.connection.is_closed)
        return None

    def _enter(self, session: HttpSession, exchange: Exchange) -> None:
        connection = exchange.connection
        given = exchange.headers
        session.begin_request(connection, proxied=is_proxied(given), sends_signs=_EXECUTING in given)
        connection.carried.add(session)

    # --- sessions ------------------------------------------------------------------------------------------------

    def _key(self, cookies: bytes) -> str:
        """Return the value of the client's cookie, or ``""`` if there is none."""
        for cookie in cookies.split(b";"):
            name, mark, value = cookie.partition(b"=")
            if mark and name.strip() == self._cookie:
                return value.strip().decode("latin-1")
        return ""

    def _find(self, exchange: Exchange, function_id: int, *, keeps_cookies: bool) -> HttpSession | None:
        """Return the session of a request without a valid cookie; create it if necessary.

        Args:
            exchange: the request.
            function_id: id of the function that the request calls.
            keeps_cookies: True if the request contains a cookie, which however identifies no open session.

        Returns:
            The session; ``None`` if a limit is reached, or for a Service_Stop without a session.
        """
        address, port = exchange.scope["client"] or ("", 0)
        if _EXECUTING in exchange.headers and function_id in _WITHOUT_HANDLE:  # a client of orinkit
            keeps_cookies = True
        if function_id == _SERVICE_STOP:  # this function never opens a session
            return None if keeps_cookies else self._sessions.by_address(address)
        if keeps_cookies:
            session = self._sessions.create(address, port)
        elif function_id == _SERVICE_START:
            session = self._sessions.for_service_start(address, port)
        else:
            session = self._sessions.without_cookie(address, port)
        if session is not None and not session.plain:
            exchange.add(b"set-cookie", self._set_cookie(session.key))
        return session

    def _set_cookie(self, value: str, more: bytes = b"") -> bytes:
        secure = b"; Secure" if self._secure else b""
        return b"%s=%s; HttpOnly; SameSite=Strict; Path=/%s%s" % (self._cookie, value.encode(), secure, more)

    # --- a call ---------------------------------------------------------------------------------------------------

    async def _read(self, body: bytes) -> EcapRequest:
        if len(body) <= LARGE:
            return read_request(body, self._context.limits)
        return await self._context.worker.run(partial(read_request, body, self._context.limits))

    async def _reply(self, exchange: Exchange, session: HttpSession | None, request: EcapRequest) -> CallReply:
        function_id = request.function.id
        if session is None:
            if function_id == _SERVICE_STOP:
                return _call_immediately(Session(self._context.host), request)
            detail = tr("{clients} clients are connected", clients=self._context.clients)
            return CallReply(hresult.E_MAX_CONNECT, detail=detail)
        if function_id == _SERVICE_STOP:
            reply = _call_immediately(session.session, request)
            if not hresult.failed(reply.code):
                session.end()
            return reply
        if session.at_call_limit and function_id not in _STOPPING:
            detail = tr("{calls} calls of this client are in progress", calls=CALLS)
            return CallReply(hresult.E_BUSY_PROC, detail=detail)
        if function_id == _SERVICE_START:
            return self._start(session, request)
        outcome = session.session.invoke(function_id, request.arguments)
        if type(outcome) is CallReply:
            return outcome
        assert isinstance(outcome, Pending)
        return await self._wait(exchange, session, session.start_call(outcome))

    def _start(self, session: HttpSession, request: EcapRequest) -> CallReply:
        try:
            options = read_options(request.arguments) if self._takes_start_options else ServiceOptions()
        except CallError as error:
            return CallReply(error.code, detail=error.detail)
        session.set_options(options)
        return _call_immediately(session.session, request)

    async def _wait(self, exchange: Exchange, session: HttpSession, call: RunningCall) -> CallReply:
        """Wait for the reply of a long-running call; meanwhile send keep-alive bytes if the client requested them."""
        seconds = session.invoke_timeout
        timer = asyncio.get_running_loop().call_later(seconds, _time_out, call, seconds)
        exchange.connection.on_closed = call.give_up
        if exchange.connection.is_closed:  # the client closed it while the request was read
            call.give_up()
        try:
            if exchange.interval:
                await exchange.send_keep_alives(call.reply)
            reply = await call.reply
        finally:
            timer.cancel()
            exchange.connection.on_closed = None
            if not call.task.done():  # the client does not wait any more, but the call still requires its memory
                kept = exchange.memory.hand_over()
                call.task.add_done_callback(lambda _: kept.release())
        if reply is None:
            raise _Disconnected
        return reply

    async def _answer(self, exchange: Exchange, reply: CallReply) -> None:
        code, result = self._code_replacements.get(reply.code, reply.code), reply.result
        data = None if result is None else result.value
        if isinstance(data, bytes) and 2 * len(data) > self._context.limits.packet:
            code, result = self._code_replacements.get(hresult.E_TOO_MUCH_DATA, hresult.E_TOO_MUCH_DATA), None
        body, room = b"", True
        try:
            if result is None or not is_large(result):
                body = write_reply(code, result)
            elif room := exchange.memory.set(memory_of((result,))):
                body = await self._context.worker.run(partial(write_reply, code, result))
                room = exchange.memory.set(max(exchange.memory.bytes, len(body)))
        except Exception:
            logger.exception("cannot encode a result")
            code = hresult.E_FAIL
            body = write_reply(code, None)
        if len(body) > self._context.limits.packet:
            code = self._code_replacements.get(hresult.E_TOO_MUCH_DATA, hresult.E_TOO_MUCH_DATA)
            body = write_reply(code, None)
        if not room:
            reply = CallReply(hresult.E_OUTOFMEMORY, detail=out_of_memory().detail)
            logger.info("%s: %s", exchange.connection.name, reply.detail)
            code = self._code_replacements.get(reply.code, reply.code)
            body = write_reply(code, None)
        exchange.connection.begin_response(exchange.memory)
        await exchange.answer(body, code, reply.detail)


class Exchange:
    """One request and its response.

    Args:
        scope: the ASGI scope.
        receive: the ASGI receive callable.
        send: the ASGI send callable.
        memory: the memory of the call.

    Attributes:
        scope: the ASGI scope.
        memory: the memory of the call: of its arguments, then of its result, then of the unsent response.
        headers: headers of the request; the names are in lower case.
        connection: the connection of the request.
        interval: interval of keep-alive bytes during a call, ms; 0 if the client has not requested them.
        begun: True if the response has begun.
        has_room: False if the limit on the bytes of incomplete requests does not permit the body of the request.
    """

    __slots__ = (
        "_counted",
        "_more",
        "_receive",
        "_send",
        "_whole",
        "begun",
        "connection",
        "has_room",
        "headers",
        "interval",
        "memory",
        "scope",
    )

    def __init__(self, scope: Scope, receive: Receive, send: Send, memory: CallMemory) -> None:
        self.scope = scope
        self.memory = memory
        self.headers: Headers = dict(scope["headers"])
        self.connection: LimitedProtocol = scope["state"]["connection"]
        interval = self.headers.get(_EXECUTING, b"")
        self.interval = int(interval) if interval.isdigit() and len(interval) < 6 and int(interval) in _INTERVALS else 0
        self.begun = False
        self._receive = receive
        self._send = send
        self.has_room = True
        self._counted = 0
        self._whole = False
        self._more: list[tuple[bytes, bytes]] = []

    def add(self, name: bytes, value: bytes) -> None:
        """Add a header to the response."""
        self._more.append((name, value))

    def _add_text(self, name: bytes, text: str) -> None:
        self.add(name, quote(text[:_LONGEST_DETAIL].strip(), safe=_PLAIN, errors="replace").encode())

    async def _next(self) -> bytes:
        message = await self._receive()
        if message["type"] != "http.request":
            raise _Disconnected
        self._whole = not message["more_body"]
        body: bytes = message["body"]
        return body

    def _length(self) -> int:
        return int(self.headers.get(b"content-length", b"0"))

    def give_room(self, partial: IncompleteRequests) -> None:
        """Stop counting the body of the request among the bytes of incomplete requests."""
        partial.change(self._counted, 0)
        self._counted = 0

    async def body(self, limit: int, partial: IncompleteRequests) -> bytes | None:
        """Return the body of the request, or ``None`` if it is too long or ``has_room`` is False.

        Args:
            limit: limit on the length, bytes.
            partial: the count of the bytes of incomplete requests; it includes the body until :meth:`give_room`.
        """
        if self._length() > limit:
            return None
        pieces: list[bytes] = []
        count = 0
        while not self._whole and count <= limit:
            pieces.append(await self._next())
            count += len(pieces[-1])
            self.has_room = partial.change(self._counted, count)
            self._counted = count
            if not self.has_room:
                return None
        if count > limit:
            return None
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    async def refuse(self, refusal: PlainTextResponse, limit: int) -> None:
        """Send a response that refuses the request; it contains no return code.

        The body of the request is read first and discarded, because a client that is still sending would not read the
        response. If the body is longer than 2 * ``limit``, or if the client waits for ``100 Continue``, the body is not
        read, and the connection is closed after the response.

        Args:
            refusal: the response.
            limit: half of the maximum length of a body that is read, bytes; if it is negative, no body is read.
        """
        count = 0
        reads_body = b"expect" not in self.headers and self._length() <= 2 * limit
        while reads_body and not self._whole and count <= 2 * limit:
            count += len(await self._next())
        if not self._whole or self.scope["method"] == "CONNECT":
            refusal.headers["connection"] = "close"
        self.begun = True
        await refusal(self.scope, self._receive, self._send)

    async def send_keep_alives(self, reply: asyncio.Future[CallReply | None]) -> None:
        """Send a line feed after each ``interval`` until the reply is available."""
        while True:
            await asyncio.wait((reply,), timeout=self.interval / 1000)
            if reply.done():
                return
            if not self.begun:
                await self._begin([])
            await self._send({"type": "http.response.body", "body": b"\n", "more_body": True})

    async def answer(self, body: bytes, code: int, detail: str) -> None:
        """Send a response with a return code.

        Args:
            body: the body, including the return code.
            code: the return code.
            detail: description of the error.
        """
        if not self.begun:
            if hresult.failed(code):  # curl users see the error in this header
                self._add_text(b"orinkit-error", str(error_for(code)))
            if detail:
                self._add_text(b"orinkit-detail", detail)
            await self._begin([(b"content-length", b"%d" % len(body))])
        elif detail and hresult.failed(code):
            # The header has been sent already; clients that requested keep-alive bytes read the detail after the code.
            body += b"," + detail[:_LONGEST_DETAIL].strip().encode("utf-8", "replace")
        at = 0
        while len(body) - at > _PIECE:  # one large piece would be copied several times within one turn of the loop
            await self._send({"type": "http.response.body", "body": body[at : at + _PIECE], "more_body": True})
            await asyncio.sleep(0)
            at += _PIECE
        await self._send({"type": "http.response.body", "body": body[at:]})

    async def _begin(self, headers: list[tuple[bytes, bytes]]) -> None:
        self.begun = True
        headers.append(_TEXT)
        if self.interval:
            headers.append((_EXECUTING, b"%d" % self.interval))
        headers += self._more
        message: Message = {"type": "http.response.start", "status": 200, "headers": headers}
        await self._send(message)


# --- helpers -----------------------------------------------------------------------------------------------------------


def _time_out(call: RunningCall, seconds: float) -> None:
    call.give_up(CallReply(hresult.E_TIMEOUT, detail=tr("not completed within {seconds:g} s", seconds=seconds)))


def _call_immediately(session: Session, request: EcapRequest) -> CallReply:
    """Call Service_Start or Service_Stop, which the session itself executes immediately."""
    outcome = session.invoke(request.function.id, request.arguments)
    assert isinstance(outcome, CallReply)
    return outcome
