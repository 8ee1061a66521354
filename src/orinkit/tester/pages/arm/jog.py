"""Jogging: buttons that move the arm while they are held."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from nicegui import ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.state.arm.jog_path import JogFrame, JogRequest
from orinkit.tester.state.held_motion import IDLE, MotionState
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.hold import HoldControl, hold_button, parsed_key
from orinkit.tester.ui.session import PageSession
from orinkit.tester.ui.slider import percent_slider

_REFRESH = 0.1  # s
_KEY = re.compile(r"([1-8])([+-])")
_FRAMES: dict[JogFrame, str] = {"joint": N_("Joint"), "base": N_("Base"), "tool": N_("Tool")}
_STEPS = (0.0, 0.1, 1.0, 5.0, 10.0)
_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
_TILTS = ("RX", "RY")  # rotations that a SCARA does not have
_STATES = {
    MotionState.OFF: N_("Off"),
    MotionState.STARTING: N_("Entering slave mode"),
    MotionState.READY: N_("Ready"),
    MotionState.MOVING: N_("Moving"),
    MotionState.ENDING: N_("Leaving slave mode"),
}
_KINDS = {MotionState.READY: "ok-good", MotionState.MOVING: "ok-warn", MotionState.STARTING: "ok-warn"}


class JogCard:
    """The card with the buttons.

    Args:
        session: The page.
        cell: The arm.
    """

    def __init__(self, session: PageSession, cell: ArmCell) -> None:
        self._session, self._cell, self._jogging = session, cell, cell.jogging
        self._seen: tuple[object, ...] = ()
        self._axes: object = None
        self._shown_error: Exception | None = None
        self._buttons: list[ui.element] = []
        with ui.element("section").classes("ok-card ok-jog ok-third").props("data-testid=jog"):
            self._build_head()
            self._build_settings()
            self._pad = ui.element("div").classes("ok-pad")
            self._message = ui.label().classes("ok-jog-message").props("role=status data-testid=jog-message")
            self._errors = ErrorBox("error-jog")
        self._hold = HoldControl(session, self._jogging, self._start, self._errors.show)
        self._switch.on("click", self._toggle)
        self._refresh()
        ui.timer(_REFRESH, self._refresh)

    def _build_head(self) -> None:
        with ui.element("div").classes("ok-row"):
            ui.label(tr("Jog")).classes("ok-card-title")
            self._state = ui.label().classes("ok-chip").props("role=status data-testid=jog-state")
            ui.space()
            self._switch = ui.button().props("unelevated dense no-caps data-testid=jog-enable").classes("ok-action")

    def _build_settings(self) -> None:
        frames: dict[Any, str] = {frame: tr(text) for frame, text in _FRAMES.items()}
        self._frame = ui.toggle(frames, value="joint", on_change=self._refresh)
        self._frame.props(f'no-caps unelevated dense spread data-testid=jog-frame aria-label="{tr("Coordinates")}"')
        with ui.element("div").classes("ok-row ok-speed-row"):
            ui.label(tr("Speed")).classes("ok-dim")
            self._speed = percent_slider(tr("Jogging speed in %"), "jog-speed", 20)
            ui.label().bind_text_from(self._speed, "value", lambda value: f"{value:g} %").classes("ok-value ok-percent")
        with ui.element("div").classes("ok-row"):
            ui.label(tr("Step")).classes("ok-dim")
            steps: dict[Any, str] = {step: f"{step:g}" if step else tr("Hold") for step in _STEPS}
            self._step = ui.toggle(steps, value=0.0).props("no-caps unelevated dense data-testid=jog-step")
            ui.label("mm / °").classes("ok-unit")

    def _build_pad(self, axes: int) -> None:
        self._buttons = []
        self._pad.clear()
        names = [f"J{number}" for number in range(1, axes + 1)] if self._frame.value == "joint" else _AXES
        model = self._cell.monitor.model
        hidden = _TILTS if model is not None and model.is_scara else ()
        with self._pad:
            for number, name in enumerate(names, start=1):
                if name in hidden:
                    continue
                self._jog_button(number, name, "-")
                ui.label(name).classes("ok-pad-name")
                self._jog_button(number, name, "+")

    def _jog_button(self, number: int, name: str, sign: str) -> None:
        shown = "−" if sign == "-" else "+"
        label = tr("Jog {axis} {sign}", axis=name, sign=shown)
        button = hold_button(f"{number}{sign}", shown, label, f"jog-{name.lower()}{sign}")
        self._buttons.append(button)

    def close(self) -> None:
        """Stop the motion, because the page no longer shows the buttons."""
        self._hold.close()

    # --- events --------------------------------------------------------------------------------------------------

    async def _toggle(self) -> None:
        await self._hold.toggle()
        self._refresh()

    def _start(self, key: str, absent: Callable[[], str]) -> None:
        found = parsed_key(_KEY, key)
        sign = 1 if found[2] == "+" else -1
        request = JogRequest(self._frame.value, int(found[1]), sign, float(self._speed.value), float(self._step.value))
        self._jogging.start(request, absent)

    # --- display -------------------------------------------------------------------------------------------------

    def _show_error(self, error: Exception | None) -> None:
        self._errors.show(error)
        self._shown_error = error

    def _refresh(self) -> None:
        jogging = self._jogging
        self._hold.refresh()
        usable = self._hold.usable
        axes = len(self._cell.monitor.joints) if self._cell.monitor.model else 6
        if (self._frame.value, axes) != self._axes:
            self._axes = self._frame.value, axes
            self._build_pad(axes)
            self._seen = ()
        seen = jogging.version, usable
        if seen == self._seen:
            return
        self._seen = seen
        for button in self._buttons:
            button.props(f"aria-disabled={'false' if usable else 'true'}")
        self._state.text = tr(_STATES[jogging.state])
        self._state.classes(replace=f"ok-chip {_KINDS.get(jogging.state, '')}")
        self._switch.text = tr("Disable jogging") if jogging.active else tr("Enable jogging")
        self._switch.props("color=primary" if not jogging.active else "color=grey-7")
        self._switch.set_enabled(jogging.state not in (MotionState.STARTING, MotionState.ENDING))
        self._message.text = f"{jogging.message}" or (
            tr(
                "Enable jogging takes the arm and enters slave mode. It ends after {seconds:g} s without use.",
                seconds=IDLE,
            )
            if not jogging.active
            else tr("Hold a button to move. The arm stops when you let go.")
        )
        self._message.classes(replace="ok-jog-message" + (" ok-jog-notice" if jogging.message else ""))
        if jogging.error is not self._shown_error:
            self._show_error(jogging.error)
