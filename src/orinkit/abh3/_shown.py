"""Values in error messages."""

from __future__ import annotations

from typing import Final

_LONGEST: Final = 40
_DECIMAL: Final = 1 << 64


def shown(value: object) -> str:
    """Return a value for a message, cut off where it is long; a great whole number in hexadecimal, which is no work."""
    great = isinstance(value, int) and not -_DECIMAL < value < _DECIMAL
    text = f"{value:#x}" if great else repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
