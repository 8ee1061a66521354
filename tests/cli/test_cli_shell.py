"""shell: a session on one connection, as a script and on a terminal."""

from __future__ import annotations

import io
import os
import pty
import signal
import stat
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.raw.packets import assemble
from orinkit.virtual.ve026a import VirtualVE026A
from support.peers import BadPeer, Line, reply
from support.waiting import PATIENCE, until

# --- scripts ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def script(run, monkeypatch):
    """Run a script of the session in this process."""

    def script(url: str, *lines: str, options: tuple[str, ...] = ()):
        monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))
        return run("shell", url, *options)

    return script


def test_the_commands_share_one_connection(script, recorder, recorder_url):
    recorder.calls.clear()
    done = script(
        recorder_url,
        "# a comment", "", "put I1 5", "get I1", "execute Do 1 2", "execute TakeArm 0 --robot Arm", "call Robot_Halt x --robot Arm",
        options=("--provider", "Test.Recorder"),
    )  # fmt: skip
    assert (done.code, done.err) == (0, "")
    calls = [(call.function, call.arguments) for call in recorder.calls]
    assert [name for name, _ in calls].count("Controller_Connect") <= 1
    assert ("Variable_PutValue", (5,)) in calls
    assert ("Controller_Execute", ("Do", [1.0, 2.0])) in calls
    assert ("Robot_Execute", ("TakeArm", 0)) in calls
    assert ("Robot_Halt", ("x",)) in calls
    names = [name for name, _ in calls]
    assert (names.count("Controller_GetRobot"), names.count("Robot_Release")) == (1, 1)  # the session keeps its robots


def test_values(script, url, rc8):
    done = script(url, "put I7 42", "get I7 --json", "put S1 'two words'", "get S1", "execute SysInfo 0")
    assert done.code == 0
    assert '"value": 42' in done.out
    assert done.out.endswith("two words\nSN-42\n")
    with orinkit.connect(url) as controller:
        assert (controller.variable("I7").value, controller.variable("S1").value) == (42, "two words")


def test_the_arm_stays_taken_between_commands(script, url):
    done = script(
        url, "execute TakeArm 0 0 --robot Arm0", "execute Motor 1 --robot Arm0", "execute GiveArm --robot Arm0"
    )
    assert (done.code, done.err) == (0, "")


def test_the_first_error_ends_a_script(script, url):
    done = script(url, "put I1 3", "get I9999", "put I1 4")
    assert done.code == 1
    assert "VARIABLE_INDEX_INVALID" in done.err
    assert "Try:" in done.err
    with orinkit.connect(url) as controller:
        assert controller.variable("I1").value == 3


@pytest.mark.parametrize(
    ("line", "message", "code"),
    [
        ("frob", "unknown command frob", 2),
        ("get", "is missing", 2),
        ("get 'I0", "invalid quotes", 2),
        ("call Frob", "Frob", 2),
        ("trace maybe", "Try: trace on, trace off", 2),
        ("raw xx", "not hex", 2),
        ("call Service_Start", "the session calls this function itself", 2),
        ("execute Frobnicate", "E_INVALID_CMD_NAME", 1),
    ],
)
def test_errors_and_keep_going(script, url, line, message, code):
    done = script(url, line, "put I1 4", options=("--keep-going",))
    assert (done.code, done.out) == (code, "I1 = 4\n")
    assert message in done.err
    assert done.err.count("\n") == 1


def test_quit_and_help(script, url):
    done = script(url, "help", "help get", "functions robot_move", "quit", "get I9999")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("Usage: COMMAND\n")
    assert "Usage: get [OPTIONS] NAME" in done.out
    assert "Robot_Move(handle" in done.out


def test_trace(script, url):
    done = script(url, "get I1", "trace on", "get I2", "trace off", "get I3")
    assert [f'"I{number}"' in done.err for number in (1, 2, 3)] == [False, True, False]


def test_raw_packets_use_the_connection_of_the_session(script, url):
    name = assemble("Controller_GetName", ["2"], 500)  # the handle of the session's controller
    done = script(url, f"raw {name.hex()}", "get I1", f"raw --hex {name.hex()}")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith('← S_OK -> "Controller1"\n')
    assert packet.decode(bytes.fromhex(done.out.splitlines()[-1])).serial == 500


def test_no_reply_to_a_raw_packet(script):
    def controller(line: Line) -> None:
        while True:
            request = line.request()
            if request.serial != 500:
                line.send(reply(request, *([2] if request.code == 3 else [])))

    with BadPeer(controller) as peer:
        lines = (f"raw {assemble('Service_Start', [], 500).hex()}", "call Controller_GetName")
        done = script(peer.url, *lines, options=("--timeout", "1", "--keep-going", "--dialect", "rc8"))
    assert done.code == 1
    assert "packet 1: no reply within 1 s" in done.err


def test_a_lost_connection_can_be_opened_again(script):
    seen = []

    def controller(line: Line) -> None:
        while True:
            request = line.request()
            seen.append(request.code)
            if request.code == 21 and seen.count(3) == 1:  # Controller_GetName, on the first connection
                line.shut()
                return
            line.send(reply(request, *([2] if request.code == 3 else ["name"] if request.code == 21 else [])))

    with BadPeer(controller) as peer:
        url, name = peer.url, "call Controller_GetName"
        done = script(peer.url, name, name, "reconnect", name, options=("--keep-going", "--timeout", "30"))
    lost, missing = done.err.splitlines()
    assert "closed the connection" in lost
    assert missing == f"orinkit: there is no connection to {url}. Try: reconnect"
    assert (done.code, done.out) == (1, "name\n")
    assert seen.count(21) == 2


def test_a_serial_line(script):
    arm = VirtualVE026A(motor_seconds=0.05)
    with orinkit.serve(arm, "pty://") as server:
        lines = ("get @VERSION", "execute Motor 1 --robot VE", "get @CURRENT_ANGLE --robot VE")
        done = script(server.url, *lines, options=("--timeout", "10"))
    arm.close()
    assert (done.code, done.err) == (0, "")
    assert done.out.endswith("\n0 30 120 0 30 0 0 0\n")


def test_no_controller(refused):
    with BadPeer(Line.wait_for_end) as peer:
        url = peer.url
    assert "cannot connect" in refused("shell", url)


# --- terminals --------------------------------------------------------------------------------------------------------


class Terminal:
    """A session on a pseudo-terminal."""

    def __init__(self, command: list[str], state: Path) -> None:
        self._ours, theirs = pty.openpty()
        environment = {**os.environ, "XDG_STATE_HOME": str(state), "ORINKIT_LANG": "en", "TERM": "dumb"}
        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )  # fmt: skip
        os.close(theirs)
        os.set_blocking(self._ours, False)
        self.seen = ""

    def type(self, text: str) -> None:
        os.write(self._ours, text.encode())

    def interrupt(self) -> None:
        """Send what Ctrl-C sends to the program in the foreground."""
        self.process.send_signal(signal.SIGINT)

    def expect(self, text: str) -> str:
        """Wait until the terminal shows a text, and return everything up to it."""
        end = time.monotonic() + PATIENCE
        while text not in self.seen:
            assert time.monotonic() < end, f"{text!r} is not in {self.seen!r}"
            try:
                self.seen += os.read(self._ours, 65536).decode(errors="replace")
            except BlockingIOError:
                time.sleep(0.005)
            except OSError:  # the program has ended
                assert text in self.seen, self.seen
        before, _, self.seen = self.seen.partition(text)
        return before

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._ours)


@pytest.fixture
def terminal(program, url, tmp_path) -> Iterator[Terminal]:
    opened = Terminal([*program, "shell", url], tmp_path)
    opened.expect("orinkit> ")
    yield opened
    opened.close()


def test_an_error_does_not_end_the_session(terminal, url):
    terminal.type("get I9999\n")
    terminal.expect("VARIABLE_INDEX_INVALID")
    terminal.expect("orinkit> ")
    terminal.type("put I3 8\n")
    terminal.expect("I3 = 8")
    terminal.expect("orinkit> ")
    terminal.type("\x04")
    assert terminal.process.wait(PATIENCE) == 0
    with orinkit.connect(url) as controller:
        assert controller.variable("I3").value == 8


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("rec\t", "reconnect "),
        ("get @EMERGENCY_S\t", "@EMERGENCY_STOP "),
        ("call Controller_GetRobotN\t", "Controller_GetRobotNames "),
        ("get I1 --rob\t", "--robot "),
        ("get I1 --robot Ar\t", "Arm0 "),
        ("get I1 --task Pro\t\t", "Pro1"),
        ("execute SysI\t", "SysInfo "),
        ("trace of\t", "off "),
    ],
)
def test_completion(terminal, typed, completed):
    terminal.type(typed)
    terminal.expect(completed)


def test_the_history_is_kept_in_a_private_file(terminal, program, url, tmp_path):
    terminal.type("put I4 77\n")
    terminal.expect("I4 = 77")
    terminal.expect("orinkit> ")
    terminal.type("quit\n")
    assert terminal.process.wait(PATIENCE) == 0
    file = tmp_path / "orinkit" / "shell_history"
    assert file.read_text().splitlines()[-2:] == ["put I4 77", "quit"]
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    again = Terminal([*program, "shell", url], tmp_path)
    try:
        again.expect("orinkit> ")
        again.type("\x10\x10")  # Ctrl-P: the previous line, twice
        again.expect("put I4 77")
    finally:
        again.close()


@pytest.mark.parametrize(
    "line", ["move 'J(150,45,90,0,45,0)' --speed 1", "call Robot_Move 1 '@0 J(150,45,90,0,45,0)' Speed=1 --robot Arm0"]
)
def test_ctrl_c_halts_the_motion_and_the_session_goes_on(terminal, url, line):
    with orinkit.connect(url) as observer, observer.robot() as robot:
        if line.startswith("call"):
            for each in ("TakeArm 0 0", "Motor 1"):
                terminal.type(f"execute {each} --robot Arm0\n")
                terminal.expect("VT_EMPTY")
        before = robot.joints[0]
        terminal.type(f"{line}\n")
        until(lambda: robot.joints[0] > before + 0.05)
        terminal.interrupt()
        terminal.expect("interrupted")
        terminal.expect("orinkit> ")
        until(lambda: robot.motion_complete(1))
        assert robot.joints[0] < 149
        terminal.type("put I5 6\n")
        terminal.expect("I5 = 6")
        assert observer.variable("I5").value == 6


def test_ctrl_c_at_the_prompt_halts_a_motion_of_the_session(terminal, url):
    with orinkit.connect(url) as observer, observer.robot() as robot:
        for each in ("TakeArm 0 0", "Motor 1"):
            terminal.type(f"execute {each} --robot Arm0\n")
            terminal.expect("VT_EMPTY")
        before = robot.joints[0]
        terminal.type("call Robot_Move 1 '@0 J(150,45,90,0,45,0)' Speed=1,NEXT --robot Arm0\n")
        terminal.expect("S_OK")
        terminal.expect("orinkit> ")
        until(lambda: robot.joints[0] > before + 0.05)
        terminal.interrupt()
        terminal.expect("robot Arm0 halted")
        until(lambda: robot.motion_complete(1))
        assert robot.joints[0] < 149
