"""Conversion functions for VARIANT types; the table of the types refers to them in its columns.

They convert Python values to the content that a :class:`~orinkit.values.variant.Variant` of a type stores. They also
convert this content to the numbers in packets, and these numbers back to the content.

Functions that check a value receive the row of the type and the value. They return the content or raise InvalidValue.
"""

from __future__ import annotations

import math
import operator
import struct
from datetime import datetime, timedelta
from decimal import Context, Decimal
from typing import Any, Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.type_row import TypeRow, shown

CY_CONTEXT: Final = Context(prec=40, traps=[])
"""Context of all arithmetic with VT_CY. The decimal context of the caller is not used: it may round or raise errors."""
_CY_STEP: Final = Decimal("0.0001")
_EPOCH: Final = datetime(1899, 12, 30)
_DAY_US: Final = 86_400_000_000


# --- a Python value -> the content of a type --------------------------------------------------------------------------


def nothing(row: TypeRow, value: Any) -> None:
    """Return ``None``; raise InvalidValue for any other value."""
    if value is not None:
        raise row.misfit(value)


def any_variant(row: TypeRow, value: Any) -> Any:
    """Not called: :func:`orinkit.values.variant.variant` converts the value of a VT_VARIANT."""
    raise AssertionError(row, value)


def integer(row: TypeRow, value: Any) -> int:
    """Return a whole number within the bounds of the type; a float without a fraction is accepted."""
    return _within(row, _whole(row, value))


def code(row: TypeRow, value: Any) -> int:
    """Return a 32-bit code as an unsigned number; a negative number is converted to its two's complement."""
    number = _whole(row, value)
    return _within(row, number + 2**32 if -(2**31) <= number < 0 else number)


def _whole(row: TypeRow, value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        if not isinstance(value, float) or not value.is_integer():
            raise row.misfit(value) from None
        return int(value)


def _within(row: TypeRow, number: int) -> int:
    assert row.bounds is not None
    low, high = row.bounds
    if not low <= number <= high:
        raise row.misfit(number)
    return number


def real(row: TypeRow, value: Any) -> float:
    """Return a number as a ``float`` of double precision."""
    if isinstance(value, bool | str | bytes | bytearray | memoryview):
        raise row.misfit(value)
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise row.misfit(value) from None
    if math.isinf(number) and number != value:  # float(Decimal("1E+999")) is inf and raises no error
        raise row.misfit(value)
    return number


def single(row: TypeRow, value: Any) -> float:
    """Return a number within the range of single precision; it is rounded when it is encoded."""
    number = real(row, value)
    try:
        struct.pack("<f", number)
    except OverflowError:
        raise row.misfit(value) from None
    return number


def boolean(row: TypeRow, value: Any) -> bool:
    """Return the truth value of a number or of a numpy scalar."""
    if isinstance(value, int | float) or (getattr(value, "ndim", None) == 0 and not isinstance(value, str)):
        return bool(value)
    raise row.misfit(value)


def string(row: TypeRow, value: Any) -> str:
    """Return a string as a plain ``str``, even if it is of a subclass."""
    if not isinstance(value, str):
        raise row.misfit(value)
    return str.__str__(value)  # str() would return the name of a member of an Enum, not its value


def currency(row: TypeRow, value: Any) -> Decimal:
    """Return an amount of money (VT_CY) with at most four decimals, from a Decimal or a whole number."""
    if isinstance(value, bool | float | str | bytes) or not isinstance(value, Decimal | int):
        raise row.misfit(value)
    amount = Decimal(value)
    if amount.is_finite() and (not amount or amount.adjusted() < 15):
        rounded = amount.quantize(_CY_STEP, context=CY_CONTEXT)
        if rounded == amount and -(2**63) <= rounded.scaleb(4, CY_CONTEXT) < 2**63:
            return amount
    raise InvalidValue(
        tr(
            "{shown} does not fit VT_CY: at most four decimals, -922337203685477.5808 to 922337203685477.5807",
            shown=shown(value),
        )
    )


def date(row: TypeRow, value: Any) -> datetime | float:
    """Return the content of a VT_DATE: a ``datetime`` in local time, or a number of OLE days."""
    if isinstance(value, datetime):
        try:
            return value if value.tzinfo is None else value.astimezone().replace(tzinfo=None)
        except (OverflowError, ValueError, OSError):  # the local time is before the year 1 or after 9999
            raise row.misfit(value) from None
    return real(row, value)


# --- content -> values that struct packs, and back --------------------------------------------------------------------


def flag_to_wire(flag: bool) -> int:
    """Return -1 for True, because VARIANT_TRUE has all bits set, and 0 for False."""
    return -1 if flag else 0


def amount_to_wire(amount: Decimal) -> int:
    """Return an amount of money (VT_CY) as a number of ten-thousandths, as packets contain it."""
    return int(amount.scaleb(4, CY_CONTEXT))


def amount_from_wire(units: int) -> Decimal:
    """Return an amount of money (VT_CY) from the number of ten-thousandths in a packet."""
    return Decimal(units).scaleb(-4, CY_CONTEXT)


def date_to_wire(moment: datetime | float) -> float:
    """Return the content of a VT_DATE as OLE days."""
    return ole_days(moment) if isinstance(moment, datetime) else moment


# --- VT_DATE ----------------------------------------------------------------------------------------------------------


def ole_days(moment: datetime) -> float:
    """Return a local time as OLE days: the days since 1899-12-30, plus the time of day as a fraction of a day.

    Before 1899-12-30, the number of days is negative, and the fraction is subtracted from it.
    """
    us = (moment - _EPOCH) // timedelta(microseconds=1)
    if us >= 0:
        return us / _DAY_US
    day, rest = divmod(us, _DAY_US)
    return (day * _DAY_US - rest) / _DAY_US


def ole_datetime(days: float) -> datetime:
    """Return OLE days as local time, rounded to a microsecond.

    Raises:
        OverflowError: If the result is outside the years 1 to 9999, or ``days`` is infinite or NaN.
    """
    if days != days:
        raise OverflowError("NaN")
    top, bottom = abs(days).as_integer_ratio()
    whole, part = divmod(top, bottom)
    us = (part * _DAY_US * 2 + bottom) // (
        2 * bottom
    )  # computed exactly and rounded half up; a product of doubles would not be exact to a microsecond
    return _EPOCH + timedelta(days=whole if days >= 0 else -whole, microseconds=us)


def to_datetime(value: datetime | float) -> datetime | float:
    """Return the content of a VT_DATE as ``datetime``, or unchanged if it is outside the range of ``datetime``."""
    if isinstance(value, datetime):
        return value
    try:
        return ole_datetime(value)
    except OverflowError:
        return value


def lossless_datetime(days: float) -> datetime | float:
    """Return OLE days as ``datetime`` if the ``datetime`` is encoded as the same bytes; otherwise return the days."""
    moment = to_datetime(days)
    return (
        moment
        if isinstance(moment, datetime) and struct.pack("<d", ole_days(moment)) == struct.pack("<d", days)
        else days
    )
