"""bench/: every piece runs with tiny counts and yields plausible results; files of results can be compared."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from orinkit import functions
from orinkit.bcap import packet
from support.paths import ROOT
from support.waiting import PATIENCE

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux only")


@pytest.fixture(autouse=True)
def _path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "bench"))


PIECES = """
import faulthandler
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import native
from arms import arms
from natural import natural
from results import Results
from server_load import server_load
from start_up import start_up

if __name__ == "__main__":
    faulthandler.dump_traceback_later(float(sys.argv[3]), exit=True)
    native.BUILD = Path(sys.argv[2]).parent
    results = Results()
    natural(1, 5, 2, results)
    server_load(0.05, results)
    arms(2, 0.2, results)
    start_up(1, results)
    results.write(Path(sys.argv[2]))
"""


def test_each_piece_measures(tmp_path: Path) -> None:
    script, file = tmp_path / "pieces.py", tmp_path / "results.csv"
    script.write_text(PIECES)
    command = [sys.executable, str(script), str(ROOT / "bench"), str(file), str(PATIENCE * 4)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE * 5, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {row.what: row for row in import_module("results").read(file)}
    for kind in ("sync", "asyncio"):
        for pace in ("back to back", "every 1 ms", "every 8 ms"):
            row = rows[f'robot.execute("slvMove", pose) ({kind}, pure), {pace}']
            assert row.value > 0
            assert row.reference
            assert row.ratio
    assert rows["server, requests/s, connections: 50"].value > 0
    assert rows["2 moving arms in one process, polled at 25 Hz: CPU"].value >= 0
    assert rows["orinkit --help (bare: python -c pass)"].value > 0


@pytest.mark.parametrize("compiler", [True, False])
def test_the_responder_copies_the_serial_and_replies_to_each_function(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], compiler: bool
) -> None:
    native: Any = import_module("native")
    packets: Any = import_module("packets")
    monkeypatch.setattr(native, "BUILD", tmp_path)
    if compiler:
        if not shutil.which("cc"):
            pytest.skip("requires a C compiler")
    else:
        monkeypatch.setattr(native.shutil, "which", lambda name: None)
    requests = {
        packets.encode_request(functions.robot_execute, packets.ARGUMENTS, 0x1234): packets.POSE,
        packets.encode_request(functions.variable_get_value, (4,), 0x4321): packets.VALUE,
        packets.encode_request(functions.variable_release, (4,), 7): None,
    }
    with native.responder() as (port, language), socket.create_connection(("127.0.0.1", port), PATIENCE) as peer:
        for request, value in requests.items():
            peer.sendall(request)
            reply = packet.decode(peer.recv(65536))
            assert reply.serial == packet.decode(request).serial
            assert list(reply.arguments) == ([] if value is None else [value])
    assert language == ("C" if compiler else "Python")
    assert ("No C compiler" in capsys.readouterr().out) is not compiler


def row(what: str, value: float, **more: Any) -> Any:
    return import_module("results").Row(what, value, "us", **more)


def test_results_are_the_same_after_writing_and_reading(tmp_path: Path) -> None:
    results = import_module("results")
    rows = [row("a, b", 1.5, p99=2.0, reference=1.0, ratio=1.5, added=0.5, goal="<= 2 x", met="met"), row("c", 0.25)]
    results.Results(rows).write(tmp_path / "x.csv")
    assert results.read(tmp_path / "x.csv") == rows


def test_two_runs_are_compared_by_name() -> None:
    before = [row("kept", 10.0, ratio=2.0), row("old", 1.0)]
    after = [row("kept", 5.0, ratio=1.0), row("new", 3.0)]
    _, kept, new, old = import_module("compare").compare(before, after)
    assert kept.split() == ["kept", "10.00", "us", "5.00", "us", "-50", "%", "2.00", "1.00"]
    assert new.split() == ["new", "-", "3.00", "us"]
    assert old.split() == ["old", "1.00", "us", "-"]


@pytest.mark.parametrize(
    ("label", "extension", "pace", "mine", "met"),
    [
        ("sync, pure", "off", "back to back", 14.4, True),  # less than 4.5 us are added
        ("sync, pure", "off", "back to back", 14.6, False),
        ("sync, pure", "off", "every 8 ms", 15.1, False),
        ("sync, extension", "in use", "back to back", 10.4, True),
        ("sync, extension", "in use", "back to back", 10.6, False),
        ("sync, extension", "in use", "every 8 ms", 10.9, True),
        ("asyncio, pure", "off", "back to back", 14.1, False),
        ("asyncio, extension", "in use", "back to back", 11.4, True),
        ("sync, pure", "off", "every 1 ms", 99.0, None),
    ],
)
def test_goals_are_those_of_the_kind_of_client(label: str, extension: str, pace: str, mine: float, met: Any) -> None:
    natural: Any = import_module("natural")
    client = natural.Client(label, None, extension)
    assert natural.judged(client, "execute", pace, mine / 10, mine - 10)[1] is met


def test_an_underflow_near_a_stall_is_explained() -> None:
    stream: Any = import_module("stream")
    stalls = import_module("stalls").Stalls()
    stalls.read(iter(["10.0 10.006", "20.0 20.001"]))
    outcome = stream.Outcome(dry=[10.1, 20.1, 30.0])
    assert outcome.unexplained(stalls, 0.004) == 2
    assert outcome.unexplained(stalls, 0.0005) == 1


def test_the_cpu_time_of_a_server_counts_only_if_it_answered() -> None:
    load: Any = import_module("server_load")
    assert load.Polled([0.001] * 100, 5.0, 2).complete
    unanswered = load.Polled([0.001] * 100, 5.0, 3)
    assert not unanswered.complete
    assert "3 requests were not sent or answered" in unanswered.note()
    assert load.Polled([0.001, 0.009], 5.0, 3).late == 4
