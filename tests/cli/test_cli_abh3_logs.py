"""abh3 decode: logs other than regular files, output of can.logger, and invalid files."""

from __future__ import annotations

import io
import os
import shlex
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import can
from orinkit.can.frame import CanFrame
from orinkit.cli.abh3.logs import read_line
from orinkit.core import i18n

LINE = "(1.000000) can0 00EF0201#B6FF0000DBFFDBFF\n"
ANSWER = "00EF0201#B6FF0000DBFFDBFF  DP0R 1 -> 2: A axis velocity feedback = -14.8 min^-1"
FRAMES = [
    can.Message(timestamp=1000.25, arbitration_id=0x00EF0201, data=bytes.fromhex("b6ff0000dbffdbff"), channel="can0"),
    can.Message(timestamp=1, arbitration_id=0x00FF2801, data=b"12345678", is_rx=False, channel=0),
    can.Message(timestamp=1, arbitration_id=0x00EF0102, data=b""),
]
OTHERS = [
    can.Message(timestamp=1, arbitration_id=0x123, is_extended_id=False, data=b"\1"),
    can.Message(timestamp=1, arbitration_id=0x00EF0102, is_remote_frame=True, dlc=3),
    can.Message(timestamp=1, arbitration_id=0x00EF0102, is_error_frame=True, dlc=8),
    can.Message(timestamp=1, arbitration_id=0x00EF0102, is_fd=True, bitrate_switch=True, data=bytes(12)),
]


# --- pipes and the like -----------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no FIFOs")
@pytest.mark.parametrize("name", ["pipe", "pipe.log"])
def test_a_fifo(run, tmp_path, name):
    path = tmp_path / name
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_text, args=(LINE * 3,))
    writer.start()
    done = run("abh3", "decode", str(path))
    writer.join()
    assert (done.code, done.err) == (0, "")
    assert done.out.count(ANSWER) == 3


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="there is no /dev/stdin")
def test_dev_stdin(program):
    done = subprocess.run(
        [*program, "abh3", "decode", "/dev/stdin"], input=LINE, capture_output=True, encoding="utf-8", check=True
    )
    assert ANSWER in done.stdout


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="there is no /dev/fd")
def test_process_substitution(run):
    ours, theirs = os.pipe()
    os.write(theirs, LINE.encode())
    os.close(theirs)
    try:
        assert ANSWER in run("abh3", "decode", f"/dev/fd/{ours}").out
    finally:
        os.close(ours)


# --- output of can.logger ---------------------------------------------------------------------------------------------


def test_output_of_can_logger(run, monkeypatch):
    head = "Connected to UdpMulticastBus: 239.74.163.2\nCan Logger (Started on 2024-04-01 09:00:00.000000)\n"
    printed = head + "".join(f"{message}\n" for message in FRAMES + OTHERS)
    monkeypatch.setattr(sys, "stdin", io.StringIO(printed))
    done = run("abh3", "decode", "-")
    assert done.code == 0
    assert done.out.startswith(f"(1000.250000) {ANSWER}")
    assert done.out.count("\n") == 3
    assert "4 frames skipped" in done.err


@pytest.mark.parametrize("message", FRAMES)
def test_each_line_of_can_logger_is_read(message):
    frame = CanFrame(message.arbitration_id, bytes(message.data), message.timestamp)
    assert read_line(f"{message}\n") == frame
    assert read_line(" ".join(str(message).split())) == frame  # as after copying
    assert (
        read_line(str(message).upper().replace("TIMESTAMP", "Timestamp").replace("RX", "Rx").replace("TX", "Tx"))
        == frame
    )


@pytest.mark.parametrize("message", OTHERS)
def test_other_frames_of_can_logger_are_skipped(message):
    assert read_line(str(message)) is None


@pytest.mark.parametrize(
    "line",
    [
        "Timestamp: 123.4    ID: 00ef0102    X Rx    DL:  8    00 00",
        "Timestamp: 123.4    ID: 00ef0102    X Rx    DL:  2    00 0g",
        "Timestamp: never    ID: 00ef0102    X Rx    DL:  0",
        "Timestamp: 123.4    ID: ef0102    X Rx    DL:  0",
        "Timestamp: 123.4    ID: 00ef0102    DL:  0",
        "Timestamp: 123.4    ID: 00ef0102    X Rx    DL:  ",
        "Timestamp: 123.4    ID: 00ef0102    X Rx" + " E" * 2000,
    ],
)
def test_malformed_lines_of_can_logger(line):
    with pytest.raises(ValueError):
        read_line(line)


# --- invalid files ----------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.*bus.blf")  # python-can leaves it open
def test_a_file_that_is_not_a_log(refused, tmp_path):
    for name in ("bus.blf", "bus.xyz"):
        path = tmp_path / name
        path.write_bytes(b"this is no log")
        assert "cannot be read" in refused("abh3", "decode", str(path), code=2)
    assert "FILE is missing" in refused("abh3", "decode", code=2)


@pytest.mark.parametrize("suffix", ["", ".log", ".blf", ".asc"])
def test_names_that_cannot_be_opened(refused, tmp_path, suffix):
    def message(name: object) -> str:
        return refused("abh3", "decode", str(name), code=2)

    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    assert message(folder).endswith(": is a directory")
    assert message(tmp_path / f"none{suffix}").endswith(": no such file")
    assert "too long" in message(tmp_path / f"{'x' * 300}{suffix}")
    assert "null" in message(f"a\0b{suffix}")


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root can read every file")
def test_no_permission(refused, tmp_path):
    path = tmp_path / "bus.log"
    path.write_text(LINE)
    path.chmod(0)
    assert "Permission denied" in refused("abh3", "decode", str(path), code=2)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="requires Linux")
def test_a_read_that_fails(refused):
    assert refused("abh3", "decode", "/proc/self/mem", code=2) == ("/proc/self/mem: cannot be read: Input/output error")


@pytest.mark.parametrize(("lang", "message"), [("en", "-: stdin is closed"), ("ja", "-: 標準入力が閉じられています")])
def test_stdin_is_closed(program, lang, message):
    line = shlex.join([*program, "abh3", "decode", "-"])
    done = subprocess.run(
        ["sh", "-c", f"{line} <&-"], capture_output=True, encoding="utf-8", check=False,
        env={**os.environ, "ORINKIT_LANG": lang, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"orinkit: {message}\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="requires Linux")
def test_a_full_disk_while_it_decodes(program):
    """The error is about stdout, not about the log."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*program, "abh3", "decode", "-"], input=LINE, stdout=full, stderr=subprocess.PIPE, encoding="utf-8",
            check=False, env={**os.environ, "ORINKIT_LANG": "en"},
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, "orinkit: reading or writing failed: No space left on device\n")


def test_in_japanese(refused, tmp_path):
    i18n.use("ja")
    assert refused("abh3", "decode", str(tmp_path), code=2).endswith(": ディレクトリです")
    assert refused("abh3", "decode", str(tmp_path / "none"), code=2).endswith(": ファイルがありません")
