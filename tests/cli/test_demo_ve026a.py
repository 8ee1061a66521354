"""demo ve026a: the procedure of VE026A 6.2, and the messages for wrong replies and late set-points."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from contextlib import redirect_stdout
from typing import Any

import pytest

from orinkit import Lateness
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.bcap.pcapng import SERIAL_LINE
from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.transcript import Transcript
from orinkit.cli.app import main
from orinkit.cli.demo import ve026a
from orinkit.virtual.ve026a import VirtualVE026A
from orinkit.virtual.ve026a.codes import SET_POINT_MISSED
from support.tshark import Tshark, assert_named, needs_tshark
from support.waiting import until


def test_the_procedure(run):
    done = run("demo", "ve026a")
    assert done.code == 0, done.err
    assert "A virtual VE026A listens at serial:///" in done.out
    assert "[VE026A 6.2 (5)]" in done.out
    assert "slvMove" in done.out
    assert "replies match the document" in done.out
    assert "more ..." in done.out


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    """The output as JSON; for several tests, because the demo is slow."""
    with redirect_stdout(io.StringIO()) as out:
        assert main(["demo", "ve026a", "--json"]) == 0
    document: dict[str, Any] = json.loads(out.getvalue())
    return document


def test_the_procedure_as_json(report):
    assert report["as_documented"] is True
    assert [step["number"] for step in report["steps"]] == [1, 2, 3, 4, 5, 6, 7]
    assert all(step["packets"] for step in report["steps"])


@needs_tshark
def test_tshark_names_every_packet(report, tmp_path):
    packets = [
        (">" if each["direction"] == "request" else "<", bytes.fromhex(each["bytes"]), SERIAL_LINE)
        for step in report["steps"]
        for each in step["packets"]
    ]
    found = Tshark(tmp_path).dissect(packets)
    assert_named(found, packets)
    assert all(each.shows("bcap.crc") for each in found.packets)


def test_no_picture(refused):
    assert "--picture is available for rc8 only" in refused("demo", "ve026a", "--picture", "x.png", code=2)


@pytest.mark.parametrize("reply", [Packet(1, 0x80004005, [], 1), Packet(2, 0, [], 1), Packet(1, 0, [], 0)])
def test_a_wrong_reply(reply):
    transcript = Transcript()
    transcript(">", packet.encode(Packet(1, 1, [], 1), crc=True))
    transcript("<", packet.encode(reply, crc=True))
    demo = ve026a.VE026ADemo(lambda _line: None, fields=False)
    with pytest.raises(CommandError, match="step"):
        demo._check(transcript.packets, "step")


@pytest.fixture
def arms(monkeypatch) -> list[VirtualVE026A]:
    """The arms that the demo creates."""
    made: list[VirtualVE026A] = []

    class Noted(VirtualVE026A):
        def __init__(self) -> None:
            super().__init__()
            made.append(self)

    monkeypatch.setattr("orinkit.virtual.ve026a.VirtualVE026A", Noted)
    return made


def test_the_wave_is_repeated_on_a_busy_computer(monkeypatch, arms):
    """A set-point is missing: the error is cleared, and the wave starts again at the current position."""
    output: list[str] = []
    wave, waves = ve026a.VE026ADemo._wave, []

    def torn(self, robot, angles):
        waves.append(angles)
        if len(waves) == 1:
            for cycle in range(1, 40):
                robot.execute("slvMove", [angles[0] + 0.002 * cycle**2, *angles[1:]])
            until(lambda: arms[0].error == SET_POINT_MISSED)
            robot.execute("slvMove", angles)
        return wave(self, robot, angles)

    monkeypatch.setattr(ve026a.VE026ADemo, "_wave", torn)
    report = ve026a.run(output.append, fields=False)
    assert len(waves) > 1
    assert waves[0][0] != waves[1][0]
    assert any("too busy" in line for line in output)
    assert [step["number"] for step in report["steps"]] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(("count", "reported"), [(0, False), (3, True)])
def test_late_set_points_are_reported(monkeypatch, count, reported):
    output: list[str] = []
    monkeypatch.setattr(VirtualVE026A, "set_point_lateness", property(lambda _: Lateness(count, 0.048, 0.1)))
    monkeypatch.setattr(ve026a.VE026ADemo, "_procedure", lambda *_: None)
    ve026a.run(output.append, fields=False)
    words = "3 late set-points, by up to 48 ms: this computer was too busy. A real VE026A would have stopped."
    assert any(words in line for line in output) is reported


def test_the_log_does_not_repeat_it():
    """Python writes warnings to stderr if logging is not configured."""
    script = """
import logging
from orinkit.cli.demo.rc8 import quiet_logs
with quiet_logs():
    logging.getLogger("orinkit.rc8").warning("unheard")
    logging.getLogger("orinkit.ve026a").warning("unheard")
logging.getLogger("orinkit.rc8").warning("heard")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True)
    assert (done.stdout, done.stderr) == ("", "heard\n")
