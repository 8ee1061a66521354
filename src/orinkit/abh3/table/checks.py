"""Checks of numbers passed by programs: accepted types and ranges."""

from __future__ import annotations

import math
from operator import index
from typing import Final, SupportsFloat, SupportsIndex

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief

_LONGEST: Final = 3600.0


def real(value: object) -> float | None:
    """Return a finite number of any numeric type as a ``float``, ``None`` for anything else."""
    if type(value) is float:  # fast path: the checks below take longer than the rest of a command
        return value if math.isfinite(value) else None
    if isinstance(value, bool | str | bytes) or not isinstance(value, SupportsFloat):
        return None
    try:
        number = float(value)
    except (OverflowError, TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def whole(value: object) -> int | None:
    """Return a whole number of any integer type as an ``int``, ``None`` for anything else, including bool."""
    if type(value) is int:  # fast path: the checks below are slow
        return value
    if isinstance(value, bool) or not isinstance(value, SupportsIndex):
        return None
    try:
        return index(value)
    except TypeError:  # numpy.bool
        return None


def checked(name: str, number: object, highest: int) -> int:
    """Return a whole number of 0 to ``highest``.

    Raises:
        InvalidValue: If it is not a whole number in this range.
    """
    found = whole(number)
    if found is not None and 0 <= found <= highest:
        return found
    raise InvalidValue(
        tr("{name} must be 0 to {highest}, not {number}", name=name, highest=highest, number=brief(number))
    )


def check_seconds(name: str, seconds: float) -> float:
    """Return a number of seconds.

    Raises:
        InvalidValue: If it is not a number above 0, or exceeds an hour.
    """
    number = real(seconds)
    if number is None or not 0 < number <= _LONGEST:
        raise InvalidValue(
            tr(
                "{name} must be a number of seconds above 0 and up to {longest:g}, not {seconds}",
                name=name,
                longest=_LONGEST,
                seconds=brief(seconds),
            )
        )
    return number
