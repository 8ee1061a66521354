"""Packages beyond the standard library, which parts of orinkit need and its core does not (extras of the package)."""

from __future__ import annotations

from importlib.util import find_spec

from orinkit.core.errors import MissingExtra
from orinkit.core.i18n import tr


def require(what: str, extra: str, *packages: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
        what: that needs them, in the current language.
        extra: of orinkit.
        packages: their names as modules.

    Raises:
        MissingExtra: one of them is not there.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        names = ", ".join(missing)
        raise MissingExtra(
            tr(
                "{what} needs {names}; install it with: pip install 'orinkit[{extra}]'",
                what=what,
                names=names,
                extra=extra,
            )
        )
