"""Set-points, and buttons that drive the motors while they are held."""

from __future__ import annotations

import re
from collections.abc import Callable

from nicegui import ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.abh3.drive import AXES, DriveRequest
from orinkit.tester.state.abh3.set_point import LONGEST_ENTRY, parse_set_point, range_text, sent_text, unit_text
from orinkit.tester.state.held_motion import IDLE, MotionState
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.hold import HoldControl, hold_button, parsed_key
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.1  # s
_KEY = re.compile(r"(ay|bx|both)([+-])")
_NAMES = {"ay": "A/Y", "bx": "B/X"}
_DEFAULT = "100"
_STATES = {
    MotionState.OFF: N_("Off"),
    MotionState.STARTING: N_("Switching the servo on"),
    MotionState.READY: N_("Ready"),
    MotionState.MOVING: N_("Driving"),
    MotionState.ENDING: N_("Stopping"),
}
_TONES = {MotionState.READY: "ok-good", MotionState.MOVING: "ok-warn", MotionState.STARTING: "ok-warn"}


class DriveCard:
    """The card for driving.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._session, self._drive = session, cell.drive
        self._buttons: list[ui.element] = []
        self._fields: dict[str, ui.input] = {}
        self._units: dict[str, str] = {}
        self._seen: tuple[object, ...] = ()
        self._shown_error: Exception | None = None
        with ui.element("section").classes("ok-card ok-drive ok-first").props("data-testid=drive"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Drive")).classes("ok-card-title")
                self._state = ui.label().classes("ok-chip").props("role=status data-testid=drive-state")
                ui.space()
                self._switch = ui.button().props("unelevated dense no-caps data-testid=drive-enable")
                self._switch.classes("ok-action")
            for axis in AXES:
                self._build_axis(axis)
            with ui.element("div").classes("ok-drive-row"):
                ui.label(tr("Both")).classes("ok-pad-name")
                self._pair("both", tr("both axes"))
            self._message = ui.label().classes("ok-jog-message").props("role=status data-testid=drive-message")
            self._errors = ErrorBox("error-drive")
        self._hold = HoldControl(session, self._drive, self._start, self._errors.show, always=True)
        self._switch.on("click", self._toggle)
        self._refresh()
        ui.timer(_REFRESH, self._refresh)

    def close(self) -> None:
        """Stop driving, because the page no longer shows the buttons."""
        self._hold.close()

    def _build_axis(self, axis: str) -> None:
        with ui.element("div").classes("ok-drive-row"):
            ui.label(_NAMES[axis]).classes("ok-pad-name")
            field = ui.input(tr("Set-point"), value=_DEFAULT, validation=lambda text: self._problem(axis, text))
            field.props(f"outlined dense autocomplete=off inputmode=decimal maxlength={LONGEST_ENTRY + 1}")
            field.props(f"data-testid=set-point-{axis}").classes("ok-mono ok-drive-field")
            field.props["aria-label"] = tr("Set-point of {axis}", axis=_NAMES[axis])
            self._pair(axis, _NAMES[axis])
        self._fields[axis] = field
        field.on_value_change(lambda: self._show_unit(axis))

    def _pair(self, key: str, name: str) -> None:
        with ui.element("div").classes("ok-drive-pair"):
            for sign, shown in (("-", "−"), ("+", "+")):
                label = tr("Drive {axis} {sign} while held", axis=name, sign=shown)
                self._buttons.append(hold_button(f"{key}{sign}", shown, label, f"drive-{key}{sign}"))

    # --- events --------------------------------------------------------------------------------------------------

    def _problem(self, axis: str, text: str | None) -> str | None:
        try:
            parse_set_point(text or "", self._drive.quantity(axis))
        except InvalidValue as error:
            return f"{error} ({range_text(self._drive.quantity(axis))})"
        return None

    async def _toggle(self) -> None:
        await self._hold.toggle()
        self._refresh()

    def _start(self, key: str, absent: Callable[[], str]) -> None:
        found = parsed_key(_KEY, key)
        sign = -1 if found[2] == "-" else 1
        driven = AXES if found[1] == "both" else (found[1],)
        values = {axis: sign * self._set_point(axis) for axis in driven}
        self._drive.start(DriveRequest(**values), absent)

    def _set_point(self, axis: str) -> float:
        self._fields[axis].validate()
        try:
            return parse_set_point(self._fields[axis].value or "", self._drive.quantity(axis))
        except InvalidValue as error:
            raise InvalidValue(tr("{axis}: {error}", axis=_NAMES[axis], error=error)) from None

    # --- display -------------------------------------------------------------------------------------------------

    def _refresh(self) -> None:
        drive = self._drive
        self._hold.refresh()
        for axis in AXES:
            self._follow_quantity(axis)
        seen = drive.version, self._hold.usable
        if seen == self._seen:
            return
        self._seen = seen
        for button in self._buttons:
            button.props(f"aria-disabled={'false' if self._hold.usable else 'true'}")
        self._state.text = tr(_STATES[drive.state])
        self._state.classes(replace=f"ok-chip {_TONES.get(drive.state, '')}")
        self._switch.text = tr("Disable driving") if drive.active else tr("Enable driving")
        self._switch.props("color=primary" if not drive.active else "color=grey-7")
        self._switch.set_enabled(drive.state not in (MotionState.STARTING, MotionState.ENDING))
        self._message.text = f"{drive.message}" or self._hint()
        self._message.classes(replace="ok-jog-message" + (" ok-jog-notice" if drive.message else ""))
        if drive.error is not self._shown_error:
            self._errors.show(drive.error)
            self._shown_error = drive.error

    def _hint(self) -> str:
        if self._drive.active:
            return tr("Hold a button to drive. When you let go, the command is 0 and start is off.")
        return tr(
            "Enable driving resets errors and switches the servo of both axes on. It ends after {seconds:g} s without use.",
            seconds=IDLE,
        )

    def _follow_quantity(self, axis: str) -> None:
        """Adapt the field if the axis changes between velocity and torque; the same number would mean something else."""
        unit = self._drive.quantity(axis).unit
        before = self._units.get(axis)
        if unit == before:
            return
        self._units[axis] = unit
        field = self._fields[axis]
        field.props["suffix"] = unit_text(unit)
        if before is not None:
            field.value = "0"
        self._show_unit(axis)

    def _show_unit(self, axis: str) -> None:
        field = self._fields[axis]
        field.props["hint"] = sent_text(field.value or "", self._drive.quantity(axis))
        field.update()
