"""Output of values: as text for people, as JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from datetime import datetime
from decimal import Decimal
from typing import Any, Final

from orinkit.cli._shared.terminal import json_text, one_line
from orinkit.values.notation import format_variant
from orinkit.values.types import ARRAY, EMPTIES, VarType, type_name
from orinkit.values.variant import Variant

_FLAGS: Final = {False: "false", True: "true"}


def text(value: Variant) -> str:
    """Return a value as text for people.

    A string is unchanged. An array of strings has one string per line. Any other value is in VARIANT notation without
    its type. ``orinkit put`` accepts the text of a single value.
    """
    vt, content = value.type, value.value
    if vt == VarType.BSTR:
        return str(content)
    if vt == VarType.BSTR | ARRAY:
        return "\n".join(map(one_line, content))
    if vt in EMPTIES:
        return type_name(vt)
    if vt & ~ARRAY == VarType.BOOL:
        return " ".join(_FLAGS[flag] for flag in content) if vt & ARRAY else _FLAGS[content]
    data = format_variant(value).partition(",")[2]
    return data.replace(",", " ") if vt & ARRAY and vt & ~ARRAY != VarType.VARIANT else data


def typed_document(value: Variant) -> dict[str, Any]:
    """Return a value for JSON, with its type and its VARIANT notation."""
    return {"type": type_name(value.type), "value": jsonable(value.plain), "notation": format_variant(value)}


def jsonable(value: Any) -> Any:
    """Convert a value to types that JSON supports.

    ``bytes`` become a string of hex digits, ``datetime`` ISO 8601 local time, ``Decimal`` a string of its digits; a
    number that is not finite becomes ``"NaN"``, ``"Infinity"`` or ``"-Infinity"``.
    """
    if isinstance(value, Variant):
        return jsonable(value.plain)
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Decimal):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return value


def print_json(document: object) -> None:
    """Print one JSON document; lone surrogates, which cannot be encoded, are escaped."""
    written = json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False)
    try:
        written.encode()
    except UnicodeEncodeError:
        written = json.dumps(document, indent=2, allow_nan=False)
    print(json_text(written))


def width(line: str) -> int:
    """Return the number of columns of a line; a full-width character takes two."""
    from unicodedata import east_asian_width

    return sum(2 if east_asian_width(character) in "WF" else 1 for character in line)


def padded(line: str, columns: int) -> str:
    """Return a line padded with spaces to a width."""
    return line + " " * (columns - width(line))


def table(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Return labels and their values as lines of two columns; a value may have several lines."""
    widest = max(width(label) for label, _ in rows)
    result = []
    for label, value in rows:
        first, *more = value.split("\n")
        result += [f"{padded(label, widest)}  {first}", *(f"{'':{widest}}  {line}" for line in more)]
    return result
