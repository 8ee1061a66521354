"""Opening serial ports with serialx, for synchronous links and for asyncio."""

from __future__ import annotations

import errno
import os
import select
import sys
from io import FileIO
from typing import TYPE_CHECKING, Any, Final

from orinkit.core import optional_deps
from orinkit.core.errors import ConnectFailed, ConnectionLost
from orinkit.core.i18n import tr
from orinkit.transport.link_errors import lost
from orinkit.transport.serial.address import SerialAddress

if TYPE_CHECKING:
    import serialx

CHUNK: Final = 4096
_XON_XOFF: Final = 1
_HARDWARE: Final = 2
_ABSENT: Final = (errno.ENOENT, errno.ENODEV, errno.ENXIO)
_FORBIDDEN: Final = (errno.EACCES, errno.EPERM)
_TAKEN: Final = (errno.EBUSY, errno.EAGAIN)


def settings(address: SerialAddress) -> dict[str, Any]:
    """Return the arguments for serialx to open a port.

    Raises:
        MissingExtra: If serialx is not installed.
    """
    optional_deps.require(tr("a serial port"), "serial", "serialx")
    import serialx

    return {
        "baudrate": address.baudrate,
        "parity": serialx.Parity(address.parity),
        "byte_size": address.bits,
        "stopbits": serialx.StopBits(address.stop),
        "xonxoff": address.flow == _XON_XOFF,
        "rtscts": address.flow == _HARDWARE,
        "exclusive": True,
    }


def open_port(address: SerialAddress) -> serialx.BaseSerial:
    """Open a serial port for exclusive use; serialx discards bytes that were received before.

    Raises:
        ConnectFailed: If the port does not exist, access is denied, it is in use, or it does not support the settings.
        MissingExtra: If serialx is not installed.
    """
    chosen = settings(address)
    import serialx

    kind, _ = serialx.get_serial_classes("device://")
    try:
        port = kind(address.path, **chosen)
        port.open()
    except (OSError, ValueError, RuntimeError, serialx.SerialException) as error:
        raise open_failed(address, error) from error
    return port


def open_file(address: SerialAddress) -> FileIO:
    """Open a serial port, as :func:`open_port`, and return it as a non-blocking file."""
    port = open_port(address)
    try:
        return as_file(os.dup(port.fileno()))
    finally:
        port.close()


def as_file(descriptor: int) -> FileIO:
    """Return a non-blocking file for a descriptor."""
    os.set_blocking(descriptor, False)
    return FileIO(descriptor, "r+")


def is_gone(port: FileIO) -> bool:
    """Return True if a port has been removed.

    An empty read alone does not show this: it also occurs if no byte is available and the port is configured with
    VMIN = 0, which another process that has opened the port can do at any time.
    """
    poll = select.poll()
    poll.register(port, 0)  # POLLHUP, POLLERR and POLLNVAL are always reported
    return bool(poll.poll(0))


def open_failed(address: SerialAddress, error: BaseException) -> ConnectFailed:
    """Return the exception for a port that could not be opened."""
    reason = (os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)) or type(
        error
    ).__name__
    try_this = _what_to_try(address, error.errno if isinstance(error, OSError) else None)
    return ConnectFailed(
        tr(
            "cannot open the serial port {path}: {reason}. Try: {try_this}",
            path=address.path,
            reason=reason,
            try_this=try_this,
        )
    )


def _what_to_try(address: SerialAddress, number: int | None) -> str:
    if number in _ABSENT:
        return tr(
            "check that it is plugged in and that its name is right: usually /dev/ttyUSB0 or /dev/ttyACM0 on "
            "Linux, COM3 on Windows"
        )
    if number in _FORBIDDEN and sys.platform == "win32":
        return tr("close the program that uses it")
    if number in _FORBIDDEN:
        return tr("add the user to the group of the port (Linux: sudo usermod -aG dialout $USER) and log in again")
    if number in _TAKEN:
        return tr("close the program that uses it")
    return tr("check that it is a serial port and supports these settings: {address}", address=address)


def gone(reason: object) -> ConnectionLost:
    """Return the exception for a serial port that was removed or failed."""
    return lost(tr("the serial port failed ({reason})", reason=reason))
