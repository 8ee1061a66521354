"""What clients say in the option of Controller_Connect about the ABH3 that they want."""

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
from orinkit.transport.address import CanAddress, parse_address

OPTIONS: Final = (
    "Interface", "Channel", "Bitrate", "Bus", "Address", "Host", "Group", "Priority", "Dialect", "LoadUnit", "Timeout",
    "KeepAlive", "Idle",
)  # fmt: skip
"""Their names; upper and lower case do not matter."""
_WHERE: Final = ("Interface", "Channel", "Bitrate", "Bus")
_NUMBERS: Final = ("address", "host", "group", "priority")
_REALS: Final = ("timeout", "load_unit")
_ALLOWED: Final = ("port", "tty_baudrate", "sleep_after_open")
"""Options of a URL that clients may give: others open files and connections of the server's computer."""
_MULTICAST: Final = "udp_multicast"
_GROUP: Final = "239.74.163.2"
_PORT: Final = 43113
_PERIOD: Final = 0.1
_SHORTEST, _SLOWEST = 0.01, 0.4  # s: a driver stops by itself after 0.5 s
_IDLE: Final = 1.0
_LONGEST: Final = 3600


class BusKey(NamedTuple):
    """A bus, however it was spelled.

    Attributes:
        interface: of python-can.
        channel: of the interface; a device file by its real path.
        port: of multicast.
    """

    interface: str
    channel: str
    port: int


class DriverSelection(NamedTuple):
    """Which driver a client wants, and how.

    Attributes:
        bus: where it is; ``None`` for the bus that the server has.
        dialect: of the driver.
        settings: what is known of it.
        period: s between commands of the keep-alive; 0 for none.
        idle: s without a call of the client after which the motor is stopped; 0 for never.
    """

    bus: CanAddress | None
    dialect: str
    settings: HostSettings
    period: float
    idle: float

    @property
    def place(self) -> BusKey | None:
        """The bus, so that two spellings of it are one."""
        return None if self.bus is None else _place(self.bus)


def wanted(option: str, defaults: Mapping[str, Any], *, own_bus: str | bool) -> DriverSelection:
    """Return what an option string says.

    Args:
        option: of Controller_Connect.
        defaults: what holds where it says nothing.
        own_bus: the server has one bus, and clients choose no other; its URL, or ``True``.

    Raises:
        CallError: E_INVALIDARG: it cannot be used.
        InvalidValue, InvalidAddress: the same.
    """
    options = Options(option)
    _check_names(options)
    period = _seconds(options, "KeepAlive", _PERIOD, _LONGEST)
    if period and not _SHORTEST <= period <= _SLOWEST:
        raise invalid(
            tr(
                "KeepAlive is 0, or {shortest} to {slowest} s, not {period:g}: a driver stops by itself after 0.5 s",
                shortest=_SHORTEST,
                slowest=_SLOWEST,
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
    """Return the exception for what cannot be used."""
    return error_for(hresult.E_INVALIDARG, text)


# --- the bus ----------------------------------------------------------------------------------------------------------


def _bus(options: Options, *, own_bus: str | bool) -> CanAddress | None:
    given = [name for name in _WHERE if name in options]
    if not own_bus:
        return _chosen(options, given)
    if given and not (isinstance(own_bus, str) and _is_at(own_bus, _chosen(options, given))):
        names = ", ".join(given)
        raise invalid(tr("the server decides which bus it is, and it is another one: leave {names} out", names=names))
    return None


def _is_at(url: str, address: CanAddress) -> bool:
    own = parse_address(url)
    return isinstance(own, CanAddress) and _place(own) == _place(address)


def _chosen(options: Options, given: list[str]) -> CanAddress:
    if not given or ("Bus" in given and len(given) > 1) or given == ["Bitrate"]:
        raise invalid(
            tr("which CAN bus? Try: Interface=socketcan, Channel=can0 (and Bitrate=500000); or Bus= and its URL alone")
        )
    address = parse_address(options.text_of("Bus") if "Bus" in given else _url(options))
    if not isinstance(address, CanAddress):
        raise invalid(tr("{address} is no CAN bus", address=address))
    refused = [name for name, value in address.options if name not in _ALLOWED or not _is_number(value)]
    if refused or "://" in address.channel:
        what = ", ".join(refused) or address.channel
        raise invalid(tr("{what:.100} may be said on the server only. Try: let the server name the bus", what=what))
    return address


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _url(options: Options) -> str:
    url = f"can://{options.text_of('Interface')}/{quote(options.text_of('Channel'), safe='/:')}"
    return f"{url}?bitrate={_number(options, 'Bitrate')}" if "Bitrate" in options else url


def _place(address: CanAddress) -> BusKey:
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
    """Refuse an option that there is not, or that is there twice: a mistyped Address would turn another motor.

    Raises:
        CallError: E_INVALIDARG: there is one.
    """
    known = {name.lower() for name in OPTIONS}
    if options.repeated:
        names = ", ".join(options.repeated)
        raise invalid(tr("options given twice: {names:.100}", names=names))
    for name in options.names:
        if name not in known:
            raise invalid(tr("there is no option {name:.40}; there are: {names}", name=name, names=", ".join(OPTIONS)))


def _number(options: Options, name: str) -> int:
    try:
        number = options.number(name)
    except ValueError as error:
        raise invalid(tr("{name}={value} is no whole number", name=name, value=error)) from None
    assert number is not None
    return number


def _real(options: Options, name: str) -> float:
    text = options.text_of(name)
    try:
        return float(text)
    except ValueError:
        raise invalid(tr("{name}={text:.40} is no number", name=name, text=text)) from None


def _seconds(options: Options, name: str, default: float, longest: float) -> float:
    seconds = _real(options, name) if name in options else default
    if not 0 <= seconds <= longest:
        raise invalid(tr("{name} is 0 to {longest:g} s, not {seconds:g}", name=name, longest=longest, seconds=seconds))
    return seconds
