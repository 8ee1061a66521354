"""Motor, errors and external speed."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession
from orinkit.tester.ui.slider import percent_slider

_REFRESH = 0.3  # s


class ArmControls:
    """Buttons for the motor and errors, and the external speed.

    Args:
        session: The page.
        cell: The arm.
    """

    def __init__(self, session: PageSession, cell: ArmCell) -> None:
        self._cell = cell
        self._reported: float | None = None  # the external speed that is displayed
        with ui.element("div").classes("ok-row"):
            self._on = _button(tr("Motor on"), "power_settings_new", "motor-on")
            self._off = _button(tr("Motor off"), "power_off", "motor-off")
            clear = _button(tr("Clear errors"), "restart_alt", "clear-errors")
        with ui.element("div").classes("ok-row ok-speed-row") as row:
            ui.label(tr("External speed")).classes("ok-dim")
            self._slider = percent_slider(tr("External speed in %"), "ext-speed", 100)
            self._text = ui.label().classes("ok-value ok-percent")
        self._row = row
        self._errors = ErrorBox("error-controls")
        show = self._errors.show
        self._on.on_click(session.guarded(lambda: self._switch(self._on, on=True), show))
        self._off.on_click(session.guarded(lambda: self._switch(self._off, on=False), show))
        clear.on_click(session.guarded(cell.clear_errors, show))
        self._slider.on("change", session.guarded(self._set_speed, show))
        self._slider.on_value_change(lambda: self._show_speed(self._slider.value))
        self._refresh()
        ui.timer(_REFRESH, self._refresh)

    async def _switch(self, button: ui.button, *, on: bool) -> None:
        button.props("loading")
        try:
            await self._cell.switch_motor(on)
        finally:
            button.props(remove="loading")

    async def _set_speed(self, event: object) -> None:
        try:
            await self._cell.set_speed(float(self._slider.value))
        except Exception:
            self._reported = None  # display the actual speed again
            raise

    def _refresh(self) -> None:
        status = self._cell.monitor.status
        self._row.visible = status.speed is not None
        if status.speed is not None and status.speed != self._reported:
            self._reported = status.speed
            self._slider.value = status.speed
            self._show_speed(status.speed)
        self._on.set_enabled(status.motor is not True)
        self._off.set_enabled(status.motor is not False)

    def _show_speed(self, percent: float) -> None:
        self._text.text = f"{percent:g} %"


def _button(text: str, icon: str, marker: str) -> ui.button:
    return ui.button(text, icon=icon).props(f"outline dense no-caps data-testid={marker}").classes("ok-action")
