"""Checks for the third-party packages of optional features (the extras of the distribution)."""

from __future__ import annotations

from importlib.util import find_spec

from orinkit.core.errors import MissingExtra
from orinkit.core.i18n import tr


def require(what: str, extra: str, *packages: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
        what: Name of the feature that needs the packages, in the current language.
        extra: Name of the extra of orinkit.
        packages: Module names of the packages.

    Raises:
        MissingExtra: If a package is not installed.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        names = ", ".join(missing)
        raise MissingExtra(
            tr(
                "{what} needs {names}. Try: pip install 'orinkit[{extra}]'",
                what=what,
                names=names,
                extra=extra,
            )
        )
