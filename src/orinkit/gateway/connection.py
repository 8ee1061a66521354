"""The connection from a gateway to a controller for one client.

Error codes of the controller are returned to the client unchanged. Errors between gateway and controller have these
codes:

* E_CAO_REMOTE_PROVIDER (0x80000209): the controller is unreachable, or it has deleted the client's handles, for example
  because of a restart. The call was not executed.
* E_NOT_CONNECTED (0x80000902): the connection was lost during the call. The call may or may not have been executed; it
  is never repeated.
* E_TIMEOUT (0x80000900): the controller did not reply in time. The call may or may not have been executed. After a call
  with more than 64 KiB, the connection is closed, because it may contain unsent data of the call.
* E_INVALIDARG: an argument cannot be sent to the controller, for example because it is too long for UDP. The call was
  not sent.
* E_TOO_MUCH_DATA, E_FAIL: the call was executed, but the reply exceeds the limits (E_TOO_MUCH_DATA) or is invalid
  (E_FAIL).
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.replies import Reply
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient
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
from orinkit.gateway.moving_arms import MovingArms
from orinkit.gateway.upstream import ConnectRequest, Upstream
from orinkit.server.capacity import ALWAYS
from orinkit.server.large_values import memory_of
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.gateway")

_MAX_DELAY: Final = 10  # maximum delay between two attempts to connect, as a multiple of Upstream.retry
_CLOSE_TIMEOUT: Final = 1.0  # s; time-out of Service_Stop
_MAX_TIMEOUTS: Final = 2  # number of successive calls without a reply after which a connection is considered lost
_SIGNS: Final = 3  # number of keep-alives within the time after which a controller ends an idle session


class UpstreamConnection:
    """The connection from the gateway to a controller for one client. If it is lost, the next call opens it again.

    The connection belongs to one event loop and carries one call at a time. A caller acquires :attr:`turn`, calls
    :meth:`ensure_connected` once, and then :meth:`request` as often as required.

    Args:
        upstream: Address of the controller.
        wanted: Arguments of the client's Controller_Connect.
        ended: Callback invoked with this object after :meth:`close` has closed the connection.

    Attributes:
        turn: Lock that serializes calls.
        generation: Number of times that the connection has been opened; handles of earlier generations are invalid.
        handle: Handle of the controller object, which is valid until the connection is opened again.
        url: URL of the controller, for messages.
        moving: The arms that may still execute a motion that was forwarded for this client.
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
        self._lossy = False  # True if an earlier attempt may have arrived although a later one raised ConnectFailed
        self.moving = MovingArms()
        self._executing = False  # True after a call was sent, until its reply or its time-out
        self._timeouts = 0
        self._last_reply = 0.0
        self._next_try = -math.inf
        self._delay = upstream.retry
        self._refusal: tuple[int, str] = (hresult.E_CAO_REMOTE_PROVIDER, "")
        self._released: deque[tuple[Function[[int], None], int]] = deque()
        self._keep_alive_timer: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    # --- calls; the caller holds ``turn`` -------------------------------------------------------------------------

    async def ensure_connected(self) -> None:
        """Connect to the controller if necessary, and send the pending calls that release objects.

        Raises:
            CallError: If there is no connection and none can be opened. The client's call was not sent.
        """
        if self._closed:
            raise _disconnected(self.url)
        if self._client is None:
            await self._open()
        try:
            await self._send_pending()
        except OrinError:
            raise error_for(*self._refusal) from None

    async def request(self, function: Function[..., Any], handle: int, *arguments: Any) -> Reply:
        """Call a function of the controller; return the return code, and the result with its VARIANT type.

        Raises:
            CallError: With the controller's error code, or one of the codes in the module's docstring.
        """
        self.moving.before(function, handle, arguments)
        try:
            reply = await self._exchange(function, handle, *arguments)
        except CallError:
            raise
        except OrinError as error:
            raise self._failure(function, error) from error
        self.moving.after(function, handle, arguments)
        self.moving.connected(function, arguments, getattr(reply.value, "value", reply.value))
        return reply

    def add_reference(self, release: Function[[int], None], handle: int) -> None:
        """Count one more object with a handle, because a controller may return the same handle for several objects.

        Args:
            release: Function that releases the object.
            handle: Handle of the object.
        """
        if self._client is not None:
            self._client.handles.add_reference(release, handle)

    # --- for any caller -------------------------------------------------------------------------------------------

    def release(self, release: Function[[int], None], handle: int, generation: int) -> None:
        """Release an object of the controller in the background; further calls are sent after the release.

        The release is not sent while another object has the same handle, or if the handle belongs to an earlier
        generation.
        """
        if self._closed or self._client is None or generation != self.generation:
            return
        if self._client.handles.drop_reference(release, handle):
            self._released.append((release, handle))
            if len(self._released) == 1:
                self._spawn(self._send_releases())

    def close(self) -> None:
        """Close the connection in the background, after a Service_Stop with which the controller releases all objects.

        If the controller is executing another call, Service_Stop is omitted, because the controller would not accept a
        second call. In this case, the controller releases the objects because the connection is closed.
        """
        if not self._closed:
            self._closed = True
            self._released.clear()
            self._stop_keep_alive()
            self._spawn(self._shut_down())

    def disconnect(self) -> None:
        """Close the connection to the controller in the background; the next call opens it again."""
        self._spawn(self._lose(ConnectionClosed(tr("no signs of life from the client"))))

    async def wait_closed(self) -> None:
        """Wait at most 2 s until the connection is closed; return immediately if this event loop does not close it."""
        if self._closed and self._tasks and self._loop is asyncio.get_running_loop():
            await asyncio.wait(self._tasks, timeout=2 * _CLOSE_TIMEOUT)

    # --- internals ------------------------------------------------------------------------------------------------

    async def _open(self) -> None:
        if self._loop.time() < self._next_try:
            raise error_for(*self._refusal)
        try:
            client, self.handle = await self._upstream.open(self._wanted)
        except OrinError as error:
            self._refusal = _refusal(self.url, error)
            logger.warning("%s: %s", self.url, error)
            self._next_try = self._loop.time() + self._delay
            self._delay = min(2 * self._delay, _MAX_DELAY * self._upstream.retry)
            raise error_for(*self._refusal) from error
        if self._closed:
            await client.close()
            raise _disconnected(self.url)
        logger.info("%s: connected%s", self.url, " again" if self.generation else "")
        self._client = client
        self._lossy = client.profile.lossy
        self.generation += 1
        self._delay = self._upstream.retry
        self._next_try = self._loop.time() + self._delay
        self._note_reply()
        self._start_keep_alive(client)

    async def _exchange(self, function: Function[..., Any], handle: int, *arguments: Any) -> Reply:
        client = self._client
        if client is None:
            raise ConnectionClosed(self.url)
        timeout = client.command_timeout(arguments[0]) if function.method == "execute" and arguments else None
        self._executing = True  # if this task is cancelled, it remains True: the controller still executes the call
        try:
            reply = await client.request(function, handle, *arguments, timeout=timeout, exact=True)
        except CallError as error:
            self._note_reply()
            if error.code == hresult.E_HANDLE and await self._is_forgotten(client):
                await self._lose(error)
                raise error_for(hresult.E_CAO_REMOTE_PROVIDER, _forgotten(self.url)) from error
            raise
        except CallTimeout as error:
            self._executing = False
            self._timeouts += 1
            if self._timeouts >= _MAX_TIMEOUTS or _is_long(arguments):
                await self._lose(error)
            raise
        except OrinError as error:
            self._executing = False
            if isinstance(error, TransportError) or (isinstance(error, ProtocolError) and error.fatal):
                await self._lose(error)
            raise
        self._note_reply()
        return reply

    async def _is_forgotten(self, client: AsyncClient) -> bool:
        """Return True if the controller has deleted this client's handles, after a restart or a long idle period.

        On UDP, HTTP and serial lines, the controller does not report the deletion; it only returns E_HANDLE for handles
        that should be valid. Therefore this method requests the name of the controller object, whose handle is valid
        unless the handles have been deleted.
        """
        if not (client.profile.session_timeout or client.profile.shared):
            return False
        try:
            await client.call(f.controller_get_name, self.handle)
        except CallError as error:
            return error.code == hresult.E_HANDLE
        return False

    def _note_reply(self) -> None:
        self._executing = False
        self._timeouts = 0
        self._last_reply = self._loop.time()

    async def _lose(self, error: OrinError) -> None:
        """Close a connection that is lost or unusable; keep the error for calls before the next attempt to connect."""
        client, self._client = self._client, None
        self.moving.clear()
        self._released.clear()
        self._stop_keep_alive()
        self._refusal = _refusal(self.url, error)
        if client is not None:
            if not self._closed:
                logger.warning("%s: the connection is lost: %s", self.url, error)
            await client.close()

    def _failure(self, function: Function[..., Any], error: OrinError) -> CallError:
        """Return the error for the client if a call failed between gateway and controller."""
        if isinstance(error, ConnectionClosed) and self._closed:
            return _disconnected(self.url)
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
        return error_for(code, _uncertain(self.url, function, error))

    async def _send_pending(self) -> None:
        while self._released:
            release, handle = self._released[0]
            try:
                await self._exchange(release, handle)
            except OrinError as error:
                logger.debug("%s: %s", self.url, error)
                if self._client is None:
                    raise
            if self._released:  # a lost connection clears the pending releases
                self._released.popleft()

    async def _send_releases(self) -> None:
        async with self.turn:
            try:
                await self._send_pending()
            except OrinError as error:
                logger.debug("%s: %s", self.url, error)

    # --- closing --------------------------------------------------------------------------------------------------

    async def _shut_down(self) -> None:
        client = self._client
        if client is not None:
            if not self._executing:
                await self._stop_service(client)
            await client.close()  # sends Service_Stop on transports without connections
            self._client = None
        self._ended(self)

    async def _stop_service(self, client: AsyncClient) -> None:
        try:
            async with asyncio.timeout(_CLOSE_TIMEOUT), self.turn:
                await client.call(f.service_stop)
        except (OrinError, TimeoutError) as error:
            logger.debug("%s: %s", self.url, error)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # --- keep-alive -----------------------------------------------------------------------------------------------

    def _start_keep_alive(self, client: AsyncClient) -> None:
        wanted = self._upstream.keep_alive
        interval = client.profile.session_timeout / _SIGNS if wanted is None else wanted
        if interval:
            self._keep_alive_timer = self._loop.call_later(interval, self._check_idle, interval)

    def _check_idle(self, interval: float) -> None:
        if self._loop.time() - self._last_reply >= interval / 2 and not self.turn.locked():
            self._spawn(self._send_keep_alive())
        self._keep_alive_timer = self._loop.call_later(interval, self._check_idle, interval)

    async def _send_keep_alive(self) -> None:
        async with self.turn:
            try:
                await self._exchange(f.controller_get_name, self.handle)
            except OrinError as error:  # any reply shows that the controller has received the call
                logger.debug("%s: %s", self.url, error)

    def _stop_keep_alive(self) -> None:
        if self._keep_alive_timer is not None:
            self._keep_alive_timer.cancel()
            self._keep_alive_timer = None


def _is_long(arguments: tuple[Any, ...]) -> bool:
    """Return True if part of a call without a reply may still be unsent; the connection would keep these bytes."""
    return memory_of(each for each in arguments if isinstance(each, Variant)) > ALWAYS


def _refusal(url: str, error: OrinError) -> tuple[int, str]:
    """Return the return code and the text for calls that are not sent because there is no connection."""
    if isinstance(error, CallError) and error.code != hresult.E_HANDLE:  # the controller has refused the connection
        return error.code, error.detail
    return hresult.E_CAO_REMOTE_PROVIDER, _never_sent(url, error)


def _never_sent(url: str, error: OrinError) -> str:
    return tr("gateway to {url}: {error}. The call was not sent", url=url, error=error)


def _forgotten(url: str) -> str:
    return tr(
        "gateway to {url}: the controller has released this client, for example because of a restart. The call "
        "was not executed; the next call reconnects",
        url=url,
    )


def _uncertain(url: str, function: Function[..., Any], error: OrinError) -> str:
    return tr(
        "gateway to {url}: {error}. {name} may or may not have been executed; it is not repeated. If the connection "
        "was lost, the next call reconnects, without taking the arm",
        url=url,
        error=error,
        name=function.name,
    )


def _disconnected(url: str) -> CallError:
    return error_for(
        hresult.E_ABORT,
        tr("gateway to {url}: the client has disconnected", url=url),
    )
