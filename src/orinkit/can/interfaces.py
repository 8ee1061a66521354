"""Open a bus with python-can; if this fails, raise an exception with the reason and a remedy."""

from __future__ import annotations

import errno
import os
import sys
from importlib import import_module
from traceback import clear_frames
from typing import TYPE_CHECKING, Any, Final

from orinkit.core import optional_deps
from orinkit.core.errors import ConnectFailed, InvalidAddress, MissingExtra, OrinError
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress

if TYPE_CHECKING:
    import can

_GROUP: Final = "239.74.163.2"
"""The IPv4 group of udp_multicast; python-can's default is an IPv6 group, which fewer networks support."""
_NEEDS: Final = {
    "udp_multicast": "msgpack",
    "slcan": "serial",
    "serial": "serial",
    "robotell": "serial",
    "seeedstudio": "serial",
}
_PORTS: Final = ("slcan", "serial", "robotell", "seeedstudio")
_PSEUDO: Final = "/dev/pts/"
_WITH_KNOWN_OPTIONS: Final = ("socketcan", "udp_multicast", "virtual", "slcan", "serial")
"""Interfaces whose class has all options as parameters; the others accept further options."""
_NO_OPTIONS: Final = ("channel", "kwargs", "can_filters", "timing", "protocol")
_PORT_LIMIT: Final = 65536
_REFUSED: Final = (ValueError, TypeError, OverflowError, AttributeError)
_ABSENT: Final = (errno.ENOENT, errno.ENODEV, errno.ENXIO)
_FORBIDDEN: Final = (errno.EACCES, errno.EPERM)


def opened(address: CanAddress) -> can.BusABC:
    """Open a bus; see :func:`orinkit.can.bus.open_bus`."""
    optional_deps.require("CAN", "can", "can")
    if address.interface in _NEEDS:
        optional_deps.require(f"CAN ({address.interface})", "can", _NEEDS[address.interface])
    import can

    if address.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise InvalidAddress(
            tr(
                "{address}: python-can has no interface {interface!r}; available: {known}. Example: can://socketcan/can0",
                address=_short(address),
                interface=address.interface,
                known=known,
            )
        )
    _check_options(address)
    try:
        return can.Bus(interface=address.interface, ignore_config=True, **_settings(address))
    except Exception as error:
        _release_frames(error)
        raise _failed(address, error) from error


def _release_frames(error: BaseException | None) -> None:
    """Release the local variables in the tracebacks of an error and of its causes.

    If python-can cannot open a bus, it does not close its socket. The tracebacks would keep this socket open until the
    next garbage collection.
    """
    while error is not None:
        clear_frames(error.__traceback__)
        error = error.__context__


def _check_options(address: CanAddress) -> None:
    """Check the options that python-can would ignore or that would make it fail.

    Raises:
        InvalidAddress: If the interface does not have an option, or the port is not valid.
    """
    if address.interface in _WITH_KNOWN_OPTIONS:
        from inspect import signature

        from can.interfaces import BACKENDS

        module, name = BACKENDS[address.interface]
        known = [each for each in signature(getattr(import_module(module), name)).parameters if each not in _NO_OPTIONS]
        for option, _ in address.options:
            if option not in known:
                names = ", ".join(known)
                raise _refused(address, tr("unknown option {option!r}; available: {names}", option=option, names=names))
    port = dict(address.options).get("port", 1)
    if address.interface == "udp_multicast" and (not isinstance(port, int) or not 0 < port < _PORT_LIMIT):
        raise _refused(address, tr("port must be 1 to 65535, not {port!r:.80}", port=port))


def _settings(address: CanAddress) -> dict[str, Any]:
    settings = dict(address.options)
    channel: str | int = address.channel
    if address.interface == "udp_multicast":
        channel = channel or _GROUP
    elif address.channel.isascii() and address.channel.isdecimal() and str(int(address.channel)) == address.channel:
        channel = int(address.channel)  # python-can does the same with a channel from its configuration
    if channel != "":
        settings["channel"] = channel
    if address.bitrate is not None:
        settings["bitrate"] = address.bitrate
    if address.interface == "slcan" and os.path.realpath(address.channel.partition("@")[0]).startswith(_PSEUDO):
        settings.setdefault("sleep_after_open", 0)  # python-can's default is 2 s, see open_bus
    return settings


def _failed(address: CanAddress, error: Exception) -> OrinError:
    """Return the exception for an error of python-can."""
    import can

    if isinstance(error, can.CanInitializationError) and isinstance(error.__cause__, (*_REFUSED, OSError)):
        cause: BaseException = error.__cause__  # python-can wraps the errors of interfaces
    else:
        cause = error
    reason = str(cause) or type(cause).__name__
    if isinstance(cause, ImportError) or "not installed" in reason or "Cannot import module" in reason:
        return MissingExtra(
            tr(
                "{address}: {reason}. Try: pip install 'orinkit[can]', and install the driver of the adapter",
                address=_short(address),
                reason=reason,
            )
        )
    number = cause.errno if isinstance(cause, OSError) else None
    if isinstance(cause, _REFUSED) and not isinstance(cause, OSError):
        return _refused(address, reason)
    if cause is not error and str(error) and str(error) != reason:
        reason = f"{error} ({reason})"
    remedy = _remedy(address, number)
    return ConnectFailed(
        tr(
            "cannot open the CAN bus {address}: interface {interface}, channel {channel!r:.80}: "
            "{reason}. Try: {try_this}",
            address=_short(address),
            interface=address.interface,
            channel=address.channel,
            reason=reason,
            try_this=remedy,
        )
    )


def _refused(address: CanAddress, reason: str) -> InvalidAddress:
    return InvalidAddress(
        tr(
            "{address}: interface {interface}, channel {channel!r:.80}: {reason}. Try: check the channel "
            "and the options of this interface in the documentation of python-can",
            address=_short(address),
            interface=address.interface,
            channel=address.channel,
            reason=reason,
        )
    )


def _remedy(address: CanAddress, number: int | None) -> str:
    if address.interface in _PORTS and number in _FORBIDDEN and sys.platform != "win32":
        return tr("join the group that owns the port (Linux: sudo usermod -aG dialout $USER) and log in again")
    if address.interface in _PORTS:
        return tr(
            "check that the adapter is plugged in, that the port name is right (can://slcan//dev/ttyACM0, "
            "can://slcan/COM3), and that no other program uses it"
        )
    if address.interface == "socketcan" and number in _ABSENT:
        return tr(
            "check that the adapter is plugged in, that its name is right (`ip link` lists the names), and that "
            "it is up (sudo ip link set {channel} up type can bitrate {bitrate})",
            channel=address.channel or "can0",
            bitrate=address.bitrate or 500000,
        )
    if address.interface == "socketcan":
        return tr(
            "check that the system supports CAN (Linux: sudo modprobe can_raw); without hardware, use can://udp_multicast/239.74.163.2"
        )
    if address.interface == "udp_multicast":
        return tr(
            "use a multicast address (239.74.163.2) and a free port (?port=43113), and check that the network supports multicast"
        )
    return tr("check that the adapter is plugged in, its driver is installed, and the channel is right")


def _short(address: CanAddress) -> str:
    return f"{address!s:.200}"
