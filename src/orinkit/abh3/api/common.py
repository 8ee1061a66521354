"""Settings of buses and drivers, shared by the synchronous and the asynchronous API."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, TypedDict
from urllib.parse import quote

from orinkit.abh3.session.host import Host
from orinkit.abh3.table.signals import Dialect, dialect_of
from orinkit.core.errors import InvalidAddress
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_seconds
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    import can

EXAMPLE: Final = "can://socketcan/can0"
_SCHEME: Final = "can://"


class BusSettings(TypedDict, total=False):
    """The location of the bus, if no URL is given.

    Attributes:
        interface: Interface of python-can: ``"socketcan"``, ``"slcan"``, ``"udp_multicast"`` ...
        channel: Channel of the interface: ``"can0"``, ``"/dev/ttyACM0"`` ...
        bitrate: Bit rate in bit/s: 250000, 500000 or 1000000. If omitted, the interface keeps its setting.
    """

    interface: str
    channel: str | int
    bitrate: int


class HostSettings(TypedDict, total=False):
    """Settings of a host for one driver; they must match the driver's parameters (section 1 of the ABH3 document).

    Attributes:
        address: Address of the driver, 0 to 253; 1 by default.
        host: Address of this host, 0 to 253; 2 by default.
        group: Group of the driver's broadcasts, 0 to 31; 5 by default.
        timeout: Seconds to wait for a reply; 1 by default.
        priority: Priority of the frames that are sent, 0 (highest) to 7; 0 by default.
        load_unit: Resolution of the loads in frames, in %: 1 (as in the document) or 0.1; 1 by default.
    """

    address: int
    host: int
    group: int
    timeout: float
    priority: int
    load_unit: float


class Settings(BusSettings, HostSettings, total=False):
    """Settings of the bus and of the driver."""


def check_names(
    settings: Mapping[str, object], known: type[BusSettings | HostSettings | Settings], *others: str
) -> None:
    """Check that every setting exists, as Python does for keyword arguments.

    Raises:
        TypeError: If a setting is unknown.
    """
    names = (*known.__annotations__, *others)
    for name in settings:
        if name not in names:
            raise TypeError(
                tr("unknown setting {name!r:.40}; valid settings: {names}", name=name, names=", ".join(names))
            )


def bus_address(at: str | None, settings: BusSettings) -> CanAddress:
    """Return the address of a bus.

    Args:
        at: URL of the bus, or ``None``.
        settings: Location of the bus, if no URL is given.

    Raises:
        InvalidAddress: If ``at`` is not the URL of a CAN bus, if both ``at`` and settings of the bus are given, or if
            neither is given.
    """
    if at is None and "interface" not in settings:
        raise _bus_required(at)
    if at is not None:
        conflicting = [name for name in BusSettings.__annotations__ if name in settings]
        if conflicting:
            raise _conflict(at, ", ".join(conflicting))
        address = parse_address(at) if at.lower().startswith(_SCHEME) else None
        if not isinstance(address, CanAddress):
            raise _bus_required(at)
        return address
    channel = quote(
        str(settings.get("channel", "")), safe="/:", errors="surrogatepass"
    )  # surrogates are passed on, because parse_address rejects them with InvalidAddress
    url = f"can://{settings['interface']}/{channel}"
    if "bitrate" in settings:
        url += f"?bitrate={settings['bitrate']}"
    address = parse_address(url)
    assert isinstance(address, CanAddress)
    return address


def given_bus(at: object) -> can.BusABC | None:
    """Return the argument if it is a python-can bus, ``None`` if it is a URL or ``None``.

    Raises:
        InvalidAddress: If the argument is something else.
    """
    if at is None or isinstance(at, str):
        return None
    import can

    if isinstance(at, can.BusABC):
        return at
    raise _bus_required(at)


def _conflict(at: str, name: str) -> InvalidAddress:
    return InvalidAddress(tr("{name} cannot be combined with the bus URL {at!r:.200}", at=at, name=name))


def _bus_required(at: object) -> InvalidAddress:
    text = f"{at!r:.200}" if isinstance(at, str) else brief(at)
    given = f": {text}" if at is not None else ""
    return InvalidAddress(
        tr(
            "a CAN bus is required{given}. Try: either a URL such as {example}?bitrate=500000, or interface= and "
            "channel= (and bitrate=), or a python-can bus",
            given=given,
            example=EXAMPLE,
        )
    )


def make_host(dialect: str | Dialect, settings: HostSettings) -> Host[Any]:
    """Return the host of a driver; settings of the bus are ignored.

    Raises:
        InvalidValue: If a setting is out of range.
    """
    return Host(
        dialect_of(dialect).with_load_unit(settings.get("load_unit", 1.0)),
        address=settings.get("address", 1),
        host=settings.get("host", 2),
        group=settings.get("group", 5),
        timeout=check_seconds("timeout", settings.get("timeout", 1.0)),
        priority=settings.get("priority", 0),
    )


def bus_settings(settings: Settings) -> BusSettings:
    """Return the settings of the bus only."""
    found: BusSettings = {}
    if "interface" in settings:
        found["interface"] = settings["interface"]
    if "channel" in settings:
        found["channel"] = settings["channel"]
    if "bitrate" in settings:
        found["bitrate"] = settings["bitrate"]
    return found
