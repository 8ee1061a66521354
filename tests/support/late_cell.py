"""A virtual RC8 in slave mode whose clock and connection are controlled by a test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from orinkit.cao.provider import ClientInfo
from orinkit.values.variant import variant
from orinkit.virtual.clock import Clock, ClockDriver
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from support.cell import ADDRESS, Cell
from support.slave_cell import J0, straight


class HandClock(Clock):
    """A clock with limited patience that is advanced by the test only."""

    def __init__(self, patience: float = 0.25, scale: float = 1.0) -> None:
        super().__init__(scale)
        self.seconds = 0.0
        self.patience = patience
        self.driven: list[Callable[[], float | None]] = []

    def now(self) -> float:
        return self.seconds

    def time_budget(self, seconds: float) -> Callable[[], bool]:
        return lambda: False

    def drive(self, advance: Callable[[], float | None]) -> ClockDriver:
        self.driven.append(advance)
        return _Nobody()


class _Nobody(ClockDriver):
    def wake(self) -> None:
        """Do nothing: the test drives the clock."""

    def close(self) -> None:
        """Do nothing: the test drives the clock."""


class Wire:
    """A connection: data that has arrived but has not been read, and the callbacks that wait for it to be processed."""

    def __init__(self) -> None:
        self.asked: list[Callable[[], None]] = []
        self.arrived: list[Callable[[], Any]] = []

    def when_input_processed(self, handled: Callable[[], None]) -> None:
        self.asked.append(handled)

    def read(self) -> None:
        """Process the data that has arrived, then invoke the callbacks."""
        arrived, self.arrived = self.arrived, []
        for call in arrived:
            call()
        asked, self.asked = self.asked, []
        for handled in asked:
            handled()


class LateCell(Cell):
    """A virtual RC8 with a clock and a connection controlled by the test; its client is in slave mode."""

    def __init__(self, mode: int = J0, *, wired: bool = True, scale: float = 1.0, strict: bool = True) -> None:
        self.hand = HandClock(scale=scale)
        self.wire = Wire()
        self.rc8 = VirtualRC8(clock=self.hand, motor=True, strict_time=strict)
        self.arm = self.rc8.state.arm
        self.cycles_ = self.rc8.state.cycles
        self.controller = self.rc8.connect(
            "c", "", "", ClientInfo(ADDRESS, "tcp", 1, self.wire.when_input_processed if wired else None)
        )
        self.robot = self.controller.get_robot("Arm", "")
        self.commands = [self.arm.queue.joints]
        with self.rc8.guard:
            self.robot.execute("TakeArm", variant([0, 0]))
            self.robot.execute("slvChangeMode", variant(mode))

    def call(self, pose: Any) -> Any:
        """Call slvMove, as the server does."""
        with self.rc8.guard:
            return self.robot.execute("slvMove", variant([*pose, 0.0, 0.0]))

    def drive(self, seconds: float = 0.0) -> float | None:
        """Advance the clock and run the controller; record the resulting command."""
        self.hand.seconds += seconds
        number, joints = self.cycles_.number, self.arm.queue.joints
        pause = self.hand.driven[0]()
        if self.cycles_.number != number or self.arm.queue.joints != joints:
            self.commands.append(self.arm.queue.joints)
        return pause

    def stream(self, poses: Any) -> None:
        """Send a set-point for each cycle, on time."""
        for pose in poses:
            self.call(pose)
            self.drive(PERIOD)
            if self.wire.asked:
                self.read()

    def read(self) -> None:
        """Let the server read the data that has arrived; record the resulting command."""
        number = self.cycles_.number
        self.wire.read()
        if self.cycles_.number != number:
            self.commands.append(self.arm.queue.joints)

    @property
    def error(self) -> int:
        return self.rc8.state.faults.code

    @property
    def on(self) -> bool:
        return self.arm.slave.on

    @property
    def due_in(self) -> float:
        """Seconds until the next cycle."""
        return -self.cycles_.overdue


POSES = list(straight(1.0, 150))

MOVING = 30


def moving(cell: LateCell) -> LateCell:
    """Bring a cell to a constant velocity of 1 deg per cycle, with an empty buffer."""
    cell.stream(POSES[:MOVING])
    assert (cell.error, cell.arm.queue.joints) == (0, POSES[MOVING - 1])
    return cell
