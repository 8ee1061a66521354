"""The parameters and monitors of the driver: reading and writing."""

from __future__ import annotations

from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core.i18n import cut, tr, visible
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.abh3.parameters import (
    GROUPS,
    LONGEST_ENTRY,
    ROWS,
    ParameterRow,
    hint_of,
    parse_value,
    unit_of,
    value_text,
)
from orinkit.tester.state.abh3.set_point import unit_text
from orinkit.tester.ui.dialogs import ask
from orinkit.tester.ui.errors import ErrorBox, error_text, problem_text
from orinkit.tester.ui.session import PageSession, notify

_LONGEST = 200  # characters of an error
_EDIT_SLOT = """
<q-td :props="props" style="text-align: right">
  <q-btn v-if="props.row.writable" flat dense round size="sm" icon="edit" :aria-label="props.row.edit"
         :data-testid="'edit-' + props.row.number" @click.stop="$parent.$emit('edit', props.row.key)" />
</q-td>"""
_VALUE_SLOT = """
<q-td :props="props"><span :class="props.row.problem ? 'ok-watch-error' : 'ok-mono'" :title="props.row.problem"
  :data-testid="'parameter-' + props.row.number">{{ props.value }}</span></q-td>"""


class ParametersCard:
    """The table of the parameters of one group, and the form for writing one.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._session, self._cell, self._store = session, cell, cell.parameters
        self._edited: ParameterRow | None = None
        self._shown: object = None
        self._busy = False
        with ui.element("section").classes("ok-card").props("data-testid=parameters"):
            self._build_head()
            self._errors = ErrorBox("error-parameters")
            self._editor = ui.element("div").classes("ok-parameter-editor")
            self._editor.visible = False
            self._build_table()
        self.refresh()

    def _build_head(self) -> None:
        with ui.element("div").classes("ok-row"):
            ui.label(tr("Parameters")).classes("ok-card-title")
            self._group = ui.select({key: tr(text) for key, text in GROUPS.items()}, value="can", label=tr("Group"))
            self._group.props("outlined dense options-dense data-testid=parameter-group").classes("ok-plot-frame")
            self._words = ui.input(placeholder=tr("Filter")).props("outlined dense clearable maxlength=100")
            self._words.classes("ok-grow").props("data-testid=parameter-filter").props["aria-label"] = tr("Filter")
            self._progress = ui.label().classes("ok-dim").props("role=status")
            self._read = ui.button(icon="download", on_click=self._read_or_cancel)
            self._read.props("unelevated no-caps data-testid=read-parameters")

    def _build_table(self) -> None:
        columns = (
            ("number", tr("No."), "left"), ("name", tr("Name"), "left"), ("value", tr("Value"), "right"),
            ("unit", tr("Unit"), "left"), ("edit", "", "right"),
        )  # fmt: skip
        self._table = ui.table(
            columns=[{"name": name, "label": label, "field": name, "align": align} for name, label, align in columns],
            rows=[], row_key="key",
        )  # fmt: skip
        self._table.props("dense flat wrap-cells hide-bottom data-testid=parameter-table")
        self._table.props(":rows-per-page-options=[0]").classes("ok-log ok-parameters")
        self._table.add_slot("body-cell-value", _VALUE_SLOT)
        self._table.add_slot("body-cell-edit", _EDIT_SLOT)
        self._table.on("edit", self._edit)

    # --- reading -------------------------------------------------------------------------------------------------

    def _rows(self) -> list[ParameterRow]:
        words = (self._words.value or "").casefold().split()
        rows = [each for each in ROWS.values() if each.group == self._group.value]
        return [each for each in rows if all(word in _text_of(each).casefold() for word in words)]

    async def _read_or_cancel(self) -> None:
        if self._store.pending:
            self._store.cancel()
            return
        await self._session.guarded(self._read_rows, self._errors.show)()

    async def _read_rows(self) -> None:
        await self._store.read([each.item.address for each in self._rows()])

    # --- writing -------------------------------------------------------------------------------------------------

    def _edit(self, event: GenericEventArguments) -> None:
        row = ROWS.get(event.args) if isinstance(event.args, int) else None
        if row is None or not row.writable:
            return
        self._edited = row
        self._editor.clear()
        self._editor.visible = True
        value = self._store.value(row.item.address)
        with self._editor:
            ui.label(f"{row.item.address:04X} {row.item.text}").classes("ok-watch-name")
            with ui.element("form").classes("ok-row").on("submit.prevent", lambda: write()):
                field = ui.input(
                    tr("New value"), value=value_text(value) if value else "",
                    validation=lambda text: problem_text(lambda entry: parse_value(row.item, entry), text),
                ).without_auto_validation()  # fmt: skip
                field.props(f"outlined dense autofocus autocomplete=off maxlength={LONGEST_ENTRY + 1}")
                field.props("data-testid=parameter-value").classes("ok-mono ok-grow")
                field.props["hint"] = hint_of(row.item)
                field.props["suffix"] = unit_text(unit_of(row.item))
                field.on("blur", field.validate)
                ui.button(tr("Write"), icon="edit").props("unelevated no-caps type=submit data-testid=write-parameter")
                ui.button(tr("Cancel"), on_click=self._close_editor).props("flat no-caps")
            errors = ErrorBox("error-write")

        async def write() -> None:
            if field.validate():
                await self._session.guarded(lambda: self._write(row, field.value or ""), errors.show)()

    async def _write(self, row: ParameterRow, text: str) -> None:
        parse_value(row.item, text)
        if row.concerns_bus:
            question = tr(
                "{name} concerns the communication. With a wrong value, the driver may not reply any more.",
                name=row.item.text,
            )
            title = tr("Write parameter {address:04X}?", address=row.item.address)
            if await ask(self._session, title, question, {"write": tr("Write")}, danger="write") != "write":
                return
        await self._cell.write_parameter(row.item.address, text)
        with self._session.client:
            notify(tr("{name} is written", name=row.item.text), "positive")
        self._close_editor()

    def _close_editor(self) -> None:
        self._edited = None
        self._editor.visible = False

    # --- display -------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Show the values that have been read."""
        pending = self._store.pending
        text = tr("{count} left", count=pending) if pending else ""
        if self._progress.text != text:
            self._progress.text = text
        self._show_button(pending > 0)
        key = self._group.value, self._words.value, self._store.version
        if key == self._shown:
            return
        self._shown = key
        self._table.rows = [self._row(each) for each in self._rows()]

    def _show_button(self, busy: bool) -> None:
        if busy != self._busy or not self._read.text:
            self._busy = busy
            self._read.text = tr("Cancel") if busy else tr("Read")
            self._read.props(f"icon={'close' if busy else 'download'}")

    def _row(self, row: ParameterRow) -> dict[str, Any]:
        address = row.item.address
        value, problem = self._store.value(address), self._store.problem(address)
        shown = value_text(value) if value else tr("refused") if problem else "–"
        return {
            "key": address, "number": f"{address:04X}", "name": row.item.text, "unit": unit_text(unit_of(row.item)),
            "value": shown, "problem": visible(cut(error_text(problem), _LONGEST)) if problem else "", "writable": row.writable,
            "edit": tr("Change {name}", name=row.item.text),
        }  # fmt: skip


def _text_of(row: ParameterRow) -> str:
    return f"{row.item.address:04X} {row.item.text} {row.item.unit}"
