"""The emergency stop of the pendant is confirmed promptly, regardless of the load on the server (``make soak``)."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from support.paths import ROOT

sys.path.insert(0, str(ROOT / "bench"))
import orinkit
from orinkit import J
from stalls import watched
from support.attacked import Attackers, Crowd, Served, served
from support.attackers import ATTACKS

pytestmark = pytest.mark.soak

SECONDS = 30.0
LIMIT = 0.1  # s
VELOCITY = 425.0  # deg/s of J1, the fastest motion of the tests
TIMES = [(name,) for name in ATTACKS] + [tuple(ATTACKS)]


def presses(target: Served, pendant: orinkit.Controller, seconds: float) -> list[tuple[float, float]]:
    """Press and release the emergency stop; return the time of each press, and the delay of its reply."""
    found = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        began = time.monotonic()
        pendant.execute("EmergencyStop", True)
        found.append((began, time.monotonic() - began))
        pendant.execute("EmergencyStop", False)
        time.sleep(0.05)
    return found


@pytest.mark.timeout(900)
@pytest.mark.parametrize("clients", [0, 50])
@pytest.mark.parametrize("names", TIMES, ids=["+".join(names) for names in TIMES])
def test_the_emergency_stop_is_answered(tmp_path: Path, names: tuple[str, ...], clients: int) -> None:
    with served(tmp_path) as target, target.pendant() as pendant:
        pendant.execute("EmergencyStop", False)
        with watched() as stalls, Crowd(target, clients) as crowd, Attackers(target, names) as attackers:
            time.sleep(2)
            began = time.monotonic()
            found = presses(target, pendant, SECONDS)
            ended = time.monotonic()
        seen = stalls.between(began, ended)
        stalled = [each for each in found if any(s.begin < each[0] + each[1] and s.end > each[0] for s in seen)]
        taken = sorted(each[1] for each in found if each not in stalled)
        percentiles = [
            f"{part}: {taken[int(len(taken) * share)] * 1e3:.1f} ms" for part, share in (("p50", 0.5), ("p99", 0.99))
        ]
        print(
            f"\n{'+'.join(names)}, {clients} clients: {len(found)} presses, {', '.join(percentiles)}, longest {taken[-1] * 1e3:.1f} ms"
        )
        print(f"  {len(stalled)} presses during stalls of the machine; {stalls.text(began, ended)}")
        print(f"  attackers: {attackers.did}; clients: {crowd.calls} calls, slowest {crowd.slowest:.2f} s")
        assert len(taken) > 50
        assert taken[-1] < LIMIT
        assert crowd.errors == []
        assert target.process.poll() is None


def stopping(target: Served, pendant: orinkit.Controller) -> tuple[float, float, float]:
    """Press the emergency stop during a fast motion of J1.

    Returns:
        The times before and after the press, and the angle by which J1 has moved since a position before the press.
    """
    pendant.execute("EmergencyStop", False)
    pendant.execute("ClearErrors")
    pendant.execute("Motor", [True, True])
    with target.connect() as controller, controller.robot() as robot, robot.arm():
        robot.move(J(-150, 45, 90, 0, 45, 0))
        motion = robot.move(J(150, 45, 90, 0, 45, 0), speed=100, wait=False)
        while robot.joints[0] < -140:  # the motion has begun
            pass
        began, position = time.monotonic(), robot.joints[0]
        pendant.execute("EmergencyStop", True)
        ended = time.monotonic()
        with suppress(orinkit.OrinError):
            motion.wait()
        return began, ended, robot.joints[0] - position


@pytest.mark.timeout(900)
def test_the_arm_stops_under_attack(tmp_path: Path) -> None:
    names = tuple(name for name in ATTACKS if name.startswith("pipelined"))
    with served(tmp_path) as target, target.pendant() as pendant, watched() as stalls:
        idle = max(stopping(target, pendant)[2] for _ in range(3))
        with Attackers(target, names) as attackers:
            time.sleep(2)
            found = [stopping(target, pendant) for _ in range(10)]
        angles = [angle for began, ended, angle in found if not stalls.between(began, ended)]
        print(f"\nJ1 moves {idle:.1f} deg after the press without attackers, {max(angles):.1f} deg under attack")
        print(f"  {len(found) - len(angles)} presses during stalls of the machine; attackers: {attackers.did}")
        assert angles
        assert max(angles) < idle + VELOCITY * LIMIT
