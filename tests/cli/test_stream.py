"""stream: a trajectory is checked, streamed and reported; the previous state is restored; recordings can be plotted."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

import orinkit
from orinkit import Lateness, StreamResult, Timing
from orinkit.cli._shared.stream_report import StreamReport, histogram
from orinkit.cli._shared.stream_trace import StreamTrace, is_recording, read_trace, trace_of
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.streaming.process.realtime import RealTime
from orinkit.streaming.recording.recorder import open_recorder
from orinkit.streaming.recording.samples import Sample
from orinkit.values.poses import J
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.robot.slave_mode.slave_mode import RC8SlaveMode
from support.stopping import stopped
from support.waiting import PATIENCE, until

PERIOD = 0.008
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
SIGNALS = tuple(
    number
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    if signal.getsignal(number) is not signal.SIG_IGN  # ignored under nohup
)


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(motor=True, language="en")
    yield device
    device.close()


def wave(seconds: float = 0.4, amplitude: float = 2.0, home: Sequence[float] = HOME) -> list[tuple[float, ...]]:
    """Return a trajectory in which J1 moves by an amplitude and back."""
    count = round(seconds / PERIOD)
    sways = [amplitude * (1 - math.cos(2 * math.pi * number / count)) / 2 for number in range(count + 1)]
    return [(home[0] + sway, *home[1:]) for sway in sways]


def write(path: Path, points: Sequence[Sequence[float]], header: str = "j1,j2,j3,j4,j5,j6") -> str:
    path.write_text("\n".join([header, *(",".join(f"{value:.6f}" for value in point) for point in points)]))
    return str(path)


@pytest.fixture
def file(tmp_path) -> str:
    return write(tmp_path / "wave.csv", wave())


def status(rc8: VirtualRC8, *names: str) -> list[object]:
    found = rc8.pendant.status()
    return [found[name] for name in names]


def joints(rc8: VirtualRC8) -> list[float]:
    found = rc8.pendant.status()["joints"]
    assert isinstance(found, list)
    return found


# --- streaming --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["0", "2"])
def test_it_streams_and_reports(run, rc8, url, file, mode):
    done = run("stream", url, file, "--mode", mode)
    assert (done.code, done.err) == (0, "")
    report = dict(line.split(maxsplit=1) for line in done.out.splitlines() if not line.startswith(" "))
    assert report["set-points"] == "51"
    assert report["underflows"] == "0"
    assert report["gaps"].startswith("p50 ")
    assert report["real"].startswith("time  ")
    assert report["largest"].startswith("deviation  J1 ")
    assert "record" not in report
    assert "#" in done.out
    until(lambda: joints(rc8) == pytest.approx(HOME))
    assert status(rc8, "motor", "arm_holder", "moving") == ["on", "", False]  # the motor was on


def test_json_and_a_record(run, rc8, url, file, tmp_path):
    path = tmp_path / "run.csv"
    report = run("stream", url, file, "--json", "--record", str(path)).json
    assert (report["set_points"], report["underflows"], report["record"]) == (51, 0, str(path))
    assert report["seconds"] > 0.3
    assert 0 < report["gaps"]["p50"] <= report["gaps"]["p99"] <= report["gaps"]["max"]
    assert sum(report["gaps"]["histogram_ms"].values()) == report["gaps"]["count"] >= 50
    assert report["real_time"].keys() == {"priority", "memory_locked"}
    assert 0.1 < report["largest_deviation"]["J1"] < 2
    assert report["largest_deviation"]["J2"] == pytest.approx(0, abs=1e-6)
    with path.open() as lines:
        commands = [float(row["J1_command"]) for row in csv.DictReader(lines)]
    assert max(commands) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("suffix", ["csv", "mcap"])
def test_a_recording_becomes_a_picture(run, rc8, url, file, tmp_path, suffix):
    path, picture = tmp_path / f"run.{suffix}", tmp_path / "run.svg"
    assert run("stream", url, file, "--record", str(path)).code == 0
    done = run("plot", str(path), "--out", str(picture))
    assert (done.code, done.out, done.err) == (0, f"{picture}\n", "")
    text = picture.read_text()
    for words in ("J1 [deg]", "command", "actual", "actual - command", "time [s]"):
        assert f"<!-- {words} -->" in text
    assert "<!-- J2 [deg] -->" not in text
    assert "streamed motion, 0." in text


def test_positions(run, rc8, url, tmp_path):
    points = [(364.159992, point[0], 278.535534, 180.0, 0.0, 180.0, 5.0) for point in wave()]
    path = tmp_path / "run.csv"
    report = run(
        "stream", url, write(tmp_path / "p.csv", points, "x,y,z,rx,ry,rz,fig"), "--json", "--record", str(path)
    ).json
    assert list(report["largest_deviation"]) == ["X", "Y", "Z", "RX", "RY", "RZ"]
    assert report["largest_deviation"]["Y"] > 0.1
    assert report["largest_deviation"]["RX"] == pytest.approx(0, abs=1e-3)  # also across the step from 180 to -180
    trace = read_trace(path)
    assert trace.names == ["X", "Y", "Z", "RX", "RY", "RZ"]
    assert [trace.names[index] for index in trace.changing()] == ["Y"]
    assert trace.actual


def test_an_arm_at_another_position(run, refused, rc8, url, tmp_path):
    file = write(tmp_path / "away.csv", wave(home=(3.0, *HOME[1:])))
    line = refused("stream", url, file, code=2)
    assert "the trajectory begins at J(3, 45, 90, 0, 45, 0)" in line
    assert line.endswith("; the option --move does this")
    assert joints(rc8) == pytest.approx(HOME)
    done = run("stream", url, file, "--move", "--speed", "90")
    assert done.code == 0
    until(lambda: joints(rc8)[0] == pytest.approx(3.0))


def test_the_whole_trajectory_is_checked_before_the_arm_moves(run, refused, rc8, url, tmp_path):
    points = [*wave(), (9.0, *HOME[1:])]
    file = write(tmp_path / "fast.csv", points)
    line = refused("stream", url, file, "--move", code=2)
    assert "sample 51 " in line
    assert "J1: velocity 1125.0 deg/s" in line
    assert joints(rc8) == pytest.approx(HOME)
    assert status(rc8, "arm_holder") == [""]
    assert run("stream", url, file, "--retime").code == 0
    until(lambda: joints(rc8)[0] == pytest.approx(9.0))


def test_limits(refused, url, tmp_path):
    file = write(tmp_path / "wave.csv", wave(amplitude=10.0))
    assert "J1: acceleration 616.0 deg/s^2 exceeds the limit of 212.5" in refused(
        "stream", url, file, "--speed", "10", code=2
    )
    slow = tmp_path / "slow.toml"
    slow.write_text((Path(orinkit.__file__).parent / "arms" / "vs050.toml").read_text().replace("170", "5"))
    assert "outside the range of -5 to 5" in refused("stream", url, file, "--model", str(slow), code=2)


def test_the_motor_is_switched_on_and_off(run, refused, tmp_path, file):
    device = VirtualRC8(language="en")
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        assert "MOTOR_NOT_ON" in refused("stream", server.url, file, "--no-motor")
        assert run("stream", server.url, file).code == 0
        assert status(device, "motor", "arm_holder") == ["off", ""]
    device.close()


@pytest.mark.parametrize("number", SIGNALS)
def test_ctrl_c_stops_the_arm(run, rc8, url, when, tmp_path, number):
    file, path = write(tmp_path / "long.csv", wave(8.0, 60.0)), tmp_path / "run.csv"
    handlers = [signal.getsignal(each) for each in SIGNALS]
    when(lambda: joints(rc8)[0] > 1, lambda: os.kill(os.getpid(), number))
    done = run("stream", url, file, "--record", str(path))
    assert (done.code, done.out) == (130, "")
    assert [signal.getsignal(each) for each in SIGNALS] == handlers
    assert done.err.startswith("orinkit: interrupted after ")
    assert "of 1001 set-points: the arm was stopped, slave mode is off" in done.err
    assert 1 < joints(rc8)[0] < 50
    assert rc8.pendant.status()["error"] == ""
    assert status(rc8, "motor", "arm_holder", "moving") == ["on", "", False]
    assert len(path.read_text().splitlines()) > 5  # the motion up to the interruption


@pytest.mark.parametrize("number", SIGNALS)
def test_ctrl_c_before_it_streams(run, rc8, url, when, tmp_path, number):
    file = write(tmp_path / "away.csv", wave(amplitude=0.1, home=(40.0, *HOME[1:])))
    when(lambda: joints(rc8)[0] > 1, lambda: os.kill(os.getpid(), number))
    done = run("stream", url, file, "--move", "--speed", "2")
    assert (done.code, done.err) == (130, "orinkit: interrupted\n")
    assert 0.5 < joints(rc8)[0] < 39


def test_an_error_during_the_stream(refused, rc8, url, when, tmp_path):
    file = write(tmp_path / "long.csv", wave(8.0, 60.0))
    when(lambda: joints(rc8)[0] > 1, lambda: rc8.raise_error(0x83204071, "axis 1 is at its limit"))
    line = refused("stream", url, file)
    assert "0x83204071" in line
    assert line.count("axis 1 is at its limit") == 1
    assert "Controller_Execute ClearError" in line
    assert status(rc8, "arm_holder", "moving") == ["", False]


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], "TRAJECTORY is missing"),
        (["none.csv"], "cannot read none.csv"),
        (["wave.csv", "--mode", "7"], "Try: mode 0, 1 or 2"),
        (["wave.csv", "--mode", "1.5"], "'1.5'"),
        (["wave.csv", "--pose", "X"], "J, P or T"),
        (["wave.csv", "--pose", "p"], "type J, expected P"),
        (["wave.csv", "--speed", "0"], "--speed must be 0.1 to 100, not 0.0"),
        (["wave.csv", "--speed", "nan"], "speed"),
        (["wave.csv", "--model", "VS-999"], "no such robot model"),
        (["wave.csv", "--record", "run.txt"], ".csv or .mcap"),
        (["wave.csv", "--record", "/no/such/run.csv"], "the directory /no/such"),
        (["empty.csv"], "empty"),
        (["words.csv"], "words.csv"),
    ],
)
def test_a_command_line_that_cannot_be_used(refused, rc8, url, tmp_path, monkeypatch, argv, words):
    monkeypatch.chdir(tmp_path)
    write(Path("wave.csv"), wave())
    Path("empty.csv").touch()
    Path("words.csv").write_text("a,b\nc,d\n")
    assert words in refused("stream", url, *argv, code=2)
    assert status(rc8, "arm_holder", "moving") == ["", False]


def test_http_is_refused_before_anything_moves(refused, run, tmp_path):
    """``--move`` would have moved the arm, and only then slave mode would have been refused."""
    device = VirtualRC8(language="en")
    file = write(tmp_path / "away.csv", wave(home=(3.0, *HOME[1:])))
    with orinkit.serve(device, "http://127.0.0.1:0") as server:
        line = refused("stream", server.url, file, "--move", code=2)
        expected = f"slave mode requires b-CAP; {server.url} uses e-CAP. Try: tcp://, udp://, serial://"
        assert line.rstrip("/") == expected.rstrip("/")
        assert status(device, "motor", "arm_holder") == ["off", ""]
        assert joints(device) == pytest.approx(HOME)
    page = run("stream", "--help").out
    assert "tcp://" in page
    assert "http" not in page.partition("TRAJECTORY")[0].partition("URL")[2]
    device.close()


def test_a_command_that_is_suspended(program, tmp_path):
    """The message names an option of the command, not a method of the library."""
    device = VirtualRC8(motor=True, language="en")
    file = write(tmp_path / "long.csv", wave(20.0, 60.0))
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        process = subprocess.Popen([*program, "stream", server.url, file], stderr=subprocess.PIPE, text=True)
        try:
            until(lambda: joints(device)[0] > 1)
            with stopped(process.pid):
                until(lambda: status(device, "slave_mode", "moving") == [0, False])
            _, errors = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 1
    assert errors == (
        "orinkit: this program was stopped (SIGSTOP), so the arm was stopped and slave mode was ended. "
        "Try: run the command again, with --move\n"
    )
    device.close()


def test_a_terminal_shows_a_progress_bar(run, rc8, url, monkeypatch, tmp_path):
    file = write(tmp_path / "away.csv", wave(home=(3.0, *HOME[1:])))
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    done = run("stream", url, file, "--move")
    assert done.code == 0
    for words in ("moving", "streaming", "51/51", "100%", "J(3, 45, 90, 0, 45, 0)"):
        assert words in done.err
    assert done.out.startswith("set-points ")


def test_in_japanese(run, refused, url, file, tmp_path):
    i18n.use("ja")
    out = run("stream", url, file).out
    assert "; " not in out  # a separator of English lists
    for words in ("目標値", "送信間隔", "バッファ枯渇", "最大偏差", "51 個"):
        assert words in out
    assert "--move" in refused("stream", url, write(tmp_path / "a.csv", wave(home=(3.0, *HOME[1:]))), code=2)


# --- the report -------------------------------------------------------------------------------------------------------


LATE = {"count": 2, "longest": 0.048, "total": 0.06}


@pytest.fixture
def late_file(tmp_path, monkeypatch) -> str:
    """A trajectory for which the controller reports two late set-points."""

    def lateness(slave: RC8SlaveMode, skip_first: int) -> Lateness:
        return Lateness(**LATE) if slave.newest > (1.0,) and skip_first == 0 else Lateness()

    monkeypatch.setattr(RC8SlaveMode, "lateness", property(lambda slave: partial(lateness, slave)))
    return write(tmp_path / "half.csv", wave(0.8)[:51])


@pytest.mark.parametrize(
    ("lang", "report"),
    [
        ("en", ("late 2 late set-points, by up to 48 ms", "(a real controller would have stopped the arm)")),
        ("ja", ("遅延 遅延した目標値 2 個 (最大 48 ms)", "(実機ではアームが停止していました)")),
    ],
)
def test_late_set_points_are_reported(run, url, late_file, lang, report):
    i18n.use(lang)
    done = run("stream", url, late_file)
    assert done.code == 0
    words = [" ".join(line.split()) for line in done.out.splitlines()]
    assert words[words.index(report[0]) + 1] == report[1]


def test_late_set_points_in_json(run, url, late_file):
    assert run("stream", url, late_file, "--json").json["late"] == LATE


def test_punctual_set_points_are_not_reported():
    report = StreamReport(StreamResult(51, 0, (), 0, Timing()), RealTime(0, False), StreamTrace([], [], [], []))
    assert not [line for line in report.lines() if line.startswith("late")]
    assert report.document()["late"] == {"count": 0, "longest": 0.0, "total": 0.0}


def test_a_histogram_has_few_lines_for_any_gaps():
    assert histogram(Timing()) == []
    lines = histogram(Timing((0.0081,) * 299 + (0.0079,)))
    assert [line.split()[::2] for line in lines] == [["7-8", "1"], ["8-9", "299"]]
    assert lines[0].endswith(" 1 #")
    assert lines[1].endswith("#" * 30)
    many = histogram(Timing(tuple(place / 1000 + 0.0005 for place in range(40))))
    assert len(many) == 12
    assert many[-1].split()[:3] == ["11-...", "ms", "29"]


def sample(number: int, value: float, actual: float | None) -> Sample:
    feedback = None if actual is None else J(actual, 0, 0, 0, 0, 0)
    return Sample(number, number * 0.0081, (value, *HOME[1:]), joints=feedback)


def test_without_feedback_there_is_no_deviation():
    trace = trace_of([sample(0, 0, 0), sample(1, 5, None)], "J", PERIOD)
    assert trace.actual == []
    assert trace.largest_deviation(0) == 0
    assert trace.times == [0, PERIOD]
    assert trace_of([], "J", PERIOD).times == []


def test_angles_are_compared_the_shorter_way():
    trace = StreamTrace([0.0], ["X", "RX", "J7"], [[0.0, 179.0, 0.0]], [[2.0, -179.0, 360.0]])
    assert [trace.largest_deviation(index) for index in range(3)] == pytest.approx([2.0, 2.0, 360.0])
    assert [trace.unit(index) for index in range(3)] == ["mm", "deg", ""]


# --- recordings as files ----------------------------------------------------------------------------------------------


@pytest.fixture(params=["csv", "mcap"])
def recording(request, tmp_path) -> Path:
    path = tmp_path / f"run.{request.param}"
    with open_recorder(path, kind="J", period=PERIOD) as recorder:
        for number in range(2000):
            recorder.write(sample(number, number / 100, number / 100 - 0.5))
    assert recorder.error is None
    return path


def test_a_recording_can_be_read(recording):
    assert is_recording(recording)
    trace = read_trace(recording)
    assert trace.names == ["J1", "J2", "J3", "J4", "J5", "J6"]
    assert list(trace.times) == pytest.approx([number * PERIOD for number in range(2000)])
    assert trace.largest_deviation(0) == pytest.approx(0.5)
    assert trace.command[100][0] == pytest.approx(1.0)


def test_a_truncated_recording(run, tmp_path):
    path = tmp_path / "run.mcap"
    with open_recorder(path, kind="J", period=PERIOD) as recorder:
        for number in range(2000):
            recorder.write(sample(number, number / 100, 0))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    assert 100 < len(read_trace(path).times) < 2000
    assert run("plot", str(path)).code == 0


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.mcap", b"", "not a recording of a stream"),
        ("x.mcap", b"\x89MCAP0\r\n" + bytes(100), "not a recording of a stream"),
        ("x.mcap", b"time_s,J1_command\n", "not a recording of a stream"),
        ("x.csv", b"time_s,J1_command,sent_s\n0,1,0\n", "at least 2 are required"),
        ("x.csv", b"time_s,J1_command,sent_s\n", "at least 2 are required"),
        ("x.csv", b"time_s,sent_s\n0,1\n", "columns time_s, J1_command"),
        ("x.csv", b"J1_command,sent_s\n0,1\n", "columns time_s, J1_command"),
        ("x.csv", b"time_s,J1_command,sent_s\n0,nan,0\n1,1,1\n", "line 2"),
        ("x.csv", b"time_s,J1_command,sent_s\n0,1\n", "line 2"),
    ],
)
def test_an_invalid_file(refused, tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    line = refused("plot", str(path), code=2)
    assert words in line
    assert str(path) in line
    i18n.use("ja")
    assert refused("plot", str(path), code=2) != line


@pytest.mark.parametrize(
    "message",
    [
        b"[]", b"{}", b'{"number": 0, "sent": 0}', b'{"number": 0, "command": "x"}', b'{"number": 0, "command": [null]}',
        b'{"number": 0, "command": [1e999]}', b'{"number": {}, "command": [1]}', b"[" * 100_000, b"\xff",
    ],
)  # fmt: skip
def test_invalid_messages(tmp_path, message):
    from mcap.writer import Writer

    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, data in (
            ("/slave/info", json.dumps({"kind": "J", "period": PERIOD}).encode()),
            ("/slave/sample", message),
        ):
            channel = writer.register_channel(topic, "json", 0)
            writer.add_message(channel, 0, data, 0)
        writer.finish()
    with pytest.raises(InvalidValue, match=r"x\.mcap"):
        read_trace(path)


def test_without_mcap(refused, tmp_path, monkeypatch):
    path = tmp_path / "x.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    monkeypatch.setitem(sys.modules, "mcap", None)
    assert "pip install 'orinkit[log]'" in refused("plot", str(path))


def test_an_arm_that_did_not_move(run, tmp_path):
    path, target = tmp_path / "x.csv", tmp_path / "x.svg"
    path.write_text("time_s,J1_command,sent_s\n0,1,0\n0.008,1,0.008\n")
    assert run("plot", str(path), "--out", str(target)).code == 0
    text = target.read_text()
    assert "<!-- the arm did not move -->" in text
    assert "<!-- actual -->" not in text
