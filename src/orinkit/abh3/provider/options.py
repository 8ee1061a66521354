"""The option string of Controller_Connect, by which a client selects an ABH3 and its settings."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, cast
from urllib.parse import quote

from orinkit.abh3.api.names import HostSettings
from orinkit.abh3.table.signals import dialect_of
from orinkit.cao.options import Options
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import is_number
from orinkit.transport.address import CanAddress, parse_address

OPTIONS: Final = (
    "Interface", "Channel", "Bitrate", "Bus", "Address", "Host", "Group", "Priority", "Dialect", "LoadUnit", "Timeout",
    "KeepAlive", "Idle",
)  # fmt: skip
"""Names of the options; case-insensitive."""
_BUS_OPTIONS: Final = ("Interface", "Channel", "Bitrate", "Bus")
_NUMBERS: Final = ("address", "host", "group", "priority")
_REALS: Final = ("timeout", "load_unit")
_CLIENT_OPTIONS: Final = ("port", "tty_baudrate", "sleep_after_open")
"""URL options that clients may set; all others could open files and connections on the server's computer."""
_MULTICAST: Final = "udp_multicast"
_GROUP: Final = "239.74.163.2"
_PORT: Final = 43113
_PERIOD: Final = 0.1
_SHORTEST_PERIOD, _LONGEST_PERIOD = 0.01, 0.4  # s; a driver stops by itself if no command arrives for 0.5 s
_IDLE: Final = 1.0
_LONGEST: Final = 3600


class BusKey(NamedTuple):
    """Identifies a bus independently of the spelling of its address.

    Attributes:
        interface: Interface of python-can.
        channel: Channel of the interface; for a device file, its real path.
        port: Port of a multicast bus; 0 otherwise.
    """

    interface: str
    channel: str
    port: int


class DriverSelection(NamedTuple):
    """The driver and the settings selected by a client.

    Attributes:
        bus: Address of the bus; ``None`` for the bus of the server.
        dialect: Dialect of the driver.
        settings: Settings of the host.
        period: Seconds between commands of the keep-alive; 0 for no keep-alive.
        idle: Seconds without a call of the client after which the motor is stopped; 0 for no such limit.
    """

    bus: CanAddress | None
    dialect: str
    settings: HostSettings
    period: float
    idle: float

    @property
    def bus_key(self) -> BusKey | None:
        """Key of the bus, the same for all spellings of its address; ``None`` for the bus of the server."""
        return None if self.bus is None else _bus_key(self.bus)


def parse_selection(option: str, defaults: Mapping[str, Any], *, own_bus: str | bool) -> DriverSelection:
    """Parse an option string.

    Args:
        option: Option string of Controller_Connect.
        defaults: Settings for options that are not in the string.
        own_bus: URL of the only bus that clients can use; ``True`` if this bus has no URL, because it is a python-can
            bus; ``False`` if clients select the bus.

    Raises:
        CallError: E_INVALIDARG: If the option string or one of its numbers is not valid.
        InvalidValue, InvalidAddress: If the dialect or the address of the bus is not valid.
    """
    options = Options(option)
    _check_names(options)
    period = _seconds(options, "KeepAlive", _PERIOD, _LONGEST)
    if period and not _SHORTEST_PERIOD <= period <= _LONGEST_PERIOD:
        raise invalid(
            tr(
                "KeepAlive must be 0 or {shortest} to {slowest} s, not {period:g} s: a driver stops by itself if "
                "no command arrives for 0.5 s",
                shortest=_SHORTEST_PERIOD,
                slowest=_LONGEST_PERIOD,
                period=period,
            )
        )
    return DriverSelection(
        _bus(options, own_bus=own_bus),
        dialect_of(options.text_of("Dialect", str(defaults.get("dialect", "v1")))).name,
        _settings(options, defaults),
        period,
        _seconds(options, "Idle", _IDLE, _LONGEST),
    )


def invalid(text: str) -> CallError:
    """Return the exception for an invalid value."""
    return error_for(hresult.E_INVALIDARG, text)


# --- the bus ----------------------------------------------------------------------------------------------------------


def _bus(options: Options, *, own_bus: str | bool) -> CanAddress | None:
    given = [name for name in _BUS_OPTIONS if name in options]
    if not own_bus:
        return _chosen(options, given)
    if given and not (isinstance(own_bus, str) and _is_at(own_bus, _chosen(options, given))):
        names = ", ".join(given)
        raise invalid(tr("the server uses another bus, which clients cannot change. Try: omit {names}", names=names))
    return None


def _is_at(url: str, address: CanAddress) -> bool:
    own = parse_address(url)
    return isinstance(own, CanAddress) and _bus_key(own) == _bus_key(address)


def _chosen(options: Options, given: list[str]) -> CanAddress:
    if not given or ("Bus" in given and len(given) > 1) or given == ["Bitrate"]:
        raise invalid(
            tr(
                "the options do not select a CAN bus. Try: Interface=socketcan, Channel=can0 and, if necessary, "
                "Bitrate=500000; or Bus=URL without these three options"
            )
        )
    address = parse_address(options.text_of("Bus") if "Bus" in given else _url(options))
    if not isinstance(address, CanAddress):
        raise invalid(tr("{address} is not a CAN bus", address=address))
    refused = [name for name, value in address.options if name not in _CLIENT_OPTIONS or not is_number(value)]
    if refused or "://" in address.channel:
        what = ", ".join(refused) or address.channel
        raise invalid(tr("{what:.100} can only be set on the server. Try: configure the bus on the server", what=what))
    return address


def _url(options: Options) -> str:
    url = f"can://{options.text_of('Interface')}/{quote(options.text_of('Channel'), safe='/:')}"
    return f"{url}?bitrate={_number(options, 'Bitrate')}" if "Bitrate" in options else url


def _bus_key(address: CanAddress) -> BusKey:
    channel, port = address.channel, 0
    if address.interface == _MULTICAST:
        channel = _host(channel or _GROUP)
        port = int(dict(address.options).get("port", _PORT))
    elif channel.startswith(("/", ".")):
        channel = os.path.realpath(channel.partition("@")[0])
    return BusKey(address.interface, channel, port)


def _host(text: str) -> str:
    try:
        return str(ipaddress.ip_address(text))
    except ValueError:
        return text.lower()


# --- numbers ----------------------------------------------------------------------------------------------------------


def _settings(options: Options, defaults: Mapping[str, Any]) -> HostSettings:
    settings = {name: value for name, value in defaults.items() if name != "dialect"}
    for name in _NUMBERS:
        if name in options:
            settings[name] = _number(options, name)
    for name in _REALS:
        if (option := name.replace("_", "")) in options:
            settings[name] = _real(options, option)
    return cast(HostSettings, settings)


def _check_names(options: Options) -> None:
    """Check that every option is known and occurs once.

    Without this check, a client that misspells ``Address`` would move the motor with the default address.

    Raises:
        CallError: E_INVALIDARG: If an option is unknown or repeated.
    """
    known = {name.lower() for name in OPTIONS}
    if options.repeated:
        names = ", ".join(options.repeated)
        raise invalid(tr("options given twice: {names:.100}", names=names))
    for name in options.names:
        if name not in known:
            raise invalid(tr("unknown option {name:.40}; valid options: {names}", name=name, names=", ".join(OPTIONS)))


def _number(options: Options, name: str) -> int:
    try:
        number = options.number(name)
    except ValueError as error:
        raise invalid(tr("{name}={value} is not a whole number", name=name, value=error)) from None
    assert number is not None
    return number


def _real(options: Options, name: str) -> float:
    text = options.text_of(name)
    try:
        return float(text)
    except ValueError:
        raise invalid(tr("{name}={text:.40} is not a number", name=name, text=text)) from None


def _seconds(options: Options, name: str, default: float, longest: float) -> float:
    seconds = _real(options, name) if name in options else default
    if not 0 <= seconds <= longest:
        raise invalid(
            tr("{name} must be 0 to {longest:g} s, not {seconds:g} s", name=name, longest=longest, seconds=seconds)
        )
    return seconds
