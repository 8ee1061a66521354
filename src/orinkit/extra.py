"""Packages beyond the standard library, which parts of orinkit need and its core does not (extras of the package)."""

from __future__ import annotations

from importlib.util import find_spec

from orinkit.errors import MissingExtra
from orinkit.language import pick


def require(what: tuple[str, str], extra: str, *packages: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
        what: that needs them, in English and in Japanese.
        extra: of orinkit.
        packages: their names as modules.

    Raises:
        MissingExtra: one of them is not there.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        names = ", ".join(missing)
        english, japanese = what
        raise MissingExtra(
            pick(
                f"{english} needs {names}; install it with: pip install 'orinkit[{extra}]'",
                f"{japanese}には {names} が必要です。pip install 'orinkit[{extra}]' でインストールしてください",
            )
        )
