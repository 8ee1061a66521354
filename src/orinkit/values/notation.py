"""Conversion of VARIANTs to and from text (e-CAP 3.5; the b-CAP Tester uses the same form, RC8 5.3).

The notation is ``<type>,<data>``. The type is the VARTYPE number, plus 8192 for an array. The elements of an array are
separated by commas. Each element of a VARIANT array is in brackets.

=====================================  ==========================================================================
text                                   VARIANT
=====================================  ==========================================================================
``2,100``                              VT_I2 100
``8,Sample,Test``                      VT_BSTR "Sample,Test": everything after the first comma, unchanged
``8194,100,200,300``                   VT_I2 array
``8200,Sample,Test``                   VT_BSTR array of two
``8204,(8,Sample),(2,100)``            VARIANT array: "Sample", 100; nested up to 16 deep
``12,(8,Sample)``                      VT_VARIANT, which contains the value in the brackets
``(8197, 0, 0), (3, 0), (3, -2)``      the elements of a VARIANT array without its type, as entered in the b-CAP
                                       Tester; only for :func:`parse_elements`
=====================================  ==========================================================================

The documents do not specify the form of the other types, and do not specify which characters a string may contain. This
module uses these rules:

* Numbers are decimal. Whole numbers and VT_ERROR may also be hexadecimal with ``0x``. VT_R4 and VT_R8 may have a
  decimal point and an exponent, or be ``inf`` or ``nan``. VT_CY has up to four decimals. VT_BOOL is ``-1``, ``1`` or
  ``True`` for true, and ``0`` or ``False`` for false. VT_DATE is ``2026-11-21 10:00:00.5`` in local time, or a number
  of OLE days; the forms ``2026/11/21``, ``T`` between date and time, and a date without a time are also valid. Blanks
  around a number are ignored. VT_EMPTY is ``0,``, VT_NULL is ``1,``, and an array without elements is ``8197,``; the
  comma of these three is optional.
* A single string (``8,...`` as the whole text) is never changed.
* Inside brackets and in a VT_BSTR array, blanks around a string are ignored, and brackets in it must be balanced:
  ``(8,@P P(1,2,3))`` is one string. A comma inside brackets does not separate strings: ``8200,P(1,2),P2`` has two.
* Inside brackets and in a VT_BSTR array, a string to which these two rules cannot be applied is quoted, with each ``"``
  in it doubled: ``(8," :-) ")``, ``8200,"a,b",c``. A string counts as quoted only if it begins with ``"``. ``8200,`` is
  an array without strings, and ``8200,""`` is an array of one empty string.

e-CAP uses ``exact=True``, because its document has neither quotes nor ignored blanks: blanks around strings are kept,
an unbalanced bracket in a VT_BSTR array is part of the string, and a string in quotes is unquoted only if it begins with
a quotation mark itself or could not be written otherwise (:mod:`orinkit.values.notation_strings`).

For every VARIANT, ``parse(format_variant(value))`` is therefore the same value with the same types (a VT_R4 in single
precision, as in a packet). Plain text is written as in the documents.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.values.notation_numbers import FLAGS, LONGEST, REAL, WHOLE, ElementFormat
from orinkit.values.notation_strings import end_of_quoted, quoted_text, read_exactly, undoubled
from orinkit.values.type_row import no_type
from orinkit.values.types import ARRAY, EMPTIES, ROWS, TABLE, UI1_ARRAY, VarType, type_name
from orinkit.values.variant import Value, Variant, trusted, variant

MAX_DEPTH: Final = 16
"""Largest nesting depth of VARIANT arrays and brackets, as in a packet."""
MAX_LENGTH: Final = 16 * 1024 * 1024
"""Largest number of characters of a text to parse."""

_BLANKS: Final = " \t\r\n"  # not an ideographic space, which is part of Japanese text
_PIECE: Final = 4096  # elements or characters that are processed at a time, because this blocks other threads
_MAX_PADDED: Final = 65_536  # largest length of a number including the blanks around it
_SHOWN: Final = 20  # characters of a text that an error message quotes

_FORMS: Final[dict[int, ElementFormat]] = {int(row.code): row.text for row in TABLE if row.text is not None}
_TYPES: Final = frozenset(ROWS) | {ARRAY | base for base in ROWS if base not in EMPTIES}
_KNOWN: Final = ", ".join(str(int(vt)) for vt in sorted(_TYPES) if vt < ARRAY)


# --- text -> Variant --------------------------------------------------------------------------------------------------


def parse(text: str, *, exact: bool = False) -> Variant:
    """Parse ``<type>,<data>`` by the rules of this module's docstring.

    Args:
        text: The text.
        exact: True for the strings of e-CAP, in which blanks count.

    Raises:
        NotationError: If the text is not valid VARIANT notation, is nested deeper than MAX_DEPTH, or is longer than
            MAX_LENGTH. The message contains the column, counted from 1, and the expected text.
    """
    reader = _NotationParser(text, exact=exact)
    result = reader.variant()
    reader.finish()
    return result


def parse_elements(text: str) -> list[Variant]:
    """Parse the elements of a VARIANT array without its type, as they are entered in the b-CAP Tester (RC8 5.3).

    For example, ``(8197, 0, 0, 0, 0, 0, 0, 5), (3, 0), (3, -2)`` is a pose of Robot_Move. A blank text has no elements.

    Raises:
        NotationError: As for :func:`parse`.
    """
    reader = _NotationParser(text)
    result = reader.elements()
    reader.finish()
    return result


def parse_data(vt: int, text: str) -> Variant:
    """Parse ``<data>``, the second part of the notation, as a value of a type that is known.

    Args:
        vt: Number of the type.
        text: The data: ``100,200`` for an array of VT_I2.

    Raises:
        NotationError: As for :func:`parse`; the columns are those of ``text``.
        InvalidValue: If there is no such type.
    """
    if vt not in _TYPES:
        raise no_type(type_name(vt), vt)
    reader = _NotationParser(text)
    result = reader.data(vt)
    reader.finish()
    return result


_NOTATION: Final = re.compile(rf"[{_BLANKS}]*([0-9]{{1,5}})[{_BLANKS}]*,")


def parse_lenient(text: str) -> Variant:
    """Parse a value from a command line; the type is optional.

    If a text begins with the number of a type and a comma, it is parsed as by :func:`parse`. For other texts, the type
    is inferred:

    ==============================  =====================================================================
    ``2,100``                       VT_I2 100
    ``100``, ``-5``, ``0x1F``       VT_I4; error if out of range (use ``20,...`` VT_I8, ``5,...`` VT_R8)
    ``1.5``, ``1e3``                VT_R8
    ``true``, ``False``             VT_BOOL
    ``P1``, ``J(1,2,3)``, ``a,b``   VT_BSTR, like any other text, including an empty one
    ``8,100``, ``8,2,100``          VT_BSTR "100", "2,100": strings that would otherwise have another type
    ==============================  =====================================================================

    Raises:
        NotationError: If the text begins with a type and a comma but is not valid, or is a whole number outside the
            range of VT_I4.
    """
    match = _NOTATION.match(text)
    if match and int(match[1]) in _TYPES:
        return parse(text)
    reader = _NotationParser(text)
    word = text.strip(_BLANKS)
    if len(word) <= LONGEST:
        if word.lower() in ("true", "false"):
            return trusted(VarType.BOOL, FLAGS[word.lower()])
        if WHOLE.fullmatch(word):
            return trusted(VarType.I4, reader.number(VarType.I4, len(text)))
        real = REAL.fullmatch(word)
        if real and not real[1]:  # "inf" and "nan" are strings here
            return trusted(VarType.R8, reader.number(VarType.R8, len(text)))
    return trusted(VarType.BSTR, text)


_HEAD: Final = re.compile(rf"([0-9]{{1,5}})[{_BLANKS}]*")
_SPACE: Final = re.compile(rf"[{_BLANKS}]*")
_BRACKET: Final = re.compile(r"[()]")
_BRACKET_OR_COMMA: Final = re.compile(r"[(),]")


def _error(at: int, problem: str) -> NotationError:
    return NotationError(tr("column {column}: {problem}", column=at + 1, problem=problem))


class _NotationParser:
    """Parses a text in one pass; ``at`` is the position, ``depth`` the number of open brackets."""

    __slots__ = ("at", "depth", "exact", "text")

    def __init__(self, text: str, *, exact: bool = False) -> None:
        self.text, self.at, self.depth, self.exact = text, 0, 0, exact
        if len(text) > MAX_LENGTH:
            raise _error(
                MAX_LENGTH,
                tr("the text is longer than {most} characters", most=MAX_LENGTH),
            )

    def variant(self) -> Variant:
        """Read ``<type>,<data>``."""
        vt = self._type()
        if not self._skip(","):
            if not vt & ARRAY and vt not in EMPTIES:
                name = f"{type_name(vt)} ({vt})"
                raise self._expected(tr('"," and the value of {name}', name=name))
            return trusted(vt, b"" if vt == UI1_ARRAY else [] if vt & ARRAY else None)
        return self.data(vt)

    def data(self, vt: int) -> Variant:
        """Read the data of a VARIANT whose type is known."""
        base = vt & ~ARRAY
        if vt == VarType.VARIANT:
            return trusted(vt, self._bracketed())
        if vt in EMPTIES:
            self._blank()
            return trusted(vt, None)
        if base == VarType.VARIANT:
            return trusted(vt, self.elements())
        if base == VarType.BSTR:
            return trusted(vt, self._strings() if vt & ARRAY else self._string())
        return trusted(vt, self._numbers(base) if vt & ARRAY else self.number(base, self._end_of_numbers()))

    def elements(self) -> list[Variant]:
        """Read bracketed VARIANTs up to the end of the text or of the enclosing bracket."""
        self._check_depth()
        if self._at_end():
            return []
        result = [self._bracketed()]
        while self._skip(","):
            result.append(self._bracketed())
        return result

    def number(self, base: int, end: int) -> Any:
        """Read one element of the type ``base``, neither VT_BSTR nor VT_VARIANT; the element ends at ``end``."""
        self._blank()
        piece = self.text[self.at : end]
        piece = piece.strip(_BLANKS) if len(piece) <= _MAX_PADDED else piece[: LONGEST + 1]
        form = _FORMS[base]
        value = form.read(piece) if len(piece) <= LONGEST else None
        if value is None:
            wanted = tr("{wanted} ({type})", wanted=form.wanted, type=type_name(base))
            raise self._expected(wanted, len(piece))
        self.at = end
        return value

    def finish(self) -> None:
        """Raise an error if any text except blanks follows."""
        self._blank()
        if self.at < len(self.text):
            found = self.text[self.at : self.at + _SHOWN]
            raise _error(
                self.at,
                tr("expected the end of the text, found {found!r}", found=found),
            )

    # Separators, types and brackets

    def _type(self) -> int:
        self._blank()
        match = _HEAD.match(self.text, self.at)
        if not match or int(match[1]) not in _TYPES:
            raise self._expected(
                tr("the number of a type ({known}; plus 8192 for an array)", known=_KNOWN),
                len(match[1]) if match else 0,
            )
        self.at = match.end()
        return int(match[1])

    def _bracketed(self) -> Variant:
        self._check_depth()
        if not self._skip("("):
            raise self._expected(tr("a VARIANT in parentheses, for example (3,100)"))
        self.depth += 1
        result = self.variant()
        if not self._skip(")"):
            raise self._expected(tr('"{sign}"', sign=")"))
        self.depth -= 1
        return result

    def _check_depth(self) -> None:
        if self.depth >= MAX_DEPTH:
            raise _error(self.at, tr("nested deeper than {depth}", depth=MAX_DEPTH))

    def _blank(self) -> None:
        while True:
            match = _SPACE.match(self.text, self.at, self.at + _PIECE)
            assert match  # the pattern also matches an empty text
            self.at, begun = match.end(), self.at
            if self.at < begun + _PIECE:
                return

    def _skip(self, sign: str) -> bool:
        """Skip blanks, and a sign if it follows; return True if the sign was skipped."""
        self._blank()
        found = self.text.startswith(sign, self.at)
        self.at += found
        return found

    def _at_end(self) -> bool:
        """Return True at the end of the text or of the enclosing bracket, ignoring blanks."""
        self._blank()
        return self.at == len(self.text) or (self.depth > 0 and self.text[self.at] == ")")

    def _at_end_exactly(self) -> bool:
        return self.at == len(self.text) or (self.depth > 0 and self.text[self.at] == ")")

    def _expected(self, wanted: str, length: int = 0) -> NotationError:
        """Return the error for unexpected text at this position; ``length`` is its length, 0 if it is unknown."""
        self._blank()
        found = self.text[self.at : self.at + min(length or _SHOWN, _SHOWN)]
        if not found:
            return _error(self.at, tr("expected {wanted}, the text ends here", wanted=wanted))
        return _error(self.at, tr("expected {wanted}, found {found!r}", wanted=wanted, found=found))

    # Data

    def _end_of_numbers(self) -> int:
        end = self.text.find(")", self.at) if self.depth else -1
        return end if end >= 0 else len(self.text)

    def _numbers(self, base: int) -> Any:
        end = self._end_of_numbers()
        values: list[Any] = []
        if not self._at_end():
            read = _FORMS[base].read
            for piece in self._cut(end):
                after = self.at + len(piece)
                value = read(piece.strip(_BLANKS)) if len(piece) <= LONGEST else None
                values.append(self.number(base, after) if value is None else value)
                self.at = after + 1
            self.at = end
        return bytes(values) if base | ARRAY == UI1_ARRAY else values

    def _cut(self, end: int) -> Iterator[str]:
        """Yield the parts of the text from this position up to ``end``, split at the commas."""
        at = self.at
        while True:
            last = self.text.rfind(",", at, min(at + 16 * _PIECE, end))
            if last < 0:  # the next part is longer than the searched range, or it is the last part
                last = self.text.find(",", at, end)
            if last < 0:
                yield from [self.text[at:end]]
                return
            yield from self.text[at:last].split(",")
            at = last + 1

    def _string(self) -> str:
        if self.depth:
            return self._exact_text() if self.exact else self._text(_BRACKET)
        start, self.at = self.at, len(self.text)
        return self.text[start:]

    def _strings(self) -> list[str]:
        if self.exact:
            return [] if self._at_end_exactly() else list(self._exact_strings())
        if self._at_end():
            return []
        result = [self._text(_BRACKET_OR_COMMA)]
        while self._skip(","):
            result.append(self._text(_BRACKET_OR_COMMA))
        return result

    def _text(self, signs: re.Pattern[str]) -> str:
        """Read a string.

        The string ends at the end of the text or of the enclosing bracket. If ``signs`` includes the comma, the
        string also ends at a comma.
        """
        self._blank()
        start = self.at
        if self.text.startswith('"', start):
            return self._quoted()
        end = len(self.text)
        depth = opened = 0  # number of open brackets inside the string, and position of the outermost one
        for match in signs.finditer(self.text, start):
            sign, at = match[0], match.start()
            if sign == "(":
                opened = opened if depth else at
                depth += 1
            elif depth:
                depth -= sign == ")"
            elif sign == "," or self.depth:
                end = at
                break
            else:
                raise self._unbalanced(at)
        if depth:
            raise self._unbalanced(opened)
        self.at = end
        while end > start and not self.text[max(start, end - _PIECE) : end].rstrip(_BLANKS):
            end = max(start, end - _PIECE)
        last = max(start, end - _PIECE)
        return self.text[start:last] + self.text[last:end].rstrip(_BLANKS)

    def _unbalanced(self, at: int) -> NotationError:
        sign = self.text[at]
        return _error(
            at,
            tr('"{sign}" is unbalanced. Try: double quotes around the string', sign=sign),
        )

    def _exact_strings(self) -> Iterator[str]:
        """Yield the strings of an array in which blanks count, and quotes only if they are required."""
        nests, in_brackets = True, self.depth > 0
        while True:
            found = read_exactly(self.text, self.at, in_array=True, in_brackets=in_brackets, nests=nests)
            if found is None and not in_brackets:
                nests = False  # for the rest of the array, so that the time is proportional to the length
                found = read_exactly(self.text, self.at, in_array=True, in_brackets=False, nests=False)
            if found is None:
                raise self._unbalanced_exactly()
            value, self.at = found
            yield value
            if not self.text.startswith(",", self.at):
                return
            self.at += 1

    def _exact_text(self) -> str:
        found = read_exactly(self.text, self.at, in_array=False, in_brackets=True)
        if found is None:
            raise self._unbalanced_exactly()
        value, self.at = found
        return value

    def _unbalanced_exactly(self) -> NotationError:
        return self._unbalanced(max(self.text.find("(", self.at), 0))

    def _quoted(self) -> str:
        end = end_of_quoted(self.text, self.at)
        if end < 0:
            raise _error(
                self.at,
                tr("the quote is not closed; quotes inside a quoted string must be doubled"),
            )
        start, self.at = self.at, end
        return undoubled(self.text[start + 1 : end - 1])


# --- Variant -> text --------------------------------------------------------------------------------------------------


def format_variant(value: Value, *, exact: bool = False) -> str:
    """Return a value as ``<type>,<data>``, in the notation of the documents: ``8204,(8,Sample),(2,100)``.

    Args:
        value: A :class:`~orinkit.values.variant.Variant`, or a value that :func:`~orinkit.values.variant.variant`
            accepts.
        exact: True for the strings of e-CAP, in which blanks count; ``parse`` requires the same argument.

    Raises:
        InvalidValue: If the value cannot be converted to a VARIANT, or is nested deeper than MAX_DEPTH.
    """
    item = variant(value)
    if not exact:
        return _write(item, 0, quoted_text)
    # The documents have no quotation marks. A string that begins with one is quoted only if the text is ambiguous.
    text = _write(item, 0, partial(quoted_text, exact=True, quotes=False))
    if item.type != VarType.BSTR and ',"' in text and not _reads_as(text, item):
        text = _write(item, 0, partial(quoted_text, exact=True))
    return text


def _reads_as(text: str, item: Variant) -> bool:
    try:
        return parse(text, exact=True) == item
    except NotationError:
        return False


def _write(item: Variant, depth: int, write_text: Callable[..., str]) -> str:
    return f"{item.type},{_write_data(item, depth, write_text)}"


def _write_data(item: Variant, depth: int, write_text: Callable[..., str]) -> str:
    vt, value = item.type, item.value
    if vt & ~ARRAY == VarType.VARIANT:
        if depth >= MAX_DEPTH:
            raise InvalidValue(tr("VARIANT arrays nested deeper than {depth}", depth=MAX_DEPTH))
        elements = value if vt & ARRAY else [value]
        return ",".join(f"({_write(element, depth + 1, write_text)})" for element in elements)
    if vt == VarType.BSTR:
        return write_text(value) if depth else value
    if vt == VarType.BSTR | ARRAY:
        if value == [""]:
            return '""'
        return ",".join(write_text(text, in_array=True) for text in value)
    if vt in EMPTIES:
        return ""
    write = _FORMS[vt & ~ARRAY].write
    if not vt & ARRAY:
        return write(value)
    # The list is joined in pieces, because joining a long list in one call would block other threads.
    return ",".join(",".join(map(write, value[at : at + _PIECE])) for at in range(0, len(value), _PIECE))
