"""Numbers, dates and flags as text, for :mod:`orinkit.values.notation` (e-CAP 3.5)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import datetime
from decimal import Context, Decimal
from functools import partial
from math import isinf, isnan
from typing import Any, Final

from orinkit.core.i18n import N_, tr
from orinkit.core.record import EMPTY, record
from orinkit.core.validation import rounded_to_single

LONGEST: Final = 1100
"""Largest number of characters of a number; the longest exact decimal form of a double has 1,077."""


@record
class ElementFormat:
    """The text form of one element of a type.

    Attributes:
        read: Function that parses a text; it returns ``None`` if the text is not valid.
        write: Function that formats a value.
        description: Message that describes valid texts.
        bounds: Values of the placeholders in ``description``, by name.
    """

    read: Callable[[str], Any]
    write: Callable[[Any], str]
    description: str
    bounds: Mapping[str, int] = EMPTY

    @property
    def wanted(self) -> str:
        """Description of valid texts in the current language."""
        return tr(self.description, **self.bounds)


WHOLE: Final = re.compile(r"[+-]?(?:[0-9]+|(0[xX][0-9a-fA-F]+))")
REAL: Final = re.compile(
    r"[+-]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|(inf(?:inity)?|nan))", re.IGNORECASE | re.ASCII
)
_AMOUNT: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]{0,4}0*)?|\.[0-9]{1,4}0*)")
_MOMENT: Final = re.compile(
    r"([0-9]{4})([-/])([0-9]{1,2})\2([0-9]{1,2})(?:[ T]+([0-9]{1,2}):([0-9]{2})(?::([0-9]{2})(?:\.([0-9]{1,6}))?)?)?"
)
FLAGS: Final = {"-1": True, "1": True, "true": True, "0": False, "false": False}
_SMALLEST_NORMAL_SINGLE: Final = 2.0**-126
_MAX_AMOUNT: Final = 2**63
_DECIMALS: Final = Context(prec=28)


def _read_whole(low: int, high: int, text: str) -> int | None:
    match = WHOLE.fullmatch(text)
    if not match:
        return None
    number = int(text, 16 if match[1] else 10)
    return number if low <= number <= high else None


def _read_error(text: str) -> int | None:
    number = _read_whole(-(2**31), 2**32 - 1, text)
    return None if number is None else number & 0xFFFFFFFF


def _read_real(text: str) -> float | None:
    match = REAL.fullmatch(text)
    if not match:
        return None
    number = float(text)
    return None if isinf(number) and not match[1] else number


def _read_single(text: str) -> float | None:
    number = _read_real(text)
    if number is None:
        return None
    try:
        return _to_single(number)
    except OverflowError:
        return None


def _read_amount(text: str) -> Decimal | None:
    if not _AMOUNT.fullmatch(text):
        return None
    amount = Decimal(text)
    return amount if -_MAX_AMOUNT <= _DECIMALS.multiply(amount, 10000) < _MAX_AMOUNT else None


def _read_moment(text: str) -> datetime | float | None:
    match = _MOMENT.fullmatch(text)
    if not match:
        return _read_real(text)
    year, _, month, day, hour, minute, second, fraction = match.groups(default="0")
    try:
        us = int(fraction.ljust(6, "0"))
        return datetime(int(year), int(month), int(day), int(hour), int(minute), int(second), us)
    except ValueError:
        return None


def _to_single(number: float) -> float:
    single = rounded_to_single(number)
    return float(single)


def _write_real(number: float) -> str:
    return repr(float(number)).removesuffix(".0")


def _write_single(number: float) -> str:
    """Return the shortest text that is parsed as the same single-precision number."""
    single = _to_single(number)
    if isinf(single) or isnan(single):
        return _write_real(single)
    # For a normal number, the search may begin with six digits, because "g" omits trailing zeros.
    minimum = 6 if abs(single) >= _SMALLEST_NORMAL_SINGLE else 1
    shortest = next(
        near for near in (float(f"{single:.{digits}g}") for digits in range(minimum, 10)) if _to_single(near) == single
    )
    return _write_real(shortest)


def _write_amount(amount: Decimal) -> str:
    return f"{amount.normalize(_DECIMALS):f}"


def _write_moment(moment: datetime | float) -> str:
    return moment.isoformat(sep=" ") if isinstance(moment, datetime) else _write_real(moment)


def _write_error(code: int) -> str:
    return f"0x{code:08X}"


def _read_flag(text: str) -> bool | None:
    return FLAGS.get(text.lower())


def _write_flag(flag: bool) -> str:
    return "-1" if flag else "0"


def whole(low: int, high: int) -> ElementFormat:
    """Return the text form of whole numbers within bounds."""
    return ElementFormat(
        partial(_read_whole, low, high), str, N_("a whole number from {low} to {high}"), {"low": low, "high": high}
    )


SINGLE: Final = ElementFormat(_read_single, _write_single, N_("a number in the range of single precision"))
DOUBLE: Final = ElementFormat(_read_real, _write_real, N_("a number in the range of double precision"))
AMOUNT: Final = ElementFormat(
    _read_amount,
    _write_amount,
    N_("an amount with up to four decimals, -922337203685477.5808 to 922337203685477.5807"),
)
MOMENT: Final = ElementFormat(_read_moment, _write_moment, N_("a date like 2026-11-21 10:00:00 or a number of days"))
ERROR: Final = ElementFormat(_read_error, _write_error, N_("a 32-bit code, decimal or 0x hexadecimal"))
FLAG: Final = ElementFormat(_read_flag, _write_flag, N_("True, 1, -1, False or 0"))
