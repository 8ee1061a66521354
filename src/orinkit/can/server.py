"""Devices on a CAN bus, beside an ordinary program: :func:`serve_can`. The rest is imported when something is served."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from orinkit.can.device import CanDevice as CanDevice
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    import can

DEFAULT_BUS: Final = "can://udp_multicast/239.74.163.2"
"""A bus without hardware that all programs of a network share."""

_JOIN: Final = 5.0  # s


class CanServer:
    """Devices on a bus, in a thread of their own; :func:`serve_can` makes one."""

    def __init__(self, devices: Iterable[CanDevice], at: str | can.BusABC) -> None:
        from orinkit.can.device_thread import ServedDevice, run
        from orinkit.can.reconnecting_bus import ReconnectingBus

        self._devices = [ServedDevice(device) for device in _checked(devices)]
        self._ending = threading.Event()
        self._wire = ReconnectingBus(_address(at) if isinstance(at, str) else at, self._ending)
        self._lock = threading.Lock()
        self._thread = threading.Thread(
            target=run, args=(tuple(self._devices), self._wire, self._ending), name="orinkit-can-server", daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        """Where the devices are: ``can://INTERFACE/CHANNEL``."""
        return self._wire.url

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the server is closed by another thread, the seconds have passed, or Ctrl-C is pressed.

        Ctrl-C ends the wait quietly, so that ``with serve_can(...) as server: server.wait()`` is a whole program.
        """
        try:
            self._thread.join(seconds)
        except KeyboardInterrupt:
            pass

    def close(self) -> None:
        """Leave the bus and close the devices; does nothing the second time."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN)
        with self._lock:
            devices, self._devices = self._devices, []
        self._wire.close()
        for device in devices:
            device.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve_can(*devices: CanDevice, at: str | can.BusABC = DEFAULT_BUS) -> CanServer:
    """Serve devices on a CAN bus beside the program until the server is closed; use it in a ``with`` statement.

    Args:
        devices: closed with the server.
        at: ``can://INTERFACE/CHANNEL?bitrate=500000&OPTION=VALUE``, as python-can names them, or a bus that is open
            already; nobody else may receive from that one, and it is not closed with the server.

    Raises:
        InvalidAddress: the URL cannot be used.
        InvalidValue: two devices have the same address.
        ConnectFailed: the bus cannot be opened.
        MissingExtra: python-can is not installed, or a package that the interface needs.
    """
    return CanServer(devices, at)


def _address(url: str) -> CanAddress:
    address = parse_address(url)
    if isinstance(address, CanAddress):
        return address
    raise InvalidAddress(tr("{url!r:.200} is no CAN bus. Example: {example}", url=url, example=DEFAULT_BUS))


def _checked(devices: Iterable[CanDevice]) -> list[CanDevice]:
    """Return devices that can be on one bus.

    Raises:
        InvalidValue: two have the same address.
    """
    found: dict[int, CanDevice] = {}
    for device in devices:
        if device.address in found:
            raise InvalidValue(
                tr("two devices have the address {address}: each one on a bus needs its own", address=device.address)
            )
        found[device.address] = device
    return list(found.values())
