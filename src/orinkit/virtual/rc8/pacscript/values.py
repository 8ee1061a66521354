"""The values of a program: numbers, texts and poses; how they are converted, calculated, compared and written.

A pose is a plain tuple, and its length says what it is: V 3, P 7, J 8, T 10 numbers. A truth value is -1 or 0, and any
number but 0 counts as true. Whole numbers have 32 bits; a result beyond them is a fault, never another number.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.errors import mismatch, out_of_range

AnyValue: TypeAlias = Any
"""``int``, ``float``, ``str`` or a tuple of ``float``."""

V_LENGTH: Final = 3
"""How many numbers a V has."""
P_LENGTH: Final = 7
"""How many a P has."""
J_LENGTH: Final = 8
"""How many a J has."""
T_LENGTH: Final = 10
"""How many a T has."""
KINDS: Final = {V_LENGTH: "V", P_LENGTH: "P", J_LENGTH: "J", T_LENGTH: "T"}
"""Which kind of pose has how many numbers."""
LENGTHS: Final = {kind: length for length, kind in KINDS.items()}
"""The lengths of the kinds V, P, J, T; :data:`KINDS` is the way back."""

LEAST: Final = -(2**31)
"""The least Integer."""
LARGEST: Final = 2**31 - 1
"""The largest Integer."""
MAX_TEXT: Final = 4096
"""How many characters a text may have while it is calculated with."""

_SINGLE: Final = struct.Struct("<f")
_SHORTEST_DIGITS: Final = range(6, 10)


# --- conversion -------------------------------------------------------------------------------------------------------


def describe(value: AnyValue) -> str:
    """Return what a value is, for a message."""
    if isinstance(value, str):
        return tr("a text")
    if isinstance(value, tuple):
        return KINDS.get(len(value), tr("a list"))
    return tr("a number")


def number(value: AnyValue) -> int | float:
    """Return a number as it is.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; it is a text or a pose.
    """
    if isinstance(value, int | float):
        return value
    raise mismatch(tr("a number is wanted, not {given}", given=describe(value)))


def whole(value: AnyValue) -> int:
    """Return a whole number of 32 bits; a fraction is rounded, one half upwards.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
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
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(number(value)))[0])
    except OverflowError:
        raise overflow() from None


def double(value: AnyValue) -> float:
    """Return a number of double precision.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED.
    """
    return float(number(value))


def string(value: AnyValue) -> str:
    """Return a text as it is.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; it is none.
    """
    if isinstance(value, str):
        return value
    raise mismatch(tr("a text is wanted, not {given}", given=describe(value)))


def boolean(value: AnyValue) -> int:
    """Return -1 for any number but 0.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED.
    """
    return -1 if number(value) else 0


def pose(*kinds: str) -> Callable[[AnyValue], tuple[float, ...]]:
    """Return what takes poses of some kinds: ``pose("P", "J")``."""
    lengths = frozenset(LENGTHS[kind] for kind in kinds)
    wanted = ", ".join(kinds)

    def take(value: AnyValue) -> tuple[float, ...]:
        if isinstance(value, tuple) and len(value) in lengths:
            return value
        raise mismatch(tr("{wanted} is wanted, not {given}", wanted=wanted, given=describe(value)))

    return take


def any_value(value: AnyValue) -> AnyValue:
    """Return a value as it is, as a Variant takes it."""
    return value


def truth(value: AnyValue) -> bool:
    """Return whether a condition is met.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; it is no number.
    """
    return bool(number(value))


# --- calculation ------------------------------------------------------------------------------------------------------


def add(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return a sum; of texts their concatenation, of two poses of a kind the sum of their numbers, with the left Fig.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE, STRING_TOO_LONG.
    """
    if type(left) is int and type(right) is int:
        result = left + right
        if LEAST <= result <= LARGEST:
            return result
        raise overflow()
    if isinstance(left, str) and isinstance(right, str):
        return bounded(left + right)
    if isinstance(left, tuple):
        return _by_element(left, right, 1.0)
    return finite(number(left) + number(right))


def subtract(left: AnyValue, right: AnyValue) -> AnyValue:
    """Return a difference, as :func:`add`.

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
    """Return a product: of numbers, of a number and a V, of two T (the second seen from the first, with its Fig).

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
    """Return a quotient, always with a fraction; of a V and a number a V.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    divisor = _divisor(number(right))
    if isinstance(left, tuple) and len(left) == V_LENGTH:
        return tuple(finite(element / divisor) for element in left)
    return finite(number(left) / divisor)


def divide_whole(left: AnyValue, right: AnyValue) -> int:
    r"""Return the quotient of two whole numbers without its fraction: ``-7 \ 2`` is -3.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    dividend, divisor = whole(left), _divisor(whole(right))
    quotient = int(abs(dividend) // abs(divisor))
    return whole(quotient if (dividend < 0) == (divisor < 0) else -quotient)


def remainder(left: AnyValue, right: AnyValue) -> int:
    """Return the remainder of two whole numbers, with the sign of the first: ``-7 Mod 2`` is -1.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    dividend = whole(left)
    result = abs(dividend) % abs(_divisor(whole(right)))
    return int(-result if dividend < 0 else result)


def power(left: AnyValue, right: AnyValue) -> float:
    """Return a power, always with a fraction.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; VALUE_OUT_OF_RANGE also where there is no such power.
    """
    base, exponent = float(number(left)), float(number(right))
    try:
        return finite(math.pow(base, exponent))
    except (ValueError, OverflowError):
        raise out_of_range(tr("{base:g} ^ {exponent:g} has no value", base=base, exponent=exponent)) from None


def negate(value: AnyValue) -> AnyValue:
    """Return a number or a V with the other sign.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    if isinstance(value, tuple) and len(value) == V_LENGTH:
        return tuple(-element for element in value)
    return whole(-value) if type(value) is int else -number(value)


def join(left: AnyValue, right: AnyValue) -> str:
    """Return the texts of two values behind each other.

    Raises:
        CallError: STRING_TOO_LONG.
    """
    return bounded(text(left) + text(right))


def shift(value: AnyValue, count: AnyValue) -> int:
    """Return a whole number with its bits moved, up for a positive count; bits beyond 32 are lost.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED, VALUE_OUT_OF_RANGE.
    """
    bits, by = whole(value), whole(count)
    if not -32 < by < 32:
        raise out_of_range(tr("bits cannot be moved by {by}", by=by))
    moved = bits << by if by >= 0 else bits >> -by
    return (moved - LEAST) % 2**32 + LEAST


# --- comparison -------------------------------------------------------------------------------------------------------


def equal(left: AnyValue, right: AnyValue) -> bool:
    """Return whether two values are the same.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED; a number cannot be compared with a text, nor a P with a J.
    """
    if type(left) is not type(right) or type(left) is tuple:
        _comparable(left, right)
    return bool(left == right)


def less(left: AnyValue, right: AnyValue) -> bool:
    """Return whether the first of two numbers or texts comes before the second.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED.
    """
    if type(left) is not type(right) or type(left) is tuple:
        _comparable(left, right)
    if isinstance(left, tuple):
        raise mismatch(tr("poses can only be compared with = and <>"))
    return bool(left < right)


# --- writing ----------------------------------------------------------------------------------------------------------


def text(value: AnyValue) -> str:
    """Return how a value is written: ``12``, ``0.1``, ``P(1, 2, 3, 180, 0, 180, 5)``."""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return f"{KINDS.get(len(value), '')}({', '.join(map(text, value))})"
    if isinstance(value, int):
        return str(value)
    return _real(value)


def bounded(value: str) -> str:
    """Return a text that is not too long.

    Raises:
        CallError: STRING_TOO_LONG.
    """
    if len(value) <= MAX_TEXT:
        return value
    raise error_for(hresult.STRING_TOO_LONG, tr("more than {most} characters", most=MAX_TEXT))


def overflow() -> Exception:
    """Return the error of a number that is too large."""
    return out_of_range(tr("the number is too large for its type"))


def finite(value: float) -> float:
    """Return a number that is neither infinite nor NaN.

    Raises:
        CallError: VALUE_OUT_OF_RANGE.
    """
    if value - value == 0:
        return value
    raise overflow()


def _real(value: float) -> str:
    shown = repr(value)
    if abs(value) < LARGEST and value.is_integer():
        return str(int(value))
    try:
        if _SINGLE.unpack(_SINGLE.pack(value))[0] == value:  # a value of single precision in as few digits as it has
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
        turned = (*_turn(left, right[0:3]), *_turn(left, right[3:6]), *_turn(left, right[6:9]))
        moved = (left[0] + turned[0], left[1] + turned[1], left[2] + turned[2])
        return tuple(finite(value) for value in (*moved, *turned[3:], right[9]))
    raise mismatch(
        tr("{left} and {right} cannot be multiplied", left=describe(left), right=describe(right)),
    )


def _turn(frame: tuple[float, ...], vector: tuple[float, ...]) -> tuple[float, float, float]:
    """Return a vector that is seen from a T as one of the base; the T's X axis is orient x approach."""
    ox, oy, oz, ax, ay, az = frame[3:9]
    nx, ny, nz = oy * az - oz * ay, oz * ax - ox * az, ox * ay - oy * ax
    x, y, z = vector
    return nx * x + ox * y + ax * z, ny * x + oy * y + ay * z, nz * x + oz * y + az * z


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
