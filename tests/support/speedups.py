"""Comparison of the extension in C with the Python functions that it replaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from orinkit.core.speedups import EXTENSION, PURE
from support.strategies import same

needs_extension = pytest.mark.skipif(EXTENSION is None, reason="the C extension is not built, or disabled")


def outcome(function: Callable[..., Any], *arguments: Any, **named: Any) -> tuple[Any, ...]:
    """Return the result of a function, or the type, the text and the return code of its exception."""
    try:
        return ("result", function(*arguments, **named))
    except Exception as error:  # noqa: BLE001 - any exception is an outcome
        return (type(error), str(error), getattr(error, "code", None), getattr(error, "fatal", None))


def alike(one: Any, other: Any) -> bool:
    """Compare like :func:`~support.strategies.same`, also within tuples."""
    if isinstance(one, tuple) and type(one) is type(other):
        return len(one) == len(other) and all(map(alike, one, other))
    return same(one, other)


def check_same_outcome(name: str, native: Callable[..., Any], *arguments: Any, **named: Any) -> None:
    """Call a function and its counterpart in Python with the same arguments; fail if the outcomes differ."""
    expected = outcome(PURE[name], *arguments, **named)
    found = outcome(native, *arguments, **named)
    assert alike(found, expected), f"{name}{arguments!r} {named!r}: {found!r}, in Python: {expected!r}"
