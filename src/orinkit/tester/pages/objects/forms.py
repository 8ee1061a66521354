"""Forms for all functions of an object, generated from the function table."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from orinkit.cao.table import Function
from orinkit.core.i18n import tr
from orinkit.tester.pages.objects.context import ObjectContext
from orinkit.tester.pages.objects.results import ResultBox
from orinkit.tester.state.objects import functions_of
from orinkit.tester.ui.fields import field_for
from orinkit.values.types import VarType, type_name


def build_functions(context: ObjectContext) -> None:
    """Build the list of the functions of an object, and the form of the selected one."""
    functions = functions_of(context.target.interface)
    with ui.element("div").classes("ok-functions"):
        with ui.element("div").classes("ok-function-list"):
            search = ui.input(placeholder=tr("Search")).props("dense outlined clearable").props("data-testid=search")
            search.props(f'aria-label="{tr("Search")}"')
            rows = ui.element("div").classes("ok-function-rows")
        holder = ui.element("div").classes("ok-function-form")
    buttons: dict[str, ui.button] = {}
    shown: list[Function[..., Any]] = []

    def select(function: Function[..., Any]) -> None:
        if function in shown:  # the entered arguments remain
            return
        shown[:] = [function]
        for name, button in buttons.items():
            button.classes(**{"add" if name == function.name else "remove": "ok-current"})
        holder.clear()
        with holder:
            build_form(context, function)

    with rows:
        for each in functions:
            button = ui.button(on_click=lambda each=each: select(each)).props("flat no-caps align=left dense")
            button.props(f"data-testid=function-{each.name}").classes("ok-function-row")
            with button:
                ui.label(f"{each.id}").classes("ok-dim ok-mono")
                ui.label(each.name.partition("_")[2]).classes("ok-function-name")
            buttons[each.name] = button

    def narrow() -> None:
        wanted = (search.value or "").lower()
        for each in functions:
            buttons[each.name].visible = wanted in f"{each.id} {each.name} {each.text}".lower()

    search.on_value_change(narrow)
    select(functions[0])


def build_form(context: ObjectContext, function: Function[..., Any]) -> None:
    """Build the form for a function: a field for each argument except the handle, a button, and the result."""
    form = ui.element("section").classes("ok-form-column").props(f"data-testid=form-{function.name}")
    with form:
        with ui.element("div").classes("ok-row"):
            ui.label(function.name).classes("ok-card-title ok-mono")
            ui.label(tr("function {id}", id=function.id)).classes("ok-chip")
            if function.section:
                ui.label(function.section).classes("ok-chip")
        ui.label(function.text).classes("ok-dim")
        fields = []
        for argument in function.arguments:
            if argument.is_handle:
                with ui.element("div").classes("ok-row"):
                    ui.label(tr("handle")).classes("ok-dim")
                    ui.label(f"{context.target.handle}").classes("ok-value").props("data-testid=handle")
                    ui.label(type_name(VarType.I4)).classes("ok-dim")
            else:
                fields.append(field_for(argument))
        result = ResultBox()
        with ui.element("div").classes("ok-row"):
            context.button(tr("Call"), "play_arrow", f"call-{function.name}", function, fields, result)
        result.to_end()
