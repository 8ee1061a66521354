"""The optional extension in C, ``orinkit.core._speedups``: loading it, and replacing Python functions by it.

Each function in C has a counterpart in Python with the same results and errors, and calls it for everything unusual.
The extension is built if a compiler is available when orinkit is installed. The environment variable ``ORINKIT_PURE=1``
disables it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final, TypeVar

from orinkit.core.i18n import tr

F = TypeVar("F", bound=Callable[..., Any])

_STALE: Final = "INTERFACE"
_COROUTINE: Final = 0x80  # inspect.CO_COROUTINE; importing inspect takes longer than orinkit.core
INTERFACE: Final = 4
"""Number of the interface of the extension that the modules in Python expect (``csrc/speedups.h``)."""


def _load() -> tuple[Any, str]:
    """Return the extension, or ``None`` and the reason."""
    if os.environ.get("ORINKIT_PURE", "") not in ("", "0"):
        return None, "ORINKIT_PURE"
    try:
        from orinkit.core import _speedups
    except ImportError as error:
        return None, str(error)
    # an editable installation keeps the extension when its sources change, for example after "git pull"
    if getattr(_speedups, "INTERFACE", None) != INTERFACE:
        return None, _STALE
    return _speedups, ""


EXTENSION: Any
EXTENSION, _reason = _load()
"""The extension; ``None`` if it is not used."""

PURE: Final[dict[str, Callable[..., Any]]] = {}
"""The Python functions that have a counterpart in C, by name."""


def replaced_in_c(function: F, name: str = "") -> F:
    """Return the counterpart of a function in C; return the function itself if the extension is not used.

    Coroutine functions have no counterpart.

    Args:
        function: The function.
        name: Name of the counterpart; by default, that of the function.
    """
    if function.__code__.co_flags & _COROUTINE:
        return function
    name = name or function.__name__
    PURE[name] = function
    if EXTENSION is None:
        return function
    counterpart: F = EXTENSION.replaced(name, function)
    return counterpart


def native_template(function: object, count: int, constants: bytes, varies: bool, most: int) -> object:
    """Return the template of a prepared call for the functions in C; ``None`` if the extension is not used.

    Args:
        function: The entry of the table of functions, with its ID and the type of its result.
        count: Number of arguments.
        constants: The encoded constant arguments.
        varies: True if there is a further argument, which varies.
        most: Largest size of a packet, bytes.
    """
    return None if EXTENSION is None else EXTENSION.native_template(function, count, constants, varies, most)


native_request: Callable[[object, int, object], bytes | None] | None = EXTENSION and EXTENSION.native_request
"""Return the packet of a prepared call: template, serial, varying argument. ``None`` if the extension is not used.

The result is ``None`` if the code in Python has to convert the varying argument, or to report its error.
"""


def status() -> str:
    """Return a sentence that states whether the extension is used, and if not, the reason."""
    if EXTENSION is not None:
        return tr("C extension: in use")
    if _reason == "ORINKIT_PURE":
        return tr("C extension: disabled by ORINKIT_PURE")
    if _reason == _STALE:
        return tr(
            "C extension: not in use, because it was built from another version of orinkit. Try: rebuild: make "
            "setup-dev in the source folder, or reinstall orinkit"
        )
    return tr("C extension: not built. Try: install a C compiler and the Python headers, then reinstall orinkit")
