"""``connect(alive=)``: the arm stops if the program that moves it is suspended, although its connection stays open."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

import orinkit
from orinkit.cao.dialect import RC8, VE026A
from orinkit.cao.service_options import read_options
from orinkit.client._shared.common import check_alive, with_alive
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue
from orinkit.gateway import RemoteProvider
from orinkit.server.threaded import Server
from orinkit.values.variant import variant
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.leaping import leap
from support.peers import RawClient
from support.stopping import stopped
from support.waiting import PATIENCE, until

EVERYWHERE = only("tcp", "udp", "serial", "http", because="each transport carries signs of life in its own way")
BEGIN = """
import asyncio, orinkit, sys, time
from orinkit import J, aio

def main():
    with orinkit.connect(sys.argv[1], dialect="rc8", alive=1.0) as rc8:
        robot = rc8.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        robot.execute("ExtSpeed", 1)
        print("moving", flush=True)
        try:
            robot.move(1, J(150, 45, 90, 0, 45, 0))
        except orinkit.CallError as error:
            print(error.info.name, flush=True)
        robot.execute("ExtSpeed", 100)
        robot.move(1, J(0, 45, 90, 0, 45, 0))
        print("moved", flush=True)
        sys.stdin.readline()

async def body():
    async with await aio.connect(sys.argv[1], dialect="rc8", alive=1.0) as rc8:
        robot = await rc8.robot("Arm")
        await robot.execute("TakeArm", [0, 0])
        await robot.execute("ExtSpeed", 1)
        print("moving", flush=True)
        task = asyncio.create_task(robot.move(1, J(150, 45, 90, 0, 45, 0)))
        await asyncio.sleep(0.3)
        if sys.argv[2] == "blocked":
            sys.stdin.readline()
        try:
            await task
        except orinkit.CallError as error:
            print(error.info.name, flush=True)
        await robot.execute("ExtSpeed", 100)
        await robot.move(1, J(0, 45, 90, 0, 45, 0))
        print("moved", flush=True)
        sys.stdin.readline()

main() if sys.argv[2] == "sync" else asyncio.run(body())
"""


@contextmanager
def program(url: str, kind: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program that moves the arm, and moves it again after an error reports that the arm was stopped."""
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN, url, kind], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "moving\n"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("kind", ["sync", "async"])
@EVERYWHERE
def test_a_stopped_program_stops_the_arm(listen_at: str, kind: str) -> None:
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with orinkit.serve(device, listen_at, alive=60.0) as server, program(server.url, kind) as process:
        until(lambda: arm.queue.joints[0] > 0.1)
        with stopped(process.pid):
            until(lambda: not arm.busy)
            stopped_at = arm.queue.joints[0]
            assert stopped_at < 100
            if listen_at.startswith(("tcp", "http")):
                assert arm.holder is not None  # the client may still continue
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == "STOPPED_DURING_PC_MOTION\n"
        assert process.stdout.readline() == "moved\n"
        assert arm.queue.joints[0] == pytest.approx(0.0)
        process.stdin.write("\n")
        process.stdin.flush()
        assert process.wait(PATIENCE) == 0


def test_a_blocked_event_loop_stops_the_arm() -> None:
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, program(server.url, "blocked") as process:
        until(lambda: arm.queue.joints[0] > 0.05)
        until(lambda: not arm.busy)
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("\n")
        process.stdin.flush()
        assert process.stdout.readline() == "STOPPED_DURING_PC_MOTION\n"
        assert process.stdout.readline() == "moved\n"


@only("tcp", "http", because="otherwise these keep a silent client")
def test_a_program_that_stays_stopped_loses_the_arm(listen_at: str) -> None:
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with orinkit.serve(device, listen_at) as server, program(server.url, "sync") as process:
        until(lambda: arm.queue.joints[0] > 0.1)
        with stopped(process.pid):
            until(lambda: not arm.busy)
            assert arm.holder is not None
            leap(server, 10.0)
            until(lambda: arm.holder is None)
            assert server.clients == 0


def test_through_a_gateway() -> None:
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with ExitStack() as stack:
        server = stack.enter_context(orinkit.serve(device, "tcp://127.0.0.1:0"))
        gateway = stack.enter_context(orinkit.serve(RemoteProvider(server.url), "tcp://127.0.0.1:0"))
        process = stack.enter_context(program(gateway.url, "sync"))
        until(lambda: arm.queue.joints[0] > 0.1)
        with stopped(process.pid):
            until(lambda: not arm.busy and arm.holder is None)


def test_the_log_names_the_silent_client(caplog: pytest.LogCaptureFixture) -> None:
    device = VirtualRC8(motor=True)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server, program(server.url, "sync") as process:
        until(lambda: device.state.arm.queue.joints[0] > 0.1)
        name = _client(server).name
        with stopped(process.pid):
            until(lambda: not device.state.arm.busy)
    assert f"{name}: silent for 1 s: its arm is stopped" in caplog.messages


@pytest.mark.parametrize("monitored", [True, False])
def test_silence_is_a_possible_cause_of_a_stop(both: Both, monitored: bool) -> None:
    """A program that did not request ``alive`` is not told about it."""
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        rc8 = both.connect(server.url, alive=1.0 if monitored else None)
        robot = both.run(rc8.robot("Arm"))
        both.run(robot.execute("TakeArm", [0, 0]))
        motion = both.run(robot.move(orinkit.J(150, 45, 90, 0, 45, 0), speed=1, wait=False))
        until(lambda: arm.queue.joints[0] > 0.1)
        if monitored:
            both.run(_fall_silent(rc8.client, both))
        else:
            with device.guard:
                arm.stop(hresult.STOPPED_DURING_PC_MOTION)
        until(lambda: not arm.busy)
        with pytest.raises(CallError) as stop:
            both.run(motion.wait())
        assert "halted by another client or program" in stop.value.detail
        assert ("by the server because this client was silent" in stop.value.detail) == monitored
        assert "silence of the client" in str(stop.value)
        both.run(rc8.close())


def _fall_silent(client: Any, both: Both) -> Any:
    """Stop the signs of life of a client, as if its program were suspended."""
    client._pulse.end()
    return _nothing() if both.loop is not None else None


async def _nothing() -> None:
    return None


def _client(server: Server) -> Any:
    (client,) = server._server._context.open
    return client


@EVERYWHERE
def test_the_motion_of_a_running_program_continues(both: Both, listen_at: str) -> None:
    """A client that waits for a long motion keeps it running: the interval of its option passes several times."""
    device = VirtualRC8(motor=True)
    arm = device.state.arm
    with orinkit.serve(device, listen_at) as server:
        rc8 = both.connect(server.url, alive=6.0)
        robot = both.run(rc8.robot("Arm"))
        both.run(robot.execute("TakeArm", [0, 0]))
        both.run(robot.execute("ExtSpeed", 1))
        seen: list[bool] = []

        def watch() -> None:
            until(lambda: arm.busy)
            for _ in range(3):
                time = server._loop.time()
                until(lambda time=time: _client(server).last_request_at > time)
                leap(server, 3.0)
                seen.append(arm.busy and arm.holder is not None)

        def skip() -> None:
            try:
                watch()
            finally:
                with device.guard:
                    arm.skip()

        thread = threading.Thread(target=skip)
        thread.start()
        both.run(robot.move(1, orinkit.J(150, 45, 90, 0, 45, 0)))
        thread.join()
        assert seen == [True] * 3
        both.run(rc8.close())


def test_the_option_of_service_start() -> None:
    assert with_alive("WDT=400", 1.0) == "WDT=400,Alive=1000"
    assert with_alive(None, 0.5) == "Alive=500"
    assert with_alive("WDT=400", None) == "WDT=400"
    assert read_options([variant("WDT=400,alive=1000")]).max_silence == 1.0
    assert read_options([variant("WDT=400")]).max_silence is None
    with pytest.raises(CallError) as refused:
        read_options([variant("Alive=100")])
    assert refused.value.code == hresult.E_INVALIDARG


@pytest.mark.parametrize("seconds", [0, 0.2, 3601, float("nan"), "1", True])
def test_invalid_seconds(both: Both, seconds: Any) -> None:
    with pytest.raises(InvalidValue, match="alive"):
        both.connect("tcp://127.0.0.1:1", alive=seconds)


def test_connections_without_the_option() -> None:
    check_alive(None, None, VE026A)
    check_alive(1.0, "WDT=400", RC8)
    with pytest.raises(InvalidValue, match="ve026a"):
        check_alive(1.0, None, VE026A)
    with pytest.raises(InvalidValue, match="cannot be combined with Alive in service="):
        check_alive(1.0, "WDT=400, Alive = 500", RC8)


def test_a_client_that_sends_only_the_option() -> None:
    """This is how a program appears whose machine fails: nothing moves, and the client is disconnected."""
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server, RawClient(server.url) as raw:
        raw.ask(1, "Alive=1000")
        leap(server, 5.0)
        assert server.clients == 1
        leap(server, 6.0)
        until(lambda: not server.clients)


@only("udp", "serial", because="on the others the watchdog and the signs of life do not interfere")
def test_no_watchdog_if_repeated_requests_are_the_signs_of_life(both: Both, listen_at: str) -> None:
    with (
        orinkit.serve(VirtualRC8(), listen_at) as server,
        pytest.raises(InvalidValue, match="Try: remove WDT"),
    ):
        both.connect(server.url, dialect="rc8", alive=2.0, service="WDT = 400")
