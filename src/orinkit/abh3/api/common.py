"""What the synchronous and the asynchronous side of ABH3 have in common: settings, and what they say."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, TypedDict
from urllib.parse import quote

from orinkit.abh3.session.host import Host
from orinkit.abh3.table.checks import check_seconds
from orinkit.abh3.table.signals import Dialect, dialect_of
from orinkit.core.errors import InvalidAddress
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress, parse_address
from orinkit.values.pose_numbers import brief

if TYPE_CHECKING:
    import can

EXAMPLE: Final = "can://socketcan/can0"
_SCHEME: Final = "can://"


class BusSettings(TypedDict, total=False):
    """Where the bus is, if no URL says it.

    Attributes:
        interface: of python-can: ``"socketcan"``, ``"slcan"``, ``"udp_multicast"`` ...
        channel: of the interface: ``"can0"``, ``"/dev/ttyACM0"`` ...
        bitrate: bit/s, where the interface sets it: 250000, 500000 or 1000000.
    """

    interface: str
    channel: str | int
    bitrate: int


class HostSettings(TypedDict, total=False):
    """What a host has to know of a driver, as its parameters say (section 1).

    Attributes:
        address: of the driver, 0 to 253; 1 by default.
        host: address of this host, 0 to 253; 2 by default.
        group: of the driver's broadcasts, 0 to 31; 5 by default.
        timeout: seconds to wait for an answer; 1 by default.
        priority: of what is sent, 0 (first) to 7; 0 by default.
        load_unit: % of a code of the load: 1, as the document says, or 0.1.
    """

    address: int
    host: int
    group: int
    timeout: float
    priority: int
    load_unit: float


class Settings(BusSettings, HostSettings, total=False):
    """Both together."""


def check_names(
    settings: Mapping[str, object], known: type[BusSettings | HostSettings | Settings], *others: str
) -> None:
    """Refuse settings that there are not, as Python refuses an unknown argument.

    Raises:
        TypeError: there is one.
    """
    names = (*known.__annotations__, *others)
    for name in settings:
        if name not in names:
            raise TypeError(
                tr("there is no setting {name!r:.40}; there are {names}", name=name, names=", ".join(names))
            )


def bus_address(at: str | None, settings: BusSettings) -> CanAddress:
    """Return the address of a bus.

    Args:
        at: its URL, or ``None``.
        settings: where it is, if there is no URL.

    Raises:
        InvalidAddress: it is no address of a CAN bus, or is given twice or not at all.
    """
    if at is None and "interface" not in settings:
        raise _needed(at)
    if at is not None:
        beside = [name for name in BusSettings.__annotations__ if name in settings]
        if beside:
            raise _twice(at, ", ".join(beside))
        address = parse_address(at) if at.lower().startswith(_SCHEME) else None
        if not isinstance(address, CanAddress):
            raise _needed(at)
        return address
    channel = quote(str(settings.get("channel", "")), safe="/:", errors="surrogatepass")  # parse_address refuses those
    url = f"can://{settings['interface']}/{channel}"
    if "bitrate" in settings:
        url += f"?bitrate={settings['bitrate']}"
    address = parse_address(url)
    assert isinstance(address, CanAddress)
    return address


def given_bus(at: object) -> can.BusABC | None:
    """Return a bus of python-can if that is what was given, ``None`` for a URL or nothing.

    Raises:
        InvalidAddress: it is neither.
    """
    if at is None or isinstance(at, str):
        return None
    import can

    if isinstance(at, can.BusABC):
        return at
    raise _needed(at)


def _twice(at: str, name: str) -> InvalidAddress:
    return InvalidAddress(tr("{at!r:.200} says all about the bus: {name} cannot be given beside it", at=at, name=name))


def _needed(at: object) -> InvalidAddress:
    text = f"{at!r:.200}" if isinstance(at, str) else brief(at)
    given = f": {text}" if at is not None else ""
    return InvalidAddress(
        tr(
            "a CAN bus is needed{given}. Try: a URL as {example}?bitrate=500000, or interface= and "
            "channel= (and bitrate=), or a bus of python-can; one of the three",
            given=given,
            example=EXAMPLE,
        )
    )


def host_of(dialect: str | Dialect, settings: HostSettings) -> Host[Any]:
    """Return what is known of a driver; settings that are about the bus are passed over.

    Raises:
        InvalidValue: a setting is out of its range.
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
    """Return those of the settings that are about the bus."""
    found: BusSettings = {}
    if "interface" in settings:
        found["interface"] = settings["interface"]
    if "channel" in settings:
        found["channel"] = settings["channel"]
    if "bitrate" in settings:
        found["bitrate"] = settings["bitrate"]
    return found
