"""The pendant of a virtual RC8."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.arm.pendant import PendantLink
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_REFRESH = 0.25  # s
_MODES = {"manual": N_("Manual"), "teach_check": N_("Teach check"), "automatic": N_("Automatic")}
_MODE_WORDS = {"manual": "manual", "teach_check": "teach", "automatic": "auto"}
_TOKENS = {"any": N_("Any"), "tp": N_("Pendant"), "io": "I/O", "ethernet": "Ethernet"}
_SWITCHES = {
    "protective_stop": ("ProtectiveStop", N_("Protective stop"), "front_hand"),
    "deadman": ("Deadman", N_("Enable switch"), "touch_app"),
    "auto_enable": ("AutoEnable", N_("Auto enable"), "autorenew"),
    "machine_lock": ("MachineLock", N_("Machine lock"), "lock"),
}
_LONGEST = 100


class PendantCard:
    """The card with the buttons of the pendant; the emergency stop works for every user.

    Args:
        session: The page.
        pendant: The pendant.
    """

    def __init__(self, session: PageSession, pendant: PendantLink) -> None:
        self._session, self._pendant = session, pendant
        self._seen: dict[str, Any] = {}
        self._polling = False
        with ui.element("section").classes("ok-card ok-sixth").props("data-testid=pendant"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Pendant of the virtual RC8")).classes("ok-card-title")
                ui.space()
                self._holder = ui.label().classes("ok-dim").props("data-testid=pendant-holder")
            with ui.element("div").classes("ok-pendant"):
                self._build_emergency_stop()
                with ui.element("div").classes("ok-pendant-switches"):
                    self._build_switches()
            with ui.element("div").classes("ok-form ok-pendant-form"):
                self._build_errors()
                self._build_workpiece()
            self._errors = ErrorBox("error-pendant")
        ui.timer(_REFRESH, self._poll)

    def _build_emergency_stop(self) -> None:
        self._stop = ui.element("button").classes("ok-emergency").props("type=button data-testid=emergency-stop")
        self._stop.props("aria-pressed=false")
        with self._stop:
            self._stop_text = ui.label(tr("EMERGENCY STOP"))
            self._stop_hint = ui.label(tr("press")).classes("ok-emergency-hint")
        self._stop.on("click", self._press_emergency_stop)

    def _build_switches(self) -> None:
        self._mode = ui.toggle({key: tr(text) for key, text in _MODES.items()})
        self._mode.props(f'no-caps unelevated dense spread data-testid=pendant-mode aria-label="{tr("Mode switch")}"')
        self._mode.on("update:model-value", self._guarded(lambda: self._press("Mode", _MODE_WORDS[self._mode.value])))
        self._token = ui.toggle({key: tr(text) for key, text in _TOKENS.items()})
        self._token.props("no-caps unelevated dense spread data-testid=pendant-token")
        self._token.props(f'aria-label="{tr("Executable token")}"')
        self._token.on("update:model-value", self._guarded(lambda: self._press("Token", self._token.value)))
        ui.label(tr("Executable token")).classes("ok-dim ok-token-label")
        self._switches: dict[str, ui.button] = {}
        with ui.element("div").classes("ok-switch-grid"):
            for name, (command, text, icon) in _SWITCHES.items():
                button = ui.button(tr(text), icon=icon).props(f"outline dense no-caps data-testid=pendant-{name}")
                button.on_click(self._guarded(self._toggling(name, command)))
                self._switches[name] = button

    def _build_errors(self) -> None:
        with ui.element("div").classes("ok-row ok-nowrap"):
            self._code = ui.input(tr("Error code or name"), placeholder="0x83500121").classes("ok-grow ok-mono")
            self._code.props(f"outlined dense maxlength={_LONGEST} data-testid=pendant-error-code")
            inject = ui.button(tr("Raise")).props("outline no-caps data-testid=pendant-raise")
            clear = ui.button(tr("Clear")).props("outline no-caps data-testid=pendant-clear")
        inject.on_click(self._guarded(self._raise))
        clear.on_click(self._guarded(lambda: self._press("ClearErrors")))

    def _build_workpiece(self) -> None:
        with ui.element("div").classes("ok-row ok-nowrap"):
            self._width = ui.number(tr("Workpiece in the hand (mm)"), value=20, min=0, max=30, step=1).classes(
                "ok-grow"
            )
            self._width.props("outlined dense data-testid=pendant-workpiece")
            place = ui.button(tr("Place")).props("outline no-caps data-testid=pendant-place")
            remove = ui.button(tr("Remove")).props("outline no-caps data-testid=pendant-remove")
        place.on_click(self._guarded(self._place))
        remove.on_click(self._guarded(lambda: self._press("Workpiece")))

    # --- buttons -------------------------------------------------------------------------------------------------

    async def _press(self, command: str, parameter: Any = None) -> None:
        try:
            await self._pendant.press(command, parameter)
        finally:
            self._seen = {}  # also after an error: display the actual state
            self._show()

    async def _press_emergency_stop(self) -> None:
        """Press the emergency stop (every user may), or release it (only the user who holds the controls)."""
        if self._pendant.status.get("emergency_stop"):
            await self._guarded(lambda: self._press("EmergencyStop", False))()
            return
        self._errors.show(None)
        try:
            await self._press("EmergencyStop", True)
        except OrinError as error:
            self._errors.show(error)

    def _toggling(self, name: str, command: str) -> Callable[[], Any]:
        return lambda: self._press(command, not self._pendant.status.get(name))

    async def _raise(self) -> None:
        code = (self._code.value or "").strip()
        if not code or len(code) > _LONGEST:
            raise InvalidValue(tr("the error code is empty. Try: {example}", example="0x83500121"))
        await self._press("RaiseError", [code])

    async def _place(self) -> None:
        if self._width.value is None:
            raise InvalidValue(tr("the width is empty. Try: {example}", example="20"))
        await self._press("Workpiece", [float(self._width.value), False])

    def _guarded(self, handler: Callable[[], Any]) -> Callable[..., Any]:
        run = self._session.guarded(handler, lambda error: self._errors.show(error))

        async def handle(*_: object) -> None:
            await run()
            self._seen = {}
            self._show()

        return handle

    # --- display -------------------------------------------------------------------------------------------------

    async def _poll(self) -> None:
        if self._polling or not self._session.client.has_socket_connection:
            return
        self._polling = True
        try:
            await self._pendant.refresh()
        except (OrinError, OSError) as error:
            self._errors.show(error)
        finally:
            self._polling = False
        self._show()

    def _show(self) -> None:
        status = dict(self._pendant.status)
        status.pop("joints", None)
        if status == self._seen or not status or self._stop.is_deleted:
            return
        self._seen = status
        pressed = bool(status.get("emergency_stop"))
        self._stop.props(f"aria-pressed={'true' if pressed else 'false'}")
        self._stop.classes(add="ok-pressed" if pressed else "", remove="" if pressed else "ok-pressed")
        self._stop_hint.text = tr("pressed: click to release") if pressed else tr("press")
        self._mode.value = status.get("mode")
        token = str(status.get("token", "")).partition(":")[0]
        self._token.value = token if token in _TOKENS else None
        for name, button in self._switches.items():
            on = bool(status.get(name))
            button.props(f"aria-pressed={'true' if on else 'false'}")
            button.classes(add="ok-on" if on else "", remove="" if on else "ok-on")
        holder = status.get("arm_holder")
        self._holder.text = tr("Arm taken by {holder}", holder=holder) if holder else tr("Arm free")
