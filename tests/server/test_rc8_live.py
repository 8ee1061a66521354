"""The virtual RC8 over the network, in real and in scaled time: equal trajectories, and clients that disappear."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest

import orinkit
from orinkit import functions as f
from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import variant
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from support.leaping import going, take_turns
from support.waiting import PATIENCE, until

MOVES: list[tuple[int, Any, str]] = [
    (1, "@P J(30, 40, 100, 10, 40, 20)", "NEXT"),
    (1, "@E J(20, 45, 90, 0, 45, 0)", ""),
    (2, "P(320, 100, 300, 180, 0, 180)", "SPEED=40"),
    (3, "P(350, 0, 320, 180, 0, 180), P(320, -100, 300, 180, 0, 180)", "ACCEL=50"),
]
KILLED = """
import orinkit, sys
from orinkit import functions as f
rc8 = orinkit.connect(sys.argv[1], timeout=30)
robot = rc8.robot("Arm")
robot.execute("TakeArm", [0, 0])
print("moving", flush=True)
rc8.client.call(f.robot_move, robot.handle, 1, "J(150, 45, 90, 0, 45, 0)", "SPEED=30")
"""


def moving_samples(device: VirtualRC8, start: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Return the commanded joints of the control log, without the standstill before and after the movement."""
    log = device.state.arm.log
    samples = [start, *(tuple(log.record(index)[0:24:4]) for index in range(len(log)))]
    changes = [index for index in range(1, len(samples)) if samples[index] != samples[index - 1]]
    return samples[changes[0] : changes[-1] + 1]


def with_manual_clock() -> list[list[tuple[float, ...]]]:
    """Return the samples of each move with a manual clock that is advanced by one cycle at a time."""
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    robot = device.connect("c", "", "", ClientInfo("127.0.0.1", "tcp")).get_robot("Arm", "")
    robot.execute("TakeArm", variant([0, 0]))
    traces = []
    for moves in (MOVES[:2], MOVES[2:3], MOVES[3:]):
        device.state.arm.log.clear()
        start = device.state.arm.queue.joints
        robot.execute("StartLog", variant(None))
        for move in moves:
            result = robot.move(move[0], variant(move[1]), move[2])
        while isinstance(result, Deferred) and not result.done():
            clock.advance(PERIOD)
        robot.execute("StopLog", variant(None))
        traces.append(moving_samples(device, start))
    device.close()
    return traces


@pytest.mark.parametrize("scale", [1.0, 20.0, 7.3])
def test_a_scaled_clock_gives_the_same_trajectories_sample_by_sample(scale):
    device = VirtualRC8(clock=Clock(scale), motor=True)
    traces = []
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, timeout=PATIENCE) as rc8:
        robot = rc8.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        for moves in (MOVES[:2], MOVES[2:3], MOVES[3:]):
            robot.execute("ClearLog")
            start = device.state.arm.queue.joints
            robot.execute("StartLog")
            for interpolation, pose, option in moves:
                rc8.client.call(f.robot_move, robot.handle, interpolation, pose, option)
            robot.execute("StopLog")
            traces.append(moving_samples(device, start))
    wanted = with_manual_clock()
    assert [len(trace) for trace in traces[1:]] == [len(trace) for trace in wanted[1:]]
    assert traces[1:] == wanted[1:]
    # the second of the blended motions is queued a few cycles sooner or later, which affects the trajectory
    assert traces[0][0] == wanted[0][0]
    assert traces[0][-1] == wanted[0][-1]


def test_the_arm_stops_when_its_client_is_killed(tmp_path):
    """kill -9 during a move: the arm decelerates within its limits, and another client takes it."""
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, timeout=PATIENCE) as rc8:
        robot = rc8.robot("Arm")
        robot.execute("StartLog")
        with subprocess.Popen([sys.executable, "-c", KILLED, server.url], stdout=subprocess.PIPE, text=True) as client:
            assert client.stdout is not None
            assert client.stdout.readline() == "moving\n"
            until(lambda: device.state.arm.busy)
            while device.state.arm.queue.joints[0] <= 10:
                clock.advance(PERIOD)
            with pytest.raises(CallError) as caught:
                robot.execute("TakeArm", [0, 0])
            assert caught.value.code == hresult.ARM_NOT_TAKEN
            client.send_signal(signal.SIGKILL)
        until(lambda: server.clients == 1)
        take_turns(server)
        while device.state.arm.busy:
            clock.advance(PERIOD)
        robot.execute("StopLog")
        assert 10 < device.state.arm.queue.joints[0] < 149
        samples = np.array(moving_samples(device, device.state.arm.model.home))
        velocity = np.diff(samples, axis=0) / PERIOD
        acceleration = np.diff(velocity, axis=0) / PERIOD
        for axis, limits in enumerate(device.state.arm.model.axes):
            assert np.abs(velocity[:, axis]).max() <= limits.velocity * 0.3 * 1.001
            assert np.abs(acceleration[:, axis]).max() <= limits.acceleration * 1.001
        assert device.state.arm.motor.on
        robot.execute("TakeArm", [0, 0])
        with going(clock):
            rc8.client.call(f.robot_move, robot.handle, 1, "J(0, 45, 90, 0, 45, 0)", "")
        assert robot.execute("CurJnt")[:6] == pytest.approx([0, 45, 90, 0, 45, 0], abs=20)
        assert device.state.arm.queue.joints == (0, 45, 90, 0, 45, 0)


def test_halt_from_a_second_connection_stops_the_move_of_the_first():
    clock = ManualClock()
    device = VirtualRC8(clock=clock, motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, timeout=PATIENCE) as first:
        robot = first.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        outcome: list[int] = []

        def move() -> None:
            try:
                first.client.call(f.robot_move, robot.handle, 1, "J(150, 45, 90, 0, 45, 0)", "SPEED=20")
            except CallError as error:
                outcome.append(error.code)

        thread = threading.Thread(target=move)
        thread.start()
        until(lambda: device.state.arm.busy)
        while device.state.arm.queue.joints[0] <= 5:
            clock.advance(PERIOD)
        with orinkit.connect(server.url, timeout=PATIENCE) as second, going(clock):
            second.robot("Arm").halt()
            assert not device.state.arm.busy
        thread.join(PATIENCE)
        assert outcome == [hresult.STOPPED_DURING_PC_MOTION]
        assert not robot.execute("MotionComplete", [-1, 0]) or device.state.arm.queue.joints[0] < 149


def test_fifty_clients_read_while_one_moves():
    """Reading does not disturb the motion: no cycle is missing."""
    device = VirtualRC8(clock=Clock(1), motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url, timeout=PATIENCE) as first:
        robot = first.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        robot.execute("StartLog")
        readers = [orinkit.connect(server.url, timeout=PATIENCE) for _ in range(50)]
        robots = [reader.robot("Arm") for reader in readers]
        first.client.call(f.robot_move, robot.handle, 1, "J(60, 45, 90, 0, 45, 0)", "SPEED=20,NEXT")
        while not robot.execute("MotionComplete", [-1, 0]):
            for each in robots:
                assert len(each.execute("CurJnt")) == 8
        robot.execute("StopLog")
        counters = [device.state.arm.log.record(index)[36] for index in range(len(device.state.arm.log))]
        assert counters == list(range(counters[0], counters[0] + len(counters)))
        for reader in readers:
            reader.close()
