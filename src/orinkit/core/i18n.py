"""The language of user-visible text, English or Japanese, and safe display of external text.

The source contains the English messages. The Japanese ones are in ``locale/ja/LC_MESSAGES/orinkit.po``, which
``tools/messages.py`` updates from the source. The initial language is taken from ``ORINKIT_LANG``, ``LC_ALL``,
``LC_MESSAGES`` or ``LANG`` (the first that is set); :func:`use` changes it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Final, Literal, Protocol, Self

if TYPE_CHECKING:
    from gettext import NullTranslations

Language = Literal["en", "ja"]


class Translate(Protocol):
    """A function that returns a message in a certain language, for example :func:`tr` (the current language)."""

    def __call__(self, message: str, /, **values: object) -> str:
        """Return the message in the language of this function, with the values inserted at their placeholders."""


def _from_environment() -> Language:
    for name in ("ORINKIT_LANG", "LC_ALL", "LC_MESSAGES", "LANG"):
        value = os.environ.get(name)
        if value:
            return "ja" if value.lower().startswith("ja") else "en"
    return "en"


_current: Language = _from_environment()
_source: Callable[[], Language | None] | None = None


def use(language: Language) -> None:
    """Set the language of all further texts: ``"en"`` or ``"ja"``."""
    global _current
    if language not in ("en", "ja"):
        raise ValueError(f'language must be "en" or "ja", not {language!r}')
    _current = language


def current() -> Language:
    """Return the current language."""
    return (_source and _source()) or _current


def set_source(source: Callable[[], Language | None] | None) -> None:
    """Set the callback that returns the language of the current context, for programs with users of both languages.

    If the callback returns ``None``, or is ``None``, the language is the one set with :func:`use`.
    """
    global _source
    _source = source


def tr(message: str, /, **values: object) -> str:
    """Return a message in the current language.

    In a program with users of both languages (:func:`set_source`), the result is translated again if it is displayed
    in another context, for example by ``str()`` or as the text of an exception.

    Args:
        message: English text, a literal, with placeholders as for ``str.format``.
        values: Values of the placeholders. Without values, braces in the message are literal.
    """
    text = translate(current(), message, **values)
    return _SharedText(text, message, values) if _source is not None else text


class _SharedText(str):
    """A message that may be displayed in other languages than the one in which it was created.

    An exception of a connection that several users share is created once, in the language of one user or of the process.
    As a string, a message has that language; ``str()`` and ``format()`` return it in the current one.
    """

    __slots__ = ("_message", "_values")

    _message: str
    _values: dict[str, object]

    def __new__(cls, text: str, message: str, values: dict[str, object]) -> Self:
        self = super().__new__(cls, text)
        self._message, self._values = message, values
        return self

    def __str__(self) -> str:
        return translate(current(), self._message, **self._values)

    def __format__(self, specification: str) -> str:
        return format(str(self), specification)

    def __reduce__(self) -> tuple[type[str], tuple[str]]:  # the values may not be picklable
        return str, (str(self),)


def choose(en: str, ja: str) -> str:
    """Return the text in the current language, out of an English and a Japanese one."""
    return ja if current() == "ja" else en


def N_(message: str) -> str:  # noqa: N802 - the name that gettext requires
    """Mark a message for the catalogue and return it unchanged; pass it to :func:`tr` to display it."""
    return message


def translate(language: Language, message: str, /, **values: object) -> str:
    """Return a message in the language ``language``; the other arguments are those of :func:`tr`."""
    text = _japanese().gettext(message) if language == "ja" and message else message
    return text.format(**values) if values else text


@cache
def _japanese() -> NullTranslations:
    import gettext
    from importlib.resources import files

    with (files("orinkit") / "locale" / "ja" / "LC_MESSAGES" / "orinkit.mo").open("rb") as file:
        return gettext.GNUTranslations(file)


LONGEST: Final = 200
"""Maximum number of characters of an external text in an error or a log."""
_QUOTED: Final = 40  # maximum number of characters of a text that an error message quotes


_SPACES: Final = frozenset(  # the spaces of Unicode, including Japanese ones, and the joiners in emoji and Indic words
    "\u00a0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a\u200c\u200d\u202f\u205f\u3000"
)


def visible(text: str, keep: str = "", escape: Callable[[str], str] = repr) -> str:
    """Return a text with its control characters escaped, so that it cannot control the terminal that displays it.

    The control characters of ASCII and Unicode, direction marks, line separators, zero-width characters and unassigned
    code points are escaped.

    Args:
        text: External text.
        keep: Characters to leave unchanged.
        escape: Function that returns a character as a quoted, escaped text.
    """
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign in _SPACES or sign in keep else escape(sign)[1:-1] for sign in text
    )


def cut(text: str, longest: int = LONGEST) -> str:
    """Return the beginning of a text, with an ellipsis if it was shortened."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def printable(text: str, longest: int = LONGEST) -> str:
    """Return the beginning of a text for display, with control characters escaped (:func:`visible`).

    The text is shortened first, because escaping several megabytes takes seconds.
    """
    return visible(cut(text, longest))


def quoted(text: object, longest: int = _QUOTED) -> str:
    """Return the beginning of an external text in quotation marks, or the shortened ``repr`` of another value."""
    return repr(cut(text, longest)) if isinstance(text, str) else cut(repr(text), longest)
