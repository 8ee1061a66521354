"""The contents of the page Objects: the tree on one side, the selected object on the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from nicegui import ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.pages.objects.adding import ICONS, LABELS, build_adding
from orinkit.tester.pages.objects.context import ObjectContext
from orinkit.tester.pages.objects.forms import build_functions
from orinkit.tester.pages.objects.panels import build_change, build_execute, build_move, build_value
from orinkit.tester.pages.objects.performance import build_performance
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.objects import RemoteObject
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.reporting import show_no_controller
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.5  # s
_FUNCTIONS = (N_("Functions"), build_functions)
_EXECUTE = (N_("Execute"), build_execute)
TABS: dict[str, tuple[tuple[str, Callable[[ObjectContext], None]], ...]] = {
    "Controller": (_EXECUTE, _FUNCTIONS),
    "Robot": ((N_("Move"), build_move), _EXECUTE, (N_("Change"), build_change), _FUNCTIONS),
    "Task": (_EXECUTE, _FUNCTIONS),
    "File": (_EXECUTE, _FUNCTIONS),
    "Extension": (_EXECUTE, _FUNCTIONS),
    "Variable": ((N_("Value"), build_value), (N_("Performance"), build_performance), _FUNCTIONS),
}
"""The tabs of an object by its interface; all others have the functions only."""


def build(session: PageSession) -> Iterator[None]:
    """Build the contents."""
    ui.label(tr("Objects")).classes("ok-page-title").props("role=heading aria-level=1")
    ui.label(
        tr("The objects of the controller and all functions that can be called on them. All pages share these objects.")
    ).classes("ok-page-hint")
    yield from ObjectsPage(session).build()


class ObjectsPage:
    """The tree, and the selected object."""

    def __init__(self, session: PageSession) -> None:
        self._session = session
        self._selected: RemoteObject | None = None
        self._built: object = None
        self._shown: object = None
        self._holder = ui.element("div").style("display: contents")
        self._connection: ControllerConnection | None = None

    def build(self) -> Iterator[None]:
        """Build the elements in several parts."""
        yield
        connection = self._session.connection
        if isinstance(connection, ControllerConnection) and connection.is_open:
            self._begin(connection)
            yield from self._parts(connection.objects.controller or connection.objects.root)
        self.refresh()
        ui.timer(_REFRESH, self.refresh)

    def refresh(self) -> None:
        """Update what has changed."""
        connection = self._session.connection
        usable = connection if isinstance(connection, ControllerConnection) and connection.is_open else None
        if self._begin(connection) and usable is None:
            with self._holder:
                show_no_controller(self._session)
        if usable is not None:
            self._refresh_tree(usable)

    def _begin(self, connection: Connection | None) -> bool:
        """Begin again if the connection has changed; return True if it has."""
        usable = connection if isinstance(connection, ControllerConnection) and connection.is_open else None
        state = (connection, usable, connection.error if connection else None)
        if state == self._built:
            return False
        self._connection, self._built = usable, state
        self._selected = self._shown = None
        self._holder.clear()
        if usable is not None:
            with self._holder:
                self._build_columns()
        return True

    def _build_columns(self) -> None:
        with ui.element("div").classes("ok-objects"):
            with ui.element("div").classes("ok-objects-side"):
                with ui.element("nav").classes("ok-card").props(f'aria-label="{tr("Objects")}"'):
                    self._tree = ui.element("div").classes("ok-tree").props("role=tree data-testid=tree")
                    self._errors = ErrorBox("error-tree")
                self._adding = ui.element("div").style("display: contents")
            self._detail = ui.element("section").classes("ok-card").props("data-testid=object")

    def _refresh_tree(self, connection: ControllerConnection) -> None:
        objects = connection.objects
        if self._selected is None or self._selected not in objects:
            self._select(objects.controller or objects.root)
        state = (objects.version, self._selected)
        if state == self._shown:
            return
        self._shown = state
        self._tree.clear()
        with self._tree:
            self._branch(objects.root, 1)

    def _branch(self, item: RemoteObject, level: int) -> None:
        selected = item is self._selected
        with ui.element("div").classes("ok-tree-row").style(f"padding-left: {(level - 1) * 16}px"):
            button = ui.button(on_click=lambda: self._select(item)).props("flat dense no-caps align=left")
            button.classes("ok-tree-item" + (" ok-current" if selected else ""))
            button.props(f"role=treeitem aria-level={level} aria-selected={'true' if selected else 'false'}")
            with button:
                ui.icon(ICONS[item.interface])
                ui.label(item.label if item.parent else tr(LABELS[item.interface])).classes("ok-tree-label")
                if item.handle:
                    ui.label(f"{item.handle}").classes("ok-chip ok-mono").tooltip(tr("handle"))
            if item.parent is not None and item.parent.parent is not None:
                release = ui.button(icon="close", on_click=self._releasing(item)).props("flat dense round size=sm")
                release.props["aria-label"] = tr("Release {name}", name=item.label)
        for child in item.children:
            self._branch(child, level + 1)

    def _releasing(self, item: RemoteObject) -> Callable[..., object]:
        async def release() -> None:
            assert self._connection is not None
            await self._connection.objects.release(item)
            self.refresh()

        return self._session.guarded(release, self._errors.show)

    def _select(self, item: RemoteObject) -> None:
        if self._connection is None or item is self._selected:
            return
        for _ in self._parts(item):
            pass
        self._refresh_tree(self._connection)

    def _parts(self, item: RemoteObject) -> Iterator[None]:
        """Build the elements for an object in several parts."""
        assert self._connection is not None
        self._selected = item
        context = ObjectContext(self._session, self._connection, item, self.refresh, self._select)
        self._adding.clear()
        with self._adding:
            build_adding(context)
        yield
        self._detail.clear()
        with self._detail:
            self._build_detail(context)
        yield

    def _build_detail(self, context: ObjectContext) -> None:
        item = context.target
        with ui.element("div").classes("ok-row"):
            ui.icon(ICONS[item.interface], size="24px", color="primary")
            ui.label(item.label if item.parent else tr(LABELS[item.interface])).classes("ok-card-title ok-ellipsis")
            ui.label(tr(LABELS[item.interface])).classes("ok-chip")
            if item.handle:
                ui.label(tr("handle {handle}", handle=item.handle)).classes("ok-chip ok-mono").props(
                    "data-testid=object-handle"
                )
        choices = TABS.get(item.interface, (_FUNCTIONS,))
        holder = ui.element("div").classes("ok-form-column")

        def show(build_tab: Callable[[ObjectContext], None]) -> None:
            holder.clear()
            with holder:
                build_tab(context)

        if len(choices) > 1:
            with ui.tabs().props("dense no-caps align=left inline-label").classes("ok-tabs") as tabs:
                for name, _ in choices:
                    ui.tab(name, tr(name)).props(f"data-testid=tab-{name}")
            tabs.on_value_change(lambda: show(dict(choices)[f"{tabs.value}"]))
            tabs.value = choices[0][0]
            holder.move(target_index=-1)
        else:
            show(choices[0][1])
