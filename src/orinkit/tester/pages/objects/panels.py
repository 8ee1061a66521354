"""Panels for the usual functions: Execute, Move, Change, and the value of a variable (as in DENSO's Tester)."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from orinkit.cao import functions as f
from orinkit.core.i18n import N_, tr
from orinkit.rc8.commands import COMMANDS
from orinkit.tester.pages.objects.context import ObjectContext
from orinkit.tester.pages.objects.results import ResultBox
from orinkit.tester.state.objects import Outcome
from orinkit.tester.state.value_text import value_text
from orinkit.tester.ui.fields import Field, TextField, ValueField
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType

INTERPOLATIONS: Final = {1: "1: MOVE P", 2: "2: MOVE L", 3: "3: MOVE C", 4: "4: MOVE S"}
_POSE_EXAMPLES: Final = {int(VarType.BSTR): "@E P1", VARIANT_ARRAY: "(8197, 0, 0, 0, 0, 0, 0, 5),(3, 0),(3, -2)"}
_MOVE_HINT: Final = N_("VT_BSTR: pass mark and pose, for example @E P1 or P(400,0,300,180,0,180,5)")


def build_execute(context: ObjectContext) -> None:
    """Build the panel for extended commands, which are offered by name with their usual parameters."""
    interface = context.target.interface
    dialect = context.connection.controller.client.dialect.name
    known = {each.name.lower(): each for each in COMMANDS.get(dialect, {}).get(interface, ())}
    command = TextField(tr("Command"), "command")
    command.suggest(each.name for each in known.values())
    parameter = ValueField("parameter", tr("Parameter"))
    hint = ui.label().classes("ok-dim ok-line").props("data-testid=command-hint")

    def choose() -> None:
        found = known.get((command.input.value or "").strip().lower())
        if found is None:
            hint.text = ""
            return
        parameter.set(found.vt, placeholder=found.example)
        hint.text = (
            tr("{example}: {hint}", example=found.example, hint=tr(found.hint)) if found.hint else tr("no parameter")
        )
        if found.vt == VarType.EMPTY:
            parameter.set(found.vt, "")

    command.input.on_value_change(choose)
    result = ResultBox()
    function = f.BY_NAME[f"{interface}_Execute"]
    context.button(tr("Execute"), "play_arrow", "execute", function, [command, parameter], result)
    result.to_end()


class _InterpolationField(Field):
    """The interpolation of Robot_Move."""

    def __init__(self) -> None:
        self.select = ui.select(INTERPOLATIONS, value=1, label=tr("Interpolation")).props(
            "outlined dense options-dense"
        )
        self.select.props("data-testid=interpolation")

    async def read(self) -> int:
        """Return the number."""
        return int(self.select.value)


def build_move(context: ObjectContext) -> None:
    """Build the panel for Robot_Move."""
    interpolation = _InterpolationField()
    pose = ValueField("pose", tr("Pose"), VarType.BSTR)
    pose.input.props["placeholder"] = _POSE_EXAMPLES[int(VarType.BSTR)]
    pose.type.on_value_change(lambda: pose.input.props.update(placeholder=_POSE_EXAMPLES.get(int(pose.type.value), "")))
    ui.label(tr(_MOVE_HINT)).classes("ok-dim")
    option = TextField(tr("Option"), "move-option", hint="SPEED=20,ACCEL=20,DECEL=20,TIME=1500,NEXT")
    result = ResultBox()
    with ui.element("div").classes("ok-row"):
        context.button(tr("Move"), "open_with", "move", f.robot_move, [interpolation, pose, option], result)
        halt: list[Field] = [_Constant("")]
        context.button(tr("Halt"), "front_hand", "halt", f.robot_halt, halt, result).props("outline")
    result.to_end()


class _Constant(Field):
    """A value without a field."""

    def __init__(self, value: str) -> None:
        self._value = value

    async def read(self) -> str:
        """Return the value."""
        return self._value


def build_change(context: ObjectContext) -> None:
    """Build the panel for Robot_Change: tool and work."""
    name = TextField(tr("Tool or work"), "change-name", hint="Tool1, Work1")
    name.suggest([*(f"Tool{number}" for number in range(10)), *(f"Work{number}" for number in range(8))])
    result = ResultBox()
    context.button(tr("Change"), "swap_horiz", "change", f.robot_change, [name], result)
    result.to_end()


def build_value(context: ObjectContext) -> None:
    """Build the panel for the value and the ID of a variable."""
    value = ValueField("value", tr("Value"), VarType.I4)
    result = ResultBox("value-result")

    def adopt(outcome: Outcome) -> None:
        """Offer the value that was read for editing, unless the user has entered one."""
        if isinstance(outcome.value, Variant) and not value.input.value:
            text = "" if outcome.value.type in (VarType.EMPTY, VarType.NULL) else value_text(outcome.value)
            value.set(outcome.value.type, placeholder=text[:200])

    with ui.element("div").classes("ok-row"):
        context.button(tr("Get"), "download", "get", f.variable_get_value, [], result, adopt)
        context.button(tr("Put"), "upload", "put", f.variable_put_value, [value], result)
    result.to_end()
    ui.separator()
    ui.label(tr("ID: selects the element of a variable with a wildcard, such as I*.")).classes("ok-dim")
    number = ValueField("id", tr("ID"), VarType.I4)
    outcome = ResultBox("id-result")
    with ui.element("div").classes("ok-row"):
        context.button(tr("Get ID"), "download", "get-id", f.variable_get_id, [], outcome)
        context.button(tr("Put ID"), "upload", "put-id", f.variable_put_id, [number], outcome)
    outcome.to_end()
