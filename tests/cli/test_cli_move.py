"""move: a robot moves, its motion is recorded, and the previous state is restored."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

import orinkit
from orinkit.cli.app import main
from orinkit.core import i18n
from orinkit.virtual.clock import Clock, ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from support.stopping import stopped
from support.waiting import until

HOME = [0, 45, 90, 0, 45, 0]
THERE = [45, 30, 120, 0, -60, 0]
POSE = "J(45,30,120,0,-60,0)"
SLOWLY = ("--speed", "0.3")  # several seconds at a time scale of 20, so tests need not be quick
SIGNALS = tuple(
    number
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    if signal.getsignal(number) is not signal.SIG_IGN  # ignored under nohup
)


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(clock=Clock(20), language="en")
    yield device
    device.close()


def status(rc8: VirtualRC8, *names: str) -> list[object]:
    found = rc8.pendant.status()
    return [found[name] for name in names]


def joints(rc8: VirtualRC8) -> list[float]:
    found = rc8.pendant.status()["joints"]
    assert isinstance(found, list)
    return found


def test_a_scara_has_four_joints(run):
    device = VirtualRC8(clock=Clock(20), language="en", model="HSR065")
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        done = run("move", server.url, "J(20, 40, 50, 10)")
    assert (done.code, done.err) == (0, "")
    assert done.out == "J(20, 40, 50, 10)\nP(489.885, 366.415, 50, 0, 0, 70, 0)\n"


def test_it_moves_and_restores_the_previous_state(run, rc8, url):
    done = run("move", url, POSE)
    assert (done.code, done.err) == (0, "")
    assert done.out == "J(45, 30, 120, 0, -60, 0)\nP(234.166, 234.166, 345.67, 0, 90, 45, 1)\n"
    assert joints(rc8) == pytest.approx(THERE)
    assert status(rc8, "motor", "arm_holder", "moving") == ["off", "", False]


def test_a_motor_that_was_on_stays_on(run, rc8, url):
    rc8.pendant.motor()
    until(lambda: status(rc8, "motor") == ["on"])
    assert run("move", url, POSE, "--no-motor").code == 0
    assert run("move", url, "J(0,45,90,0,45,0)").code == 0
    assert status(rc8, "motor", "arm_holder") == ["on", ""]


def test_no_motor(refused, rc8, url):
    assert "MOTOR_NOT_ON" in refused("move", url, POSE, "--no-motor")
    assert joints(rc8) == pytest.approx(HOME)
    assert status(rc8, "motor", "arm_holder") == ["off", ""]


def test_the_call_sent(run, rc8, url):
    done = run("move", url, "P(380,0,250,180,0,180,5)", "--line", "--speed", "30.5", "--mark", "@E", "--trace")
    assert done.code == 0
    assert 'Robot_Move(3, 2, "@E P(380,0,250,180,0,180,5)", "SPEED=30.5,NEXT")' in done.err
    assert done.out.endswith("P(380, 0, 250, 180, 0, 180, 5)\n")


def test_json(run, rc8, url):
    answer = run("move", url, POSE, "--json").json
    assert answer["joints"] == pytest.approx(THERE)
    assert answer["position"] == pytest.approx([234.166, 234.166, 345.67, 0, 90, 45, 1], abs=1e-3)
    assert answer["record"] is None


def test_a_record(run, rc8, url, tmp_path):
    path = tmp_path / "motion.csv"
    assert run("move", url, POSE, "--record", str(path)).code == 0
    header, *rows = csv.reader(path.read_text().splitlines())
    assert header == ["time_s", *(f"J{n}_command" for n in range(1, 7)), *(f"J{n}_encoder" for n in range(1, 7))]
    values = [list(map(float, row)) for row in rows]
    assert len(values) > 20
    assert [row[0] for row in values] == pytest.approx([0.008 * place for place in range(len(values))])
    assert values[0][1:] == pytest.approx([*HOME, *HOME], abs=1)
    assert values[-1][1:] == pytest.approx([*THERE, *THERE])
    assert all(a[1] <= b[1] for a, b in pairwise(values))
    # the next run writes a new record
    assert run("move", url, "J(44,30,120,0,-60,0)", "--record", str(path)).code == 0
    assert float(path.read_text().splitlines()[1].split(",")[1]) == pytest.approx(45, abs=1)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["P(380,0"], "column"),
        (["here"], "column 1"),
        (["P1", "--mark", "E"], 'a pass mark ("@P", "@E"'),
        (["@E P1", "--mark", "@E"], "pass mark"),
        (["P1", "--speed", "0"], "--speed must be above 0 and at most 100, not 0.0"),
        (["P1", "--timeout", "0"], "--timeout must be a number of seconds above 0"),
        (["P1", "--speed", "nan"], "speed"),
        (["P1", "--speed", "fast"], "'fast'"),
        (["P1", "--record", "/no/such/directory/x.csv"], "the directory /no/such/directory does not exist"),
        ([], "POSE is missing"),
    ],
)
def test_a_command_line_that_cannot_be_used(refused, rc8, url, argv, words):
    assert words in refused("move", url, *argv, code=2)
    assert status(rc8, "motor") == ["off"]


def test_a_pose_out_of_reach(refused, rc8, url):
    assert "TARGET_OUT_OF_RANGE" in refused("move", url, "P(5000,0,0,0,0,0)")
    assert status(rc8, "motor", "arm_holder") == ["off", ""]


def test_an_error_before_the_motion(refused, run, rc8, url):
    rc8.raise_error(0x83204071, "axis 1 is at its limit")
    line = refused("move", url, POSE)
    assert "the controller reports 0x83204071 axis 1 is at its limit" in line
    command = f"orinkit call {url} Controller_Execute ClearError"
    assert f"to clear the error: {command}" in line
    assert run(*command.split()[1:]).code == 0
    assert run("move", url, POSE).code == 0


def test_an_error_during_the_motion_is_reported_once(refused, rc8, url, when):
    when(lambda: joints(rc8)[0] > 1, lambda: rc8.raise_error(0x83204071, "axis 1 is at its limit"))
    line = refused("move", url, POSE, *SLOWLY)
    assert "STOPPED_DURING_PC_MOTION" in line
    assert line.count("axis 1 is at its limit") == 1
    assert "Controller_Execute ClearError" in line


def test_the_emergency_stop_is_reported(refused, rc8, url, when):
    when(lambda: joints(rc8)[0] > 1, rc8.pendant.emergency_stop)
    assert "the emergency stop is pressed" in refused("move", url, POSE, *SLOWLY)


def test_help_has_no_empty_default(run):
    assert '[default: ""]' not in run("move", "--help").out


def test_an_arm_taken_by_another_client(refused, rc8, url):
    with orinkit.connect(url) as other:
        robot = other.robot()
        robot.execute("TakeArm")
        assert "ARM_NOT_TAKEN" in refused("move", url, POSE)
    assert joints(rc8) == pytest.approx(HOME)


@pytest.mark.parametrize("number", SIGNALS)
def test_ctrl_c_halts_the_arm(run, rc8, url, when, tmp_path, number):
    handlers = [signal.getsignal(each) for each in SIGNALS]
    when(lambda: joints(rc8)[0] > 1, lambda: os.kill(os.getpid(), number))
    path = tmp_path / "motion.csv"
    done = run("move", url, POSE, *SLOWLY, "--record", str(path))
    assert (done.code, done.out, done.err) == (130, "", "orinkit: interrupted\n")
    assert [signal.getsignal(each) for each in SIGNALS] == handlers
    assert 1 < joints(rc8)[0] < 40
    assert status(rc8, "motor", "arm_holder", "moving") == ["off", "", False]
    assert len(path.read_text().splitlines()) > 5  # the motion up to the interruption


@pytest.mark.parametrize("number", SIGNALS)
def test_ctrl_c_before_it_moves(run, when, number):
    clock = ManualClock()  # the motor does not switch on until the test advances the clock
    device = VirtualRC8(clock=clock, language="en")

    def interrupt() -> None:
        os.kill(os.getpid(), number)
        while status(device, "motor") != ["off"]:
            clock.advance(0.05)
            time.sleep(0.001)

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        when(lambda: status(device, "motor") == ["switching on"], interrupt)
        assert run("move", server.url, POSE).code == 130
        assert joints(device) == pytest.approx(HOME)
        assert status(device, "motor", "arm_holder") == ["off", ""]
    device.close()


def test_another_client_halts_the_arm(refused, rc8, url, when, tmp_path):
    def halt() -> None:
        with orinkit.connect(url) as other:
            other.robot().halt()

    when(lambda: joints(rc8)[0] > 1, halt)
    path = tmp_path / "motion.csv"
    line = refused("move", url, POSE, *SLOWLY, "--record", str(path))
    assert "STOPPED_DURING_PC_MOTION" in line
    assert "halted by another client or program" in line
    assert status(rc8, "motor", "arm_holder") == ["off", ""]
    assert path.exists()


def test_the_connection_is_lost(capsys, when, tmp_path):
    device = VirtualRC8(clock=Clock(20))
    server = orinkit.serve(device, "tcp://127.0.0.1:0")
    when(lambda: joints(device)[0] > 1, server.close)
    assert main(["move", server.url, POSE, *SLOWLY, "--record", str(tmp_path / "x.csv")]) == 1
    error = capsys.readouterr().err
    assert "the motor may still be on" in error
    assert "connection" in error.splitlines()[-1]
    until(lambda: status(device, "moving", "arm_holder") == [False, ""])
    device.close()


def test_a_command_that_is_suspended_stops_the_arm(program):
    """The attack: SIGSTOP. The connection stays open, and the motion would take minutes."""
    device = VirtualRC8(language="en")
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        command = [*program, "move", server.url, POSE, "--speed", "0.1"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            until(lambda: status(device, "moving") == [True])
            with stopped(process.pid):
                until(lambda: status(device, "moving") == [False])
        finally:
            process.kill()
            process.wait()
        assert joints(device)[0] < 40
    device.close()


@pytest.mark.parametrize(("argv", "sent"), [([], ["1000"]), (["--alive", "0.5"], ["500"]), (["--alive", "0"], [])])
def test_the_server_is_asked_to_watch_the_command(run, url, argv, sent):
    trace = run("move", url, POSE, "--trace", *argv).err
    assert "Service_Start(" in trace
    assert re.findall(r"Service_Start\(.*Alive=(\d+)", trace) == sent


@pytest.mark.parametrize("seconds", ["-1", "0.2", "3601", "nan"])
def test_seconds_without_signs_of_life_that_cannot_be_used(refused, url, seconds):
    line = refused("move", url, POSE, "--alive", seconds, code=2)
    assert line == f"--alive must be 0 or 0.3 to 3600 s, not {float(seconds)}"


def test_the_help_states_the_range_of_alive(run):
    page = " ".join(run("move", "--help").out.replace("│", " ").split())
    assert "0.3 to 3600, or 0:" in page


def test_a_terminal_shows_a_progress_bar(run, rc8, url, monkeypatch, tmp_path):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    done = run("move", url, POSE, "--speed", "20", "--record", str(tmp_path / "x.csv"))
    assert done.code == 0
    for words in ("moving", "J(45, 30, 120, 0, -60, 0)", "100%", "reading the record"):
        assert words in done.err
    assert done.out.startswith("J(45, ")


def test_in_japanese(refused, rc8, url):
    i18n.use("ja")
    assert "モータ" in refused("move", url, POSE, "--no-motor")
    assert "ディレクトリ" in refused("move", url, POSE, "--record", "/no/such/x.csv", code=2)
