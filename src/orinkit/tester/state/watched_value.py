"""Values as text for users, and text that users enter as values: :func:`value_text`, :func:`entered_value`."""

from __future__ import annotations

import re
from datetime import datetime
from decimal import Decimal, InvalidOperation
from typing import Any, Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import cut, tr, visible
from orinkit.values.notation import parse_lenient
from orinkit.values.types import ARRAY, EMPTIES, VarType
from orinkit.values.variant import Variant

LONGEST_ENTRY: Final = 4000
"""Maximum number of characters of an entered value."""
_SHOWN: Final = 300
_SHOWN_ELEMENTS: Final = 32
_WORDS: Final = {
    **dict.fromkeys(("true", "on", "1", "-1"), True),
    **dict.fromkeys(("false", "off", "0"), False),
}
_REALS: Final = (VarType.R4, VarType.R8)


def value_text(value: Variant | None) -> str:
    """Return a value as short text in one line, with control characters escaped."""
    if value is None or value.type in EMPTIES:
        return "–"
    content, kind = value.value, value.type & ~ARRAY
    if isinstance(content, list):
        more = "" if len(content) <= _SHOWN_ELEMENTS else f", … ({len(content)})"
        return cut(", ".join(_element(each, kind) for each in content[:_SHOWN_ELEMENTS]) + more, _SHOWN)
    if isinstance(content, bytes):
        return cut(content[:_SHOWN].hex(" "), _SHOWN)
    if content == "":
        return '""'
    plain = value.plain
    return _element(plain if isinstance(plain, datetime) else content, kind)


def _element(content: Any, kind: int) -> str:
    if isinstance(content, Variant):
        return value_text(content)
    if isinstance(content, bool):
        return "true" if content else "false"
    if isinstance(content, float):
        return f"{content:.7g}" if kind == VarType.R4 else f"{content:.10g}"
    if isinstance(content, datetime):
        return content.isoformat(" ", "seconds")
    return visible(cut(f"{content}", _SHOWN))


def entered_value(text: str, vt: int) -> Variant:
    """Return the value that a user has entered for a variable.

    Args:
        text: ``12``, ``1.5``, ``on``, ``text``, ``2026-11-24 10:00:00``; the elements of an array are separated by
            commas or spaces.
        vt: VARIANT type of the variable; VT_EMPTY if unknown, so that the type follows from the text.

    Raises:
        InvalidValue: If the text is not a value of this type.
        NotationError: If the type is unknown and the text is invalid VARIANT notation.
    """
    if len(text) > LONGEST_ENTRY:
        raise InvalidValue(
            tr("the value is too long: {count} characters; at most {most}", count=len(text), most=LONGEST_ENTRY)
        )
    kind = vt & ~ARRAY
    if vt in EMPTIES or kind == VarType.VARIANT:
        return parse_lenient(text)
    if vt == VarType.BSTR:
        return Variant(vt, text)
    if not text.strip():
        raise InvalidValue(tr("the value is empty"))
    if not vt & ARRAY:
        return Variant(vt, _scalar(text.strip(), kind))
    parts = text.split(",") if "," in text else text.split()
    return Variant(vt, _array([each.strip() for each in parts], kind))


def _array(parts: list[str], kind: int) -> Any:
    values = [_scalar(each, kind) for each in parts]
    return bytes(values) if kind == VarType.UI1 and all(0 <= each <= 255 for each in values) else values


def _scalar(text: str, kind: int) -> Any:
    try:
        if kind == VarType.BSTR:
            return text
        if kind == VarType.BOOL:
            return _WORDS[text.lower()]
        if kind in _REALS:
            return float(text)
        if kind == VarType.DATE:
            return datetime.fromisoformat(text)
        if kind == VarType.CY:
            return Decimal(text)
        return int(text, 16) if re.match(r"[-+]?0[xX]", text) else int(text)
    except (KeyError, ValueError, InvalidOperation):
        raise InvalidValue(_expectation(kind).format(text=repr(cut(text, 40)))) from None


def _expectation(kind: int) -> str:
    if kind == VarType.BOOL:
        return tr("{text} is neither on nor off. Try: on or off")
    if kind == VarType.DATE:
        return tr("{text} is not a date and time. Try: 2026-11-24 10:00:00")
    if kind in (*_REALS, VarType.CY):
        return tr("{text} is not a number. Try: 1.5")
    return tr("{text} is not a whole number. Try: 12 or 0x0C")
