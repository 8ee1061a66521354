"""The arm in 3D."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import nicegui.elements.scene  # noqa: F401 - registers three.js, which the drawing imports
from nicegui import ui

from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.monitor import ArmMonitor
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_CAMERAS = {"iso": N_("Perspective"), "front": N_("Front"), "side": N_("Side"), "top": N_("Top")}
_ICONS = {"iso": "view_in_ar", "front": "crop_portrait", "side": "flip", "top": "vertical_align_bottom"}
_DIGITS = 3


class ArmScene(ui.element, component="arm_view.js", esm={"orinkit-arm": "drawing"}):
    """The canvas on which a worker of the browser draws the arm.

    Args:
        dark: True for dark mode.
        on_init: Callback invoked when the browser can draw; nothing is drawn yet.
        on_simple: Callback invoked with True if the drawing has become simple, because the computer is slow.
        on_failed: Callback invoked if the browser cannot draw.
    """

    def __init__(
        self,
        *,
        dark: bool,
        on_init: Callable[[], None],
        on_simple: Callable[[bool], None],
        on_failed: Callable[[], None],
    ) -> None:
        super().__init__()
        self._props["dark"] = dark
        self.on("init", lambda _: on_init(), [])
        self.on("simple", lambda event: on_simple(bool(event.args)))
        self.on("failed", lambda _: on_failed(), [])

    def call(self, name: str, *values: object) -> None:
        """Call a method of the drawing."""
        self.run_method("call", name, *values)

    def toggle_simple(self) -> None:
        """Change between the simple and the full drawing."""
        self.run_method("toggle")


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
        with ui.element("section").classes("ok-card ok-scene-card ok-first"):
            with ui.element("div").classes("ok-scene-bar"):
                self._title = ui.label().classes("ok-card-title").props("data-testid=arm-type")
                ui.space()
                for name, text in _CAMERAS.items():
                    _button(_ICONS[name], tr(text), name, partial(self._call, "look", name))
                _button("layers_clear", tr("Erase the path"), "clear", partial(self._call, "clear"))
                self._simple = _button("speed", tr("Simple drawing, for slow computers"), "simple", self._toggle_simple)
            self._scene: ArmScene = ArmScene(
                dark=session.dark, on_init=self._initialised, on_simple=self._show_simple, on_failed=self._show_failure
            )
            self._scene.classes("ok-scene").props("data-testid=scene role=img").props["aria-label"] = tr(
                "The arm in 3D"
            )
            self._errors = ErrorBox("error-arm")
            self._unknown = ui.label().classes("ok-scene-unknown").props("role=status data-testid=arm-unknown")
            self._unknown.visible = False

    def update(self) -> None:
        """Draw the arm if its type has become known; send its joints if they have changed."""
        monitor = self._monitor
        self._show_state()
        model = monitor.model
        if not self._ready or model is None or not monitor.joints:
            return
        joints = tuple(round(joint, _DIGITS) for joint in monitor.joints[: model.robot_axes])
        if self._drawn != monitor.type_name:
            self._drawn, self._sent = monitor.type_name, joints
            drawing = {"kind": model.kind, "origins": model.origins, "joints": joints}
            self._scene.call("build", drawing, "iso")
        elif joints != self._sent:
            self._sent = joints
            self._scene.call("joints", joints)

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

    def _call(self, name: str, *values: object) -> None:
        self._scene.call(name, *values)

    def _toggle_simple(self) -> None:
        self._scene.toggle_simple()

    def _initialised(self) -> None:
        self._ready, self._drawn = True, ""  # also if the browser has discarded the canvas

    def _show_simple(self, simple: bool) -> None:
        self._simple.props(f"aria-pressed={'true' if simple else 'false'}")
        self._simple.classes(add="ok-current" if simple else "", remove="" if simple else "ok-current")

    def _show_failure(self) -> None:
        self._errors.show_text(tr("This browser cannot draw the arm: WebGL 2 is not available."))


def _button(icon: str, text: str, name: str, handler: Callable[[], None]) -> ui.button:
    button = ui.button(icon=icon, on_click=handler).props(f'flat dense round size=sm data-testid="scene-{name}"')
    button.props["aria-label"] = text
    button.tooltip(text)
    return button
