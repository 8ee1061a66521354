"""Parameters of the commands, in the types of tables 5-2 and 5-3 and in the types that clients actually send.

Clients send numbers in any type and as strings, modes also in hexadecimal, and poses as arrays of R4 or R8, as VARIANT
arrays and as a string.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, EMPTIES, R8_ARRAY, VARIANT_ARRAY, VarType
from orinkit.values.variant import Variant
from orinkit.virtual.ve026a.codes import AXES

OFF: Final = 0x000
SYNCHRONOUS: Final = 0x002
ASYNCHRONOUS: Final = 0x102
MODES: Final = (OFF, SYNCHRONOUS, ASYNCHRONOUS)
"""The modes of slvChangeMode (table 2-1; 0 is in 2.2.1)."""

VALUES: Final = 8
"""Number of values of a pose: the positions of the seven axes and a 0, as in the samples of the document."""

_R4_ARRAY: Final = int(VarType.R4) | ARRAY

_HEXADECIMAL: Final = re.compile(r"\s*(?:0x|&h)([0-9a-f]{1,8})\s*", re.IGNORECASE)
_LONGEST: Final = 1024  # characters of a pose as a string
_OFF_OR_ON: Final = {0: False, 1: True, -1: True}  # VT_BOOL is -1


def motor(parameter: Variant) -> bool:
    """Return the parameter of Motor, True for on. According to table 5-3, it is a VT_I2: 1 for on, 0 for off.

    Raises:
        CallError: E_INVALIDARG if it is another number; E_INVALIDARGTYPE if it is not a number.
    """
    number = coerce.to_integer(parameter)
    if number not in _OFF_OR_ON:
        raise error_for(hresult.E_INVALIDARG, tr("the parameter of Motor must be 0 or 1, not {number}", number=number))
    return _OFF_OR_ON[number]


def mode(parameter: Variant) -> int:
    """Return the parameter of slvChangeMode, one of :data:`MODES`.

    Its type is VT_I2, VT_I4, or a string such as ``"258"`` or ``"0x102"``.

    Raises:
        CallError: E_INVALIDARG if there is no such mode; E_INVALIDARGTYPE if it is not a number.
    """
    parameter = coerce.unwrap_single(parameter)
    found = _HEXADECIMAL.fullmatch(parameter.value) if isinstance(parameter.value, str) else None
    number = int(found[1], 16) if found else coerce.to_integer(parameter)
    if number not in MODES:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("the mode of slvChangeMode must be 0, 0x2 or 0x102, not {number:#x}", number=number),
        )
    return number


def skip_first_count(parameter: Variant) -> int:
    """Return the parameter of slvGetLateness: how many of the first late set-points are not counted; 0 by default.

    Raises:
        CallError: E_INVALIDARGTYPE if it is not a number.
    """
    parameter = coerce.unwrap_single(parameter)
    return 0 if parameter.type in EMPTIES or parameter.value == "" else coerce.to_integer(parameter)


def error_code(parameter: Variant) -> int:
    """Return the parameter of ClearError, an unsigned error code; 0 by default.

    ClearError ignores the code: it clears any error.

    Raises:
        CallError: E_INVALIDARG if it is not a whole number of 32 bits; E_INVALIDARGTYPE if it is not a number.
    """
    parameter = coerce.unwrap_single(parameter)
    if parameter.type in EMPTIES or parameter.value == "":
        return 0
    number = coerce.to_real(parameter)
    if number != int(number) or not -(2**31) <= number < 2**32:
        raise error_for(hresult.E_INVALIDARG, tr("{number} is not a return code", number=number))
    return hresult.unsigned(int(number))


def joints(parameter: Variant) -> tuple[float, ...]:
    """Return the seven joints of a pose, deg; an eighth value is ignored.

    Raises:
        CallError: E_INVALIDARG if there are not seven or eight numbers, or one is not finite; E_INVALIDARGTYPE if a
            value is not a number.
    """
    values = _numbers(parameter)
    if not all(map(math.isfinite, values)):
        raise error_for(hresult.E_INVALIDARG, tr("a joint is not a finite number"))
    return tuple(values[:AXES])


def _numbers(parameter: Variant) -> Sequence[float]:
    if isinstance(parameter.value, str):
        parts = parameter.value[: _LONGEST + 1].split(",")
        _require_pose(len(parts) if len(parameter.value) <= _LONGEST else 0)
        return [coerce.to_real(Variant(VarType.BSTR, part)) for part in parts]
    if not parameter.type & ARRAY:
        raise coerce.wrong_type(parameter, "VT_R4|VT_ARRAY")
    _require_pose(len(parameter.value))
    if parameter.type in (_R4_ARRAY, R8_ARRAY):
        return list(parameter.value)
    if parameter.type == VARIANT_ARRAY:
        return [coerce.to_real(each) for each in parameter.value]
    return [coerce.to_real(Variant(parameter.type & ~ARRAY, each)) for each in parameter.value]


def _require_pose(count: int) -> None:
    if count not in (AXES, VALUES):
        raise _count(count)


def _count(count: int) -> CallError:
    return error_for(
        hresult.E_INVALIDARG,
        tr("a pose must have {axes} or {most} values, not {given}", given=count, axes=AXES, most=VALUES),
    )
