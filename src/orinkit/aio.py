"""The asyncio counterparts of the classes and functions of :mod:`orinkit`.

::

    async with aio.connect("tcp://192.168.0.1:5007") as rc8:
        io = await rc8.variable("IO150")
        await io.put_value(True)
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from orinkit.client._async import controller
from orinkit.client._async.client import AsyncClient
from orinkit.client._async.controller import (
    AsyncCommand,
    AsyncController,
    AsyncExtension,
    AsyncMessage,
)
from orinkit.client._async.file import AsyncFile
from orinkit.client._async.motion import AsyncMotion
from orinkit.client._async.objects import AsyncPreparedCall, AsyncVariable
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._async.stream import AsyncStream
from orinkit.client._async.task import AsyncTask
from orinkit.core.awaitable import AwaitableContext
from orinkit.server.aio_group import AsyncServerGroup
from orinkit.server.aio_server import AsyncServer

__all__ = [
    "AsyncClient",
    "AsyncCommand",
    "AsyncController",
    "AsyncExtension",
    "AsyncFile",
    "AsyncMessage",
    "AsyncMotion",
    "AsyncPreparedCall",
    "AsyncRobot",
    "AsyncServer",
    "AsyncServerGroup",
    "AsyncStream",
    "AsyncTask",
    "AsyncVariable",
    "connect",
    "open_client",
    "serve",
    "serve_many",
]

P = ParamSpec("P")
C = TypeVar("C", bound=AsyncController | AsyncClient)


def _opening(function: Callable[P, Coroutine[Any, Any, C]]) -> Callable[P, AwaitableContext[C]]:
    @wraps(function)
    def start(*args: P.args, **kwargs: P.kwargs) -> AwaitableContext[C]:
        return AwaitableContext(function(*args, **kwargs))

    return start


connect = _opening(controller.connect)
open_client = _opening(AsyncClient.open)
serve = AsyncServer
serve_many = AsyncServerGroup

for _name in __all__:  # so that help() and tracebacks show orinkit.aio as the module of the public names
    _public = globals()[_name]
    if isinstance(_public, type) or getattr(_public, "__name__", "") == _name:
        _public.__module__ = __name__
