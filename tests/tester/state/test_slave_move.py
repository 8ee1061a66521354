"""The sequence of Slave Move, without a browser: its steps, and its end without a user."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import pytest

import orinkit
from orinkit.core.errors import InvalidValue, StreamError
from orinkit.server.threaded import Server
from orinkit.streaming.trajectory import generators
from orinkit.streaming.trajectory.csv_file import load_csv
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.slave_move import MotorOff, SlaveMove
from orinkit.tester.state.slave_options import SlaveMoveOptions, Step, StepState
from orinkit.tester.state.slave_trajectory import SlaveTrajectory, read_arm
from orinkit.tester.state.workspace import Workspace
from orinkit.virtual.rc8 import VirtualRC8
from support.arm_log import logged
from support.waiting import PATIENCE, until

HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
SHORT = SlaveTrajectory("J", generators.sine((5.0, *HOME[1:]), 1, 2.0, 0.4), "sine")
LONG = SlaveTrajectory("J", generators.sine((5.0, *HOME[1:]), 1, 20.0, 4.0, 50), "sine")
OPTIONS = SlaveMoveOptions(2, timeout=PATIENCE, approach=100.0)


class Cell(NamedTuple):
    rc8: VirtualRC8
    server: Server


@pytest.fixture(scope="module")
def cell() -> Iterator[Cell]:
    rc8 = VirtualRC8(motor=True)
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield Cell(rc8, server)


class Watcher:
    """The user: gone after a condition is true."""

    def __init__(self, gone: Callable[[SlaveMove], bool] = lambda _: False) -> None:
        self.move: SlaveMove | None = None
        self._gone = gone

    def __call__(self) -> str:
        return "the user is gone" if self.move is not None and self._gone(self.move) else ""


async def carry_out(
    cell: Cell, tmp_path: Any, trajectory: SlaveTrajectory, options: SlaveMoveOptions = OPTIONS,
    gone: Callable[[SlaveMove], bool] = lambda _: False, during: Callable[[Workspace, SlaveMove], Any] | None = None,
) -> SlaveMove:  # fmt: skip
    """Execute the sequence with a workspace of its own, and return it after its end."""
    workspace = Workspace(tmp_path / "profiles.json")
    try:
        connection = workspace.add(ConnectionSpec("arm", cell.server.url))
        await connection.open()
        watcher = Watcher(gone)
        move = workspace.slave_moves.start(connection, trajectory, options, absent=watcher)
        watcher.move = move
        assert move in workspace.motions
        if during is not None:
            await during(workspace, move)
        while not move.finished:  # noqa: ASYNC110 - the user interface polls, too
            await asyncio.sleep(0.005)
        assert move not in workspace.motions
        packets = [packet.data.decode("utf-16-le", "replace") for packet in workspace.packets]
        move.traced = any("slvMove" in text or "TakeArm" in text for text in packets)
        move.kept = [path.read_bytes() for path in move.trace.recordings]
        return move
    finally:
        await workspace.close()


def assert_released(cell: Cell) -> None:
    arm = cell.rc8.state.arm
    assert arm.holder is None
    assert arm.slave.mode is None
    assert arm.motor.on


def test_the_sequence_of_the_document_is_executed(cell, tmp_path):
    with logged(cell.rc8) as log:
        move = asyncio.run(carry_out(cell, tmp_path, SHORT))
    assert (move.error, move.reason) == (None, "")
    assert set(move.steps.values()) == {StepState.DONE}
    assert move.sent == move.result.sent == len(SHORT.points)
    executed = {command[:6] for command in log.commands}
    assert executed >= set(SHORT.points)
    log.check_limits()
    assert_released(cell)
    assert move.trace.command[:6] == pytest.approx(SHORT.points[-1])
    assert sum(count for _, count in move.trace.histogram()) == move.trace.count - 1
    assert not move.traced  # packets of this window do not appear in the main window
    csv, mcap = move.kept
    assert mcap.startswith(b"\x89MCAP")
    again = tmp_path / "again.csv"
    again.write_bytes(csv)
    kind, _, rows = load_csv(again)
    assert kind == "J"
    assert {tuple(round(value, 4) for value in row[:6]) for row in rows} >= {
        tuple(round(value, 4) for value in point) for point in SHORT.points
    }


@pytest.mark.parametrize(
    ("gone", "step"),
    [
        (lambda move: move.step is Step.FIRST_POSE, Step.FIRST_POSE),
        (lambda move: move.sent > 60, Step.STREAM),
        pytest.param(lambda move: move.repetition == 2, Step.STREAM, marks=pytest.mark.soak),
    ],
)
def test_without_a_user_the_arm_stops_within_its_limits_and_is_released(cell, tmp_path, gone, step):
    repeats = step is Step.STREAM
    trajectory = LONG if not repeats else LONG.part(0.0, 2.0 * 4.0)
    if repeats:
        trajectory = SlaveTrajectory("J", generators.sine((5.0, *HOME[1:]), 1, 10.0, 1.0), "sine")
    options = SlaveMoveOptions(2, timeout=PATIENCE, repeat=repeats, approach=20.0 if not repeats else 100.0)
    with logged(cell.rc8) as log:
        move = asyncio.run(carry_out(cell, tmp_path, trajectory, options, gone))
    assert move.reason == "the user is gone"
    assert move.error is None
    assert move.steps[step] is StepState.STOPPED
    log.check_limits()
    assert_released(cell)


def test_the_newest_set_point_is_used_in_mode_1(cell, tmp_path):
    modes = set()

    async def observe(_: Workspace, move: SlaveMove) -> None:
        while not move.finished:
            mode = cell.rc8.state.arm.slave.mode
            modes.add(mode and mode.number)
            await asyncio.sleep(0.005)

    with logged(cell.rc8) as log:
        options = SlaveMoveOptions(1, timeout=PATIENCE, approach=100.0)
        move = asyncio.run(carry_out(cell, tmp_path, SHORT, options, during=observe))
    assert (move.error, move.reason) == (None, "")
    assert modes == {None, 0x102}  # joints, mode 1
    log.check_limits(newest_only=True)
    assert log.commands[-1][:6] == pytest.approx(SHORT.points[-1], abs=1e-6)
    assert_released(cell)


def test_the_stop_button_stops_the_sequence_and_waits_for_standstill(cell, tmp_path):
    async def press(workspace: Workspace, move: SlaveMove) -> None:
        while move.sent < 50 and not move.finished:  # noqa: ASYNC110 - as above
            await asyncio.sleep(0.002)
        assert await workspace.stop_all("the stop button was pressed") == []
        assert move.finished
        assert not cell.rc8.state.arm.busy

    with logged(cell.rc8) as log:
        move = asyncio.run(carry_out(cell, tmp_path, LONG, during=press))
    assert move.reason == "the stop button was pressed"
    assert move.error is None
    log.check_limits()
    assert_released(cell)


def test_the_arm_stops_if_the_tester_hangs_and_does_not_continue_by_itself(cell, tmp_path):
    arm, counts = cell.rc8.state.arm, []

    async def hang(_workspace: Workspace, move: SlaveMove) -> None:
        while move.sent < 200 and not move.finished:  # noqa: ASYNC110 - as above
            await asyncio.sleep(0.002)
        counts.append(len(log.commands))
        until(
            lambda: len(log.commands) > counts[0] + 50 and len(set(log.commands[-100:])) == 1
        )  # blocks the event loop
        assert arm.slave.mode is not None

    with logged(cell.rc8) as log:
        move = asyncio.run(carry_out(cell, tmp_path, LONG, during=hang))
    assert "blocked for more than 1 s" in move.reason
    assert move.error is None
    # The queue of 1 s, and the deceleration; the whole trajectory has many more. Cycles at standstill do not count: a
    # busy machine delays the streaming process, which then continues with its queue.
    steps = sum(before != now for before, now in pairwise(log.commands[counts[0] - 1 :]))
    assert steps < 125 + 150 + 100
    log.check_limits()
    assert_released(cell)


def test_nothing_moves_if_the_motor_is_off(cell, tmp_path):
    arm = cell.rc8.state.arm
    with orinkit.connect(cell.server.url) as controller, controller.robot() as robot:
        robot.execute("Motor", [0, 0])
        try:
            with logged(cell.rc8) as log:
                move = asyncio.run(carry_out(cell, tmp_path, SHORT))
            assert not arm.motor.on
        finally:
            robot.execute("Motor", [1, 0])
    assert isinstance(move.error, MotorOff)
    assert set(move.steps.values()) == {StepState.WAITING}
    assert not log.moved


def test_nothing_moves_if_the_trajectory_exceeds_the_limits_of_the_connected_arm(cell, tmp_path):
    fast = SlaveTrajectory("J", generators.sine(HOME, 1, 90.0, 0.3), "fast")
    with logged(cell.rc8) as log:
        move = asyncio.run(carry_out(cell, tmp_path, fast))
    assert isinstance(move.error, InvalidValue)
    assert "J1: acceleration" in str(move.error)
    assert set(move.steps.values()) == {StepState.WAITING}
    assert not log.moved
    assert_released(cell)


def test_slave_move_is_refused_over_http(tmp_path):
    with orinkit.serve(VirtualRC8(motor=True), "http://127.0.0.1:0") as server:
        move = asyncio.run(carry_out(Cell(None, server), tmp_path, SHORT))
    assert isinstance(move.error, StreamError)
    assert "e-CAP" in str(move.error)


@pytest.mark.parametrize(
    "options",
    [
        SlaveMoveOptions(3),
        SlaveMoveOptions(2, timeout=0.01),
        SlaveMoveOptions(2, timeout=float("nan")),
        SlaveMoveOptions(2, speed=0.0),
        SlaveMoveOptions(2, approach=101.0),
    ],
)
def test_invalid_options_are_refused(options):
    with pytest.raises(InvalidValue):
        options.check()


def test_a_range_of_time_keeps_its_set_points():
    part = SHORT.part(0.1, 0.3)
    assert part.points == SHORT.points[12:39]
    assert SHORT.part(0.0, 99.0) is SHORT
    with pytest.raises(InvalidValue, match="later"):
        SHORT.part(0.3, 0.3)


def test_a_part_that_begins_while_moving_is_retimed(cell, tmp_path):
    async def limits() -> Any:
        async with orinkit.aio.connect(cell.server.url) as controller, await controller.robot() as robot:
            return (await read_arm(robot)).limits("J", 2)

    found = asyncio.run(limits())
    part = LONG.part(1.5, 6.0)
    assert {each.what for each in part.violations(found)} == {"acceleration"}
    slower = part.retimed(found)
    assert slower.violations(found) == []
    assert (slower.points[0], slower.points[-1]) == (part.points[0], part.points[-1])
