"""Converts the values written by clients to the values of variables, without silent loss.

Clients write numbers as any numeric VARIANT, as a string or as a one-element array, and poses as arrays of any numeric
type. A type that cannot be converted raises DISP_E_TYPEMISMATCH. A number out of range raises DISP_E_OVERFLOW. A
fraction for a whole number, NaN, infinity, and an array of a wrong length raise E_INVALIDARG: the fraction is not
rounded, and the array is neither padded nor cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime
from typing import Final

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import rounded_to_single
from orinkit.values.conversions import to_datetime
from orinkit.values.types import ARRAY, INTEGERS, NUMERIC, REALS, VARIANT_ARRAY, VarType, type_name
from orinkit.values.variant import Variant

_NUMBERS: Final = NUMERIC | {int(VarType.BOOL), int(VarType.BSTR)}
_STRING_BYTES: Final = 255
_SHOWN: Final = 10**20  # larger numbers are not printed


def number(given: Variant) -> int | float:
    """Return a number from a numeric VARIANT, VT_BOOL (-1, 0), a string or a one-element array of these."""
    element = coerce.unwrap_single(given)
    if element.type not in _NUMBERS:
        raise _mismatch(given, tr("a number"))
    try:
        return coerce.to_number(element)
    except CallError as error:
        raise error_for(hresult.DISP_E_TYPEMISMATCH, error.detail) from None


def whole(given: Variant) -> int:
    """Return a whole number of any size."""
    value = number(given)
    if isinstance(value, float) and not value.is_integer():  # False for infinity and NaN as well
        raise error_for(hresult.E_INVALIDARG, tr("{value} is not a whole number", value=value))
    return int(value)


def whole_within(low: int, high: int) -> Callable[[Variant], int]:
    """Return a converter to a whole number from ``low`` to ``high``."""

    def convert(given: Variant) -> int:
        value = whole(given)
        if not low <= value <= high:
            raise _overflow(str(value) if abs(value) < _SHOWN else tr("the number"), low, high)
        return value

    return convert


_TRUTH: Final = whole_within(-1, 1)


def boolean(given: Variant) -> bool:
    """Return a boolean from VT_BOOL or a number -1, 0, 1."""
    return bool(_TRUTH(given))


def double(given: Variant) -> float:
    """Return a finite number of double precision."""
    value = number(given)
    try:
        return _finite(float(value))
    except OverflowError:
        raise _too_large("VT_R8") from None


def single(given: Variant) -> float:
    """Return a finite number, rounded to single precision."""
    return _single(double(given))


def singles(length: int) -> Callable[[Variant], tuple[float, ...]]:
    """Return a converter to a tuple of ``length`` numbers, rounded to single precision."""

    def convert(given: Variant) -> tuple[float, ...]:
        values = _elements(given)
        if len(values) != length:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("got {count} values, expected {length}", count=len(values), length=length),
            )
        return tuple(_single(_finite(value)) for value in values)

    return convert


def string(given: Variant) -> str:
    """Return a string of at most 255 bytes.

    The bytes are counted in Shift_JIS (code page 932), the encoding of Japanese controllers, so the string may have 127
    kanji. A character that Shift_JIS does not have counts as one byte. The string itself is not changed.

    Raises:
        CallError: DISP_E_TYPEMISMATCH; STRING_TOO_LONG.
    """
    element = coerce.unwrap_single(given)
    if element.type != VarType.BSTR:
        raise _mismatch(given, "VT_BSTR")
    text = str(element.value)
    # If the string has more than 255 characters, it is too long in any encoding.
    length = len(text) if len(text) > _STRING_BYTES else len(text.encode("cp932", "replace"))
    if length > _STRING_BYTES:
        raise error_for(hresult.STRING_TOO_LONG, tr("the string has {length} bytes", length=length))
    return text


def moment(given: Variant) -> datetime:
    """Return a local date and time from VT_DATE."""
    element = coerce.unwrap_single(given)
    if element.type != VarType.DATE:
        raise _mismatch(given, "VT_DATE")
    value = to_datetime(element.value)
    if not isinstance(value, datetime):
        raise error_for(hresult.E_INVALIDARG, tr("{value} days is not a valid date", value=value))
    return value


def _elements(given: Variant) -> list[float]:
    base = given.type & ~ARRAY
    if given.type & ARRAY and base in REALS:
        return list(given.value)
    if given.type == VARIANT_ARRAY:
        return [double(element) for element in given.value]
    if given.type & ARRAY and base in INTEGERS:
        return [float(element) for element in given.value]
    raise _mismatch(given, tr("an array of VT_R4"))


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise error_for(hresult.E_INVALIDARG, tr("{value} is not a finite number", value=value))
    return value


def _single(value: float) -> float:
    try:
        return rounded_to_single(value)
    except OverflowError:
        raise _too_large("VT_R4") from None


def _mismatch(given: Variant, wanted: str) -> CallError:
    return error_for(
        hresult.DISP_E_TYPEMISMATCH,
        tr("got {type}, expected {wanted}", type=type_name(given.type), wanted=wanted),
    )


def _overflow(shown: str, low: int, high: int) -> CallError:
    return error_for(
        hresult.DISP_E_OVERFLOW,
        tr("{shown} is out of range; expected {low} to {high}", shown=shown, low=low, high=high),
    )


def _too_large(wanted: str) -> CallError:
    return error_for(hresult.DISP_E_OVERFLOW, tr("the number does not fit {wanted}", wanted=wanted))
