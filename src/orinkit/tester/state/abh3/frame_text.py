"""The explanation of CAN frames of ABH3: one line, the fields with their bytes, and text to copy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Final

from orinkit.abh3.table import ids
from orinkit.abh3.table.decoder import CONTROL, REQUEST, TRANSFER, DecodedFrame, Decoder
from orinkit.abh3.table.ids import FrameId
from orinkit.abh3.table.signals import Dialect
from orinkit.abh3.table.transfer_fields import PARTS, PGN_AT
from orinkit.bcap.dissect import PacketField
from orinkit.can.frame import CanFrame
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.frame_log import LoggedFrame
from orinkit.tester.state.packet_detail import PacketDetail
from orinkit.tester.state.packet_rows import row_time
from orinkit.tester.state.packet_text import time_text

KINDS: Final = {
    "command": N_("Commands and feedback (EF)"),
    "request": N_("Requests (EA)"),
    "broadcast": N_("Broadcasts (FF)"),
    "multi": N_("Multi-packet messages (EB, EC)"),
    "other": N_("Other frames"),
}
"""The kinds of frames, by key."""
_KIND_OF: Final = {
    ids.SINGLE: "command",
    ids.REQUEST: "request",
    ids.BROADCAST: "broadcast",
    ids.CONTROL: "multi",
    ids.TRANSFER: "multi",
}
_ADDRESSED: Final = 0xF0  # lowest PF whose PS is not an address
_ID_BYTES: Final = 4
_BROADCAST_NUMBERS: Final = 8


def kind_of(frame: CanFrame) -> str:
    """Return the key of a frame's kind in :data:`KINDS`."""
    return _KIND_OF.get(frame.id >> 16 & 0xFF, "other")


def row_of(entry: LoggedFrame, previous: LoggedFrame | None, mode: str, start_ns: int, decoder: Decoder) -> list[Any]:
    """Return a frame as a row: number, time, ID, direction, data, explanation, CSS class, marks.

    Args:
        entry: The frame.
        previous: The frame in the row above, if there is one.
        mode: A key of :data:`~orinkit.tester.state.packet_rows.TIME_MODES`.
        start_ns: Time to which relative times refer, in ns since 1970.
        decoder: The decoder of the connection.
    """
    decoded = decoder.decode(entry.frame)
    marks = [tr("invalid")] if decoded.fault else []
    time = row_time(entry.time_ns, previous.time_ns if previous else None, mode, start_ns)
    frame = entry.frame
    return [
        entry.number, time, f"{frame.id:08X}", entry.direction, frame.data.hex(" ").upper(), decoded.text,
        "bad" if decoded.fault else "", marks,
    ]  # fmt: skip


def detail_of(frame: CanFrame, decoder: Decoder) -> PacketDetail:
    """Return the bytes of a frame, four of the identifier and those of the data, with the fields."""
    decoded = decoder.decode(frame)
    data = frame.id.to_bytes(_ID_BYTES, "big") + frame.data
    fields = [*_id_fields(frame, data), *_data_fields(decoded, decoder.dialect)]
    return PacketDetail(data, len(data), fields)


def _id_fields(frame: CanFrame, data: bytes) -> Iterator[PacketField]:
    parts = FrameId.parse(frame.id)
    page = (parts.reserved << 1 | parts.dp) << 16
    number = page | parts.pf << 8 | (parts.ps if parts.pf >= _ADDRESSED else 0)
    yield PacketField(0, data[:_ID_BYTES], tr("CAN ID"), f"{frame.id:08X}, PGN {number:05X}")
    first = tr("priority {priority}, DP {page}", priority=parts.priority, page=parts.dp)
    yield PacketField(0, data[:1], tr("priority, data page"), first, level=1)
    yield PacketField(1, data[1:2], tr("PDU format (PF)"), f"{parts.pf:02X}: {tr(KINDS[kind_of(frame)])}", level=1)
    yield PacketField(2, data[2:3], *_ps_field(parts), level=1)
    yield PacketField(3, data[3:4], tr("source address (SA)"), f"{parts.sa}", level=1)


def _ps_field(parts: FrameId) -> tuple[str, str]:
    if parts.pf < _ADDRESSED:
        return tr("destination address (PS)"), tr("all") if parts.ps == ids.EVERYONE else f"{parts.ps}"
    group, number = divmod(parts.ps, _BROADCAST_NUMBERS)
    return tr("group and number (PS)"), tr("group {group}, broadcast {number}", group=group, number=number)


def _data_fields(decoded: DecodedFrame, dialect: Dialect) -> Iterator[PacketField]:
    data = decoded.frame.data
    if decoded.fault is not None:
        yield PacketField(_ID_BYTES, data, tr("data"), decoded.fault.text, error=True)
    places = dict(_places(decoded.name, dialect))
    for value in decoded.values:
        start, size = places.get(value.name, (0, 0) if decoded.fault else (0, len(data)))
        yield PacketField(_ID_BYTES + start, data[start : start + size], tr(value.title), value.shown)


def _places(name: str, dialect: Dialect) -> Iterable[tuple[str, tuple[int, int]]]:
    """Return the offset and the size of the values of a frame in its data, by the names of the values."""
    if name == REQUEST:
        return [("wanted", (0, 3)), ("group", (0, 1))]
    if name == CONTROL:
        parts = [(part.name, (part.start, part.size)) for part in PARTS]
        return [("kind", (0, 1)), *parts, ("pgn", (PGN_AT, 3))]
    if name == TRANSFER:
        return [("number", (0, 1)), ("data", (1, 7))]
    layout = dialect.layouts.get(name)
    if layout is None:
        return []
    return [(field.name, (start // 8, _SIZES[field.code])) for field, start in layout.starts]


_SIZES: Final = {"h": 2, "H": 2, "i": 4, "I": 4, "f": 4}


def as_text(entries: Iterable[LoggedFrame], decoder: Decoder) -> str:
    """Return frames as lines of text: time, direction, frame in the notation of candump, explanation."""
    arrows = {">": tr("sent"), "<": tr("received")}
    return "\n".join(
        f"{time_text(entry.time_ns)} {arrows[entry.direction]} {entry.frame} {decoder.decode(entry.frame).text}"
        for entry in entries
    )
