"""Strings in VARIANT notation: quotation marks, brackets and commas in them.

In the notation of e-CAP (``exact``), a string in an array ends at the next comma that is not inside brackets, and a
string inside brackets ends at the bracket that closes them. Blanks count. If a bracket is not closed, brackets have no
meaning in the rest of the array. The document has no quotation marks. They are
used only for a string that cannot be written otherwise (:func:`needs_quotes`), and are read only around such a string
or around one that itself begins with a quotation mark. Any other string that begins with a quotation mark is taken
literally.

Two strings that begin with a quotation mark, and of which at least one is written literally, can look like one quoted
string: ``(8,"a),(8,"b)``. Such strings are quoted, too. So every string comes back unchanged.
"""

from __future__ import annotations

import re
from typing import Final

_BLANKS: Final = " \t\r\n"  # not an ideographic space, which is part of Japanese text
_PIECE: Final = 4096  # characters that are processed at a time, because this blocks other threads
_BRACKET: Final = re.compile(r"[()]")
_BRACKET_OR_COMMA: Final = re.compile(r"[(),]")


def quoted_text(text: str, *, in_array: bool = False, exact: bool = False, quotes: bool = True) -> str:
    """Return a string as text inside brackets or an array; quote it if it would otherwise be parsed differently.

    Args:
        text: the string.
        in_array: True in a VT_BSTR array.
        exact: True in the notation of e-CAP.
        quotes: True to quote a string that begins with a quotation mark; only e-CAP permits False.
    """
    if not text:
        return text
    if exact:
        special = (quotes and text[0] == '"') or needs_quotes(text, in_array=in_array)
    else:
        outer = text[0] in _BLANKS or text[-1] in _BLANKS or text[0] == '"'
        special = outer or (in_array and "," in text) or not _is_balanced(text)
    return f'"{_doubled(text)}"' if special else text


def needs_quotes(text: str, *, in_array: bool) -> bool:
    """Return True if a string cannot be written without quotation marks in the notation of e-CAP."""
    if not text.strip('"'):  # otherwise, an array of one empty string would be one without strings
        return True
    depth = 0
    for at in range(0, len(text), _PIECE):
        for sign in _BRACKET_OR_COMMA.findall(text, at, at + _PIECE):
            if sign == ",":
                if in_array and not depth:
                    return True
                continue
            depth += 1 if sign == "(" else -1
            if depth < 0:
                return True
    return depth != 0


def read_exactly(
    text: str, start: int, *, in_array: bool, in_brackets: bool, nests: bool = True
) -> tuple[str, int] | None:
    """Return the string that begins at ``start``, and the position after it; ``None`` if a bracket is not closed.

    Args:
        text: the whole text.
        start: position of the first character.
        in_array: True if a comma ends the string.
        in_brackets: True if a closing bracket ends the string.
        nests: True if a comma inside brackets does not end the string.
    """
    if text.startswith('"', start):
        end = end_of_quoted(text, start)
        if end >= 0 and _ends_at(text, end, in_array=in_array, in_brackets=in_brackets):
            value = undoubled(text[start + 1 : end - 1])
            if value.startswith('"') or needs_quotes(value, in_array=in_array):
                return value, end
    end = _end(text, start, in_array, in_brackets) if nests else _next_comma(text, start)
    return None if end < 0 else (text[start:end], end)


def end_of_quoted(text: str, start: int) -> int:
    """Return the position after the quotation mark that closes the one at ``start``; -1 if there is none."""
    end = text.find('"', start + 1)
    while end >= 0 and text.startswith('"', end + 1):
        end = text.find('"', end + 2)
    return end + 1 if end >= 0 else -1


def _ends_at(text: str, end: int, *, in_array: bool, in_brackets: bool) -> bool:
    return end == len(text) or (in_array and text[end] == ",") or (in_brackets and text[end] == ")")


def _next_comma(text: str, start: int) -> int:
    end = text.find(",", start)
    return end if end >= 0 else len(text)


def _end(text: str, start: int, in_array: bool, in_brackets: bool) -> int:
    """Return the position after a string without quotation marks; -1 if a bracket is not closed."""
    depth = 0
    for match in (_BRACKET_OR_COMMA if in_array else _BRACKET).finditer(text, start):
        sign, at = match[0], match.start()
        if sign == ",":
            if not depth:
                return at
        elif sign == "(":
            depth += 1
        elif depth:
            depth -= 1
        elif in_brackets:
            return at
    return -1 if depth else len(text)


def undoubled(text: str) -> str:
    """Return a text with each pair of quotation marks replaced by one.

    The text is processed in slices; a slice never ends inside such a pair.
    """
    pieces = []
    at = 0
    while at < len(text):
        end = at + _PIECE
        quotes = 0
        while end - quotes > at and text[end - quotes - 1 : end - quotes] == '"':
            quotes += 1
        end -= quotes % 2 if end < len(text) else 0
        pieces.append(text[at:end].replace('""', '"'))
        at = end
    return "".join(pieces)


def _doubled(text: str) -> str:
    return "".join([text[at : at + _PIECE].replace('"', '""') for at in range(0, len(text), _PIECE)])


def _is_balanced(text: str) -> bool:
    depth = 0
    for at in range(0, len(text), _PIECE):
        for sign in _BRACKET.findall(text, at, at + _PIECE):
            depth += 1 if sign == "(" else -1
            if depth < 0:
                return False
    return depth == 0
