"""Interrupted calls, closing during calls, blocks that raise: the driver stops, and stays usable."""

from __future__ import annotations

import asyncio
import gc
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from orinkit.can.server import serve_can
from orinkit.core import i18n
from orinkit.core.errors import ConnectFailed, ConnectionClosed, DriverTimeout, InvalidValue, OrinError
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.abh3_wires import COMMAND, FAST, PATIENCE, Echo, Hosts, Peer, Place, arrived, obliging, only_on, turn
from support.both import Both
from support.waiting import interrupted_at, until

PATIENT = {"timeout": PATIENCE}
STOP = "00EF0102#00 00 00 00 01 10 00 00"
"""Commands 0, servo on, start off."""


@asynccontextmanager
async def timeout_when(condition: Callable[[], bool]) -> AsyncIterator[None]:
    """Time out when a condition becomes true."""
    async with asyncio.timeout(None) as scope:
        waiting = asyncio.create_task(_expire_when(condition, scope))
        try:
            yield
        finally:
            waiting.cancel()


async def _expire_when(condition: Callable[[], bool], scope: asyncio.Timeout) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:  # noqa: ASYNC110 - counted in a thread
        await asyncio.sleep(0.005)
    scope.reschedule(asyncio.get_running_loop().time())


# --- interrupted calls ------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
@pytest.mark.parametrize("both", ["sync"], indirect=True)
def test_ctrl_c_in_a_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The driver stays usable; the reply to the interrupted call is not taken as that to the next call."""
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    peer.script = lambda _frame: []

    def interrupt() -> None:
        until(lambda: peer.served == 2)
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        thread.start()
        driver.command(99.0)
    assert time.monotonic() - began < PATIENCE * 0.8
    assert driver.commands == (0, 0)
    thread.join()
    peer.send(*obliging(peer.heard[-1]))
    arrived(both, bare, driver, 1)
    peer.script = obliging
    assert driver.command(3.0).a_velocity == 3.0
    assert driver.pulses().a_pulses == 4


@pytest.mark.parametrize("both", ["async"], indirect=True)
def test_a_cancelled_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    peer.script = lambda _frame: []

    async def body() -> None:
        call = asyncio.create_task(driver.command(99.0))
        end = time.monotonic() + PATIENCE
        while peer.served < 2 and time.monotonic() < end:  # noqa: ASYNC110 - counted in a thread
            await asyncio.sleep(0.01)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        assert driver.commands == (0, 0)
        peer.send(*obliging(peer.heard[-1]))
        peer.script = obliging
        while not driver._port.frames and time.monotonic() < end:  # noqa: ASYNC110 - arrivals cannot be awaited
            await asyncio.sleep(0.01)
        assert (await driver.command(3.0)).a_velocity == 3.0
        peer.script = lambda _frame: []
        with pytest.raises(TimeoutError):
            async with timeout_when(lambda: peer.served == 4):
                await driver.command(4.0)
        peer.script = obliging
        assert (await driver.pulses()).a_pulses == 4

    both.run(body())


# --- closing ----------------------------------------------------------------------------------------------------------


def test_closing_the_bus_ends_a_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    bus = hosts.open_bus(bare.near)
    driver = bus.driver(timeout=0.2)

    async def calls() -> object:
        try:
            return await both.now(driver.command(1.0))
        except OrinError as error:
            return type(error)

    async def closes() -> float:
        end = time.monotonic() + PATIENCE
        while not peer.heard and time.monotonic() < end:
            await both.now(asyncio.sleep(0.01) if both.loop else time.sleep(0.01))  # noqa: ASYNC251 - in the thread
        began = time.monotonic()
        await both.now(bus.close())
        return time.monotonic() - began

    called, took = both.side_by_side(calls(), closes())
    assert called in (DriverTimeout, ConnectionClosed)
    assert took < PATIENCE * 0.8
    with pytest.raises(ConnectionClosed):
        both.run(driver.command())
    assert driver.commands == (0, 0)


@only_on("virtual", "udp_multicast", because="it is the same everywhere")
@pytest.mark.parametrize("kept", [False, True])
def test_closing_the_bus_stops_its_drivers(both: Both, hosts: Hosts, bare: Place, kept: bool) -> None:
    """They would not stop on their own: their time-outs are off."""
    devices = [VirtualABH3(Parameters(address=each, command_timeout=0, error_timeout=0, **FAST)) for each in (1, 7, 9)]
    drivers: list[Any] = []

    def body(bus: Any) -> None:
        drivers.extend(bus.driver(address=device.parameters.address, **PATIENT) for device in devices)
        for driver in drivers[:2]:
            if kept:
                both.run(driver.keep_alive(0.02, patience=PATIENCE))
            turn(both, driver)
        until(lambda: all(device.state().moving for device in devices[:2]))

    with serve_can(*devices, at=bare.far):
        both.within(hosts.opening_bus(bare.near), body)
        until(lambda: [int(device.state().inputs) for device in devices] == [0x1001, 0x1001, 0])
        until(lambda: not any(device.state().moving for device in devices))
    for driver in drivers:
        assert not driver.kept_alive
        assert driver.commands == (0, 0)
        with pytest.raises(ConnectionClosed):
            both.run(driver.command())


@only_on("udp_multicast", because="it is the same everywhere")
def test_closing_stops_the_driver_before_joining_the_keep_alive(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second Ctrl-C interrupts the closing by the first one: the stop has been sent by then."""
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    turn(both, driver)
    both.run(driver.keep_alive(0.02, patience=PATIENCE))
    told: list[str] = []

    def interrupted(keeper: Any) -> None:
        until(lambda: peer.data[-1] == STOP)  # nothing else would send it now
        told.append(peer.data[-1])
        real(keeper)
        raise KeyboardInterrupt

    real = type(driver._keep_alive_call).join
    monkeypatch.setattr(type(driver._keep_alive_call), "join", interrupted)
    with pytest.raises(KeyboardInterrupt):
        both.run(driver.close())
    assert told == [STOP]
    assert driver.closed
    with pytest.raises(ConnectionClosed):
        both.run(driver.bus.request_all(0))


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("udp_multicast", "virtual", because="it is the same everywhere")
def test_a_cancelled_close_still_closes(
    both: Both, hosts: Hosts, bare: Place, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The block is cancelled while it waits for the reply of a silent driver to the stop."""
    monkeypatch.setattr("orinkit.abh3.api._async.driver._GOODBYE", PATIENCE)  # longer than until the cancellation
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    turn(both, driver)
    peer.script = lambda _frame: []

    async def body() -> None:
        task = asyncio.create_task(driver.close())
        while peer.data[-1] != STOP:  # noqa: ASYNC110 - counted in a thread
            await asyncio.sleep(0.001)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    both.run(body())
    assert driver.closed
    with pytest.raises(ConnectionClosed):
        both.run(driver.bus.request_all(0))


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
@pytest.mark.parametrize("both", ["sync"], indirect=True)
def test_stopping_in_a_signal_handler(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A call of the same thread waits for a reply that never arrives: the handler does not wait for it."""
    peer.script = obliging
    driver = hosts.connect(bare.near, timeout=PATIENCE)
    turn(both, driver)
    asked = len(peer.heard)
    unanswered = 400.0
    peer.script = lambda frame: [] if frame.data[:2] == bytes((0xD0, 0x07)) else obliging(frame)
    stopped: list[Any] = []

    def handler(*_arguments: object) -> None:
        began = time.monotonic()
        stopped.extend((driver.stop(), time.monotonic() - began))
        raise KeyboardInterrupt  # ends the pending call

    before = signal.signal(signal.SIGUSR1, handler)
    main = threading.main_thread().ident or 0
    thread = threading.Thread(
        target=lambda: (until(lambda: len(peer.heard) > asked), signal.pthread_kill(main, signal.SIGUSR1))
    )
    try:
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            driver.command(unanswered)
    finally:
        thread.join()
        signal.signal(signal.SIGUSR1, before)
    assert stopped[0].a_velocity == 0
    assert stopped[1] < PATIENCE * 0.8
    assert peer.data[-1] == STOP
    assert driver.commands == (0, 0)
    assert driver.command(3.0).a_velocity == 3.0


# --- objects ----------------------------------------------------------------------------------------------------------


def test_one_object_for_a_driver(both: Both, hosts: Hosts, bare: Place) -> None:
    """Two objects would not know each other's commands; a second host address is another driver object."""
    bus = hosts.open_bus(bare.near)
    driver = bus.driver(address=7)
    for tongue, text in (("en", "ABH3 7 already has a driver object on this bus. Try"), ("ja", "アドレス 7 の ABH3")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            bus.driver(address=7, dialect="v2")
    other = bus.driver(address=8)
    second = bus.driver(address=7, host=3)
    both.run(driver.close())
    again = bus.driver(address=7)  # the first one is closed
    both.run(again.close())
    del again
    assert not other.closed
    assert not second.closed


@only_on("virtual", "udp_multicast", because="it is the same everywhere")
def test_collected_objects_leave_nothing_behind(both: Both, hosts: Hosts, bare: Place) -> None:
    bus = hosts.open_bus(bare.near)
    kept = bus.driver(address=1)
    for number in range(500):
        bus.driver(address=4 + number % 200)
    if both.loop is not None:
        both.run(asyncio.sleep(0))
    assert len(bus._line._ports) == 1
    assert list(bus._members) == [kept]
    gone = bus.driver(address=3)
    del gone
    bus.driver(address=3)  # the other one was collected


@pytest.mark.parametrize("both", ["sync"], indirect=True)
@only_on("virtual", because="it is the same everywhere")
def test_an_object_may_be_collected_at_any_moment(both: Both, hosts: Hosts, bare: Place) -> None:
    """The garbage collector may run inside the shared bus, in the same thread, without a deadlock."""
    bus = hosts.open_bus(bare.near)
    done = threading.Event()

    def collects() -> None:
        driver = bus.driver()
        driver.itself = driver  # a cycle, as with the frame of an exception
        del driver
        with bus._line._lock:
            gc.collect()
        done.set()

    threading.Thread(target=collects, daemon=True).start()
    assert done.wait(PATIENCE / 2)
    assert bus._line._ports == ()


# --- Ctrl-C at every point --------------------------------------------------------------------------------------------


OURS = (
    "_sync/driver.py",
    "_sync/shared.py",
    "session/host.py",
    "orinkit/can/shared_bus.py",
    "orinkit/can/bus.py",
    "table/frames.py",
    "threading.py",
)


@pytest.mark.parametrize("both", ["sync"], indirect=True)
@pytest.mark.parametrize("name", ["command", "pulses", "stop"])
@only_on("udp_multicast", because="the queues of virtual buses are of Python itself, and do not stand that")
def test_ctrl_c_at_every_point(both: Both, hosts: Hosts, bare: Place, name: str) -> None:
    """No lock stays held, and no thread stays registered as reading: the next call succeeds."""
    with serve_can(Echo(1), at=bare.far):
        driver = hosts.connect(bare.near, timeout=PATIENCE)
        line = driver.bus._line
        call = {"command": lambda: driver.command(100.0, 50.0), "pulses": driver.pulses, "stop": driver.stop}[name]
        points = 0
        while interrupted_at(points + 1, call, OURS):
            points += 1
            assert points < 1000
            assert (line._reader, line._waiting) == (None, []), points
            assert both.side_by_side(_sends(driver)) == [True], points  # from another thread
            assert driver.command(7.0, 0.0).a_velocity == 7.0, points
        assert points > 20
        both.run(driver.close())


async def _sends(driver: Any) -> bool:
    return bool(driver.stop().y_velocity == 1)


@pytest.mark.parametrize("both", ["sync"], indirect=True)
@only_on("udp_multicast", because="it is the same everywhere")
def test_ctrl_c_at_every_point_of_closing(both: Both, hosts: Hosts, bare: Place) -> None:
    """It can be closed again afterwards."""
    with serve_can(Echo(1), at=bare.far):
        points = 0
        while True:
            driver = hosts.connect(bare.near, timeout=PATIENCE)
            driver.command(100.0)
            interrupted = interrupted_at(points + 1, driver.close, OURS)
            driver.close()
            driver.bus.close()
            with pytest.raises(ConnectionClosed):
                driver.command()
            if not interrupted:
                break
            points += 1
            assert points < 1000
        assert points > 10


@only_on("virtual", "serial", because="it takes a time-out")
def test_closing_a_driver_while_a_call_waits(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The call ends first; then the driver is stopped and closed."""
    driver = hosts.connect(bare.near, init=False, timeout=0.2)

    async def calls() -> object:
        try:
            return await both.now(driver.command(1.0))
        except OrinError as error:
            return type(error)

    async def closes() -> None:
        end = time.monotonic() + PATIENCE
        while not peer.heard and time.monotonic() < end:
            await both.now(asyncio.sleep(0.01) if both.loop else time.sleep(0.01))  # noqa: ASYNC251 - in the thread
        await both.now(driver.close())

    called, _ = both.side_by_side(calls(), closes())
    assert called in (DriverTimeout, ConnectionClosed)
    both.run(driver.close())
    with pytest.raises(ConnectionClosed):
        both.run(driver.command())


def test_a_block_that_raises_stops_the_motor(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging

    def body(driver: Any) -> None:
        turn(both, driver)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        both.within(hosts.opening(bare.near, **PATIENT), body)
    until(lambda: peer.data[-1] == STOP)
    assert [data for data in peer.data if data.startswith(f"{COMMAND:08X}")][-2] == "00EF0102#f4 01 f4 01 03 30 00 00"


@only_on("udp_multicast", because="it is the same everywhere")
def test_closing_stops_commanded_drivers_only(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    for calls, frames in [([], 1), (["servo_on"], 2), (["start"], 3)]:
        peer.heard.clear()
        driver = hosts.connect(bare.near, **PATIENT)
        for name in calls:
            both.run(driver.set_input(name, 1))
        both.run(driver.close())
        both.run(driver.close())
        until(lambda frames=frames: len(peer.heard) >= frames)
        assert len(peer.heard) == frames
    assert peer.data[-1] == "00EF0102#00 00 00 00 00 00 00 00"


@only_on("udp_multicast", because="it is the same everywhere")
def test_closing_waits_briefly_for_a_silent_driver(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    turn(both, driver)
    peer.script = lambda _frame: []
    began = time.monotonic()
    both.run(driver.close())
    assert time.monotonic() - began < PATIENCE * 0.8
    until(lambda: peer.data[-1] == STOP)


@only_on("udp_multicast", because="it is the same everywhere")
def test_closing_stops_a_driver_whose_reply_was_lost(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The commands are reset, but the state of the driver is unknown."""
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    turn(both, driver)
    peer.script = lambda _frame: []
    with hosts.in_vain(driver, 0.1), pytest.raises(DriverTimeout):
        both.run(driver.command())
    assert driver.commands == (0, 0)
    peer.script = obliging
    before = len(peer.heard)
    both.run(driver.close())
    until(lambda: len(peer.heard) > before)
    assert peer.data[-1] == STOP


@only_on("udp_multicast", because="it is the same everywhere")
def test_opening_without_a_driver_leaves_nothing_open(both: Both, hosts: Hosts, bare: Place) -> None:
    with pytest.raises(DriverTimeout, match="cmd_init"):
        hosts.connect(bare.near, timeout=0.1)


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("virtual", "serial", because="a thread reads for the loop; there is a port to let go of")
def test_cancelled_opening_leaves_nothing_open(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    async def body() -> None:
        with pytest.raises(TimeoutError):
            async with timeout_when(lambda: peer.served == 1):
                await hosts.opening(bare.near, **PATIENT)

    both.run(body())
    peer.script = obliging
    assert both.run(hosts.connect(bare.near, **PATIENT).command(1.0)).a_velocity == 1.0


@pytest.mark.parametrize(
    ("at", "kind"),
    [
        ("can://slcan/{folder}/nothing", ConnectFailed),
        ("can://serial/{folder}/nothing", ConnectFailed),
        ("tcp://127.0.0.1:5007", ValueError),
        ("can://no-such-interface/0", ValueError),
    ],
)
def test_buses_that_cannot_be_opened(both: Both, hosts: Hosts, tmp_path: Path, at: str, kind: type) -> None:
    with pytest.raises(kind, match=r"Try|CAN bus|no interface"):
        hosts.connect(at.format(folder=tmp_path))
