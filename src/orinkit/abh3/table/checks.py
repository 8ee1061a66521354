"""Numbers that programs give: whatever kind they are of, and whether they can be used."""

from __future__ import annotations

import math
from operator import index
from typing import Final, SupportsFloat, SupportsIndex

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief

_LONGEST: Final = 3600.0


def real(value: object) -> float | None:
    """Return a finite number of whatever kind as a float; ``None`` of anything else."""
    if type(value) is float:  # to ask whether it is any other kind takes longer than all the rest of a command
        return value if math.isfinite(value) else None
    if isinstance(value, bool | str | bytes) or not isinstance(value, SupportsFloat):
        return None
    try:
        number = float(value)
    except (OverflowError, TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def whole(value: object) -> int | None:
    """Return a whole number of whatever kind as an ``int``; ``None`` of anything else, of bool too."""
    if type(value) is int:  # nearly always; the next question takes long
        return value
    if isinstance(value, bool) or not isinstance(value, SupportsIndex):
        return None
    try:
        return index(value)
    except TypeError:  # a bool of numpy
        return None


def checked(name: str, number: object, highest: int) -> int:
    """Return a whole number of 0 to ``highest``.

    Raises:
        InvalidValue: it is none.
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
        InvalidValue: it is none above 0, or more than an hour.
    """
    number = real(seconds)
    if number is None or not 0 < number <= _LONGEST:
        raise InvalidValue(
            tr(
                "{name} is a number of seconds above 0 and up to {longest:g}, not {seconds}",
                name=name,
                longest=_LONGEST,
                seconds=brief(seconds),
            )
        )
    return number
