"""The bytes of a packet as a hex dump, beside its fields: :class:`PacketBytes`."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.packet_detail import SHOWN_FIELDS, PacketDetail


class PacketBytes(ui.element, component="packet_bytes.js"):
    """The bytes of a packet as a hex dump, beside its fields.

    Args:
        marker: Value of ``data-testid``.
    """

    def __init__(self, marker: str) -> None:
        super().__init__()
        self.props(f'data-testid="{marker}"')
        self._props["labels"] = {"bytes": tr("Bytes of the packet"), "fields": tr("Fields of the packet")}
        self._props["packet"] = {"hex": "", "fields": [], "note": ""}

    def show(self, detail: PacketDetail | None) -> None:
        """Show the bytes and fields of a packet or frame; ``None`` shows nothing."""
        detail = detail or PacketDetail(b"", 0, [])
        self._props["packet"] = {
            "hex": detail.data.hex(),
            "fields": [
                [each.offset, len(each.raw), each.name, each.meaning, each.error, each.level] for each in detail.fields
            ],
            "note": _note(detail),
        }
        self.update()


def _note(detail: PacketDetail) -> str:
    if detail.omitted:
        return tr(
            "Only the first {most} fields are shown; there are {count} more.", most=SHOWN_FIELDS, count=detail.omitted
        )
    if detail.is_partial:
        return tr(
            "Only the first {shown} of {size} bytes are shown. Save the packets to examine all.",
            shown=f"{len(detail.data):,}",
            size=f"{detail.size:,}",
        )
    return ""
