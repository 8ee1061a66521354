"""Checks of numbers that programs pass as arguments: accepted types and ranges.

Any numeric type is accepted, also those of numpy; ``bool``, text and bytes are not. The arguments of CAO functions, which are
VARIANTs with return codes of their own, are converted in :mod:`orinkit.cao.coerce`.
"""

from __future__ import annotations

import math
import struct
from operator import index
from typing import Final, SupportsFloat, SupportsIndex

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

_SURELY_FINITE: Final = 1e300
_GREAT: Final = 10_000  # bits; Python may refuse to write a larger whole number in decimal
_SHOWN: Final = 40  # characters of a value that an error message quotes
_SINGLE: Final = struct.Struct("<f")


def brief(value: object) -> str:
    """Return any value in a short form for messages; never raises an exception."""
    try:
        text = f"{value:#x}" if isinstance(value, int) and value.bit_length() > _GREAT else repr(value)
    except Exception:  # noqa: BLE001 - a user's __repr__
        return f"<{type(value).__name__}>"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


# --- types ------------------------------------------------------------------------------------------------------------


def is_number(value: object) -> bool:
    """Return True for ``int`` and ``float``, but not for ``bool``."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def real(value: object) -> float | None:
    """Return a finite number of any numeric type as a ``float``, ``None`` for anything else."""
    if type(value) is float:  # fast path: the checks below take longer than the rest of a command
        return value if math.isfinite(value) else None
    if isinstance(value, bool | str | bytes) or not isinstance(value, SupportsFloat | SupportsIndex):
        return None
    try:
        number = float(value)
    except (OverflowError, TypeError, ValueError):  # an int of hundreds of digits, an array of several numbers
        return None
    return number if math.isfinite(number) else None


def whole(value: object) -> int | None:
    """Return a whole number of any integer type as an ``int``, ``None`` for anything else, including ``bool``."""
    if type(value) is int:  # fast path: the checks below are slow
        return value
    if isinstance(value, bool) or not isinstance(value, SupportsIndex):
        return None
    try:
        return index(value)
    except TypeError:  # numpy.bool
        return None


def rounded_to_single(number: float) -> float:
    """Return a number rounded to single precision (VT_R4).

    Raises:
        OverflowError: If it is too large.
    """
    rounded: float = _SINGLE.unpack(_SINGLE.pack(number))[0]
    return rounded


# --- checks -----------------------------------------------------------------------------------------------------------


def check_finite(name: str, value: object, owner: str = "") -> float:
    """Return a finite number as a ``float``.

    Args:
        name: Its name, for the message.
        value: The number.
        owner: What the number belongs to; precedes the name in the message.

    Raises:
        InvalidValue: If it is not a number, or NaN, infinite or too large.
    """
    if type(value) in (float, int) and -_SURELY_FINITE < value < _SURELY_FINITE:  # type: ignore[operator]  # fast path
        return float(value)  # type: ignore[arg-type]
    number = real(value)
    if number is None:
        raise InvalidValue(
            tr("{name} must be a finite number, not {value}", name=_full(name, owner), value=brief(value))
        )
    return number


def check_positive(name: str, value: object, owner: str = "") -> float:
    """Return a finite number above 0, see :func:`check_finite`.

    Raises:
        InvalidValue: If it is not a finite number, or not above 0.
    """
    number = check_finite(name, value, owner)
    if number <= 0:
        raise InvalidValue(
            tr("{name} must be greater than 0, not {value}", name=_full(name, owner), value=brief(value))
        )
    return number


def check_amount(name: str, value: object, most: float, owner: str = "") -> float:
    """Return a number above 0 and at most ``most``, see :func:`check_finite`.

    Raises:
        InvalidValue: If it is not a finite number, or out of this range.
    """
    number = check_finite(name, value, owner)
    if not 0 < number <= most:
        raise InvalidValue(
            tr(
                "{name} must be above 0 and at most {most:.10g}, not {value}",
                name=_full(name, owner),
                most=most,
                value=brief(value),
            )
        )
    return number


def check_seconds(name: str, value: object, longest: float = 3600.0) -> float:
    """Return a number of seconds above 0 and at most ``longest``.

    Raises:
        InvalidValue: If it is not a number, or out of this range.
    """
    number = real(value)
    if number is None or not 0 < number <= longest:
        raise InvalidValue(
            tr(
                "{name} must be a number of seconds above 0 and up to {longest:g}, not {seconds}",
                name=name,
                longest=longest,
                seconds=brief(value),
            )
        )
    return number


def check_range(name: str, value: object, least: float, most: float, unit: str = "") -> float:
    """Return a number of ``least`` to ``most``.

    Args:
        name: Its name, for the message.
        value: The number.
        least: The smallest allowed number.
        most: The largest allowed number.
        unit: The unit, for the message.

    Raises:
        InvalidValue: If it is not a number, or out of this range.
    """
    number = real(value)
    if number is None or not least <= number <= most:
        raise _out_of_range(name, value, f"{least:.10g}", f"{most:.10g} {unit}".rstrip())
    return number


def check_whole(name: str, value: object, most: int, least: int = 0) -> int:
    """Return a whole number of ``least`` to ``most``.

    Raises:
        InvalidValue: If it is not a whole number in this range.
    """
    number = whole(value)
    if number is None or not least <= number <= most:
        raise _out_of_range(name, value, str(least), str(most))
    return number


def _out_of_range(name: str, value: object, least: str, most: str) -> InvalidValue:
    return InvalidValue(
        tr("{name} must be {least} to {most}, not {value}", name=name, least=least, most=most, value=brief(value))
    )


def _full(name: str, owner: str) -> str:
    return f"{owner}: {name}" if owner else name
