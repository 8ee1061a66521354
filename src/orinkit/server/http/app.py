"""The ASGI application for e-CAP: checks a request, calls the function, and sends the response.

The reply of a function always has status 200 and a return code in its body. Any other status means that no function was
called.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from typing import Final, TypeAlias

from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from orinkit.bcap.server import LARGE
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.quota import STORING_METHODS
from orinkit.cao.service_options import ServiceOptions, read_options
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.ecap.message import EcapRequest, own_code, read_request, write_reply
from orinkit.rc8.stopping import is_stop
from orinkit.server.capacity import CallMemory
from orinkit.server.context import ServerContext
from orinkit.server.http.access import (
    AccessCheck,
    ambiguous,
    closed,
    cors_headers,
    is_proxied,
    plain,
    too_long,
    too_many_guesses,
    too_many_request_bytes,
)
from orinkit.server.http.exchange import EXECUTING, Disconnected, Exchange
from orinkit.server.http.json_text import is_view
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.sessions import CALLS, HttpSession, HttpSessions, RunningCall
from orinkit.server.http.variables import VariableViews
from orinkit.server.large_values import is_large, memory_of, out_of_memory
from orinkit.server.log_limiter import CLIENT
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import Variant, unwrapped

logger = logging.getLogger("orinkit.server")

_SERVICE_START: Final = 1
_SERVICE_STOP: Final = 2
_CONNECT: Final = 3
_WITHOUT_HANDLE: Final = (_SERVICE_START, _SERVICE_STOP, _CONNECT)
_REFUSED: Final = 400
_NO_TOKEN: Final = 401
_HELD: Final = 32  # maximum number of delayed replies to wrong tokens of one address
_SUSPICIOUS: Final = (_NO_TOKEN, 403, 421, 429)
_DO_NOT_READ: Final = -1  # a limit for Exchange.refuse: the body is not read before the refusal
_BYTE: Final = 3e-7  # s to decode a byte of the slowest values

_Read: TypeAlias = EcapRequest | CallReply


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
        self._views = VariableViews(context)
        self._cookie = b""
        self._strict = context.host.dialect.strict
        self._takes_start_options = context.host.dialect.takes_start_options
        self._code_replacements = context.host.dialect.code_replacements
        self._unwraps = context.host.unwraps_variants
        self._user_functions = {number: user for number, (_, user) in context.host.user_functions.items()}

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
            self._allow_origin(exchange)
            refusal = self._refusal(scope["method"], exchange)
            if refusal is None:
                refusal = await self._serve(exchange)
            if refusal is not None:
                if refusal.status_code >= _REFUSED:
                    self._log(exchange, refusal.status_code)
                if refusal.status_code == _NO_TOKEN:
                    await self._slow_down(exchange)
                await exchange.refuse(refusal, self._context.limits.packet if exchange.has_room else _DO_NOT_READ)
        except Disconnected:
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
        return self._access.refusal(method, exchange.headers, reads=is_view(exchange.path))

    def _allow_origin(self, exchange: Exchange) -> None:
        """Add the headers for a page of an allowed origin to the response."""
        origin = self._access.allowed_origin(exchange.headers)
        if origin:
            for name, value in cors_headers(origin).items():
                exchange.add(name.lower().encode(), value.encode("latin-1"))

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
        if is_view(exchange.path):
            await self._views.answer(exchange)
            return None
        key = self._key(exchange.headers.get(b"cookie", b""))
        session = self._sessions.by_key(key) if key else None
        if session is not None:
            self._enter(session, exchange)
        exchange.use_charset(self._access.charset(exchange.headers))
        context, connection = self._context, exchange.connection
        limits = context.first_limits
        if context.requires_secret and session is not None and session.holds_objects:
            limits = context.limits
        try:
            try:
                body = await exchange.body(limits.packet, context.partial)
                if body is None:
                    return too_long(limits.packet) if exchange.has_room else too_many_request_bytes()
                read: Callable[[], _Read] = partial(self._read, body, limits, exchange.charset)
                if len(body) > LARGE:
                    request, memory = await context.worker.run(partial(_measured, read, len(body)))
                    read = partial(_same, request if exchange.memory.set(memory) else _refused())
            finally:  # the body counts until the worker has decoded it
                exchange.give_room(context.partial)
            outcome = await connection.run(partial(self._begin, exchange, key, read), _BYTE * min(len(body), LARGE))
            if isinstance(outcome, RunningCall):
                outcome = await self._wait(exchange, outcome)
            await self._answer(exchange, outcome)
        finally:
            exchange.memory.release()
            if exchange.session is not None:
                exchange.session.end_request(broken=connection.is_closed)
        return None

    def _enter(self, session: HttpSession, exchange: Exchange) -> None:
        connection = exchange.connection
        given = exchange.headers
        exchange.session = session
        session.begin_request(connection, proxied=is_proxied(given), sends_signs=EXECUTING in given)
        connection.carried.add(session)

    def _read(self, body: bytes, limits: PacketLimits, charset: str) -> _Read:
        """Return the request in a body, or the reply to an invalid body."""
        try:
            request = read_request(body, limits, charset, self._user_functions)
            if self._unwraps and request.function.method not in STORING_METHODS:
                return EcapRequest(request.function, [unwrapped(each) for each in request.arguments])
        except CallError as error:
            return CallReply(error.code, detail=error.detail)
        return request

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
        if EXECUTING in exchange.headers and function_id in _WITHOUT_HANDLE:  # a client of orinkit
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

    def _begin(self, exchange: Exchange, key: str, read: Callable[[], _Read]) -> CallReply | RunningCall:
        """Read a request, find its session, and begin the call; return the reply, or the call if it takes longer."""
        request = read()
        if isinstance(request, CallReply):
            return request
        session = exchange.session
        if session is None or session.ended:  # the session may have ended while the body was read
            session = self._find(exchange, request.function.id, keeps_cookies=bool(key))
            if session is not None:
                self._enter(session, exchange)
        if key and request.function.id == _SERVICE_STOP:
            exchange.add(b"set-cookie", self._set_cookie("", b"; Max-Age=0"))
        return self._call(session, request)

    def _call(self, session: HttpSession | None, request: EcapRequest) -> CallReply | RunningCall:
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
        if session.at_call_limit and not is_stop(function_id, request.arguments):
            detail = tr("{calls} calls of this client are in progress", calls=CALLS)
            return CallReply(hresult.E_BUSY_PROC, detail=detail)
        if function_id == _SERVICE_START:
            return self._start(session, request)
        outcome = session.session.invoke(function_id, request.arguments)
        return session.start_call(outcome) if isinstance(outcome, Pending) else outcome

    def _start(self, session: HttpSession, request: EcapRequest) -> CallReply:
        try:
            options = (
                read_options(request.arguments, strict=self._strict) if self._takes_start_options else ServiceOptions()
            )
        except CallError as error:
            return CallReply(own_code(error.code), detail=error.detail)
        session.set_options(options)
        return _call_immediately(session.session, request)

    async def _wait(self, exchange: Exchange, call: RunningCall) -> CallReply:
        """Wait for the reply of a long-running call; meanwhile send keep-alive bytes if the client requested them."""
        assert exchange.session is not None
        seconds = exchange.session.invoke_timeout
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
            raise Disconnected
        return reply

    async def _answer(self, exchange: Exchange, reply: CallReply) -> None:
        code, detail = reply.code, reply.detail
        try:
            body = await self._encode(exchange, self._replaced(code), reply.result)
        except CallError as error:
            logger.info("%s: %s", exchange.connection.name, error)
            code, detail = error.code, error.detail
            body = write_reply(self._replaced(code), None)
        except Exception:
            logger.exception("cannot encode a result")
            code = hresult.E_FAIL
            body = write_reply(code, None)
        exchange.connection.begin_response(exchange.memory)
        await exchange.answer(body, self._replaced(code), detail)

    def _replaced(self, code: int) -> int:
        return self._code_replacements.get(code, code)

    async def _encode(self, exchange: Exchange, code: int, result: Variant | None) -> bytes:
        """Return the body of a response.

        Raises:
            CallError: E_TOO_MUCH_DATA if the body would be longer than a packet; E_OUTOFMEMORY if calls and replies
                require too much memory.
        """
        charset = exchange.charset
        if result is None:
            return write_reply(code, None)
        longest = self._context.limits.packet
        if isinstance(result.value, bytes) and 2 * len(result.value) > longest:
            raise error_for(hresult.E_TOO_MUCH_DATA)
        write = partial(write_reply, code, result, charset)
        if is_large(result):
            if not exchange.memory.set(memory_of((result,))):
                raise out_of_memory()
            body = await self._context.worker.run(write)
            if not exchange.memory.set(max(exchange.memory.bytes, len(body))):
                raise out_of_memory()
        else:
            body = await exchange.connection.run(write) if isinstance(result.value, list) else write()
        if len(body) > longest:
            raise error_for(hresult.E_TOO_MUCH_DATA)
        return body


# --- helpers -----------------------------------------------------------------------------------------------------------


def _measured(read: Callable[[], _Read], size: int) -> tuple[_Read, int]:
    """Return a large request, or the reply to it, and the memory that it requires, bytes."""
    request = read()
    return request, 0 if isinstance(request, CallReply) else max(memory_of(request.arguments), size)


def _refused() -> CallReply:
    """Return the reply to a request if calls and replies require too much memory."""
    error = out_of_memory()
    return CallReply(error.code, detail=error.detail)


def _same(request: _Read) -> _Read:
    return request


def _time_out(call: RunningCall, seconds: float) -> None:
    call.give_up(CallReply(hresult.E_TIMEOUT, detail=tr("not completed within {seconds:g} s", seconds=seconds)))


def _call_immediately(session: Session, request: EcapRequest) -> CallReply:
    """Call Service_Start or Service_Stop, which the session itself executes immediately."""
    outcome = session.invoke(request.function.id, request.arguments)
    assert isinstance(outcome, CallReply)
    return outcome
