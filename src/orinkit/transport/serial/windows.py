"""Serial ports through the reads and writes of serialx, for systems where a port is no file (Windows)."""

from __future__ import annotations

import threading
from time import monotonic
from typing import TYPE_CHECKING, Final

from orinkit.core.errors import TransportError
from orinkit.transport.link_errors import closed
from orinkit.transport.serial.settings import CHUNK, gone

if TYPE_CHECKING:
    import serialx

_SLICE: Final = 0.05  # s after which a read finds that the port was closed


class PortLink:
    """A serial port through serialx, used by the thread that calls; a wait finds that it was closed a little later.

    Args:
        port: is open, and this link's from then on.
    """

    def __init__(self, port: serialx.BaseSerial) -> None:
        self._port = port
        self._open = True
        self._using = threading.RLock()

    def fileno(self) -> int:
        """What the system knows the port by."""
        if not self._open:
            raise closed()
        return self._port.fileno()

    def send(self, data: bytes, seconds: float) -> None:
        """Send, as :meth:`SerialLink.send`."""
        with self._using:
            try:
                self._port.write(data, timeout=seconds)
            except TimeoutError:
                pass
            except Exception as error:
                raise self._broken(error) from error

    def receive(self, seconds: float) -> bytes | None:
        """Receive, as :meth:`SerialLink.receive`."""
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

    def release(self) -> None:
        """Close, as :meth:`close`."""
        self.close()

    def close(self) -> None:
        """Close; a receive that another thread is in ends soon."""
        self._open = False
        with self._using:
            self._port.close()
