"""Opening a bus with python-can, and saying why it cannot be opened."""

from __future__ import annotations

import errno
import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from orinkit.core import optional_deps
from orinkit.core.errors import ConnectFailed, InvalidAddress, MissingExtra, OrinError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress

if TYPE_CHECKING:
    import can

_GROUP: Final = "239.74.163.2"
"""The IPv4 group of udp_multicast; python-can's own choice is an IPv6 group, which fewer networks have."""
_NEEDS: Final = {
    "udp_multicast": "msgpack",
    "slcan": "serial",
    "serial": "serial",
    "robotell": "serial",
    "seeedstudio": "serial",
}
_PORTS: Final = ("slcan", "serial", "robotell", "seeedstudio")
_PSEUDO: Final = "/dev/pts/"
_TELLING: Final = ("socketcan", "udp_multicast", "virtual", "slcan", "serial")
"""Interfaces whose class names all of its options; others look for more in what they are given."""
_NO_OPTIONS: Final = ("channel", "kwargs", "can_filters", "timing", "protocol")
_PAST_PORTS: Final = 65536
_REFUSED: Final = (ValueError, TypeError, OverflowError, AttributeError)
_ABSENT: Final = (errno.ENOENT, errno.ENODEV, errno.ENXIO)
_FORBIDDEN: Final = (errno.EACCES, errno.EPERM)


def opened(address: CanAddress) -> can.BusABC:
    """Open a bus, as :func:`orinkit.can.bus.open_bus`."""
    optional_deps.require("CAN", "can", "can")
    if address.interface in _NEEDS:
        optional_deps.require(f"CAN ({address.interface})", "can", _NEEDS[address.interface])
    import can

    if address.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise InvalidAddress(
            tr(
                "{address}: python-can has no interface {interface!r}; known: {known}. Example: can://socketcan/can0",
                address=_short(address),
                interface=address.interface,
                known=known,
            )
        )
    _check_options(address)
    try:
        return can.Bus(interface=address.interface, ignore_config=True, **_settings(address))
    except Exception as error:
        raise _failed(address, error) from error


def _check_options(address: CanAddress) -> None:
    """Refuse what python-can would swallow, or stumble over.

    Raises:
        InvalidAddress: there is an option that the interface has not, or a port that is none.
    """
    if address.interface in _TELLING:
        from inspect import signature

        from can.interfaces import BACKENDS

        module, name = BACKENDS[address.interface]
        known = [each for each in signature(getattr(import_module(module), name)).parameters if each not in _NO_OPTIONS]
        for option, _ in address.options:
            if option not in known:
                names = ", ".join(known)
                raise _refused(address, tr("no option {option!r}; known: {names}", option=option, names=names))
    port = dict(address.options).get("port", 1)
    if address.interface == "udp_multicast" and (not isinstance(port, int) or not 0 < port < _PAST_PORTS):
        raise _refused(address, tr("port {port!r:.80} is not 1 to 65535", port=port))


def _settings(address: CanAddress) -> dict[str, Any]:
    settings = dict(address.options)
    channel: str | int = address.channel
    if address.interface == "udp_multicast":
        channel = channel or _GROUP
    elif address.channel.isascii() and address.channel.isdecimal() and str(int(address.channel)) == address.channel:
        channel = int(address.channel)  # as python-can reads its own configuration
    if channel != "":
        settings["channel"] = channel
    if address.bitrate is not None:
        settings["bitrate"] = address.bitrate
    if address.interface == "slcan" and os.path.realpath(address.channel.partition("@")[0]).startswith(_PSEUDO):
        settings.setdefault("sleep_after_open", 0)  # its own choice is 2 s, see open_bus
    return settings


def _failed(address: CanAddress, error: Exception) -> OrinError:
    """Return the exception for a bus that could not be opened."""
    import can

    if isinstance(error, can.CanInitializationError) and isinstance(error.__cause__, (*_REFUSED, OSError)):
        cause: BaseException = error.__cause__  # python-can wraps what it finds
    else:
        cause = error
    reason = str(cause) or type(cause).__name__
    if isinstance(cause, ImportError) or "not installed" in reason or "Cannot import module" in reason:
        return MissingExtra(
            tr(
                "{address}: {reason}. Try: pip install 'orinkit[can]', and the driver of the adapter",
                address=_short(address),
                reason=reason,
            )
        )
    number = cause.errno if isinstance(cause, OSError) else None
    if isinstance(cause, _REFUSED) and not isinstance(cause, OSError):
        return _refused(address, reason)
    if cause is not error and str(error) and str(error) != reason:
        reason = f"{error} ({reason})"
    try_this = _what_to_try(address, number)
    return ConnectFailed(
        tr(
            "cannot open the CAN bus {address}: interface {interface}, channel {channel!r:.80}: "
            "{reason}. Try: {try_this}",
            address=_short(address),
            interface=address.interface,
            channel=address.channel,
            reason=reason,
            try_this=try_this,
        )
    )


def _refused(address: CanAddress, reason: str) -> InvalidAddress:
    return InvalidAddress(
        tr(
            "{address}: interface {interface}, channel {channel!r:.80}: {reason}. Try: the channel "
            "and the options that python-can has for this interface",
            address=_short(address),
            interface=address.interface,
            channel=address.channel,
            reason=reason,
        )
    )


def _what_to_try(address: CanAddress, number: int | None) -> str:
    if address.interface in _PORTS and number in _FORBIDDEN and sys.platform != "win32":
        return tr("become a member of the group of the port (Linux: sudo usermod -aG dialout $USER) and log in again")
    if address.interface in _PORTS:
        return tr(
            "is the adapter plugged in, is that the name of its port (can://slcan//dev/ttyACM0, "
            "can://slcan/COM3), does no other program use it?"
        )
    if address.interface == "socketcan" and number in _ABSENT:
        return tr(
            "is the adapter plugged in, and is that its name? `ip link` lists them; sudo ip link set "
            "{channel} up type can bitrate {bitrate}",
            channel=address.channel or "can0",
            bitrate=address.bitrate or 500000,
        )
    if address.interface == "socketcan":
        return tr(
            "has this system CAN (Linux: sudo modprobe can_raw)? Without hardware: can://udp_multicast/239.74.163.2"
        )
    if address.interface == "udp_multicast":
        return tr("a multicast address (239.74.163.2), a port (?port=43113), and is there a network that carries it?")
    return tr("is the adapter plugged in, its driver installed, the channel right?")


def _short(address: CanAddress) -> str:
    return f"{address!s:.200}"
