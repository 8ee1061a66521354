"""The pages of the Tester: the table :data:`PAGES`, and one module or folder for each page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from nicegui import ui

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
            relative to this package.
    """

    path: str
    title: str
    icon: str
    build: str

    def builder(self) -> Callable[[PageSession], object]:
        """Return the function that builds the contents."""
        module, _, name = self.build.partition(":")
        function: Callable[[PageSession], object] = getattr(import_module(f"{__name__}.{module}"), name)
        return function


PAGES: Final = (
    Page("/", N_("Connections"), "lan", "connections:build"),
    Page("/arm", N_("Arm"), "precision_manufacturing", "arm:build"),
    Page("/objects", N_("Objects"), "account_tree", "objects:build"),
    Page("/monitor", N_("Monitor"), "show_chart", "monitor:build"),
    Page("/programs", N_("Programs"), "code", "programs:build"),
    Page("/slave-move", N_("Slave Move"), "timeline", "slave_move:build"),
    Page("/abh3", "ABH3", "electric_rickshaw", "abh3:build"),
    Page("/packets", N_("Packets"), "receipt_long", "packets:build"),
)
"""All pages, in the order of the navigation."""


def register(workspace: Workspace) -> None:
    """Register all pages with NiceGUI."""
    for each in PAGES:
        _register(each, workspace)


def _register(page: Page, workspace: Workspace) -> None:
    build = page.builder()

    @ui.page(page.path)
    def show() -> None:
        session = open_session(workspace)
        with frame(session, page, PAGES):
            build(session)
