"""serve abh3, and abh3 monitor, decode and dbc, over a UDP multicast bus and with log files."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cantools
import pytest

import can
import orinkit
from orinkit.abh3.table.decoder import Decoder
from orinkit.can.frame import CanFrame
from orinkit.cli.abh3.live_table import FrameRows
from orinkit.cli.abh3.logs import read_line
from orinkit.core import i18n
from support import multicast
from support.multicast import GROUP, free_port

PORT = free_port()
URL = multicast.bus(PORT)
SERVO_ON = bytes.fromhex("e803000003300000")
LOG = [
    (0x00EF0102, "0000000003300000"),
    (0x00EF0201, "b6ff0000dbffdbff"),
    (0x18EAFF02, "28ff00"),
    (0x00FF2801, "0000400000004000"),
    (0x00EC0102, "101200030300ef00"),
    (0x18FEF103, "0102"),
]

Serve = Callable[..., "tuple[subprocess.Popen[str], str]"]


@pytest.fixture
def serve(program) -> Iterator[Serve]:
    """Start ``orinkit serve abh3``; returns the process and the address that it prints."""
    started: list[subprocess.Popen[str]] = []

    def serve(*options: str, where: tuple[str, ...] = (URL,)) -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(
            [*program, "serve", "abh3", *where, *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        word, _, url = process.stdout.readline().rstrip("\n").partition(" ")
        assert word == "ready", process.communicate()
        return process, url

    yield serve
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def bus() -> Iterator[can.BusABC]:
    with can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, ignore_config=True) as bus:
        yield bus


def ask(bus: can.BusABC, number: int, data: bytes, answer: int, seconds: float = 30) -> bytes:
    """Send a frame and return the data of the reply; repeats lost frames."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        bus.send(can.Message(arbitration_id=number, data=data))
        again = time.monotonic() + 1
        while (left := again - time.monotonic()) > 0:
            found = bus.recv(left)
            if found is not None and found.arbitration_id == answer:
                return bytes(found.data)
    raise AssertionError("no reply")


def stop(process: subprocess.Popen[str], number: int) -> tuple[int, str, str]:
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


# --- serve ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ready_line_replies_and_clean_stop(serve, bus, number):
    process, url = serve()
    assert url == URL
    assert len(ask(bus, 0x00EF0102, SERVO_ON, 0x00EF0201)) == 8
    code, out, err = stop(process, number)
    assert (code, out) == (0, "")
    assert "Traceback" not in err


def test_a_signal_ends_it_at_any_moment():
    """Also while a lock of the wait is held; in a separate process, because a failure would hang."""
    script = """
import signal, sys
from orinkit.cli.commands import serve_abh3

def look(*_):
    global left
    left -= 1
    if left == 0:
        signal.raise_signal(signal.SIGTERM)

serve_abh3._POLL = 0.001
for left in range(1, 40):
    with serve_abh3._wait_for_signals() as wait:
        sys.setprofile(look)
        wait()
        sys.setprofile(None)
"""
    subprocess.run([sys.executable, "-c", script], timeout=60, check=True)


def test_several_drivers_with_options(serve, bus):
    serve("--address", "1", "--address", "3", "--host", "9", "--group", "16", "--broadcast", "2=20", "--dialect", "v2")
    ask(bus, 0x00EF0109, SERVO_ON, 0x00EF0901)
    ask(bus, 0x00EF0309, SERVO_ON, 0x00EF0903)
    seen = set()
    end = time.monotonic() + 30
    while not {0x00FF8201, 0x00FF8203} <= seen:  # broadcasts that were not requested
        assert time.monotonic() < end
        found = bus.recv(1)
        seen.add(found.arbitration_id if found else 0)


def test_any_host(serve, bus):
    serve("--any-host")
    ask(bus, 0x00EF0107, SERVO_ON, 0x00EF0701)


def test_interface_and_channel(serve):
    process, url = serve(where=("--interface", "virtual", "--channel", "test"))
    assert url == "can://virtual/test"
    code, _, err = stop(process, signal.SIGTERM)
    assert code == 0
    assert "within one process" in err


def test_cao_clients_are_accepted_too(serve):
    process, url = serve(
        "--tcp", "127.0.0.1:0", "--http", "127.0.0.1:0", "--address", "7", where=("can://virtual/cao",)
    )
    assert url == "can://virtual/cao"
    assert process.stdout is not None
    for scheme in ("tcp", "http"):
        word, _, url = process.stdout.readline().rstrip("\n").partition(" ")
        assert (word, url.partition(":")[0]) == ("ready", scheme)
        with orinkit.connect(url, provider="CaoProv.Waco.ABH3") as motor:
            motor.execute("ResetErrors")
            assert motor.variable("MAIN_VOLTAGE").value == 24.0
    code, _, err = stop(process, signal.SIGTERM)
    assert code == 0
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--address", "254"), "address"),
        (("--address", "1", "--address", "1"), "two devices have the address 1"),
        (("--address", "x"), "'x' is not a valid value for --address"),
        (("--address", "1.5"), "'1.5' is not a valid value for --address"),
        (("--host", "1"), "host"),
        (("--group", "32"), "group"),
        (("--dialect", "v3"), "dialect"),
        (("--model", "boat"), "model"),
        (("--load-unit", "0.5"), "load_unit"),
        (("--broadcast", "8=100"), "--broadcast 8=100"),
        (("--broadcast", "two"), "--broadcast two"),
        (("--broadcast", "2=5000"), "broadcast_modes"),
        (("--single-period", "0"), "--single-period"),
        (("--single-period", "1001"), "single_mode"),
        (("--single-period", "100", "--any-host"), "single_mode"),
        (("--command-timeout", "-1"), "command_timeout"),
        (("--time-scale", "0"), "time scale"),
        (("--time-scale", "1e308"), "time scale must be positive, from 0.000001 to 1000000"),
        (("--frob",), "unknown option --frob"),
        (("can://virtual/x", "--channel", "y"), "--channel cannot be combined with a bus URL"),
        (("can://nothing/x",), "nothing"),
        (("tcp://127.0.0.1:5007",), "is not a CAN bus"),
        (("can0",), "can0 is not a URL of a CAN bus. Try: can://socketcan/can0"),
        (("vcan12",), "can://socketcan/vcan12"),
        (("/dev/ttyACM0",), "can://slcan//dev/ttyACM0?bitrate=500000"),
        (("COM3",), "can://slcan/COM3?bitrate=500000"),
        (("PCAN_USBBUS1",), "can://pcan/PCAN_USBBUS1?bitrate=500000"),
        (("239.74.163.2",), "can://udp_multicast/239.74.163.2"),
        (("192.168.0.1",), "is not a CAN bus"),
        (("--interface", "socketcan"), "requires --channel"),
        (("--interface", "virtual", "--channel", "x", "--bitrate", "fast"), "--bitrate"),
    ],
)
def test_serve_with_a_wrong_option(refused, options, message):
    where = () if options[0] == "--interface" or not options[0].startswith("--") else ("can://virtual/wrong",)
    assert message in refused("serve", "abh3", *where, *options, code=2)


# --- monitor ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def traffic() -> Iterator[None]:
    """A bus on which the frames of the log are sent repeatedly."""
    ending = threading.Event()

    def send() -> None:
        with can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, ignore_config=True) as bus:
            while not ending.wait(0.02):
                for number, data in LOG:
                    bus.send(can.Message(arbitration_id=number, data=bytes.fromhex(data)))

    thread = threading.Thread(target=send)
    thread.start()
    yield
    ending.set()
    thread.join()


def test_monitor_prints_a_line_for_each_frame(run, traffic):
    done = run("abh3", "monitor", URL, "--count", "12")
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert len(lines) == 12
    assert any(
        "00EF0201#B6FF0000DBFFDBFF  DP0R 1 -> 2: A axis velocity feedback = -14.8 min^-1, B axis velocity" in line
        for line in lines
    )
    assert all(line.startswith("(") for line in lines)


def test_monitor_as_json(run, traffic):
    done = run("abh3", "monitor", URL, "--count", "12", "--json", "--dialect", "v2")
    documents = [json.loads(line) for line in done.out.splitlines()]
    assert len(documents) == 12
    found: dict[str, Any] = {document["name"]: document for document in documents}
    assert found["DP0R"]["values"]["ay_velocity"] == -14.8
    assert found["DP0R"]["units"] == {"ay_velocity": "min^-1", "bx_velocity": "min^-1"}
    assert found["BR0"]["values"]["errors"] == {"value": 0x400000, "on": ["can_communication"]}
    assert (found["BR0"]["source"], found["BR0"]["destination"]) == (1, None)
    assert found[""]["fault"].startswith("not a frame of an ABH3")


def test_monitor_ends_by_time_and_sends_nothing(run, bus):
    done = run("abh3", "monitor", URL, "--seconds", "0.3", "--plain")
    assert (done.code, done.out, done.err) == (0, "", f"orinkit: no frames received on {URL}\n")
    assert bus.recv(0) is None


def test_monitor_ends_by_ctrl_c(run, traffic, when, monkeypatch):
    written, write = threading.Event(), sys.stdout.write

    def note(text: str) -> int:
        count = write(text)
        written.set()
        return count

    monkeypatch.setattr(sys.stdout, "write", note)
    when(written.is_set, lambda: os.kill(os.getpid(), signal.SIGINT))
    done = run("abh3", "monitor", URL)
    assert (done.code, done.err) == (0, "")
    assert done.out


def test_monitor_as_a_table(run, traffic, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "200")
    i18n.use("ja")
    done = run("abh3", "monitor", URL, "--count", "30")
    assert done.code == 0
    for message in ("フレーム", "DP0R 1 -> 2", "BR0 1 -> 全体", "A 速度帰還 = -14.8 min^-1"):
        assert message in done.out


def test_rows_of_the_table():
    now = 100.0
    rows, decoder = FrameRows(lambda: now), Decoder()

    def add(number: int, data: str = "") -> None:
        rows.add(decoder.decode(CanFrame(number, bytes.fromhex(data))))

    for step in range(21):
        now = 100.0 + step * 0.1
        add(0x00EF0201, f"{step:02x}00000000000000")
    add(0x00FF2803, "00" * 8)
    add(0x18FEF103)
    now += 1.0
    driver, unknown, broadcast = rows.lines()
    assert driver[:4] == ("DP0R 1 -> 2", "10.0", "1.0", "21")
    assert driver[4].startswith("A axis velocity feedback = 4.0 min^-1")  # the last one
    assert (unknown[0], broadcast[0]) == ("unknown 3 -> all", "BR0 3 -> all")
    now += 10.0
    assert rows.lines()[0][1:3] == ("0.0", "11.0")  # silent
    for number in range(1000):
        add(0x18000000 | number << 8)
    assert len(rows.lines()) == 200


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--count", "0"), "--count must be more than 0"),
        (("--seconds", "-1"), "--seconds must be more than 0"),
        (("--seconds", "nan"), "--seconds must be more than 0"),
        (("--count", "many"), "--count"),
        (("--dialect", "v3"), "v3"),
        (("--host", "300"), "host"),
        (("--group", "32"), "group"),
        (("--load-unit", "2"), "load"),
        (("--interface", "virtual"), "--interface cannot be combined with a bus URL"),
    ],
)
def test_monitor_with_a_wrong_option(refused, options, message):
    assert message in refused("abh3", "monitor", URL, *options, code=2)


# --- decode -----------------------------------------------------------------------------------------------------------


def messages() -> list[can.Message]:
    others = [
        can.Message(timestamp=1005, arbitration_id=0x123, is_extended_id=False, data=b"\1"),
        can.Message(timestamp=1006, arbitration_id=0x00EF0102, is_remote_frame=True, dlc=0),
    ]
    return [
        can.Message(timestamp=1000 + 0.25 * n, arbitration_id=number, data=bytes.fromhex(data), channel=0)
        for n, (number, data) in enumerate(LOG)
    ] + others


def expected() -> list[str]:
    decoder = Decoder()
    return [decoder.decode(CanFrame(number, bytes.fromhex(data))).text for number, data in LOG]


WRITERS = {".log": can.CanutilsLogWriter, ".asc": can.ASCWriter, ".blf": can.BLFWriter, ".csv": can.CSVWriter}


@pytest.mark.parametrize("suffix", WRITERS)
def test_decode_of_logs(run, tmp_path, suffix):
    path = str(tmp_path / f"bus{suffix}")
    with WRITERS[suffix](path) as writer:
        for message in messages():
            writer(message)
    done = run("abh3", "decode", path)
    assert (done.code, [line.split("  ", 1)[1] for line in done.out.splitlines()]) == (0, expected())
    assert "2 frames skipped" in done.err
    times = [float(line[1:].split(")")[0]) for line in done.out.splitlines()]
    assert [time - times[0] for time in times] == pytest.approx([0.25 * n for n in range(len(LOG))], abs=1e-3)
    documents = [json.loads(line) for line in run("abh3", "decode", path, "--json").out.splitlines()]
    assert [(int(document["id"], 16), document["data"]) for document in documents] == LOG


CANDUMP = """
  can0  00EF0102   [8]  00 00 00 00 03 30 00 00
 (000.250000)  can0  00EF0201   [8]  B6 FF 00 00 DB FF DB FF   '........'
 (2020-12-19 12:04:45.485261)  can0  18EAFF02   [3]  28 FF 00
 (1579857014.345944) can0 00FF2801#0000400000004000
(1579857014.345944) can0 00EC0102#101200030300EF00 R
 (1579857014.345944)  can0  RX - -  18FEF103   [2]  01 02
  can0  123   [2]  01 02
 can0  00EF0102   [0]  remote request
(1579857014.345944) can0 00EF0102#R
(1579857014.345944) can0 00EF0102##1112233
  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME
"""


def test_decode_of_candump_output(run, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stdin", io.StringIO(CANDUMP))
    done = run("abh3", "decode", "-")
    assert (done.code, [line.split("  ", 1)[1] for line in done.out.splitlines()]) == (0, expected())
    assert "5 frames skipped" in done.err
    path = tmp_path / "candump.txt"
    path.write_text(CANDUMP)
    assert run("abh3", "decode", str(path)) == done


def test_decode_of_its_own_lines(run, monkeypatch):
    """The output of monitor can be decoded again."""
    monkeypatch.setattr(sys, "stdin", io.StringIO(CANDUMP))
    first = run("abh3", "decode", "-")
    monkeypatch.setattr(sys, "stdin", io.StringIO(first.out.replace(") ", ") can0 ")))
    assert run("abh3", "decode", "-").out == first.out
    monkeypatch.setattr(sys, "stdin", io.StringIO(first.out))
    assert run("abh3", "decode", "-").out == first.out


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_decode_reports_malformed_lines(run, monkeypatch, lang):
    i18n.use(lang)
    monkeypatch.setattr(sys, "stdin", io.StringIO("can0  00EF0102   [2]  01 02\nhello\n\nworld\n" + "x" * 100_000))
    done = run("abh3", "decode", "-")
    assert done.code == 1
    assert done.out.count("\n") == 1
    assert ("the first is line 2: 'hello'" if lang == "en" else "2 行目: 'hello'") in done.err


@pytest.mark.parametrize(
    "line",
    [
        "00EF0102",
        "can0 00EF0102#0",
        "can0 00EF0102#00 0",
        "can0 00EF0102 [8] 00 00",
        "can0 00EF0102 [8] 00 00 0G",
        "(x) can0 00EF0102#00",
        "(0001-01-01 00:00:00) can0 00EF0102#00x",
        "can0 EF0102#00",
        "can0 00EF0102 [99999999999999999999] 00",
    ],
)
def test_malformed_lines(line):
    if line == "can0 00EF0102#00 0":  # text after the data is ignored
        assert read_line(line) == CanFrame(0x00EF0102, b"\0")
        return
    with pytest.raises(ValueError):
        read_line(line)


# --- dbc --------------------------------------------------------------------------------------------------------------


def test_dbc(run):
    done = run("abh3", "dbc", "--dialect", "v2", "--address", "1", "--address", "3", "--host", "9", "--group", "16")
    assert (done.code, done.err) == (0, "")
    database = cantools.database.load_string(done.out, "dbc")
    assert database.get_message_by_name("DP0R_3").frame_id == 0x00EF0903
    assert database.get_message_by_name("BR0_1").frame_id == 0x00FF8001


def test_cantools_agrees_with_monitor(run, tmp_path):
    """orinkit abh3 dbc > abh3.dbc; candump can0 | cantools decode abh3.dbc"""
    path: Path = tmp_path / "abh3.dbc"
    path.write_text(run("abh3", "dbc").out)
    done = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", str(path)],
        input="(1.0) can0 00EF0201#B6FF0000DBFFDBFF\n", capture_output=True, encoding="utf-8", check=True,
    )  # fmt: skip
    for name, value in (("a", -14.8), ("b", 0.0), ("y", -7.4), ("x", -7.4)):
        message = done.stdout.split(f"{name}_velocity: ")[1].split()[0]
        assert float(message) == pytest.approx(value)


@pytest.mark.parametrize(
    ("options", "message"),
    [(("--dialect", "v3"), "v3"), (("--address", "2"), "address 2"), (("--group", "-1"), "group")],
)
def test_dbc_with_a_wrong_option(refused, options, message):
    assert message in refused("abh3", "dbc", *options, code=2)


def test_no_ready_line_if_a_port_is_taken(run):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = run("serve", "abh3", "can://virtual/taken", "--tcp", f"127.0.0.1:{port}")
    assert (done.code, done.out) == (1, "")
