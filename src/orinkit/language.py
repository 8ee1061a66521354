"""Which language user-visible text is in: English or Japanese.

The choice is made once, from ``ORINKIT_LANG``, ``LC_ALL``, ``LC_MESSAGES`` or ``LANG`` (first one set), and may be
changed at any time with :func:`use`. Whatever the language, a text in which somebody else's may be is made
:func:`printable` for a terminal or a log.
"""

from __future__ import annotations

import os
from typing import Literal

Language = Literal["en", "ja"]


def _from_environment() -> Language:
    for name in ("ORINKIT_LANG", "LC_ALL", "LC_MESSAGES", "LANG"):
        value = os.environ.get(name)
        if value:
            return "ja" if value.lower().startswith("ja") else "en"
    return "en"


_current: Language = _from_environment()


def use(language: Language) -> None:
    """Set the language of every text from now on: ``"en"`` or ``"ja"``."""
    global _current
    if language not in ("en", "ja"):
        raise ValueError(f'language must be "en" or "ja", not {language!r}')
    _current = language


def current() -> Language:
    """Return the language in force."""
    return _current


def pick(en: str, ja: str) -> str:
    """Return the one of two texts that is in the language in force."""
    return ja if _current == "ja" else en


def printable(text: str) -> str:
    """Return a text as one line with its control characters visible: it must not steer the terminal it is shown on."""
    return text if text.isprintable() else "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)
