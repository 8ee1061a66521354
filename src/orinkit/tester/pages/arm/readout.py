"""The values of the arm: joints with their limits, position, state."""

from __future__ import annotations

from nicegui import ui

from orinkit.arms import AxisModel
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.state.arm.monitor import ArmMonitor, ArmStatus
from orinkit.tester.state.held_motion import MotionState

_NEAR_LIMIT = 5.0  # deg
_COORDINATES = ("X", "Y", "Z", "RX", "RY", "RZ")
_MODES = {1: N_("manual"), 2: N_("teach check"), 3: N_("automatic")}
_UNKNOWN = "–"


class JointBars:
    """A bar for each joint, between its soft limits.

    Args:
        monitor: The state of the arm.
    """

    def __init__(self, monitor: ArmMonitor) -> None:
        self._monitor = monitor
        self._rows: list[_JointRow] = []
        self._built: object = None
        with ui.element("section").classes("ok-card").props("data-testid=joints"):
            ui.label(tr("Joints")).classes("ok-card-title")
            self._holder = ui.element("div").classes("ok-joints")

    def update(self) -> None:
        """Display the newest joints."""
        monitor = self._monitor
        built = monitor.type_name, len(monitor.joints)
        if built != self._built:
            self._built = built
            self._holder.clear()
            axes = monitor.model.axes if monitor.model else ()
            with self._holder:
                self._rows = [
                    _JointRow(number, axes[number - 1] if number <= len(axes) else None)
                    for number in range(1, len(monitor.joints) + 1)
                ]
        for row, joint in zip(self._rows, monitor.joints, strict=False):
            row.update(joint)


class _JointRow:
    def __init__(self, number: int, axis: AxisModel | None) -> None:
        self._axis = axis
        self._shown = ""
        unit = "mm" if axis and axis.linear else "°"
        with ui.element("div").classes("ok-joint"):
            ui.label(f"J{number}").classes("ok-joint-name")
            ui.label(f"{axis.lower:g}" if axis else "").classes("ok-joint-limit")
            with ui.element("div").classes("ok-track").props("aria-hidden=true"):
                self._knob = ui.element("div").classes("ok-knob")
            ui.label(f"{axis.upper:g}" if axis else "").classes("ok-joint-limit")
            self._value = ui.label().classes("ok-value ok-joint-value").props(f'data-testid="joint-{number}"')
            ui.label(unit).classes("ok-unit")

    def update(self, joint: float) -> None:
        text = f"{joint:z.2f}"
        if text == self._shown:
            return
        self._shown = text
        self._value.text = text
        axis = self._axis
        if axis is not None:
            part = min(1.0, max(0.0, (joint - axis.lower) / (axis.upper - axis.lower)))
            self._knob.style(f"left: {part * 100:.1f}%")
            near = min(joint - axis.lower, axis.upper - joint) < _NEAR_LIMIT
            self._knob.classes(add="ok-near" if near else "", remove="" if near else "ok-near")


class PositionReadout:
    """X, Y, Z, RX, RY, RZ and the figure of the tool.

    Args:
        monitor: The state of the arm.
    """

    def __init__(self, monitor: ArmMonitor) -> None:
        self._monitor = monitor
        with ui.element("section").classes("ok-card").props("data-testid=position"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Position")).classes("ok-card-title")
                ui.space()
                self._frame = ui.label().classes("ok-dim")
            with ui.element("div").classes("ok-position"):
                self._values = [_position_value(name) for name in (*_COORDINATES, "Fig")]

    def update(self) -> None:
        """Display the newest position."""
        position, status = self._monitor.position, self._monitor.status
        for index, label in enumerate(self._values):
            value = position[index] if index < len(position) else None
            text = _UNKNOWN if value is None else f"{value:.0f}" if index == len(_COORDINATES) else f"{value:z.2f}"
            if label.text != text:
                label.text = text
        frame = "" if status.tool is None else tr("Tool {tool}, work {work}", tool=status.tool, work=status.work)
        if self._frame.text != frame:
            self._frame.text = frame


def _position_value(name: str) -> ui.label:
    with ui.element("div").classes("ok-coordinate"):
        ui.label(name).classes("ok-coordinate-name")
        value = ui.label(_UNKNOWN).classes("ok-value").props(f'data-testid="position-{name.lower()}"')
        ui.label("" if name == "Fig" else "mm" if name in "XYZ" else "°").classes("ok-unit")
    return value


class StatusChips:
    """The state of the controller in words.

    Args:
        cell: The arm.
    """

    def __init__(self, cell: ArmCell) -> None:
        self._cell = cell
        self._shown: list[tuple[str, str, str]] = []
        self._row = ui.element("div").classes("ok-chips").props("role=status data-testid=arm-status")

    def update(self) -> None:
        """Display the newest state."""
        chips = status_chips(self._cell.monitor.status, self._cell.jogging.state)
        if chips == self._shown:
            return
        self._shown = chips
        self._row.clear()
        with self._row:
            for name, text, kind in chips:
                ui.label(text).classes(f"ok-chip {kind}").props(f'data-testid="chip-{name}"')


def status_chips(status: ArmStatus, jogging: MotionState) -> list[tuple[str, str, str]]:
    """Return a name, a text and a CSS class for each known part of the state."""
    chips: list[tuple[str, str, str]] = []
    if status.motor is not None:
        chips.append(("motor", tr("Motor on") if status.motor else tr("Motor off"), "ok-good" if status.motor else ""))
    if status.moving is not None:
        chips.append(
            ("moving", tr("Moving") if status.moving else tr("Standstill"), "ok-warn" if status.moving else "")
        )
    if status.mode is not None:
        mode = tr(_MODES[status.mode]) if status.mode in _MODES else str(status.mode)
        chips.append(("mode", tr("Mode: {mode}", mode=mode), "" if status.mode == 3 else "ok-warn"))
    if status.token is not None:
        chips.append(
            (
                "token",
                tr("Start allowed") if status.token else tr("Start not allowed"),
                "" if status.token else "ok-warn",
            )
        )
    if status.slave or jogging in (MotionState.READY, MotionState.MOVING):
        chips.append(("slave", tr("Slave mode on"), "ok-warn"))
    if status.error:
        chips.append(("error", status.error_text, "ok-bad ok-chip-long"))
    elif status.mode is not None:
        chips.append(("error", tr("No error"), "ok-good"))
    return chips
