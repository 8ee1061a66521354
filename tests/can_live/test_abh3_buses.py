"""Buses that die and come back; calls that are broken off; closing while others wait."""

from __future__ import annotations

import asyncio
import queue
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest
from abh3_wires import (
    COMMAND,
    FAST,
    PATIENCE,
    Hosts,
    Peer,
    Place,
    arrived,
    message,
    obliging,
    only_on,
    rest,
    until,
    wait,
)

from both import Both
from orinkit import language
from orinkit.errors import ConnectFailed, ConnectionClosed, ConnectionLost, DriverTimeout, InvalidValue, OrinError
from orinkit.server.can_server import serve_can
from orinkit.virtual.abh3 import Parameters, VirtualABH3

PATIENT = {"timeout": PATIENCE}
REST = "00EF0102#00 00 00 00 03 30 00 00"
"""Commands 0, servo and start on."""
STOP = "00EF0102#00 00 00 00 01 10 00 00"
"""Commands 0, servo on, start off."""


def turn(both: Both, driver: Any) -> None:
    """Have both motors turn."""
    both.run(driver.set_input("servo_on", 1))
    both.run(driver.set_input("start", 1))
    both.run(driver.command(100.0, 100.0))


def stands(device: VirtualABH3, seconds: float, both: Both) -> bool:
    """Whether the motors do not move for a while, and nothing asks them to."""
    before = device.state()
    rest(both, seconds)
    after = device.state()
    return (
        not before.moving
        and not after.moving
        and (before.a_pulses, before.b_pulses) == (after.a_pulses, after.b_pulses)
        and after.ay_velocity_command == 0
    )


# --- adapters that are unplugged --------------------------------------------------------------------------------------


@only_on("slcan", "serial", because="adapters can be unplugged")
def test_an_adapter_that_is_unplugged(both: Both, hosts: Hosts, bare: Place, caplog: pytest.LogCaptureFixture) -> None:
    """Calls say so; when it is back the next call works by itself, and nothing moves by itself."""
    device = VirtualABH3(Parameters(error_timeout=0, **FAST))
    with serve_can(device, at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        turn(both, driver)
        wait(both, lambda: both.run(driver.command()).a_velocity == 100.0)
        bare.cut()
        with pytest.raises((ConnectionLost, ConnectFailed), match=bare.kind) as lost:
            both.run(driver.command(120.0))  # a thread that reads for an event loop may know already
        assert len(str(lost.value)) > len(bare.near)
        assert driver.commands == (0, 0)
        for call in (driver.command, driver.errors):
            with pytest.raises(ConnectFailed, match="Try: is the adapter plugged in"):
                both.run(call())
        language.use("ja")
        with pytest.raises(ConnectFailed, match="対処"):
            both.run(driver.command())
        language.use("en")
        wait(both, lambda: not device.state().moving)
        bare.restore()
        wait(both, lambda: works(both, driver))
        assert int(driver.inputs) == 0x3003  # servo and start are on, commands are 0
        assert driver.commands == (0, 0)
        assert stands(device, 0.2, both)
        both.run(driver.command(50.0))  # until the program says so
        wait(both, lambda: both.run(driver.command()).a_velocity == 50.0)
        both.run(driver.close())
    assert "lost" in caplog.text  # the server says so too


def works(both: Both, driver: Any) -> bool:
    """Call, and tell whether that has worked; the server's side of the bus takes its time to come back."""
    driver._host.timeout = 1.0
    try:
        both.run(driver.command())
    except (DriverTimeout, ConnectFailed, ConnectionLost):
        return False
    return True


@only_on("slcan", "serial", because="adapters can be unplugged")
def test_an_adapter_that_is_unplugged_during_a_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    peer.script = lambda _frame: []
    thread = threading.Thread(target=lambda: (until(lambda: len(peer.heard) == 2), bare.cut()))
    thread.start()
    began = time.monotonic()
    with pytest.raises(ConnectionLost):
        both.run(driver.command(100.0))
    assert time.monotonic() - began < PATIENCE * 0.8
    thread.join()
    until(lambda: peer.failed)
    peer.failed.clear()
    assert driver.commands == (0, 0)


def test_the_other_end_goes_away(both: Both, hosts: Hosts, bare: Place) -> None:
    """A driver that is switched off, and on again: time-outs, then the next call is right."""
    with serve_can(VirtualABH3(), at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        both.run(driver.command(10.0))
    for _ in range(2):
        with hosts.in_vain(driver, 0.15), pytest.raises(DriverTimeout):
            both.run(driver.command(20.0))
        assert driver.commands == (0, 0)
    with serve_can(VirtualABH3(), at=bare.far):
        both.run(driver.command())
        assert both.run(driver.velocities()).ay_velocity_command == 0
        both.run(driver.close())


# --- a bus as a script ------------------------------------------------------------------------------------------------


class Scripted(can.BusABC):
    """A bus that answers as :func:`obliging`, until it is told to fail."""

    def __init__(self) -> None:
        super().__init__(None)
        self.channel_info = "a scripted bus"
        self.receiving: Exception | None = None
        self.sending: Exception | None = None
        self.sent: list[can.Message] = []
        self.shut = 0
        self._waiting: queue.Queue[can.Message] = queue.Queue()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = time.monotonic() + (timeout or 0)
        while True:
            if self.receiving is not None:
                raise self.receiving
            try:
                return self._waiting.get(timeout=0.005), False
            except queue.Empty:
                if time.monotonic() >= end:
                    return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.sending is not None:
            raise self.sending
        self.sent.append(msg)
        for answer in obliging(message(msg.arbitration_id, bytes(msg.data))):
            self._waiting.put(answer)

    def shutdown(self) -> None:
        super().shutdown()
        self.shut += 1


@pytest.fixture
def buses(monkeypatch: pytest.MonkeyPatch) -> list[Scripted | Exception]:
    """What is opened by ``can://socketcan/can0``, one after the other; those that are open stay in it."""
    made: list[Any] = []

    def opened(address: object) -> can.BusABC:
        waiting = [each for each in made if isinstance(each, Exception) or not getattr(each, "taken", False)]
        first = waiting[0]
        if isinstance(first, Exception):
            made.remove(first)
            raise first
        first.taken = True
        return first

    monkeypatch.setattr("orinkit.transport.can_bus.open_bus", opened)
    return made


URL = "can://socketcan/can0"


@pytest.mark.parametrize("way", ["receiving", "sending"])
def test_a_bus_that_fails_and_comes_back(both: Both, hosts: Hosts, buses: list[Any], way: str) -> None:
    first, second = Scripted(), Scripted()
    buses.extend([first, ConnectFailed("it is away"), second])
    driver = hosts.connect(URL, **PATIENT)
    turn(both, driver)
    setattr(first, way, can.CanOperationError("the cable was pulled"))
    with pytest.raises(ConnectionLost, match="the cable was pulled"):
        both.run(driver.command(200.0))
    assert driver.commands == (0, 0)
    with pytest.raises(ConnectFailed, match="it is away"):
        both.run(driver.command())
    assert first.shut
    assert both.run(driver.command()).a_velocity == 0
    assert [bytes(frame.data) for frame in second.sent] == [bytes.fromhex("0000 0000 03300000")]
    assert both.run(driver.command(5.0)).a_velocity == 5.0
    both.run(driver.close())
    assert second.shut


@pytest.mark.parametrize("way", ["receiving", "sending"])
def test_all_drivers_of_a_lost_bus_forget_their_commands(both: Both, hosts: Hosts, buses: list[Any], way: str) -> None:
    buses.extend([Scripted(), Scripted()])
    bus = hosts.open_bus(URL)
    one, other = bus.driver(**PATIENT), bus.driver(address=7, **PATIENT)
    both.run(one.command(100.0))
    other._host._codes = [5, 5]  # nobody answers for it here
    setattr(buses[0], way, OSError(19, "No such device"))
    with pytest.raises(ConnectionLost, match="No such device"):
        both.run(one.command())
    assert one.commands == other.commands == (0, 0)
    assert both.run(one.command()).a_velocity == 0
    both.run(bus.close())


@pytest.mark.parametrize("both", ["async"], indirect=True)
def test_a_bus_that_is_lost_while_nobody_calls(both: Both, hosts: Hosts, buses: list[Any]) -> None:
    """The commands are 0 although no call has failed: the driver has stopped meanwhile, and does not go on by itself."""
    first, second = Scripted(), Scripted()
    buses.extend([first, second])
    driver = hosts.connect(URL, **PATIENT)
    turn(both, driver)
    first.receiving = can.CanOperationError("the cable was pulled")
    wait(both, lambda: driver.bus._line.broken)
    assert both.run(driver.set_input("brake_release", 1)).a_velocity == 0
    assert bytes(second.sent[0].data) == bytes.fromhex("0000 0000 03300010")
    both.run(driver.close())


def test_a_bus_that_a_listener_finds_lost(both: Both, hosts: Hosts, buses: list[Any]) -> None:
    first, second = Scripted(), Scripted()
    buses.extend([first, second])
    driver = hosts.connect(URL, **PATIENT)
    turn(both, driver)
    first.receiving = can.CanOperationError("the cable was pulled")
    listener = driver.listen(PATIENCE)
    with pytest.raises(ConnectionLost):
        both.run(next(listener) if both.loop is None else anext(listener))
    both.run(driver.set_input("brake_release", 1))
    assert bytes(second.sent[0].data) == bytes.fromhex("0000 0000 03300010")
    both.run(driver.close())


def test_a_bus_that_was_given_is_not_opened_again(both: Both, hosts: Hosts) -> None:
    bus = Scripted()
    driver = hosts.connect(bus, **PATIENT)
    assert both.run(driver.command(5.0)).a_velocity == 5.0
    bus.receiving = can.CanOperationError("the cable was pulled")
    with pytest.raises(ConnectionLost, match="the cable was pulled"):
        both.run(driver.command(6.0))
    bus.receiving = None
    with pytest.raises(InvalidValue, match="opened elsewhere"):
        both.run(driver.command(7.0))
    assert driver.commands == (0, 0)
    both.run(driver.close())
    assert bus.shut == 0
    bus.shutdown()


def test_a_frame_that_nobody_takes(both: Both, hosts: Hosts) -> None:
    """The only one on a bus gets no acknowledgement: that is told, and the bus goes on."""
    bus = Scripted()
    driver = hosts.connect(bus, **PATIENT)
    both.run(driver.command(5.0))
    bus.sending = can.CanTimeoutError("transmit buffer full")
    with pytest.raises(OrinError, match="could not be sent"):
        both.run(driver.command(6.0))
    assert driver.commands == (0, 0)
    bus.sending = None
    assert both.run(driver.command(7.0)).a_velocity == 7.0
    both.run(driver.close())
    bus.shutdown()


# --- calls that are broken off ----------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system sends no signals to threads")
@pytest.mark.parametrize("both", ["sync"], indirect=True)
def test_ctrl_c_in_a_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The driver is usable afterwards; an answer to what was broken off is not taken for that to the next call."""
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
    thread.join()
    peer.send(*obliging(peer.heard[-1]))
    arrived(both, bare, driver, 1)
    peer.script = obliging
    assert driver.command(3.0).a_velocity == 3.0
    assert driver.pulses().a_pulses == 4


@pytest.mark.parametrize("both", ["async"], indirect=True)
def test_a_call_that_is_cancelled(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    peer.script = lambda _frame: []

    async def body() -> None:
        call = asyncio.create_task(driver.command(99.0))
        end = time.monotonic() + PATIENCE
        while peer.served < 2 and time.monotonic() < end:  # noqa: ASYNC110 - a thread counts
            await asyncio.sleep(0.01)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        peer.send(*obliging(peer.heard[-1]))
        peer.script = obliging
        while not driver._port.frames and time.monotonic() < end:  # noqa: ASYNC110 - what arrives tells nobody
            await asyncio.sleep(0.01)
        assert (await driver.command(3.0)).a_velocity == 3.0
        peer.script = lambda _frame: []
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await driver.command(4.0)
        while peer.served < 4 and time.monotonic() < end:  # noqa: ASYNC110 - a thread counts
            await asyncio.sleep(0.01)
        peer.script = obliging
        assert (await driver.pulses()).a_pulses == 4

    both.run(body())


# --- closing ----------------------------------------------------------------------------------------------------------


def outcome(call: Callable[[], Any]) -> object:
    try:
        return call()
    except OrinError as error:
        return type(error)


def test_closing_the_bus_ends_a_call(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    bus = hosts.open_bus(bare.near)
    driver = bus.driver(**PATIENT)

    async def calls() -> object:
        try:
            return await both.now(driver.command(1.0))
        except OrinError as error:
            return type(error)

    async def closes() -> float:
        end = time.monotonic() + PATIENCE
        while not peer.heard and time.monotonic() < end:
            await both.now(asyncio.sleep(0.01) if both.loop else time.sleep(0.01))  # noqa: ASYNC251 - of the thread
        began = time.monotonic()
        await both.now(bus.close())
        return time.monotonic() - began

    called, took = both.side_by_side(calls(), closes())
    assert called is ConnectionClosed
    assert took < PATIENCE * 0.8
    with pytest.raises(ConnectionClosed):
        both.run(driver.command())
    assert driver.commands == (0, 0)


@only_on("virtual", "serial", because="it takes a time-out")
def test_closing_a_driver_while_a_call_waits(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """The call comes to its end first; then the driver is stopped, and closed."""
    driver = hosts.connect(bare.near, init=False, timeout=0.5)

    async def calls() -> object:
        try:
            return await both.now(driver.command(1.0))
        except OrinError as error:
            return type(error)

    async def closes() -> None:
        end = time.monotonic() + PATIENCE
        while not peer.heard and time.monotonic() < end:
            await both.now(asyncio.sleep(0.01) if both.loop else time.sleep(0.01))  # noqa: ASYNC251 - of the thread
        await both.now(driver.close())

    called, _ = both.side_by_side(calls(), closes())
    assert called in (DriverTimeout, ConnectionClosed)
    both.run(driver.close())
    with pytest.raises(ConnectionClosed):
        both.run(driver.command())


def test_a_block_that_raises_brings_the_motor_to_rest(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging

    def body(driver: Any) -> None:
        turn(both, driver)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        both.within(hosts.opening(bare.near, **PATIENT), body)
    until(lambda: peer.data[-1] == STOP)
    assert [data for data in peer.data if data.startswith(f"{COMMAND:08X}")][-2] == "00EF0102#f4 01 f4 01 03 30 00 00"


@only_on("udp_multicast", because="it is the same everywhere")
def test_closing_stops_what_was_asked_for_only(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
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
def test_closing_waits_little_for_a_driver_that_is_silent(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    turn(both, driver)
    peer.script = lambda _frame: []
    began = time.monotonic()
    both.run(driver.close())
    assert time.monotonic() - began < PATIENCE * 0.8
    assert peer.data[-1] == STOP


@only_on("udp_multicast", because="it is the same everywhere")
def test_opening_where_nobody_answers_leaves_nothing_open(both: Both, hosts: Hosts, bare: Place) -> None:
    with pytest.raises(DriverTimeout, match="cmd_init"):
        hosts.connect(bare.near, timeout=0.1)


@pytest.mark.parametrize("both", ["async"], indirect=True)
@only_on("virtual", "serial", because="a thread reads for the loop; there is a port to let go of")
def test_opening_that_is_cancelled_leaves_nothing_open(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    async def body() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.3):
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
