"""Conversion of arguments, as real clients send them, to the types of the functions (docs/protocol.md lists the forms).

Clients send the same argument in several forms: a whole number as VT_I2, VT_I4, VT_R4, VT_R8 or text, a scalar as an
array of one element, an empty string as VT_EMPTY, and a pose in single precision. Only this module converts them.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.values.conversions import CY_CONTEXT
from orinkit.values.types import ARRAY, EMPTIES, INTEGERS, SIZES, TABLE, VarType, type_name
from orinkit.values.variant import Variant, innermost

_NUMBER: Final = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(inf|nan)", re.IGNORECASE)
_NUMBERS: Final = frozenset(
    int(row.code) for row in TABLE if row.number_kind
)  # includes VT_ERROR, because a return code is a number
_HANDLES: Final = frozenset(vt for vt in INTEGERS if SIZES[vt] in (2, 4))
_LONGEST: Final = 4400  # limit on the characters of a number; int() reads at most 4,300 digits


def wrong_type(given: Variant, wanted: str) -> CallError:
    """Return the exception for an argument of the wrong type."""
    return error_for(
        hresult.E_INVALIDARGTYPE,
        tr("got {type}, expected {wanted}", type=type_name(given.type), wanted=wanted),
    )


def unwrap_single(given: Variant) -> Variant:
    """Return the element of a one-element array, or the value in a VT_VARIANT, or any other value unchanged.

    The elements of longer arrays are not inspected, because this takes long for large ones.
    """
    given = innermost(given)
    if given.type & ARRAY and len(given.value) == 1:
        element = given.value[0]
        return innermost(element) if isinstance(element, Variant) else Variant(given.type & ~ARRAY, element)
    return given


def to_number(given: Variant) -> float | int:
    """Return a number from any numeric type, VT_BOOL (-1 for True, 0 for False), or text."""
    given = unwrap_single(given)
    value = given.value
    if given.type == VarType.BOOL:
        return -1 if value else 0
    if isinstance(value, str):
        try:
            return _number_in(value)
        except ValueError:
            raise wrong_type(given, tr("a number, not {value}", value=quoted(value))) from None
    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value(context=CY_CONTEXT) else float(value)
    if given.type in _NUMBERS:
        number: int | float = value
        return number
    raise wrong_type(given, tr("a number"))


def _number_in(text: str) -> float | int:
    if len(text) > _LONGEST:
        raise ValueError(text[:_LONGEST])
    text = text.strip()
    if _NUMBER.fullmatch(text) is None:  # float() accepts more than controllers do: 1_0, full-width digits
        raise ValueError(text)
    try:
        return int(text, 10)
    except ValueError:
        if text.lstrip("+-").isdecimal():
            raise  # the number has more digits than int() reads
        return float(text)


def to_integer(given: Variant) -> int:
    """Return a whole number in the range of VT_I4.

    Raises:
        CallError: E_INVALIDARGTYPE if the value is not a number, E_INVALIDARG if it is a fraction or out of range.
    """
    number = to_number(given)
    if number != number or number in (float("inf"), float("-inf")) or number != int(number):
        raise error_for(hresult.E_INVALIDARG, tr("{number} is not a whole number", number=number))
    if not -(2**31) <= number < 2**31:
        raise error_for(hresult.E_INVALIDARG, tr("{number!s:.40} is out of range", number=number))
    return int(number)


def to_handle(given: Variant) -> int:
    """Return a handle, which some clients send as a whole number of 4 bytes, and others in 2 bytes."""
    if given.type in _HANDLES:
        return int(given.value)
    raise wrong_type(given, "VT_I4")


def to_real(given: Variant) -> float:
    """Return a number as ``float``; NaN and infinity are refused (E_INVALIDARG)."""
    try:
        number = float(to_number(given))
    except OverflowError:  # text with hundreds of digits
        number = float("inf")
    if number != number or number in (float("inf"), float("-inf")):
        raise error_for(hresult.E_INVALIDARG, tr("{number} is not a finite number", number=number))
    return number


def to_text(given: Variant) -> str:
    """Return text; for VT_EMPTY and VT_NULL the empty string."""
    given = unwrap_single(given)
    if given.type == VarType.BSTR:
        return str(given.value)
    if given.type in EMPTIES:
        return ""
    raise wrong_type(given, "VT_BSTR")


def to_values(given: Variant) -> list[Any]:
    """Return a list of plain values: the elements of an array, or one value; ``[]`` for VT_EMPTY and VT_NULL."""
    given = innermost(given)
    if given.type in EMPTIES:
        return []
    plain = given.plain
    return list(plain) if given.type & ARRAY else [plain]
