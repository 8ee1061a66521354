"""The source of the set-points: a generated motion, or a control log in a CSV file."""

from __future__ import annotations

import asyncio
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from nicegui import events, ui

from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import N_, tr
from orinkit.streaming.trajectory import generators
from orinkit.streaming.trajectory.control_log import LARGEST_FILE, ControlLog
from orinkit.tester.pages.slave_move.log_columns import LogColumnChooser
from orinkit.tester.pages.slave_move.preview import TrajectoryCard
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_trajectory import SlaveArm, SlaveTrajectory, load_trajectory, trajectory_of_log
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_TICK: Final = 0.25  # s
_SHAPES: Final = {"sine": N_("Sine on a joint"), "line": N_("Line in space"), "circle": N_("Circle in space")}


class SourceCard:
    """The card."""

    def __init__(self, session: PageSession, connection: ControllerConnection, target: TrajectoryCard) -> None:
        self._session = session
        self._connection = connection
        self._target = target
        running = session.workspace.slave_moves.get(connection.name)
        self._changed = running is None or running.finished  # a page that is opened shows a first proposal
        self._busy = False
        self._chooser: LogColumnChooser | None = None
        with ui.element("section").classes("ok-card").props("data-testid=slave-source"):
            ui.label(tr("Source of the set-points")).classes("ok-card-title")
            with ui.tabs().props("dense no-caps align=left inline-label") as tabs:
                generate = ui.tab("generate", tr("Generate"), "auto_graph").props("data-testid=tab-generate")
                log = ui.tab("log", tr("Control log (CSV)"), "upload_file").props("data-testid=tab-log")
            with ui.tab_panels(tabs, value=generate).classes("ok-sm-panels"):
                with ui.tab_panel(generate):
                    self._build_generator()
                with ui.tab_panel(log):
                    self._build_upload()
            self._errors = ErrorBox("error-source")
        ui.timer(_TICK, self._tick)

    # --- generated motions --------------------------------------------------------------------------------------

    def _build_generator(self) -> None:
        self._shape = ui.toggle({key: tr(text) for key, text in _SHAPES.items()}, value="sine", on_change=self._change)
        self._shape.props("no-caps unelevated dense data-testid=shape")
        with ui.element("div").classes("ok-form ok-sm-parameters"):
            self._joint = ui.select(
                {n: f"J{n}" for n in range(1, 9)}, value=1, label=tr("Joint"), on_change=self._change
            )
            self._joint.props("outlined dense data-testid=joint")
            self._amplitude = self._number(tr("Amplitude"), 10.0, "deg", "amplitude", -360.0, 360.0)
            self._distance = {
                axis: self._number(axis, 50.0 if axis == "Z" else 0.0, "mm", f"line-{axis}", -3000.0, 3000.0) for axis in "XYZ"
            }  # fmt: skip
            self._radius = self._number(tr("Radius"), 30.0, "mm", "radius", 0.001, 3000.0)
            self._plane = ui.select(list(generators.PLANES), value="XY", label=tr("Plane"), on_change=self._change)
            self._plane.props("outlined dense data-testid=plane")
            self._period = self._number(
                tr("Period"), 4.0, "s", "period", generators.SHORTEST, generators.LONGEST
            )  # fmt: skip
            self._repetitions = self._number(
                tr("Repetitions"), 1, "", "repetitions", 1, generators.MOST_REPETITIONS, whole=True
            )
        with ui.element("div").classes("ok-row"):
            here = ui.button(tr("Start from the current pose"), icon="my_location", on_click=self._change)
            here.props("outline no-caps data-testid=generate")
            ui.label(tr("Lines and circles are in base coordinates; the tool keeps its orientation.")).classes("ok-dim")
        self._show_fields()

    def _number(
        self, label: str, value: float, unit: str, marker: str, least: float, most: float, *, whole: bool = False
    ) -> ui.number:
        def problem(given: float | None) -> str | None:
            if given is None or not math.isfinite(given):
                return tr("a number is required")
            if not least <= given <= most:
                return tr("{least:g} to {most:g} {unit}", least=least, most=most, unit=unit).rstrip()
            return tr("a whole number is required") if whole and given != int(given) else None

        field = ui.number(label, value=value, suffix=unit or None, validation=problem, on_change=self._change)
        return field.props("outlined dense debounce=250").props(f"data-testid={marker}")

    def _fields(self) -> dict[str, list[ui.number]]:
        common = [self._period, self._repetitions]
        return {
            "sine": [self._amplitude, *common],
            "line": [*self._distance.values(), *common],
            "circle": [self._radius, *common],
        }

    def _show_fields(self) -> None:
        shape = self._shape.value
        self._joint.visible = shape == "sine"
        self._plane.visible = shape == "circle"
        shown = self._fields()[shape]
        for fields in self._fields().values():
            for field in fields:
                field.visible = field in shown

    def _change(self) -> None:
        self._changed = True

    async def _tick(self) -> None:
        """Generate the trajectory again after a change."""
        if not self._changed or self._busy:
            return
        self._changed, self._busy = False, True
        try:
            self._show_fields()
            self._errors.show(None)
            if all(field.validate() for field in self._fields()[self._shape.value]):
                arm = await self._target.read_arm()
                self._target.use(await asyncio.to_thread(self._generator(arm)))
            else:
                self._target.clear()
        except (OrinError, OSError, ValueError) as error:
            self._target.clear()
            self._errors.show(error)
        finally:
            self._busy = False

    def _generator(self, arm: SlaveArm) -> Callable[[], SlaveTrajectory]:
        """Return a function that generates the trajectory; it does not access the page."""
        shape, start = self._shape.value, arm.start()
        period, count = float(self._period.value), int(self._repetitions.value)
        joint, amplitude = int(self._joint.value), float(self._amplitude.value or 0.0)
        distance = [float(field.value or 0.0) for field in self._distance.values()]
        radius, plane, name = float(self._radius.value or 0.0), self._plane.value, tr(_SHAPES[shape])
        if shape == "sine" and joint > len(start):
            raise InvalidValue(tr("the arm has no joint J{joint}", joint=joint))

        def generate() -> SlaveTrajectory:
            match shape:
                case "sine":
                    points = generators.sine(start, joint, amplitude, period, count)
                case "line":
                    points = generators.line(arm.known_model(), start, distance, period, count)
                case _:
                    points = generators.circle(arm.known_model(), start, radius, plane, period, count)
            return SlaveTrajectory("J", points, name)

        return generate

    # --- control logs -------------------------------------------------------------------------------------------

    def _build_upload(self) -> None:
        ui.label(
            tr(
                "A CSV file with the command values of each joint: a recording of orinkit, or the control log of another "
                "program such as WINCAPS."
            )
        ).classes("ok-dim")
        upload = ui.upload(
            label=tr("CSV file"), auto_upload=True, max_file_size=LARGEST_FILE, on_upload=self._uploaded,
            on_rejected=lambda: self._errors.show_text(
                tr("the file was refused: it is larger than {most} MB", most=LARGEST_FILE // 2**20)
            ),
        )  # fmt: skip
        upload.props('accept=".csv,.txt,.log" flat bordered data-testid=upload').classes("ok-sm-upload")
        self._columns = ui.element("div")

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        self._errors.show(None)
        self._columns.clear()
        event.sender.reset()  # type: ignore[attr-defined]  # the upload element
        try:
            arm = await self._target.read_arm()
            axes = len(arm.start())
            name = event.file.name[:100]
            with tempfile.TemporaryDirectory(prefix="orinkit-log-") as folder:
                path = Path(folder) / "control-log.csv"
                await event.file.save(path)
                try:
                    self._target.use(await asyncio.to_thread(load_trajectory, path, name, axes))
                except InvalidValue:
                    log = await asyncio.to_thread(ControlLog, path)
                    self._choose_columns(log, name, axes)
        except (OrinError, OSError, ValueError) as error:
            self._target.clear()
            self._errors.show(error)

    def _choose_columns(self, log: ControlLog, name: str, axes: int) -> None:
        """Let the user choose the columns of the command values, with a proposal."""

        async def use() -> None:
            self._errors.show(None)
            try:
                columns = chooser.columns()
                self._target.use(await asyncio.to_thread(trajectory_of_log, log, columns, name, axes))
            except (OrinError, ValueError) as error:
                self._target.clear()
                self._errors.show(error)

        with self._columns:
            chooser = LogColumnChooser(log, axes, use)
