"""Bytes typed in hex: separators and prefixes, and the text of bytes."""

from __future__ import annotations

import re
from typing import Final

SEPARATORS: Final = ",;:[]{}()'\""
"""Characters between bytes, besides white space."""
PREFIXES: Final = ("0x", "0X", "\\x", "&h", "&H")
PER_LINE: Final = 16

_TO_SPACES: Final = str.maketrans(dict.fromkeys(SEPARATORS, " "))
_SINGLE: Final = re.compile(r"(?:0[xX]|\\x|&[hH])([0-9A-Fa-f])(?![0-9A-Za-z])")  # 0x1


def masked(text: str) -> str:
    """Return a text of the same length, in which separators and prefixes are spaces; ``0x1`` becomes `` 01``."""
    text = _SINGLE.sub(r" 0\1", text) if any(prefix in text for prefix in PREFIXES) else text
    for prefix in PREFIXES:
        text = text.replace(prefix, "  ")
    return text.translate(_TO_SPACES)


def hex_text(data: bytes, per_line: int = PER_LINE) -> str:
    """Return bytes in hex, with several lines of ``per_line`` bytes."""
    return "\n".join(data[at : at + per_line].hex(" ") for at in range(0, len(data), per_line))
