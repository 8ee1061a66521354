"""abh3 drive: the motors of a virtual ABH3 turn, and are stopped in every case."""

from __future__ import annotations

import fcntl
import json
import math
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from orinkit.can.frame import CanFrame
from orinkit.can.server import CanServer, serve_can
from orinkit.cli._shared import interrupts
from orinkit.cli.abh3 import drive
from orinkit.core import i18n
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support import multicast
from support.stopping import stopped
from support.waiting import PATIENCE, until

pytestmark = pytest.mark.slow

URL = multicast.bus()
DRIVE = ("abh3", "drive", URL)
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SILENCE = {"command_timeout": 10_000, "error_timeout": 10_000}  # ms: a stalled machine must not count as a silent host
BY_ITSELF = {"command_timeout": 500, "error_timeout": 1000}
"""Usual values, ms: the driver stops by itself."""


class Counting(VirtualABH3):
    """A driver that counts the commands it receives."""

    commands = 0

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        self.commands += frame.id == 0x00EF0102
        return super().receive(frame)


class Bench:
    """A virtual driver on the bus."""

    def __init__(self, **parameters: Any) -> None:
        self.abh3 = Counting(Parameters(**{**SILENCE, **parameters}))
        self.server: CanServer = serve_can(self.abh3, at=URL)

    @property
    def at_rest(self) -> bool:
        """True if both motors are at standstill and no input is set."""
        state = self.abh3.state()
        return not (state.moving or state.ay_servo or state.bx_servo or state.inputs)


@pytest.fixture
def serve() -> Iterator[Callable[..., Bench]]:
    """Serve a virtual driver with parameters."""
    served: list[Bench] = []

    def serve(**parameters: Any) -> Bench:
        served.append(Bench(**parameters))
        return served[-1]

    yield serve
    for bench in served:
        bench.server.close()


@pytest.fixture
def bench(serve) -> Bench:
    return serve()


class Steady:
    """A clock that advances only by its own :meth:`sleep`: a stall of the machine takes no time."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)
        self.now += seconds


@pytest.fixture
def steady(monkeypatch) -> None:
    """Run the command on a clock without stalls; the driver uses real time."""
    clock = Steady()
    for module in (drive, interrupts):
        monkeypatch.setattr(module, "monotonic", clock.monotonic)
        monkeypatch.setattr(module, "sleep", clock.sleep)


@pytest.fixture(autouse=True)
def _not_held_up(monkeypatch) -> None:
    """Prevent a stalled machine from ending a command in this process."""
    monkeypatch.setattr(drive, "_MAX_COMMAND_DELAY", PATIENCE)


def turning(bench: Bench, least: float = 50) -> Callable[[], bool]:
    return lambda: abs(bench.abh3.state().a_velocity) > least


def lines(out: str) -> list[Any]:
    return [json.loads(line) for line in out.splitlines()]


# --- motion -----------------------------------------------------------------------------------------------------------


def test_it_turns_and_comes_to_rest(run, serve, steady):
    bench = serve(error_timeout=1000)
    until(lambda: bench.abh3.state().errors)  # it was without commands for 1 s; drive resets that error
    done = run(*DRIVE, "--ay", "100", "--bx", "-50", "--seconds", "0.6")
    assert (done.code, done.err) == (0, "")
    first, *_, before_last, last = done.out.splitlines()
    assert first.startswith("0.00 s  A 0.0  B 0.0  Y 0.0  X 0.0 min^-1  pulses A ")
    assert before_last.startswith("0.50 s  A 100.0  B -50.0  Y 25.0  X 75.0 min^-1")
    assert "  A 0.0  B 0.0  Y 0.0  X 0.0 min^-1" in last
    assert "  current A/Y 0.00  B/X 0.00 %  load A 0  B 0 %" in last
    assert bench.at_rest
    assert bench.abh3.state().a_pulses > 0 > bench.abh3.state().b_pulses


def test_json(run, bench, steady):
    done = run(*DRIVE, "--ay", "100", "--seconds", "0.5", "--period", "0.05", "--json")
    assert (done.code, done.err) == (0, "")
    output = lines(done.out)
    assert [line["time"] for line in output] == sorted(line["time"] for line in output)
    assert max(line["values"]["a_velocity"] for line in output) == 100
    assert output[-1]["values"]["a_velocity"] == 0
    assert output[-1]["values"]["a_pulses"] > output[0]["values"]["a_pulses"]
    assert output[0]["units"]["a_velocity"] == "min^-1"
    assert output[0]["units"]["a_load"] == "%"
    assert (output[0]["errors"], output[0]["warnings"]) == ([], [])
    assert bench.at_rest


def test_the_second_dialect_and_other_numbers(run, serve, steady):
    bench = serve(dialect="v2", address=7, host=9, group=3)
    numbers = ("--address", "7", "--host", "9", "--group", "3", "--dialect", "v2")
    done = run(*DRIVE, *numbers, "--bx", "80", "--seconds", "0.5", "--json")
    assert (done.code, done.err) == (0, "")
    assert max(line["values"]["bx_velocity"] for line in lines(done.out)) == 80
    assert bench.at_rest


def test_torque(run, bench, when, steady):
    states = [bench.abh3.state()]

    def turns() -> bool:
        states.append(bench.abh3.state())
        return abs(states[-1].a_velocity) > 1

    when(turns, lambda: None)
    done = run(*DRIVE, "--ay", "10", "--torque", "--seconds", "0.5", "--json")
    assert done.code == 0
    assert max(line["values"]["ay_current_command"] for line in lines(done.out)) == 10
    until(lambda: abs(states[-1].a_velocity) > 1)
    assert "ay_torque" in states[-1].inputs
    assert bench.at_rest


@pytest.mark.parametrize(
    ("model", "a", "b"), [("motor", "a_velocity", "b_velocity"), ("travel", "y_velocity", "x_velocity")]
)
def test_a_vehicle(run, serve, steady, model, a, b):
    bench = serve(model=model)
    measures = ("--wheel-diameter", "0.1", "--track", "0.5", "--gear", "0.1")
    done = run(*DRIVE, "--velocity", "0.05", "--turn", "0.1", *measures, "--seconds", "0.6", "--json")
    assert (done.code, done.err) == (0, "")
    values = lines(done.out)[-2]["values"]
    y = 0.05 * 60 / (0.01 * math.pi)
    x = -0.1 * 0.25 * 60 / (0.01 * math.pi)
    assert (values["y_velocity"], values["x_velocity"]) == pytest.approx((y, x), abs=0.3)
    wanted = (y, x) if model == "travel" else (y + x, y - x)
    assert (values[a], values[b]) == pytest.approx(wanted, abs=0.3)
    assert bench.at_rest


def test_the_servo_stays_on(run, bench):
    assert run(*DRIVE, "--ay", "60", "--seconds", "0.3", "--keep-servo").code == 0
    state = bench.abh3.state()
    assert list(state.inputs) == ["ay_servo_on", "bx_servo_on"]
    assert not state.moving


# --- end of the motion ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_it(run, bench, when, number):
    if signal.getsignal(number) is signal.SIG_IGN:  # the tests run under nohup
        pytest.skip("this signal is ignored here")
    handlers = [signal.getsignal(each) for each in SIGNALS]
    when(turning(bench), lambda: os.kill(os.getpid(), number))
    done = run(*DRIVE, "--ay", "100", "--seconds", "60")
    assert (done.code, done.err) == (130, "orinkit: interrupted\n")
    assert [signal.getsignal(each) for each in SIGNALS] == handlers
    assert bench.at_rest


def test_many_signals_do_not_prevent_the_stop(run, serve):
    bench = serve(deceleration_time=10.0)

    def insist() -> None:
        until(turning(bench, 250))
        while turning(bench, 50)():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)

    thread = threading.Thread(target=insist)
    before = signal.signal(signal.SIGINT, lambda *_: None)  # the last signal may arrive after the command
    thread.start()
    try:
        assert run(*DRIVE, "--ay", "300", "--seconds", "60").code == 130
    finally:
        thread.join()
        signal.signal(signal.SIGINT, before)
    until(lambda: bench.at_rest)


def test_an_error_of_the_driver_is_reported(run, bench, when):
    when(turning(bench), lambda: bench.abh3.inject("a_overcurrent"))
    done = run(*DRIVE, "--ay", "100", "--seconds", "60")
    assert done.code == 1
    assert done.err.splitlines()[-1].startswith("orinkit: the driver has stopped with errors: ")
    assert "overcurrent" in done.err
    assert bench.at_rest


def test_persistent_errors(refused, bench):
    bench.abh3.inject("a_overcurrent", stays=True)
    assert "overcurrent" in refused(*DRIVE, "--ay", "100", "--seconds", "1")
    assert bench.at_rest


def test_errors_that_are_not_reset(refused, bench):
    bench.abh3.inject("a_overcurrent")
    line = refused(*DRIVE, "--ay", "100", "--seconds", "1", "--no-reset")
    assert "overcurrent" in line
    assert "--no-reset" in line
    assert bench.at_rest


def test_no_driver_on_the_bus(refused):
    assert "no reply from ABH3 1 within" in refused(*DRIVE, "--ay", "100", "--seconds", "1")


def test_the_driver_disappears(run, bench, when):
    when(turning(bench), bench.server.close)
    done = run(*DRIVE, "--ay", "100", "--seconds", "60")
    assert done.code == 1
    assert "standstill of the motors was not confirmed within 5 s" in done.err
    assert "the servo may still be on" in done.err
    assert "no reply from ABH3 1 within" in done.err.splitlines()[-1]


def test_a_long_deceleration(run, serve):
    bench = serve(deceleration_time=100.0)
    done = run(*DRIVE, "--ay", "300", "--seconds", "0.5")
    assert done.code == 1
    assert done.err.startswith("orinkit: standstill of the motors was not confirmed within 5 s: ")
    assert not bench.abh3.state().ay_servo


# --- as a program -----------------------------------------------------------------------------------------------------


PATIENT = f"""
import sys
from orinkit.__main__ import main
from orinkit.cli.abh3 import drive as _abh3_drive
_abh3_drive._MAX_COMMAND_DELAY = {PATIENCE}
sys.exit(main())
"""


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start the command in a separate process, by default with a long limit for stalls of the machine."""
    started: list[subprocess.Popen[str]] = []

    def start(
        *options: str, stdout: int = subprocess.PIPE, program: tuple[str, ...] = (sys.executable, "-c", PATIENT)
    ) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*program, *DRIVE, *options],
            stdout=stdout, stderr=subprocess.PIPE, text=True, encoding="utf-8", env={**os.environ, "ORINKIT_LANG": "en"},
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_a_reader_that_closes_the_pipe(start, bench):
    process = start("--ay", "100", "--seconds", "60")
    until(turning(bench))
    process.stdout.close()
    assert process.wait(30) == 1
    assert process.stderr.read() == ""
    assert bench.at_rest


@pytest.fixture
def unread() -> Iterator[tuple[int, int]]:
    """The read and write ends of a pipe with a small buffer that is not read."""
    ours, theirs = os.pipe()
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        fcntl.fcntl(theirs, fcntl.F_SETPIPE_SZ, 4096)
    yield ours, theirs
    os.close(ours)
    os.close(theirs)


def fill(theirs: int) -> Callable[[], bool]:
    return lambda: not select.select([], [theirs], [], 0)[1]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_reader_that_does_not_read(start, bench, unread, number):
    process = start("--ay", "100", "--seconds", "60", "--period", "0.02", "--json", stdout=unread[1])
    until(turning(bench))
    until(fill(unread[1]))
    commands = bench.abh3.commands
    until(lambda: bench.abh3.commands > commands + 75)  # the command continues
    assert bench.abh3.state().moving
    process.send_signal(number)
    until(lambda: bench.at_rest)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    first, last = err.splitlines()
    assert re.fullmatch(r"orinkit: \d+ lines of stdout were not read and are lost", first)
    assert last == "orinkit: interrupted"


def test_the_command_ends_if_its_output_is_not_read(start, bench, unread):
    process = start("--ay", "100", "--seconds", "1.5", "--period", "0.02", "--json", stdout=unread[1])
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "were not read and are lost" in err
    assert bench.at_rest


def test_a_late_reader_gets_all_lines(start, bench, unread):
    ours, theirs = unread
    process = start("--ay", "100", "--seconds", "1", "--period", "0.02", "--json", stdout=theirs)
    until(lambda: bench.abh3.state().moving)
    until(fill(theirs))
    written = b""
    while process.poll() is None or select.select([ours], [], [], 0)[0]:
        if select.select([ours], [], [], 0.1)[0]:
            written += os.read(ours, 512)  # slowly
    assert process.returncode == 0
    assert process.stderr.read() == ""
    times = [line["time"] for line in lines(written.decode())]
    assert times == sorted(times)
    assert times[-1] > 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="requires Linux")  # noqa: PTH110 - a device, not a file
def test_a_full_disk(start, bench):
    with open("/dev/full", "w") as full:  # noqa: PTH123 - a device, not a file
        process = start("--ay", "100", "--seconds", "60", stdout=full.fileno())
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (1, "orinkit: reading or writing failed: No space left on device\n")
    assert bench.at_rest


def test_a_program_that_was_suspended_does_not_continue(start, serve, program):
    bench = serve(**BY_ITSELF)
    process = start("--ay", "100", "--seconds", "60", program=program)
    until(turning(bench))
    with stopped(process.pid):
        until(lambda: not bench.abh3.state().moving)  # the driver stops by itself
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "orinkit does not restart it" in err
    assert bench.at_rest


def test_a_killed_program(start, serve):
    bench = serve(**BY_ITSELF)
    process = start("--ay", "100", "--seconds", "60")
    until(turning(bench))
    process.kill()
    until(lambda: not bench.abh3.state().moving)


def test_a_terminal_sees_one_live_line(start, bench):
    ours, theirs = pty.openpty()
    try:
        process = start("--ay", "100", "--seconds", "1", stdout=theirs)
        os.close(theirs)
        written = b""
        while select.select([ours], [], [], 30)[0]:
            try:
                written += os.read(ours, 65536)
            except OSError:  # the process has ended
                break
        assert process.wait(30) == 0
    finally:
        os.close(ours)
    assert b"A 100.0" in written
    assert b"\x1b[2K" in written  # the line is overwritten in place
    assert bench.at_rest


# --- invalid command lines --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--ay", "100"), "--seconds is missing"),
        (("--seconds", "1"), "Try: --ay and --bx"),
        (("--ay", "7000", "--seconds", "1"), "-6553.6 to 6553.4 min^-1"),
        (("--ay", "nan", "--seconds", "1"), "must be -6553.6 to 6553.4 min^-1, not nan"),
        (("--bx", "400", "--torque", "--seconds", "1"), "-327.68 to 327.67 %"),
        (("--ay", "1", "--seconds", "0"), "--seconds must be more than 0"),
        (("--ay", "1", "--seconds", "nan"), "--seconds must be more than 0"),
        (("--ay", "1", "--seconds", "1", "--period", "0.5"), "--period must be 0.01 to 0.3 s"),
        (("--ay", "1", "--velocity", "1", "--seconds", "1"), "--ay cannot be combined with --velocity"),
        (("--torque", "--turn", "1", "--seconds", "1"), "--torque cannot be combined with --turn"),
        (("--velocity", "1", "--track", "0.5", "--seconds", "1"), "require --wheel-diameter, --track and --gear"),
        (("--track", "0.5", "--seconds", "1"), "--velocity or --turn is missing"),
        (
            ("--velocity", "1", "--wheel-diameter", "0", "--track", "1", "--gear", "1", "--seconds", "1"),
            "wheel_diameter must be greater than 0",
        ),
        (
            ("--velocity", "9", "--wheel-diameter", "0.01", "--track", "1", "--gear", "0.1", "--seconds", "1"),
            "-6553.6 to 6553.4 min^-1",
        ),
        (("--ay", "1", "--seconds", "1", "--address", "254"), "address must be 0 to 253"),
        (("--ay", "1", "--seconds", "1", "--dialect", "v3"), "v3"),
        (("--ay", "1", "--seconds", "1", "--bitrate", "500000"), "--bitrate cannot be combined with a bus URL"),
    ],
)
def test_a_command_line_that_cannot_be_used(refused, bench, options, words):
    assert words in refused(*DRIVE, *options, code=2)
    assert bench.at_rest


def test_in_japanese(run, refused, bench, steady):
    i18n.use("ja")
    assert "指令がありません" in refused(*DRIVE, "--seconds", "1", code=2)
    assert " パルス A " in run(*DRIVE, "--ay", "10", "--seconds", "0.1").out


@pytest.mark.parametrize(
    ("options", "output"),
    [
        (("--ay", "10000"), "--ay: "),
        (("--ay", "1", "--bx", "-7000"), "--bx: "),
        (
            ("--velocity", "30", "--wheel-diameter", "0.15", "--track", "0.4", "--gear", "0.05"),
            "A/Y axis of this vehicle",
        ),
    ],
)
def test_a_command_out_of_range_is_reported_by_its_option(refused, options, output):
    assert output in refused(*DRIVE, *options, "--seconds", "1", code=2)
