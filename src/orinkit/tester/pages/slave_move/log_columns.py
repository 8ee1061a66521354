"""The choice of the columns of a control log: the command value of each joint, and the time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from nicegui import ui

from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.control_log import INTERVAL, ControlLog, LogColumns

_NONE: Final = -1
_UNITS: Final = {1.0: "s", 0.001: "ms", 0.000001: "us"}


class LogColumnChooser:
    """The form.

    Args:
        log: The control log.
        axes: Number of joints of the arm.
        use: Handler of the button that uses the columns.
    """

    def __init__(self, log: ControlLog, axes: int, use: Callable[[], Any]) -> None:
        guess = log.guess()
        names = {_NONE: tr("(none)"), **{place: name[:60] for place, name in enumerate(log.names)}}
        ui.label(tr("{rows} rows. Choose the columns of the command values (deg).", rows=len(log.rows))).classes(
            "ok-dim"
        ).props("data-testid=log-rows")
        with ui.element("div").classes("ok-form ok-sm-columns"):
            self._joints = []
            for joint in range(1, axes + 1):
                found = guess.joints[joint - 1] if joint <= len(guess.joints) else None
                field = ui.select(names, label=f"J{joint}", value=_NONE if found is None else found)
                self._joints.append(field.props("outlined dense options-dense").props(f"data-testid=column-{joint}"))
            self._time = ui.select(names, label=tr("Time"), value=_NONE if guess.time is None else guess.time)
            self._time.props("outlined dense options-dense data-testid=column-time")
            self._unit = ui.select(_UNITS, label=tr("Unit of the time"), value=guess.time_unit).props("outlined dense")
            self._interval = ui.number(tr("Interval, if there is no time"), value=INTERVAL * 1000, suffix="ms")
            self._interval.props("outlined dense data-testid=interval")
        button = ui.button(tr("Use these columns"), icon="check", on_click=use)
        button.props("unelevated no-caps data-testid=use-columns")

    def columns(self) -> LogColumns:
        """Return the chosen columns."""
        joints = tuple(None if field.value == _NONE else int(field.value) for field in self._joints)
        time = None if self._time.value == _NONE else int(self._time.value)
        return LogColumns(joints, time, float(self._unit.value), float(self._interval.value or 0.0) / 1000.0)
