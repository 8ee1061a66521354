"""The JSON view of variables, for dashboards: ``GET /variables/NAME``.

Each address that reads variables has one session, which ends after a time without a request. The session only connects
to the controller and reads variables.
"""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import ClientInfo
from orinkit.cao.results import begin_call
from orinkit.cao.session import Session
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.ecap.message import own_code
from orinkit.server.call_runner import result_of
from orinkit.server.context import ServerContext
from orinkit.server.http.exchange import Exchange
from orinkit.server.http.json_text import VARIABLES, error_document, value_document
from orinkit.server.large_values import is_large
from orinkit.values.variant import Variant, VarType, variant

logger = logging.getLogger("orinkit.server")

IDLE_TIMEOUT: Final = 60.0
"""Time in s without a request after which the session of an address ends."""
MOST_ADDRESSES: Final = 32
"""Limit on the addresses that read variables at the same time; the address that has been silent longest is forgotten."""
MOST_VARIABLES: Final = 64
"""Limit on the variables that the session of an address keeps open."""

_COST: Final = 0.0001  # s, expected time of one call
_RC8: Final = "CaoProv.DENSO.VRC"  # for a gateway, which forwards any name to its controller


class _Failed(Exception):
    """A call has returned an error code."""

    def __init__(self, reply: CallReply) -> None:
        self.reply = reply


class _View:
    """The session of one address."""

    def __init__(self, context: ServerContext, address: str, port: int) -> None:
        self._context = context
        self._session = Session(context.host, ClientInfo(address, "http", port), context.numbers, own_code)
        self._controller = 0
        self._variables: dict[str, int] = {}  # the variable that has been read most recently last
        self._lock = asyncio.Lock()
        self.used_at = asyncio.get_running_loop().time()

    async def read(self, exchange: Exchange, name: str) -> Variant:
        """Return the value of a variable.

        Raises:
            _Failed: If the device returns an error code.
        """
        async with self._lock:
            self.used_at = asyncio.get_running_loop().time()
            if not self._controller:
                names = self._context.host.providers[0].provider_names
                provider = _RC8 if names[0] == "*" else names[0]
                self._controller = await self._number(exchange, f.controller_connect, "", provider, "localhost", "")
            handle = self._variables.pop(name, 0)
            if not handle:
                if len(self._variables) >= MOST_VARIABLES:
                    oldest = next(iter(self._variables))
                    await self._call(exchange, f.variable_release, self._variables.pop(oldest))
                handle = await self._number(exchange, f.controller_get_variable, self._controller, name, "")
            self._variables[name] = handle
            value = await self._call(exchange, f.variable_get_value, handle)
            return Variant(VarType.EMPTY) if value is None else value

    async def _number(self, exchange: Exchange, function: Function[..., Any], *arguments: Any) -> int:
        value = await self._call(exchange, function, *arguments)
        assert value is not None
        return int(value.value)

    async def _call(self, exchange: Exchange, function: Function[..., Any], *arguments: Any) -> Variant | None:
        given = [variant(each) for each in arguments]
        outcome = await exchange.connection.run(partial(self._session.invoke, function.id, given), _COST)
        reply = await self._completed(outcome) if isinstance(outcome, Pending) else outcome
        if hresult.failed(reply.code):
            raise _Failed(reply)
        return reply.result

    async def _completed(self, pending: Pending) -> CallReply:
        begin_call(lambda: False)
        try:
            async with asyncio.timeout(self._context.invoke_timeout):
                result = await result_of(pending.work)
        except TimeoutError:
            return CallReply(hresult.E_TIMEOUT)
        except Exception as error:  # noqa: BLE001 - any exception of a device becomes a reply
            return self._session.fail(pending, error)
        return self._session.complete(pending, result)

    def close(self) -> None:
        """Release the objects of the session."""
        self._session.free_names()
        self._session.close()


class VariableViews:
    """The JSON view of one listener.

    Args:
        context: the state shared by all clients of the server.
    """

    def __init__(self, context: ServerContext) -> None:
        self._context = context
        self._views: dict[str, _View] = {}  # by address; the one that has been used most recently last
        self._timer: asyncio.TimerHandle | None = None

    async def answer(self, exchange: Exchange) -> None:
        """Send the response to a request for a variable."""
        name = exchange.path[len(VARIABLES) :]
        if self._context.host.requires_secret:
            detail = tr("the provider requires a secret")
            await exchange.answer_json(*error_document(hresult.E_ACCESSDENIED, detail))
            return
        view = self._view(exchange)
        try:
            value = await view.read(exchange, name)
        except _Failed as failed:
            if failed.reply.code == hresult.E_HANDLE:  # the device has released the objects
                self._forget(exchange.scope["client"][0])
            await exchange.answer_json(*error_document(failed.reply.code, failed.reply.detail))
            return
        if is_large(value):
            await exchange.answer_json(*error_document(hresult.E_TOO_MUCH_DATA, ""))
        else:
            await exchange.answer_json(200, value_document(name, value))

    def _view(self, exchange: Exchange) -> _View:
        address, port = exchange.scope["client"] or ("", 0)
        view = self._views.pop(address, None)
        if view is None:
            if len(self._views) >= MOST_ADDRESSES:
                self._forget(next(iter(self._views)))
            view = _View(self._context, address, port)
            self._context.all.add(self)
        self._views[address] = view
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(IDLE_TIMEOUT, self._check_idle_time)
        return view

    def _forget(self, address: str) -> None:
        view = self._views.pop(address, None)
        if view is not None:
            view.close()

    def _check_idle_time(self) -> None:
        self._timer = None
        loop = asyncio.get_running_loop()
        now = loop.time()
        for address, view in list(self._views.items()):
            if now >= view.used_at + IDLE_TIMEOUT:
                self._forget(address)
        if self._views:
            self._timer = loop.call_later(IDLE_TIMEOUT, self._check_idle_time)
        else:
            self._context.discard(self)

    # --- the server is closing: orinkit.server.context.Closable ---------------------------------------------------------

    def close(self) -> None:
        """End all sessions."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for address in list(self._views):
            self._forget(address)
        self._context.discard(self)

    def abort(self) -> None:
        """End all sessions."""
        self.close()
