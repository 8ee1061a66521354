"""dissector, and --capture: the files that they write, read by tshark."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit import HttpOptions
from orinkit.bcap.dissector import lua
from orinkit.bcap.pcapng import SERIAL_LINE
from orinkit.cao.functions import FUNCTIONS
from orinkit.transport.address import DEFAULT_PORT, parse_address
from orinkit.transport.captured import connection_of
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.tshark import Result, Tshark, needs_tshark
from support.waiting import until


@pytest.fixture
def capture(tmp_path) -> Path:
    return tmp_path / "new.pcapng"


def read(path: Path, url: str, *options: str) -> Result:
    """Dissect a capture of a server on any port."""
    return Result(Tshark(path.parent), path, ("-o", f"bcap.ports:{url.rpartition(':')[2]}", *options))


# --- dissector --------------------------------------------------------------------------------------------------------


def test_the_dissector_is_written_to_stdout_or_a_file(run, tmp_path):
    text = lua(orinkit.__version__, DEFAULT_PORT)
    assert run("dissector").out == text
    path = tmp_path / "bcap.lua"
    path.write_text("old")
    assert run("dissector", "--output", str(path)) == (0, "", "")
    assert path.read_text(encoding="utf-8") == text


def test_the_dissector_is_utf_8_in_any_environment(program):
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1", "ORINKIT_LANG": "ja"}
    done = subprocess.run([*program, "dissector"], env=environment, stdout=subprocess.PIPE, check=True)
    assert FUNCTIONS[1].ja in done.stdout.decode("utf-8")


def test_a_file_that_cannot_be_written(refused, tmp_path):
    assert refused("dissector", "--output", str(tmp_path / "no" / "bcap.lua"), code=2).startswith("--output ")


# --- --capture --------------------------------------------------------------------------------------------------------


@pytest.fixture(params=["tcp://127.0.0.1:0", "udp://127.0.0.1:0"])
def any_url(rc8, request) -> Iterator[str]:
    with orinkit.serve(rc8, request.param) as server:
        yield server.url


@needs_tshark
def test_every_packet_of_a_command_is_captured(run, any_url, capture):
    """The transcript of --trace shows the same packets."""
    traced = [line[4:] for line in run("info", any_url, "--trace", "--capture", str(capture)).err.splitlines()]
    texts = [line for line in traced if line[0] in "→←"]
    found = read(capture, any_url)
    assert found.experts == []
    assert [frame[-1] for frame in found.frames] == ["bcap"] * len(texts)
    assert all(any_url[:3] in frame for frame in found.frames)
    assert len(texts) > 20
    assert not any(each.malformed for each in found.packets)
    for text, info in zip(texts, found.infos, strict=True):
        arrow, _, meaning = text.partition(" ")
        assert (info if arrow == "→" else info.partition(": ")[2]) == meaning
    assert all(each.shows("bcap.response_in") or each.shows("bcap.request_in") for each in found.packets)


@pytest.mark.parametrize("words", ["get I1", "put I1 5", "call Controller_GetName", "call Service_Start"])
def test_every_command_that_connects_has_the_option(run, url, capture, words):
    name, *more = words.split()
    assert run(name, url, *more, "--capture", str(capture)).code == 0
    assert stat.S_IMODE(capture.stat().st_mode) == 0o600
    assert capture.read_bytes().startswith(b"\x0a\x0d\x0d\x0a")
    assert b"\x01\x10\0\0\0" in capture.read_bytes()  # a packet of 16 bytes


def test_an_existing_file_is_not_overwritten(refused, url, capture):
    capture.write_text("mine")
    assert "the file exists. Try: another name" in refused("get", url, "I1", "--capture", str(capture), code=2)
    assert capture.read_text() == "mine"


def test_a_file_that_cannot_be_created(refused, url, tmp_path):
    assert refused("get", url, "I1", "--capture", str(tmp_path / "no" / "x"), code=2).startswith("--capture ")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="requires /dev/full")
def test_a_full_disk_ends_the_command(refused, url, monkeypatch):
    from orinkit.cli._shared import capture as module

    monkeypatch.setattr(module, "_private", lambda _path, _flags: os.open("/dev/full", os.O_WRONLY))
    assert refused("get", url, "I1", "--capture", "x") == "cannot write x: No space left on device"


@needs_tshark
def test_an_interrupted_command_leaves_a_complete_file(run, when, capture):
    device = VirtualRC8(clock=Clock(20), language="en")

    def joint() -> float:
        joints = device.pendant.status()["joints"]
        assert isinstance(joints, list)
        return float(joints[0])

    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        when(lambda: joint() > 1, lambda: os.kill(os.getpid(), signal.SIGINT))
        done = run("move", server.url, "J(45,30,120,0,-60,0)", "--speed", "0.3", "--capture", str(capture))
        assert done.code == 130
    device.close()
    found = read(capture, server.url)
    assert found.experts == []
    assert not any(each.malformed for each in found.packets)
    assert found.infos[-1] == "Service_Stop: S_OK"
    assert any(info.startswith("Robot_Halt(") for info in found.infos)


@needs_tshark
def test_a_killed_command_leaves_its_packets(program, recorder_url, capture):
    """The packets are in the file as soon as they have been sent or received."""
    process = subprocess.Popen(
        [*program, "move", recorder_url, "J(1,2,3,4,5,6)", "--capture", str(capture)], stderr=subprocess.PIPE
    )
    try:
        until(lambda: (capture.exists() and capture.stat().st_size > 500) or process.poll() is not None)
    finally:
        process.kill()
        process.communicate()
    found = read(capture, recorder_url)
    assert found.packets != []
    assert not any(each.malformed for each in found.packets)


@needs_tshark
def test_bodies_of_http_are_captured_without_headers(run, rc8, capture):
    with orinkit.serve(rc8, "http://127.0.0.1:0", http=HttpOptions()) as server:
        assert run("get", server.url, "I1", "--capture", str(capture)).code == 0
    output = Tshark(capture.parent).run(capture, "-T", "fields", "-e", "tcp.payload")
    bodies = [bytes.fromhex(line) for line in output.splitlines()]
    assert bodies[0].startswith(b"Func=")
    assert len(bodies) % 2 == 0


@pytest.mark.parametrize(
    ("url", "transport", "local", "remote"),
    [
        ("tcp://127.0.0.1:5007", "tcp", "127.0.0.1", ("127.0.0.1", 5007)),
        ("udp://192.168.0.1:5008", "udp", "192.0.2.1", ("192.168.0.1", 5008)),
        ("tcp://[::1]:5007", "tcp", "::1", ("::1", 5007)),
        ("tcp://[fe80::1]:5007", "tcp", "2001:db8::1", ("fe80::1", 5007)),
        ("http://127.0.0.1", "tcp", "127.0.0.1", ("127.0.0.1", 80)),
        (f"tcp://{'x' * 64}:5007", "tcp", "192.0.2.1", ("192.0.2.2", 5007)),  # not a valid name
    ],
)
def test_the_addresses_in_a_capture(url, transport, local, remote):
    found = connection_of(parse_address(url))
    assert (found.transport, found.local, found.remote) == (transport, (local, 49152), remote)


def test_a_serial_line_is_captured_as_a_stream():
    assert connection_of(parse_address("serial:///dev/ttyUSB0")) is SERIAL_LINE
