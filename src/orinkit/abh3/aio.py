"""ABH3 drivers in asyncio: the asynchronous counterpart of :mod:`orinkit.abh3`.

::

    async with aio.connect("can://socketcan/can0") as abh3:
        print((await abh3.command(ay=100.0)).a_velocity)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from orinkit.abh3.api._async import bus
from orinkit.abh3.api._async.bus import AsyncMotorBus
from orinkit.abh3.api._async.driver import AsyncDriver
from orinkit.abh3.api.common import BusSettings, Settings
from orinkit.abh3.table.records import BR1, BR1V2, DP0R, DP0RV2
from orinkit.abh3.table.signals import Dialect
from orinkit.core.awaitable import AwaitableContext

if TYPE_CHECKING:
    import can

__all__ = ["AsyncDriver", "AsyncMotorBus", "connect", "open_bus"]


@overload
def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: Literal["v1"] = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> AwaitableContext[AsyncDriver[DP0R, BR1]]: ...


@overload
def connect(
    at: str | can.BusABC | None = None, *, dialect: Literal["v2"], init: bool = True, **settings: Unpack[Settings]
) -> AwaitableContext[AsyncDriver[DP0RV2, BR1V2]]: ...


@overload
def connect(
    at: str | can.BusABC | None = None, *, dialect: str | Dialect, init: bool = True, **settings: Unpack[Settings]
) -> AwaitableContext[AsyncDriver[Any, Any]]: ...


def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: str | Dialect = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> AwaitableContext[AsyncDriver[Any, Any]]:
    """Open a CAN bus with one driver, for ``async with`` or ``await``; see :func:`orinkit.abh3.connect`."""
    return AwaitableContext(bus.connect(at, dialect=dialect, init=init, **settings))


def open_bus(at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> AwaitableContext[AsyncMotorBus]:
    """Open a CAN bus for several drivers, for ``async with`` or ``await``; see :func:`orinkit.abh3.open_bus`."""
    return AwaitableContext(bus.open_bus(at, **settings))
