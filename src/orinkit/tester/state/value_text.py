"""Values as users enter and read them: a type and a text (RC8 5.3)."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from types import MappingProxyType
from typing import Any, Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.notation import format_variant, parse, parse_data, parse_elements
from orinkit.values.types import ARRAY, EMPTIES, TABLE, VARIANT_ARRAY, VarType, type_name
from orinkit.values.variant import Variant, trusted

LONGEST_TEXT: Final = 100_000
"""Largest number of characters of a value in a form; longer ones are sent with ``orinkit call``."""
_SHOWN: Final = 400  # elements of a value that are displayed
_SHOWN_TEXT: Final = 4000  # characters of a value that are displayed


def _names() -> dict[int, str]:
    """Return the names of the types as in DENSO's Tester; VARIANT stands for the whole notation, with the type."""
    scalars = {int(row.code): row.code.name for row in TABLE if row.code != VarType.VARIANT}
    arrays = {ARRAY | int(row.code): f"ARRAY | {row.code.name}" for row in TABLE if row.code not in EMPTIES}
    return {**scalars, **arrays, int(VarType.VARIANT): "<type>,<data>"}


TYPES: Final[Mapping[int, str]] = MappingProxyType(_names())
"""The types that users can choose, by number, with their names."""


def read_value(vt: int, text: str) -> Variant:
    """Return the value of a text.

    For an array of VARIANT and for ``<type>,<data>``, the text may begin with its type (``8204,(8,P1),(3,0)``) or
    consist of the bracketed elements only (``(8197,0,0),(3,0),(3,-2)``).

    Args:
        vt: A key of :data:`TYPES`.
        text: The text.

    Raises:
        InvalidValue: If the text is too long, or there is no such type.
        NotationError: If the text is not a value of the type; the message contains the column.
    """
    check_length(text)
    if vt in (VARIANT_ARRAY, VarType.VARIANT):
        bracketed = text.lstrip().startswith("(") or (vt == VARIANT_ARRAY and not text.strip())
        value = trusted(VARIANT_ARRAY, parse_elements(text)) if bracketed else parse(text)
        if vt == VARIANT_ARRAY and value.type != vt:
            raise InvalidValue(
                tr(
                    "the text is a value of type {found}, not {wanted}",
                    found=type_name(value.type),
                    wanted=type_name(vt),
                )
            )
        return value
    if vt & ARRAY and not text.strip():
        raise InvalidValue(tr("the array is empty. Try: the elements, separated by commas"))
    return parse_data(vt, text)


def check_length(text: str, most: int = LONGEST_TEXT) -> str:
    """Return a text that is not too long.

    Raises:
        InvalidValue: If the text is too long; nothing is cut.
    """
    if len(text) > most:
        raise InvalidValue(
            tr("the text has {count} characters, more than {most}. Try: a shorter value", count=len(text), most=most)
        )
    return text


def describe(value: Variant) -> str:
    """Return the type of a value in plain words: ``VT_R8|VT_ARRAY, 7 elements``."""
    name = type_name(value.type)
    if value.type & ARRAY:
        count = len(value.value)
        return (
            tr("{type}, 1 element", type=name) if count == 1 else tr("{type}, {count} elements", type=name, count=count)
        )
    if value.type == VarType.BSTR:
        return tr("{type}, {count} characters", type=name, count=len(value.value))
    return name


def value_text(value: Variant) -> str:
    """Return a value as text in the form that :func:`read_value` accepts; ``(EMPTY)`` and ``(NULL)`` if it has no data.

    Long values are shortened, with an ellipsis.
    """
    if value.type in EMPTIES:
        return f"({VarType(value.type).name})"
    whole: Any = value.value
    cut = value.type & ARRAY and len(whole) > _SHOWN
    if cut:
        whole = bytes(whole[:_SHOWN]) if isinstance(whole, bytes) else list(islice(whole, _SHOWN))
    elif isinstance(whole, str):
        return whole if len(whole) <= _SHOWN_TEXT else f"{whole[:_SHOWN_TEXT]}…"
    text = format_variant(trusted(value.type, whole)).partition(",")[2]
    if len(text) > _SHOWN_TEXT:
        text, cut = text[:_SHOWN_TEXT], True
    return f"{text},…" if cut else text
