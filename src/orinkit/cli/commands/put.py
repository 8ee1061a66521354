"""``orinkit put``: write a variable."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cli._shared.connection import ConnectionOptions, Json, OwnerOptions, Url
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli.commands.get import Name
from orinkit.core.errors import InvalidArgument, InvalidValue, NotationError
from orinkit.core.hresult import DISP_E_TYPEMISMATCH
from orinkit.core.i18n import tr
from orinkit.values.notation import parse_lenient
from orinkit.values.variant import R8_ARRAY, Variant, VarType, type_name, variant

_CONNECTION: Final = ConnectionOptions()
_OWNING: Final = OwnerOptions()

Text = Annotated[
    str,
    Parameter(
        required=True,
        help=tr(
            "100, 1.5, true or text; several numbers form an array; 2,100 or 8200,a,b specify the type "
            "(VARIANT notation), for example 8,100 for the text 100. Put -- before a text that begins with -."
        ),
    ),
]


def put(
    url: Url, name: Name, /, *value: Text, owning: OwnerOptions = _OWNING, connection: ConnectionOptions = _CONNECTION, json: Json = False
) -> None:  # fmt: skip
    """Write a variable; the controller converts the value to the type of the variable if possible."""
    from orinkit import functions
    from orinkit.cli._shared.output import print_json, text, typed_document
    from orinkit.cli._shared.terminal import one_line

    new = read_values(value)
    if len(value) == 1 and _DECIMAL_COMMA.fullmatch(value[0]) and new.type != VarType.BSTR:
        note = tr(
            "{value} is interpreted as VARIANT notation (type,value), not as a decimal number: {type}",
            value=value[0],
            type=type_name(new.type),
        )
        print(f"orinkit: {note} {one_line(text(new))}", file=sys.stderr)
    try:
        with connection.opened(url) as controller:
            owning.of(controller).variable(name).put_value(new)
    except InvalidArgument as error:
        if error.code != DISP_E_TYPEMISMATCH or error.function != functions.variable_put_value.name:
            raise
        raise CommandError(f"{error} {_type_hint()}") from None
    if json:
        print_json({"name": name, **typed_document(new)})
    else:
        print(f"{name} = {one_line(text(new))}")


_DECIMAL_COMMA: Final = re.compile(r"\s*\d+,\d+\s*")


def _type_hint() -> str:
    return tr(
        "On the command line: several numbers form an array (put URL P1 400 0 300 180 0 180 5), 8,100 means the "
        "text 100 (VARIANT type 8 is text), and a text with spaces must be quoted."
    )


def read_values(texts: tuple[str, ...]) -> Variant:
    """Return the value of one or several words: several numbers become a VT_R8 array, several texts a VT_BSTR array.

    Raises:
        CommandError: If a word is invalid VARIANT notation.
        InvalidValue: If the words cannot be combined in one array.
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
        raise usage_error(tr("VALUE {number}, {text!r:.60}: {error}", number=number, text=text, error=error)) from None
