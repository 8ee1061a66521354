"""The signature of a CAO function in one line."""

from __future__ import annotations

import json
from typing import Any

from orinkit.cao.argument_text import type_text
from orinkit.cao.table import Argument, Function


def signature(function: Function[..., Any]) -> str:
    """Return the signature: ``Robot_Move(handle, interpolation: VT_I4, pose: VARIANT, option: VT_BSTR = "")``."""
    arguments = ", ".join(map(_argument, function.arguments))
    return f"{function.name}({arguments}){f' -> {result(function)}' if function.result else ''}"


def result(function: Function[..., Any]) -> str:
    """Return the type of a function's result; ``""`` if it has none."""
    if function.result is None:
        return ""
    return f"{function.creates} handle" if function.creates else type_text(function.result)


def _argument(argument: Argument) -> str:
    if argument.is_handle:
        return argument.name
    text = f"{argument.name}: {type_text(argument.vt)}"
    if not argument.optional:
        return text
    if argument.omitted_by_default:
        return f"[{text}]"
    return f"{text} = {'VT_EMPTY' if argument.default is None else json.dumps(argument.default)}"
