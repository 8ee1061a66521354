"""Regressions: errors of programs while they stream, and interruptions, which once moved an arm wrongly or hung."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit import Limits, aio
from orinkit.core.errors import InvalidValue, OrinError, StreamError
from orinkit.streaming.process.shared_memory import StreamMemory
from orinkit.values.poses import J
from support.stopping import stopped
from support.streams import HOME, PATIENCE, Arm, served, sine
from support.waiting import until


@pytest.fixture
def arm() -> Iterator[Arm]:
    with served() as served_arm:
        yield served_arm


@pytest.fixture
def robot(arm: Arm) -> Iterator[orinkit.Robot]:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        robot.execute("TakeArm", [0, 0])
        robot.execute("Motor", [1, 0])
        yield robot


def at(angle: float) -> J:
    return J(angle, 45, 90, 0, 45, 0)


def sent(stream: Any) -> int:
    """Return the number of set-points of trajectories that were sent."""
    return int(stream._streaming.shared.taken)


FORKED = """
import orinkit, os, sys, time
from orinkit.values.poses import J
with orinkit.connect(sys.argv[1]) as rc8:
    robot = rc8.robot("Arm")
    with robot.arm(), robot.motor(), robot.slave_mode() as stream:
        child = os.fork()
        if child == 0:
            time.sleep(600)
            os._exit(0)
        stream.target = J(160, 45, 90, 0, 45, 0)
        print(child, flush=True)
        time.sleep(60)
"""


def test_a_killed_program_that_has_forked(arm: Arm) -> None:
    with subprocess.Popen([sys.executable, "-c", FORKED, arm.url], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        child = int(program.stdout.readline())
        try:
            until(lambda: arm.arm.queue.joints[0] > 5)
            program.kill()
            until(arm.standing)
        finally:
            os.kill(child, signal.SIGKILL)
    assert arm.errors == []
    assert arm.within_limits()


def test_a_run_that_is_cancelled_brings_the_arm_to_rest(arm: Arm) -> None:
    async def main() -> int:
        async with aio.connect(arm.url) as rc8:
            robot = await rc8.robot()
            async with robot.arm(), robot.motor(), robot.slave_mode() as stream:
                running = asyncio.ensure_future(stream.run(sine(20.0)))
                while sent(stream) < 100:  # noqa: ASYNC110 - another process
                    await asyncio.sleep(0.001)
                running.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await running
                await stream.wait()
                return sent(stream)

    assert asyncio.run(main()) < 2000
    assert arm.errors == []
    assert arm.within_limits()


def test_an_iterator_that_raises_brings_the_arm_to_rest(arm: Arm, robot: orinkit.Robot) -> None:
    def points() -> Iterator[tuple[float, ...]]:
        yield from sine(20.0)[:2000]
        raise RuntimeError("mine")

    with robot.slave_mode() as stream:
        with pytest.raises(RuntimeError, match="mine"):
            stream.run(points())
        stream.wait()
        assert sent(stream) < 1000
    assert arm.errors == []


def test_a_slow_iterator_can_be_broken_off(arm: Arm) -> None:
    def points() -> Iterator[tuple[float, ...]]:
        while True:
            time.sleep(0.01)
            yield HOME

    async def main() -> int:
        ticks = 0
        async with aio.connect(arm.url) as rc8:
            robot = await rc8.robot()
            async with robot.arm(), robot.motor(), robot.slave_mode() as stream:
                running = asyncio.ensure_future(stream.run(points()))
                for _ in range(20):
                    await asyncio.sleep(0.01)
                    ticks += 1
                running.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await running
        return ticks

    assert asyncio.run(main()) == 20


def test_a_stop_that_is_cancelled_is_over(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StreamMemory, "order_done", False)  # cancelled before its end, regardless of its duration

    async def main() -> None:
        async with aio.connect(arm.url) as rc8:
            robot = await rc8.robot()
            async with robot.arm(), robot.motor(), robot.slave_mode() as stream:
                stream.target = at(60)
                await asyncio.sleep(0.3)
                samples = stream.latest.number
                stopping = asyncio.ensure_future(stream.stop())
                while stream.latest.number < samples + 2:  # noqa: ASYNC110 - another process
                    await asyncio.sleep(0.001)
                stopping.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await stopping
                stream.target = at(0)
                await stream.wait()
                await stream.run(sine(1.0))

    asyncio.run(main())
    assert arm.commands[-1] == pytest.approx(HOME)


@pytest.mark.parametrize("what", ["stop", "target"])
def test_what_breaks_a_run_off_is_said(arm: Arm, robot: orinkit.Robot, what: str) -> None:
    with robot.slave_mode() as stream:

        def later() -> None:
            until(lambda: arm.arm.queue.joints[0] > 0.5)
            if what == "stop":
                stream.stop()
            else:
                stream.target = at(3)

        thread = threading.Thread(target=later)
        thread.start()
        with pytest.raises(StreamError, match="trajectory was interrupted"):
            stream.run(sine(10.0))
        thread.join()
        stream.wait()
    if what == "target":
        assert arm.commands[-1][0] == pytest.approx(3)
    assert arm.errors == []


@pytest.mark.parametrize("limits", [5, 3])
def test_joints_without_limits_stay_where_they_are(arm: Arm, robot: orinkit.Robot, limits: int) -> None:
    whole = Limits.of_model(arm.model)
    few = Limits(*(getattr(whole, name)[:limits] for name in ("lower", "upper", "velocity", "acceleration", "jerk")))
    robot.move(J(0, 45, 90, 0, 45, 0 if limits == 3 else 0.1), "@E")
    arm.record()
    with pytest.raises(StreamError, match="axis"), robot.slave_mode(limits=few):
        pass
    assert (arm.commands == arm.commands[0]).all()


def test_the_end_of_the_queue_is_the_last_set_point(arm: Arm, robot: orinkit.Robot) -> None:
    points = [(0.1 * number, *HOME[1:]) for number in range(60)]
    with robot.slave_mode() as stream:
        for point in points:
            stream.push(point)
        stream.run([points[-1]])
        for point in reversed(points):
            stream.push(point)
    assert arm.commands[-1] == pytest.approx(HOME)
    assert arm.commands[:, 0].max() == pytest.approx(5.9)


def test_pauses_between_ways_of_feeding_are_no_idleness(arm: Arm, robot: orinkit.Robot) -> None:
    wave = sine(0.6, amplitude=2.0)
    with robot.slave_mode(idle=1.0) as stream:
        stream.run(wave)
        time.sleep(1.1)
        stream.run(wave)
        stream.target = at(2)
        stream.wait()
        time.sleep(1.1)
        stream.target = at(0)
        stream.wait()
        stream.push(HOME)
        stream.stop()
        time.sleep(1.1)
        stream.push(HOME)
        stream.wait()
    assert arm.errors == []


def test_a_streaming_process_that_hangs_is_ended(arm: Arm, robot: orinkit.Robot, monkeypatch: Any) -> None:
    with pytest.raises(OrinError), robot.slave_mode() as stream:
        assert stream._streaming is not None
        with stopped(stream._streaming._process.pid):
            monkeypatch.setattr("orinkit.streaming.process.launcher._HANG_TIMEOUT", 1.0)
            with pytest.raises(StreamError, match="killed"):
                stream.wait()
        robot.get_joints()
    until(lambda: arm.arm.holder is None)


def test_a_python_that_does_not_start(arm: Arm, robot: orinkit.Robot, monkeypatch: Any, tmp_path: Path) -> None:
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\nsleep 60\n")
    script.chmod(0o755)
    monkeypatch.setattr("orinkit.streaming.process.launcher._HANG_TIMEOUT", 0.5)
    monkeypatch.setattr(sys, "executable", str(script))
    with pytest.raises(StreamError), robot.slave_mode():
        pass
    assert robot.get_joints()[:6] == pytest.approx(HOME)


def test_a_frozen_program_is_not_started_again(arm: Arm, robot: orinkit.Robot, monkeypatch: Any) -> None:
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    with pytest.raises(StreamError, match="Python"), robot.slave_mode():
        pass


@pytest.fixture
def restore_switch_interval() -> Iterator[None]:
    interval = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval)


def test_threads_that_look_while_the_block_ends(arm: Arm, robot: orinkit.Robot, restore_switch_interval: None) -> None:
    sys.setswitchinterval(1e-6)
    for _ in range(3):
        end = threading.Event()

        def look(stream: Any, end: threading.Event = end) -> None:
            while not end.is_set():
                try:
                    stream.latest  # noqa: B018 - reading the attribute raises
                except StreamError:
                    return

        with robot.slave_mode() as stream:
            threads = [threading.Thread(target=look, args=(stream,)) for _ in range(3)]
            for thread in threads:
                thread.start()
        end.set()
        for thread in threads:
            thread.join()
        assert robot.execute("slvGetMode") == 0


def test_several_threads_may_push(arm: Arm, robot: orinkit.Robot, restore_switch_interval: None) -> None:
    sys.setswitchinterval(1e-6)
    with robot.slave_mode(queue=2000) as stream:
        written = stream._alive().shared.written
        threads = [threading.Thread(target=lambda: [stream.push(HOME) for _ in range(300)]) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert stream._alive().shared.written == written + 900
        stream.stop()


def test_a_stream_is_used_inside_its_block(arm: Arm, robot: orinkit.Robot) -> None:
    stream = robot.slave_mode()
    for use in (stream.recover, stream.stop, stream.wait, lambda: stream.latest, lambda: stream.push(HOME)):
        with pytest.raises(StreamError, match="block"):
            use()
    with stream:
        feedback = stream.feedback()
        next(feedback)
    with pytest.raises(StreamError, match="block"):
        stream.recover()
    assert list(feedback) == []
    assert robot.execute("slvGetMode") == 0


def test_a_connection_that_is_closed_in_the_block(arm: Arm) -> None:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with pytest.raises(OrinError), robot.arm(), robot.motor(), robot.slave_mode() as stream:
            stream.target = at(90)
            until(lambda: arm.arm.queue.joints[0] > 5)
            rc8.client.close()
    until(arm.free)
    assert arm.errors == []
    assert arm.within_limits()


@pytest.mark.parametrize(
    "outputs",
    [{"mini": 1 << 40}, {"user": (3, b"\1")}, {"user": (128, bytes(200))}, {"hand": "a"}, {"user": 5}, {"mini": 1}],
)
def test_outputs_that_cannot_be_sent_are_refused_and_nothing_ends(
    arm: Arm, robot: orinkit.Robot, outputs: dict[str, Any]
) -> None:
    with robot.slave_mode(hand=0, user=(128, b"\0")) as stream:
        stream.target = at(20)
        with pytest.raises(InvalidValue):
            stream.outputs(**outputs)
        with pytest.raises(InvalidValue):
            stream.push(HOME, **outputs)
        stream.wait()
    assert arm.commands[-1][0] == pytest.approx(20)


def test_standard_streams_may_be_closed_and_places_may_be_paths(arm: Arm) -> None:
    program = """
import orinkit, pathlib, sys
sys.path.insert(0, pathlib.Path("/nowhere"))
with orinkit.connect(sys.argv[1]) as rc8:
    robot = rc8.robot("Arm")
    with robot.arm(), robot.motor(), robot.slave_mode() as stream:
        stream.target = orinkit.J(1, 45, 90, 0, 45, 0)
        stream.wait()
"""
    command = ["sh", "-c", 'exec "$0" -c "$1" "$2" <&- >&-', sys.executable, program, arm.url]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    assert arm.commands[-1][0] == pytest.approx(1)


def test_a_recording_is_not_touched_where_slave_mode_is_refused(arm: Arm, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("mine")
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with pytest.raises(OrinError), robot.slave_mode(record=path):
            pass
    assert path.read_text() == "mine"


def test_a_recording_goes_on_after_an_error(arm: Arm, robot: orinkit.Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    with robot.slave_mode(record=path) as stream:
        stream.run(sine(0.6, amplitude=2.0))
        arm.device.state.raise_error(0x84201486)
        until(lambda: stream.error is not None)
        stream.recover()
        stream.run(sine(0.6, amplitude=2.0))
    times = [float(line.split(",")[0]) for line in path.read_text().splitlines()[1:]]
    assert times == sorted(times)
    assert times[-1] > 1.2
