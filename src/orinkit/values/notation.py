"""VARIANT as text, both ways (e-CAP 3.5; the b-CAP Tester's form, RC8 5.3).

``<type>,<data>``: the type is the VARTYPE number, an array's plus 8192; an array's data are separated by commas; each
element of a VARIANT array is bracketed.

=====================================  ==========================================================================
text                                   VARIANT
=====================================  ==========================================================================
``2,100``                              VT_I2 100
``8,Sample,Test``                      VT_BSTR "Sample,Test": everything behind the first comma, as it is
``8194,100,200,300``                   VT_I2 array
``8200,Sample,Test``                   VT_BSTR array of two
``8204,(8,Sample),(2,100)``            VARIANT array: "Sample", 100; may be nested, 16 deep
``12,(8,Sample)``                      VT_VARIANT: the value in the brackets itself
``(8197, 0, 0), (3, 0), (3, -2)``      the data alone of a VARIANT array, as typed into the Tester:
                                       :func:`parse_elements`
=====================================  ==========================================================================

The documents do not say how the other types are written, nor what else may stand in a string:

* Numbers: decimal; whole numbers and VT_ERROR also ``0x`` hexadecimal; VT_R4 and VT_R8 with point, exponent, ``inf``,
  ``nan``; VT_CY with up to four decimals; VT_BOOL ``-1``, ``1``, ``True`` or ``0``, ``False``; VT_DATE
  ``2026-11-21 10:00:00.5`` (local time; also ``2026/11/21``, ``T`` between, the time left out) or OLE days. Blanks
  around a number do not count. VT_EMPTY is ``0,``, VT_NULL ``1,``, an array without elements ``8197,``; the comma of
  these three may be left out.
* A string by itself (``8,...`` as the whole text) is never changed, whatever is in it. Inside brackets and in a VT_BSTR
  array blanks around a string do not count, and brackets in it have to balance: ``(8,@P P(1,2,3))`` is one string, so
  is the ``P(1,2)`` in ``8200,P(1,2),P2``.
* Any other string is quoted there, with ``"`` doubled inside: ``(8," :-) ")``, ``8200,"a,b",c``. A string is quoted
  only if it begins with ``"``. ``8200,`` is an array of no string, ``8200,""`` of one that is empty.

So ``parse(format_variant(value))`` is the same value with the same types, for every VARIANT (a VT_R4 as single
precision, like on the wire), and plain text is written as the documents print it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.values.notation_numbers import FLAGS, LONGEST, REAL, WHOLE, TextForm
from orinkit.values.types import ARRAY, EMPTIES, ROWS, TABLE, UI1_ARRAY, VARIANT_ARRAY, VarType, type_name
from orinkit.values.variant import Value, Variant, trusted, variant

MAX_DEPTH: Final = 16
"""How deep VARIANT arrays and brackets may be nested, as in a packet."""
MAX_LENGTH: Final = 16 * 1024 * 1024
"""How many characters a text to parse may have."""

_BLANKS: Final = " \t\r\n"  # no other: an ideographic space is part of a Japanese text
_PIECE: Final = 4096  # elements, or characters, that are read or written at a time: other threads wait meanwhile
_MOST_BLANKS: Final = 65_536  # characters of a number with the blanks around it
_SHOWN: Final = 20  # characters of a text that an error message quotes

_FORMS: Final[dict[int, TextForm]] = {int(row.code): row.text for row in TABLE if row.text is not None}
_TYPES: Final = frozenset(ROWS) | {ARRAY | base for base in ROWS if base not in EMPTIES}
_KNOWN: Final = ", ".join(str(int(vt)) for vt in sorted(_TYPES) if vt < ARRAY)


# --- text -> Variant --------------------------------------------------------------------------------------------------


def parse(text: str) -> Variant:
    """Return the VARIANT that a text ``<type>,<data>`` stands for; the module's docstring has the rules.

    Raises:
        NotationError: the text is no VARIANT notation, is nested deeper than MAX_DEPTH or longer than MAX_LENGTH; the
            message names the column, counted from 1, and what was expected there.
    """
    reader = _NotationParser(text)
    result = reader.variant()
    reader.finish()
    return result


def parse_elements(text: str) -> list[Variant]:
    """Return the elements of a VARIANT array from its data alone, as the b-CAP Tester's fields have it (RC8 5.3).

    ``(8197, 0, 0, 0, 0, 0, 0, 5), (3, 0), (3, -2)`` is a pose of Robot_Move; a text of blanks is no element.

    Raises:
        NotationError: as :func:`parse`.
    """
    reader = _NotationParser(text)
    result = reader.elements()
    reader.finish()
    return result


_NOTATION: Final = re.compile(rf"[{_BLANKS}]*([0-9]{{1,5}})[{_BLANKS}]*,")


def parse_lenient(text: str) -> Variant:
    """Return the VARIANT for a value typed on a command line, where the type may be left out.

    A text that begins with the number of a type and a comma is full notation, as for :func:`parse`. Anything else is
    read as what it looks like:

    ==============================  =====================================================================
    ``2,100``                       VT_I2 100
    ``100``, ``-5``, ``0x1F``       VT_I4; beyond 32 bits an error (``20,...`` and ``5,...`` hold more)
    ``1.5``, ``1e3``                VT_R8
    ``true``, ``False``             VT_BOOL
    ``P1``, ``J(1,2,3)``, ``a,b``   VT_BSTR, as any other text, the empty one too
    ``8,100``, ``8,2,100``          VT_BSTR "100", "2,100": how to give a text that would be read otherwise
    ==============================  =====================================================================

    Raises:
        NotationError: the text begins as notation and is not, or is a whole number beyond VT_I4.
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
        if real and not real[1]:  # "inf" and "nan" are words
            return trusted(VarType.R8, reader.number(VarType.R8, len(text)))
    return trusted(VarType.BSTR, text)


_HEAD: Final = re.compile(rf"([0-9]{{1,5}})[{_BLANKS}]*")
_SPACE: Final = re.compile(rf"[{_BLANKS}]*")
_BRACKET: Final = re.compile(r"[()]")
_BRACKET_OR_COMMA: Final = re.compile(r"[(),]")


def _error(at: int, problem: str) -> NotationError:
    return NotationError(tr("column {column}: {problem}", column=at + 1, problem=problem))


class _NotationParser:
    """Walks once over a text; ``at`` is where it stands, ``depth`` in how many brackets."""

    __slots__ = ("at", "depth", "text")

    def __init__(self, text: str) -> None:
        self.text, self.at, self.depth = text, 0, 0
        if len(text) > MAX_LENGTH:
            raise _error(
                MAX_LENGTH,
                tr("the text goes on beyond the {most} characters that are allowed", most=MAX_LENGTH),
            )

    def variant(self) -> Variant:
        """Read ``<type>,<data>``."""
        vt = self._type()
        base = vt & ~ARRAY
        if not self._skip(","):
            if not vt & ARRAY and vt not in EMPTIES:
                name = f"{type_name(vt)} ({vt})"
                raise self._expected(tr('"," and the value of {name}', name=name))
            return trusted(vt, b"" if vt == UI1_ARRAY else [] if vt & ARRAY else None)
        if vt == VarType.VARIANT:
            return self._bracketed()
        if vt in EMPTIES:
            self._blank()
            return trusted(vt, None)
        if base == VarType.VARIANT:
            return trusted(vt, self.elements())
        if base == VarType.BSTR:
            return trusted(vt, self._strings() if vt & ARRAY else self._string())
        return trusted(vt, self._numbers(base) if vt & ARRAY else self.number(base, self._end_of_numbers()))

    def elements(self) -> list[Variant]:
        """Read bracketed VARIANTs up to the end of what encloses them."""
        self._check_depth()
        if self._at_end():
            return []
        result = [self._bracketed()]
        while self._skip(","):
            result.append(self._bracketed())
        return result

    def number(self, base: int, end: int) -> Any:
        """Read one element of a type other than VT_BSTR and VT_VARIANT; it reaches up to ``end``."""
        self._blank()
        piece = self.text[self.at : end]
        piece = piece.strip(_BLANKS) if len(piece) <= _MOST_BLANKS else piece[: LONGEST + 1]
        form = _FORMS[base]
        value = form.read(piece) if len(piece) <= LONGEST else None
        if value is None:
            wanted = tr("{wanted} ({type})", wanted=form.wanted, type=type_name(base))
            raise self._expected(wanted, len(piece))
        self.at = end
        return value

    def finish(self) -> None:
        """Make sure that nothing follows."""
        self._blank()
        if self.at < len(self.text):
            found = self.text[self.at : self.at + _SHOWN]
            raise _error(
                self.at,
                tr("expected the end of the text, found {found!r}", found=found),
            )

    # What stands between the values

    def _type(self) -> int:
        self._blank()
        match = _HEAD.match(self.text, self.at)
        if not match or int(match[1]) not in _TYPES:
            raise self._expected(
                tr("the number of a type ({known}; an array's plus 8192)", known=_KNOWN),
                len(match[1]) if match else 0,
            )
        self.at = match.end()
        return int(match[1])

    def _bracketed(self) -> Variant:
        self._check_depth()
        if not self._skip("("):
            raise self._expected(tr('"(" and a VARIANT like (3,100)'))
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
            assert match  # it also matches nothing
            self.at, begun = match.end(), self.at
            if self.at < begun + _PIECE:
                return

    def _skip(self, sign: str) -> bool:
        """Go behind a sign, and the blanks before it, if it is there."""
        self._blank()
        found = self.text.startswith(sign, self.at)
        self.at += found
        return found

    def _at_end(self) -> bool:
        """Tell whether what is being read ends here, blanks aside."""
        self._blank()
        return self.at == len(self.text) or (self.depth > 0 and self.text[self.at] == ")")

    def _expected(self, wanted: str, length: int = 0) -> NotationError:
        """Return the error that something else stands here; ``length`` is that of the wrong piece, 0 if not known."""
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
        """Yield what stands between the commas up to the end."""
        at = self.at
        while True:
            last = self.text.rfind(",", at, min(at + 16 * _PIECE, end))
            if last < 0:  # nothing but a long piece, or the rest
                last = self.text.find(",", at, end)
            if last < 0:
                yield from [self.text[at:end]]
                return
            yield from self.text[at:last].split(",")
            at = last + 1

    def _string(self) -> str:
        if self.depth:
            return self._text(_BRACKET)
        start, self.at = self.at, len(self.text)
        return self.text[start:]

    def _strings(self) -> list[str]:
        if self._at_end():
            return []
        result = [self._text(_BRACKET_OR_COMMA)]
        while self._skip(","):
            result.append(self._text(_BRACKET_OR_COMMA))
        return result

    def _text(self, signs: re.Pattern[str]) -> str:
        """Read a string that ends where what encloses it does, or at a comma if that is one of the signs."""
        self._blank()
        start = self.at
        if self.text.startswith('"', start):
            return self._quoted()
        end = len(self.text)
        depth = opened = 0  # brackets inside the string: how many are open, where the outermost is
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
            tr('"{sign}" has no counterpart; put a string with such a bracket in double quotes', sign=sign),
        )

    def _quoted(self) -> str:
        start = self.at
        end = self.text.find('"', start + 1)
        while end >= 0 and self.text.startswith('"', end + 1):
            end = self.text.find('"', end + 2)
        if end < 0:
            raise _error(
                start,
                tr("the quote is not closed; a quote inside a quoted string is doubled"),
            )
        self.at = end + 1
        return _undoubled(self.text[start + 1 : end])


# --- Variant -> text --------------------------------------------------------------------------------------------------


def format_variant(value: Value) -> str:
    """Return a value as ``<type>,<data>``, as the documents print it: ``8204,(8,Sample),(2,100)``.

    Args:
        value: a :class:`~orinkit.values.variant.Variant`, or any value that :func:`~orinkit.values.variant.variant` takes.

    Raises:
        InvalidValue: no VARIANT can hold the value, or it is nested deeper than MAX_DEPTH.
    """
    return _write(variant(value), 0)


def _write(item: Variant, depth: int) -> str:
    return f"{item.type},{_write_data(item, depth)}"


def _write_data(item: Variant, depth: int) -> str:
    vt, value = item.type, item.value
    if vt == VARIANT_ARRAY:
        if depth >= MAX_DEPTH:
            raise InvalidValue(tr("VARIANT arrays nested deeper than {depth}", depth=MAX_DEPTH))
        return ",".join(f"({_write(element, depth + 1)})" for element in value)
    if vt == VarType.BSTR:
        return _quote(value, brackets=depth > 0)
    if vt == VarType.BSTR | ARRAY:
        return '""' if value == [""] else ",".join(_quote(text, element=True) for text in value)
    if vt in EMPTIES:
        return ""
    write = _FORMS[vt & ~ARRAY].write
    if not vt & ARRAY:
        return write(value)
    # in pieces: other threads have to wait while Python writes one
    return ",".join(",".join(map(write, value[at : at + _PIECE])) for at in range(0, len(value), _PIECE))


def _quote(text: str, *, brackets: bool = False, element: bool = False) -> str:
    """Return a string as it stands inside brackets or as element of an array: quoted if it would be read otherwise."""
    if not text or not (brackets or element):
        return text
    begins, ends = text[0], text[-1]
    special = begins in _BLANKS or ends in _BLANKS or begins == '"' or (element and "," in text) or not _balanced(text)
    return f'"{_doubled(text)}"' if special else text


def _undoubled(text: str) -> str:
    """Return what :func:`_doubled` has been given; a slice ends where no quote is cut from its twin."""
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


def _balanced(text: str) -> bool:
    depth = 0
    for at in range(0, len(text), _PIECE):
        for sign in _BRACKET.findall(text, at, at + _PIECE):
            depth += 1 if sign == "(" else -1
            if depth < 0:
                return False
    return depth == 0
