"""Transcripts of packets, with their meaning."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit.bcap.dissect import PacketField, explain, one_line
from orinkit.cli._shared.output import padded, width

_PER_LINE: Final = 24
_ARROWS: Final = {">": "→", "<": "←"}
_INDENT: Final = "    "
_WIDEST_HEX: Final = 3 * 8 - 1
_WIDEST_TEXT: Final = 100


@dataclass(frozen=True, slots=True)
class TracedPacket:
    """A packet of b-CAP, or an HTTP body of e-CAP.

    Attributes:
        direction: ``">"`` to the controller, ``"<"`` from it.
        data: The bytes.
        meaning: The explanation in one line.
        request: For a reply, the bytes of its request; ``None`` for a request.
    """

    direction: str
    data: bytes
    meaning: str
    request: bytes | None = None

    def lines(self, *, fields: bool = False) -> list[str]:
        """Return the packet for people: the meaning, then the bytes in hex or field by field."""
        head = f"{_INDENT}{_ARROWS[self.direction]} {self.meaning}"
        if not _is_binary(self.data):
            text = self.data.decode("utf-8", "backslashreplace")
            return [head, *(f"{_INDENT}  {line}" for line in textwrap.wrap(text, _WIDEST_TEXT) if line)]
        if fields:
            explained = explain(self.data, "request" if self.request is None else "reply", self.request)
            return [head, *(f"{_INDENT}  {line}" for line in field_lines(explained))]
        return [head, *(f"{_INDENT}  {line}" for line in hex_lines(self.data))]

    def document(self) -> dict[str, Any]:
        """Return the packet for JSON."""
        return {
            "direction": "request" if self.direction == ">" else "reply",
            "meaning": self.meaning,
            "bytes": self.data.hex(),
        }


def _is_binary(data: bytes) -> bool:
    """Return True for a packet of b-CAP, False for a body of e-CAP, which is text."""
    return data[:1] == b"\x01"


def _meaning(direction: str, data: bytes, request: bytes | None) -> str:
    if _is_binary(data):
        return one_line(data, None if direction == ">" else request)
    from orinkit.ecap.message import explain_reply, explain_request  # rarely needed

    return explain_request(data) if direction == ">" else explain_reply(data)


class Transcript:
    """Collects the packets of a client (as its ``trace=`` callback) and passes each to ``show``."""

    def __init__(self, show: Callable[[TracedPacket], None] | None = None) -> None:
        self.packets: list[TracedPacket] = []
        self._show = show
        self._request: bytes | None = None

    def __call__(self, direction: str, data: bytes) -> None:
        """Record a packet."""
        if direction == ">":
            self._request = data
        request = self._request if direction == "<" else None
        packet = TracedPacket(direction, data, _meaning(direction, data, request), request)
        self.packets.append(packet)
        if self._show is not None:
            self._show(packet)


def hex_lines(data: bytes, per_line: int = _PER_LINE) -> list[str]:
    """Return bytes in hex, ``per_line`` bytes on each line."""
    return [data[at : at + per_line].hex(" ") for at in range(0, len(data), per_line)]


def field_lines(fields: list[PacketField]) -> list[str]:
    """Return explained fields as the lines of a table; errors are marked with an exclamation mark."""
    names = ["  " * field.level + field.name for field in fields]
    widest = max(map(width, names), default=0)
    lines = []
    for field, name in zip(fields, names, strict=True):
        first, *more = hex_lines(field.raw, 8) or [""]
        mark = "!" if field.error else " "
        line = f"{field.offset:5} {mark} {padded(name, widest)}  {first:{_WIDEST_HEX}}  {field.meaning}"
        lines.append(line.rstrip())
        lines += [f"{'':5}   {'':{widest}}  {rest}" for rest in more]
    return lines
