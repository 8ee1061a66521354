"""The second robot of a controller on the command line: --second-model, --robot-id, pendant --robot."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.cli._shared.control_secret import stored_secret
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider

POSE = "J(10,45,90,0,45,0)"


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(clock=Clock(50), language="en", second_model="VS-060")
    yield device
    device.close()


@pytest.fixture
def url(rc8) -> Iterator[str]:
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield server.url


def test_robot_id_chooses_the_robot(run, refused, rc8, url):
    types = [arm.model.type_name for arm in (robot.arm for robot in rc8.state.robots)]
    for options, wanted in (((), types[0]), (("--robot-id", "0"), types[0]), (("--robot-id", "1"), types[1])):
        assert types.index(wanted) is not None
        assert wanted in run("get", url, "@TYPE_NAME", "--robot", "Arm", *options).out
        assert wanted in run("call", url, "Robot_Execute", "GetRobotTypeName", "", "--robot", "Arm", *options).out
    assert "--robot-id" in refused("get", url, "I1", "--robot-id", "1", code=2)
    assert "--robot-id" in refused("call", url, "Controller_GetRobotNames", "", "--robot-id", "1", code=2)
    assert "0x80000204" in refused("get", url, "@TYPE_NAME", "--robot", "Arm", "--robot-id", "2")
    assert "Arm0, Arm1" in run("info", url).out


def test_move_moves_the_robot_that_is_chosen(run, rc8, url):
    run("move", url, POSE, "--mark", "@E", "--robot-id", "1")
    arms = [robot.arm for robot in rc8.state.robots]
    assert arms[1].queue.joints[0] == pytest.approx(10)
    assert arms[0].queue.joints == arms[0].model.home
    assert not any(arm.motor.on for arm in arms)


def test_stream_moves_the_robot_that_is_chosen(run, rc8, url, tmp_path):
    rows = ["j1,j2,j3,j4,j5,j6", *(f"{0.05 * min(step, 20)},30,90,0,60,0" for step in range(25))]
    path = tmp_path / "path.csv"
    path.write_text("\n".join(rows))
    rc8.state.robots[1].arm.place((0, 30, 90, 0, 60, 0))
    run("stream", url, str(path), "--retime", "--robot-id", "1")
    arms = [robot.arm for robot in rc8.state.robots]
    assert arms[1].queue.joints[0] == pytest.approx(1)
    assert arms[0].queue.joints == arms[0].model.home


def test_the_pendant_chooses_a_robot(run, refused, rc8, tmp_path, monkeypatch):
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    provider = ControlProvider(rc8)
    with (
        orinkit.serve(provider, "tcp://127.0.0.1:0") as server,
        stored_secret(provider.secret, int(server.url.rpartition(":")[2])),
    ):
        run("pendant", server.url, "mode", "manual")
        run("pendant", server.url, "deadman", "on")
        run("pendant", server.url, "motor", "on", "--wait", "--robot", "1")
        assert [robot.arm.motor.on for robot in rc8.state.robots] == [False, True]
        run("pendant", server.url, "jog", "1", "5", "--wait", "--robot", "1")
        assert rc8.state.robots[1].arm.queue.joints[0] == pytest.approx(5)
        assert run("pendant", server.url, "status", "--robot", "1", "--json").json["joints"][0] == pytest.approx(5)
        told = refused("pendant", server.url, "status", "--robot", "2")
        assert "no robot 2" in told
        assert provider.secret not in told


def test_serve_adds_a_second_robot(program):
    command = [*program, "serve", "rc8", "--tcp", "127.0.0.1:0", "--second-model", "VS-060"]
    process = subprocess.Popen([*command, "--second-joints", "10,30,90,0,60,0"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        url = process.stdout.readline().removeprefix("ready ").strip()
        with orinkit.connect(url) as controller:
            robot = controller.robot("Arm", "ID=1")
            assert robot.execute("CurJnt")[0] == pytest.approx(10)
    finally:
        process.terminate()
        process.communicate()
