"""How long a client without a connection may be silent while its motions run; :mod:`orinkit.server.vigil` watches."""

from __future__ import annotations

from typing import Final

from orinkit.errors import InvalidValue
from orinkit.language import pick

ALIVE: Final = 2.0
"""Seconds of silence after which a client without a connection is taken to have gone whose motions run."""

_LEAST: Final = 0.5
_MOST: Final = 3600.0


def check_alive(seconds: float) -> float:
    """Return the seconds that a client without a connection may be silent while its motions run.

    Raises:
        InvalidValue: it is no number from 0.5 to 3,600.
    """
    given: object = seconds
    if isinstance(given, bool) or not isinstance(given, int | float) or not _LEAST <= given <= _MOST:
        raise InvalidValue(
            pick(
                f"alive must be {_LEAST:g} to {_MOST:g} seconds, not {given!r:.40}",
                f"alive は {_LEAST:g}～{_MOST:g} 秒でなければなりません ({given!r:.40})",
            )
        )
    return float(given)
