"""The pages of the Tester: the table :data:`PAGES`, and one module or folder for each page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from nicegui import Client, ui

from orinkit.core.i18n import N_
from orinkit.tester.state.workspace import Workspace
from orinkit.tester.ui.frame import frame
from orinkit.tester.ui.session import PageSession, open_session


@dataclass(frozen=True, slots=True)
class Page:
    """A page.

    Attributes:
        path: Path of the page.
        title: Title, in English.
        icon: Name of the Material icon.
        build: Reference ``module:function`` to the function that builds the contents from a :class:`PageSession`,
            relative to this package. If it is a generator function, other tasks of the Tester run at each ``yield``, so
            that a large page does not block them, for example a motion of another user.
    """

    path: str
    title: str
    icon: str
    build: str

    def builder(self) -> Callable[[PageSession], Iterator[None] | None]:
        """Return the function that builds the contents."""
        module, _, name = self.build.partition(":")
        function: Callable[[PageSession], Iterator[None] | None] = getattr(import_module(f"{__name__}.{module}"), name)
        return function


PAGES: Final = (
    Page("/", N_("Connections"), "lan", "connections:build"),
    Page("/arm", N_("Arm"), "precision_manufacturing", "arm:build"),
    Page("/objects", N_("Objects"), "account_tree", "objects:build"),
    Page("/monitor", N_("Monitor"), "show_chart", "monitor:build"),
    Page("/programs", N_("Programs"), "code", "programs:build"),
    Page("/slave-move", N_("Slave Move"), "timeline", "slave_move:build"),
    Page("/abh3", "ABH3", "electrical_services", "abh3:build"),
    Page("/packets", N_("Packets"), "receipt_long", "packets:build"),
    Page("/raw", N_("Raw packets"), "data_array", "raw:build"),
)
"""All pages, in the order of the navigation."""
_LONGEST_BUILD: Final = 60.0  # s, on a machine that stalls


def register(workspace: Workspace) -> None:
    """Register all pages with NiceGUI."""
    for each in PAGES:
        _register(each, workspace)


def _register(page: Page, workspace: Workspace) -> None:
    build = page.builder()

    @ui.page(page.path, response_timeout=_LONGEST_BUILD)
    async def show() -> None:
        session = open_session(workspace)
        complete = _hold_back(session.client)
        try:
            with frame(session, page, PAGES):
                await asyncio.sleep(0)
                for _ in build(session) or ():
                    await asyncio.sleep(0)
        finally:
            complete.set()


def _hold_back(client: Client) -> asyncio.Event:
    """Let timers wait until the page is complete; return the event for it.

    A task that waits for the connection of the browser makes NiceGUI deliver the page as far as it has been built.
    """
    complete, connected = asyncio.Event(), client.connected

    async def wait(timeout: float | None = None) -> None:
        await complete.wait()
        await connected(timeout)

    client.connected = wait  # type: ignore[method-assign]  # NiceGUI has no hook for this
    return complete
