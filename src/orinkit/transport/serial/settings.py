"""Opening a serial port with serialx, for links on the caller's own thread and in asyncio."""

from __future__ import annotations

import errno
import os
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
    """Return what serialx is to be told of a port.

    Raises:
        MissingExtra: it is not installed.
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
    """Open a serial port, for this program alone; serialx throws away what waits in it from before.

    Raises:
        ConnectFailed: it is not there, may not be used, is in use, or cannot be set like this.
        MissingExtra: serialx is missing.
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
    """Open a serial port as a file that does not block, as :func:`open_port`."""
    port = open_port(address)
    try:
        return as_file(os.dup(port.fileno()))
    finally:
        port.close()


def as_file(descriptor: int) -> FileIO:
    """Return a file that has a descriptor and does not block."""
    os.set_blocking(descriptor, False)
    return FileIO(descriptor, "r+")


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
            "is it plugged in, and is that its name? In Linux most are /dev/ttyUSB0 or /dev/ttyACM0, in Windows COM3"
        )
    if number in _FORBIDDEN and sys.platform == "win32":
        return tr("close the other program that uses it")
    if number in _FORBIDDEN:
        return tr("become a member of the group of the port (Linux: sudo usermod -aG dialout $USER) and log in again")
    if number in _TAKEN:
        return tr("close the other program that uses it")
    return tr("is it a serial port, and can it be set like this: {address}", address=address)


def gone(reason: object) -> ConnectionLost:
    """Return the exception for a port that cannot be used any more."""
    return lost(tr("the serial port is gone ({reason})", reason=reason))
