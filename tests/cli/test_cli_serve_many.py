"""serve rc8 --count: several controllers in one process."""

from __future__ import annotations

import signal
import socket
import subprocess
from collections.abc import Callable, Iterator

import pytest

import orinkit
from orinkit.cli._shared.control_secret import find_secret
from orinkit.transport.address import parse_address

Start = Callable[..., "tuple[subprocess.Popen[str], list[str]]"]


@pytest.fixture
def start(program) -> Iterator[Start]:
    """Start ``orinkit serve rc8`` and read a number of lines of its output."""
    started: list[subprocess.Popen[str]] = []

    def begin(lines: int, *options: str) -> tuple[subprocess.Popen[str], list[str]]:
        process = subprocess.Popen(
            [*program, "serve", "rc8", "--no-providers", *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        return process, [process.stdout.readline().rstrip("\n") for _ in range(lines)]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def free_ports(count: int) -> int:
    """Return the first of some consecutive ports that are free now."""
    for port in range(20_000, 30_000, count):
        with socket.create_server(("127.0.0.1", port)) as first:
            taken = [first]
            try:
                taken += [socket.create_server(("127.0.0.1", port + number)) for number in range(1, count)]
            except OSError:
                continue
            finally:
                for each in taken:
                    each.close()
            return port
    raise AssertionError("no free ports")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_two_controllers_with_state_and_pendants(start, run, tmp_path, number):
    if signal.getsignal(number) is signal.SIG_IGN:  # the tests run under nohup
        pytest.skip("this signal is ignored here")
    port = free_ports(4)
    state = tmp_path / "state"
    process, lines = start(
        5, "--count", "2", "--tcp", str(port), "--control", f"127.0.0.1:{port + 2}", "--state", str(state)
    )
    urls = [f"tcp://127.0.0.1:{port + index}" for index in range(4)]
    assert lines[:4] == [f"ready {urls[0]}", f"ready {urls[1]}", f"ready control {urls[2]}", f"ready control {urls[3]}"]
    assert lines[4].startswith("control secret ")
    first, second = (orinkit.connect(url) for url in urls[:2])
    with first, second:
        first.variable("I1").value, second.variable("I1").value = 1, 2
        assert (first.variable("I1").value, second.variable("I1").value) == (1, 2)
        assert run("pendant", urls[3], "mode", "manual").code == 0
        assert (first.variable("@MODE").value, second.variable("@MODE").value) == (3, 1)
        process.send_signal(number)  # connected clients do not prevent the end
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    assert "Traceback" not in err
    assert not find_secret(parse_address(urls[2]))
    assert not find_secret(parse_address(urls[3]))
    assert sorted(path.name for path in state.iterdir()) == ["1", "2"]
    _, lines = start(1, "--tcp", "127.0.0.1:0", "--state", str(state / "2"))
    with orinkit.connect(lines[0].removeprefix("ready ")) as again:
        assert again.variable("I1").value == 2


def test_twenty_controllers_move_independently(start):
    process, lines = start(20, "--count", "20", "--tcp", "127.0.0.1:0", "--motor-on", "--time-scale", "20")
    arms = [orinkit.connect(line.removeprefix("ready ")) for line in lines]
    try:
        robots = [arm.robot("Arm") for arm in arms]
        for index, robot in enumerate(robots):
            robot.execute("TakeArm", [0, 0])
            robot.move(f"J({index}, 20, 80, 0, 60, 0)", wait=False)
        for index, robot in enumerate(robots):
            robot.move(f"J({index}, 25, 80, 0, 60, 0)")  # after the first motion
            assert robot.execute("CurJnt")[:2] == pytest.approx([index, 25], abs=0.1)  # the servo follows
    finally:
        for arm in arms:
            arm.close()
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--count", "0"), "--count must be at least 1, not 0"),
        (("--count", "2", "--tcp", "65535"), "2 consecutive ports would exceed port 65535"),
        (("--count", "2", "--pty"), "consecutive ports require an address with a port"),
    ],
)
def test_invalid_command_lines(refused, options, message):
    assert message in refused("serve", "rc8", *options, code=2)


def test_a_secret_file_for_all_controllers(start, run, tmp_path):
    file = tmp_path / "cell.secret"
    process, lines = start(
        5, "--count", "2", "--tcp", "127.0.0.1:0", "--control", "127.0.0.1:0", "--control-secret-file", str(file)
    )
    assert lines[4] == f"control secret {file.read_text().strip()}"
    for line in lines[2:4]:
        url = line.removeprefix("ready control ")
        assert run("pendant", url, "estop", "on", "--control-secret-file", str(file)).code == 0
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert not file.exists()
