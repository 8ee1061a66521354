"""What a virtual device needs besides the standard library."""

from __future__ import annotations

from importlib.util import find_spec

from orinkit.errors import MissingExtra
from orinkit.language import pick


def require(what: str, extra: str, *packages: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
        what: the module that needs them.
        extra: of orinkit.
        packages: their names as modules.

    Raises:
        MissingExtra: one of them is not there.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        names = ", ".join(missing)
        raise MissingExtra(
            pick(
                f"{what} needs {names}; install it with: pip install 'orinkit[{extra}]'",
                f"{what} には {names} が必要です。pip install 'orinkit[{extra}]' でインストールしてください",
            )
        )
