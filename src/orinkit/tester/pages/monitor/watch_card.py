"""The watched variables: their values, lowest and highest values, and writing them."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.tester.pages.monitor.watches import Watches
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.poller import VariableRef
from orinkit.tester.state.watch_list import entered_refs
from orinkit.tester.state.watched_value import LONGEST_ENTRY, entered_value, value_text
from orinkit.tester.ui.errors import ErrorBox, error_text
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession, notify
from orinkit.values.types import ARRAY, VarType, type_name

_MOST_NAMES = 500  # suggestions


class WatchCard:
    """The card with the watch list.

    Args:
        session: The page.
        connection: The connection.
        watches: The watched variables of the page.
    """

    def __init__(self, session: PageSession, connection: ControllerConnection, watches: Watches) -> None:
        self._session = session
        self._connection = connection
        self._watches = watches
        self._rows: list[_Row] = []
        self._version = -1
        self._names: dict[str, list[str]] = {}
        with ui.element("section").classes("ok-card").props("data-testid=watch-card"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Watch list")).classes("ok-card-title")
                ui.space()
                self._rate = ui.label().classes("ok-dim ok-value-small")
                _icon_button("restart_alt", tr("Reset minimum and maximum")).on_click(self._shown_after(watches.reset))
            self._build_form()
            self._errors = ErrorBox("error-watch")
            self._list = ui.element("div").classes("ok-watch").props(f'role=table aria-label="{tr("Watch list")}"')
        session.client.on_connect(self._suggest)

    def _build_form(self) -> None:
        kinds = {
            "controller": tr("Controller"), "robot": tr("Robot"), "task": tr("Task"), "extension": tr("Extension"),
        }  # fmt: skip
        with ui.element("form").classes("ok-watch-form").on("submit.prevent", lambda: self._add()):
            self._kind = ui.select(kinds, value="controller", label=tr("Object"), on_change=self._suggest)
            self._kind.props("outlined dense options-dense data-testid=watch-kind")
            self._owner = ui.input(tr("Name of the object"), on_change=self._suggest)
            self._owner.props("outlined dense maxlength=100 list=ok-owners data-testid=watch-owner")
            self._name = ui.input(tr("Variable"), placeholder="I10, P1, @MODE")
            self._name.props("outlined dense maxlength=2001 list=ok-names autocomplete=off data-testid=watch-name")
            self._name.classes("ok-mono ok-grow")
            ui.button(tr("Add"), icon="add").props("unelevated no-caps type=submit data-testid=watch-add")
        self._owners = ui.element("datalist").props("id=ok-owners")
        self._choices = ui.element("datalist").props("id=ok-names")
        self._owner.visible = False

    async def _add(self) -> None:
        await reported(self._session, self._add_entered, self._errors.show)()

    def _add_entered(self) -> None:
        refs = entered_refs(self._kind.value, self._owner.value or "", self._name.value or "")
        self._watches.chosen.add(refs)
        self._name.value = ""
        self._watches.follow()
        self.refresh()

    async def _suggest(self) -> None:
        """Offer the names that the controller reports; without them, users can enter any name."""
        kind = self._kind.value
        self._owner.visible = kind in ("task", "extension")
        try:
            if kind in ("task", "extension"):
                _fill(self._owners, await self._owner_names(kind))
            _fill(self._choices, await self._variable_names(kind, (self._owner.value or "").strip()))
        except (OrinError, OSError):
            self._choices.clear()

    async def _owner_names(self, kind: str) -> list[str]:
        if kind not in self._names:
            controller = await self._connection.monitor()
            names = await (controller.task_names() if kind == "task" else controller.extension_names())
            self._names[kind] = names[:_MOST_NAMES]
        return self._names[kind]

    async def _variable_names(self, kind: str, owner: str) -> list[str]:
        key = f"{kind}/{owner}"
        if key not in self._names:
            controller = await self._connection.monitor()
            if kind in ("task", "extension"):
                if owner not in await self._owner_names(kind):
                    return []
                async with await (controller.task(owner) if kind == "task" else controller.extension(owner)) as found:
                    names = await found.variable_names()
            else:
                names = await (
                    await self._connection.monitored_robot() if kind == "robot" else controller
                ).variable_names()
            self._names[key] = [name.replace("*", "0") for name in names[:_MOST_NAMES]]
        return self._names[key]

    def refresh(self) -> None:
        """Display the current values."""
        chosen = self._watches.chosen
        if self._version != chosen.version:
            self._version = chosen.version
            self._build_rows()
            try:
                self._watches.follow()
            except OrinError as error:
                self._errors.show(error)
        for row in self._rows:
            row.refresh()
        poller = self._connection.poller
        text = tr("every {period:.1f} s", period=poller.period) if self._rows and poller.cycles > 1 else ""
        if self._rate.text != text:
            self._rate.text = text

    def _build_rows(self) -> None:
        self._list.clear()
        self._rows = []
        with self._list:
            refs = list(self._watches.chosen)
            if not refs:
                with ui.element("div").classes("ok-empty"):
                    ui.icon("playlist_add")
                    ui.label(tr("Add variables to watch their values: I10, IO128, P1, or @CURRENT_ANGLE of the robot."))
                return
            with ui.element("div").classes("ok-watch-row ok-watch-head").props("role=row"):
                for text in (tr("Variable"), tr("Type"), tr("Value"), tr("Minimum"), tr("Maximum"), ""):
                    ui.label(text).props("role=columnheader")
            self._rows = [_Row(self._session, self._connection, self._watches, ref, self._shown_after) for ref in refs]

    def _shown_after(self, action: Callable[[], None]) -> Callable[[], None]:
        """Return a function that performs an action and displays its result, without waiting for the next refresh."""

        def act() -> None:
            action()
            self.refresh()

        return act


class _Row:
    """One variable."""

    def __init__(
        self,
        session: PageSession,
        connection: ControllerConnection,
        watches: Watches,
        ref: VariableRef,
        shown_after: Callable[[Callable[[], None]], Callable[[], None]],
    ) -> None:
        self._session, self._connection, self._watches, self._ref = session, connection, watches, ref
        self._shown: tuple[str, ...] = ()
        chosen = watches.chosen
        with ui.element("div").classes("ok-watch-row").props("role=row") as row:
            row.props["data-testid"] = f"watch-{ref.label}"
            ui.label(ref.label).classes("ok-mono ok-watch-name").props("role=cell")
            cells = [ui.label().props("role=cell") for _ in range(4)]
            self._type, self._value, self._low, self._high = cells
            self._type.classes("ok-dim")
            self._value.classes("ok-value ok-watch-value").props("data-testid=value")
            self._low.classes("ok-value ok-value-small ok-watch-extreme").props("data-testid=minimum")
            self._high.classes("ok-value ok-value-small ok-watch-extreme").props("data-testid=maximum")
            self._low.props["data-label"], self._high.props["data-label"] = tr("Minimum"), tr("Maximum")
            with ui.element("div").classes("ok-watch-actions").props("role=cell"):
                _icon_button("edit", tr("Write {name}", name=ref.label), "edit").on_click(self._open_editor)
                self._plot = _icon_button("show_chart", tr("Plot {name}", name=ref.label), "plot")
                self._plot.on_click(shown_after(lambda: watches.toggle(ref)))
                _icon_button("arrow_upward", tr("Move {name} up", name=ref.label), "up").on_click(
                    shown_after(lambda: chosen.move(ref, -1))
                )
                _icon_button("arrow_downward", tr("Move {name} down", name=ref.label), "down").on_click(
                    shown_after(lambda: chosen.move(ref, 1))
                )
                _icon_button("close", tr("Remove {name}", name=ref.label), "remove").on_click(
                    shown_after(lambda: chosen.remove(ref))
                )
            self._editor = ui.element("div").classes("ok-watch-editor")
            self._editor.visible = False

    def refresh(self) -> None:
        """Display the current value."""
        watch = self._watches.watch(self._ref)
        reading = watch.reading if watch else None
        error = reading.error if reading else None
        vt = reading.value.type if reading and reading.value else VarType.EMPTY
        plotted = any(each in self._watches.chosen.plotted for each in self._watches.labels_of(self._ref))
        shown = (
            "" if vt == VarType.EMPTY else type_name(vt).replace("VT_", ""),
            error_text(error) if error else value_text(reading.value if reading else None),
            _number(watch.low if watch else None), _number(watch.high if watch else None),
            "error" if error else "", "plotted" if plotted else "",
        )  # fmt: skip
        if shown == self._shown:
            return
        self._shown = shown
        self._type.text, self._value.text, self._low.text, self._high.text = shown[:4]
        self._value.classes(add="ok-watch-error" if error else "", remove="" if error else "ok-watch-error")
        self._plot.props("color=primary aria-pressed=true" if plotted else "color=none aria-pressed=false")

    def _open_editor(self) -> None:
        self._editor.visible = not self._editor.visible
        self._editor.clear()
        if not self._editor.visible:
            return
        watch = self._watches.watch(self._ref)
        value = watch.reading.value if watch else None
        is_bool = value is not None and value.type == VarType.BOOL
        with self._editor:
            with ui.element("form").classes("ok-row").on("submit.prevent", lambda: write()):
                field = ui.input(tr("New value"), value=value_text(value) if value and value.value != "" else "")
                field.props(f"outlined dense autofocus maxlength={LONGEST_ENTRY + 1} data-testid=new-value")
                field.classes("ok-mono ok-grow")
                ui.button(tr("Write"), icon="edit").props("unelevated no-caps type=submit data-testid=write")
            if is_bool:
                ui.label(tr("on or off")).classes("ok-dim")
            elif value is not None and value.type & ARRAY:
                ui.label(tr("Separate the elements by commas.")).classes("ok-dim")
            errors = ErrorBox("error-write")

        async def send() -> None:
            await self._write(field.value or "")
            self._editor.visible = False

        async def write() -> None:
            await self._session.guarded(send, errors.show)()

    async def _write(self, text: str) -> None:
        """Write the variable through the connection of the user; its packets are in the log."""
        watch, ref = self._watches.watch(self._ref), self._ref
        value = watch.reading.value if watch else None
        new = entered_value(text, value.type if value else VarType.EMPTY)
        controller = self._connection.controller
        if ref.kind == "controller":
            async with await controller.variable(ref.name) as variable:
                await variable.put_value(new)
        elif ref.kind == "robot":
            async with await (await self._connection.robot()).variable(ref.name) as variable:
                await variable.put_value(new)
        else:
            connect = controller.task if ref.kind == "task" else controller.extension
            async with await connect(ref.owner) as owner, await owner.variable(ref.name) as variable:
                await variable.put_value(new)
        notify(tr("{name} is written", name=ref.label), "positive")


def _fill(choices: ui.element, names: list[str]) -> None:
    choices.clear()
    with choices:
        for name in names:
            ui.element("option").props["value"] = name


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.7g}"


def _icon_button(icon: str, text: str, marker: str = "") -> ui.button:
    button = ui.button(icon=icon).props("flat dense round size=sm").tooltip(text)
    button.props["aria-label"] = text
    if marker:
        button.props["data-testid"] = marker
    return button
