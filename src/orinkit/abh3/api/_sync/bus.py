"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``bus.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from orinkit.abh3.api._sync.driver import Driver
from orinkit.abh3.api._sync.shared import SharedBus
from orinkit.abh3.api.common import BusSettings, HostSettings, Settings, bus_settings, check_names, host_of
from orinkit.abh3.table.records import BR1, BR1V2, DP0R, DP0RV2
from orinkit.abh3.table.signals import Dialect
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can


class MotorBus(SharedBus):
    """A CAN bus that any number of drivers and listeners share; :func:`open_bus` makes it."""

    @overload
    def driver(self, *, dialect: Literal["v1"] = "v1", **settings: Unpack[HostSettings]) -> Driver[DP0R, BR1]: ...

    @overload
    def driver(self, *, dialect: Literal["v2"], **settings: Unpack[HostSettings]) -> Driver[DP0RV2, BR1V2]: ...

    @overload
    def driver(self, *, dialect: str | Dialect, **settings: Unpack[HostSettings]) -> Driver[Any, Any]: ...

    def driver(self, *, dialect: str | Dialect = "v1", **settings: Unpack[HostSettings]) -> Driver[Any, Any]:
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
        return Driver(self, host)


def open_bus(at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> MotorBus:
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
    return MotorBus.open(at, **settings)


@overload
def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: Literal["v1"] = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> Driver[DP0R, BR1]: ...


@overload
def connect(
    at: str | can.BusABC | None = None, *, dialect: Literal["v2"], init: bool = True, **settings: Unpack[Settings]
) -> Driver[DP0RV2, BR1V2]: ...


@overload
def connect(
    at: str | can.BusABC | None = None, *, dialect: str | Dialect, init: bool = True, **settings: Unpack[Settings]
) -> Driver[Any, Any]: ...


def connect(
    at: str | can.BusABC | None = None,
    *,
    dialect: str | Dialect = "v1",
    init: bool = True,
    **settings: Unpack[Settings],
) -> Driver[Any, Any]:
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
    driver: Driver[Any, Any] = Driver(MotorBus.open(at, **bus_settings(settings)), host, owner=True)
    if init:
        try:
            driver.init()
        except BaseException:
            driver.close()
            raise
    return driver
