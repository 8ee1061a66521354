"""PACK_FLOAT: decimal floating-point numbers in 32 bits, used for a driver's parameters and monitors.

Only multi-packet messages (:mod:`orinkit.abh3.session.telabh3`) contain such numbers; single packets and broadcasts do
not. Section 4.9 of the ABH3 document describes the numbers.

A word has three signed fields, and its value is ``mantissa * 10 ** (point + exponent)``. The field ``exponent`` is the
number after ``e`` in the text. The field ``point`` is the position of the decimal point. Therefore ``0.001`` and
``1e-3`` are different words.

All 32-bit words are valid. A word whose mantissa has more than six digits is not a number: two of these mantissas mean
the infinities, and all others mean NaN.
"""

from __future__ import annotations

import math
import re
from typing import Final, Literal, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, rounded_to_single

ZERO: Final = 0x0000_0000
"""The word of 0."""
PLUS_INFINITY: Final = 0x000F_FFFF
"""The word of infinity."""
MINUS_INFINITY: Final = 0xFFF0_0000
"""The word of minus infinity that the document's functions return."""
NAN: Final = 0xFFF0_0001
"""The word of NaN that the document's functions return."""

Rounding = Literal["round", "trunc"]

_DIGITS: Final = 6
_GREATEST: Final = 999_999
_PLUS: Final = 0xF_FFFF  # mantissas of the infinities
_MINUS: Final = -0x10_0000
_POINTS: Final = range(-8, 8)
_EXPONENTS: Final = range(-64, 64)
_USUAL_POINT: Final = -5  # for numbers whose point does not fit in its field
_TEXT: Final = re.compile(r"([+-]?)([0-9]*)(\.[0-9]*)?(?:[eE]([+-]?)([0-9]*))?")
_LIMITS: Final = {"round": (99_999.95, 999_999.5, 0.5), "trunc": (100_000.0, 1_000_000.0, 0.0)}


class PackFloat(NamedTuple):
    """The fields of a word.

    Attributes:
        mantissa: kasuu (仮数), 21 bits, -999999 to 999999; other values are infinities and NaN.
        point: shousuutenn (小数点位置), 4 bits, -8 to 7: if negative, minus the number of decimals; if positive, the
            number of zeros to append to the mantissa.
        exponent: shisuu (指数), 7 bits, -64 to 63: the number after the ``e``.
    """

    mantissa: int
    point: int
    exponent: int


def pack(mantissa: int, point: int, exponent: int) -> int:
    """Return the word for three fields.

    If the point does not fit in its field, it becomes -5, and the exponent is adjusted. If the exponent is too small,
    the result is zero. If the exponent is too large, the result is an infinity.

    Raises:
        InvalidValue: If the mantissa has more than 21 bits.
    """
    if not _MINUS <= mantissa <= _PLUS:
        raise InvalidValue(
            tr(
                "the mantissa of a PACK_FLOAT must be {low} to {high}, not {mantissa}",
                low=_MINUS,
                high=_PLUS,
                mantissa=brief(mantissa),
            )
        )
    if point not in _POINTS:
        exponent += point - _USUAL_POINT
        point = _USUAL_POINT
    if exponent < _EXPONENTS.start or (exponent >= _EXPONENTS.stop and mantissa == 0):
        return ZERO
    if exponent >= _EXPONENTS.stop:
        return PLUS_INFINITY if mantissa > 0 else MINUS_INFINITY
    return (exponent & 0x7F) << 25 | (point & 0xF) << 21 | mantissa & 0x1F_FFFF


def unpack(word: int) -> PackFloat:
    """Return the fields of a word.

    Raises:
        InvalidValue: If the word has more than 32 bits or is negative.
    """
    if not 0 <= word <= 0xFFFF_FFFF:
        raise InvalidValue(tr("a PACK_FLOAT must be a 32-bit word, 0 to 0xFFFFFFFF, not {word}", word=brief(word)))
    return PackFloat(_signed(word, 21), _signed(word >> 21, 4), _signed(word >> 25, 7))


def from_text(text: str) -> int:
    """Return the word of a text (``str_to_pkflt``).

    The text consists of a sign, digits, a point with digits, and ``e`` or ``E`` with a sign and digits. Each part may
    be missing; an empty text is 0. The first six digits are used, beginning with the first digit that is not 0. Further
    digits are cut off, not rounded. Trailing zeros are kept. Infinities and NaN are not accepted.

    Raises:
        InvalidValue: If the text has another form.
    """
    found = _TEXT.fullmatch(text)
    if found is None:
        raise InvalidValue(
            tr(
                "{text} is not a PACK_FLOAT number. Try: a text such as 12.5 or -1.25e+3, without spaces",
                text=brief(text),
            )
        )
    sign, whole, decimals, exponent_sign, exponent = found.groups("")
    digits = whole.lstrip("0")
    point = max(len(digits) - _DIGITS, 0)
    mantissa = _leading(digits)
    if point == 0:
        mantissa, point = _with_decimals(mantissa, decimals[1:])
    power = _leading(exponent.lstrip("0"))  # six digits suffice: they exceed every valid exponent
    return pack(-mantissa if sign == "-" else mantissa, point, -power if exponent_sign == "-" else power)


def to_text(word: int) -> str:
    """Return the text of a word (``pkflt_to_str``): ``0.001``, ``1.5e-7``, ``+#INF``, ``-#INF`` or ``#NAN``.

    Raises:
        InvalidValue: If the word has more than 32 bits or is negative.
    """
    mantissa, point, exponent = unpack(word)
    if abs(mantissa) > _GREATEST:
        return {_PLUS: "+#INF", _MINUS: "-#INF"}.get(mantissa, "#NAN")
    digits = str(abs(mantissa))
    if point < 0:
        digits = digits.zfill(1 - point)
        digits = f"{digits[:point]}.{digits[point:]}"
    elif mantissa:
        digits += "0" * point
    return f"{'-' if mantissa < 0 else ''}{digits}{f'e{exponent:+d}' if exponent else ''}"


def to_float(word: int) -> float:
    """Return the value of a word (``pkflt_to_flt``) in single precision, as the document's function does.

    A value that is too large for single precision becomes an infinity. A value that is too small becomes 0 with the
    sign of the word.

    Raises:
        InvalidValue: If the word has more than 32 bits or is negative.
    """
    mantissa, point, exponent = unpack(word)
    if abs(mantissa) > _GREATEST:
        return {_PLUS: math.inf, _MINUS: -math.inf}.get(mantissa, math.nan)
    if mantissa == 0:
        return 0.0
    value = float(mantissa)
    power = point + exponent
    left, factor = abs(power), 10.0
    while left:
        if left & 1:
            value = _single(value * factor if power > 0 else value / factor)
        left >>= 1
        factor = _single(factor * factor)
    return value


def from_float(value: float, *, rounding: Rounding = "round") -> int:
    """Return the word for a value (``flt_to_pkflt``), with six digits.

    Args:
        value: The value; it is rounded to single precision first.
        rounding: ``"round"`` rounds to the nearest number of six digits; a half is rounded away from zero. The
            document's functions do this if they are built for a processor that rounds towards zero. ``"trunc"`` cuts
            off all further digits, as other builds of these functions do.

    Raises:
        InvalidValue: If ``rounding`` has another value.
    """
    if rounding not in _LIMITS:
        raise InvalidValue(tr('rounding must be "round" or "trunc", not {rounding}', rounding=brief(rounding)))
    value = _single(value)
    if math.isnan(value):
        return NAN
    if math.isinf(value):
        return PLUS_INFINITY if value > 0 else MINUS_INFINITY
    if value == 0:
        return ZERO
    mantissa, power = _six_digits(abs(value), rounding)
    zeros = 0
    while mantissa % 10 == 0:
        mantissa //= 10
        zeros += 1
    point, exponent = _placed(power, zeros)
    return pack(-mantissa if value < 0 else mantissa, point, exponent)


def _six_digits(value: float, rounding: Rounding) -> tuple[int, int]:
    """Return a value as a whole number of six digits, and the power of ten by which to multiply this number."""
    least, beyond, half = map(_single, _LIMITS[rounding])
    power = 0
    while value < least:
        value = _single(value * 10)
        power -= 1
    while value >= beyond:
        value = _single(value / 10)
        power += 1
    return int(value + half), power


def _placed(power: int, zeros: int) -> tuple[int, int]:
    """Return the point and the exponent for a six-digit number from which trailing zeros were removed."""
    if power + zeros < -6:  # 9.99999e-99
        point = min(zeros - 5, 0)
        return point, power + zeros - point
    if power <= 0:  # 0.000001 to 999999
        return power + zeros, 0
    return zeros - 5, power + 5  # 9.99999e+99


def _with_decimals(mantissa: int, decimals: str) -> tuple[int, int]:
    """Append decimals to a mantissa, up to six digits in total; return the new mantissa and its point."""
    leading = len(decimals) - len(decimals.lstrip("0")) if mantissa == 0 else 0
    kept = decimals[: leading + _DIGITS - (len(str(mantissa)) if mantissa else 0)]
    return mantissa * 10 ** (len(kept) - leading) + _leading(kept[leading:]), -len(kept)


def _leading(digits: str) -> int:
    return int(digits[:_DIGITS] or "0")


def _signed(field: int, bits: int) -> int:
    field &= (1 << bits) - 1
    return field - (1 << bits) if field >> (bits - 1) else field


def _single(value: float) -> float:
    """Round to single precision; values beyond its range become infinities."""
    try:
        return rounded_to_single(float(value))
    except OverflowError:
        return math.inf if value > 0 else -math.inf
