"""Measure when the arm of a virtual RC8 stops after a client is lost: the table of docs/howto/lost-clients.md.

A client starts six long motions without waiting for them, or one that it waits for, and is then lost. The time is
measured from the loss to standstill. The unplugged cable is simulated with network namespaces, which requires root.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import orinkit
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8

PATIENT = 120.0
HOME = (-160.0, 45.0, 90.0, 0.0, 45.0, 0.0)
CONNECT = """
import orinkit, os, sys, time
from orinkit.values.poses import J
options = eval(sys.argv[2])
controller = orinkit.connect(sys.argv[1], **options)
robot = controller.robot("Arm")
robot.execute("TakeArm", [0, 0])
robot.execute("ExtSpeed", [5.0])
"""
CLIENT = f"""{CONNECT}
for angle in (-100, -40, 20, 60, 100, 140):
    robot.move(J(angle, 45, 90, 0, 45, 0), wait=False)
if len(sys.argv) > 3 and os.fork() == 0:
    time.sleep(300)
print("moving", flush=True)
time.sleep(300)
"""
WAITING = f"""{CONNECT}
print("moving", flush=True)
robot.move("J(140, 45, 90, 0, 45, 0)")
"""
CURL = """
import subprocess, sys, time
def call(body):
    out = subprocess.run(["curl", "-s", "-d", body, sys.argv[1]], capture_output=True, text=True, check=True).stdout.strip()
    assert out.startswith("0x0"), (body, out)
    return out.partition(",")[2]
call("Func=1,Arg1=")
controller = call("Func=3,Arg1=c,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=").split(",")[-1]
robot = call(f"Func=7,Arg1={controller},Arg2=Arm,Arg3=").split(",")[-1]
call(f"Func=64,Arg1={robot},Arg2=TakeArm,Arg3=")
call(f"Func=64,Arg1={robot},Arg2=ExtSpeed,Arg3=8197,5")
for angle in (-100, -40, 20, 60, 100, 140):
    call(f"Func=72,Arg1={robot},Arg2=1,Arg3=8,J({angle}, 45, 90, 0, 45, 0),Arg4=NEXT")
print("moving", flush=True)
time.sleep(300)
"""


@dataclass(frozen=True)
class Loss:
    """A way of losing a client.

    Attributes:
        text: Text for the table.
        url: URL to serve on.
        options: Options of connect(), as a Python literal.
        lose: Function that loses the client; its argument is the process of the client.
        program: Source of the client program.
        more: Further arguments of the client program.
        gateway: True if the client is behind a gateway.
    """

    text: str
    url: str
    lose: Callable[[subprocess.Popen[str]], None]
    options: str = "{}"
    program: str = CLIENT
    more: tuple[str, ...] = ()
    gateway: bool = False


def kill(client: subprocess.Popen[str]) -> None:
    """Kill the client."""
    client.kill()


def stop(client: subprocess.Popen[str]) -> None:
    """Stop the client, as a debugger does."""
    client.send_signal(signal.SIGSTOP)


def nothing(_: subprocess.Popen[str]) -> None:
    """Do nothing: the client sends no further requests."""


TCP, UDP, HTTP = (f"{scheme}://127.0.0.1:0" for scheme in ("tcp", "udp", "http"))
LOSSES = [
    Loss("TCP: process killed", TCP, kill),
    Loss("TCP: process killed, a forked child lives on", TCP, kill, more=("fork",)),
    Loss("TCP: process stopped", TCP, stop),
    Loss("TCP: process stopped, `alive=1.0`", TCP, stop, '{"alive": 1.0}'),
    Loss("UDP, no call in progress: process killed or stopped", UDP, kill),
    Loss("UDP, in a call that waits for a motion: process killed or stopped", UDP, kill, program=WAITING),
    Loss("the same, `alive=1.0`", UDP, kill, '{"alive": 1.0}', program=WAITING),
    Loss("serial line, no call in progress: process killed or stopped", "pty://", kill),
    Loss("serial line, in a call that waits for a motion: process killed or stopped", "pty://", kill, program=WAITING),
    Loss("the same, `alive=1.0`", "pty://", kill, '{"alive": 1.0}', program=WAITING),
    Loss("HTTP with a cookie: process killed", HTTP, kill),
    Loss("HTTP with a cookie, no call in progress: process stopped", HTTP, stop),
    Loss("HTTP with a cookie, in a call that waits for a motion: process stopped", HTTP, stop, program=WAITING),
    Loss("the same, `alive=1.0`", HTTP, stop, '{"alive": 1.0}', program=WAITING),
    Loss("HTTP without a cookie (curl, PLC): no further request", HTTP, nothing, program=CURL),
    Loss("TCP behind a gateway: process killed", TCP, kill, gateway=True),
    Loss("UDP behind a gateway: process killed or stopped", UDP, kill, gateway=True),
]


@contextmanager
def gateway_to(url: str, at: str) -> Iterator[str]:
    """Run a gateway; yield its address."""
    option = f"--{at.partition(':')[0]}"
    program = subprocess.Popen(
        [sys.executable, "-m", "orinkit", "gateway", "--upstream", url, option, "127.0.0.1:0"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert program.stdout is not None
        yield program.stdout.readline().split()[-1]
    finally:
        program.terminate()
        program.communicate()


def measured(loss: Loss) -> tuple[float | None, float]:
    """Lose a client; return the time to standstill in s (``None`` if the arm did not stop) and the distance in deg."""
    rc8 = VirtualRC8(clock=Clock(1.0), motor=True, joints=HOME)
    with orinkit.serve(rc8, TCP if loss.gateway else loss.url) as server:
        if loss.gateway:
            with gateway_to(server.url, loss.url) as url:
                return lost(loss, rc8, url)
        return lost(loss, rc8, server.url)


def lost(loss: Loss, rc8: VirtualRC8, url: str) -> tuple[float | None, float]:
    """Start a client, lose it, and return the result like :func:`measured`."""
    arm = rc8.state.arm
    client = subprocess.Popen(
        [sys.executable, "-c", loss.program, url, loss.options, *loss.more],
        stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert client.stdout is not None
        assert client.stdout.readline() == "moving\n"
        time.sleep(0.5)
        loss.lose(client)
        return until_rest(rc8, arm.queue.joints[0])
    finally:
        os.killpg(client.pid, signal.SIGKILL)
        client.wait()


def until_rest(rc8: VirtualRC8, start: float, seconds: float = PATIENT) -> tuple[float | None, float]:
    """Wait for standstill; return time in s (``None`` if all motions were executed) and distance in deg."""
    began = time.monotonic()
    arm = rc8.state.arm
    while time.monotonic() - began < seconds:
        time.sleep(0.002)
        with rc8.state.cycles:
            busy, joint = arm.busy, arm.queue.joints[0]
        if not busy:
            return (None if joint > 139 else time.monotonic() - began), joint - start
    raise AssertionError("the arm still moves")


# --- unplugged cable --------------------------------------------------------------------------------------------------

SPACE = "orinkit-loss"


def ip(*words: str) -> None:
    """Run the command ``ip``."""
    subprocess.run(["ip", *words], check=True, capture_output=True)


@contextmanager
def cable() -> Iterator[None]:
    """Create a network namespace for the client, connected by a virtual cable."""
    near, far = "orinkit0", "orinkit1"
    ip("netns", "add", SPACE)
    try:
        ip("link", "add", near, "type", "veth", "peer", "name", far, "netns", SPACE)
        ip("addr", "add", "10.243.7.1/24", "dev", near)
        ip("link", "set", near, "up")
        ip("-n", SPACE, "addr", "add", "10.243.7.2/24", "dev", far)
        ip("-n", SPACE, "link", "set", far, "up")
        yield
    finally:
        ip("netns", "del", SPACE)


def pulled() -> tuple[float | None, float]:
    """Unplug the cable of a TCP client, and return the result like :func:`measured`."""
    rc8 = VirtualRC8(clock=Clock(1.0), motor=True, joints=HOME)
    with cable(), orinkit.serve(rc8, "tcp://10.243.7.1:0") as server:
        client = subprocess.Popen(
            ["ip", "netns", "exec", SPACE, sys.executable, "-c", CLIENT, server.url, "{}"],
            stdout=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            assert client.stdout is not None
            assert client.stdout.readline() == "moving\n"
            time.sleep(0.5)
            ip("-n", SPACE, "link", "set", "orinkit1", "down")
            return until_rest(rc8, rc8.state.arm.queue.joints[0])
        finally:
            os.killpg(client.pid, signal.SIGKILL)
            client.wait()


def row(text: str, result: tuple[float | None, float]) -> None:
    """Print a row of the table."""
    seconds, degrees = result
    standstill = "not stopped: the motions are completed" if seconds is None else f"{seconds:.2f} s"
    print(f"| {text} | {standstill} | {degrees:.1f} |", flush=True)


def main() -> None:
    """Measure all losses and print the table."""
    print("| client lost | standstill after | J1 moved on by (deg, at 5 % speed) |\n|---|---|---|")
    with TemporaryDirectory() as folder:
        os.chdir(Path(folder))
        for loss in LOSSES:
            row(loss.text, measured(loss))
        if os.geteuid() == 0:
            row("TCP: cable pulled", pulled())


if __name__ == "__main__":
    main()
