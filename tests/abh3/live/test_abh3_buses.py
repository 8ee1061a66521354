"""Buses that are lost and recover: the next call reopens the bus, and no motion resumes on its own."""

from __future__ import annotations

import queue
import threading
import time
from typing import Any

import pytest

import can
from orinkit.can.server import serve_can
from orinkit.core import i18n
from orinkit.core.errors import ConnectFailed, ConnectionLost, DriverTimeout, InvalidValue, OrinError
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.abh3_wires import FAST, PATIENCE, Hosts, Peer, Place, message, obliging, only_on, rest, turn, wait
from support.both import Both
from support.waiting import until

PATIENT = {"timeout": PATIENCE}


def stands(device: VirtualABH3, seconds: float, both: Both) -> bool:
    """Return True if the motors stand still for a while, and nothing commands them to move."""
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
    """Calls raise; once it is plugged in again the next call works, and no motion resumes on its own."""
    device = VirtualABH3(Parameters(error_timeout=0, **FAST))
    with serve_can(device, at=bare.far):
        driver = hosts.connect(bare.near, **PATIENT)
        turn(both, driver)
        wait(both, lambda: both.run(driver.command()).a_velocity == 100.0)
        bare.cut()
        with pytest.raises((ConnectionLost, ConnectFailed), match=bare.kind) as lost:
            both.run(driver.command(120.0))  # the thread that reads for an event loop may have noticed already
        assert len(str(lost.value)) > len(bare.near)
        assert driver.commands == (0, 0)
        for call in (driver.command, driver.errors):
            with pytest.raises(ConnectFailed, match="Try: check that the adapter is plugged in"):
                both.run(call())
        i18n.use("ja")
        with pytest.raises(ConnectFailed, match="対処"):
            both.run(driver.command())
        i18n.use("en")
        wait(both, lambda: not device.state().moving)
        bare.restore()
        wait(both, lambda: works(both, driver))
        assert int(driver.inputs) == 0x1001  # start is off, commands are 0
        assert driver.commands == (0, 0)
        assert stands(device, 0.2, both)
        both.run(driver.set_input("start", 1))
        both.run(driver.command(50.0))  # until the program commands it
        wait(both, lambda: both.run(driver.command()).a_velocity == 50.0)
        both.run(driver.close())
    assert "lost" in caplog.text  # the server logs it too


def works(both: Both, driver: Any) -> bool:
    """Return True if a call succeeds; the server's side of the bus recovers later."""
    with Hosts.in_vain(driver, 1.0):
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


def test_a_driver_is_switched_off(both: Both, hosts: Hosts, bare: Place) -> None:
    """A driver is switched off and on again: time-outs, then the next call succeeds."""
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


# --- a scripted bus ----------------------------------------------------------------------------------------------------


class Scripted(can.BusABC):
    """A bus that replies like :func:`obliging`, until the test makes it fail."""

    def __init__(self) -> None:
        super().__init__(None)
        self.channel_info = "a scripted bus"
        self.receiving: Exception | None = None
        self.sending: Exception | None = None
        self.receiving_then: Exception | None = None  # error after the next frame is sent
        self.sent: list[can.Message] = []
        self.refused = 0
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
            self.refused += 1
            raise self.sending
        self.sent.append(msg)
        if self.receiving_then is not None:
            self.receiving = self.receiving_then
            return
        for answer in obliging(message(msg.arbitration_id, bytes(msg.data))):
            self._waiting.put(answer)

    def shutdown(self) -> None:
        super().shutdown()
        self.shut += 1


@pytest.fixture
def buses(monkeypatch: pytest.MonkeyPatch) -> list[Scripted | Exception]:
    """Return the buses that ``can://socketcan/can0`` opens, in order; the open ones stay in the list."""
    made: list[Any] = []

    def opened(address: object) -> can.BusABC:
        waiting = [each for each in made if isinstance(each, Exception) or not getattr(each, "taken", False)]
        first = waiting[0]
        if isinstance(first, Exception):
            made.remove(first)
            raise first
        first.taken = True
        return first

    monkeypatch.setattr("orinkit.can.bus.open_bus", opened)
    return made


URL = "can://socketcan/can0"


@pytest.mark.parametrize("way", ["receiving_then", "sending"])
def test_a_bus_that_fails_and_recovers(both: Both, hosts: Hosts, buses: list[Any], way: str) -> None:
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
    assert [bytes(frame.data) for frame in second.sent] == [bytes.fromhex("0000 0000 01100000")]
    assert both.run(driver.command(5.0)).a_velocity == 5.0
    both.run(driver.close())
    assert second.shut


@pytest.mark.parametrize("way", ["receiving_then", "sending"])
def test_the_commands_of_all_drivers_of_a_lost_bus_are_reset(
    both: Both, hosts: Hosts, buses: list[Any], way: str
) -> None:
    buses.extend([Scripted(), Scripted()])
    bus = hosts.open_bus(URL)
    one, other = bus.driver(**PATIENT), bus.driver(address=7, **PATIENT)
    both.run(one.command(100.0))
    other.host._codes = [5, 5]  # nothing replies for it here
    setattr(buses[0], way, OSError(19, "No such device"))
    with pytest.raises(ConnectionLost, match="No such device"):
        both.run(one.command())
    assert one.commands == other.commands == (0, 0)
    assert both.run(one.command()).a_velocity == 0
    both.run(bus.close())


def test_a_keep_alive_frame_that_is_not_accepted(both: Both, hosts: Hosts) -> None:
    """A briefly full transmit buffer ends no keep-alive, and resets no commands of other drivers."""
    bus = Scripted()
    shared = hosts.open_bus(bus)
    one, other = shared.driver(**PATIENT), shared.driver(address=7, **PATIENT)
    both.run(one.set_inputs(0x3003))
    both.run(one.command(100.0))
    other.host._codes = [5, 5]  # nothing replies for it here
    both.run(one.keep_alive(0.02, patience=PATIENCE))
    refused = bus.refused
    bus.sending = can.CanTimeoutError("transmit buffer full")
    wait(both, lambda: bus.refused > refused + 2)
    bus.sending = None
    sent = len(bus.sent)
    wait(both, lambda: len(bus.sent) > sent + 2)
    assert one.kept_alive
    assert one.commands == (100.0, 0.0)
    assert other.commands == (1.0, 1.0)
    assert bytes(bus.sent[-1].data) == bytes.fromhex("f401 0000 03300000")
    one.end_keep_alive()
    both.run(one.keep_alive(0.02, patience=0.2))
    bus.sending = can.CanTimeoutError("transmit buffer full")
    wait(both, lambda: not one.kept_alive and one.commands == (0, 0))  # longer than the patience
    assert other.commands == (1.0, 1.0)
    bus.sending = None
    other.host.reset_commands()
    both.run(shared.close())
    bus.shutdown()


@pytest.mark.parametrize("both", ["async"], indirect=True)
def test_a_bus_that_is_lost_between_calls(both: Both, hosts: Hosts, buses: list[Any]) -> None:
    """The commands are 0 although no call failed: the driver stopped meanwhile, and must not resume on its own."""
    first, second = Scripted(), Scripted()
    buses.extend([first, second])
    driver = hosts.connect(URL, **PATIENT)
    turn(both, driver)
    first.receiving = can.CanOperationError("the cable was pulled")
    wait(both, lambda: driver.bus._line.broken)
    assert both.run(driver.set_input("brake_release", 1)).a_velocity == 0
    assert bytes(second.sent[0].data) == bytes.fromhex("0000 0000 01100010")
    both.run(driver.close())


def test_a_listener_detects_a_lost_bus(both: Both, hosts: Hosts, buses: list[Any]) -> None:
    first, second = Scripted(), Scripted()
    buses.extend([first, second])
    driver = hosts.connect(URL, **PATIENT)
    turn(both, driver)
    first.receiving = can.CanOperationError("the cable was pulled")
    listener = driver.listen(PATIENCE)
    with pytest.raises(ConnectionLost):
        both.run(next(listener) if both.loop is None else anext(listener))
    both.run(driver.set_input("brake_release", 1))
    assert bytes(second.sent[0].data) == bytes.fromhex("0000 0000 01100010")
    both.run(driver.close())


def test_a_bus_of_the_caller_is_not_reopened(both: Both, hosts: Hosts) -> None:
    bus = Scripted()
    driver = hosts.connect(bus, **PATIENT)
    assert both.run(driver.command(5.0)).a_velocity == 5.0
    bus.receiving_then = can.CanOperationError("the cable was pulled")
    with pytest.raises(ConnectionLost, match="the cable was pulled"):
        both.run(driver.command(6.0))
    bus.receiving = bus.receiving_then = None
    with pytest.raises(InvalidValue, match="only if it was opened by an address"):
        both.run(driver.command(7.0))
    assert driver.commands == (0, 0)
    both.run(driver.close())
    assert bus.shut == 0
    bus.shutdown()


def test_a_frame_that_is_not_acknowledged(both: Both, hosts: Hosts) -> None:
    """The only node on a bus gets no acknowledgement: the call raises, and the bus stays usable."""
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
