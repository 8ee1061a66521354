"""The explanation of a packet for display: its fields, in part if the packet is large."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from orinkit.bcap import packet as bcap
from orinkit.bcap.dissect import PacketField, explain
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_facts import LONGEST_DECODED, is_binary, is_can, summary
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.values.types import type_name

SHOWN_BYTES: Final = 4096
"""Maximum number of bytes in a hex dump."""
SHOWN_FIELDS: Final = 400
"""Maximum number of fields that are listed."""
PER_ROW: Final = 16
"""Number of bytes in a row of a hex dump."""
_ARGUMENT: Final = struct.Struct("<IHI")  # length of the rest, type, count
_HEAD: Final = 6  # bytes of type and count
_LARGE_ARGUMENTS: Final = 32


@dataclass(frozen=True, slots=True)
class PacketDetail:
    """A packet for display.

    Attributes:
        data: The first :data:`SHOWN_BYTES` bytes.
        size: Number of bytes of the whole packet.
        fields: The first :data:`SHOWN_FIELDS` fields.
        omitted: Number of further fields.
        is_partial: True if bytes or fields are missing, or values are not explained.
    """

    data: bytes
    size: int
    fields: list[PacketField]
    omitted: int = 0
    is_partial: bool = False


def detail_of(packet: LoggedPacket) -> PacketDetail:
    """Return a packet for display; the time that this takes is limited for any packet."""
    data = packet.data
    size = len(data)
    if size > LONGEST_DECODED:
        fields = _fields_of_large(packet) if is_binary(packet) else _body_fields(packet)
        return PacketDetail(data[:SHOWN_BYTES], size, fields, is_partial=True)
    fields = _fields(packet) if is_binary(packet) else _body_fields(packet)
    omitted = max(len(fields) - SHOWN_FIELDS, 0)
    return PacketDetail(
        data[:SHOWN_BYTES], size, fields[:SHOWN_FIELDS], omitted, is_partial=size > SHOWN_BYTES or omitted > 0
    )


def _fields(packet: LoggedPacket) -> list[PacketField]:
    if is_can(packet):
        return [PacketField(0, packet.data, tr("CAN frame"), "")]
    if packet.direction == ">":
        return explain(packet.data, "request")
    request = packet.request
    return explain(packet.data, "reply", request[: bcap.OVERHEAD] if request is not None else None)


def _body_fields(packet: LoggedPacket) -> list[PacketField]:
    """Return the fields of an e-CAP body: the parts between its commas, and the decoded call or reply."""
    data, fields, at = packet.data, [], 0
    meaning = summary(packet)
    separator = b"&" if packet.direction == ">" and b"&" in data[:LONGEST_DECODED] else b","
    parts = data.split(separator, 12) if packet.direction == ">" else data.split(separator, 1)
    for index, part in enumerate(parts):
        raw = part if index == len(parts) - 1 else part + separator
        name, mark, value = part[:LONGEST_DECODED].partition(b"=")
        if packet.direction == "<":
            name, value = (tr("return code") if index == 0 else tr("result")).encode(), part[:LONGEST_DECODED]
        elif not mark:
            name, value = b"", name
        fields.append(PacketField(at, raw, _text(name), meaning if index == 0 else _text(value)))
        at += len(raw)
    return fields


def _text(data: bytes) -> str:
    text = data[:400].decode("utf-8", "backslashreplace")
    return text if len(data) <= 400 else f"{text}…"


def _fields_of_large(packet: LoggedPacket) -> list[PacketField]:
    """Return the header of a large packet, and type and size of each argument, without the values."""
    data = packet.data
    if not bcap.is_whole(data):
        problem = tr(
            "{count} bytes are not a packet: SOH 01 and the length must come first, EOT 04 last", count=len(data)
        )
        return [PacketField(0, data[:SHOWN_BYTES], tr("not a packet"), problem, error=True)]
    _, length, serial, reserved, code, count = bcap.HEADER.unpack_from(data)
    short = bcap.pack(serial, code, 0, b"", reserved)
    request = packet.request[: bcap.OVERHEAD] if packet.direction == "<" and packet.request else None
    fields = explain(short, "request" if packet.direction == ">" else "reply", request)[:6]
    fields[1] = PacketField(1, data[1:5], fields[1].name, tr("{count} bytes", count=f"{length:,}"))
    fields[5] = PacketField(13, data[13:15], fields[5].name, str(count))
    at = bcap.HEADER.size
    for index in range(min(count, _LARGE_ARGUMENTS)):
        name = tr("argument {index}", index=index + 1) if packet.direction == ">" else tr("result")
        found = _large_argument(data, at, name)
        fields += found
        if not found or found[-1].error:
            return fields
        at = found[-1].offset + len(found[-1].raw)
    if at == len(data) - 1:
        fields.append(PacketField(at, data[at:], tr("end (EOT)"), ""))
    return fields


def _large_argument(data: bytes, at: int, name: str) -> list[PacketField]:
    if at + _ARGUMENT.size > len(data):
        return [PacketField(at, data[at:], name, tr("the argument is incomplete"), error=True, level=1)]
    length, vt, count = _ARGUMENT.unpack_from(data, at)
    if not _HEAD <= length <= len(data) - at - 5:
        wrong = tr("the length {length} does not fit into the packet", length=length)
        return [PacketField(at, data[at : at + 4], name, wrong, error=True, level=1)]
    start, stop = at + _ARGUMENT.size, at + 4 + length
    return [
        PacketField(
            at, data[at : at + 4], f"{name}: {tr('length')}", tr("{count} bytes", count=f"{length:,}"), level=1
        ),
        PacketField(at + 4, data[at + 4 : at + 6], f"{name}: {tr('data type')}", f"{type_name(vt)} ({vt})", level=1),
        PacketField(at + 6, data[at + 6 : start], f"{name}: {tr('element count')}", f"{count:,}", level=1),
        PacketField(
            start, data[start:stop], name, tr("{count} bytes, not decoded", count=f"{stop - start:,}"), level=1
        ),
    ]
