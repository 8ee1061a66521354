"""The fields of a request's body, such as ``Func=3,Arg1=b-CAP``: they are split first, then decoded (e-CAP 3.2).

* Fields are separated by ``&``. A ``,`` separates fields if it is followed by the name of a field and ``=``. Any other
  comma is part of a value: ``Arg1=WDT=400,InvokeTimeout=5000`` is one field.
* Names are ``Func`` and ``Arg1`` to ``Arg5``, in upper or lower case, in any order, possibly surrounded by blanks.
* Values are form-urlencoded: ``+`` represents a blank, and ``%2C`` the byte 2C. The bytes of a value are UTF-8, with or
  without this encoding. Encoded characters never separate fields.
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
_BAD_ESCAPE: Final = re.compile(rb"%(?![0-9a-f]{2})", re.IGNORECASE)
_MARK: Final = b"\xef\xbb\xbf"
_SURROGATES: Final = 8192  # bytes decoded at a time if there are surrogates, which are slow to decode
_LONGEST_PAIR: Final = 6  # bytes of two surrogates


class FormField(NamedTuple):
    """The value of a field.

    Attributes:
        text: the decoded text.
        plus: True if a ``+`` was decoded as a blank, which may be the cause of an error.
    """

    text: str
    plus: bool = False


def read_fields(body: bytes) -> dict[str, FormField]:
    """Return the fields of a body by their names in lower case, including ``func``.

    Raises:
        CallError: E_INVALIDARG if ``Func`` is missing, a field is repeated or unknown, an escape is invalid, or the
            bytes are not UTF-8.
    """
    body = body.removeprefix(_MARK).rstrip(b"\r\n")
    if b"=" not in body and _WHOLE.match(body):
        return _decoded(_split(_form_bytes(body)), bytes)
    fields = _decoded(_split(body), _form_bytes)
    if len(fields) == 1:
        whole = b"Func=" + fields["func"].text.encode("utf-8", "surrogatepass")
        if _search(_SEPARATOR, whole):
            return _decoded(_split(whole), bytes)
    return fields


def _split(body: bytes) -> dict[str, bytes]:
    pieces = _pieces(body)
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
    return found


def _pieces(body: bytes) -> list[bytes]:
    """Split a body at its separators into at most ``MOST + 1`` pieces.

    The last of ``MOST + 1`` pieces may contain further separators.
    """
    pieces: list[bytes] = []
    at = 0
    while len(pieces) < MOST and (found := _search(_SEPARATOR, body, at)) is not None:
        pieces.append(body[at : found.start()])
        at = found.end()
    return [*pieces, body[at:]]


def _search(pattern: re.Pattern[bytes], data: bytes, start: int = 0) -> re.Match[bytes] | None:
    """Return the first match, as ``pattern.search`` does; search slice by slice, so that other threads can run."""
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
                "{name} is not UTF-8: bytes {found} at {offset}. Try: send UTF-8, not Shift_JIS",
                name=name,
                found=found,
                offset=error.start,
            )
        ) from None


def _form_bytes(value: bytes) -> bytes:
    """Return the decoded bytes of a form-urlencoded value."""
    if b"%" not in value and b"+" not in value:
        return value
    bad = _search(_BAD_ESCAPE, value)
    if bad:
        found = quoted(value[bad.start() : bad.start() + 3].decode("ascii", "replace"))
        raise refused(
            tr('{found} is not an escape ("%" and two hexadecimal digits). Try: encode a "%" as %25', found=found)
        )
    return b"".join(map(_unescaped, _slices(value)))


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
    value = value.replace(b"+", b" ")
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
