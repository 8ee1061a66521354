"""The form that adds an object below the selected one: kind, name, option, [Get] for the names."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.pages.objects.context import ObjectContext
from orinkit.tester.pages.objects.results import ResultBox
from orinkit.tester.state.objects import Outcome, creators_of, names_function
from orinkit.tester.ui.fields import Field, TextField, field_for

ICONS: Final = {
    "Service": "dns", "Controller": "developer_board", "Robot": "precision_manufacturing", "Task": "list_alt",
    "File": "description", "Extension": "extension", "Variable": "data_object", "Command": "terminal", "Message": "mail",
}  # fmt: skip
LABELS: Final = {
    "Service": N_("Service"), "Controller": N_("Controller"), "Robot": N_("Robot"), "Task": N_("Task"),
    "File": N_("File"), "Extension": N_("Extension"), "Variable": N_("Variable"), "Command": N_("Command"),
    "Message": N_("Message"),
}  # fmt: skip
_FIRST: Final = ("Variable", "Robot", "Task", "File", "Extension")  # as the tabs of DENSO's Tester


def build_adding(context: ObjectContext) -> None:
    """Build the form; nothing if objects of this kind create no others."""
    creators = {each.creates: each for each in creators_of(context.target.interface)}
    if not creators or context.target.parent is None:
        return
    kinds = [each for each in (*_FIRST, *creators) if each in creators]
    with ui.element("section").classes("ok-card").props("data-testid=adding"):
        ui.label(tr("Add an object to {name}", name=context.target.label)).classes("ok-card-title")
        kind = ui.toggle({each: tr(LABELS[each]) for each in dict.fromkeys(kinds)}, value=kinds[0])
        kind.props("no-caps unelevated dense toggle-color=primary").classes("ok-kinds")
        kind.props("data-testid=kind")
        holder = ui.element("div").classes("ok-form-column")

    def show() -> None:
        holder.clear()
        with holder:
            _build_fields(context, f"{kind.value}")

    kind.on_value_change(show)
    show()


def _build_fields(context: ObjectContext, kind: str) -> None:
    creator = next(each for each in creators_of(context.target.interface) if each.creates == kind)
    result = ResultBox("add-result")
    fields: list[Field] = []
    with ui.element("div").classes("ok-form"):
        for argument in creator.arguments[1:]:
            label = {"name": tr("Name"), "option": tr("Option")}.get(argument.name, argument.name)
            field = (
                TextField(label, f"add-{kind}-{argument.name}")
                if argument.name in ("name", "option")
                else field_for(argument)
            )
            fields.append(field)

    def done(outcome: Outcome) -> None:
        if outcome.created is not None:
            context.select(outcome.created)

    with ui.element("div").classes("ok-row"):
        if names_function(creator) is not None:
            assert isinstance(fields[0], TextField)
            _get_button(context, kind, fields[0], result)
        context.button(tr("Add"), "add", f"add-{kind}", creator, fields, result, done)
    result.to_end()


def _get_button(context: ObjectContext, kind: str, name: TextField, result: ResultBox) -> None:
    creator = next(each for each in creators_of(context.target.interface) if each.creates == kind)
    chips = ui.element("div").classes("ok-names").props("data-testid=names")
    chips.visible = False

    async def fetch() -> None:
        names = await context.connection.objects.names(context.target, creator)
        name.suggest(names[:_MOST_NAMES])
        chips.clear()
        chips.visible = True
        with chips:
            if not names:
                ui.label(tr("The controller has no names.")).classes("ok-dim")
            for each in names[:_MOST_NAMES]:
                ui.button(each, on_click=lambda each=each: name.input.set_value(each)).props("flat dense no-caps")
            if len(names) > _MOST_NAMES:
                ui.label(tr("… {count} in total", count=len(names))).classes("ok-dim")

    get = ui.button(tr("Get"), icon="download").props(f"outline no-caps data-testid=get-{kind}")
    get.on_click(context.session.guarded(fetch, result.fail)).tooltip(tr("Get the names from the controller"))
    chips.move(target_index=-1)


_MOST_NAMES: Final = 200
