"""Which language user-visible text is in: English or Japanese.

The choice is made once, from ``ORINKIT_LANG``, ``LC_ALL``, ``LC_MESSAGES`` or ``LANG`` (first one set), and may be
changed at any time with :func:`use`. Whatever the language, a text in which somebody else's may be is made
:func:`printable` for a terminal or a log.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from typing import Final, Literal

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


LONGEST: Final = 200
"""Characters of somebody else's text that an error or a log shows."""
_QUOTED: Final = 40  # of one that an error quotes


_STEERING: Final = re.compile(  # C0 and C1; what is not seen, or turns the direction of what follows; ends of lines
    "[\x00-\x1f\x7f-\x9f\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    "\U0001d173-\U0001d17a\U000e0000-\U000e007f]"
)


def visible(text: str, keep: str = "", escape: Callable[[str], str] = repr) -> str:
    """Return a text with its control characters as escapes: it must not steer the terminal it is shown on.

    Those are the control characters of ASCII and Unicode, those that set the direction of text, line separators, and
    characters that take no room.

    Args:
        text: somebody else's.
        keep: characters that stay.
        escape: makes a quoted text with escapes of a character.
    """
    if text.isprintable():
        return text
    return _STEERING.sub(lambda found: sign if (sign := found[0]) in keep else escape(sign)[1:-1], text)


def cut(text: str, longest: int = LONGEST) -> str:
    """Return the beginning of a text, with an ellipsis where it goes on."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def printable(text: str, longest: int = LONGEST) -> str:
    """Return the beginning of a text for a line that people read, :func:`visible`.

    It is cut first: escapes of a text of megabytes would take seconds.
    """
    return visible(cut(text, longest))


def quoted(text: object, longest: int = _QUOTED) -> str:
    """Return the beginning of somebody else's text as an error quotes it, or any other value as its short ``repr``."""
    return repr(cut(text, longest)) if isinstance(text, str) else cut(repr(text), longest)
