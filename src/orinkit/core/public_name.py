"""The module that help() and tracebacks show for a public class."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

C = TypeVar("C", bound=type)


def public(module: str) -> Callable[[C], C]:
    """Return a decorator that shows a class as a name of the given module.

    It is for classes that a public module imports on first use; a public module marks its other classes itself.

    Args:
        module: ``"orinkit"`` or ``"orinkit.aio"``.
    """

    def show(kind: C) -> C:
        kind.__module__ = module
        return kind

    return show
