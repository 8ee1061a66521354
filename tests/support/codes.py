"""Return codes of calls."""

from __future__ import annotations

from collections.abc import Callable

from orinkit.core.errors import CallError


def code_of(call: Callable[..., object], *arguments: object) -> int:
    """Make a call; return the code of its error, or 0."""
    try:
        call(*arguments)
    except CallError as error:
        return error.code
    return 0
