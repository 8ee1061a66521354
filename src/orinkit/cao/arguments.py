"""Conversion of a call's arguments to the types of the function table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final

from orinkit.cao import coerce
from orinkit.cao.table import Argument, Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType


def read_arguments(function: Function[..., Any], given: Sequence[Variant]) -> list[Any]:
    """Return a call's arguments with the types of the table, and with defaults for omitted optional ones.

    Raises:
        CallError: E_INVALIDARG if the number of arguments is wrong, E_INVALIDARGTYPE if a type is wrong.
    """
    expected = function.arguments
    if not function.required <= len(given) <= len(expected):
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "got {count} arguments, expected {wanted} for {name}",
                count=len(given),
                name=function.name,
                wanted=len(expected),
            ),
        )
    values = []
    for (vt, longest, argument), value in zip(_expected(function), given, strict=False):
        content = value.value
        if value.type == vt and (not longest or len(content) <= longest):
            values.append(content)  # it has the type of the table already
        else:
            values.append(_read(function, argument, value))
    if len(given) < len(expected):
        values += [_default(argument) for argument in expected[len(given) :]]
    return values


_ANY: Final = -1  # no VARIANT has this type
_UNCHANGED: Final = frozenset((VarType.I4, VarType.BSTR))  # the types whose content is passed on without a check


@cache
def _expected(function: Function[..., Any]) -> tuple[tuple[int, int, Argument], ...]:
    """Return for each argument the type whose content needs no conversion, its limit on characters, and the argument."""
    return tuple(
        (
            int(argument.vt) if argument.vt in _UNCHANGED else _ANY,
            argument.longest if argument.vt is VarType.BSTR else 0,
            argument,
        )
        for argument in function.arguments
    )


def _read(function: Function[..., Any], argument: Argument, value: Variant) -> Any:
    if argument.is_handle:
        return coerce.to_handle(value)
    read = _READERS[argument.vt](value)
    if argument.vt is VarType.BSTR and len(read) > argument.longest:
        raise _too_long(function, argument, len(read))
    return read


def _too_long(function: Function[..., Any], argument: Argument, length: int) -> CallError:
    where = f"{function.name}: {argument.name}"
    return error_for(
        hresult.E_INVALIDARG,
        tr(
            "{where} of {length} characters exceeds the limit of {most} characters",
            where=where,
            length=length,
            most=argument.longest,
        ),
    )


def _default(argument: Argument) -> object:
    if argument.vt is VarType.VARIANT:
        return Variant(VarType.EMPTY)
    return "" if argument.default is None else argument.default


_READERS: Final[dict[VarType, Callable[[Variant], Any]]] = {
    VarType.I4: coerce.to_integer,
    VarType.R4: coerce.to_real,
    VarType.R8: coerce.to_real,
    VarType.BOOL: lambda value: bool(coerce.to_number(value)),
    VarType.BSTR: coerce.to_text,
    VarType.VARIANT: lambda value: value,
}
