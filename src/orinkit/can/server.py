"""Serve devices on a CAN bus from a thread: :func:`serve_can`. Other modules are imported when it is called."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from orinkit.can.device import CanDevice as CanDevice
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.thread_server import ThreadServer
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    import can

DEFAULT_BUS: Final = "can://udp_multicast/239.74.163.2"
"""A bus without hardware, shared by all programs of a network."""
PSEUDO_TERMINAL: Final = "pty://"
"""A bus of one program on this machine, which opens it as an slcan adapter; see :attr:`CanServer.url`."""

_JOIN: Final = 5.0  # s


class CanServer(ThreadServer):
    """Devices on a bus, served from a thread; created by :func:`serve_can`."""

    def __init__(self, devices: Iterable[CanDevice], at: str | can.BusABC) -> None:
        from orinkit.can.device_thread import IsolatedDevice, run
        from orinkit.can.pseudo_terminal import PseudoTerminalBus
        from orinkit.can.reconnecting_bus import ReconnectingBus

        self._devices = [IsolatedDevice(device) for device in _checked(devices)]
        self._ending = threading.Event()
        self._wire: ReconnectingBus | PseudoTerminalBus
        if at == PSEUDO_TERMINAL:
            self._wire = PseudoTerminalBus()
        else:
            self._wire = ReconnectingBus(_address(at) if isinstance(at, str) else at, self._ending)
        self._lock = threading.Lock()
        self._thread = threading.Thread(
            target=run, args=(tuple(self._devices), self._wire, self._ending), name="orinkit-can-server", daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the bus, for programs that connect to it: ``can://INTERFACE/CHANNEL``."""
        return self._wire.url

    def close(self) -> None:
        """Close the bus and the devices. May be called again."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN)
        with self._lock:
            devices, self._devices = self._devices, []
        self._wire.close()
        for device in devices:
            device.close()


def serve_can(*devices: CanDevice, at: str | can.BusABC = DEFAULT_BUS) -> CanServer:
    """Serve devices on a CAN bus from a thread until the server is closed; use it in a ``with`` statement.

    Args:
        devices: The devices; they are closed with the server.
        at: ``can://INTERFACE/CHANNEL?bitrate=500000&OPTION=VALUE``, in which the names are those of python-can;
            ``pty://`` for a new pseudo-terminal, which one program of this user can open as an slcan adapter; or an
            open python-can bus, which the server does not close, and from which nothing else may receive.

    Raises:
        InvalidAddress: If the URL is not valid.
        InvalidValue: If two devices have the same address.
        ConnectFailed: If the bus cannot be opened.
        MissingExtra: If python-can, or a package that the interface requires, is not installed.
    """
    return CanServer(devices, at)


def _address(url: str) -> CanAddress:
    address = parse_address(url)
    if isinstance(address, CanAddress):
        return address
    raise InvalidAddress(
        tr("{url!r:.200} is not the address of a CAN bus. Example: {example}", url=url, example=DEFAULT_BUS)
    )


def _checked(devices: Iterable[CanDevice]) -> list[CanDevice]:
    """Check that the devices can share a bus, and return them.

    Raises:
        InvalidValue: If two devices have the same address.
    """
    found: dict[int, CanDevice] = {}
    for device in devices:
        if device.address in found:
            raise InvalidValue(
                tr("two devices have the address {address}: addresses on a bus must be unique", address=device.address)
            )
        found[device.address] = device
    return list(found.values())
