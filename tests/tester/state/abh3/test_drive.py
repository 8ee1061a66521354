"""Driving: what the driver receives while a button is held, and when the user is gone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from orinkit.abh3.table.signals import CURRENT, VELOCITY
from orinkit.core.errors import DriverFault, InvalidValue
from orinkit.tester.state import held_motion
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.state.abh3.drive import Drive, DriveRequest
from orinkit.tester.state.abh3.set_point import LONGEST_ENTRY, parse_set_point, range_text, sent_text
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.held_motion import MotionState
from orinkit.tester.state.workspace import Workspace
from support.drivers import RecordedDriver, served_driver, soon, with_connection

FAST = {"acceleration_time": 0.05, "deceleration_time": 0.05}


class User:
    """A user whose presence the test controls."""

    reason = ""

    def absent(self) -> str:
        return self.reason


def driving(
    test: Callable[[Drive, RecordedDriver, User, DriverCell], Awaitable[None]], *, dialect: str = "v1"
) -> RecordedDriver:
    """Run a test with driving enabled."""
    with served_driver(dialect=dialect, **FAST) as (driver, url):

        async def run(connection: DriverConnection) -> None:
            workspace, user = Workspace(), User()
            cell = DriverCell.of(workspace, connection)
            assert cell is DriverCell.of(workspace, connection)
            cell.drive.watch(user.absent)
            await cell.drive.enable()
            assert cell.drive in workspace.motions
            await test(cell.drive, driver, user, cell)
            await cell.drive.disable()
            assert not workspace.motions

        with_connection(url, run, dialect=dialect)
    return driver


def test_the_motors_turn_while_the_button_is_held():
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        assert "servo_on" in driver.state().inputs
        assert "ay_start" not in driver.state().inputs
        drive.start(DriveRequest(ay=120.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 120)
        assert drive.state is MotionState.MOVING
        assert not driver.state().inputs["bx_start"]
        drive.release()
        await soon(lambda: not driver.state().moving)
        last = driver.commands[-1]
        assert (last.ay_command, last.bx_command, last.inputs["start"]) == (0, 0, False)
        assert last.inputs["servo_on"]
        drive.start(DriveRequest(ay=-30.0, bx=60.2), user.absent)
        await soon(lambda: (driver.state().ay_velocity, driver.state().bx_velocity) == (-30, 60.2))

    driver = driving(test)
    assert driver.stopped


def test_start_is_off_until_the_command_has_been_sent():
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        drive.start(DriveRequest(ay=50.0, bx=50.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 50)
        drive.release()
        await soon(lambda: drive.state is MotionState.READY)

    driver = driving(test)
    starts = [index for index, each in enumerate(driver.commands) if each.inputs.value & 0x2002]
    first = driver.commands[starts[0]]
    assert (first.ay_command, first.bx_command) == (50, 50)
    assert driver.commands[starts[0] - 1].ay_command == 50


@pytest.mark.parametrize("gone", ["the page is hidden", "another user holds the controls"])
def test_the_motors_stop_and_the_servo_is_switched_off_if_the_user_is_gone(gone):
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        drive.start(DriveRequest(bx=200.0), user.absent)
        await soon(lambda: driver.state().bx_velocity == 200)
        user.reason = gone
        await soon(lambda: drive.state is MotionState.OFF)
        assert driver.stopped
        assert gone in drive.message
        stopping = [each for each in driver.commands if not each.inputs["servo_on"]][-1]
        assert stopping.inputs.value == 0
        user.reason = ""

    driving(test)


def test_the_user_must_be_present_while_driving_is_enabled():
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        user.reason = "the page was closed"
        await soon(lambda: drive.state is MotionState.OFF)
        assert driver.stopped
        with pytest.raises(InvalidValue, match="not enabled"):
            drive.start(DriveRequest(ay=1.0), user.absent)

    driving(test)


def test_the_servo_stays_on_until_standstill():
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        drive.start(DriveRequest(ay=300.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 300)
        await drive.stop("STOP")
        assert driver.stopped
        assert drive.message == "STOP"

    driver = driving(test)
    commands = driver.commands
    after = commands[max(index for index, each in enumerate(commands) if each.ay_command) + 1 :]
    assert after[0].inputs["servo_on"]
    assert not after[0].inputs["ay_start"]


def test_a_blocked_tester_stops_the_motors():
    async def test(drive: Drive, driver: RecordedDriver, user: User, cell: DriverCell) -> None:
        drive.start(DriveRequest(ay=100.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 100)
        cell.connection.driver._keep_alive_timer.idle = 1e-9  # type: ignore[union-attr]  # as if no call had been made for long
        await soon(lambda: drive.state is MotionState.OFF)
        assert driver.stopped

    driving(test)


def test_a_driver_that_does_not_reply_ends_driving():
    async def test(drive: Drive, driver: RecordedDriver, user: User, cell: DriverCell) -> None:
        drive.start(DriveRequest(ay=100.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 100)
        cell.connection.driver.host.timeout = 0.1
        driver.mute = True
        await soon(lambda: drive.state is MotionState.OFF)
        assert drive.error is not None
        assert cell.connection.driver.commands == (0, 0)
        await soon(lambda: not driver.state().moving)  # by itself, because of its command time-out
        driver.mute = False

    driving(test)


def test_the_operation_ends_if_it_is_not_used(monkeypatch):
    async def test(drive: Drive, driver: RecordedDriver, _: User, __: DriverCell) -> None:
        monkeypatch.setattr(held_motion, "IDLE", 0.01)
        await soon(lambda: drive.state is MotionState.OFF)
        assert "was not used" in drive.message
        assert driver.stopped

    driving(test)


def test_the_end_of_the_connection_stops_the_motors():
    async def test(drive: Drive, driver: RecordedDriver, user: User, cell: DriverCell) -> None:
        drive.start(DriveRequest(ay=100.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 100)
        await cell.connection.close()
        await soon(lambda: drive.state is MotionState.OFF)
        assert (driver.commands[-1].ay_command, driver.commands[-1].inputs["ay_start"]) == (0, False)
        await soon(lambda: not driver.state().moving)
        assert drive.inputs == 0

    driving(test)


@pytest.mark.parametrize("request_", [DriveRequest(ay=6553.5), DriveRequest(bx=-7000.0), DriveRequest(ay=float("nan"))])
def test_a_set_point_out_of_range_is_not_sent(request_):
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        with pytest.raises(InvalidValue, match="velocity"):
            drive.start(request_, user.absent)
        assert not drive.requested

    driver = driving(test)
    assert all(each.ay_command == each.bx_command == 0 for each in driver.commands)


def test_inputs_are_switched():
    async def test(drive: Drive, driver: RecordedDriver, user: User, cell: DriverCell) -> None:
        masks = cell.connection.dialect.inputs.masks
        for name in ("ay_select_1", "bx_torque"):
            await drive.set_input(masks[name].bit_length() - 1, 1)
            assert name in driver.state().inputs
        assert drive.quantity("bx") is CURRENT
        assert drive.quantity("ay") is VELOCITY
        with pytest.raises(InvalidValue, match="current"):
            drive.start(DriveRequest(bx=400.0), user.absent)
        with pytest.raises(InvalidValue, match="while a button is held"):
            await drive.set_input(masks["bx_start"].bit_length() - 1, 1)
        drive.start(DriveRequest(ay=10.0), user.absent)
        with pytest.raises(InvalidValue, match="while a motor is driven"):
            await drive.set_input(0, 0)
        with pytest.raises(InvalidValue, match="while a motor is driven"):
            await cell.write_parameter(0x4102, "1")
        with pytest.raises(InvalidValue, match="while a motor is driven"):
            await cell.reset_errors()
        await drive.disable()
        with pytest.raises(InvalidValue, match="while driving is enabled"):
            await drive.set_input(0, 1)
        assert driver.state().inputs.value == 0

    driving(test)


def test_errors_are_reset():
    async def test(drive: Drive, driver: RecordedDriver, _: User, cell: DriverCell) -> None:
        await drive.disable()
        driver.inject("a_overcurrent")
        await cell.reset_errors()
        assert not driver.state().errors
        driver.inject("overheat", stays=True)
        with pytest.raises(DriverFault):
            await drive.enable()
        assert drive.state is MotionState.OFF
        assert isinstance(drive.error, DriverFault)
        driver.repair("overheat")
        await drive.enable()
        assert drive.error is None

    driving(test)


def test_dialect_v2():
    async def test(drive: Drive, driver: RecordedDriver, user: User, _: DriverCell) -> None:
        drive.start(DriveRequest(ay=20.0, bx=-20.0), user.absent)
        await soon(lambda: driver.state().ay_velocity == 20)
        drive.release()
        await soon(lambda: not driver.state().moving)

    driver = driving(test, dialect="v2")
    assert driver.state().inputs.value == 0


def test_stopping_while_the_preparation_is_in_progress():
    with served_driver() as (driver, url):

        async def run(connection: DriverConnection) -> None:
            drive = DriverCell.of(Workspace(), connection).drive
            enabling = asyncio.create_task(drive.enable())
            await asyncio.sleep(0)
            await drive.stop("STOP")
            await enabling
            assert drive.state is MotionState.OFF
            assert driver.stopped

        with_connection(url, run)


@pytest.mark.parametrize(("text", "number"), [
    ("100", 100.0), (" -6553.6 ", -6553.6), ("+1.", 1.0), (".5", 0.5), ("−3", -3.0),
])  # fmt: skip
def test_a_set_point(text, number):
    assert parse_set_point(text, VELOCITY) == number


@pytest.mark.parametrize(
    "text", ["", "x", "1e3", "1,5", "--1", "nan", "inf", "１", "1" * (LONGEST_ENTRY + 1), "9" * 10_000_000]
)
def test_not_a_set_point(text):
    with pytest.raises(InvalidValue, match="not a number"):
        parse_set_point(text, VELOCITY)


def test_the_text_below_a_set_point():
    assert sent_text("100.1", VELOCITY) == "sends 100.2 min⁻¹ (code 501)"
    assert sent_text("50", CURRENT) == "sends 50.00 % (code 5000)"
    assert sent_text("x", VELOCITY) == range_text(VELOCITY) == "-6553.6 to 6553.4 min⁻¹"
