"""User-defined functions: functions of a device with numbers above those of CAO (e-CAP 3.3).

e-CAP assigns the numbers from 255 to the user, b-CAP those from 256. A user-defined function belongs to the provider, not
to an object, so it has no handle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from orinkit.cao.table import Argument, Function
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.variant import VarType

FIRST: Final = 255
"""First number of a user-defined function over e-CAP."""
FIRST_BCAP: Final = 256
"""First number of a user-defined function over b-CAP."""
LAST: Final = 0x7FFF_FFFF
MOST_ARGUMENTS: Final = 5
"""Limit on the arguments of a user-defined function: a request of e-CAP has five."""


@record
class UserFunction:
    """A user-defined function of a device.

    Attributes:
        function: the entry with number, name and arguments.
        call: callable invoked with the arguments; returns a result as a method of a provider does.
    """

    function: Function[..., Any]
    call: Callable[..., Any]


def check_number(number: object) -> int:
    """Return the number of a user-defined function.

    Raises:
        InvalidValue: If it is not a whole number from 255.
    """
    if isinstance(number, int) and not isinstance(number, bool) and FIRST <= number <= LAST:
        return number
    raise InvalidValue(
        tr(
            "a user-defined function has a number from {first} (over b-CAP from {bcap}) to {last}, not {number!r:.40}",
            first=FIRST,
            bcap=FIRST_BCAP,
            last=LAST,
            number=number,
        )
    )


def user_entry(
    number: int, name: str, arguments: tuple[Argument, ...], result: VarType | None, en: str, ja: str
) -> Function[..., Any]:
    """Return the entry of a user-defined function, with the form of an entry of the function table.

    Raises:
        InvalidValue: If the number is not valid, or there are more than five arguments.
    """
    if len(arguments) > MOST_ARGUMENTS:
        raise InvalidValue(
            tr(
                "user-defined function {number} has {count} arguments; the limit is {most}",
                number=number,
                count=len(arguments),
                most=MOST_ARGUMENTS,
            )
        )
    required = sum(not argument.optional for argument in arguments)
    return Function(
        check_number(number), name, "", "e-CAP 3.3", arguments, result, "", "", False, en, ja, "", name, required
    )


def foreign_entry(number: int, count: int) -> Function[..., Any]:
    """Return the entry with which a client calls a user-defined function, whose arguments it does not know.

    Args:
        number: number of the function.
        count: number of arguments of the call.

    Raises:
        InvalidValue: If the number is not valid, or there are more than five arguments.
    """
    arguments = tuple(Argument(f"arg{place}", VarType.VARIANT) for place in range(1, count + 1))
    return user_entry(number, f"User_{number}", arguments, VarType.VARIANT, "User-defined function.", "ユーザ関数。")


def is_user_function(function_id: int) -> bool:
    """Return True if a number belongs to user-defined functions."""
    return FIRST <= function_id <= LAST


NO_FUNCTIONS: Final[Mapping[int, UserFunction]] = {}
