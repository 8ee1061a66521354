"""move and stream with a VE026A, which moves in slave mode only."""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

import orinkit
from orinkit.core import i18n
from orinkit.virtual.ve026a import VirtualVE026A
from support.waiting import until

HOME = (0.0, 30.0, 120.0, 0.0, 30.0, 0.0, 0.0)


@pytest.fixture
def arm() -> Iterator[VirtualVE026A]:
    device = VirtualVE026A(motor_seconds=0.05, clear_seconds=0.05)
    yield device
    device.close()


@pytest.fixture
def url(arm) -> Iterator[str]:
    with orinkit.serve(arm, "pty://") as server:
        yield server.url


def wave(path: Path, first: float, count: int = 60) -> str:
    """Write a trajectory that begins at an angle of J1, moves by 2 deg, and returns."""
    rows = [(first + 1 - math.cos(2 * math.pi * k / count), *HOME[1:]) for k in range(count + 1)]
    path.write_text("\n".join(["j1,j2,j3,j4,j5,j6,j7", *(",".join(f"{value:.6f}" for value in row) for row in rows)]))
    return str(path)


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_move_is_refused(refused, arm, url, lang):
    i18n.use(lang)
    line = refused("move", url, "J(10,30,120,0,30,0)")
    words = {"en": "a VE026A moves in slave mode only. Try: orinkit stream", "ja": "スレーブモードでのみ動作します"}
    assert words[lang] in line
    assert (arm.joints, arm.servo_on, arm.error) == (HOME, False, 0)


def test_stream_moves_it_to_the_first_set_point(run, refused, arm, url, tmp_path):
    file = wave(tmp_path / "wave.csv", 20.0)
    assert "--move" in refused("stream", url, file, code=2)
    assert arm.joints == HOME
    report = run("stream", url, file, "--move", "--json").json
    assert (report["set_points"], report["underflows"]) == (61, 0)
    assert arm.joints == pytest.approx((20.0, *HOME[1:]), abs=1e-3)
    assert (arm.servo_on, arm.slave_mode, arm.error) == (False, 0, 0)
    assert run("stream", url, file, "--move").code == 0  # it is already there


def test_speed_applies_to_the_approach(run, arm, url, tmp_path):
    path = tmp_path / "run.csv"
    assert (
        run("stream", url, wave(tmp_path / "wave.csv", 10.0), "--move", "--speed", "20", "--record", str(path)).code
        == 0
    )
    header, *lines = (line.split(",") for line in path.read_text().splitlines())
    place = header.index("J1_command")
    angles = [float(line[place]) for line in lines]
    assert angles[0] == pytest.approx(0.0, abs=0.1)
    assert max(abs(b - a) for a, b in pairwise(angles)) <= 180 * 0.2 * 0.008 * 1.001


def test_ctrl_c_during_the_approach(run, arm, url, tmp_path):
    def interrupt() -> None:
        until(lambda: arm.joints[0] > 2)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    done = run("stream", url, wave(tmp_path / "wave.csv", 80.0, 200), "--move", "--speed", "10")
    thread.join()
    assert done.code == 130
    assert "interrupted" in done.err
    assert 2 < arm.joints[0] < 70
    assert (arm.servo_on, arm.slave_mode, arm.error) == (False, 0, 0)
