"""Calls of CAO functions over one asynchronous connection: :class:`AsyncClient`.

The synchronous version is generated from this file; :mod:`orinkit.client._async.controller` describes how.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from random import randint
from typing import Any, Final, ParamSpec, Self, TypeVar

from orinkit.bcap.client import sign_of_life
from orinkit.bcap.profiles import DEFAULT_TRIES, STREAM
from orinkit.cao.dialect import Dialect
from orinkit.cao.functions import controller_connect, controller_get_name
from orinkit.cao.replies import Reply, Trace
from orinkit.cao.table import Function
from orinkit.cao.transport_profile import TransportProfile
from orinkit.cao.user_functions import foreign_entry
from orinkit.client._async.connection import AsyncConnection
from orinkit.client._shared.common import (
    CallRequest,
    HandleTable,
    check_deadline,
    check_timeout,
    check_tries,
    expired_handle_hint,
)
from orinkit.client._shared.connection_string import ConnectArguments, evaluate
from orinkit.client._shared.endpoint import (
    access_to,
    another,
    connection_deadline,
    conversation,
    enable_concurrent_send,
    guard,
    limit_patience,
    link_for_closing,
    opening_of,
    raw_operation,
    send_during_call,
)
from orinkit.client._shared.local_calls import local_calls
from orinkit.client._shared.prepared import PreparedFunction, directly_usable
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.core.speedups import replaced_in_c
from orinkit.rc8.motion_calls import MOVING
from orinkit.transport.aio_keepalive import AsyncKeepAlive, atry_acquire
from orinkit.transport.aio_links import open_link
from orinkit.transport.direct import Unfinished, acall_prepared
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.registry import LinkOptions
from orinkit.transport.runner import AsyncLink, Deadline, asend_close
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Value

_LAST_SERIAL: Final = 0xFFFF
_SIGN_INTERVAL: Final = 0.5  # s between signs of life
_SIGNS: Final = 4  # number of signs of life within the interval of ``Alive``
P = ParamSpec("P")
R = TypeVar("R")


class AsyncClient(AsyncConnection):
    """A connection to a controller, over which a program calls the functions of CAO directly.

    Calls are executed one at a time; several tasks may use one client. A call that is cancelled or times out leaves the
    connection usable: its reply is dropped if it arrives later.

    On UDP and serial lines, where packets may be lost, a request without a timely reply is sent again. The controller
    recognizes duplicates and executes the request once.

    Args:
        link: Link to the controller.
        timeout: Initial value of the attribute ``timeout``; the default depends on the transport.
        tries: Initial value of the attribute ``tries``.
        limits: Limits on the size of received packets and on the values in them; the limits of the transport apply,
            too.
        trace: Callback invoked for every packet, or every e-CAP body, with ``">"`` (sent) or ``"<"`` (received), and
            the bytes.
        profile: Properties of the transport.
        messages: False to refuse the message functions (:func:`connect`).
        debug: True to keep the last packets (:func:`connect`).
        charset: Encoding of text over e-CAP (:func:`connect`).

    Attributes:
        timeout: Time-out of a call in s; on UDP and serial lines, of each attempt. Each S_EXECUTING from the controller
            restarts the time-out.
        tries: Maximum number of times that a request is sent on UDP and serial lines, 1 to 7.
        profile: Properties of the transport.
        alive: Interval in s within which the server requires a sign of life of this client while its arm moves;
            ``None`` if the client has not requested this.
        deadline: Maximum duration of a call in s, regardless of S_EXECUTING; ``None`` (the default) for no limit.
        dialect: Dialect of the controller; set with :meth:`use_dialect`.
    """

    # the extension in C reads slots faster than __dict__
    __slots__ = ("__dict__", "__weakref__", "_deadline", "_direct", "_end", "_lock", "_timeout", "dialect")

    def __init__(
        self,
        link: AsyncLink,
        *,
        timeout: float | None = None,
        tries: int = DEFAULT_TRIES,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: TransportProfile = STREAM,
        messages: bool = True,
        debug: bool = False,
        charset: str = "utf-8",
    ) -> None:
        self._timeout = check_timeout(profile.timeout if timeout is None else timeout)
        self._tries = check_tries(tries)
        self._local, trace = local_calls(trace, messages=messages, debug=debug)
        super().__init__(link, conversation(profile, limits, trace, charset))
        if profile.shared:  # late replies to the previous client must not match the first requests of this client
            self._conversation.serial = randint(1, _LAST_SERIAL)  # noqa: S311 - no secret
        self._lock = asyncio.Lock()
        guard(link, self._lock)
        self._finished = False
        self._deadline: float | None = None
        self._end: Deadline | None = None  # end of connecting or closing
        self.handles = HandleTable()
        self.alive: float | None = None
        keep_from_children(self)
        self._pulse: AsyncKeepAlive | None = None
        self._idle = Deadline(0.0)  # passes if the program makes no call for half an interval
        self._sign_interval = _SIGN_INTERVAL
        self._second: AsyncClient | None = None  # sends signs of life during calls if this link cannot
        self._controller = 0
        # on these transports, the server cannot detect the end of a client without signs of life
        self._sends_signs = bool(profile.session_timeout or profile.shared)
        self._direct = directly_usable(self._conversation, link, self._local, signs=self._sends_signs)
        self.dialect: Dialect = self._conversation.dialect
        self._session_deadline = (
            Deadline(profile.session_timeout) if profile.session_timeout else None
        )  # passes when the controller may have ended the session of this client

    @property
    def timeout(self) -> float:
        """The time-out of a call in s; on UDP and serial lines, of each attempt. May be set."""
        return self._timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._timeout = check_timeout(seconds)

    @property
    def deadline(self) -> float | None:
        """The maximum duration of a call in s, regardless of S_EXECUTING; ``None`` for no limit. May be set."""
        return self._deadline

    @deadline.setter
    def deadline(self, seconds: float | None) -> None:
        self._deadline = check_deadline(seconds)

    @property
    def tries(self) -> int:
        """The maximum number of times that a request is sent on UDP and serial lines (RC8 table 5-1: TORetry).

        May be set.
        """
        return self._tries

    @tries.setter
    def tries(self, number: int) -> None:
        self._tries = check_tries(number)

    def use_dialect(self, dialect: Dialect) -> None:
        """Set the dialect of the controller."""
        self.dialect = self._conversation.dialect = dialect

    @property
    def echoes_reserved(self) -> bool:
        """True if the last reply repeated the reserved field of its request, as a VE026A does (UDP, serial lines)."""
        return self._conversation.echoes_reserved

    @property
    def profile(self) -> TransportProfile:
        """The properties of the transport that the client uses."""
        return self._conversation.profile

    @classmethod
    async def open(
        cls,
        url: str,
        *,
        timeout: float | None = None,
        tries: int = DEFAULT_TRIES,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        token: str = "",
        cafile: str = "",
        dead_after: float = DEAD_AFTER,
        deadline: float | None = None,
        messages: bool = True,
        debug: bool = False,
        charset: str = "utf-8",
    ) -> Self:
        """Open a connection without calling any function; the caller must call Service_Start.

        Args:
            url: For b-CAP, ``tcp://host:port``, ``udp://host:port`` or
                ``serial:///dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0``. The notation of DENSO is
                accepted, too: ``tcp:host:port``, ``udp:host:port`` and ``com:1:38400:N:8:1:0``. For e-CAP,
                ``http://host:port/path`` or ``https://...``. A connection string is accepted, too (:func:`connect`).
            timeout: Time-out in s for connecting and for each call; on UDP and serial lines for each attempt, so that a
                call may take ``timeout * tries``. The default is 3.0 s on TCP and HTTP, 0.5 s otherwise; long packets
                on a slow serial line need more. Only the e-CAP server of orinkit can report that a call is still
                executing; for other e-CAP servers, the time-out of a call is at least 180 s.
            tries: Maximum number of times that a request is sent on UDP and serial lines, clamped to 1 to 7
                (RC8 table 5-1: TORetry). On TCP and HTTP, requests are sent once.
            limits: Limits on the size of received packets and on the values in them. A packet has at most 503 bytes on
                UDP, and 65,536 bytes on a serial line.
            trace: Callback invoked for every packet, or every e-CAP body, with ``">"`` (sent) or ``"<"`` (received),
                and the bytes.
            token: Access token for HTTP, sent as ``Authorization: Bearer``.
            cafile: PEM file of CA certificates for verifying an https server, instead of those of the system.
            dead_after: Time in s without any reply from the controller's network stack after which a TCP connection is
                considered lost (cable pulled, power off): 2 to 7,200.
            deadline: Maximum duration of opening the connection in s; it has an effect only if it is less than the
                time-out. The deadline of calls is :attr:`AsyncClient.deadline`.
            messages: False to refuse the message functions (:func:`connect`).
            debug: True to keep the last packets (:func:`connect`).
            charset: Encoding of text over e-CAP (:func:`connect`).

        Raises:
            InvalidAddress: If the URL is invalid.
            InvalidValue: If another argument is invalid.
            ConnectFailed: If nothing listens at the address; on UDP and HTTP, the first call raises it.
            MissingExtra: If a package is not installed: serialx for serial lines, httpx2 for HTTP.
        """
        url, *_, timeout, tries, messages, debug = evaluate(
            ConnectArguments(url, timeout=timeout, tries=tries, messages=messages, debug=debug)
        )
        address, profile, seconds = opening_of(url, timeout, tries)
        seconds = min(seconds, check_deadline(deadline) or seconds)
        opening = LinkOptions(
            seconds, access_to(address, token, cafile, charset), limits.packet, check_dead_after(dead_after)
        )
        link = await open_link(address, opening)
        return cls(
            link,
            timeout=timeout,
            tries=tries,
            limits=limits,
            trace=trace,
            profile=profile,
            messages=messages,
            debug=debug,
            charset=charset,
        )

    async def call(self, function: Function[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function of CAO (:mod:`orinkit.cao.functions`) and return its result.

        Raises:
            TypeError: If the arguments do not match the function's parameters.
            InvalidValue: If an argument does not fit its type; nothing was sent.
            CallError: If the controller returned an error code.
            CallTimeout: If there was no reply in time.
            ConnectFailed: If nothing listens at the address (UDP, HTTP).
            ConnectionLost: If the connection broke.
            ProtocolError: If the reply violates the protocol.
            MessagesDisabled: If messages are disabled and the function is a message function; nothing was sent.
        """
        arguments = function.bind(args, kwargs)
        await self._lock.acquire()  # faster than "async with"
        try:
            value: R = (await self._execute(function, arguments, self._timeout))[1]
        finally:
            self._lock.release()
        return value

    async def call_prepared(self, call: PreparedFunction, value: Any = None, timeout: float | None = None) -> Any:
        """Make a call that :meth:`prepare` has prepared, and return its result.

        Args:
            call: The prepared call.
            value: The varying argument; ``None`` (VT_EMPTY) also for a call without one.
            timeout: Time-out in s, instead of :attr:`timeout`.

        Raises:
            CallError: As :meth:`call`, which also raises the other exceptions.
        """
        seconds = self._timeout if timeout is None else check_timeout(timeout)
        await self._lock.acquire()
        try:
            direct, template = self._direct, call.template
            if (
                direct is not None
                and template is not None
                and direct.direct
                and self._deadline is None
                and self._end is None
            ):
                link: Any = self._link  # of the type that directly_usable() has checked
                serial = direct.serial
                try:
                    outcome = await acall_prepared(direct, link, call.function, template, value, seconds)
                    if isinstance(outcome, Unfinished):
                        outcome = await self._resume(call.function, call.arguments(value), seconds, outcome)
                except BaseException as error:
                    self._failed_prepared(call, error, serial)
                    raise
                if outcome is not None:
                    return outcome[1]
            return (await self._execute(call.function, call.arguments(value), seconds))[1]
        except CallError as error:
            error.subject = call.subject
            raise
        finally:
            self._lock.release()

    def _failed_prepared(self, call: PreparedFunction, error: BaseException, serial: int) -> None:
        """Complete the exception of a prepared call on the direct path; close the link if it cannot be used any more."""
        if isinstance(error, CallError):
            error.subject = call.subject
        self._break_off(error, serial)

    def prepare(self, function: Function[..., Any], *constants: Any, subject: str = "") -> PreparedFunction:
        """Prepare calls of a function whose last argument alone varies, or whose arguments are all constant.

        Args:
            function: Function of CAO (:mod:`orinkit.cao.functions`).
            constants: All arguments, or all but the last one.
            subject: Name of the object whose function is called, for the messages of errors.
        """
        template = None if self._direct is None else self._direct.template(function, constants)
        varies = len(constants) < len(function.arguments)
        return PreparedFunction(function, constants, template, subject, varies=varies)

    async def request(
        self,
        function: Function[..., Any],
        *arguments: Any,
        timeout: float | None = None,
        deadline: float | None = None,
        exact: bool = False,
    ) -> Reply:
        """Call a function like :meth:`call`; return the return code, which is a success code, and the result.

        Args:
            function: Function of CAO (:mod:`orinkit.cao.functions`).
            arguments: Arguments of the function.
            timeout: Time-out in s, instead of :attr:`timeout`; on UDP and serial lines, of each attempt.
            deadline: Maximum duration of the call in s, instead of :attr:`deadline`.
            exact: True to return the result as a :class:`~orinkit.values.variant.Variant` with its type.
        """
        seconds = self.timeout if timeout is None else check_timeout(timeout)
        limit = check_deadline(deadline)
        bound = function.bind(arguments, {})
        async with self._lock:
            return Reply(*await self._execute(function, bound, seconds, exact, limit))

    async def call_user(self, number: int, *arguments: Value, timeout: float | None = None) -> Any:
        """Call a user-defined function of a device (e-CAP 3.3) and return its result.

        Args:
            number: Number of the function: from 256, over e-CAP from 255.
            arguments: Up to five arguments. Over e-CAP, text and numbers are sent without a type, as its document
                requires; a :class:`~orinkit.values.variant.Variant` is sent with its type.
            timeout: Time-out in s, instead of :attr:`timeout`.

        Raises:
            InvalidValue: If the number or the arguments are not valid.
            CallError: If the device returned an error code; E_NOTIMPL if it has no such function.
        """
        return (await self.request(foreign_entry(number, len(arguments)), *arguments, timeout=timeout)).value

    async def send_raw(self, data: bytes, *, timeout: float | None = None) -> bytes | None:
        """Send bytes unchanged on this connection, and return the packet received in reply.

        Args:
            data: The bytes, usually a b-CAP packet. They are sent once. If a serial number is in them, the packet with
                the same serial is the reply.
            timeout: Time-out in s, instead of :attr:`timeout`.

        Returns:
            The packet, or ``None`` if there is none in time.

        Raises:
            InvalidValue: If the connection uses e-CAP.
            ConnectionLost: If the connection broke.
            ProtocolError: If the reply is not b-CAP.
        """
        seconds = self.timeout if timeout is None else check_timeout(timeout)
        operation = raw_operation(self._conversation, data, seconds)
        async with self._lock:
            return await self._run(operation)

    def set_overall_deadline(self, seconds: float | None) -> None:
        """Set the time in s after which all further calls together must have ended; ``None`` removes this deadline."""
        self._end = None if seconds is None else Deadline(seconds)

    def connection_deadline(self) -> float:
        """Return the default deadline in s for connecting and for closing."""
        return connection_deadline(self._timeout, self._tries, self.profile)

    async def _execute(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool = False,
        deadline: float | None = None,
    ) -> tuple[int, Any]:
        direct = self._direct
        if direct is not None and direct.direct and deadline is None and self._deadline is None and self._end is None:
            return await self._call_directly(direct, function, arguments, seconds, exact)
        if self._local is not None:
            local = self._local.reply(function, arguments, exact)
            if local is not None:
                return local
        deadline = self._deadline if deadline is None else deadline
        if self._end is not None:
            deadline = min(self._end.left, self._end.left if deadline is None else deadline)
        call = CallRequest(function, arguments, seconds, exact, deadline)
        if self._sends_signs:
            return await self._execute_with_signs(call)
        return await self._execute_now(call)

    async def start_keep_alive(self, seconds: float, controller: int) -> None:
        """Start sending signs of life, also during calls: at least three per interval.

        Call this once, after Controller_Connect. On UDP and serial lines, repeated requests are the signs of life
        during a call, so :attr:`timeout` is limited to a quarter of the interval.

        Args:
            seconds: Interval in s that was passed to the server (``Alive=<ms>``).
            controller: Handle of the controller.
        """
        self.alive = seconds
        self._direct = None
        self._sends_signs, self._sign_interval, self._controller = True, seconds / _SIGNS, controller
        if self.profile.lossy:
            self._timeout = min(self._timeout, seconds / _SIGNS)
        enable_concurrent_send(self._link)
        link = another(self._link)
        if link is not None:
            self._second = type(self)(link, timeout=self._timeout, profile=self.profile)
        if self._pulse is not None:
            self._pulse.end()
        self._pulse = AsyncKeepAlive(self._send_sign, self._sign_interval)

    async def _send_sign(self) -> None:
        """Send a sign of life.

        If no call of this client is executing and the program has made none recently, the sign of life is a call. While
        a call is executing, the sign of life is a message on this link or, if the link cannot send during a call, a
        call over a second link. On UDP and serial lines, nothing is sent during a call, because repeated requests are
        the signs of life.
        """
        if await atry_acquire(self._lock):
            try:
                if self._idle.passed and not self._finished:
                    await self._get_name()
            finally:
                self._lock.release()
        elif self._second is not None:
            await self._second.call(controller_get_name, self._controller)
        elif not self.profile.lossy:
            send_during_call(self._link, sign_of_life(self._controller))

    async def _execute_with_signs(self, call: CallRequest) -> tuple[int, Any]:
        """Execute a call. Before the first call that may start a motion, start to send signs of life."""
        if call.function.id in MOVING and self._pulse is None and not self._finished:
            self._pulse = AsyncKeepAlive(self._keep_alive, _SIGN_INTERVAL)
        try:
            code, result = await self._execute_remembered(call)
        finally:
            self._idle = Deadline(self._sign_interval / 2)
        if call.function is controller_connect:
            self._controller = result.value if call.exact else result
        return code, result

    async def _keep_alive(self) -> None:
        """Request the controller's name, unless the program has just made a call.

        On a transport without connections, a server stops the arm of a client that sends no requests.
        """
        async with self._lock:
            if self._idle.passed and not self._finished:
                await self._get_name()

    async def _get_name(self) -> None:
        """Request the controller's name, as a sign of life."""
        await self._execute_remembered(CallRequest(controller_get_name, (self._controller,), self._timeout))

    async def _execute_remembered(self, call: CallRequest) -> tuple[int, Any]:
        """Execute a call. If it fails with E_HANDLE after a long idle period, add a hint to the error.

        After such a period, the server may have ended the session and released all its objects.
        """
        forgotten = self._session_deadline is not None and self._session_deadline.passed
        try:
            return await self._execute_now(call)
        except CallError as error:
            if forgotten and error.code == hresult.E_HANDLE:
                error.detail = expired_handle_hint(self.profile)
            raise
        finally:
            if self._session_deadline is not None:
                self._session_deadline = Deadline(self.profile.session_timeout)

    async def _execute_now(self, call: CallRequest) -> tuple[int, Any]:
        if call.deadline is not None:
            limit_patience(self._link, call.deadline)
        operation = self._conversation.call(
            call.function,
            call.arguments,
            call.seconds,
            exact=call.exact,
            tries=self._tries,
            deadline=call.deadline,
        )
        return await self._run(operation)

    def command_timeout(self, command: str) -> float | None:
        """Return the time-out of each attempt, in s, for a command that takes long; ``None`` for any other command."""
        longest = self.dialect.command_timeouts.get(str(command).strip().lower())
        if longest is None:
            return None
        return max(self._timeout, longest / self._tries if self.profile.lossy else longest)

    def after_fork_in_child(self) -> Iterable[int]:
        """Disable the client in a forked child process.

        The lock is replaced, because the thread that may hold it does not exist in the child process. The result is
        empty: the link returns its own file descriptors.
        """
        self._lock = asyncio.Lock()
        self._finished, self._pulse = True, None
        return ()

    async def close(self) -> None:
        """Close the connection immediately; the controller then releases all objects of the connection.

        On UDP and serial lines, Service_Stop is sent first, without waiting for a reply. On HTTP, Service_Stop is sent,
        too; the wait for its reply is limited to 1 s.
        """
        link = self._link
        if self._pulse is not None:
            self._pulse.end()
        second, self._second = self._second, None
        if second is not None:
            second._finished = True
            await second.close()
        try:
            packets = [] if self._finished else self._conversation.close_sequence()
            self._finished = True
            if packets:
                link = link_for_closing(link)
            await asend_close(link, packets)
        finally:  # close the links even if this is cancelled or interrupted
            link.close()
            self._link.close()


call_prepared_by_client = replaced_in_c(AsyncClient.call_prepared, "call_prepared_by_client")
"""The function that objects call; the extension in C replaces it in the synchronous client."""
