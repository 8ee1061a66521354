"""``orinkit put``: write a variable."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cli._connection import Connection, Json, Owning, Url
from orinkit.cli.get import Name
from orinkit.language import pick
from orinkit.notation import parse_lenient
from orinkit.variant import R8_ARRAY, Variant, variant

_CONNECTION: Final = Connection()
_OWNING: Final = Owning()

Text = Annotated[
    str,
    Parameter(
        required=True,
        help=pick(
            "100, 1.5, true, text; several numbers make an array; 2,100 or 8200,a,b name the type (VARIANT notation), "
            "8,100 is the text 100. Behind -- for a text that begins with -.",
            "100, 1.5, true, 文字列。複数の数値は配列になります。2,100 や 8200,a,b は型を指定した VARIANT 表記、"
            "8,100 は文字列の 100。- で始まる文字列は -- の後に書きます。",
        ),
    ),
]


def put(
    url: Url, name: Name, /, *value: Text, owning: Owning = _OWNING, connection: Connection = _CONNECTION, json: Json = False
) -> None:  # fmt: skip
    """Write a variable; the controller converts the value to the variable's type where it can."""
    from orinkit.cli._output import print_json, text, typed

    new = read_values(value)
    with connection.open(url) as controller:
        owning.of(controller).variable(name).put_value(new)
    if json:
        print_json({"name": name, **typed(new)})
    else:
        print(f"{name} = {text(new)}")


def read_values(texts: tuple[str, ...]) -> Variant:
    """Return the value of one or several words: numbers become a VT_R8 array, texts a VT_BSTR array.

    Raises:
        NotationError: a word begins as notation and is not.
        InvalidValue: no array can hold them together.
    """
    values = [parse_lenient(text) for text in texts]
    if len(values) == 1:
        return values[0]
    plain = [value.plain for value in values]
    if all(isinstance(item, int | float) and not isinstance(item, bool) for item in plain):
        return Variant(R8_ARRAY, plain)
    return variant(plain if all(isinstance(item, str) for item in plain) else values)
