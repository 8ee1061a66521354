"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``bus.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from orinkit.abh3.api._sync.driver import Driver
from orinkit.abh3.api._sync.shared import SharedBus
from orinkit.abh3.api.common import BusSettings, HostSettings, Settings, bus_settings, check_names, make_host
from orinkit.abh3.table.records import BR1, BR1V2, DP0R, DP0RV2
from orinkit.abh3.table.signals import Dialect
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import can


class MotorBus(SharedBus):
    """A CAN bus shared by any number of drivers; created by :func:`open_bus`."""

    @overload
    def driver(self, *, dialect: Literal["v1"] = "v1", **settings: Unpack[HostSettings]) -> Driver[DP0R, BR1]: ...

    @overload
    def driver(self, *, dialect: Literal["v2"], **settings: Unpack[HostSettings]) -> Driver[DP0RV2, BR1V2]: ...

    @overload
    def driver(self, *, dialect: str | Dialect, **settings: Unpack[HostSettings]) -> Driver[Any, Any]: ...

    def driver(self, *, dialect: str | Dialect = "v1", **settings: Unpack[HostSettings]) -> Driver[Any, Any]:
        """Return the object for a driver on this bus; no frame is sent.

        Args:
            dialect: ``"v1"`` for the dialect in the ABH3 document, ``"v2"`` for drivers of 2023 and later.
            **settings: See :class:`HostSettings`.

        Raises:
            InvalidValue: If a setting is out of range, or if this bus already has an object for the same driver. Two
                objects would overwrite each other's commands.
        """
        check_names(settings, HostSettings, "dialect")
        host = make_host(dialect, settings)
        if self.has(host):
            raise InvalidValue(
                tr(
                    "ABH3 {address} already has a driver object on this bus. Try: use that object, or close it first",
                    address=host.address,
                )
            )
        return Driver(self, host)


def open_bus(at: str | can.BusABC | None = None, **settings: Unpack[BusSettings]) -> MotorBus:
    """Open a CAN bus for several drivers (section 4.1 of the ABH3 document, abh3_can_port_init).

    Args:
        at: URL of the bus, such as ``can://socketcan/can0``, or a python-can bus; ``None`` if the settings identify the
            bus. orinkit does not close a python-can bus. While orinkit uses a python-can bus, no other code may receive
            from it.
        **settings: ``interface``, ``channel`` and ``bitrate``, only if ``at`` is omitted; see :class:`BusSettings`.

    Raises:
        InvalidAddress: If the arguments do not identify a CAN bus.
        ConnectFailed: If the bus cannot be opened.
        MissingExtra: If a required package is missing.
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
    """Open a CAN bus with one driver, and set the driver's commands and inputs to 0.

    This function corresponds to abh3_can_init (section 4.1 of the ABH3 document).

    Closing the driver also closes the bus, unless ``at`` is a python-can bus.

    Args:
        at: URL of the bus, or a python-can bus; ``None`` if the settings identify the bus. See :func:`open_bus`.
        dialect: ``"v1"`` for the dialect in the ABH3 document, ``"v2"`` for drivers of 2023 and later. The dialect of a
            driver cannot be detected from its frames.
        init: ``False`` to open the bus only, without sending a frame, like abh3_can_port_init.
        **settings: ``interface``, ``channel`` and ``bitrate``, only if ``at`` is omitted, see :class:`BusSettings`;
            ``address``, ``host``, ``group``, ``timeout``, ``priority`` and ``load_unit``, see :class:`HostSettings`.

    Raises:
        InvalidAddress: If the arguments do not identify a CAN bus.
        InvalidValue: If a setting is out of range.
        ConnectFailed: If the bus cannot be opened.
        DriverTimeout: If the driver does not reply; the bus is closed again.
        MissingExtra: If a required package is missing.
    """
    check_names(settings, Settings, "dialect", "init")
    host = make_host(dialect, settings)
    driver: Driver[Any, Any] = Driver(MotorBus.open(at, **bus_settings(settings)), host, owner=True)
    if init:
        try:
            driver.init()
        except BaseException:
            driver.close()
            raise
    return driver
