"""Checks of numbers that programs pass as arguments: accepted types and ranges.

All numeric types are accepted, including those of numpy; ``bool``, text and bytes are refused. The arguments of CAO
functions are not checked here but in :mod:`orinkit.cao.coerce`: they are VARIANTs, and invalid ones result in return
codes.
"""

from __future__ import annotations

import math
import struct
from operator import index
from typing import Final, SupportsFloat, SupportsIndex

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

_SURELY_FINITE: Final = 1e300
_GREAT: Final = 10_000  # bits of a whole number; Python may refuse to convert a larger one to decimal digits
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
        OverflowError: If the number is too large.
    """
    rounded: float = _SINGLE.unpack(_SINGLE.pack(number))[0]
    return rounded


# --- checks -----------------------------------------------------------------------------------------------------------


def check_finite(name: str, value: object, owner: str = "") -> float:
    """Return a finite number as a ``float``.

    Args:
        name: Name of the number, for the message.
        value: The number.
        owner: The object or function that the number belongs to; precedes the name in the message.

    Raises:
        InvalidValue: If the value is not a number, or is NaN, infinite or too large for a ``float``.
    """
    # the fast path; mypy does not narrow by type(value), and isinstance would accept True
    if type(value) in (float, int) and -_SURELY_FINITE < value < _SURELY_FINITE:  # type: ignore[operator]  # see above
        return float(value)  # type: ignore[arg-type]  # see above
    number = real(value)
    if number is None:
        raise InvalidValue(
            tr("{name} must be a finite number, not {value}", name=_full(name, owner), value=brief(value))
        )
    return number


def check_positive(name: str, value: object, owner: str = "") -> float:
    """Return a finite number above 0, see :func:`check_finite`.

    Raises:
        InvalidValue: If the value is not a finite number above 0.
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
        InvalidValue: If the value is not a finite number in this range.
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
        InvalidValue: If the value is not a number in this range.
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


def check_range(name: str, value: object, least: float, most: float, *, seconds: bool = False) -> float:
    """Return a number from ``least`` to ``most``.

    Args:
        name: Name of the number, for the message.
        value: The number.
        least: The smallest allowed number.
        most: The largest allowed number.
        seconds: True if the number is a time in s, for the message.

    Raises:
        InvalidValue: If the value is not a number in this range.
    """
    number = real(value)
    if number is not None and least <= number <= most:
        return number
    if seconds:
        raise InvalidValue(
            tr(
                "{name} must be {least:.10g} to {most:.10g} s, not {value}",
                name=name,
                least=least,
                most=most,
                value=brief(value),
            )
        )
    raise _out_of_range(name, value, f"{least:.10g}", f"{most:.10g}")


def check_whole(name: str, value: object, most: int, least: int = 0) -> int:
    """Return a whole number from ``least`` to ``most``.

    Raises:
        InvalidValue: If the value is not a whole number in this range.
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
