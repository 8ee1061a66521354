"""A dissector of b-CAP for Wireshark, in Lua.

The template ``dissector.lua`` beside this module contains the code. The tables of functions, VARIANT types, return codes
and limits are generated from the tables of orinkit.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Final, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.dissect import LAST_FUNCTION_ID, LONGEST_VALUE
from orinkit.bcap.profiles import LINE
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.type_row import TypeRow
from orinkit.values.types import ARRAY, TABLE, UI1_ARRAY, VarType

_LuaValue: TypeAlias = "int | str | list[_LuaValue] | Mapping[str, _LuaValue]"

_TEMPLATE: Final = "dissector.lua"
_VERSION: Final = "@VERSION@"
_TABLES: Final = "@TABLES@"


def lua(version: str, port: int) -> str:
    """Return the text of the dissector; the descriptions in it are in the current language.

    Args:
        version: version of orinkit, which the text mentions.
        port: default port of b-CAP.
    """
    template = files("orinkit.bcap").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    return template.replace(_VERSION, version).replace(_TABLES, "\n".join(_tables(port)))


def _tables(port: int) -> list[str]:
    constants: dict[str, _LuaValue] = {
        "DEFAULT_PORTS": str(port),
        "SOH": packet.SOH,
        "EOT": packet.EOT,
        "HEADER": packet.HEADER.size,
        "OVERHEAD": packet.OVERHEAD,
        "SERIAL_PACKET": LINE.packet,
        "LIMITS": {
            "packet": DEFAULT_LIMITS.packet,
            "depth": DEFAULT_LIMITS.depth,
            "variants": DEFAULT_LIMITS.variants,
        },
        "SHOWN": LONGEST_VALUE,
        "LAST_FUNCTION_ID": LAST_FUNCTION_ID,
        "EXECUTING": hresult.S_EXECUTING,
        "ARRAY": ARRAY,
        "BYTES": UI1_ARRAY,
        "STRING": int(VarType.BSTR),
    }
    functions: dict[int, _LuaValue] = {
        code: {
            "name": function.name,
            "text": function.text,
            "creates": function.creates,
            "arguments": [argument.name for argument in function.arguments],
        }
        for code, function in FUNCTIONS.items()
    }
    codes: dict[int, _LuaValue] = {code: [row.name, row.text] for code, row in hresult.CODES.items()}
    types: dict[int, _LuaValue] = {int(row.code): _type(row) for row in TABLE}
    return [
        *(f"local {name} = {_literal(value)}" for name, value in constants.items()),
        *_numbered("FUNCTIONS", functions),
        *_numbered("RETURN_CODES", codes),
        *_numbered("TYPES", types),
    ]


def _type(row: TypeRow) -> _LuaValue:
    kind = "empty" if row.empty else row.number_kind or (row.python.__name__ if row.python else "variant")
    values: dict[str, _LuaValue] = {"name": row.name, "kind": kind, "elements_per_unit": row.elements_per_unit}
    return values | {"format": row.format, "size": row.size} if row.format else values


def _numbered(name: str, rows: Mapping[int, _LuaValue]) -> list[str]:
    return [f"local {name} = {{", *(f"    [{code}] = {_literal(row)}," for code, row in rows.items()), "}"]


def _literal(value: _LuaValue) -> str:
    """Return a value as Lua source."""
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    if isinstance(value, list):
        return "{" + ", ".join(map(_literal, value)) + "}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name} = {_literal(each)}" for name, each in value.items()) + "}"
    return str(value)
