"""Synchronous serial ports through serialx, for systems on which a port is not a file (Windows)."""

from __future__ import annotations

import threading
from time import monotonic
from typing import TYPE_CHECKING, Final

from orinkit.core.errors import TransportError
from orinkit.transport.link_errors import closed
from orinkit.transport.serial.settings import CHUNK, gone

if TYPE_CHECKING:
    import serialx

_SLICE: Final = 0.05  # s within which a read detects that the port was closed


class PortLink:
    """A serial port through serialx, used from the caller's thread.

    Args:
        port: The open port; the link owns it.
    """

    def __init__(self, port: serialx.BaseSerial) -> None:
        self._port = port
        self._open = True
        self._using = threading.RLock()

    def fileno(self) -> int:
        """Return the system's descriptor of the port."""
        if not self._open:
            raise closed()
        return self._port.fileno()

    def send(self, data: bytes, seconds: float) -> None:
        """Send bytes, as :meth:`SerialLink.send`."""
        with self._using:
            try:
                self._port.write(data, timeout=seconds)
            except TimeoutError:
                pass
            except Exception as error:
                raise self._broken(error) from error

    def receive(self, seconds: float) -> bytes | None:
        """Receive bytes, as :meth:`SerialLink.receive`."""
        end = monotonic() + seconds
        buffer = bytearray(CHUNK)
        while True:
            left = max(0.0, end - monotonic())
            with self._using:
                try:
                    count = self._port.readinto(buffer, timeout=min(left, _SLICE))
                except Exception as error:
                    raise self._broken(error) from error
            if count:
                return bytes(buffer[:count])
            if not left:
                return None

    def _broken(self, error: Exception) -> TransportError:
        was_open = self._open
        self.close()
        return gone(error) if was_open else closed()

    def close_local(self) -> None:
        """Close the link, as :meth:`close`."""
        self.close()

    def close(self) -> None:
        """Close the link; a receive pending in another thread ends within 50 ms."""
        self._open = False
        with self._using:
            self._port.close()
