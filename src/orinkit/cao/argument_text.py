"""Arguments of CAO functions as text: plain text and numbers, or VARIANT notation."""

from __future__ import annotations

import re
from typing import Any, Final

from orinkit.cao.table import Argument
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.hresult import signed
from orinkit.core.i18n import tr
from orinkit.values.notation import parse_lenient
from orinkit.values.types import VarType, type_name
from orinkit.values.variant import Variant

_CODE: Final = re.compile(r"0[xX][89A-Fa-f][0-9A-Fa-f]{7}")  # an error code in hex, which is sent as a negative VT_I4


def type_text(vt: VarType) -> str:
    """Return the name of a type; ``VARIANT`` stands for any type."""
    return "VARIANT" if vt is VarType.VARIANT else type_name(vt)


def read_argument(argument: Argument, text: str) -> Any:
    """Return the value of an argument from a text: ``100``, ``1.5``, ``true``, text, or VARIANT notation.

    Raises:
        InvalidValue: If the text is not a number, and the argument is one.
        NotationError: If the text is invalid VARIANT notation.
    """
    if argument.vt is VarType.BSTR:
        return _read_text(text)
    value = parse_lenient(text) if not _CODE.fullmatch(text) else Variant(VarType.I4, signed(int(text, 16)))
    if argument.vt is VarType.VARIANT:
        return value
    number = value.plain
    fits = isinstance(number, int if argument.vt is VarType.I4 else int | float) and not isinstance(number, bool)
    if not fits:
        name = f"{argument.name} ({type_text(argument.vt)})"
        raise InvalidValue(tr("{text!r} is not a valid number for the argument {name}", text=text, name=name))
    return number


def _read_text(text: str) -> str:
    """Return a word unchanged; for a text in VARIANT notation (``8,100``), return the text alone (``100``)."""
    try:
        value = parse_lenient(text)
    except NotationError:
        return text
    return str(value.value) if value.type == VarType.BSTR else text
