"""The objects of a connection, calls that move, and the measurement of calls; over a connection to a virtual RC8."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import orinkit
from orinkit.cao import functions as f
from orinkit.core.errors import ConnectionClosed, InvalidValue, ObjectReleased
from orinkit.tester.state import motion_call
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.motion_call import call_function
from orinkit.tester.state.objects import RemoteObject
from orinkit.tester.state.performance import Performance
from orinkit.tester.state.workspace import Workspace
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from support.arm_log import logged
from support.waiting import PATIENCE


class Cell(NamedTuple):
    workspace: Workspace
    connection: ControllerConnection
    rc8: VirtualRC8

    async def add(self, creator: Any, name: str) -> RemoteObject:
        objects = self.connection.objects
        assert objects.controller is not None
        created = (await objects.call(objects.controller, creator, name, "")).created
        assert created is not None
        return created


@asynccontextmanager
async def cell(folder: Path) -> AsyncIterator[Cell]:
    rc8 = VirtualRC8(motor=True)
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        workspace = Workspace(folder / "connections.json")
        connection = workspace.add(ConnectionSpec("cell", server.url))
        assert isinstance(connection, ControllerConnection)
        await connection.open()
        try:
            yield Cell(workspace, connection, rc8)
        finally:
            await workspace.close()


def run(body: Callable[[Cell], Any], folder: Path) -> None:
    async def main() -> None:
        async with cell(folder) as made:
            await body(made)

    asyncio.run(main())


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - the state of another thread
            await asyncio.sleep(0.01)


def test_created_objects_appear_and_released_ones_disappear_with_those_below(tmp_path):
    async def body(cell: Cell) -> None:
        objects = cell.connection.objects
        robot = await cell.add(f.controller_get_robot, "Arm")
        below = (await objects.call(robot, f.robot_get_variable, "@CURRENT_ANGLE", "")).created
        assert [each.label for each in objects] == ["Service", "cell", "Arm", "@CURRENT_ANGLE"]
        assert below is not None
        assert below.path == "cell/Arm/@CURRENT_ANGLE"
        assert len({each.handle for each in objects}) == 4
        assert "I*" in await objects.names(objects.controller, f.controller_get_variable)
        await objects.release(robot)
        assert [each.label for each in objects] == ["Service", "cell"]
        with pytest.raises(ObjectReleased, match="has been released"):
            await objects.call(below, f.variable_get_value)

    run(body, tmp_path)


def test_the_objects_of_a_closed_connection_are_forgotten(tmp_path):
    async def body(cell: Cell) -> None:
        variable = await cell.add(f.controller_get_variable, "I1")
        await cell.connection.close()
        assert list(cell.connection.objects) == [cell.connection.objects.root]
        with pytest.raises(ConnectionClosed):
            await cell.connection.objects.call(variable, f.variable_get_value)
        await cell.connection.open()
        assert [each.label for each in cell.connection.objects] == ["Service", "cell"]

    run(body, tmp_path)


async def begin_move(cell: Cell) -> asyncio.Task[Any]:
    robot = await cell.add(f.controller_get_robot, "Arm")
    take = Variant(VarType.I4 | ARRAY, [0, 1])
    await call_function(cell.workspace, cell.connection, "me", robot, f.robot_execute, "TakeArm", take)
    move = call_function(
        cell.workspace, cell.connection, "me", robot, f.robot_move, 1, "@E J(90,0,90,0,90,0)", "SPEED=1"
    )
    task = asyncio.create_task(move)
    await until(lambda: cell.rc8.state.arm.busy)
    return task


def test_a_move_is_a_motion_of_the_workspace_and_can_be_stopped(tmp_path):
    async def body(cell: Cell) -> None:
        cell.workspace.controls.enter("me")
        task = await begin_move(cell)
        assert len(cell.workspace.motions) == 1
        assert await cell.workspace.stop_all("test") == []
        with pytest.raises(orinkit.CallError):
            await task
        assert not cell.rc8.state.arm.busy
        assert not cell.workspace.motions

    run(body, tmp_path)


def test_a_move_is_stopped_if_the_user_closes_all_pages(tmp_path, monkeypatch):
    monkeypatch.setattr(motion_call, "ABSENCE", 0.2)

    async def body(cell: Cell) -> None:
        cell.workspace.controls.enter("me")
        task = await begin_move(cell)
        cell.workspace.controls.leave("me")
        with pytest.raises(orinkit.CallError):
            await asyncio.wait_for(task, PATIENCE)
        assert not cell.rc8.state.arm.busy

    run(body, tmp_path)


async def begin_next(cell: Cell) -> None:
    """Begin a slow motion with the option NEXT: the call returns while the arm moves."""
    robot = await cell.add(f.controller_get_robot, "Arm")
    take = Variant(VarType.I4 | ARRAY, [0, 1])
    await call_function(cell.workspace, cell.connection, "me", robot, f.robot_execute, "TakeArm", take)
    pose = "@E J(90,0,90,0,90,0)"
    await call_function(cell.workspace, cell.connection, "me", robot, f.robot_move, 1, pose, "SPEED=1, NEXT")
    assert cell.rc8.state.arm.busy
    assert len(cell.workspace.motions) == 1


def test_a_motion_with_next_is_stopped_if_the_user_closes_all_pages(tmp_path, monkeypatch):
    monkeypatch.setattr(motion_call, "ABSENCE", 0.2)

    async def body(cell: Cell) -> None:
        cell.workspace.controls.enter("me")
        await begin_next(cell)
        cell.workspace.controls.leave("me")
        with logged(cell.rc8) as log:
            await until(lambda: not cell.rc8.state.arm.busy)
            log.check_limits()
        await until(lambda: not cell.workspace.motions)
        assert cell.rc8.state.arm.queue.joints[0] < 90

    run(body, tmp_path)


def test_the_stop_button_stops_a_motion_with_next(tmp_path):
    async def body(cell: Cell) -> None:
        cell.workspace.controls.enter("me")
        await begin_next(cell)
        assert await cell.workspace.stop_all("test") == []
        assert not cell.rc8.state.arm.busy
        await until(lambda: not cell.workspace.motions)

    run(body, tmp_path)


def test_a_measurement_ends_at_its_limit_and_reports_consistent_figures(tmp_path):
    async def body(cell: Cell) -> None:
        variable = await cell.add(f.controller_get_variable, "I1")
        measurement = Performance(cell.connection.objects, variable, 300, 60)
        await measurement.run()
        report = measurement.report()
        assert report.calls == sum(report.histogram) == 300
        figures = [report.percentiles[each] for each in (50, 90, 99, 99.9)]
        assert figures == sorted(figures)
        assert 0 < figures[0] <= figures[-1] <= report.largest
        endless = Performance(cell.connection.objects, variable, 1_000_000, 600)
        task = asyncio.create_task(endless.run())
        await until(lambda: endless.calls > 10)
        endless.stop()
        await asyncio.wait_for(task, PATIENCE)
        for calls, seconds in ((0, 1), (1_000_001, 1), (1, 0), (1, 601)):
            with pytest.raises(InvalidValue):
                Performance(cell.connection.objects, variable, calls, seconds)

    run(body, tmp_path)
