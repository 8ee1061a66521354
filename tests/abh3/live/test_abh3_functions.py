"""Every function of section 4 over every kind of bus: the exact frames, and the reaction of a virtual driver."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from typing import Any

import pytest

from orinkit.abh3 import BR0, BR1, BR1V2, BR2, BR3, BR4, BR5, BR6, BUF, DP0R, DP0RV2
from orinkit.core.errors import ConnectionClosed, DriverTimeout, InvalidValue, ParameterRefused, ProtocolError
from support.abh3_wires import COMMAND, DRIVERS, FEEDBACK, Hosts, Peer, Place, message, obliging, only_on, wait
from support.both import Both

PATIENT = {"timeout": 10.0}
"""Time-out of calls that get a reply, on a busy machine, in s."""


# --- the frames (sections 2 and 4) ------------------------------------------------------------------------------------


def test_port_init_sends_nothing_and_init_does(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """4.1: abh3_can_port_init, then abh3_can_cmd_init."""
    peer.script = obliging
    driver = hosts.connect(bare.near, init=False, **PATIENT)
    time.sleep(0.15)  # an earlier frame would have arrived by now, before the next one
    assert peer.heard == []
    answer = both.run(driver.init())
    assert peer.data == ["00EF0102#00 00 00 00 00 00 00 00"]
    assert (answer.a_velocity, answer.b_velocity, answer.y_velocity, answer.x_velocity) == (0, 0, 0, 0)


def test_the_frames_of_every_function(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)  # 4.1, abh3_can_init
    assert both.run(driver.command(ay=100.0)).a_velocity == 100.0  # 4.2, abh3_can_cmdAY
    both.run(driver.command(bx=-50.0))  # 4.2, abh3_can_cmdBX: A/Y is unchanged
    both.run(driver.command(-6553.6, 6553.4))  # 4.3, abh3_can_cmd
    both.run(driver.command())
    both.run(driver.set_inputs(0x10345678))  # 4.4, abh3_can_inSet
    both.run(driver.set_inputs(0xFFFFFFFF, 0x0000FF00))
    both.run(driver.set_inputs(0, 0xF0000000))
    both.run(driver.set_inputs(0, 0xFFFFFFFF))
    both.run(driver.set_input(31, 1))  # 4.5, abh3_can_inBitSet
    both.run(driver.set_input(31, 0))
    both.run(driver.set_input("servo_on", True))
    both.run(driver.set_input("ay_start", 1))
    both.run(driver.set_input("bx_servo_on", False))
    assert peer.data == [
        "00EF0102#00 00 00 00 00 00 00 00",
        "00EF0102#f4 01 00 00 00 00 00 00",
        "00EF0102#f4 01 06 ff 00 00 00 00",
        "00EF0102#00 80 ff 7f 00 00 00 00",
        "00EF0102#00 80 ff 7f 00 00 00 00",
        "00EF0102#00 80 ff 7f 78 56 34 10",
        "00EF0102#00 80 ff 7f 78 ff 34 10",
        "00EF0102#00 80 ff 7f 78 ff 34 00",
        "00EF0102#00 80 ff 7f 00 00 00 00",
        "00EF0102#00 80 ff 7f 00 00 00 80",
        "00EF0102#00 80 ff 7f 00 00 00 00",
        "00EF0102#00 80 ff 7f 01 10 00 00",
        "00EF0102#00 80 ff 7f 03 10 00 00",
        "00EF0102#00 80 ff 7f 03 00 00 00",
    ]
    assert list(driver.inputs) == ["ay_servo_on", "ay_start"]
    assert driver.commands == (-6553.6, 6553.4)


@pytest.mark.parametrize("everyone", [False, True])
def test_the_frames_of_requests(both: Both, hosts: Hosts, bare: Place, peer: Peer, everyone: bool) -> None:
    """4.7: abh3_can_reqBRD and abh3_can_reqBRDBRD; 0 to 6 and the numbers of the document mean the same."""
    peer.script = obliging
    driver = hosts.connect(bare.near, init=False, **PATIENT)
    kinds = [BR0, BR1, BR2, BR3, BR4, BR5, BR6]
    for number, kind in enumerate(kinds):
        for name in (number, 0x28 + number):
            answer = both.run(driver.request_broadcast(name, everyone=everyone))
            assert type(answer) is kind
            assert list(answer.raw_values.values()) != []
            if kind is BR4:
                assert (answer.a_pulses, answer.b_pulses) == (4, 4)
    sent = "00EAFF02" if everyone else "00EA0102"
    assert peer.data == [f"{sent}#{0x28 + number:02x} ff 00" for number in range(7) for _ in range(2)]


@only_on("udp_multicast", because="it is the same over every bus")
def test_other_addresses_group_and_priority(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    driver = hosts.connect(bare.near, address=0x21, host=2, group=31, priority=5, init=False, **PATIENT)
    peer.script = lambda frame: [
        message(0x00EF0221, bytes(frame.data)) if frame.arbitration_id & 0xFF0000 == 0xEF0000 else message(0x00FFFE21)
    ]
    assert both.run(driver.command(1.0)).a_velocity == 1.0
    assert type(both.run(driver.monitors())) is BR6
    assert peer.data == ["14EF2102#05 00 00 00 00 00 00 00", "14EA2102#fe ff 00"]


@only_on("udp_multicast", because="it is the same over every bus")
def test_a_broadcast_without_a_layout_is_eight_bytes(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = lambda frame: [message(0x00FF2F01, bytes(range(8)))]
    driver = hosts.connect(bare.near, init=False, **PATIENT)
    answer = both.run(driver.request_broadcast(7))
    assert type(answer) is BUF
    assert answer.data == bytes(range(8))


def test_single_packets_without_a_command(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """abh3_can_reqSNG asks for DP0 and DP1, and commands nothing."""
    peer.script = lambda frame: [message(FEEDBACK | frame.data[2] << 24, bytes((9, 0, 0, 0, 7, 0, 0, 0)))]
    driver = hosts.connect(bare.near, init=False, **PATIENT)
    assert both.run(driver.request_single()).a_velocity == 1.8
    pulses = both.run(driver.request_single(1))
    assert (pulses.a_pulses, pulses.b_pulses) == (9, 7)
    assert peer.data == ["00EA0102#00 ef 00", "00EA0102#00 ef 01"]


@only_on("udp_multicast", because="it is the same over every bus")
def test_invalid_values_are_not_sent(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    peer.script = obliging
    driver = hosts.connect(bare.near, **PATIENT)
    both.run(driver.command(10.0, 20.0))
    for call, arguments in [
        (driver.command, (6553.6,)),
        (driver.command, (None, -6554.0)),
        (driver.command, (math.nan,)),
        (driver.command, ("fast",)),
        (driver.set_inputs, (1 << 32,)),
        (driver.set_inputs, (0, 1.5)),
        (driver.set_inputs, (-1,)),
        (driver.set_inputs, (0, -1)),
        (driver.set_input, (32, 1)),
        (driver.set_input, ("ay_go", 1)),
        (driver.set_input, (0, 2)),
        (driver.request_broadcast, (256,)),
        (driver.request_broadcast, (0x30,)),  # of another group
        (driver.request_single, (2,)),
        (driver.request_single, (False,)),
        (driver.stop_and_wait, (0,)),
        (driver.stop_and_wait, (3601,)),
        (driver.stop_and_wait, ("long",)),
        (driver.read_parameter, (0x10000,)),
    ]:
        with pytest.raises(InvalidValue):
            both.run(call(*arguments))
    assert driver.commands == (10.0, 20.0)
    assert int(driver.inputs) == 0
    assert len(peer.heard) == 2
    both.run(driver.command())
    assert peer.data[-1] == "00EF0102#32 00 64 00 00 00 00 00"


# --- a virtual driver -------------------------------------------------------------------------------------------------


def test_turning(both: Both, hosts: Hosts, world: Place) -> None:
    driver = hosts.connect(world.near, **PATIENT)
    both.run(driver.set_input("servo_on", 1))
    assert type(both.run(driver.set_input("start", 1))) is DP0R
    before = both.run(driver.pulses())
    both.run(driver.command(100.0, -50.0))
    wait(both, lambda: both.run(driver.request_single()).b_velocity == -50.0)
    wait(both, lambda: both.run(driver.command(100.0)).a_velocity == 100.0)
    feedback = both.run(driver.command())
    assert (feedback.a_velocity, feedback.b_velocity) == (100.0, -50.0)
    assert (feedback.y_velocity, feedback.x_velocity) == (25.0, 75.0)
    velocities = both.run(driver.velocities())
    assert (velocities.ay_velocity_command, velocities.bx_velocity_command) == (100.0, -50.0)
    assert (velocities.ay_velocity, velocities.bx_velocity) == (100.0, -50.0)
    wait(both, lambda: both.run(driver.pulses()).a_pulses > before.a_pulses + 10)
    assert both.run(driver.pulses()).b_pulses < before.b_pulses
    currents = both.run(driver.currents())
    assert (currents.ay_current_command, currents.bx_current_command) == (5.0, -5.0)
    assert (currents.a_load, currents.b_load) == (5.0, 5.0)
    assert both.run(driver.analog()).main_voltage == 24.0
    monitors = both.run(driver.monitors())
    assert (monitors.monitor_0, monitors.monitor_1) == (100.0, -50.0)
    states = both.run(driver.states())
    assert "servo_on" in states.control
    assert "start" in states.control
    both.run(driver.stop())
    wait(both, lambda: both.run(driver.velocities()).ay_velocity == 0)
    assert driver.commands == (0, 0)
    assert list(driver.inputs) == ["ay_servo_on", "bx_servo_on"]


def test_turning_a_driver_of_2023(both: Both, hosts: Hosts, world: Place) -> None:
    """v2: another feedback, other bits; loads in 0.1 %."""
    driver = hosts.connect(world.near, address=9, dialect="v2", group=3, load_unit=0.1, **PATIENT)
    both.run(driver.set_input("servo_on", 1))
    both.run(driver.set_input("start", 1))
    assert int(driver.inputs) == 0x303
    feedback = both.run(driver.command(200.0, 100.0))
    assert type(feedback) is DP0RV2
    assert "servo_on" in feedback.control
    wait(both, lambda: both.run(driver.command()).ay_velocity == 200.0)
    assert both.run(driver.command()).bx_velocity == 100.0
    states = both.run(driver.states())
    assert type(states) is BR1V2
    assert "servo_on" in states.external  # the terminals are on
    currents = both.run(driver.currents())
    assert (currents.a_load, currents.raw_values["a_load"]) == (5.0, 50)
    for number in (0, 2, 4, 5, 6):
        both.run(driver.request_broadcast(number))
        both.run(driver.request_broadcast(3 * 8 + number, everyone=True))
    both.run(driver.stop())
    wait(both, lambda: both.run(driver.command()).ay_velocity == 0)


def test_a_load_in_another_unit(both: Both, hosts: Hosts, world: Place) -> None:
    """Frames do not contain the unit; the host has to know it."""
    bus = hosts.open_bus(world.near)
    fine = bus.driver(address=9, dialect="v2", group=3, load_unit=0.1, **PATIENT)
    both.run(fine.set_input("servo_on", 1))
    both.run(fine.set_input("start", 1))
    both.run(fine.command(100.0))
    wait(both, lambda: both.run(fine.currents()).a_load == 5.0)
    coarse = both.run(bus.request_all(3, seconds=10, count=1, group=3, dialect="v2", load_unit=1.0))
    assert coarse[9].a_load == 50.0
    both.run(fine.stop())


def test_torque(both: Both, hosts: Hosts, world: Place) -> None:
    driver = hosts.connect(world.near, address=7, **PATIENT)
    both.run(driver.command(1000.0, 10.0))
    both.run(driver.set_input("ay_torque", 1))
    assert driver.commands == (0.0, 10.0)  # 1000 min^-1 would be 50 % now
    with pytest.raises(InvalidValue, match="327"):
        both.run(driver.command(400.0))
    both.run(driver.set_input("servo_on", 1))
    both.run(driver.set_input("start", 1))
    both.run(driver.command(ay=20.0, bx=0.0))
    assert driver.commands == (20.0, 0.0)
    wait(both, lambda: both.run(driver.request_single()).a_velocity > 0)
    assert both.run(driver.currents()).ay_current_command == 20.0
    both.run(driver.init())
    wait(both, lambda: both.run(driver.velocities()).ay_velocity == 0)


def test_stop_and_wait(both: Both, hosts: Hosts, world: Place) -> None:
    """stop_and_wait() returns at standstill, not before; the servo stays on."""
    driver = hosts.connect(world.near, address=7, **PATIENT)
    both.run(driver.set_input("servo_on", 1))
    both.run(driver.set_input("start", 1))
    both.run(driver.command(1000.0, -1000.0))
    wait(both, lambda: both.run(driver.request_single()).b_velocity == -1000.0)
    with pytest.raises(DriverTimeout, match=r"ABH3 7 did not reach standstill within 0\.05 s"):
        both.run(driver.stop_and_wait(0.05))  # it takes a quarter of a second
    assert driver.commands == (0, 0)
    feedback = both.run(driver.stop_and_wait(PATIENT["timeout"]))
    assert max(map(abs, (feedback.a_velocity, feedback.b_velocity))) < 1
    assert list(driver.inputs) == ["ay_servo_on", "bx_servo_on"]
    assert max(map(abs, (both.run(driver.velocities()).ay_velocity, both.run(driver.velocities()).bx_velocity))) < 1


def test_errors_are_reset(both: Both, hosts: Hosts, world: Place) -> None:
    """Driver 3 has short time-outs: after half a second without a host it reports an error."""
    driver = hosts.connect(world.near, address=3, group=6, init=False, **PATIENT)
    wait(both, lambda: "can_communication" in both.run(driver.errors()).errors)
    both.run(driver.init())
    assert "can_communication" in both.run(driver.errors()).errors  # a command alone does not clear it
    cleared = both.run(driver.reset_errors(tries=100))
    assert type(cleared) is BR0
    assert (int(cleared.errors), int(cleared.warnings)) == (0, 0)
    assert int(driver.inputs) == 0


def test_a_request_of_all(both: Both, hosts: Hosts, world: Place) -> None:
    bus = hosts.open_bus(world.near)
    drivers = {address: bus.driver(address=address, **PATIENT) for address in (1, 7)}
    for address, driver in drivers.items():
        both.run(driver.init())
        both.run(driver.command(address * 10.0))
    found = both.run(bus.request_all(0, seconds=10, count=2))
    assert sorted(found) == [1, 7]
    assert {type(record) for record in found.values()} == {BR0}

    def answering() -> list[int]:
        heard = sorted(both.run(bus.request_all(0x2C, seconds=0.2)))
        assert set(heard) <= {1, 7}  # drivers of other groups do not reply
        return heard

    wait(both, lambda: answering() == [1, 7])
    assert list(both.run(bus.request_all(4, seconds=10, count=1, group=3, dialect="v2"))) == [9]
    assert both.run(bus.request_all(4, seconds=0.1, group=11)) == {}
    for driver in drivers.values():
        assert type(both.run(driver.request_broadcast(4, everyone=True))) is BR4
        assert type(both.run(driver.velocities())) is BR2
        assert type(both.run(driver.currents())) is BR3
        assert type(both.run(driver.states())) is BR1
        assert type(both.run(driver.analog())) is BR5


def test_withheld_frames_get_no_reply(both: Both, hosts: Hosts, world: Place) -> None:
    """The driver does not support DP1 (2.2)."""
    driver = hosts.connect(world.near, **PATIENT)
    with hosts.in_vain(driver, 0.15), pytest.raises(DriverTimeout, match="abh3_can_reqSNG"):
        both.run(driver.request_single(1))
    assert both.run(driver.request_single(0)).a_velocity == 0


def test_parameters_monitors_identification(both: Both, hosts: Hosts, world: Place) -> None:
    driver = hosts.connect(world.near, address=7, **PATIENT)
    assert both.run(driver.read_parameter(0x4102)).value == 7
    assert both.run(driver.read_parameter(0x4117)).value == 0
    both.run(driver.write_parameter(0x4117, 5000))
    assert both.run(driver.read_parameter(0x4117)).value == 5000
    both.run(driver.write_parameter(0x4117, 0))
    assert both.run(driver.read_monitor(0x1004)).value == 24.0
    assert "orinkit" in both.run(driver.read_identification())
    with pytest.raises(ParameterRefused, match="Try"):
        both.run(driver.read_parameter(0x7FFF))
    with pytest.raises(InvalidValue):
        both.run(driver.write_parameter(0x7FFF, 1))
    assert both.run(driver.command()).a_velocity == 0


def test_parameters_beside_commands(both: Both, hosts: Hosts, world: Place) -> None:
    """A multi-packet message takes many frames; commands continue between them."""
    driver = hosts.connect(world.near, **PATIENT)

    async def reads() -> set[float]:
        return {(await both.now(driver.read_parameter(0x4102))).value for _ in range(10)}

    async def commands() -> set[float]:
        return {(await both.now(driver.command(number / 5))).a_velocity for number in range(100)}

    assert both.side_by_side(reads(), commands(), reads()) == [{1}, {0.0}, {1}]


@pytest.mark.parametrize("both", ["async"], indirect=True)
def test_interrupted_messages_leave_nothing_behind(both: Both, hosts: Hosts, world: Place) -> None:
    """After an interruption at any point, the next reply matches the next request, and nothing else is written."""
    driver = hosts.connect(world.near, **PATIENT)

    async def body() -> None:
        for number in range(120):
            task = asyncio.create_task(driver.read_parameter(0x4108))
            await asyncio.sleep(number * 5e-5)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            try:
                assert (await driver.read_parameter(0x4102)).value == 1
                assert (await driver.read_parameter(0x4107)).value == 5
            except ProtocolError:  # the abandoned reply was being sent
                assert (await driver.read_parameter(0x4102)).value == 1

    both.run(body())


def test_listening(both: Both, hosts: Hosts, world: Place) -> None:
    """Frames of other nodes are decoded: here the replies to another host."""
    bus = hosts.open_bus(world.near)
    driver = bus.driver(address=1, **PATIENT)

    enough = threading.Event()

    async def calls() -> None:
        while not enough.is_set():
            await both.now(driver.command(10.0))
            await both.now(driver.pulses())

    async def listens() -> list[str]:
        try:
            return await some_names()
        finally:
            enough.set()

    async def some_names() -> list[str]:
        names: list[str] = []
        listener = bus.listen(PATIENT["timeout"])
        if both.loop is None:
            for heard in listener:
                names.append(heard.name)
                if len(names) >= 40:
                    break
            listener.close()
        else:
            async for heard in listener:
                names.append(heard.name)
                if len(names) >= 40:
                    break
            await listener.aclose()
        return names

    names, _ = both.side_by_side(listens(), calls())
    assert {"DP0R", "BR4"} <= set(names) <= {"DP0R", "BR4", "DP0S", "REQUEST"}


def test_listening_ends_after_its_time(both: Both, hosts: Hosts, bare: Place) -> None:
    bus = hosts.open_bus(bare.near)
    listener = bus.listen(0.05)
    if both.loop is None:
        assert list(listener) == []
    else:

        async def all_of() -> list[object]:
            return [heard async for heard in listener]

        assert both.run(all_of()) == []


def test_closing(both: Both, hosts: Hosts, world: Place) -> None:
    """4.8, abh3_can_finish."""
    driver = hosts.connect(world.near, **PATIENT)
    both.run(driver.close())
    both.run(driver.close())
    for call, arguments in [
        (driver.init, ()),
        (driver.command, ()),
        (driver.stop, ()),
        (driver.stop_and_wait, ()),
        (driver.errors, ()),
        (driver.reset_errors, ()),
        (driver.read_identification, ()),
        (driver.read_parameter, (0x4102,)),
        (driver.write_parameter, (0x4117, 0)),
        (driver.read_monitor, (0x1004,)),
        (driver.keep_alive, ()),
    ]:
        with pytest.raises(ConnectionClosed):
            both.run(call(*arguments))
    assert driver.closed
    assert not driver.kept_alive
    again = hosts.connect(world.near, **PATIENT)  # the bus can be opened again
    assert both.run(again.command()).a_velocity == 0


def test_a_closed_driver_leaves_the_bus_open_for_others(both: Both, hosts: Hosts, world: Place) -> None:
    bus = hosts.open_bus(world.near)
    one, other = bus.driver(address=1, **PATIENT), bus.driver(address=7, **PATIENT)
    both.run(one.close())
    assert both.run(other.init()).a_velocity == 0
    both.run(bus.close())
    with pytest.raises(ConnectionClosed):
        both.run(other.init())


def test_two_hosts(both: Both, hosts: Hosts, bare: Place, peer: Peer) -> None:
    """A driver that accepts any host replies to each; each host gets its own replies."""
    peer._is_for_me = lambda found: found.arbitration_id & 0xFF in (2, 4)
    peer.script = lambda frame: [message(0x00EF0001 | (frame.arbitration_id & 0xFF) << 8, bytes(frame.data[:2]) * 4)]
    bus = hosts.open_bus(bare.near)
    two, four = bus.driver(host=2, **PATIENT), bus.driver(host=4, **PATIENT)

    async def asks(driver: object, first: int) -> bool:
        return all([(await both.now(driver.command(first + n))).b_velocity == first + n for n in range(100)])

    assert both.side_by_side(asks(two, 100), asks(four, 300)) == [True, True]
    assert {frame.arbitration_id for frame in peer.heard} == {COMMAND, 0x00EF0104}


def test_the_drivers_have_their_parameters(both: Both, hosts: Hosts, world: Place) -> None:
    """Each driver of the world replies according to its parameters."""
    bus = hosts.open_bus(world.near)
    for address, given in DRIVERS.items():
        driver = bus.driver(address=address, **PATIENT)
        assert both.run(driver.read_parameter(0x4107)).value == given.get("group", 5)


def test_two_drivers_turn_independently(both: Both, hosts: Hosts, world: Place) -> None:
    """Commands for driver 1 do not affect driver 7, and vice versa."""
    bus = hosts.open_bus(world.near)

    async def turns(driver: Any, offset: int) -> tuple[float, float]:
        await both.now(driver.init())
        await both.now(driver.set_input("servo_on", 1))
        await both.now(driver.set_input("start", 1))
        for number in range(60):
            wanted = number * 4 + offset
            await both.now(driver.command(wanted, -wanted))
            velocities = await both.now(driver.velocities())
            assert (velocities.ay_velocity_command, velocities.bx_velocity_command) == (wanted, -wanted)
        end = time.monotonic() + PATIENT["timeout"]
        while (answer := await both.now(driver.command())).a_velocity != wanted and time.monotonic() < end:
            pass
        await both.now(driver.init())
        return answer.a_velocity, answer.b_velocity

    drivers = [bus.driver(address=address, **PATIENT) for address in (1, 7)]
    assert both.side_by_side(turns(drivers[0], 1), turns(drivers[1], 2)) == [(237.0, -237.0), (238.0, -238.0)]
