"""Calls that are broken off, closing while others wait, blocks that raise: a driver comes to rest, and stays usable."""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from abh3_wires import (
    COMMAND,
    PATIENCE,
    Hosts,
    Peer,
    Place,
    arrived,
    obliging,
    only_on,
    turn,
    until,
)

from both import Both
from orinkit.errors import ConnectFailed, ConnectionClosed, DriverTimeout, OrinError

PATIENT = {"timeout": PATIENCE}
STOP = "00EF0102#00 00 00 00 01 10 00 00"
"""Commands 0, servo on, start off."""


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
    assert driver.commands == (0, 0)
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
        assert driver.commands == (0, 0)
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
