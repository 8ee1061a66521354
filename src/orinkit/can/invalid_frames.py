"""The log of objects that a device sent although they are not CAN frames: :class:`InvalidFrameLog`."""

from __future__ import annotations

import logging
from time import monotonic
from typing import Final

_log = logging.getLogger("orinkit.server")
_QUIET: Final = 1.0  # s between two logged invalid frames


class InvalidFrameLog:
    """Logs invalid frames, at most one per second."""

    def __init__(self) -> None:
        self._quiet_until = 0.0

    def add(self, url: str, frame: object, error: Exception) -> None:
        """Log an invalid frame.

        Args:
            url: Address of the bus.
            frame: The object that the device returned.
            error: The reason why it is not valid.
        """
        if monotonic() >= self._quiet_until:
            _log.error("%s: a device sent %.80r, which is not a CAN frame: %s", url, frame, error)
            self._quiet_until = monotonic() + _QUIET
