"""Commands of the robot that clients and programs share: a row for each, and the readers of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.types import EMPTIES
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.variables import conversion

R8_ARRAY = int(VarType.R8) | ARRAY


@record
class SharedCommand:
    """A command of the robot.

    Attributes:
        name: Name as documented; case-insensitive.
        run: Executes the command; its arguments are the arm, the client or program, and the parameter.
        reads: If True, the command requires only the right to read; otherwise it checks its conditions itself.
        in_slave: If True, the client that is in slave mode may use the command (entries of the provider guide without
            the mark S).
    """

    name: str
    run: Callable[[RC8Arm, Operator, Variant], Any]
    reads: bool = True
    in_slave: bool = True


def numbers_of(arm: RC8Arm, given: Variant, count: int, kind: str = "P") -> tuple[float, ...]:
    """Return the first ``count`` numbers of a pose, a vector or an array; a number is the index of a variable.

    Raises:
        CallError: E_INVALIDARG if there are fewer numbers.
    """
    target = parameters.pose(given)
    values = target.value
    if isinstance(values, int):
        values = arm.space.read_variable(target.kind or kind, values)
    if len(values) < count:
        raise error_for(
            hresult.E_INVALIDARG, tr("got {count} values, expected {length}", count=len(values), length=count)
        )
    return tuple(values[:count])


def is_given(given: Sequence[Variant], index: int) -> bool:
    """Return True if there is a parameter at an index that is not empty."""
    return index < len(given) and given[index].type not in EMPTIES and given[index].value != ""


def truth(given: Variant) -> bool:
    """Return False for 0, True for any other number (RC8 provider guide)."""
    return bool(conversion.double(given))


def r8(values: Sequence[float]) -> Variant:
    """Return numbers as an array of VT_R8."""
    return Variant(R8_ARRAY, [float(value) for value in values])
