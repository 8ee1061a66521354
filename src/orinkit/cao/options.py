"""Option strings: ``"WDT=400,InvokeTimeout=180000"``, ``"@IfNotMember"`` (RC8 tables 3-1 and 5-1).

Pairs are separated by commas. A value may contain commas inside brackets or quotes. Names are case-insensitive. Empty
parts are ignored, for example the part before a leading comma, which some clients send. A name without a value means
``True``.
"""

from __future__ import annotations

import re
from typing import Final

from orinkit.cao.table import LONGEST_OPTION
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

_OPENING: Final = {"(": ")", "[": "]", "{": "}", "<": ">"}
_DECIMAL: Final = re.compile(r"\s*[+-]?[0-9]+\s*")
_HEX: Final = re.compile(r"\s*0[xX][0-9A-Fa-f]+\s*")
_QUOTES: Final = "\"'"


class Options:
    """The parsed options of one call; if an option is repeated, its last value applies.

    Attributes:
        text: the option string.
        repeated: names of repeated options, in lower case.

    Raises:
        CallError: E_INVALIDARG if the text has more than 4,096 characters.
    """

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST_OPTION:
            raise error_for(
                hresult.E_INVALIDARG,
                tr(
                    "option string of {count} characters exceeds the limit of {most} characters",
                    count=len(text),
                    most=LONGEST_OPTION,
                ),
            )
        self.text = text
        self._values: dict[str, str] = {}
        repeated: dict[str, None] = {}
        for part in split_options(text)[0]:
            name, equals, value = part.partition("=")
            name = name.strip().lower()
            if name in self._values:
                repeated[name] = None
            if name:
                self._values[name] = _unquoted(value.strip()) if equals else "True"
        self.repeated = tuple(repeated)

    def __contains__(self, name: str) -> bool:
        return name.lower() in self._values

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the options, in lower case."""
        return tuple(self._values)

    def text_of(self, name: str, default: str = "") -> str:
        """Return the value of an option as text; ``default`` if the option is absent."""
        return self._values.get(name.lower(), default)

    def flag(self, name: str) -> bool:
        """Return True if an option is on: present without a value, or with the value true, 1, -1, on or yes."""
        return self._values.get(name.lower(), "").lower() in ("true", "1", "-1", "on", "yes")

    def number(self, name: str) -> int | None:
        """Return the value of an option as a whole number, or ``None`` if it is absent.

        Raises:
            ValueError: If the value is not a whole number.
        """
        text = self._values.get(name.lower())
        if text is None:
            return None
        if _DECIMAL.fullmatch(text):  # int() accepts more: 4_00, full-width digits
            return int(text)
        if _HEX.fullmatch(text):
            return int(text, 16)
        raise ValueError(text)


def split_options(text: str) -> tuple[list[str], str]:
    """Split an option string at its commas; return the parts, and the bracket or quotation mark that is missing.

    Commas inside brackets and quotation marks do not split. The second result is ``""`` if no mark is missing.
    """
    parts: list[str] = []
    closing: list[str] = []
    start = 0
    for index, sign in enumerate(text):
        if closing:
            if sign == closing[-1]:
                closing.pop()
            elif closing[-1] not in _QUOTES and sign in _OPENING:
                closing.append(_OPENING[sign])
        elif sign in _QUOTES:
            closing.append(sign)
        elif sign in _OPENING:
            closing.append(_OPENING[sign])
        elif sign == ",":
            parts.append(text[start:index])
            start = index + 1
    return [*parts, text[start:]], closing[-1] if closing else ""


def _unquoted(value: str) -> str:
    return value[1:-1] if len(value) > 1 and value[0] in _QUOTES and value[-1] == value[0] else value
