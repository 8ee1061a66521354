"""Forked children do not keep the connections of a program: if it is killed, its peers detect that at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import orinkit
from orinkit.core.errors import ConnectFailed, ConnectionLost
from orinkit.transport import fork_safety
from orinkit.virtual.rc8 import VirtualRC8
from support.both import only
from support.stopping import state_of
from support.waiting import PATIENCE, until

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")


class Echoing(orinkit.Device):
    """A device with a command that returns its argument, and one that waits."""

    provider_names = ("Test.Echo",)

    @orinkit.command("Echo")
    def echo(self, number: int) -> int:
        return number

    @orinkit.command("Wait")
    def wait(self, seconds: float) -> None:
        time.sleep(seconds)


CHILDREN = {
    "os.fork": """
    child = os.fork()
    if not child:
        time.sleep(600)
        os._exit(0)
""",
    "fork": """
    process = multiprocessing.get_context("fork").Process(target=time.sleep, args=(600,))
    process.start()
    child = process.pid
""",
    "spawn": """
    process = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(600,))
    process.start()
    child = process.pid
""",
    "subprocess": """
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], close_fds=False).pid
""",
}
BEGIN = "import asyncio, multiprocessing, os, orinkit, subprocess, sys, threading, time\nfrom orinkit import aio\n"
MOVING = """
def main(url):
    rc8 = orinkit.connect(url)
    robot = rc8.robot("Arm")
    robot.execute("TakeArm", [0, 0])
    robot.execute("ExtSpeed", 1)
    for angle in (150, -150) * 3:
        robot.move(1, orinkit.J(angle, 45, 90, 0, 45, 0), "NEXT")
{child}
    print(child, flush=True)
    time.sleep(600)
"""
MOVING_ASYNC = """
async def body(url):
    rc8 = await aio.connect(url)
    robot = await rc8.robot("Arm")
    await robot.execute("TakeArm", [0, 0])
    await robot.execute("ExtSpeed", 1)
    for angle in (150, -150) * 3:
        await robot.move(1, orinkit.J(angle, 45, 90, 0, 45, 0), "NEXT")
{child}
    print(child, flush=True)
    await asyncio.sleep(600)

def main(url):
    asyncio.run(body(url))
"""
END = "\nif __name__ == '__main__':\n    main(sys.argv[1])\n"


@contextmanager
def running(path: Path, program: str, argument: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program from a file, as multiprocessing's start method ``spawn`` requires."""
    path.write_text(BEGIN + program + END, encoding="utf-8")
    process = subprocess.Popen([sys.executable, path, argument], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("kind", ["sync", "async"])
@pytest.mark.parametrize("children", CHILDREN)
def test_a_killed_program_whose_child_lives(tmp_path, kind: str, children: str) -> None:
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    program = (MOVING if kind == "sync" else MOVING_ASYNC).replace("{child}", CHILDREN[children])
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0") as server,
        running(tmp_path / "a.py", program, server.url) as parent,
    ):
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        try:
            until(lambda: arm.queue.joints[0] > 0.1)
            parent.kill()
            until(lambda: not server.clients)
            until(lambda: arm.holder is None and not arm.busy)
            assert state_of(child) != "Z"
        finally:
            os.kill(child, signal.SIGKILL)
        assert arm.queue.joints[0] < 140


USING = """
def main(url):
    options = {"dialect": "rc8"} if url.startswith("serial") else {}
    rc8 = orinkit.connect(url, provider="Test.Echo", **options)
    busy = threading.Thread(target=lambda: rc8.execute("Wait", 2.0), daemon=True)
    busy.start()  # has the lock of the client when the child begins
    time.sleep(0.2)
    child = os.fork()
    if not child:
        for use in (lambda: rc8.execute("Echo", 1), lambda: rc8.variable("X"), rc8.client._fileno):
            try:
                use()
            except orinkit.OrinError as error:
                print("child:", type(error).__name__, "forked" in str(error), flush=True)
        rc8.close()
        rc8.client.close()
        sys.exit()
    os.waitpid(child, 0)
    busy.join()
    print("parent:", rc8.execute("Echo", 42), flush=True)
    rc8.close()
"""
USING_ASYNC = """
async def body(url):
    options = {"dialect": "rc8"} if url.startswith("serial") else {}
    rc8 = await aio.connect(url, provider="Test.Echo", **options)
    child = os.fork()
    if not child:
        for use in (lambda: rc8.execute("Echo", 1), lambda: rc8.variable("X")):
            try:
                use().__await__().send(None)
            except orinkit.OrinError as error:
                print("child:", type(error).__name__, "forked" in str(error), flush=True)
            except RuntimeError as error:  # no event loop runs in the child
                print("child:", error, flush=True)
        try:
            rc8.client._fileno()
        except orinkit.OrinError as error:
            print("child:", type(error).__name__, "forked" in str(error), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
    print("parent:", await rc8.execute("Echo", 42), flush=True)
    await rc8.close()

def main(url):
    asyncio.run(body(url))
"""


@pytest.mark.parametrize("kind", ["sync", "async"])
@only("tcp", "udp", "serial", "http", because="each link is left behind in its own way")
def test_a_child_that_uses_the_connection_is_told_and_its_parent_goes_on(tmp_path, listen_at: str, kind: str) -> None:
    program = USING if kind == "sync" else USING_ASYNC
    with (
        orinkit.serve(Echoing(), listen_at) as server,
        running(tmp_path / "a.py", program, server.url) as process,
    ):
        said, _ = process.communicate(timeout=PATIENCE)
    assert said.splitlines() == 3 * ["child: ConnectionClosed True"] + ["parent: 42"]
    assert process.returncode == 0


SERVING = """
from orinkit.virtual.rc8 import VirtualRC8

def main(url):
    server = orinkit.serve(VirtualRC8(), url)
    print(server.url, flush=True)
    sys.stdin.readline()
    child = os.fork()
    if not child:
        time.sleep(600)
        os._exit(0)
    print(child, flush=True)
    time.sleep(600)
"""


@only("tcp", "http", because="only TCP has connections that end")
def test_a_killed_server_whose_child_lives(tmp_path, listen_at: str) -> None:
    path = tmp_path / "a.py"
    path.write_text(BEGIN + SERVING + END)
    process = subprocess.Popen(
        [sys.executable, path, listen_at], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    child = 0
    try:
        with orinkit.connect(url, timeout=PATIENCE) as rc8:
            process.stdin.write("go\n")
            process.stdin.flush()
            child = int(process.stdout.readline())
            assert rc8.variable("I1").value == 0
            process.kill()
            process.wait()
            with pytest.raises((ConnectionLost, ConnectFailed)):  # HTTP: the next call opens a connection of its own
                rc8.execute("GetErrorCount")
        with orinkit.serve(VirtualRC8(), url):  # the port is free
            assert state_of(child) != "Z"
    finally:
        process.kill()
        if child:
            os.kill(child, signal.SIGKILL)
        process.communicate()


class Broken:
    """An object that cannot return its descriptors."""

    def after_fork_in_child(self) -> list[int]:
        raise ValueError


class Holding:
    """An object with descriptors."""

    def __init__(self, *descriptors: int) -> None:
        self.descriptors = descriptors

    def after_fork_in_child(self) -> tuple[int, ...]:
        return self.descriptors


@pytest.mark.parametrize("possible", [True, False])
def test_what_is_left_behind(monkeypatch: pytest.MonkeyPatch, possible: bool) -> None:
    """As in a child, descriptors become the null device, or are closed if no descriptor is available for it."""
    monkeypatch.setattr(fork_safety, "_kept", set())
    ends = os.pipe()
    for thing in (Broken(), Holding(-1, ends[0]), Holding(ends[1])):
        fork_safety.keep_from_children(thing)
    if not possible:

        def full(*_: object) -> int:
            raise OSError(24, "Too many open files")

        monkeypatch.setattr(os, "open", full)
    fork_safety._invalidate_in_child()
    assert not fork_safety._kept
    monkeypatch.undo()
    if possible:
        for end in ends:
            assert Path(f"/proc/self/fd/{end}").resolve() == Path(os.devnull)
            os.close(end)
    else:
        for end in ends:
            with pytest.raises(OSError):
                os.close(end)
