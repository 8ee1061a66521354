"""The classes of user variables and I/O: types, shapes, accepted values, and the syntax of their names.

I/O points are bits. ``IO`` is one point. ``IOB`` is a group of 8 points, ``IOW`` of 16, ``IOD`` and ``IOF`` of 32; the
index is the number of the first point, which is the lowest bit. Clients can write every point, including inputs,
because a virtual controller has no other source of inputs.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final

from orinkit.core.i18n import N_
from orinkit.core.record import record
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8.variables import conversion

R4_ARRAY: Final = int(VarType.R4) | ARRAY


@record
class VariableClass:
    """A class of variables.

    Attributes:
        name: Name before the index.
        vt: VARIANT type of the values.
        convert: Converts the value written by a client.
        default: Value of a variable that was never written; a tuple if it is an array.
        text: Description in English.
        bits: Number of I/O points of one variable; 0 for a user variable.
    """

    name: str
    vt: int
    convert: Callable[[Variant], Any]
    default: Any
    text: str
    bits: int = 0


# A pose that was never written has no figure: Fig -1 is "undefined", 0 would be a valid figure.
_P_DEFAULT: Final = (0.0,) * 6 + (-1.0,)
_T_DEFAULT: Final = (0.0,) * 9 + (-1.0,)
_I4: Final = conversion.whole_within(-(2**31), 2**31 - 1)
_BYTE: Final = conversion.whole_within(-(2**7), 2**8 - 1)


def _signed_byte(given: Variant) -> int:
    """Return the value of 8 I/O points as VT_I1; programs also write 128 to 255."""
    value = _BYTE(given)
    return value - 2**8 if value >= 2**7 else value


CLASSES: Final[dict[str, VariableClass]] = {
    kind.name: kind
    for kind in (
        VariableClass("I", VarType.I4, _I4, 0, N_("integer")),
        VariableClass("F", VarType.R4, conversion.single, 0.0, N_("single-precision number")),
        VariableClass("D", VarType.R8, conversion.double, 0.0, N_("double-precision number")),
        VariableClass("V", R4_ARRAY, conversion.singles(3), (0.0,) * 3, N_("vector X, Y, Z")),
        VariableClass("P", R4_ARRAY, conversion.singles(7), _P_DEFAULT,
                      N_("position X, Y, Z in mm, RX, RY, RZ in degrees, Fig")),
        VariableClass("J", R4_ARRAY, conversion.singles(8), (0.0,) * 8,
                      N_("joints J1 to J8 in degrees or mm")),
        VariableClass("T", R4_ARRAY, conversion.singles(10), _T_DEFAULT,
                      N_("transform X, Y, Z in mm, orient and approach vectors, Fig")),
        VariableClass("S", VarType.BSTR, conversion.string, "", N_("string of up to 255 bytes")),
        VariableClass("IO", VarType.BOOL, conversion.boolean, False, N_("I/O point"), 1),
        VariableClass("IOB", VarType.I1, _signed_byte, 0, N_("8 I/O points"), 8),
        VariableClass("IOW", VarType.I2, conversion.whole_within(-(2**15), 2**15 - 1), 0,
                      N_("16 I/O points"), 16),
        VariableClass("IOD", VarType.I4, _I4, 0, N_("32 I/O points"), 32),
        VariableClass("IOF", VarType.R4, conversion.single, 0.0,
                      N_("32 I/O points as a single-precision number"), 32),
    )
}  # fmt: skip

USER_CLASSES: Final = tuple(name for name, kind in CLASSES.items() if not kind.bits)

# The mini allocation: first point, last point, use.
_IO_AREAS: Final = (
    (0, 15, N_("input")),
    (16, 31, N_("output")),
    (48, 55, N_("hand input")),
    (64, 71, N_("hand output")),
    (128, 2**31, N_("user")),
)
IO_ALLOCATION_MINI: Final = 0


def io_area(point: int) -> str:
    """Return the use of an I/O point in the mini allocation, in English."""
    for first, last, text in _IO_AREAS:
        if first <= point <= last:
            return text
    return N_("reserved")


_NAME: Final = re.compile(
    rf"({'|'.join(sorted(CLASSES, key=len, reverse=True))})(?:\[(\*|[0-9]+)\]|(\*|[0-9]+))(_[0-9]+)?",
    re.IGNORECASE | re.ASCII,
)
_DIGITS: Final = 10
_BEYOND: Final = 10**_DIGITS


@record
class VariableName:
    """The parsed name of a user variable: its class and index; the index of a name such as ``P*`` is ``None``."""

    kind: VariableClass
    index: int | None


def read_name(text: str) -> VariableName | None:
    """Parse a name such as ``I1``, ``io[128]``, ``P*`` or ``P*_2``; return ``None`` for other names.

    The number behind the underscore only distinguishes several variables with ``*``.
    """
    found = _NAME.fullmatch(text.strip())
    if not found:
        return None
    kind, digits = CLASSES[found[1].upper()], found[2] or found[3]
    if digits == "*":
        return VariableName(kind, None)
    if found[4]:
        return None
    digits = digits.lstrip("0") or "0"
    return VariableName(kind, int(digits) if len(digits) <= _DIGITS else _BEYOND)
