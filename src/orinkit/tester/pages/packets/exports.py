"""Downloads of packets: the route ``/packets/export``."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from datetime import datetime
from typing import Final

from nicegui import app, ui
from starlette.responses import PlainTextResponse, Response, StreamingResponse

from orinkit.core.i18n import tr
from orinkit.tester.state.packet_export import capture_places, export_pcapng, export_text
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.tester.state.workspace import Workspace

_KINDS: Final = {"pcapng": "application/x-pcapng", "txt": "text/plain; charset=utf-8"}
_PAGES: Final[dict[str, PageExports]] = {}


class PageExports:
    """The downloads that a page offers; only who has the page can fetch them.

    Args:
        workspace: The state of the Tester.
        page: Unguessable id of the page.
        numbers: Function that returns the numbers of the packets to save.
        summary: Function that returns the summary of a packet.
    """

    def __init__(
        self,
        workspace: Workspace,
        page: str,
        numbers: Callable[[], Sequence[int]],
        summary: Callable[[LoggedPacket], str],
    ) -> None:
        self._workspace, self._page = workspace, page
        self._numbers, self._summary = numbers, summary
        _PAGES[page] = self

    def close(self) -> None:
        """Offer no more downloads, because the page is closed."""
        _PAGES.pop(self._page, None)

    def start(self, kind: str) -> None:
        """Make the browser fetch a file: ``"pcapng"`` or ``"txt"``."""
        ui.download.from_url(f"/packets/export/{self._page}/{kind}")

    async def pieces(self, kind: str) -> AsyncIterator[bytes]:
        """Yield the contents of a file."""
        log, numbers = self._workspace.packets, self._numbers()
        if kind == "txt":
            found = export_text(log, numbers, self._summary)
        else:
            found = export_pcapng(log, numbers, await capture_places(self._workspace))
        async for piece in found:
            yield piece


@app.get("/packets/export/{page}/{kind}")
async def _export(page: str, kind: str) -> Response:
    exports = _PAGES.get(page)
    if exports is None or kind not in _KINDS:
        return PlainTextResponse(tr("this download does not exist. Try: save again on the page Packets"), 404)
    name = f"orinkit-{datetime.now():%Y%m%d-%H%M%S}.{kind}"
    headers = {"content-disposition": f'attachment; filename="{name}"', "cache-control": "no-store"}
    return StreamingResponse(exports.pieces(kind), media_type=_KINDS[kind], headers=headers)
