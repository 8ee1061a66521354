"""The arm in 3D."""

from __future__ import annotations

import json
from importlib.resources import files

from nicegui import ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.monitor import ArmMonitor
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_CAMERAS = {"iso": N_("Perspective"), "front": N_("Front"), "side": N_("Side"), "top": N_("Top")}
_ICONS = {"iso": "view_in_ar", "front": "crop_portrait", "side": "flip", "top": "vertical_align_bottom"}
_FPS = 50
_DIGITS = 3


class ArmView:
    """The scene; it is drawn from the arm's model as soon as the type of the arm is known.

    Args:
        session: The page.
        monitor: The state of the arm.
    """

    def __init__(self, session: PageSession, monitor: ArmMonitor) -> None:
        self._session, self._monitor = session, monitor
        self._drawn = ""
        self._sent: tuple[float, ...] = ()
        self._ready = False
        self._error_shown = ""
        ui.add_body_html(f'<script type="module">{_script()}</script>')
        with ui.element("section").classes("ok-card ok-scene-card ok-first"):
            with ui.element("div").classes("ok-scene-bar"):
                self._title = ui.label().classes("ok-card-title").props("data-testid=arm-type")
                ui.space()
                for name, text in _CAMERAS.items():
                    self._button(_ICONS[name], tr(text), "look", name)
                self._button("layers_clear", tr("Erase the path"), "clear")
            self._scene = (
                ui.scene(grid=False, background_color="#0f151c" if session.dark else "#f5f7f9", fps=_FPS, click_events=[],
                         camera=ui.scene.perspective_camera(fov=38, near=0.02, far=60))
                .classes("ok-scene").props(f'data-testid=scene role=img aria-label="{tr("The arm in 3D")}"')
            )  # fmt: skip
            self._errors = ErrorBox("error-arm")
            self._unknown = ui.label().classes("ok-scene-unknown").props("role=status data-testid=arm-unknown")
            self._unknown.visible = False
        self._scene.on("init", self._initialised)

    def update(self) -> None:
        """Draw the arm if its type has become known; send its joints if they have changed."""
        monitor = self._monitor
        self._show_state()
        model = monitor.model
        if not self._ready or model is None or not monitor.joints:
            return
        joints = tuple(round(joint, _DIGITS) for joint in monitor.joints[:6])
        if self._drawn != monitor.type_name:
            self._drawn, self._sent = monitor.type_name, joints
            drawing = {"origins": model.origins, "joints": joints}
            self._call("build", self._scene.id, drawing, self._session.dark, "iso")
        elif joints != self._sent:
            self._sent = joints
            self._call("joints", joints)

    def _show_state(self) -> None:
        monitor = self._monitor
        title = monitor.model.name if monitor.model else monitor.type_name or tr("Arm")
        if self._title.text != title:
            self._title.text = title
        error = "" if monitor.error is None else f"{monitor.error}"
        if error != self._error_shown:
            self._error_shown = error
            self._errors.show(monitor.error)
        unknown = bool(monitor.joints) and monitor.model is None
        if unknown != self._unknown.visible:
            self._unknown.text = tr(
                "The arm {type} is not known, so it is not drawn and cannot be jogged. Its joints are shown below.",
                type=monitor.type_name or tr("of this controller"),
            )
            self._unknown.visible, self._scene.visible = unknown, not unknown

    def _initialised(self) -> None:
        self._ready, self._drawn = True, ""  # also after the loss of the graphics context

    def _button(self, icon: str, text: str, name: str, *values: str) -> None:
        button = ui.button(icon=icon, on_click=lambda: self._call(name, *values))
        button.props(
            f'flat dense round size=sm aria-label="{text}" data-testid="scene-{values[0] if values else name}"'
        )
        button.tooltip(text)

    def _call(self, name: str, *values: object) -> None:
        call = json.dumps([name, *values])
        self._session.client.run_javascript(f"(window.okArm ??= []).push({call})")


def _script() -> str:
    return (files("orinkit.tester") / "static" / "arm.js").read_text("utf-8")
