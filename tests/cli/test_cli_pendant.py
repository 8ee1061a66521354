"""pendant, and its counterpart in serve rc8: the control port and the options of the robot."""

from __future__ import annotations

import os
import re
import signal
import stat
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import orinkit
from orinkit.cli._shared.control_secret import find_secret, stored_secret
from orinkit.cli._shared.errors import CommandError
from orinkit.cli.commands.pendant import ACTIONS, PROVIDER
from orinkit.core import i18n
from orinkit.transport.address import Address
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.rc8 import ModeSwitch, VirtualRC8
from orinkit.virtual.rc8.control import CONTROL_NAMES, MODE_NAMES, PROVIDER_NAME, ControlProvider


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(language="en", clock=Clock(50))
    yield device
    device.close()


@pytest.fixture(autouse=True)
def runtime(tmp_path, monkeypatch) -> Path:
    """The directory of the secrets, separate from the one of real servers of this account."""
    directory = tmp_path / "runtime"
    directory.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(directory))
    return directory / "orinkit"


@contextmanager
def buttons(rc8) -> Iterator[str]:
    """Serve the buttons as the command does; yields their address."""
    provider = ControlProvider(rc8)
    with orinkit.serve(provider, "tcp://127.0.0.1:0") as server, stored_secret(provider.secret, port_of(server.url)):
        yield server.url


def port_of(url: str) -> int:
    return int(url.rpartition(":")[2])


@pytest.fixture
def control(rc8) -> Iterator[str]:
    """The address of the buttons."""
    with buttons(rc8) as url:
        yield url


@pytest.fixture
def press(run, control) -> Callable[..., str]:
    """Press a button, check for success and return the output."""

    def press(*words: str) -> str:
        done = run("pendant", control, *words)
        assert (done.code, done.err) == (0, "")
        return done.out

    return press


# --- the buttons ------------------------------------------------------------------------------------------------------


def test_names_match_the_control_port():
    assert PROVIDER == PROVIDER_NAME
    assert {action.command for action in ACTIONS.values()} == set(CONTROL_NAMES)
    assert {name: ModeSwitch(MODE_NAMES[name]) for name in MODE_NAMES} == {
        "manual": ModeSwitch.MANUAL, "teach": ModeSwitch.TEACH_CHECK, "auto": ModeSwitch.AUTOMATIC,
    }  # fmt: skip


@pytest.mark.parametrize(("word", "mode"), [("manual", 1), ("teach", 2), ("AUTO", 3)])
def test_mode(word, mode, press, rc8):
    rc8.set_mode(1 if mode != 1 else 2)
    assert press("mode", word) == f"mode  {ModeSwitch(mode).name.lower()}\n"
    assert rc8.state.switches.mode == mode


@pytest.mark.parametrize(
    ("action", "name"),
    [("estop", "emergency_stop"), ("protective", "protective_stop"), ("auto-enable", "auto_enable"), ("deadman", "deadman"),
     ("lock", "machine_lock")],
)  # fmt: skip
def test_switches(action, name, press, rc8):
    for word, on in (("on", True), ("OFF", False), ("on", True)):
        assert f"  {word.lower()}\n" in press(action, word)
        assert getattr(rc8.state.switches, name) is on


def test_surroundings_of_the_arm(press, run, control, rc8):
    shown = press("surface", "plate", "364,0,280,0,0,0", "stiffness=2", "size=100,50", "radius=5")
    assert "surfaces" in shown
    assert "plate" in shown
    surface = rc8.workspace.surfaces["plate"]
    assert (surface.size, surface.stiffness, surface.radius, surface.thickness) == ((100, 50), 2, 5, 100)
    press("surface", "plate", "none")
    assert not rc8.workspace.surfaces
    assert press("fence", "300,0,300,0,0,0", "400,300,300", "inside") == "virtual fences  1\n"
    assert press("fence", "none") == "virtual fences  0\n"
    press("scene", "2", "3", "tool=4", "speed=30", "name=packing")
    scene = rc8.state.arm.hardware.scenes.scene(2, 3)
    assert (scene.name, scene.tool, scene.work, scene.speed) == ("packing", 4, -1, 30)
    assert press("arm-button", "1") == "buttons of the arm  off on off\n"
    press("save-path", "3")
    assert "Path3.csv" in rc8.state.files.names("")
    assert press("lose-calibration") == "calibrated  off\n"
    for words in (
        ("surface", "plate"), ("surface", "plate", "1,2"), ("surface", "plate", "1,2,3,4,5,6", "colour=1"), ("fence", "x"),
        ("surface", "plate", "1,2,3,4,5,6", "stiffness=0"), ("surface", "other", "none"), ("scene", "0", "1"), ("scene", "1", "1", "a=1"),
        ("fence", "1,2,3,4,5,6", "1,2,3", "here"), ("arm-button", "3"), ("save-path", "21"),
    ):  # fmt: skip
        assert run("pendant", control, *words).code != 0, words


def test_token(press, rc8):
    assert press("token", "ethernet:127.0.0.1") == "executable token  ethernet:127.0.0.1\n"
    assert str(rc8.state.switches.token) == "ethernet:127.0.0.1"


def test_motor_and_jog(press, rc8):
    press("mode", "manual")
    press("deadman", "on")
    assert press("motor", "on", "--wait") == "motor  on\n"
    start = rc8.state.arm.servo.encoder[0]
    shown = press("jog", "1", "5.5", "--wait")
    assert shown.splitlines()[0] == "moving  off"
    assert rc8.state.arm.queue.joints[0] == pytest.approx(start + 5.5)
    press("jog", "1", "-5.5", "--wait")
    assert rc8.state.arm.queue.joints[0] == pytest.approx(start)
    press("motor", "off", "--wait")
    assert not rc8.state.arm.motor.on


def test_jog_without_waiting(run):
    clock = ManualClock()
    rc8 = VirtualRC8(language="en", clock=clock)
    with buttons(rc8) as url:

        def press(*words: str, seconds: float = 0.0) -> None:
            assert run("pendant", url, *words).code == 0
            clock.advance(seconds)

        press("mode", "manual", seconds=1)
        press("deadman", "on")
        press("motor", "on", seconds=2)
        press("jog", "1", "90", seconds=0.5)
        press("deadman", "off", seconds=10)  # it stops long before the target
        with rc8.state.cycles:
            assert 1 < rc8.state.arm.queue.joints[0] < 45
    rc8.close()


@pytest.mark.parametrize("code", ["MOTOR_NOT_ON", "motor_not_on", "0x81501003"])
def test_errors(code, press, rc8):
    assert press("error", code) == "error  81501003\n"
    assert press("clear") == "error  -\n"
    press("error", code, "my words")
    assert rc8.state.faults.current.at(0).message == "my words"
    assert press("restart") == "motor  off\nerror  -\n"


def test_workpiece(press, rc8):
    assert "hand: workpiece  12.5\n" in press("workpiece", "12.5")
    assert rc8.state.hand.workpiece.width == 12.5
    assert "hand: workpiece  -\n" in press("workpiece", "none")


def test_time(press, rc8):
    assert press("time", "2030-01-02", "03:04:05") == "time  2030-01-02 03:04:05\n"
    assert "time  2031-01-02 00:00:0" in press("time", "2031-01-02")


def test_packets_are_captured(press, tmp_path):
    path = tmp_path / "pendant.pcapng"
    press("status", "--capture", str(path))
    assert "Status".encode("utf-16-le") in path.read_bytes()


def test_status(press, run, control):
    press("estop", "on")
    rows = dict(line.split("  ", 1) for line in press("status").splitlines())
    assert {name.strip(): value.strip() for name, value in rows.items()} | {
        "mode": "automatic", "executable token": "any", "emergency stop": "on", "motor": "off", "hand: position": "30",
    } == {name.strip(): value.strip() for name, value in rows.items()}  # fmt: skip
    document = run("pendant", control, "status", "--json").json
    assert (document["emergency_stop"], document["hand"]["position"]) == (True, 30.0)
    assert run("pendant", control, "estop", "off", "--json").json["emergency_stop"] is False


def test_in_japanese(press):
    i18n.use("ja")
    assert press("estop", "on").startswith("非常停止  on\n")


# --- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["jump"], "unknown action 'jump'. Try: mode, token, estop, "),
        (["mode"], "usage: mode manual|teach|auto"),
        (["mode", "asleep"], "'asleep' is not a mode. Try: manual, teach or auto"),
        (["mode", "manual", "auto"], "usage: mode "),
        (["estop"], "usage: estop on|off"),
        (["estop", "1"], "usage: estop on|off"),
        (["jog", "1"], "usage: jog AXIS DISTANCE [--wait]"),
        (["jog", "one", "5"], "usage: jog "),
        (["jog", "1.5", "5"], "usage: jog "),
        (["jog", "inf", "5"], "usage: jog "),
        (["error"], "usage: error NAME|0xCODE [MESSAGE]"),
        (["clear", "all"], "usage: clear"),
        (["status", "--wait"], "--wait does not apply to status"),
        (["workpiece", "wide"], "usage: workpiece WIDTH|none"),
        (["time", "noon"], "usage: time YYYY-MM-DD"),
        (["time", "2030-01-02T03:04:05+09:00"], "usage: time YYYY-MM-DD"),
        ([], "ACTION is missing"),
    ],
)
def test_invalid_command_lines(refused, control, words, message):
    assert refused("pendant", control, *words, code=2).startswith(message)


def test_a_port_requires_a_host(refused):
    assert "Example: tcp://127.0.0.1:5008" in refused("pendant", "5008", "status", code=2)


def test_actions_that_the_controller_refuses(refused, control):
    message = refused("pendant", control, "jog", "1", "5")
    assert "0x81501016 REFUSED_IN_AUTO_MODE: " in message
    assert "Try: " in message


@pytest.mark.parametrize(
    ("words", "form", "reason"),
    [
        (["token", "me"], "token any|tp|io|ethernet[:ADDRESS]", "unknown executable token 'me'"),
        (["error", "NO_SUCH_ERROR"], "error NAME|0xCODE [MESSAGE]", "NO_SUCH_ERROR"),
        (["workpiece", "31"], "workpiece WIDTH|none", "31"),
        (["jog", "7", "1"], "jog AXIS DISTANCE [--wait]", "7"),
    ],
)
def test_arguments_that_the_controller_refuses(words, form, reason, refused, control):
    message = refused("pendant", control, *words)
    before, _, detail = message.partition("0x80070057 E_INVALIDARG: ")
    assert before
    assert re.search(rf"\[[^]]*{reason}[^]]*\]\. Try: ", detail)  # the server's reason, requested after the error
    assert message.endswith(f"usage: {form}")


def test_a_port_that_is_not_a_control_port(refused, url):
    message = refused("pendant", url, "status")
    assert message == f"{url} is not a control port. Try: orinkit serve rc8 --control 127.0.0.1:5008"
    assert refused("pendant", "tcp://127.0.0.1:1", "status").startswith("cannot connect to tcp://127.0.0.1:1")


class _Parrot(orinkit.Provider):
    """A provider with the name of a control port whose commands all return ``answer``."""

    provider_names = (PROVIDER_NAME,)

    def __init__(self, answer: object) -> None:
        self.answer = answer

    def connect(self, *_: object) -> orinkit.cao.provider.ControllerObject:
        controller = orinkit.cao.provider.ControllerObject()
        controller.execute = lambda *_: self.answer
        return controller


@pytest.mark.parametrize("answer", [None, 5, "{", "[]", "[" * 100_000])
def test_an_invalid_status(refused, answer):
    with orinkit.serve(_Parrot(answer), "tcp://127.0.0.1:0") as server:
        assert refused("pendant", server.url, "status").startswith("unexpected reply to Status: ")


# --- serve rc8 --------------------------------------------------------------------------------------------------------

Serve = Callable[..., "tuple[subprocess.Popen[str], list[str]]"]


@pytest.fixture
def serve(program) -> Iterator[Serve]:
    """Start ``orinkit serve rc8``; returns the process and its first lines."""
    started: list[subprocess.Popen[str]] = []

    def serve(*options: str, lines: int = 1) -> tuple[subprocess.Popen[str], list[str]]:
        process = subprocess.Popen(
            [*program, "serve", "rc8", "--tcp", "127.0.0.1:0", *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        stream = process.stdout
        return process, [stream.readline().rstrip("\n") for _ in range(lines)]

    yield serve
    for process in started:
        process.kill()
        process.communicate()


def test_serve_with_a_control_port(serve, run, runtime):
    process, lines = serve("--tcp", "127.0.0.1:0", "--control", "0", lines=4)  # a port alone: 127.0.0.1
    assert [line.rpartition(":")[0] for line in lines[:3]] == ["ready tcp://127.0.0.1"] * 2 + [
        "ready control tcp://127.0.0.1"
    ]
    url, control = lines[0].removeprefix("ready "), lines[2].removeprefix("ready control ")
    assert lines[3].startswith("control secret ")
    (file,) = runtime.iterdir()
    assert file.name == f"control-{port_of(control)}"
    assert file.read_text() == f"{lines[3].removeprefix('control secret ')}\n"
    assert [stat.S_IMODE(path.stat().st_mode) for path in (runtime, file)] == [0o700, 0o600]
    assert run("pendant", control, "estop", "on").code == 0
    with orinkit.connect(url) as controller:
        assert controller.variable("@EMERGENCY_STOP").value is True
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    assert "Traceback" not in err
    assert list(runtime.iterdir()) == []


def test_a_file_for_the_secret(serve, run, refused, runtime, tmp_path):
    """The file is created if it does not exist, and removed at the end; an existing file is used and kept."""
    file = tmp_path / "secret"
    options = ("--control", "127.0.0.1:0", "--control-secret-file", str(file))
    process, lines = serve(*options, lines=3)
    control = lines[1].removeprefix("ready control ")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert file.read_text() == f"{lines[2].removeprefix('control secret ')}\n"
    assert not runtime.exists()
    assert run("pendant", control, "status", "--control-secret-file", str(file)).code == 0
    assert "and there is no stored secret for this port" in refused("pendant", control, "status")
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert not file.exists()

    file.write_text("0123456789abcdef-own\n")
    file.chmod(0o600)
    process, lines = serve(*options, lines=2)
    assert (
        run("pendant", lines[1].removeprefix("ready control "), "status", "--control-secret-file", str(file)).code == 0
    )
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=60)
    assert out == ""
    assert file.read_text() == "0123456789abcdef-own\n"


def test_files_that_cannot_be_used(refused, tmp_path, control):
    file = tmp_path / "secret"
    message = refused("pendant", control, "status", "--control-secret-file", str(file), code=2)
    assert message.startswith(f"--control-secret-file {file}: ")
    file.write_text("too short")
    file.chmod(0o600)
    message = refused("pendant", control, "status", "--control-secret-file", str(file), code=2)
    assert message.startswith(f"--control-secret-file {file}: a secret must have 16 to 256")
    file.write_text("0123456789abcdef")
    assert "refuses the secret. Try: " in refused("pendant", control, "status", "--control-secret-file", str(file))
    file.chmod(0o644)
    for command in (("pendant", control, "status"), ("serve", "rc8", "--control", "127.0.0.1:0")):
        message = refused(*command, "--control-secret-file", str(file), code=2)
        expected = f"--control-secret-file {file}: other accounts can access the file (mode 644). Try: chmod 600 {file}"
        assert message == expected
    if os.getuid() == 0:
        file.chmod(0o600)
        os.chown(file, 65534, 65534)
        message = refused("pendant", control, "status", "--control-secret-file", str(file), code=2)
        assert message.startswith(f"--control-secret-file {file}: the file belongs to another account")
    message = refused("serve", "rc8", "--control-secret-file", str(file), code=2)
    assert message == "--control-secret-file requires --control HOST:PORT"


def test_no_secret_is_stored_in_an_unsafe_directory(refused, runtime, tmp_path, monkeypatch):
    """The directory is a link, is accessible to others, or belongs to another user."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    runtime.symlink_to(elsewhere)
    message = refused("serve", "rc8", "--tcp", "127.0.0.1:0", "--control", "127.0.0.1:0")
    assert message.startswith(f"cannot store the secret of the control port in {runtime}: ")
    runtime.unlink()
    runtime.mkdir(mode=0o755)
    runtime.chmod(0o755)
    (runtime / "control-5008").write_text("0123456789abcdef")
    (runtime / "control-5008").chmod(0o600)
    assert find_secret(Address("tcp", "127.0.0.1", 5008)) == ""
    with (
        pytest.raises(CommandError, match="must be a directory that only this account can access"),
        stored_secret("0" * 16, 5008),
    ):
        pass
    if os.getuid() == 0:
        runtime.chmod(0o700)
        os.chown(runtime, 65534, 65534)
        with (
            pytest.raises(CommandError, match="must be a directory that only this account can access"),
            stored_secret("0" * 16, 5008),
        ):
            pass


@pytest.mark.parametrize("given", [None, "", "relative", "/nowhere"])
def test_without_a_runtime_directory(given, tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    if given is not None:
        monkeypatch.setenv("XDG_RUNTIME_DIR", given)
    directory = tmp_path / f"orinkit-{os.getuid()}"
    with stored_secret("0" * 16, 5008):
        assert stat.S_IMODE(directory.stat().st_mode) == 0o700
        assert find_secret(Address("tcp", "127.0.0.1", 5008)) == "0" * 16
        assert find_secret(Address("tcp", "127.0.0.1", 5009)) == ""
    assert find_secret(Address("tcp", "127.0.0.1", 5008)) == ""


def test_the_secret_of_a_killed_server_is_replaced(runtime):
    with stored_secret("0" * 16, 5008), stored_secret("1" * 16, 5008):
        assert find_secret(Address("tcp", "localhost", 5008)) == "1" * 16
    assert list(runtime.iterdir()) == []
    with stored_secret("0" * 16, 5008):
        (runtime / "control-5008").write_text("1" * 16)
    assert (runtime / "control-5008").read_text() == "1" * 16  # belongs to a server that was started later


def test_the_secrets_of_killed_servers_are_removed(serve, run, runtime):
    killed, lines = serve("--control", "127.0.0.1:0", lines=3)
    (left,) = runtime.iterdir()
    running, lines = serve("--control", "127.0.0.1:0", lines=3)
    control = lines[1].removeprefix("ready control ")
    assert len(list(runtime.iterdir())) == 2  # the first server still runs
    killed.kill()
    killed.communicate()
    begun, beginning = (runtime / f".control-{port}-{'0' * 16}" for port in (1, 2))
    for file in (begun, beginning):
        file.touch(mode=0o600)
    os.utime(begun, (0, 0))
    others = [runtime / name for name in ("control-1.bak", "control-x", "control-2")]
    others[0].touch()
    others[1].touch()
    others[2].symlink_to(others[0])
    with stored_secret("0" * 16, 5008):
        names = {file.name for file in runtime.iterdir()}
        assert names == {
            f"control-{port_of(control)}", "control-5008", beginning.name, *(each.name for each in others)
        }  # fmt: skip
        assert left.name not in names
        assert run("pendant", control, "estop", "on").code == 0
    assert running.poll() is None


def test_the_secret_is_not_sent_to_other_machines(run, control, runtime, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "orinkit.cli.commands.pendant._press", lambda url, connection, *_: seen.append(connection.option) or {}
    )
    for host in ("127.0.0.1", "localhost", "192.0.2.1", "robot.example"):
        run("pendant", f"tcp://{host}:{port_of(control)}", "status")
    assert [option is not None for option in seen] == [True, True, False, False]


def test_serve_without_a_control_port(serve):
    process, lines = serve()
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=60)
    assert (process.returncode, out, len(lines)) == (0, "", 1)


def test_options_of_the_robot(serve):
    options = (
        "--model",
        "cobotta",
        "--mode",
        "teach",
        "--token",
        "ethernet",
        "--motor-on",
        "--no-samples",
        "--time-scale",
        "20",
    )
    _, (line,) = serve(*options, "--joints", "J(10, 20, 100, 0, 50, 0)")
    with orinkit.connect(line.removeprefix("ready ")) as controller:
        assert controller.variable("@MODE").value == 2
        assert controller.task_names() == []
        assert controller.execute("SysState") >> 2 & 1
        with controller.robot() as robot:
            assert robot.execute("CurJnt")[:6] == pytest.approx([10, 20, 100, 0, 50, 0])
            assert "CVR038" in robot.execute("GetRobotTypeName")


@pytest.mark.parametrize(
    "joints", ["-10,20,60,0,50,0", "-10 20 60 0 50 0", "j(-10, 20, 60, 0, 50, 0)", "-10, 20, 60, 0, 50, 0"]
)
def test_joints_as_numbers(joints, serve):
    _, (line,) = serve("--joints", joints)
    with orinkit.connect(line.removeprefix("ready ")) as controller, controller.robot() as robot:
        assert robot.execute("CurJnt")[:6] == pytest.approx([-10, 20, 60, 0, 50, 0])


@pytest.mark.parametrize("address", ["0.0.0.0:5008", "192.0.2.1:5008", "[::]:5008", "robot:5008", "tcp://10.0.0.1:0"])
def test_a_control_port_that_others_could_reach(address, refused):
    message = refused("serve", "rc8", "--tcp", "127.0.0.1:0", "--control", address, code=2)
    assert message.startswith(f"--control {address}: only loopback addresses are allowed")


def test_a_control_port_that_is_taken(refused):
    with orinkit.serve(orinkit.Provider(), "tcp://127.0.0.1:0") as server:
        message = refused("serve", "rc8", "--tcp", "127.0.0.1:0", "--control", server.url)
    assert message.startswith(f"cannot listen on {server.url}: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--control", "127.0.0.1:99999"], "is not 0 to 65535"),
        (["--mode", "asleep"], "'asleep' is not a mode. Try: manual, teach or auto"),
        (["--token", "me"], "unknown executable token 'me'"),
        (["--model", "VS-999"], "VS-999: no such robot model or file"),
        (["--joints", "J(0, 0"], "--joints J(0, 0: "),
        (["--joints", "P(1, 2, 3, 4, 5, 6)"], "--joints P(1, 2, 3, 4, 5, 6): "),
        (["--joints", "J5"], "--joints J5: "),
        (["--joints", "@E J(0, 30, 90, 0, 60, 0)"], "not of the form"),
        (["--joints", "0 30 ninety"], "not of the form"),
        (["--joints", "0 nan 90"], "not of the form"),
        (["--joints", ""], "not of the form"),
        (["--joints", "0,0,0,0,0,0,0"], "is not valid for VS-050"),
        (["--joints", "1,2"], "joint position 1, 2 is not valid for VS-050. Try: 6 joints within their limits"),
        (["--joints", "J(1, 2)"], "joint position 1, 2 is not valid for VS-050. Try: 6 joints within their limits"),
        (["--joints", "1e300,0,0,0,0,0"], "is not valid for VS-050"),
        (["--time-scale", "0"], "the time scale must be positive"),
        (["--time-scale", "nan"], "the time scale must be positive"),
        (["--time-scale", "fast"], "'fast' is not a valid value for --time-scale"),
    ],
)
def test_invalid_options(options, message, refused):
    assert message in refused("serve", "rc8", "--tcp", "127.0.0.1:0", *options, code=2)
