"""The asynchronous side: the same names as in :mod:`orinkit`, for asyncio.

::

    async with aio.connect("tcp://192.168.0.1:5007") as rc8:
        io = await rc8.variable("IO150")
        await io.put_value(True)
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from functools import wraps
from types import TracebackType
from typing import Any, Generic, ParamSpec, TypeVar

from orinkit.client._async import (
    AsyncCommand,
    AsyncController,
    AsyncExtension,
    AsyncFile,
    AsyncMessage,
    open_controller,
)
from orinkit.client._async_client import AsyncClient
from orinkit.client._async_motion import AsyncMotion
from orinkit.client._async_nodes import AsyncVariable
from orinkit.client._async_robot import AsyncRobot
from orinkit.client._async_task import AsyncTask
from orinkit.server.aio_server import AsyncServer

__all__ = [
    "AsyncClient",
    "AsyncCommand",
    "AsyncController",
    "AsyncExtension",
    "AsyncFile",
    "AsyncMessage",
    "AsyncMotion",
    "AsyncRobot",
    "AsyncServer",
    "AsyncTask",
    "AsyncVariable",
    "connect",
    "open_client",
    "serve",
]

P = ParamSpec("P")
C = TypeVar("C", bound=AsyncController | AsyncClient)


class Opening(Generic[C]):
    """Something that is being opened: ``async with`` opens and closes it, ``await`` only opens it."""

    def __init__(self, opening: Coroutine[Any, Any, C]) -> None:
        self._opening = opening
        self._opened: C | None = None

    def __await__(self) -> Generator[Any, Any, C]:
        return self._opening.__await__()

    async def __aenter__(self) -> C:
        self._opened = await self._opening
        return self._opened

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._opened is not None
        await self._opened.close()


def _opening(function: Callable[P, Coroutine[Any, Any, C]]) -> Callable[P, Opening[C]]:
    @wraps(function)
    def start(*args: P.args, **kwargs: P.kwargs) -> Opening[C]:
        return Opening(function(*args, **kwargs))

    return start


connect = _opening(open_controller)
open_client = _opening(AsyncClient.open)
serve = AsyncServer
