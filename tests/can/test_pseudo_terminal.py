"""The bus of a CAN server behind a pseudo-terminal: private to one program, usable again, and lost with its server."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

pytest.importorskip("can")
pytest.importorskip("serial")
if not hasattr(os, "openpty"):
    pytest.skip("this system has no pseudo-terminals", allow_module_level=True)

from orinkit import abh3
from orinkit.can.frame import CanFrame
from orinkit.can.pseudo_terminal import PseudoTerminalBus, SlcanPort
from orinkit.can.server import PSEUDO_TERMINAL, CanServer, serve_can
from orinkit.core.errors import OrinError
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.can_ptys import reserved_name
from support.waiting import until

FRAME = CanFrame(0x00EF0102, bytes.fromhex("E803000003300000"))
LINE = b"T00EF01028E803000003300000\r"


@contextmanager
def served(**parameters: object) -> Iterator[tuple[VirtualABH3, CanServer]]:
    device = VirtualABH3(Parameters(command_timeout=0, error_timeout=0, **parameters))  # type: ignore[arg-type]  # arguments from keywords
    with serve_can(device, at=PSEUDO_TERMINAL) as server:
        yield device, server


def test_lines_become_frames_however_they_are_divided():
    port = SlcanPort()
    data = b"C\rS6\rO\r" + 2 * LINE
    assert [frame for byte in data for frame in port.feed(bytes([byte]))] == [FRAME, FRAME]
    assert port.feed(LINE + LINE[:5]) == [FRAME]
    assert port.feed(LINE[5:]) == [FRAME]


def test_the_channel_must_be_open():
    port = SlcanPort()
    assert port.feed(LINE) == []
    assert port.feed(b"L\r" + LINE) == [FRAME]
    assert port.feed(b"C\r" + LINE) == []


@pytest.mark.parametrize("line", [
    b"", b"t1232AABB", b"T00EF0102", b"T00EF01029112233445566778899", b"T00EF01022AA", b"TFFFFFFFF0", b"T00EF01021GG",
    b"\xff" * 40, b"T" * 5000,
])  # fmt: skip
def test_other_lines_are_ignored(line):
    port = SlcanPort()
    port.feed(b"O\r")
    assert port.feed(line + b"\r") == []
    assert port.feed(LINE) == [FRAME]


def test_the_buffer_of_a_line_is_limited():
    port = SlcanPort()
    port.feed(b"O\r")
    for _ in range(100):
        port.feed(b"x" * 10_000)
    assert len(port._line) <= 64
    assert port.feed(b"\r" + LINE) == [FRAME]


def test_a_frame_becomes_a_line():
    assert SlcanPort.encode(FRAME) == LINE
    assert SlcanPort.encode(CanFrame(0x1FFFFFFF, b"")) == b"T1FFFFFFF0\r"


def test_servers_do_not_share_a_bus():
    with served() as (first, one), served() as (second, other):
        assert one.url != other.url
        with abh3.connect(one.url) as driver, abh3.connect(other.url) as quiet:
            driver.set_input("servo_on", 1)
            driver.set_input("start", 1)
            driver.command(ay=100.0)
            assert quiet.command().a_velocity == 0
            until(lambda: first.state().ay_velocity == 100)
            assert second.state().inputs.value == 0
            assert second.state().ay_velocity == 0


def test_one_program_after_another_can_use_the_bus():
    with served(broadcast_modes=(10,) * 8) as (device, server):
        for number in range(3):
            with abh3.connect(server.url) as driver:
                driver.set_inputs(1 << number)
                assert device.state().inputs.value == 1 << number
                assert driver.pulses().a_pulses == 0


def test_a_program_that_does_not_read_does_not_block_the_devices():
    bus = PseudoTerminalBus()
    try:
        channel = os.open(bus.url.partition("slcan/")[2].partition("?")[0], os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(channel, b"O\r" + LINE)
            until(lambda: bus.receive(0.01) == FRAME)
            start = time.process_time()
            bus.send([FRAME] * 50_000)
            assert time.process_time() - start < 10
            until(lambda: os.read(channel, 64).startswith(LINE))
        finally:
            os.close(channel)
    finally:
        bus.close()
        bus.close()


def test_an_invalid_frame_of_a_device_does_not_end_the_server(caplog):
    bus = PseudoTerminalBus()
    try:
        bus._port.feed(b"O\r")
        bus.send([CanFrame(0x20000000, b""), None, FRAME])  # type: ignore[list-item]  # wrong on purpose
        assert bytes(bus._queue) in (b"", LINE)
        assert "which is not a CAN frame" in caplog.text
    finally:
        bus.close()


def test_the_bus_is_lost_if_its_server_ends():
    with served() as (_, server), reserved_name(server.url):
        driver = abh3.connect(server.url, timeout=30.0)
        server.close()
        with pytest.raises(OrinError):
            driver.command()
        driver.close()
