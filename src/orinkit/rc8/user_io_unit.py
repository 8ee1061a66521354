"""The unit of the size of user I/O in slvMove's parameter: bits or bytes.

The b-CAP document does not define the unit. DENSO's ROS driver sends the number of bits, a multiple of 8. The number of
bytes that are sent along shows the unit of both sizes in a parameter. If none are sent, the unit is a setting.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import brief
from orinkit.rc8.slave_values import called, whole
from orinkit.values.types import ARRAY, VarType
from orinkit.values.variant import Variant

_BITS: Final = 8
_SIZE: Final = 1  # index of the size among the elements of a part
_STATES: Final = 2


class UserIoUnit(Enum):
    """The unit of the size of user I/O."""

    BITS = "bits"
    BYTES = "bytes"


def read_unit(given: UserIoUnit | str) -> UserIoUnit:
    """Return a unit, given as such or as ``"bits"`` or ``"bytes"``.

    Raises:
        InvalidValue: If there is no such unit.
    """
    try:
        return UserIoUnit(given)
    except ValueError:
        raise InvalidValue(
            tr('the unit of the size of user I/O is "bits" or "bytes", not {given}', given=brief(given))
        ) from None


def size_in_bytes(part: str, elements: Sequence[Variant], unit: UserIoUnit) -> tuple[list[Variant], UserIoUnit]:
    """Return the elements of a part with its size in bytes, and the unit that the part had.

    Args:
        part: Name of the part of slvMove's parameter.
        elements: Offset, size and, if user I/O is sent, its bytes.
        unit: The unit, if the part does not show it.

    Raises:
        CallError: E_INVALIDARG if a number of bits is not a multiple of 8, or the size is not a whole number.
    """
    converted = list(elements)
    size = whole(elements[_SIZE], f"{part} size")
    if len(elements) > _STATES:
        states = elements[_STATES]
        count = len(states.value) if states.type & ARRAY else 1
        if size in (count, count * _BITS):
            unit = UserIoUnit.BYTES if size == count else UserIoUnit.BITS
    if unit is UserIoUnit.BITS:
        if size % _BITS:
            name = called(f"{part} size")
            raise error_for(
                hresult.E_INVALIDARG, tr("{name} is {size} bits, expected a multiple of 8", name=name, size=size)
            )
        converted[_SIZE] = Variant(VarType.I4, size // _BITS)
    return converted, unit


def size_to_send(elements: Sequence[Variant], unit: UserIoUnit) -> list[Variant]:
    """Return the elements of a part, whose size is in bytes, with the size in a unit."""
    sent = list(elements)
    if unit is UserIoUnit.BITS:
        sent[_SIZE] = Variant(VarType.I4, sent[_SIZE].value * _BITS)
    return sent
