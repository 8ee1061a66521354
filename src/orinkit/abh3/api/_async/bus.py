"""Opening CAN buses, and the ABH3 drivers on them, in asyncio.

The synchronous twin is made from this file by ``tools/make_sync.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from orinkit.abh3.api._async.driver import AsyncDriver
from orinkit.abh3.api._async.shared import AsyncSharedBus
from orinkit.abh3.api.common import BusSettings, HostSettings, Settings, bus_settings, check_names, host_of
from orinkit.abh3.table.records import BR1, BR1V2, DP0R, DP0RV2
from orinkit.abh3.table.signals import Dialect
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can


class AsyncMotorBus(AsyncSharedBus):
    """A CAN bus that any number of drivers and listeners share; :func:`open_bus` makes it."""

    @overload
    def driver(self, *, dialect: Literal["v1"] = "v1", **settings: Unpack[HostSettings]) -> AsyncDriver[DP0R, BR1]: ...

    @overload
    def driver(self, *, dialect: Literal["v2"], **settings: Unpack[HostSettings]) -> AsyncDriver[DP0RV2, BR1V2]: ...

    @overload
    def driver(self, *, dialect: str | Dialect, **settings: Unpack[HostSettings]) -> AsyncDriver[Any, Any]: ...

    def driver(self, *, dialect: str | Dialect = "v1", **settings: Unpack[HostSettings]) -> AsyncDriver[Any, Any]:
        """Return a driver on this bus; nothing is sent.

        Args:
            dialect: ``"v1"``, the document's, or ``"v2"``, that of drivers of 2023.
            **settings: as of :class:`HostSettings`.

        Raises:
            InvalidValue: a setting is out of its range, or there is an object for this driver already: two would not know
                what the other one has commanded.
        """
        check_names(settings, HostSettings, "dialect")
        host = host_of(dialect, settings)
        if self.has(host):
            raise InvalidValue(
                tr(
                    "ABH3 {address} has a driver object on this bus already. Try: use that one, or close it first",
                    address=host.address,
                )
            )
        return AsyncDriver(self, host)


async def open_bus(at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> AsyncMotorBus:
    """Open a CAN bus for several drivers (4.1, abh3_can_port_init).

    Args:
        at: its URL, as ``can://socketcan/can0``; or a bus of python-can, which stays the caller's: nobody else may receive
            from it meanwhile, and it is not closed.
        **settings: ``interface``, ``channel`` and ``bitrate`` where there is no URL.

    Raises:
        InvalidAddress: it is no CAN bus.
        ConnectFailed: it cannot be opened.
        MissingExtra: a package is missing.
    """
    check_names(settings, BusSettings)
    return await AsyncMotorBus.open(at, **settings)


@overload
async def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: Literal["v1"] = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> AsyncDriver[DP0R, BR1]: ...


@overload
async def connect(
    at: str | can.BusABC | None = None, *, dialect: Literal["v2"], init: bool = True, **settings: Unpack[Settings]
) -> AsyncDriver[DP0RV2, BR1V2]: ...


@overload
async def connect(
    at: str | can.BusABC | None = None, *, dialect: str | Dialect, init: bool = True, **settings: Unpack[Settings]
) -> AsyncDriver[Any, Any]: ...


async def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: str | Dialect = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> AsyncDriver[Any, Any]:
    """Open a CAN bus with one driver and send it commands and inputs that are all 0 (4.1, abh3_can_init).

    Closing the driver closes the bus, if it was opened here.

    Args:
        at: URL of the bus, or a bus of python-can; as :func:`open_bus`.
        dialect: ``"v1"``, the document's, or ``"v2"``, that of drivers of 2023: the wire does not tell.
        init: ``False`` sends nothing, as abh3_can_port_init does.
        **settings: ``interface``, ``channel`` and ``bitrate`` where there is no URL; ``address``, ``host``, ``group``,
            ``timeout``, ``priority`` and ``load_unit`` as of :class:`HostSettings`.

    Raises:
        InvalidAddress: it is no CAN bus.
        InvalidValue: a setting is out of its range.
        ConnectFailed: the bus cannot be opened.
        DriverTimeout: the driver does not answer; the bus is closed again.
        MissingExtra: a package is missing.
    """
    check_names(settings, Settings, "dialect", "init")
    host = host_of(dialect, settings)
    driver: AsyncDriver[Any, Any] = AsyncDriver(
        await AsyncMotorBus.open(at, **bus_settings(settings)), host, owner=True
    )
    if init:
        try:
            await driver.init()
        except BaseException:
            await driver.close()
            raise
    return driver
