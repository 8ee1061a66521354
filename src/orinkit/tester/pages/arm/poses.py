"""Stored poses: save, move to, delete."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.arm.cell import ArmCell
from orinkit.tester.state.arm.poses import LONGEST_NAME, StoredPose
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession, notify
from orinkit.tester.ui.slider import percent_slider

_REFRESH = 0.5  # s


class PosesCard:
    """The card with the stored poses of this type of arm.

    Args:
        session: The page.
        cell: The arm.
    """

    def __init__(self, session: PageSession, cell: ArmCell) -> None:
        self._session, self._cell = session, cell
        self._seen: tuple[object, ...] = ()
        with ui.element("section").classes("ok-card ok-fifth").props("data-testid=poses"):
            ui.label(tr("Poses")).classes("ok-card-title")
            with ui.element("div").classes("ok-row ok-nowrap"):
                self._name = ui.input(tr("Name of the current pose")).props(
                    f"outlined dense maxlength={LONGEST_NAME} data-testid=pose-name"
                )
                self._name.classes("ok-grow")
                save = ui.button(tr("Save"), icon="add_location_alt").props("outline no-caps data-testid=pose-save")
            with ui.element("div").classes("ok-row ok-speed-row"):
                ui.label(tr("Speed")).classes("ok-dim")
                self._speed = percent_slider(tr("Speed of motions to poses in %"), "pose-speed", 20)
                ui.label().bind_text_from(self._speed, "value", lambda value: f"{value:g} %").classes(
                    "ok-value ok-percent"
                )
            self._list = ui.element("div").classes("ok-pose-list")
            self._errors = ErrorBox("error-poses")
        self._save_pose = session.guarded(self._save, self._errors.show)
        save.on_click(self._save_pose)
        self._name.on("keydown.enter", self._save_pose)
        self._refresh()
        ui.timer(_REFRESH, self._refresh)

    def _save(self, _: object = None) -> None:
        monitor = self._cell.monitor
        name = (self._name.value or "").strip()
        if not name:
            raise InvalidValue(tr("the pose has no name. Try: a name such as Home"))
        self._cell.poses.save(name, monitor.type_name, monitor.joints)
        self._name.value = ""
        self._refresh()

    def _refresh(self) -> None:
        type_name = self._cell.monitor.type_name
        seen = type_name, self._cell.poses.version
        if seen == self._seen:
            return
        self._seen = seen
        self._list.clear()
        with self._list:
            poses = list(self._cell.poses.of(type_name))
            if not poses:
                ui.label(tr("No pose is saved for this arm yet.")).classes("ok-dim")
            for pose in poses:
                self._row(pose)

    def _row(self, pose: StoredPose) -> None:
        async def move() -> None:
            button.props("loading")
            try:
                if await self._cell.move_to(pose.joints, float(self._speed.value)):
                    notify(tr("the arm is at the pose {name}", name=pose.name), "positive")
                else:
                    notify(tr("the motion to {name} was stopped", name=pose.name), "warning")
            finally:
                if not button.is_deleted:
                    button.props(remove="loading")

        guard = self._session.guarded
        with ui.element("div").classes("ok-pose").props('data-testid="pose-row"'):
            with ui.element("div").classes("ok-grow"):
                ui.label(pose.name).classes("ok-pose-name")
                ui.label("  ".join(f"{joint:.1f}" for joint in pose.joints)).classes("ok-pose-joints")
            text = tr("Move to {name}", name=pose.name)
            button = ui.button(icon="play_arrow", on_click=guard(move, self._errors.show)).props("flat dense round")
            button.props["aria-label"] = text
            button.props("data-testid=pose-move").tooltip(text)
            text = tr("Delete {name}", name=pose.name)
            delete = ui.button(
                icon="delete_outline", on_click=guard(lambda: self._cell.poses.delete(pose), self._errors.show)
            )
            delete.props("flat dense round data-testid=pose-delete").tooltip(text)
            delete.props["aria-label"] = text
