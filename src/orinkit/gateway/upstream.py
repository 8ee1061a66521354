"""The side of a gateway that calls: where a controller is, and one client's connection to it.

An error code of the controller goes to the client as it is. What goes wrong on the way there has codes of its own:

* E_CAO_REMOTE_PROVIDER (0x80000209): it cannot be reached, or has forgotten the client; the call was not carried out.
* E_NOT_CONNECTED (0x80000902): the connection was lost while the call was under way; whether it was carried out is
  not known. It is never repeated.
* E_TIMEOUT (0x80000900): no answer in time; not known either.
* E_INVALIDARG: an argument cannot travel there, such as one that is too long for UDP; the call was not sent.
* E_TOO_MUCH_DATA, E_FAIL: the call was answered, but the answer is beyond the limits, or cannot be read.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao import functions as f
from orinkit.cao.dialect import DIALECTS, Dialect
from orinkit.cao.replies import Reply
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient
from orinkit.client._shared.common import dialect_of, service_option
from orinkit.client._shared.endpoint import access_to, opening_of
from orinkit.core import hresult
from orinkit.core.errors import (
    CallError,
    CallTimeout,
    ConnectionClosed,
    ConnectionLost,
    InvalidValue,
    LimitExceeded,
    OrinError,
    ProtocolError,
    TransportError,
    error_for,
)
from orinkit.core.i18n import tr
from orinkit.rc8.motion_calls import leaves_moving
from orinkit.transport.registry import resolve, row_of
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.pose_numbers import brief

logger = logging.getLogger("orinkit.gateway")

LOCAL: Final = "localhost"
"""The machine name that clients give who name none (RC8 3.1.2)."""

_SLOWEST: Final = 10  # the longest time between two attempts, as a multiple of the first
_GOODBYE: Final = 1.0  # s that Service_Stop may take
_SILENT: Final = 2  # calls without any answer, one after the other, after which a connection counts as dead
_SIGNS: Final = 3  # signs of life in the time after which a controller forgets a client
_MOST_SECONDS: Final = 1e6


class ConnectRequest(NamedTuple):
    """The arguments of a client's Controller_Connect."""

    name: str
    provider: str
    machine: str
    option: str


@dataclass(frozen=True, slots=True)
class Upstream:
    """Where a controller is, and how it is called.

    Attributes:
        url: ``tcp://192.168.0.1:5007``, ``udp://...``, ``serial:///dev/ttyUSB0?baudrate=38400``, ``http://...``.
        timeout: seconds that a call waits for its answer, on UDP and serial lines in each try; by default what is usual
            there. S_EXECUTING from the controller starts it anew.
        tries: how often a request is sent in all on UDP and serial lines, 1 to 7.
        service: option of Service_Start; by default as :func:`orinkit.connect` has it.
        dialect: ``"rc8"`` or ``"ve026a"``.
        machine: machine name that the controller is told; by default that of the client's Controller_Connect, or
            ``localhost`` where that was the name by which the gateway chose this upstream.
        token: for HTTP, what lets a client in.
        cafile: for https, certificates (PEM) that the server's is to be signed by.
        retry: least seconds between two attempts to connect; after each that fails twice as many, up to ten times.
        keep_alive: seconds of silence after which a harmless call (Controller_GetName) is made, so that the controller
            does not forget a client that is still there; 0 for never. By default a third of what the wire allows (UDP,
            HTTP), never with TCP and on serial lines.
        dead_after: seconds without an answer from the controller's machine after which a TCP connection counts as lost:
            2 to 7,200.
        limits: bounds on what is received.

    Raises:
        InvalidAddress: the URL cannot be used.
        InvalidValue: another value cannot be used.
        MissingExtra: HTTP needs httpx2.
    """

    url: str
    timeout: float | None = None
    tries: int = DEFAULT_TRIES
    service: str | None = None
    dialect: str = "rc8"
    machine: str = ""
    token: str = field(default="", repr=False)
    cafile: str = ""
    retry: float = 0.5
    keep_alive: float | None = None
    dead_after: float = DEAD_AFTER
    limits: PacketLimits = DEFAULT_LIMITS

    def __post_init__(self) -> None:
        address, _, _ = opening_of(self.url, self.timeout, self.tries)
        access_to(address, self.token, self.cafile)
        resolve(row_of(address).aio_link)  # importing HTTP takes long; later other clients would wait for it
        dialect_of(self.dialect, self.url)
        _check_seconds("retry", self.retry)
        check_dead_after(self.dead_after)
        if self.keep_alive is not None:
            _check_seconds("keep_alive", self.keep_alive)

    @property
    def spoken(self) -> Dialect:
        """The dialect itself."""
        return DIALECTS[self.dialect.lower()]

    @property
    def places(self) -> tuple[str, ...]:
        """What a machine name may be that means this controller: host, and host with port; none on a serial line."""
        address, _, _ = opening_of(self.url, self.timeout, self.tries)
        host, port = getattr(address, "host", "").lower(), getattr(address, "port", 0)
        if not host:
            return ()
        if ":" in host:
            return host, f"[{host}]", f"{host}:{port}", f"[{host}]:{port}"
        return (f"{host}:{port}",) if host == LOCAL else (host, f"{host}:{port}")  # every client says localhost

    async def open(self, wanted: ConnectRequest) -> tuple[AsyncClient, int]:
        """Connect for one client: Service_Start, Controller_Connect; returns the connection and the handle.

        Raises:
            OrinError: as :func:`orinkit.connect`.
        """
        client = await AsyncClient.open(
            self.url,
            timeout=self.timeout,
            tries=self.tries,
            limits=self.limits,
            token=self.token,
            cafile=self.cafile,
            dead_after=self.dead_after,
        )
        try:
            client.dialect = self.spoken
            option = service_option(self.service, client.profile, client.dialect, client.timeout)
            await client.call(f.service_start, option)
            handle = await client.call(f.controller_connect, *wanted)
        except BaseException:
            await client.close()
            raise
        return client, handle


class UpstreamConnection:
    """One client's connection to a controller: opened anew by the next call after it was lost.

    Everything happens in one event loop. Who calls takes :attr:`turn` first, then :meth:`ready`, then :meth:`ask`, as
    often as is needed; a connection carries one call at a time.

    Args:
        upstream: the controller.
        wanted: what the client said with Controller_Connect.
        ended: is called when it has been closed.

    Attributes:
        turn: is held by who calls.
        generation: how often it has been opened; handles of an earlier generation mean nothing any more.
        handle: of the controller object, in this generation.
        url: of the controller, for people.
        may_move: whether a motion that was passed on may still run.
    """

    def __init__(self, upstream: Upstream, wanted: ConnectRequest, ended: Callable[[UpstreamConnection], None]) -> None:
        self.turn = asyncio.Lock()
        self.generation = 0
        self.handle = 0
        self.url = upstream.url
        self._upstream = upstream
        self._wanted = wanted
        self._ended = ended
        self._loop = asyncio.get_running_loop()
        self._client: AsyncClient | None = None
        self._closed = False
        self._lossy = False  # nobody there now does not say that nobody was when it was sent first
        self.may_move = False
        self._at_work = False  # a call has been sent, and neither was answered nor has its time passed
        self._silent = 0
        self._heard = 0.0
        self._next_try = -math.inf
        self._delay = upstream.retry
        self._refusal: tuple[int, str] = (hresult.E_CAO_REMOTE_PROVIDER, "")
        self._released: deque[tuple[Function[[int], None], int]] = deque()
        self._alarm: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    # --- calls: for who has the turn ------------------------------------------------------------------------------

    async def ready(self) -> None:
        """Connect if it is not connected, and send what was released before.

        Raises:
            CallError: it cannot be connected; nothing was sent.
        """
        if self._closed:
            raise _gone(self.url)
        if self._client is None:
            await self._open()
        try:
            await self._let_go()
        except OrinError:
            raise error_for(*self._refusal) from None

    async def ask(self, function: Function[..., Any], handle: int, *arguments: Any) -> Reply:
        """Make one call; returns the return code, and the result with its exact type.

        Raises:
            CallError: the controller's error code, or one of those of the module's docstring.
        """
        after = leaves_moving(function, arguments)
        if after is not None:
            self.may_move = True
        try:
            reply = await self._exchange(function, handle, *arguments)
        except CallError:
            raise
        except OrinError as error:
            raise self._failure(function, error) from error
        if after is not None:
            self.may_move = after
        return reply

    def hold(self, release: Function[[int], None], handle: int) -> None:
        """One more object has this handle: controllers may give several the same."""
        if self._client is not None:
            self._client.handles.hold(release, handle)

    # --- for anybody ----------------------------------------------------------------------------------------------

    def release(self, release: Function[[int], None], handle: int, generation: int) -> None:
        """Release an object of the controller in the background, ahead of what is called from now on."""
        if self._closed or self._client is None or generation != self.generation:
            return
        if self._client.handles.is_last(release, handle):
            self._released.append((release, handle))
            if len(self._released) == 1:
                self._spawn(self._send_releases())

    def close(self) -> None:
        """End it in the background: Service_Stop, with which the controller releases everything, then close.

        Where a call is under way the end of the connection has to say the same, as a controller takes no second call.
        """
        if not self._closed:
            self._closed = True
            self._released.clear()
            self._stop_alarm()
            self._spawn(self._part())

    def give_up(self) -> None:
        """Close the connection to the controller in the background; the next call opens another one."""
        self._spawn(self._lose(ConnectionClosed(tr("its client is silent"))))

    async def ended(self) -> None:
        """Wait until it has been closed, if it is being closed, in this event loop; not for long."""
        if self._closed and self._tasks and self._loop is asyncio.get_running_loop():
            await asyncio.wait(self._tasks, timeout=2 * _GOODBYE)

    # --- inside ---------------------------------------------------------------------------------------------------

    async def _open(self) -> None:
        if self._loop.time() < self._next_try:
            raise error_for(*self._refusal)
        try:
            client, self.handle = await self._upstream.open(self._wanted)
        except OrinError as error:
            self._refusal = _refusal(self.url, error)
            logger.warning("%s: %s", self.url, error)
            self._next_try = self._loop.time() + self._delay
            self._delay = min(2 * self._delay, _SLOWEST * self._upstream.retry)
            raise error_for(*self._refusal) from error
        if self._closed:
            await client.close()
            raise _gone(self.url)
        logger.info("%s: connected%s", self.url, " again" if self.generation else "")
        self._client = client
        self._lossy = client.profile.lossy
        self.generation += 1
        self._delay = self._upstream.retry
        self._next_try = self._loop.time() + self._delay
        self._answered()
        self._stay(client)

    async def _exchange(self, function: Function[..., Any], handle: int, *arguments: Any) -> Reply:
        client = self._client
        if client is None:
            raise ConnectionClosed(self.url)
        patience = client.patience(arguments[0]) if function.method == "execute" and arguments else None
        self._at_work = True  # and it stays so where this is cancelled: the controller is still at it
        try:
            reply = await client.request(function, handle, *arguments, timeout=patience, exact=True)
        except CallError as error:
            self._answered()
            if error.code == hresult.E_HANDLE and await self._is_forgotten(client):
                await self._lose(error)
                raise error_for(hresult.E_CAO_REMOTE_PROVIDER, _forgotten(self.url)) from error
            raise
        except CallTimeout as error:
            self._at_work = False
            self._silent += 1
            if self._silent >= _SILENT:
                await self._lose(error)
            raise
        except OrinError as error:
            self._at_work = False
            if isinstance(error, TransportError) or (isinstance(error, ProtocolError) and error.fatal):
                await self._lose(error)
            raise
        self._answered()
        return reply

    async def _is_forgotten(self, client: AsyncClient) -> bool:
        """Whether the controller has forgotten this client, of which only its handles tell: restarted, or silent too long."""
        if not (client.profile.memory or client.profile.shared):
            return False
        try:
            await client.call(f.controller_get_name, self.handle)
        except CallError as error:
            return error.code == hresult.E_HANDLE
        return False

    def _answered(self) -> None:
        self._at_work = False
        self._silent = 0
        self._heard = self._loop.time()

    async def _lose(self, error: OrinError) -> None:
        """The connection is not there any more."""
        client, self._client = self._client, None
        self.may_move = False
        self._released.clear()
        self._stop_alarm()
        self._refusal = _refusal(self.url, error)
        if client is not None:
            if not self._closed:
                logger.warning("%s: the connection is lost: %s", self.url, error)
            await client.close()

    def _failure(self, function: Function[..., Any], error: OrinError) -> CallError:
        """Return what a client is told of a call that went wrong on the way."""
        if isinstance(error, ConnectionClosed) and self._closed:
            return _gone(self.url)
        if isinstance(error, InvalidValue):
            return error_for(hresult.E_INVALIDARG, _never_sent(self.url, error))
        if (
            isinstance(error, TransportError)
            and not isinstance(error, ConnectionLost | ConnectionClosed)
            and not self._lossy
        ):
            return error_for(hresult.E_CAO_REMOTE_PROVIDER, _never_sent(self.url, error))
        if isinstance(error, ProtocolError) and not error.fatal:
            code = hresult.E_TOO_MUCH_DATA if isinstance(error, LimitExceeded) else hresult.E_FAIL
            return error_for(code, f"{self.url}: {error}")
        code = hresult.E_TIMEOUT if isinstance(error, CallTimeout) else hresult.E_NOT_CONNECTED
        return error_for(code, _under_way(self.url, function, error))

    async def _let_go(self) -> None:
        while self._released:
            release, handle = self._released[0]
            try:
                await self._exchange(release, handle)
            except OrinError as error:
                logger.debug("%s: %s", self.url, error)
                if self._client is None:
                    raise
            if self._released:  # those of a connection that is lost are forgotten
                self._released.popleft()

    async def _send_releases(self) -> None:
        async with self.turn:
            try:
                await self._let_go()
            except OrinError as error:
                logger.debug("%s: %s", self.url, error)

    # --- its end --------------------------------------------------------------------------------------------------

    async def _part(self) -> None:
        client = self._client
        if client is not None:
            if not self._at_work:
                await self._say_stop(client)
            await client.close()  # says Service_Stop by itself where the end of a connection does not tell
            self._client = None
        self._ended(self)

    async def _say_stop(self, client: AsyncClient) -> None:
        try:
            async with asyncio.timeout(_GOODBYE), self.turn:
                await client.call(f.service_stop)
        except (OrinError, TimeoutError) as error:
            logger.debug("%s: %s", self.url, error)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # --- signs of life --------------------------------------------------------------------------------------------

    def _stay(self, client: AsyncClient) -> None:
        wanted = self._upstream.keep_alive
        every = client.profile.memory / _SIGNS if wanted is None else wanted
        if every:
            self._alarm = self._loop.call_later(every, self._look, every)

    def _look(self, every: float) -> None:
        if self._loop.time() - self._heard >= every / 2 and not self.turn.locked():
            self._spawn(self._make_sign())
        self._alarm = self._loop.call_later(every, self._look, every)

    async def _make_sign(self) -> None:
        async with self.turn:
            try:
                await self._exchange(f.controller_get_name, self.handle)
            except OrinError as error:  # whatever it answers, it has heard of this client
                logger.debug("%s: %s", self.url, error)

    def _stop_alarm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None


def _check_seconds(name: str, seconds: float) -> None:
    given: object = seconds
    if not isinstance(given, int | float) or not 0 <= given <= _MOST_SECONDS:
        raise InvalidValue(
            tr(
                "{name} must be a number of seconds from 0 to {most_seconds:.0e}, not {seconds}",
                name=name,
                most_seconds=_MOST_SECONDS,
                seconds=brief(seconds),
            )
        )


def _refusal(url: str, error: OrinError) -> tuple[int, str]:
    """Return code and detail for calls that are not sent, because there is no connection."""
    if isinstance(error, CallError) and error.code != hresult.E_HANDLE:  # the controller itself refuses
        return error.code, error.detail
    return hresult.E_CAO_REMOTE_PROVIDER, _never_sent(url, error)


def _never_sent(url: str, error: OrinError) -> str:
    return tr("gateway to {url}: {error}. The call was not sent", url=url, error=error)


def _forgotten(url: str) -> str:
    return tr(
        "gateway to {url}: the controller has forgotten this client, as after a restart. The "
        "call was not carried out; the next one connects again",
        url=url,
    )


def _under_way(url: str, function: Function[..., Any], error: OrinError) -> str:
    return tr(
        "gateway to {url}: {error}. Whether {name} was carried out is not known, and it is not "
        "repeated. After a lost connection the next call connects again; the arm is not taken "
        "again",
        url=url,
        error=error,
        name=function.name,
    )


def _gone(url: str) -> CallError:
    return error_for(
        hresult.E_ABORT,
        tr("gateway to {url}: the client has gone", url=url),
    )
