"""A keep-alive keeps a motor turning while the program is active, and no longer."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from decimal import Decimal
from typing import Any

import pytest

import can
from orinkit.can.frame import CanFrame
from orinkit.can.server import CanServer, serve_can
from orinkit.core.errors import ConnectionClosed, DriverTimeout, InvalidValue
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.abh3_wires import (
    FAST,
    PATIENCE,
    REQUEST,
    Hosts,
    Peer,
    Place,
    broadcast,
    line_of,
    obliging,
    only_on,
    process,
    rest,
    wait,
)
from support.both import Both
from support.stopping import stopped
from support.waiting import until

pytestmark = pytest.mark.slow

PATIENT = {"timeout": PATIENCE}
HOLDING = {"patience": PATIENCE}
"""Patience of keep-alives that must not end on a busy machine, in s."""
GO = 0x3003
STOP = "00EF0102#00 00 00 00 01 10 00 00"
"""Commands 0, servo on, start off."""


def at_rest(frame: can.Message) -> list[can.Message]:
    """Reply like a driver at standstill, without errors."""
    return [broadcast(0)] if frame.arbitration_id == REQUEST else obliging(frame)


@pytest.fixture
def device() -> VirtualABH3:
    """Return a driver that warns and stops without a latched error: any later command would move it again."""
    return VirtualABH3(Parameters(error_timeout=0, **FAST))


@pytest.fixture
def server(bare: Place, device: VirtualABH3) -> Iterator[CanServer]:
    with serve_can(device, at=bare.far) as served:
        yield served


@pytest.fixture
def driver(both: Both, hosts: Hosts, bare: Place, server: CanServer) -> Any:
    found = hosts.connect(bare.near, **PATIENT)
    both.run(found.set_inputs(GO))
    return found


def turned(device: VirtualABH3) -> int:
    return device.state().a_pulses


def stays_at_rest(device: VirtualABH3, seconds: float, both: Both | None = None) -> None:
    """Check that the motor stands still for a while."""
    until(lambda: not device.state().moving)
    before = turned(device)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        assert not device.state().moving
        if both is None:
            time.sleep(0.01)
        else:
            rest(both, 0.01)
    assert turned(device) == before


@only_on("udp_multicast", because="it is the same everywhere")
def test_stopping_takes_longer_than_the_patience(both: Both, hosts: Hosts, bare: Place) -> None:
    """The driver replies all the time: the keep-alive continues, and no time-out is raised."""
    device = VirtualABH3(Parameters(error_timeout=0, acceleration_time=0.01, deceleration_time=10.0))
    with serve_can(device, at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        both.run(driver.set_inputs(GO))
        both.run(driver.keep_alive(0.05, patience=1.0, idle=1.0))
        both.run(driver.command(500.0))
        wait(both, lambda: device.state().a_velocity == 500.0)
        both.run(driver.stop_and_wait(PATIENCE))  # 1.7 s
        assert driver.kept_alive
        both.run(driver.set_input("servo_on", 0))
        both.run(driver.close())


@only_on("slcan", "serial", because="the next test is over the network")
def test_a_motor_turns_without_calls(both: Both, device: VirtualABH3, driver: Any) -> None:
    both.run(driver.keep_alive(**HOLDING))
    assert driver.kept_alive
    both.run(driver.command(100.0))
    wait(both, lambda: device.state().a_velocity == 100.0)
    before = turned(device)
    wait(both, lambda: turned(device) - before > 380)  # 100 min^-1 are 427 pulses/s; a driver stops after half a second
    wait(both, lambda: device.state().a_velocity == 100.0)
    both.run(driver.command(0.0))
    wait(both, lambda: not device.state().moving)
    assert driver.kept_alive


@only_on("udp_multicast", because="three seconds are long")
def test_three_seconds(both: Both, device: VirtualABH3, driver: Any) -> None:
    both.run(driver.keep_alive(**HOLDING))
    both.run(driver.command(100.0))
    before = turned(device)
    wait(both, lambda: turned(device) - before > 1200)
    wait(both, lambda: device.state().a_velocity == 100.0)


@only_on("udp_multicast", because="the bus has no part in it")
def test_ending_it(both: Both, device: VirtualABH3, driver: Any) -> None:
    both.run(driver.keep_alive(**HOLDING))
    both.run(driver.command(100.0))
    wait(both, lambda: device.state().moving)
    driver.end_keep_alive()
    driver.end_keep_alive()
    assert not driver.kept_alive
    wait(both, lambda: device.state().warnings)
    stays_at_rest(device, 0.2, both)
    assert driver.commands == (100.0, 0.0)
    both.run(driver.keep_alive(0.05, **HOLDING))  # it can be started again, by calling it
    wait(both, lambda: device.state().moving)
    both.run(driver.keep_alive(0.2, **HOLDING))  # with other times
    rest(both, 0.3)
    assert [thread.name for thread in threading.enumerate()].count("orinkit-abh3-1") == (both.kind == "sync")


@only_on("udp_multicast", because="the bus has no part in it")
def test_invalid_numbers(both: Both, driver: Any) -> None:
    wrong: list[dict[str, Any]] = [
        {"period": 0},
        {"patience": -1.0},
        {"idle": float("nan")},
        {"period": float("inf")},
        {"period": "0.1"},
        {"idle": 3601},
        {"period": 0.5},  # a driver would stop before the second command
        {"patience": 0.1},
    ]
    for each in wrong:
        with pytest.raises(InvalidValue, match=next(iter(each))):
            both.run(driver.keep_alive(**each))
        assert not driver.kept_alive
    both.run(driver.keep_alive(Decimal("0.1"), **HOLDING))
    with pytest.raises(InvalidValue):
        both.run(driver.keep_alive(-1))
    assert driver.kept_alive  # the previous one continues


@only_on("udp_multicast", "slcan", because="the bus has no part in it")
def test_a_driver_that_stops_replying(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A stop is sent anyway; the next call raises, once; the commands are then 0."""
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    both.run(driver.set_inputs(GO))
    both.run(driver.keep_alive(0.05, **HOLDING))
    both.run(driver.command(100.0))
    peer.script = lambda _frame: []
    hosts.impatient(driver, patience=0.3)
    wait(both, lambda: not driver.kept_alive and peer.data[-1] == STOP)
    assert driver.commands == (0, 0)
    sent = len(peer.heard)
    rest(both, 0.3)
    assert len(peer.heard) == sent  # nothing more is sent
    peer.script = obliging  # it replies again
    with pytest.raises(DriverTimeout, match="keep_alive") as caught:
        both.run(driver.command(50.0))
    assert caught.value.seconds == 0.3
    assert len(peer.heard) == sent
    assert both.run(driver.command()).a_velocity == 0
    assert peer.data[-1] == STOP


@only_on("udp_multicast", because="the bus has no part in it")
@pytest.mark.parametrize("name", ["stop", "stop_and_wait", "init", "reset_errors"])
def test_safe_calls_are_carried_out_after_the_end(both: Both, hosts: Hosts, bare: Place, peer: Peer, name: str) -> None:
    """A call that stops the motor must not raise the time-out of the keep-alive instead."""
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    both.run(driver.set_inputs(GO))
    both.run(driver.keep_alive(0.05, **HOLDING))
    both.run(driver.command(100.0))
    peer.script = lambda _frame: []
    hosts.impatient(driver, patience=0.3)
    wait(both, lambda: not driver.kept_alive and peer.data[-1] == STOP)
    sent = len(peer.heard)
    peer.script = at_rest
    both.run(getattr(driver, name)())
    assert len(peer.heard) > sent
    assert driver.commands == (0, 0)
    assert "start" not in driver.inputs
    peer.script = obliging
    assert both.run(driver.command(50.0)).a_velocity == 50.0


@only_on("udp_multicast", because="the bus has no part in it")
def test_a_reply_to_a_keep_alive_that_is_read_late(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The program is suspended after a command: the reply that it reads later does not keep the motor going."""
    beats = threading.Semaphore(0)

    def slowly(frame: can.Message) -> list[can.Message]:
        if frame.data[:2] == b"\xf4\x01" and len(peer.heard) > 4:
            beats.release()
            time.sleep(0.1)
        return obliging(frame)

    peer.script = slowly
    driver = hosts.connect(bare.near, **PATIENT)
    both.run(driver.set_inputs(GO))
    both.run(driver.keep_alive(0.2, **HOLDING))
    both.run(driver.command(100.0))
    hosts.impatient(driver, patience=0.6)
    real = driver._port.receive

    def late(seconds: float) -> Any:
        if beats.acquire(blocking=False):
            time.sleep(0.7)  # suspends the whole program, as SIGSTOP does
        return real(seconds)

    driver._port.receive = late
    wait(both, lambda: not driver.kept_alive and driver.commands == (0, 0))
    driver._port.receive = real
    wait(both, lambda: peer.data[-1] == STOP)
    with pytest.raises(DriverTimeout, match="keep_alive"):
        both.run(driver.command(50.0))


@only_on("udp_multicast", because="the bus has no part in it")
def test_a_driver_that_replies_again_does_not_move(both: Both, bare: Place, hosts: Hosts, device: VirtualABH3) -> None:
    with serve_can(device, at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        both.run(driver.set_inputs(GO))
        both.run(driver.keep_alive(**HOLDING))
        both.run(driver.command(100.0))
        wait(both, lambda: device.state().moving)
    hosts.impatient(driver, patience=0.3)
    wait(both, lambda: not driver.kept_alive)
    again = VirtualABH3(Parameters(error_timeout=0, **FAST))
    with serve_can(again, at=bare.far):
        with pytest.raises(DriverTimeout, match="keep_alive"):
            both.run(driver.command(30.0))
        both.run(driver.set_inputs(GO))
        stays_at_rest(again, 0.3, both)
        both.run(driver.command(30.0))
        wait(both, lambda: again.state().moving)
        both.run(driver.close())


@only_on("virtual", because="the bus has no part in it")
def test_a_program_that_does_not_call(both: Both, hosts: Hosts, device: VirtualABH3, driver: Any) -> None:
    """With ``idle``, a program that hangs does not keep the motor turning."""
    both.run(driver.keep_alive(0.05, idle=PATIENCE, **HOLDING))
    both.run(driver.command(100.0))
    wait(both, lambda: device.state().moving)
    hosts.impatient(driver, idle=0.4)
    wait(both, lambda: not driver.kept_alive)
    wait(both, lambda: int(device.state().inputs) == 0x1001)  # a stop was sent; it did not stop by its time-out alone
    wait(both, lambda: not device.state().moving)
    assert driver.commands == (0, 0)
    assert list(driver.inputs) == ["ay_servo_on", "bx_servo_on"]
    assert both.run(driver.command()).a_velocity == 0  # not an error


@only_on("udp_multicast", because="the bus has no part in it")
def test_calls_restart_the_idle_time(both: Both, device: VirtualABH3, driver: Any) -> None:
    both.run(driver.keep_alive(0.05, idle=1.0, **HOLDING))
    both.run(driver.command(100.0))
    end = time.monotonic() + 1.4
    while time.monotonic() < end:
        called = driver._keep_alive_timer._called
        rest(both, 0.05)
        both.run(driver.pulses())
        assert driver._keep_alive_timer._called > called
    assert driver.kept_alive


@only_on("udp_multicast", because="the bus has no part in it")
def test_messages_restart_the_idle_time(both: Both, device: VirtualABH3, driver: Any) -> None:
    """They command nothing, but show that the program is active."""
    both.run(driver.keep_alive(0.05, idle=1.0, **HOLDING))
    both.run(driver.command(100.0))
    for call, address in [(driver.read_monitor, 0x1004), (driver.read_parameter, 0x4102)]:
        end = time.monotonic() + 1.2
        while time.monotonic() < end:
            called = driver._keep_alive_timer._called
            rest(both, 0.05)
            both.run(call(address))
            assert driver._keep_alive_timer._called > called
    assert driver.kept_alive
    assert driver.commands == (100.0, 0.0)


@only_on("udp_multicast", because="the bus has no part in it")
def test_closing_ends_it(both: Both, device: VirtualABH3, driver: Any) -> None:
    both.run(driver.keep_alive(0.02, **HOLDING))
    both.run(driver.command(100.0))
    wait(both, lambda: device.state().moving)
    both.run(driver.close())
    until(lambda: int(device.state().inputs) == 0x1001)
    assert not driver.kept_alive
    assert "orinkit-abh3-1" not in [thread.name for thread in threading.enumerate()]
    stays_at_rest(device, 0.2, both)
    with pytest.raises(ConnectionClosed):
        both.run(driver.command())


@only_on("udp_multicast", because="the bus has no part in it")
def test_a_collected_driver(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The keep-alive ends with the object."""
    peer.script = obliging
    bus = hosts.open_bus(bare.near)
    driver = bus.driver(**PATIENT)
    both.run(driver.keep_alive(0.02, **HOLDING))
    wait(both, lambda: len(peer.heard) > 3)
    keeper = driver._keep_alive_call
    del driver
    wait(both, lambda: keeper._task.done() if both.loop is not None else not keeper._thread.is_alive())
    both.run(
        bus.request_all(0, seconds=PATIENCE, count=1)
    )  # earlier frames have been received once this one gets a reply
    sent = len(peer.heard)
    rest(both, 0.3)
    assert len(peer.heard) == sent


@only_on("udp_multicast", because="the bus has no part in it")
def test_the_bus_is_lost(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A keep-alive never reopens it."""
    peer.script = obliging
    bus = hosts.open_bus(bare.near)
    driver = bus.driver(**PATIENT)
    both.run(driver.set_inputs(GO))
    both.run(driver.keep_alive(0.05, **HOLDING))
    both.run(driver.command(100.0))

    def gone(*_arguments: object) -> None:
        raise can.CanOperationError("gone")

    bus._line._bus._get = gone
    hosts.impatient(driver, patience=0.3)
    wait(both, lambda: not driver.kept_alive)
    assert bus._line.broken
    assert driver.commands == (0, 0)
    with pytest.raises(DriverTimeout, match="keep_alive"):
        both.run(driver.command(50.0))
    assert both.run(driver.command()).a_velocity == 0  # this call reopens it
    assert peer.data[-1] == STOP
    both.run(bus.close())


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("udp_multicast", because="the bus has no part in it")
def test_a_blocked_event_loop(both: Both, hosts: Hosts, device: VirtualABH3, driver: Any) -> None:
    """The motor stops, and does not start again when the loop continues."""
    both.run(driver.keep_alive(**HOLDING))
    both.run(driver.command(100.0))
    wait(both, lambda: device.state().moving)
    hosts.impatient(driver, patience=0.5)
    until(lambda: device.state().warnings and not device.state().moving)  # the loop is blocked
    stays_at_rest(device, 0.5, both)  # it continues
    assert not driver.kept_alive
    with pytest.raises(DriverTimeout, match="keep_alive"):
        both.run(driver.command())
    both.run(driver.command())
    stays_at_rest(device, 0.1, both)


@pytest.mark.parametrize("both", ["sync"], indirect=True)
@only_on("udp_multicast", because="the bus has no part in it")
def test_the_thread_that_began_it_ends(both: Both, device: VirtualABH3, driver: Any) -> None:
    def begins() -> None:
        driver.keep_alive(0.02, **HOLDING)
        driver.command(100.0)
        until(lambda: device.state().moving)

    thread = threading.Thread(target=begins)
    thread.start()
    thread.join()
    until(lambda: device.state().warnings)
    stays_at_rest(device, 0.3)
    assert not driver.kept_alive
    assert driver.commands == (0, 0)
    driver.set_input("correction", 1)  # does not concern motion
    stays_at_rest(device, 0.3)


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("udp_multicast", because="the bus has no part in it")
@pytest.mark.parametrize("begun", [True, False])
def test_its_task_is_cancelled(both: Both, device: VirtualABH3, driver: Any, begun: bool) -> None:
    """As in a program that cancels all its tasks, also before the task has started."""

    async def body() -> None:
        await driver.command(100.0)
        await driver.keep_alive(0.02, **HOLDING)
        if begun:
            await asyncio.sleep(0.1)
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        await asyncio.sleep(0.05)

    both.run(body())
    assert not driver.kept_alive
    assert driver.commands == (0, 0)
    wait(both, lambda: device.state().warnings)
    both.run(driver.set_input("correction", 1))
    stays_at_rest(device, 0.3, both)


@only_on("udp_multicast", because="the bus has no part in it")
def test_a_keep_alive_that_fails(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an internal error, the keep-alive has ended, and the commands are reset."""
    raised: list[object] = []
    monkeypatch.setattr(threading, "excepthook", lambda told: raised.append(told.exc_type))
    if both.loop is not None:
        both.loop.set_exception_handler(lambda _loop, _context: None)
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    both.run(driver.set_inputs(GO))
    both.run(driver.command(100.0))

    def fails(_seconds: float) -> Any:
        raise ZeroDivisionError

    monkeypatch.setattr(driver.host, "repeat", fails)
    both.run(driver.keep_alive(0.02, **HOLDING))
    wait(both, lambda: not driver.kept_alive and driver.commands == (0, 0))
    until(lambda: raised == ([ZeroDivisionError] if both.loop is None else []))  # the thread reports it last
    assert both.run(driver.set_input("correction", 1)).a_velocity == 0
    gc.collect()  # a task then reports that its exception was never retrieved


@pytest.mark.parametrize("both", ["sync"], indirect=True)
@only_on("udp_multicast", because="the bus has no part in it")
def test_a_call_that_takes_long(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A call that waits for a reply blocks the keep-alive: nothing is sent late afterwards."""
    peer.script = lambda frame: obliging(frame) if frame.arbitration_id == 0x00EF0102 else []
    driver = hosts.connect(bare.near, **PATIENT)
    driver.set_inputs(GO)
    driver.keep_alive(0.05, **HOLDING)
    driver.command(100.0)
    hosts.impatient(driver, patience=0.4)
    with hosts.in_vain(driver, 1.0), pytest.raises(DriverTimeout, match="reqBRD"):
        driver.pulses()
    until(lambda: not driver.kept_alive and peer.data[-1] == STOP)
    assert peer.heard[-2].arbitration_id == 0x00EA0102
    assert driver.commands == (0, 0)


# --- programs that end, in every way ----------------------------------------------------------------------------------

PROGRAM = """
import asyncio, sys, threading, time
from orinkit import abh3
from orinkit.abh3 import aio

url, kind, end = sys.argv[1:]
PATIENCE = 0.5  # of a keep-alive; nothing depends on it before the motor turns

def with_threads():
    driver = abh3.connect(url, timeout=10)
    driver.set_inputs(0x3003)
    driver.keep_alive(patience=10)
    driver.command(100.0, 100.0)
    driver._keep_alive_timer.patience = PATIENCE
    print("turning", flush=True)
    if end == "raises":
        threading.Thread(target=time.sleep, args=(60,)).start()
        time.sleep(0.5)
        raise RuntimeError("a bug")
    time.sleep(60)

async def with_tasks():
    driver = await aio.connect(url, timeout=10)
    await driver.set_inputs(0x3003)
    await driver.keep_alive(patience=10)
    await driver.command(100.0, 100.0)
    driver._keep_alive_timer.patience = PATIENCE
    print("turning", flush=True)
    if end == "raises":
        threading.Thread(target=time.sleep, args=(60,)).start()
        await asyncio.sleep(0.5)
        raise RuntimeError("a bug")
    await asyncio.sleep(60)

with_threads() if kind == "threads" else asyncio.run(with_tasks())
"""


@pytest.fixture(params=["threads", "tasks"])
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


def begins_to_turn(device: VirtualABH3, child: Any) -> None:
    assert line_of(child) == "turning"
    until(lambda: device.state().a_velocity == 100.0)


@only_on("udp_multicast", because="two processes share it")
@pytest.mark.parametrize("end", ["killed", "raises"])
def test_a_program_that_ends(bare: Place, device: VirtualABH3, server: CanServer, kind: str, end: str) -> None:
    """If it is killed, or its main thread raises while another thread continues, the motor stops."""
    with process("-c", PROGRAM, bare.near, kind, end) as child:
        begins_to_turn(device, child)
        began = time.monotonic()
        if end == "killed":
            child.kill()
        until(lambda: not device.state().moving)
        assert time.monotonic() - began < PATIENCE
        until(lambda: device.state().warnings)
        stays_at_rest(device, 0.3)
        if end == "raises":
            assert child.poll() is None  # the other thread is still running


@only_on("udp_multicast", because="two processes share it")
def test_a_program_that_is_stopped(bare: Place, device: VirtualABH3, server: CanServer, kind: str) -> None:
    """The motor stops, and does not start again when the program continues."""
    with process("-c", PROGRAM, bare.near, kind, "sleeps") as child:
        begins_to_turn(device, child)
        with stopped(child.pid):
            until(lambda: device.state().warnings and not device.state().moving)
            stays_at_rest(device, 0.2)
        stays_at_rest(device, 0.7)


class Stopping(VirtualABH3):
    """Stops a process that has sent a command before it reads the reply."""

    pid = 0

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.stack = ExitStack()

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        pid, self.pid = self.pid, 0
        if pid:
            self.stack.enter_context(stopped(pid))
        return super().receive(frame)


@only_on("udp_multicast", because="two processes share it")
def test_a_program_stopped_between_a_command_and_its_reply(bare: Place, kind: str) -> None:
    device = Stopping(Parameters(error_timeout=0, **FAST))
    with serve_can(device, at=bare.far), process("-c", PROGRAM, bare.near, kind, "sleeps") as child:
        begins_to_turn(device, child)
        with device.stack:
            device.pid = child.pid
            until(lambda: device.state().warnings and not device.state().moving)
        stays_at_rest(device, 0.7)
