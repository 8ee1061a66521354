"""The language of user-visible text, English or Japanese, and safe display of text from elsewhere.

Messages are English in the source; the Japanese ones are in ``locale/ja/LC_MESSAGES/orinkit.po``, which ``tools/messages.py``
keeps in step with the source. The language is chosen from ``ORINKIT_LANG``, ``LC_ALL``, ``LC_MESSAGES`` or ``LANG`` (the
first that is set); :func:`use` changes it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from gettext import NullTranslations

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


def tr(message: str, /, **values: object) -> str:
    """Return a message in the current language.

    Args:
        message: the English text, a literal; placeholders are written as for ``str.format``.
        values: the values of the placeholders. Without any, braces in the message have no meaning.
    """
    return translate(_current, message, **values)


def choose(en: str, ja: str) -> str:
    """Return the one of two texts of a bilingual table that is in the current language."""
    return ja if _current == "ja" else en


def N_(message: str) -> str:  # noqa: N802 - the name by which gettext knows it
    """Return the message as it is: it is in the catalogue, and :func:`tr` translates it when it is shown."""
    return message


def translate(language: Language, message: str, /, **values: object) -> str:
    """Return a message in a given language; otherwise like :func:`tr`."""
    text = _japanese().gettext(message) if language == "ja" and message else message
    return text.format(**values) if values else text


@cache
def _japanese() -> NullTranslations:
    import gettext
    from importlib.resources import files

    with (files("orinkit") / "locale" / "ja" / "LC_MESSAGES" / "orinkit.mo").open("rb") as file:
        return gettext.GNUTranslations(file)


LONGEST: Final = 200
"""Characters of somebody else's text that an error or a log shows."""
_QUOTED: Final = 40  # of one that an error quotes


_SPACES: Final = frozenset(  # of Unicode, Japanese ones among them, and the joiners within emoji and Indic words
    "\u00a0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a\u200c\u200d\u202f\u205f\u3000"
)


def visible(text: str, keep: str = "", escape: Callable[[str], str] = repr) -> str:
    """Return a text with its control characters as escapes: it must not steer the terminal it is shown on.

    Those are the control characters of ASCII and Unicode, those that set the direction of text, line separators,
    characters that take no room, and those that Unicode has not assigned.

    Args:
        text: somebody else's.
        keep: characters that stay.
        escape: makes a quoted text with escapes of a character.
    """
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign in _SPACES or sign in keep else escape(sign)[1:-1] for sign in text
    )


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
