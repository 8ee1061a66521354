"""The ``alive`` option: the time that a connectionless client may be silent while its motions run.

:mod:`orinkit.server.liveness` applies it.
"""

from __future__ import annotations

from typing import Final

from orinkit.core.validation import check_range

ALIVE: Final = 2.0
"""Seconds of silence after which a connectionless client whose motions run is disconnected."""

_LEAST: Final = 0.5
_MOST: Final = 3600.0


def check_alive(seconds: float) -> float:
    """Check the value of the ``alive`` option, s, and return it as a float.

    Raises:
        InvalidValue: If the value is not a number from 0.5 to 3,600.
    """
    return check_range("alive", seconds, _LEAST, _MOST, seconds=True)
