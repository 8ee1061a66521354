"""The trajectory: its plot, the range of time to send, and the check against the limits (before anything moves)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, Final

from nicegui import ui

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.streaming.trajectory.preflight import Violation
from orinkit.tester.pages.slave_move import charts
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_trajectory import SlaveArm, SlaveTrajectory, read_arm
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_SHOWN: Final = 50
_MARKED: Final = 20
_CHECK: Final = 0.2  # s


class TrajectoryCard:
    """The card.

    Attributes:
        base: The trajectory of the source; ``None`` before one is chosen.
        checked: The set-points that may be sent: they are within the limits; otherwise ``None``.
        arm: The connected arm, as it was read last.
    """

    def __init__(self, session: PageSession, connection: ControllerConnection) -> None:
        self.base: SlaveTrajectory | None = None
        self.checked: SlaveTrajectory | None = None
        self.arm: SlaveArm | None = None
        self._session = session
        self._connection = connection
        self._options: Callable[[], tuple[float, int]] = lambda: (100.0, 0)
        self._wanted: object = None
        self._done: object = None
        self._busy = False
        with ui.element("section").classes("ok-card").props("data-testid=slave-trajectory"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Trajectory")).classes("ok-card-title")
                self._name = ui.label("").classes("ok-dim ok-sm-name").props("data-testid=trajectory-name")
                ui.space()
                self._chip = ui.label(tr("not checked")).classes("ok-chip").props("role=status data-testid=check")
            self._empty = ui.label(tr("Generate a trajectory or load a control log above.")).classes("ok-empty")
            self._body = ui.element("div").classes("ok-sm-body")
            with self._body:
                self._build_body()
            self._errors = ErrorBox("error-trajectory")
        self._body.visible = False
        ui.timer(_CHECK, self._update)

    def _build_body(self) -> None:
        self._chart = charts.chart(
            charts.base_options(self._session.dark, "deg"), tr("Set-points over time"), "trajectory-chart"
        )
        with ui.element("div").classes("ok-form ok-sm-range"):
            self.start = ui.number(tr("Start time"), value=0.0, min=0, step=0.1, suffix="s")
            self.end = ui.number(tr("End time"), value=0.0, min=0, step=0.1, suffix="s")
            self._total = ui.label("").classes("ok-value").props("data-testid=total")
            self.retime = ui.switch(tr("Slow down where limits are exceeded")).props("data-testid=retime")
        self.start.props("outlined dense data-testid=start-time")
        self.end.props("outlined dense data-testid=end-time")
        self._table = ui.element("div").classes("ok-scroll").props("data-testid=violations")

    def on_options(self, options: Callable[[], tuple[float, int]]) -> None:
        """Set the function that returns the percentage of the limits, and the slave mode."""
        self._options = options

    async def read_arm(self) -> SlaveArm:
        """Read the arm, its type and its joints.

        Raises:
            OrinError: If reading fails.
        """
        self.arm = await read_arm(await self._connection.monitored_robot())
        return self.arm

    def use(self, trajectory: SlaveTrajectory) -> None:
        """Show a new trajectory."""
        self.base, self.checked = trajectory, None
        self.start.value, self.end.value = 0.0, round(trajectory.seconds, 3)
        self._body.visible, self._empty.visible = True, False
        self._name.text = trajectory.source

    def clear(self) -> None:
        """Discard the trajectory, because the parameters of its source are not valid."""
        self.base = self.checked = None
        self._wanted = self._done = None
        self._chip.text = tr("not checked")
        self._chip.classes(replace="ok-chip")

    async def _update(self) -> None:
        """Check the trajectory again if anything has changed."""
        if self.base is None or self._busy:
            return
        wanted = (self.base, self.start.value, self.end.value, self.retime.value, *self._options())
        if wanted == self._done:
            return
        self._busy, self._done = True, wanted
        self.checked = None
        try:
            await self._check(*wanted)
        except (OrinError, OSError, ValueError) as error:
            self._show_chip(tr("cannot be used"), "ok-bad")
            self._errors.show(error)
        finally:
            self._busy = False

    async def _check(
        self, base: SlaveTrajectory, start: float | None, end: float | None, retime: bool, speed: float, mode: int
    ) -> None:
        self._errors.show(None)
        arm = self.arm or await self.read_arm()
        limits = SlaveArm(arm.type_name, arm.model, arm.joints, arm.dialect, speed).limits(base.kind, mode)

        def prepare() -> tuple[SlaveTrajectory, list[Violation], list[dict[str, Any]]]:
            part = base.part(start or 0.0, base.seconds if end is None else end)
            ready = part.retimed(limits) if retime else part
            found = ready.violations(limits)
            marked = [each.time for each in found[:_MARKED]]
            return ready, found, charts.trajectory_series(ready.kind, ready.points, ready.period, marked)

        self._show_chip(tr("checking"), "")
        ready, found, series = await asyncio.to_thread(prepare)
        unit = "deg" if ready.kind == "J" else "mm, deg"
        charts.show(self._chart, {"series": series, "yAxis": {"name": unit}})
        self._total.text = tr(
            "Total {seconds:.3f} s, {count} set-points", seconds=ready.seconds, count=len(ready.points)
        )
        self._show_violations(found, len(ready.points))
        if not found and base is self.base:
            self.checked = ready
        if found:
            self._show_chip(tr("{count} limit violations", count=len(found)), "ok-bad")
        else:
            self._show_chip(tr("check passed (limits used: {speed:g} %)", speed=speed), "ok-good")

    def _show_chip(self, text: str, kind: str) -> None:
        self._chip.text = text
        self._chip.classes(replace=f"ok-chip {kind}")

    def _show_violations(self, found: Sequence[Violation], count: int) -> None:
        self._table.clear()
        self._table.visible = bool(found)
        if not found:
            return
        heads = (tr("Set-points"), tr("Time (s)"), tr("Axis"), tr("Reason"), tr("Value"), tr("Limit"))
        with self._table, ui.element("table").classes("ok-table ok-sm-violations"):
            with ui.element("thead"), ui.element("tr"):
                for head in heads:
                    with ui.element("th").props("scope=col"):
                        ui.label(head)
            with ui.element("tbody"):
                for each in found[:_SHOWN]:
                    _violation_row(each, count)
        if len(found) > _SHOWN:
            with self._table:
                ui.label(tr("and {count} more", count=len(found) - _SHOWN)).classes("ok-dim")


def _violation_row(each: Violation, count: int) -> None:
    if each.sample >= count:
        where = tr("stop at the end")
    else:
        where = f"{each.sample}" if each.last == each.sample else f"{each.sample} - {min(each.last, count - 1)}"
    cells = (
        where, f"{each.time:.3f}", f"J{each.axis}" if each.axis else tr("tool"), tr(each.what),
        f"{each.value:.3f} {each.unit}", f"{each.limit:g} {each.unit}",
    )  # fmt: skip
    with ui.element("tr"):
        for cell in cells:
            with ui.element("td"):
                ui.label(cell)
