"""The fields of a request's body, such as ``Func=3,Arg1=b-CAP``: they are split first, then decoded (e-CAP 3.2).

* Fields are separated by ``&``. A ``,`` separates fields if it is followed by the name of a field and ``=``. Any other
  comma is part of a value: ``Arg1=WDT=400,InvokeTimeout=5000`` is one field.
* Names are ``Func`` and ``Arg1`` to ``Arg5``, in upper or lower case, in any order, possibly surrounded by blanks.
* ``%2C`` in a value represents the byte 2C; a ``%`` without two hexadecimal digits represents itself. Encoded characters
  never separate fields. ``+`` represents itself if the fields are separated by commas, as in the document. If they are
  separated by ``&``, as in HTML forms, ``+`` represents a blank.
* The bytes of a value are UTF-8, or Shift_JIS if the server or the request selects this encoding.
* A body that was encoded as a whole, as ``curl --data-urlencode "Func=17,Arg1=3"`` does, is first decoded, then split.
* Line breaks at the end and a byte order mark at the beginning are ignored.

The processing time is proportional to the length of the body, regardless of its content.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr

ARGUMENTS: Final = 5
"""Number of argument fields that a request may have: ``Arg1`` to ``Arg5``."""
MOST: Final = 32
"""Maximum number of pieces into which a body is split; a valid body has at most six fields."""
UTF_8: Final = "utf-8"
SHIFT_JIS: Final = "shift_jis"
"""The encodings of text. Shift_JIS is code page 932, as on Japanese Windows."""
BLANKS: Final = " \t\r\n"
"""Characters allowed around names and numbers."""

_QUOTED: Final = 160  # bytes of a piece that are decoded for an error message, which shows 40 characters
_SLICE: Final = 32 * 1024  # bytes searched at a time, because other threads cannot run during a search
_MARGIN: Final = 256  # bytes by which a match may extend beyond the slice that it begins in
_BLANK: Final = rb"[ \t\r\n]{0,64}+"
_NAME: Final = rb"(func|arg[1-5])" + _BLANK + rb"="
_SEPARATOR: Final = re.compile(rb"&|,(?=" + _BLANK + _NAME.replace(b"(", b"(?:") + rb")", re.IGNORECASE)
_FIELD: Final = re.compile(_BLANK + _NAME, re.IGNORECASE)
_WHOLE: Final = re.compile(_BLANK + rb"(?:func|arg[1-5])(?:%20|\+)*+%3d", re.IGNORECASE)
_BARE_PERCENT: Final = re.compile(rb"%(?![0-9a-f]{2})", re.IGNORECASE)
_MARK: Final = b"\xef\xbb\xbf"
_SURROGATES: Final = 8192  # bytes decoded at a time if there are surrogates, which are slow to decode
_LONGEST_PAIR: Final = 6  # bytes of two surrogates


_CODECS: Final = {UTF_8: "utf-8", SHIFT_JIS: "cp932"}
_CHARSETS: Final = {
    "utf8": UTF_8, "shiftjis": SHIFT_JIS, "sjis": SHIFT_JIS, "xsjis": SHIFT_JIS, "mskanji": SHIFT_JIS,
    "windows31j": SHIFT_JIS, "cp932": SHIFT_JIS,
}  # fmt: skip


def find_charset(name: str) -> str | None:
    """Return the encoding that a name denotes: ``"utf-8"`` or ``"shift_jis"``; ``None`` for any other name."""
    return _CHARSETS.get(name.strip().strip('"').lower().replace("-", "").replace("_", ""))


class FormField(NamedTuple):
    """The value of a field.

    Attributes:
        text: the decoded text.
        plus: True if a ``+`` was decoded as a blank, which may be the cause of an error.
    """

    text: str
    plus: bool = False


def read_fields(body: bytes, charset: str = UTF_8) -> dict[str, FormField]:
    """Return the fields of a body by their names in lower case, including ``func``.

    Args:
        body: the body.
        charset: encoding of the text: :data:`UTF_8` or :data:`SHIFT_JIS`.

    Raises:
        CallError: E_INVALIDARG if ``Func`` is missing, a field is repeated or unknown, or the bytes do not have the
            encoding.
    """
    body = body.removeprefix(_MARK).rstrip(b"\r\n")
    if b"=" not in body and _WHOLE.match(body):
        return _decoded(_split(_form_bytes(body))[0], bytes, charset)
    pieces, by_ampersand = _split(body)
    is_form = by_ampersand or len(pieces) == 1
    fields = _decoded(pieces, _form_bytes if is_form else _unescaped_bytes, charset)
    if len(fields) == 1:
        whole = b"Func=" + encoded(fields["func"].text, charset)
        if _search(_SEPARATOR, whole):
            return _decoded(_split(whole)[0], bytes, charset)
    return fields


def _split(body: bytes) -> tuple[dict[str, bytes], bool]:
    """Return the values of the fields by their names, and whether ``&`` separates any fields."""
    pieces, by_ampersand = _pieces(body)
    if len(pieces) > MOST:
        raise refused(
            tr(
                "more than {most} fields; the fields are Func and Arg1 to Arg{arguments}. Try: encode an & in a "
                "value as %26",
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
            raise refused(tr("{name} is repeated", name=name.capitalize()))
        found[name] = piece[match.end() :]
    if "func" not in found:
        raise _no_function(body.strip())
    if unknown:
        raise _unknown(unknown)
    return found, by_ampersand


def _pieces(body: bytes) -> tuple[list[bytes], bool]:
    """Split a body at its separators into at most ``MOST + 1`` pieces; also return whether one of them is ``&``.

    The last of ``MOST + 1`` pieces may contain further separators.
    """
    pieces: list[bytes] = []
    at = 0
    by_ampersand = False
    while len(pieces) < MOST and (found := _search(_SEPARATOR, body, at)) is not None:
        pieces.append(body[at : found.start()])
        at = found.end()
        by_ampersand = by_ampersand or found[0] == b"&"
    return [*pieces, body[at:]], by_ampersand


def _search(pattern: re.Pattern[bytes], data: bytes, start: int = 0) -> re.Match[bytes] | None:
    """Return the first match, as ``pattern.search`` does; search slice by slice, so that other threads can run."""
    for at in range(start, len(data), _SLICE):
        found = pattern.search(data, at, at + _SLICE + _MARGIN)
        if found is not None and found.start() < at + _SLICE:
            return found
    return None


def _decoded(pieces: dict[str, bytes], decode: Callable[[bytes], bytes], charset: str) -> dict[str, FormField]:
    return {name: _decode(name.capitalize(), value, decode, charset) for name, value in pieces.items()}


def _decode(name: str, value: bytes, decode: Callable[[bytes], bytes], charset: str) -> FormField:
    try:
        return FormField(decoded(decode(value), charset), decode is _form_bytes and b"+" in value)
    except UnicodeDecodeError as error:
        found = error.object[error.start : error.start + 4].hex(" ")
        if charset == UTF_8:
            text = tr(
                "{name} is not UTF-8: bytes {found} at {offset}. Try: send UTF-8, or the header "
                "Content-Type: application/x-www-form-urlencoded; charset=Shift_JIS",
                name=name,
                found=found,
                offset=error.start,
            )
        else:
            text = tr(
                "{name} is not {charset}: bytes {found} at {offset}",
                name=name,
                charset=charset,
                found=found,
                offset=error.start,
            )
        raise refused(text) from None


def decoded(data: bytes, charset: str) -> str:
    """Return the text that bytes represent.

    Raises:
        UnicodeDecodeError: If the bytes do not have the encoding.
    """
    return to_text(data) if charset == UTF_8 else data.decode(_CODECS[charset])


def encoded(text: str, charset: str) -> bytes:
    """Return the bytes of a text; a character that Shift_JIS does not have becomes ``?``."""
    if charset == UTF_8:
        return text.encode("utf-8", "surrogatepass")
    return text.encode(_CODECS[charset], "replace")


def _form_bytes(value: bytes) -> bytes:
    """Return the decoded bytes of a form-urlencoded value."""
    if b"%" not in value and b"+" not in value:
        return value
    return b"".join([_unescaped(each.replace(b"+", b" ")) for each in _slices(value)])


def _unescaped_bytes(value: bytes) -> bytes:
    """Return a value with its escapes decoded; a ``%`` without two hexadecimal digits is kept."""
    return b"".join(map(_unescaped, _slices(value))) if b"%" in value else value


def _slices(value: bytes) -> Iterator[bytes]:
    """Yield a value in slices, without splitting an escape."""
    at = 0
    while at < len(value):
        end = at + _SLICE
        if end < len(value):
            escape = value.rfind(b"%", end - 2, end)
            end = end if escape < 0 else escape
        yield value[at:end]
        at = end


def _unescaped(value: bytes) -> bytes:
    value = _BARE_PERCENT.sub(b"%25", value)
    # Python decodes all escapes such as \x41 in one pass. This is ten times as fast as urllib.parse, which takes
    # seconds for the longest bodies.
    return value.replace(b"\\", b"%5C").replace(b"%", b"\\x").decode("unicode_escape").encode("latin-1")


def to_text(data: bytes) -> str:
    """Decode UTF-8 that may contain surrogates, each encoded in three bytes.

    A pair of surrogates is decoded as one character; a single surrogate is kept.

    Raises:
        UnicodeDecodeError: If the bytes are not UTF-8.
    """
    try:
        return data.decode()
    except UnicodeDecodeError:
        return "".join(_with_surrogates(data))


def _with_surrogates(data: bytes) -> Iterator[str]:
    """Yield the text of UTF-8 in slices, without splitting a character or a pair of surrogates."""
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
    """Return the exception for an invalid request, with the code E_INVALIDARG."""
    return error_for(hresult.E_INVALIDARG, reason)


def _no_function(body: bytes) -> CallError:
    found = _quoted(body)
    begins = tr("the body begins with {found}", found=found)
    empty = tr("the body is empty")
    return refused(
        tr("the field Func is missing: {found}. Try: Func=3,Arg1=...,Arg2=...", found=begins if body else empty)
    )


def _unknown(piece: bytes) -> CallError:
    found = _quoted(piece)
    return refused(
        tr(
            "unknown field {found}; the fields are Func and Arg1 to Arg{arguments}. Try: encode an & in a value as %26",
            found=found,
            arguments=ARGUMENTS,
        )
    )


def _quoted(piece: bytes) -> str:
    return quoted(piece[:_QUOTED].decode("utf-8", "replace"))
