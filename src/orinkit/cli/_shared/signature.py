"""A function of the table in one line, as the command line writes it."""

from __future__ import annotations

import json
from typing import Any

from orinkit.cao.table import Argument, Function
from orinkit.values.variant import VarType, type_name


def signature(function: Function[..., Any]) -> str:
    """Return ``Robot_Move(handle, interpolation: VT_I4, pose: VARIANT, option: VT_BSTR = "")``."""
    arguments = ", ".join(map(_argument, function.arguments))
    return f"{function.name}({arguments}){f' -> {result(function)}' if function.result else ''}"


def result(function: Function[..., Any]) -> str:
    """Return what a function answers with; ``""`` for nothing."""
    if function.result is None:
        return ""
    return f"{function.creates} handle" if function.creates else type_text(function.result)


def type_text(vt: VarType) -> str:
    """Return a type of the table; any type is ``VARIANT``."""
    return "VARIANT" if vt is VarType.VARIANT else type_name(vt)


def _argument(argument: Argument) -> str:
    if argument.is_handle:
        return argument.name
    text = f"{argument.name}: {type_text(argument.vt)}"
    if not argument.optional:
        return text
    if argument.unsent:
        return f"[{text}]"
    return f"{text} = {'VT_EMPTY' if argument.default is None else json.dumps(argument.default)}"
