"""The values of a program (numbers, strings and poses): conversion, calculation, comparison, formatting.

A pose is a plain tuple; its length determines its type: V 3, P 7, J 8, T 10 numbers. A truth value is -1 or 0; any
number other than 0 is true. Whole numbers have 32 bits; an overflow is an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from orinkit.arms.geometry import cross
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import rounded_to_single
from orinkit.virtual.rc8.pacscript.errors import mismatch, out_of_range

AnyValue: TypeAlias = Any
"""``int``, ``float``, ``str`` or a tuple of ``float``."""

V_LENGTH: Final = 3
"""Number of elements of a V."""
P_LENGTH: Final = 7
"""Number of elements of a P."""
J_LENGTH: Final = 8
"""Number of elements of a J."""
T_LENGTH: Final = 10
"""Number of elements of a T."""
KINDS: Final = {V_LENGTH: "V", P_LENGTH: "P", J_LENGTH: "J", T_LENGTH: "T"}
"""The type of pose for each number of elements."""
LENGTHS: Final = {kind: length for length, kind in KINDS.items()}
"""The number of elements for each type of pose; the inverse of :data:`KINDS`."""

LEAST: Final = -(2**31)
"""The smallest Integer."""
LARGEST: Final = 2**31 - 1
"""The largest Integer."""
MAX_TEXT: Final = 4096
"""Maximum length of a string in an expression, in characters."""

_SHORTEST_DIGITS: Final = range(6, 10)


# --- conversion -------------------------------------------------------------------------------------------------------


def describe(value: AnyValue) -> str:
    """Return the type of a value, for a message."""
    if isinstance(value, str):
        return tr("a string")
    if isinstance(value, tuple):
        return KINDS.get(len(value), tr("a list"))
    return tr("a number")


def number(value: AnyValue) -> int | float:
    """Return a number unchanged.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is a string or a pose.
    """
    if isinstance(value, int | float):
        return value
    raise mismatch(tr("expected a number, got {given}", given=describe(value)))


def rounded_to_integer(value: AnyValue) -> int:
    """Return a number rounded to a whole number of 32 bits; one half is rounded up.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number; VALUE_OUT_OF_RANGE if it exceeds 32 bits.
    """
    if type(value) is int and LEAST <= value <= LARGEST:
        return value
    real = number(value)
    if not LEAST - 0.5 <= real < LARGEST + 0.5:
        raise overflow()
    return math.floor(real + 0.5)


def single(value: AnyValue) -> float:
    """Return a number rounded to single precision.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number; VALUE_OUT_OF_RANGE if it is too large.
    """
    try:
        return rounded_to_single(number(value))
    except OverflowError:
        raise overflow() from None


def double(value: AnyValue) -> float:
    """Return a number in double precision.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number.
    """
    return float(number(value))


def string(value: AnyValue) -> str:
    """Return a string unchanged.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a string.
    """
    if isinstance(value, str):
        return value
    raise mismatch(tr("expected a string, got {given}", given=describe(value)))


def boolean(value: AnyValue) -> int:
    """Return 0 for 0 and -1 for any other number.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number.
    """
    return -1 if number(value) else 0


def pose(*kinds: str) -> Callable[[AnyValue], tuple[float, ...]]:
    """Return a function that returns a pose of one of these types unchanged and refuses other values.

    For example, ``pose("P", "J")`` returns a function for P and J.
    """
    lengths = frozenset(LENGTHS[kind] for kind in kinds)
    wanted = ", ".join(kinds)

    def take(value: AnyValue) -> tuple[float, ...]:
        if isinstance(value, tuple) and len(value) in lengths:
            return value
        raise mismatch(tr("expected {wanted}, got {given}", wanted=wanted, given=describe(value)))

    return take


def any_value(value: AnyValue) -> AnyValue:
    """Return a value unchanged: a Variant accepts any value."""
    return value


def truth(value: AnyValue) -> bool:
    """Return True if a number is not 0, which means that a condition is met.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number.
    """
    return bool(number(value))


# --- calculation ------------------------------------------------------------------------------------------------------


def add(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return the sum of two numbers, two V, two P or two J, or the concatenation of two strings.

    Poses are added element by element; the sum of two P has the Fig of the left one.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE, STRING_TOO_LONG.
    """
    if type(left) is int and type(right) is int:
        result = left + right
        if LEAST <= result <= LARGEST:
            return result
        raise overflow()
    if isinstance(left, str) and isinstance(right, str):
        return check_length(left + right)
    if isinstance(left, tuple):
        return _by_element(left, right, 1.0)
    return finite(number(left) + number(right))


def subtract(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return the difference of two numbers, two V, two P or two J, in the same way as :func:`add`.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    if type(left) is int and type(right) is int:
        result = left - right
        if LEAST <= result <= LARGEST:
            return result
        raise overflow()
    if isinstance(left, tuple):
        return _by_element(left, right, -1.0)
    return finite(number(left) - number(right))


def multiply(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return the product of two numbers, of a number and a V, or of two T.

    The second T is relative to the first; the product has the Fig of the second T.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    if type(left) is int and type(right) is int:
        result = left * right
        if LEAST <= result <= LARGEST:
            return result
        raise overflow()
    if isinstance(left, tuple) or isinstance(right, tuple):
        return _multiply_poses(left, right)
    return finite(number(left) * number(right))


def divide(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return the quotient of two numbers as a float, or the quotient of a V and a number as a V.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    divisor = _divisor(number(right))
    if isinstance(left, tuple) and len(left) == V_LENGTH:
        return tuple(finite(element / divisor) for element in left)
    return finite(number(left) / divisor)


def divide_whole(left: AnyValue, right: AnyValue) -> int:
    r"""Return the quotient of two whole numbers, truncated: ``-7 \ 2`` is -3.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    dividend, divisor = rounded_to_integer(left), _divisor(rounded_to_integer(right))
    quotient = int(abs(dividend) // abs(divisor))
    return rounded_to_integer(quotient if (dividend < 0) == (divisor < 0) else -quotient)


def remainder(left: AnyValue, right: AnyValue) -> int:
    """Return the remainder of two whole numbers, with the sign of the first: ``-7 Mod 2`` is -1.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    dividend = rounded_to_integer(left)
    result = abs(dividend) % abs(_divisor(rounded_to_integer(right)))
    return int(-result if dividend < 0 else result)


def power(left: AnyValue, right: AnyValue) -> float:
    """Return a power as a float.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; VALUE_OUT_OF_RANGE, also if the power is undefined.
    """
    base, exponent = float(number(left)), float(number(right))
    try:
        return finite(math.pow(base, exponent))
    except (ValueError, OverflowError):
        raise out_of_range(
            tr("{base:g} ^ {exponent:g} is undefined or too large", base=base, exponent=exponent)
        ) from None


def negate(value: AnyValue) -> AnyValue:
    """Return a number or a V with the opposite sign.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    if isinstance(value, tuple) and len(value) == V_LENGTH:
        return tuple(-element for element in value)
    return rounded_to_integer(-value) if type(value) is int else -number(value)


def join(left: AnyValue, right: AnyValue) -> str:
    """Return the concatenation of two values, formatted as strings.

    Raises:
        CallError: STRING_TOO_LONG.
    """
    return check_length(text(left) + text(right))


def shift(value: AnyValue, count: AnyValue) -> int:
    """Return a whole number shifted by a number of bits, to the left if the count is positive.

    Bits beyond the 32nd are lost.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    bits, by = rounded_to_integer(value), rounded_to_integer(count)
    if not -32 < by < 32:
        raise out_of_range(tr("the shift count {by} is not in -31 to 31", by=by))
    moved = bits << by if by >= 0 else bits >> -by
    return (moved - LEAST) % 2**32 + LEAST


# --- comparison -------------------------------------------------------------------------------------------------------


def equal(left: AnyValue, right: AnyValue) -> bool:
    """Return True if two values are equal.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the types differ, for example a number and a string, or a P and a J.
    """
    if type(left) is not type(right) or type(left) is tuple:
        _comparable(left, right)
    return bool(left == right)


def less(left: AnyValue, right: AnyValue) -> bool:
    """Return True if the first of two numbers or strings is less than the second.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the types differ, or if the values are poses.
    """
    if type(left) is not type(right) or type(left) is tuple:
        _comparable(left, right)
    if isinstance(left, tuple):
        raise mismatch(tr("poses can only be compared with = and <>"))
    return bool(left < right)


# --- formatting -------------------------------------------------------------------------------------------------------


def text(value: AnyValue) -> str:
    """Format a value: ``12``, ``0.1``, ``P(1, 2, 3, 180, 0, 180, 5)``."""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return f"{KINDS.get(len(value), '')}({', '.join(map(text, value))})"
    if isinstance(value, int):
        return str(value)
    return _real(value)


def check_length(value: str) -> str:
    """Return a string unchanged.

    Raises:
        CallError: STRING_TOO_LONG if it has more than MAX_TEXT characters.
    """
    if len(value) <= MAX_TEXT:
        return value
    raise error_for(hresult.STRING_TOO_LONG, tr("the string has more than {most} characters", most=MAX_TEXT))


def overflow() -> Exception:
    """Return the error for a number that is too large."""
    return out_of_range(tr("the number is too large for its type"))


def finite(value: float) -> float:
    """Return a number unchanged.

    Raises:
        CallError: VALUE_OUT_OF_RANGE if it is infinite or NaN.
    """
    if value - value == 0:
        return value
    raise overflow()


def _real(value: float) -> str:
    shown = repr(value)
    if abs(value) < LARGEST and value.is_integer():
        return str(int(value))
    try:
        if rounded_to_single(value) == value:  # single precision: the fewest digits that convert back to this value
            shown = next((s for n in _SHORTEST_DIGITS if single(float(s := f"{value:.{n}g}")) == value), shown)
    except OverflowError:
        pass
    return shown.removesuffix(".0")


def _by_element(left: tuple[float, ...], right: AnyValue, sign: float) -> tuple[float, ...]:
    if not isinstance(right, tuple) or len(left) != len(right) or len(left) == T_LENGTH:
        raise mismatch(
            tr("{left} and {right} cannot be added or subtracted", left=describe(left), right=describe(right)),
        )
    result = tuple(finite(a + sign * b) for a, b in zip(left, right, strict=True))
    return (*result[:-1], left[-1]) if len(left) == P_LENGTH else result


def _multiply_poses(left: AnyValue, right: AnyValue) -> tuple[float, ...]:
    vector, factor = (left, right) if isinstance(left, tuple) else (right, left)
    if len(vector) == V_LENGTH and isinstance(factor, int | float):
        return tuple(finite(factor * element) for element in vector)
    if isinstance(left, tuple) and isinstance(right, tuple) and len(left) == len(right) == T_LENGTH:
        ox, oy, oz, ax, ay, az = left[3:9]
        nx, ny, nz = cross((ox, oy, oz), (ax, ay, az))  # the X axis of T
        rows = (nx, ox, ax), (ny, oy, ay), (nz, oz, az)
        turned = [n * x + o * y + a * z for x, y, z in (right[0:3], right[3:6], right[6:9]) for n, o, a in rows]
        moved = (left[0] + turned[0], left[1] + turned[1], left[2] + turned[2])
        return tuple(finite(value) for value in (*moved, *turned[3:], right[9]))
    raise mismatch(
        tr("{left} and {right} cannot be multiplied", left=describe(left), right=describe(right)),
    )


def _divisor(value: float) -> float:
    if value:
        return value
    raise out_of_range(tr("division by zero"))


def _comparable(left: AnyValue, right: AnyValue) -> None:
    if isinstance(left, int | float) and isinstance(right, int | float):
        return
    if isinstance(left, tuple) and isinstance(right, tuple) and len(left) == len(right):
        return
    raise mismatch(
        tr("{left} and {right} cannot be compared", left=describe(left), right=describe(right)),
    )
