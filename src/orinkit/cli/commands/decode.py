"""``orinkit decode``: explain packets."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any, Final

from cyclopts import Parameter

from orinkit.cli._shared.connection import Json
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core.i18n import tr
from orinkit.raw.hex_text import masked

# Hex dumps (xxd, hexdump -C, Wireshark) have an offset before the bytes, and the same bytes as text after them.
_OFFSET: Final = re.compile(r"[ \t]*([0-9A-Fa-f]{4,8})(?::[ \t]|[ \t]{2,})[ \t]*(?=[0-9A-Fa-f]{2})")
_TEXT_COLUMN: Final = re.compile(r"\|.*$|(?<=[0-9A-Fa-f]{2})[ \t]{3,}\S.*$")  # hexdump -C; Wireshark
_TEXT_COLUMN_XXD: Final = re.compile(r"[ \t]{2,}\S.*$")


def decode(
    *hex_bytes: Annotated[
        str,
        Parameter(
            name="HEX",
            required=True,
            allow_leading_hyphen=True,
            help=tr("One or more packets in hex, in any notation (01 10 00, 0x01,0x10, a hex dump); - reads stdin."),
        ),
    ],
    json: Json = False,
) -> int:
    """Explain b-CAP packets field by field; exit with code 1 if one of them is malformed."""
    from orinkit.bcap.dissect import first_error, split
    from orinkit.cli._shared.output import print_json

    data = read_hex(sys.stdin.read() if hex_bytes == ("-",) else "\n".join(hex_bytes))
    if not data:
        raise usage_error(tr("no packet given. Try: the bytes of a packet in hex, or - for stdin"))
    found = [_explained(piece, before) for piece, before in _with_requests(split(data))]
    if json:
        print_json({"packets": [packet["document"] for packet in found]})
    else:
        print("\n\n".join(packet["text"] for packet in found))
    wrong = [packet for packet in found if first_error(packet["fields"])]
    if wrong:
        first = first_error(wrong[0]["fields"])
        assert first is not None
        raise CommandError(
            tr(
                "{wrong} of {count} packets malformed; first error at offset {offset}: {meaning}",
                wrong=len(wrong),
                count=len(found),
                offset=first.offset,
                meaning=first.meaning,
            )
        )
    return 0


def read_hex(text: str) -> bytes:
    """Return the bytes of a text in hex, with any of the usual separators.

    Raises:
        CommandError: If a part is not hex, or has an odd number of digits.
    """
    result = bytearray()
    for line in text.splitlines():
        for word in masked(_without_dump(line, len(result))).split():
            result += _read_word(word)
    return bytes(result)


def _without_dump(line: str, count: int) -> str:
    """Return a line of a hex dump without its offset and its text column.

    A number at the beginning is an offset only if it equals ``count``, the number of bytes in the preceding lines.
    Otherwise, the line is returned unchanged.
    """
    offset = _OFFSET.match(line)
    if offset is None or int(offset[1], 16) != count:
        return line
    column = _TEXT_COLUMN_XXD if ":" in offset[0] else _TEXT_COLUMN
    return column.sub("", line[offset.end() :])


def _read_word(word: str) -> bytes:
    try:
        return bytes.fromhex(word.rjust(2, "0") if len(word) == 1 else word)
    except ValueError:
        raise _not_hex(word) from None


def _not_hex(word: str) -> CommandError:
    shown = f"{word[:20]}..." if len(word) > 20 else word
    if re.fullmatch("[0-9A-Fa-f]+", word):
        return usage_error(
            tr("{text!r} has an odd number of hex digits ({count})", text=shown, count=len(word)),
        )
    return usage_error(tr("{text!r} is not hex", text=shown))


def _with_requests(pieces: list[bytes]) -> list[tuple[bytes, bytes | None]]:
    """Return each packet with its request: for a reply the preceding request of the same serial, otherwise ``None``."""
    from orinkit.bcap import packet
    from orinkit.bcap.dissect import kind_of

    requests: dict[int, bytes] = {}
    result: list[tuple[bytes, bytes | None]] = []
    for piece in pieces:
        request = None
        if len(piece) >= packet.OVERHEAD:
            _, _, serial, _, code, _ = packet.HEADER.unpack_from(piece)
            if kind_of(code) == "request":
                requests[serial] = piece
            else:
                request = requests.pop(serial, None)
        result.append((piece, request))
    return result


def _explained(piece: bytes, request: bytes | None) -> dict[str, Any]:
    from orinkit.bcap.dissect import explain, one_line
    from orinkit.cli._shared.terminal import bold
    from orinkit.cli._shared.transcript import field_lines

    fields = explain(piece, request=request)
    meaning = one_line(piece, request)
    document = {
        "meaning": meaning,
        "bytes": piece.hex(),
        "wrong": any(field.error for field in fields),
        "fields": [
            {"offset": field.offset, "bytes": field.raw.hex(), "name": field.name, "meaning": field.meaning,
             "level": field.level, "error": field.error}
            for field in fields
        ],
    }  # fmt: skip
    return {"fields": fields, "document": document, "text": "\n".join([bold(meaning), *field_lines(fields)])}
