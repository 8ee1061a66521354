"""The fields of a request's body, ``Func=3,Arg1=b-CAP``: cut apart first, decoded then (e-CAP 3.2).

* Fields are separated by ``&``, and by ``,`` where the name of a field and ``=`` follow. Any other comma is part of a
  value: ``Arg1=WDT=400,InvokeTimeout=5000`` is one field.
* Names are ``Func`` and ``Arg1`` to ``Arg5``, in upper or lower case, in any order, blanks around them.
* Values are form-urlencoded: ``+`` is a blank, ``%2C`` a byte; the bytes are UTF-8, encoded or as they are. What is
  encoded never separates.
* A body that was encoded in one piece, as ``curl --data-urlencode "Func=17,Arg1=3"`` does, is decoded first and cut then.
* Line breaks at the end and a byte order mark at the beginning do not count.

All of it takes time in proportion to the length of the body, whatever is in it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr

ARGUMENTS: Final = 5
"""How many arguments a request has."""
MOST: Final = 32
"""How many pieces a body may be cut into; there are six fields."""
BLANKS: Final = " \t\r\n"
"""What may stand around names and numbers."""

_QUOTED: Final = 160  # bytes of a piece that an error quotes, of which it shows 40 characters
_SLICE: Final = 32 * 1024  # bytes that are looked through at a time: other threads wait while Python does it
_MARGIN: Final = 256  # bytes that a match may have behind the slice that it begins in
_BLANK: Final = rb"[ \t\r\n]{0,64}+"
_NAME: Final = rb"(func|arg[1-5])" + _BLANK + rb"="
_SEPARATOR: Final = re.compile(rb"&|,(?=" + _BLANK + _NAME.replace(b"(", b"(?:") + rb")", re.IGNORECASE)
_FIELD: Final = re.compile(_BLANK + _NAME, re.IGNORECASE)
_WHOLE: Final = re.compile(_BLANK + rb"(?:func|arg[1-5])(?:%20|\+)*+%3d", re.IGNORECASE)
_BAD_ESCAPE: Final = re.compile(rb"%(?![0-9a-f]{2})", re.IGNORECASE)
_MARK: Final = b"\xef\xbb\xbf"
_SURROGATES: Final = 8192  # bytes that are decoded at a time where there are surrogates: each takes long
_LONGEST_PAIR: Final = 6  # bytes of two surrogates


class FormField(NamedTuple):
    """A value.

    Attributes:
        text: decoded.
        plus: whether a ``+`` in it was read as a blank: an error about the value may be due to that.
    """

    text: str
    plus: bool = False


def read_fields(body: bytes) -> dict[str, FormField]:
    """Return the fields of a body by their names in lower case, ``func`` among them.

    Raises:
        CallError: E_INVALIDARG; no ``Func``, a field twice, an unknown one, a wrong escape, or no UTF-8.
    """
    body = body.removeprefix(_MARK).rstrip(b"\r\n")
    if b"=" not in body and _WHOLE.match(body):
        return _decoded(_cut(_form_bytes(body)), bytes)
    fields = _decoded(_cut(body), _form_bytes)
    if len(fields) == 1:
        whole = b"Func=" + fields["func"].text.encode("utf-8", "surrogatepass")
        if _search(_SEPARATOR, whole):
            return _decoded(_cut(whole), bytes)
    return fields


def _cut(body: bytes) -> dict[str, bytes]:
    pieces = _pieces(body)
    if len(pieces) > MOST:
        raise refused(
            tr(
                "more than {most} fields; the fields are Func and Arg1 to Arg{arguments}, an & in a "
                "value is written %26",
                most=MOST,
                arguments=ARGUMENTS,
            )
        )
    found: dict[str, bytes] = {}
    unknown = b""
    for piece in pieces:
        match = _FIELD.match(piece)
        if not match:
            unknown = unknown or piece.strip()
            continue
        name = match[1].decode().lower()
        if name in found:
            raise refused(tr("{name} is there twice", name=name.capitalize()))
        found[name] = piece[match.end() :]
    if "func" not in found:
        raise _no_function(body.strip())
    if unknown:
        raise _unknown(unknown)
    return found


def _pieces(body: bytes) -> list[bytes]:
    """Cut a body into no more pieces than are needed to tell that they are too many."""
    pieces: list[bytes] = []
    at = 0
    while len(pieces) < MOST and (found := _search(_SEPARATOR, body, at)) is not None:
        pieces.append(body[at : found.start()])
        at = found.end()
    return [*pieces, body[at:]]


def _search(pattern: re.Pattern[bytes], data: bytes, start: int = 0) -> re.Match[bytes] | None:
    """Return the first match, as ``pattern.search`` does, looked for slice by slice."""
    for at in range(start, len(data), _SLICE):
        found = pattern.search(data, at, at + _SLICE + _MARGIN)
        if found is not None and found.start() < at + _SLICE:
            return found
    return None


def _decoded(pieces: dict[str, bytes], decode: Callable[[bytes], bytes]) -> dict[str, FormField]:
    return {name: _decode(name.capitalize(), value, decode) for name, value in pieces.items()}


def _decode(name: str, value: bytes, decode: Callable[[bytes], bytes]) -> FormField:
    try:
        return FormField(to_text(decode(value)), decode is _form_bytes and b"+" in value)
    except CallError as error:
        raise refused(f"{name}: {error.detail}") from None
    except UnicodeDecodeError as error:
        found = error.object[error.start : error.start + 4].hex(" ")
        raise refused(
            tr(
                "{name} is no UTF-8: bytes {found} at {offset}. Try: send UTF-8, not Shift_JIS",
                name=name,
                found=found,
                offset=error.start,
            )
        ) from None


def _form_bytes(value: bytes) -> bytes:
    """Return what a form-urlencoded value stands for."""
    if b"%" not in value and b"+" not in value:
        return value
    bad = _search(_BAD_ESCAPE, value)
    if bad:
        found = quoted(value[bad.start() : bad.start() + 3].decode("ascii", "replace"))
        raise refused(tr('{found} is no escape: "%" and two hexadecimal digits; a "%" itself is %25', found=found))
    return b"".join(map(_unescaped, _slices(value)))


def _slices(value: bytes) -> Iterator[bytes]:
    """Yield a value in slices, no escape cut in two."""
    at = 0
    while at < len(value):
        end = at + _SLICE
        if end < len(value):
            escape = value.rfind(b"%", end - 2, end)
            end = end if escape < 0 else escape
        yield value[at:end]
        at = end


def _unescaped(value: bytes) -> bytes:
    value = value.replace(b"+", b" ")
    # Ten times as fast as urllib.parse, which takes seconds for the longest bodies: \x41 is what Python can read at once.
    return value.replace(b"\\", b"%5C").replace(b"%", b"\\x").decode("unicode_escape").encode("latin-1")


def to_text(data: bytes) -> str:
    """Return UTF-8 as text, lone surrogates as they are; a pair of them, each in three bytes, is one character.

    Raises:
        UnicodeDecodeError: it is no UTF-8.
    """
    try:
        return data.decode()
    except UnicodeDecodeError:
        return "".join(_with_surrogates(data))


def _with_surrogates(data: bytes) -> Iterator[str]:
    """Yield the text of UTF-8 in slices, neither a character nor a pair of surrogates cut in two."""
    at = 0
    while at < len(data):
        end = min(at + _SURROGATES, len(data))
        for _ in range(_LONGEST_PAIR):
            if end < len(data) and (
                data[end] & 0xC0 == 0x80 or data[end : end + 2] >= b"\xed\xb0" > data[end : end + 1]
            ):
                end -= 1
        try:
            text = data[at:end].decode("utf-8", "surrogatepass")
        except UnicodeDecodeError as error:
            raise UnicodeDecodeError("utf-8", data, at + error.start, at + error.end, error.reason) from None
        yield text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "surrogatepass")
        at = end


def refused(reason: str) -> CallError:
    """Return the exception for a request that cannot be read, E_INVALIDARG."""
    return error_for(hresult.E_INVALIDARG, reason)


def _no_function(body: bytes) -> CallError:
    found = _quoted(body)
    begins = tr("the body begins with {found}", found=found)
    empty = tr("the body is empty")
    return refused(tr("no Func: {found}. Try: Func=3,Arg1=...,Arg2=...", found=begins if body else empty))


def _unknown(piece: bytes) -> CallError:
    found = _quoted(piece)
    return refused(
        tr(
            "{found} is none of the fields Func and Arg1 to Arg{arguments}; an & in a value is written %26",
            found=found,
            arguments=ARGUMENTS,
        )
    )


def _quoted(piece: bytes) -> str:
    return quoted(piece[:_QUOTED].decode("utf-8", "replace"))
