"""Jogging: buttons that move the arm while they are held."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.state.arm.jog_path import JogFrame, JogRequest
from orinkit.tester.state.arm.jogging import HEARTBEAT, IDLE, JogState
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.presence import Presence
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.1  # s
_KEY = re.compile(r"([1-8])([+-])")
_FRAMES: dict[JogFrame, str] = {"joint": N_("Joint"), "base": N_("Base"), "tool": N_("Tool")}
_STEPS = (0.0, 0.1, 1.0, 5.0, 10.0)
_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
_STATES = {
    JogState.OFF: N_("Off"),
    JogState.STARTING: N_("Entering slave mode"),
    JogState.READY: N_("Ready"),
    JogState.MOVING: N_("Moving"),
    JogState.ENDING: N_("Leaving slave mode"),
}
_KINDS = {JogState.READY: "ok-good", JogState.MOVING: "ok-warn", JogState.STARTING: "ok-warn"}


class JogCard:
    """The card with the buttons.

    Args:
        session: The page.
        cell: The arm.
    """

    def __init__(self, session: PageSession, cell: ArmCell) -> None:
        self._session, self._cell, self._jogging = session, cell, cell.jogging
        self._presence = Presence(session, HEARTBEAT)
        self._mine = False  # True if this page has begun the motion
        self._enabled = False  # True if this page has enabled jogging
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
        self._switch.on("click", self._toggle)
        ui.on("ok-jog", self._event, ["key"])
        session.client.run_javascript(_script())
        session.while_connected(lambda: None, lambda: self._gone(tr("the page was closed")))
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
            self._speed = ui.slider(min=1, max=100, step=1, value=20)
            self._speed.props(f'aria-label="{tr("Jogging speed in %")}" data-testid=jog-speed')
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
        with self._pad:
            for number, name in enumerate(names, start=1):
                self._jog_button(number, name, "-")
                ui.label(name).classes("ok-pad-name")
                self._jog_button(number, name, "+")

    def _jog_button(self, number: int, name: str, sign: str) -> None:
        shown = "−" if sign == "-" else "+"
        button = ui.element("button").classes("ok-jog-button")
        button.props(f'type=button data-jog="{number}{sign}" data-testid="jog-{name.lower()}{sign}"')
        button.props(f'aria-label="{tr("Jog {axis} {sign}", axis=name, sign=shown)}" aria-disabled=true')
        with button:
            ui.label(shown)
        self._buttons.append(button)

    # --- events --------------------------------------------------------------------------------------------------

    async def _toggle(self) -> None:
        if self._jogging.active:  # everybody may stop
            await self._jogging.disable()
        else:
            self._enabled = True
            await self._session.guarded(self._jogging.enable, self._show_error)()
        self._refresh()

    async def _event(self, event: GenericEventArguments) -> None:
        if self._pad.is_deleted:  # the page was built again for another connection
            return
        key = event.args.get("key") if isinstance(event.args, dict) else None
        if not key:
            self._release()
            return
        if key == "gone":
            self._gone(tr("the page is hidden"))
            return
        await self._session.guarded(self._start, self._errors.show)(str(key))

    def _start(self, key: str) -> None:
        found = _KEY.fullmatch(key)
        if found is None:
            raise InvalidValue(tr("the button {key:.20} does not exist", key=key))
        sign = 1 if found[2] == "+" else -1
        request = JogRequest(self._frame.value, int(found[1]), sign, float(self._speed.value), float(self._step.value))
        self._presence.begin()
        self._mine = True
        self._jogging.start(request, self._absent)

    def _release(self) -> None:
        """Stop the motion that this page has begun, if there is one."""
        if self._mine:
            self._jogging.release()

    def _gone(self, reason: str) -> None:
        """End jogging if this page has enabled it or has begun the motion."""
        if self._mine or self._enabled:
            self._enabled = False
            self._jogging.leave(reason)

    def _absent(self) -> str:
        if not self._session.in_control:
            return tr("another user holds the controls")
        return self._presence.reason

    # --- display -------------------------------------------------------------------------------------------------

    def _show_error(self, error: Exception | None) -> None:
        self._errors.show(error)
        self._shown_error = error

    def _refresh(self) -> None:
        jogging = self._jogging
        usable = jogging.state in (JogState.READY, JogState.MOVING) and self._session.in_control
        axes = len(self._cell.monitor.joints) if self._cell.monitor.model else 6
        if (self._frame.value, axes) != self._axes:
            self._axes = self._frame.value, axes
            self._build_pad(axes)
            self._seen = ()
        if self._mine and jogging.state is JogState.READY and not jogging.requested:
            self._mine = False
            self._presence.end()
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
        self._switch.set_enabled(jogging.state not in (JogState.STARTING, JogState.ENDING))
        self._message.text = jogging.message or (
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


def _script() -> str:
    return (files("orinkit.tester") / "static" / "jog.js").read_text("utf-8")
