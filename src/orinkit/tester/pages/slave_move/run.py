"""The sequence: options, steps, progress, and the buttons Start, Stop and Exit (RC8 5.1.1)."""

from __future__ import annotations

import math
from typing import Any, Final

from nicegui import ui

from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import N_, tr
from orinkit.tester.pages.slave_move.preview import TrajectoryCard
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_move import MotorOff, SlaveMove
from orinkit.tester.state.slave_options import SlaveMoveOptions, Step, StepState
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.presence import Presence
from orinkit.tester.ui.session import PageSession

LIMIT: Final = 1.5
"""Time in s without a sign of life of the browser after which the arm stops."""

_REFRESH: Final = 0.1  # s
_VALUES: Final = 8
_ICONS: Final = {
    StepState.WAITING: "radio_button_unchecked",
    StepState.ACTIVE: "play_circle",
    StepState.DONE: "check_circle",
    StepState.STOPPED: "cancel",
}
_STATES: Final = {
    StepState.WAITING: N_("waiting"),
    StepState.ACTIVE: N_("in progress"),
    StepState.DONE: N_("done"),
    StepState.STOPPED: N_("stopped"),
}
_MODES: Final = {
    2: N_("2: the reply waits for buffer space"),
    0: N_("0: the set-points are buffered"),
    1: N_("1: the newest set-point is used (Async)"),
}


class RunCard:
    """The card."""

    def __init__(self, session: PageSession, connection: ControllerConnection, trajectory: TrajectoryCard) -> None:
        self._session = session
        self._connection = connection
        self._trajectory = trajectory
        self._presence = Presence(session, LIMIT)
        self._mine: SlaveMove | None = None
        self._shown: tuple[Any, ...] = ()
        with ui.element("section").classes("ok-card").props("data-testid=slave-run"):
            ui.label(tr("Sequence")).classes("ok-card-title")
            self._build_buttons()
            self._errors = ErrorBox("error-run")
            self._arm_link = ui.link(tr("Switch the motor on: page Arm"), "/arm").props("data-testid=arm-link")
            self._arm_link.visible = False
            self._outcome = ui.label("").classes("ok-sm-outcome").props("role=status data-testid=outcome")
            self._build_progress()
            self._build_options()
            ui.label(
                tr("The motor must be on, the controller in automatic mode, and the executable token at this computer.")
            ).classes("ok-dim")
        ui.timer(_REFRESH, self._refresh)

    def _build_buttons(self) -> None:
        with ui.element("div").classes("ok-row ok-sm-buttons"):
            self._start = ui.button(
                tr("Start"), icon="play_arrow", on_click=self._session.guarded(self._begin, self._show_error)
            )
            self._start.props("unelevated no-caps data-testid=start")
            self._start.disable()  # until a trajectory has passed the check
            self._stop = ui.button(tr("Stop"), icon="stop", on_click=self._end, color="negative")
            self._stop.props("unelevated no-caps data-testid=stop")
            exit_button = ui.button(tr("Exit"), icon="logout", on_click=self._exit)
            exit_button.props("flat no-caps data-testid=exit")

    def _build_progress(self) -> None:
        with ui.element("ol").classes("ok-sm-steps").props(f'aria-label="{tr("Steps")}"'):
            self._steps = {}
            for step in Step:
                with ui.element("li").props(f"data-testid=step-{step.name.lower()}") as item:
                    icon = ui.icon(_ICONS[StepState.WAITING])
                    ui.label(tr(step.value))
                    state = ui.label("").classes("ok-sm-state")
                self._steps[step] = item, icon, state
        with ui.element("div").classes("ok-row"):
            self._bar = ui.linear_progress(0.0, show_value=False, size="10px").classes("ok-sm-bar")
            self._bar.props(f'rounded instant-feedback aria-label="{tr("Progress")}"')
            self._percent = ui.label("0 %").classes("ok-value").props("data-testid=progress")
        ui.label(tr("Current set-point")).classes("ok-dim")
        with ui.element("div").classes("ok-sm-point").props("data-testid=set-point"):
            self._numbers = [ui.label("-").classes("ok-value") for _ in range(_VALUES)]

    def _build_options(self) -> None:
        dialect = self._connection.controller.client.dialect
        modes = {
            mode: tr(text) for mode, text in _MODES.items() if dialect.slave_formats or mode != 2  # VE026A 2.2
        }  # fmt: skip
        with ui.element("div").classes("ok-form"):
            self._mode = ui.select(modes, label=tr("Mode"), value=dialect.slave_mode)
            self._mode.props("outlined dense data-testid=mode")
            self._timeout = ui.number(tr("Timeout"), value=500, min=20, max=60_000, suffix="ms")
            self._timeout.props("outlined dense data-testid=timeout")
            self._speed = ui.number(tr("Limits to use"), value=100, min=1, max=100, suffix="%")
            self._speed.props("outlined dense data-testid=speed")
            self._approach = ui.number(tr("Speed to the first pose"), value=20, min=1, max=100, suffix="%")
            self._approach.props("outlined dense data-testid=approach")
        with ui.element("div").classes("ok-row"):
            self._repeat = ui.checkbox(tr("Repeat")).props("data-testid=repeat")
            self._record = ui.checkbox(tr("Record (CSV, MCAP)"), value=True).props("data-testid=record")

    def limits_of_run(self) -> tuple[float, int]:
        """Return the percentage of the limits to use, and the slave mode."""
        return _number(self._speed.value), int(self._mode.value)

    async def _begin(self) -> None:
        trajectory = self._trajectory.checked
        if trajectory is None:
            raise InvalidValue(
                tr("no trajectory has passed the check. Try: generate one, or load a control log, within the limits")
            )  # fmt: skip
        options = SlaveMoveOptions(
            int(self._mode.value), _number(self._timeout.value) / 1000.0, bool(self._repeat.value),
            _number(self._speed.value), _number(self._approach.value), bool(self._record.value),
        ).check()  # fmt: skip
        self._presence.begin()
        self._mine = self._session.workspace.slave_moves.start(
            self._connection, trajectory, options, absent=self._absent, scope=self._session.client
        )

    def _absent(self) -> str:
        """Return why the user counts as gone; ``""`` if the user is present and holds the controls."""
        if self._presence.reason:
            return self._presence.reason
        return "" if self._session.in_control else tr("the controls were given up")

    async def _end(self) -> None:
        """Stop; everybody may do that."""
        move = self._session.workspace.slave_moves.get(self._connection.name)
        if move is not None:
            try:
                await move.stop(tr("the button Stop was pressed"))
            except (OrinError, OSError) as error:
                self._show_error(error)

    async def _exit(self) -> None:
        if self._mine is not None:
            await self._end()
        ui.navigate.to("/")

    def _show_error(self, error: Exception | None) -> None:
        self._errors.show(error)
        self._arm_link.visible = isinstance(error, MotorOff)

    # --- display ------------------------------------------------------------------------------------------------

    def _refresh(self) -> None:
        if self._mine is not None and self._mine.finished:
            self._mine = None
            self._presence.end()
        move = self._session.workspace.slave_moves.get(self._connection.name)
        running = move is not None and not move.finished
        self._start.set_enabled(not running and self._trajectory.checked is not None)
        self._stop.set_enabled(running)
        if move is None:
            return
        shown = (move, move.finished, move.step, move.sent, move.repetition, round(move.approached, 2))
        if shown != self._shown:
            ended = move.finished and (not self._shown or shown[:2] != self._shown[:2])
            self._shown = shown
            self._show(move)
            if ended and (move.error is not None or not move.reason):
                self._show_error(move.error)

    def _show(self, move: SlaveMove) -> None:
        for step, (item, icon, text) in self._steps.items():
            state = move.steps[step]
            item.classes(replace=f"ok-sm-{state.value}")
            item.props("aria-current=step" if state is StepState.ACTIVE else "", remove="aria-current")
            icon.name = _ICONS[state]
            text.text = tr(_STATES[state]) if state is not StepState.WAITING else ""
        fraction = move.approached if move.step is Step.FIRST_POSE else move.fraction
        self._bar.value = fraction
        self._percent.text = f"{fraction:.0%}".replace("%", " %")
        if move.options.repeat and move.step is Step.STREAM:
            self._percent.text += " " + tr("(repetition {number})", number=move.repetition)
        values = (*move.trace.command, *(0.0,) * _VALUES)[:_VALUES] if move.trace.command else ()
        for label, value in zip(self._numbers, values, strict=False):
            label.text = f"{value:.3f}"
        self._outcome.text = outcome_text(move)
        self._outcome.classes(replace=f"ok-sm-outcome {'ok-sm-warned' if move.reason else ''}")


def outcome_text(move: SlaveMove) -> str:
    """Return what happened: why the sequence was stopped, or that it is complete."""
    if not move.finished:
        return ""
    if move.reason:
        return tr("Stopped: {reason}. The arm is at standstill and released.", reason=move.reason)
    return "" if move.error is not None else tr("Complete: all set-points were sent, and the arm is released.")


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
