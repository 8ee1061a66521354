"""Clients of a VE026A: detection of the dialect, and no requests for functions that the controller does not have."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
import orinkit.aio
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, StreamError
from orinkit.values.poses import J
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.both import Both
from support.clocks import HeldClock
from support.waiting import PATIENCE, until

HOME = (0.0, 30.0, 120.0, 0.0, 30.0, 0.0, 0.0)


@pytest.fixture
def device() -> VirtualVE026A:
    return VirtualVE026A(motor_seconds=0.05, clear_seconds=0.05)


@pytest.fixture
def urls(device: VirtualVE026A) -> Iterator[list[str]]:
    with orinkit.serve(device, "pty://", "tcp://127.0.0.1:0") as server:
        yield server.urls


@pytest.mark.parametrize(
    ("place", "options"),
    [(0, {}), (0, {"provider": ""}), (1, {"provider": ""}), (1, {"provider": "CaoProv.DENSO.VE026A"}), (1, {"dialect": "VE026A"})],
)  # fmt: skip
def test_the_dialect_is_found(both: Both, urls: list[str], place: int, options: dict[str, Any]) -> None:
    rc = both.connect(urls[place], **{"dialect": None, **options})
    assert rc.client.dialect.name == "ve026a"
    both.run(rc.close())


def test_an_rc8_on_a_serial_line_is_not_a_ve026a(both: Both) -> None:
    with orinkit.serve(VirtualRC8(), "pty://") as server:
        rc8 = both.connect(server.url, dialect=None)
        assert rc8.client.dialect.name == "rc8"
        both.run(rc8.close())
        forced = both.connect(server.url, dialect="rc8")
        assert both.run(forced.execute("GetCurErrorCount")) == 0
        both.run(forced.close())


@pytest.mark.parametrize("name", ["rc7", "", 5])
def test_an_unknown_dialect(name: Any) -> None:
    with pytest.raises(InvalidValue, match="rc8, ve026a"):
        orinkit.connect("tcp://127.0.0.1:1", dialect=name)


@pytest.mark.parametrize("place", [0, 1], ids=["serial", "tcp"])
def test_motor_joints_and_errors(both: Both, device: VirtualVE026A, urls: list[str], place: int) -> None:
    rc = both.connect(urls[place], provider="", dialect=None)
    robot = both.run(rc.robot("VE"))

    def look(_: Any) -> None:
        assert device.servo_on
        joints = robot.joints if both.kind == "sync" else both.run(robot.get_joints())
        assert joints[:7] == HOME
        both.run(robot.halt())

    both.within(robot.arm(), lambda _: both.within(robot.motor(), look))
    assert not device.servo_on
    device.emergency_stop()
    with pytest.raises(CallError):
        both.run(robot.execute("Motor", 1))
    device.release_emergency_stop()
    both.run(rc.clear_error())
    assert device.error == 0
    with pytest.raises(CallError) as caught:
        both.run(robot.move(1, "P1"))
    assert caught.value.code == hresult.E_NOTIMPL
    with pytest.raises(CallError) as caught:
        both.run(robot.execute("slvMode", 2))
    assert caught.value.code == hresult.E_INVALIDCOMMAND
    both.run(rc.close())


@pytest.mark.parametrize("mode", [None, 0, 1])
@pytest.mark.parametrize("place", [0, 1], ids=["serial", "tcp"])
def test_slave_mode(both: Both, device: VirtualVE026A, urls: list[str], place: int, mode: int | None) -> None:
    rc = both.connect(urls[place], provider="", dialect=None)
    robot = both.run(rc.robot())

    def stream(entered: Any) -> None:
        assert device.slave_mode == (0x002 if mode == 0 else 0x102)
        entered.target = J(10, *HOME[1:])
        until(lambda: entered.latest.joints is not None and abs(entered.latest.joints[0] - 10) < 0.01)
        assert device.joints[0] == pytest.approx(10, abs=0.01)

    both.within(robot.motor(), lambda _: both.within(robot.slave_mode(mode, speed=50.0), stream))
    assert device.slave_mode == 0
    both.run(rc.close())


def test_the_hand_moves_too(device: VirtualVE026A, urls: list[str]) -> None:
    with orinkit.connect(urls[0]) as rc, rc.robot() as robot, robot.motor(), robot.slave_mode() as stream:
        stream.target = (*HOME[:6], 20.0)
        until(lambda: abs(device.joints[6] - 20.0) < 0.01)
        stream.target = (*HOME[:6], 0.0)
        until(lambda: abs(device.joints[6]) < 0.01)


def test_recovery(device: VirtualVE026A, urls: list[str]) -> None:
    with orinkit.connect(urls[0]) as rc, rc.robot() as robot, robot.motor(), robot.slave_mode() as stream:
        stream.target = J(10, *HOME[1:])
        until(lambda: device.joints[0] > 0.1)
        device.emergency_stop()
        until(lambda: stream.error is not None)
        device.release_emergency_stop()
        stream.recover()
        stream.target = J(*HOME)
        until(lambda: abs(device.joints[0]) < 0.01)
        assert device.error == 0


@pytest.mark.parametrize(
    "options", [{"mode": 2}, {"pose": "P"}, {"recv": ("position",)}, {"recv": ("joints", "current")}, {"mini": 1}]
)
def test_unsupported_slave_modes(urls: list[str], options: dict[str, Any]) -> None:
    with orinkit.connect(urls[0]) as rc, rc.robot() as robot, pytest.raises((InvalidValue, StreamError)):
        robot.slave_mode(**options)


def test_objects_that_share_a_handle(both: Both, device: VirtualVE026A, urls: list[str]) -> None:
    """The controller returns the same handle for equal requests; it is released with the last object."""
    rc = both.connect(urls[0], dialect=None)
    robot = both.run(rc.robot())
    angle = both.run(robot.variable("@CURRENT_ANGLE"))
    again = both.run(robot.variable("@current_angle"))
    assert again.handle == angle.handle
    both.run(again.close())
    assert both.run(angle.get_value())[:7] == list(HOME)
    robot = both.run(rc.robot())
    robot = both.run(rc.robot())
    assert both.run(robot.get_joints())[:7] == HOME
    both.run(robot.close())
    both.run(rc.close())


@pytest.mark.parametrize("place", [0, 1], ids=["serial", "tcp"])
def test_commands_that_take_long_are_waited_for(both: Both, place: int) -> None:
    """They take about 3 s (VE026A 5.3.4), longer than the usual time-out."""
    with orinkit.serve(VirtualVE026A(motor_seconds=1.2, clear_seconds=0.7), "pty://", "tcp://127.0.0.1:0") as server:
        rc = both.connect(server.urls[place], provider="", dialect=None, tries=3)
        robot = both.run(rc.robot())
        before, rc.client.timeout = rc.client.timeout, 0.1
        both.within(robot.motor(), lambda _: None)
        both.run(rc.clear_error())
        rc.client.timeout = before
        both.run(rc.close())


def test_a_motor_whose_task_is_cancelled_goes_off() -> None:
    """The clean-up waits until the arm is no longer busy."""

    async def cancelled(url: str) -> None:
        async with orinkit.aio.connect(url, provider="") as rc:
            robot = await rc.robot()
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(PATIENCE) as limit:
                    passing = asyncio.create_task(pass_while_it_is_busy(limit))
                    async with robot.motor():
                        raise AssertionError
            await passing

    async def pass_while_it_is_busy(limit: asyncio.Timeout) -> None:
        with clock.held():
            while device._arm._operation is None:  # noqa: ASYNC110 - a thread sets it
                await asyncio.sleep(0.002)
            limit.reschedule(0.0)
            await asyncio.sleep(0.1)
            assert not device.servo_on

    clock = HeldClock(1.0)
    with orinkit.serve(device := VirtualVE026A(motor_seconds=0.8, clock=clock), "tcp://127.0.0.1:0") as server:
        asyncio.run(cancelled(server.url))
        assert not device.servo_on
    clock.close()


def test_the_dialect_is_detected_from_replies_over_udp(both: Both, device: VirtualVE026A) -> None:
    with orinkit.serve(device, "udp://127.0.0.1:0") as server:
        rc = both.connect(server.url)
        assert rc.client.dialect.name == "ve026a"
        both.run(rc.close())
