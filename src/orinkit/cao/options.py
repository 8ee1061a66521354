"""Option strings: ``"WDT=400,InvokeTimeout=180000"``, ``"@IfNotMember"`` (RC8 table 3-1 and 5-1).

Pairs are separated by commas; a value may hold commas inside brackets or quotes; names are case-insensitive; empty
parts, as in the leading comma that some clients send, are passed over. A name without a value means ``True``.
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
    """The parsed options of one call; of those that are given twice the last one counts.

    Attributes:
        text: as it was given.
        repeated: names that are given more than once, in lower case.

    Raises:
        CallError: E_INVALIDARG, the text has more than 4,096 characters.
    """

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST_OPTION:
            raise error_for(
                hresult.E_INVALIDARG,
                tr(
                    "an option string of {count} characters, at most {most} are read",
                    count=len(text),
                    most=LONGEST_OPTION,
                ),
            )
        self.text = text
        self._values: dict[str, str] = {}
        repeated: dict[str, None] = {}
        for part in _split(text):
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
        """The names of the options that are given, in lower case."""
        return tuple(self._values)

    def text_of(self, name: str, default: str = "") -> str:
        """Return the value of an option as text."""
        return self._values.get(name.lower(), default)

    def flag(self, name: str) -> bool:
        """Return whether an option is on: given without a value, or as true, 1, on, yes."""
        return self._values.get(name.lower(), "").lower() in ("true", "1", "-1", "on", "yes")

    def number(self, name: str) -> int | None:
        """Return the value of an option as a whole number, ``None`` when it is not given.

        Raises:
            ValueError: it is given and is no whole number.
        """
        text = self._values.get(name.lower())
        if text is None:
            return None
        if _DECIMAL.fullmatch(text):  # int() takes more: 4_00, full-width digits
            return int(text)
        if _HEX.fullmatch(text):
            return int(text, 16)
        raise ValueError(text)


def _split(text: str) -> list[str]:
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
    return [*parts, text[start:]]


def _unquoted(value: str) -> str:
    return value[1:-1] if len(value) > 1 and value[0] in _QUOTES and value[-1] == value[0] else value
