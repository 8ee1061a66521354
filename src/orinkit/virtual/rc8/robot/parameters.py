"""Reads the parameters of the robot's extended commands, which clients send as arrays, as scalars or in one string."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import InvalidValue, NotationError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.pose_arguments import read_targets
from orinkit.values.poses import PassMark, Target
from orinkit.values.types import ARRAY, EMPTIES, VARIANT_ARRAY, VarType
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.variables import conversion

MOST_ELEMENTS: Final = 64
"""Maximum number of elements of an array; only values of Public variables have more."""
_LONGEST: Final = 1024  # maximum length of a string that is not a pose, in characters


def elements(parameter: Variant) -> list[Variant]:
    """Return the elements of an array, or a scalar as the only element; VT_EMPTY and ``""`` have no elements.

    Raises:
        CallError: E_INVALIDARG if the array has more elements than any command accepts.
    """
    if parameter.type & ARRAY and len(parameter.value) > MOST_ELEMENTS:
        raise _count(len(parameter.value), 0, MOST_ELEMENTS)
    if parameter.type == VARIANT_ARRAY:
        return [each if isinstance(each, Variant) else Variant(VarType.EMPTY) for each in parameter.value]
    if parameter.type & ARRAY:
        return [Variant(parameter.type & ~ARRAY, each) for each in parameter.value]
    if parameter.type in EMPTIES or parameter.value == "":
        return []
    return [parameter]


def numbers(parameter: Variant, *defaults: float | None) -> list[float]:
    """Return the numbers of a parameter.

    ``defaults`` has an element for each number. If a number is missing, its default is returned; a number whose default
    is ``None`` must not be missing.

    Raises:
        CallError: E_INVALIDARG if the number of values is wrong; DISP_E_TYPEMISMATCH if a value is not a number.
    """
    given = elements(parameter)
    if len(given) == 1 and isinstance(given[0].value, str) and len(defaults) > 1:
        given = [Variant(VarType.BSTR, part) for part in check_length(given[0].value).split(",")]
    least = sum(1 for default in defaults if default is None)
    if not least <= len(given) <= len(defaults):
        raise _count(len(given), least, len(defaults))
    values = [conversion.double(each) for each in given]
    return values + [default for default in defaults[len(given) :] if default is not None]


def whole_numbers(parameter: Variant, *defaults: int | None) -> list[int]:
    """Return the whole numbers of a parameter; see :func:`numbers`.

    Raises:
        CallError: As for :func:`numbers`; E_INVALIDARG for a fraction.
    """
    return [whole(value) for value in numbers(parameter, *defaults)]


def whole(value: float) -> int:
    """Return a number as an integer.

    Raises:
        CallError: E_INVALIDARG if the number has a fraction.
    """
    if value != int(value):
        raise error_for(hresult.E_INVALIDARG, tr("{value:g} is not a whole number", value=value))
    return int(value)


def flag(value: float) -> bool:
    """Return 0 or 1 as a boolean; -1 is True, as in VT_BOOL.

    Raises:
        CallError: VALUE_OUT_OF_RANGE for other numbers.
    """
    if value not in (-1, 0, 1):
        raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("{value:g} is neither 0 nor 1", value=value))
    return bool(value)


def at_least(parameter: Variant, count: int) -> list[Variant]:
    """Return the elements of a parameter (:func:`elements`) after checking that there are at least ``count``.

    Raises:
        CallError: E_INVALIDARG if there are fewer.
    """
    given = elements(parameter)
    if len(given) < count:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected at least {needed} parameters, got {count}", count=len(given), needed=count),
        )
    return given


def pose(parameter: Variant) -> Target:
    """Return the single pose of a parameter.

    Raises:
        CallError: E_INVALIDARG if the pose is not valid, or if the parameter has several poses.
    """
    targets = read_targets(parameter)
    if len(targets) != 1:
        raise error_for(hresult.E_INVALIDARG, tr("expected 1 pose, got {count}", count=len(targets)))
    return targets[0]


def position(target: Target) -> Target:
    """Return an untyped pose as a position (P), and any other pose unchanged.

    Raises:
        CallError: E_INVALIDARG if the number of values does not match a position.
    """
    try:
        return replace(target, kind="P") if not target.kind else target
    except InvalidValue as error:
        raise error_for(hresult.E_INVALIDARG, str(error)) from None


def pose_and_rest(parameter: Variant, most: int) -> tuple[Target, list[Variant]]:
    """Return a pose and the elements after it, as in ``[pose, tool, work]``.

    If no elements follow the pose, it may have any form that :func:`pose` accepts.

    Raises:
        CallError: E_INVALIDARG if more than ``most`` elements follow the pose; otherwise as for :func:`pose`.
    """
    if parameter.type == VARIANT_ARRAY:
        given = elements(parameter)
        has_own_form = bool(given) and (isinstance(given[0].value, str) or bool(given[0].type & ARRAY))
        if has_own_form and (len(given) == 1 or not isinstance(given[1].value, str)):
            if len(given) > 1 + most:
                raise _count(len(given), 1, 1 + most)
            return pose(given[0]), given[1:]
    return pose(parameter), []


def poses(parameter: Variant, count: int) -> list[Target]:
    """Return a given number of poses.

    Raises:
        CallError: E_INVALIDARG if the number of poses is different, or if a pose is not valid.
    """
    given = elements(parameter)
    found = [pose(each) for each in given] if len(given) == count else list(read_targets(parameter))
    if len(found) != count:
        raise _count(len(found), count, count)
    return found


def pass_mark(text: str) -> PassMark:
    """Return the pass mark of a string.

    Raises:
        CallError: E_INVALIDARG if the string is not a valid pass mark.
    """
    try:
        return PassMark.parse(text)
    except NotationError as error:
        raise error_for(hresult.E_INVALIDARG, f"{quoted(text)}: {error}") from None


def check_length(text: str) -> str:
    """Return a string after checking its length.

    Raises:
        CallError: E_INVALIDARG if the string has more than 1,024 characters. Only poses may be longer.
    """
    if len(text) > _LONGEST:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("string of {count} characters exceeds the limit of {longest}", count=len(text), longest=_LONGEST),
        )  # fmt: skip
    return text


def _count(given: int, least: int, most: int) -> Exception:
    wanted = str(least) if least == most else f"{least}..{most}"
    return error_for(
        hresult.E_INVALIDARG,
        tr("got {given} parameters, expected {wanted}", given=given, wanted=wanted),
    )
