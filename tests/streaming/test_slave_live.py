"""The arm stops safely if the program, the streaming process, the connection or the server fails."""

from __future__ import annotations

import gc
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Self

import pytest

import orinkit
from orinkit.core import hresult
from orinkit.core.errors import CallTimeout, ConnectionLost, OrinError, StreamError
from orinkit.values.poses import J
from support.paths import ROOT
from support.stopping import stopped
from support.stream_programs import came_to_rest, gone, program
from support.streams import HOME, PATIENCE, Arm, served
from support.waiting import until

pytestmark = pytest.mark.slow


@pytest.fixture
def arm() -> Iterator[Arm]:
    with served(joints=(0, 45, 90, 0, 45, 0)) as served_arm:
        yield served_arm


FEEDS = ["target", "push", "run"]


@pytest.mark.parametrize("feed", FEEDS)
def test_killed_program(arm: Arm, feed: str) -> None:
    with program(arm.url, feed) as (process, streamer):
        until(lambda: arm.arm.queue.joints[0] > 5)
        process.kill()
        until(arm.free)
        until(lambda: gone(streamer))
    came_to_rest(arm)


@pytest.mark.parametrize("feed", FEEDS)
def test_stopped_program(arm: Arm, feed: str) -> None:
    with program(arm.url, feed) as (process, streamer):
        until(lambda: arm.arm.queue.joints[0] > 5)
        with stopped(process.pid):
            until(arm.standing)
            came_to_rest(arm)
            assert arm.arm.holder is not None
        if feed != "target":  # the program sleeps
            output, errors = process.communicate(timeout=PATIENCE)
            assert "SIGSTOP" in output
            assert "StreamError" in errors
            until(lambda: gone(streamer))
    until(arm.free)
    assert arm.errors == []


@pytest.mark.parametrize("feed", FEEDS)
def test_exception_in_the_program(arm: Arm, feed: str) -> None:
    with program(arm.url, feed, "raise") as (process, streamer):
        output, errors = process.communicate(timeout=PATIENCE)
        assert "ended RuntimeError mine" in output
        assert "mine" in errors
        assert gone(streamer)
        until(arm.free)
    came_to_rest(arm)


@pytest.mark.parametrize("feed", FEEDS)
def test_ctrl_c(arm: Arm, feed: str) -> None:
    with program(arm.url, feed) as (process, streamer):
        until(lambda: arm.arm.queue.joints[0] > 5)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=PATIENCE)
        assert "ended KeyboardInterrupt" in output
        assert gone(streamer)
    until(arm.free)
    came_to_rest(arm)


@pytest.mark.skipif(signal.getsignal(signal.SIGHUP) is signal.SIG_IGN, reason="the tests run under nohup")
def test_the_terminal_is_closed(arm: Arm) -> None:
    """Both processes receive the signal; the program ends, and the streaming process stops the arm."""
    with program(arm.url, "run") as (process, streamer):
        until(lambda: arm.arm.queue.joints[0] > 5)
        os.kill(streamer, signal.SIGHUP)
        process.send_signal(signal.SIGHUP)
        until(arm.free)
        until(lambda: gone(streamer))
    came_to_rest(arm)


def test_terminated_streaming_process(arm: Arm) -> None:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor():
            with pytest.raises(StreamError, match="SIGTERM"), robot.slave_mode() as stream:
                stream.target = J(160, 45, 90, 0, 45, 0)
                until(lambda: arm.arm.queue.joints[0] > 5)
                assert stream._streaming is not None
                stream._streaming._process.terminate()
                until(lambda: stream.error is not None)
            assert robot.joints[0] > 5  # the connection still works
    came_to_rest(arm)


def test_killed_streaming_process(arm: Arm) -> None:
    """Only the controller can stop the arm, when it misses set-points or the connection."""
    with pytest.raises(OrinError), orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor(), robot.slave_mode() as stream:
            stream.target = J(160, 45, 90, 0, 45, 0)
            until(lambda: arm.arm.queue.joints[0] > 5)
            assert stream._streaming is not None
            stream._streaming._process.kill()
            until(lambda: stream.error is not None)
            assert isinstance(stream.error, StreamError)
            stream.target = J(*HOME)
    until(arm.free)
    assert arm.errors in ([], [hresult.COMMAND_DELAY])
    assert arm.within_limits()


class Cable:
    """A relay between client and server that can be cut silently: nothing passes, and the connections stay open."""

    def __init__(self, url: str) -> None:
        host, port = url.removeprefix("tcp://").split(":")
        self._server = host, int(port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self.cut = threading.Event()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with self._listener:
            near, _ = self._listener.accept()
        with near, socket.create_connection(self._server) as far:
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            others = {near: far, far: near}
            while not self._end.is_set():
                if self.cut.is_set():
                    self._end.wait()
                    return
                for end in select.select([near, far], [], [], 0.05)[0]:
                    data = end.recv(65536)
                    if not data:
                        return
                    others[end].sendall(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()


def test_cut_cable(arm: Arm) -> None:
    with Cable(arm.url) as cable, pytest.raises((CallTimeout, ConnectionLost)), orinkit.connect(cable.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor(), robot.slave_mode() as stream:
            stream.target = J(160, 45, 90, 0, 45, 0)
            until(lambda: arm.arm.queue.joints[0] > 5)
            cable.cut.set()
            until(lambda: stream.error is not None)
            stream.target = J(*HOME)
    until(arm.free)
    assert arm.errors in (
        [hresult.COMMAND_DELAY],
        [],
    )  # whichever is detected first: the late set-point or the lost client
    assert arm.within_limits()


def test_killed_server() -> None:
    command = [sys.executable, "-m", "orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0", "--motor-on"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            line = next(line for line in server.stdout if "tcp://" in line)
            url = "tcp://" + line.split("tcp://")[1].split()[0].rstrip(".,")
            with pytest.raises((ConnectionLost, StreamError)), orinkit.connect(url) as rc8:
                robot = rc8.robot()
                with robot.arm(), robot.motor(), robot.slave_mode() as stream:
                    stream.target = J(160, 45, 90, 0, 45, 0)
                    until(lambda: stream.latest.joints[0] > 5)
                    process = stream._streaming._process
                    server.kill()
                    until(lambda: stream.error is not None)
                    assert isinstance(stream.error, ConnectionLost)
                    stream.target = J(*HOME)
            assert process.returncode is not None
        finally:
            server.kill()


def children() -> set[str]:
    return {each.name for each in Path("/proc").iterdir() if each.name.isdigit() and _parent(each.name) == os.getpid()}


def _parent(pid: str) -> int:
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return -1


def left() -> tuple[int, int, set[str], int]:
    """Return the numbers of file descriptors, threads, child processes, and mappings of shared memory."""
    gc.collect()
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    mappings = Path("/proc/self/maps").read_text().count("orinkit-stream")
    return descriptors, threading.active_count(), children(), mappings


def enter_and_leave(arm: Arm, times: int) -> None:
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor():
            with robot.slave_mode() as stream:
                stream.target = J(0.1, 45, 90, 0, 45, 0)
            before = left()
            for number in range(times):
                with robot.slave_mode(mode=number % 3) as stream:
                    if number % 2:
                        stream.target = J(0.001 * number, 45, 90, 0, 45, 0)
            with suppress(AssertionError):
                until(lambda: left() == before)
            assert left() == before
    assert arm.errors == []


def test_nothing_is_left_of_a_streaming_process(arm: Arm) -> None:
    enter_and_leave(arm, 8)


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_nothing_is_left_of_five_hundred(arm: Arm) -> None:
    enter_and_leave(arm, 500)


BUSY = f"""
import sys
sys.path.insert(0, {str(ROOT / "bench")!r})
import stream
with stream.busy(int(sys.argv[2])):
    outcome = stream.ours(sys.argv[1], float(sys.argv[3]), 2)
for moment, text in outcome.failures:
    print("failure", moment, text)
print("underflows", outcome.underflows)
"""


def streamed_by_a_busy_program(url: str, threads: int, seconds: float) -> list[str]:
    """Stream from a program with threads that compute and produce garbage; return its output, the underflows last."""
    done = subprocess.run(
        [sys.executable, "-c", BUSY, url, str(threads), str(seconds)], stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout.splitlines()


@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.soak), 4])
def test_busy_threads_do_not_starve_the_arm(arm: Arm, threads: int) -> None:
    assert streamed_by_a_busy_program(arm.url, threads, 2.0) == ["underflows 0"]
    assert arm.errors == []
    assert arm.within_limits()


@pytest.mark.soak
@pytest.mark.parametrize("threads", [1, 4])
def test_busy_threads_make_nothing_late(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A short form of the ten minutes of ``make bench``, in strict time; stalls of the machine do not count."""
    monkeypatch.syspath_prepend(str(ROOT / "bench"))
    bench, stalls = import_module("stream"), import_module("stalls")
    with stalls.watched() as watched, bench.controller() as url:
        *failures, underflows = streamed_by_a_busy_program(url, threads, 20.0)
    moments = [float(line.split()[1]) for line in failures]
    excused = [moment for moment in moments if watched.between(moment - bench.NEAR_A_STALL, moment)]
    assert moments == excused
    assert underflows == "underflows 0"


def test_the_state_of_a_process_is_told(arm: Arm) -> None:
    any_of: Any = None
    with orinkit.connect(arm.url) as rc8:
        robot = rc8.robot()
        with robot.arm(), robot.motor(), robot.slave_mode() as stream:
            any_of = stream.real_time
    assert "priority" in str(any_of) or "優先度" in str(any_of)
