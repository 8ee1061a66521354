"""``orinkit put``: write a variable."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cli._connection import Connection, Json, Owning, Url
from orinkit.cli._errors import Failure, unusable
from orinkit.cli.get import Name
from orinkit.errors import InvalidArgument, InvalidValue, NotationError
from orinkit.hresult import DISP_E_TYPEMISMATCH
from orinkit.language import pick
from orinkit.notation import parse_lenient
from orinkit.variant import R8_ARRAY, Variant, VarType, type_name, variant

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
    from orinkit import functions
    from orinkit.cli._output import print_json, text, typed
    from orinkit.cli._terminal import one_line

    new = read_values(value)
    if len(value) == 1 and _DECIMAL_COMMA.fullmatch(value[0]) and new.type != VarType.BSTR:
        note = pick(
            f"{value[0]} is VARIANT notation: {type_name(new.type)}",
            f"{value[0]} は VARIANT 表記です: {type_name(new.type)}",
        )
        print(f"orinkit: {note} {one_line(text(new))}", file=sys.stderr)
    try:
        with connection.opened(url) as controller:
            owning.of(controller).variable(name).put_value(new)
    except InvalidArgument as error:
        if error.code != DISP_E_TYPEMISMATCH or error.function != functions.variable_put_value.name:
            raise
        raise Failure(f"{error} {_cure()}") from None
    if json:
        print_json({"name": name, **typed(new)})
    else:
        print(f"{name} = {one_line(text(new))}")


_DECIMAL_COMMA: Final = re.compile(r"\s*\d+,\d+\s*")


def _cure() -> str:
    return pick(
        "On the command line: several numbers make an array (put URL P1 400 0 300 180 0 180 5), 8,100 is the text 100, "
        "and a text with blanks wants quotes.",
        "コマンドラインでは、複数の数値は配列 (put URL P1 400 0 300 180 0 180 5)、8,100 は文字列の 100、"
        "空白を含む文字列は引用符で囲みます。",
    )


def read_values(texts: tuple[str, ...]) -> Variant:
    """Return the value of one or several words: numbers become a VT_R8 array, texts a VT_BSTR array.

    Raises:
        NotationError: a word begins as notation and is not.
        InvalidValue: no array can hold them together.
    """
    values = [_read(number, text) for number, text in enumerate(texts, 1)]
    if len(values) == 1:
        return values[0]
    plain = [value.plain for value in values]
    if all(isinstance(item, int | float) and not isinstance(item, bool) for item in plain):
        return Variant(R8_ARRAY, plain)
    return variant(plain if all(isinstance(item, str) for item in plain) else values)


def _read(number: int, text: str) -> Variant:
    try:
        return parse_lenient(text)
    except (NotationError, InvalidValue) as error:
        raise unusable(f"VALUE {number}, {text!r:.60}: {error}", f"{number} 番目の値 {text!r:.60}: {error}") from None
