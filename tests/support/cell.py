"""A virtual RC8 on a clock that stands still, and clients of it that call the served objects themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core.errors import CallError
from orinkit.values.variant import variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import Permission, VirtualRC8

ADDRESS = "192.168.0.7"


class Cell:
    """One virtual RC8 and its first client; ``robot`` has nothing taken, the motor is on."""

    def __init__(self, permission: Permission | None = None, **options: Any) -> None:
        self.clock = ManualClock()
        self.rc8 = VirtualRC8(clock=self.clock, permission=permission, **{"motor": True, **options})
        self.arm = self.rc8.state.arm
        self.controller = self.connect()
        self.robot = self.controller.get_robot("Arm", "")

    def connect(self, address: str = ADDRESS) -> Any:
        """Return the controller object of another client."""
        return self.rc8.connect("c", "localhost", "", ClientInfo(address, "tcp"))

    def execute(self, command: str, parameter: Any = None, seconds: float = 30.0) -> Any:
        """Execute a command of the robot to its end."""
        return self.run(self.robot.execute(command, variant(parameter)), seconds)

    def take(self) -> Cell:
        """Take the arm."""
        self.execute("TakeArm", [0, 0])
        return self

    def move(self, interpolation: int, pose: Any, option: str = "") -> Any:
        """Begin a motion."""
        return self.robot.move(interpolation, variant(pose), option)

    def run(self, result: Any, seconds: float = 30.0) -> Any:
        """Let time pass until a promise is kept, and return what it gives."""
        if isinstance(result, Deferred):
            for _ in range(round(seconds / PERIOD)):
                if result.done():
                    break
                self.clock.advance(PERIOD)
            assert result.done(), "still not done"
            result = result.result()
        return getattr(result, "plain", result)

    def code(self, result: Any, seconds: float = 30.0) -> int:
        """Return the code that a call ends with, 0 if it succeeds."""
        try:
            self.run(result, seconds)
        except CallError as error:
            return error.code
        return 0

    def code_of(self, call: Callable[[], Any]) -> int:
        """Return the code that a call is refused with at once, or ends with; 0 if it succeeds."""
        try:
            return self.code(call())
        except CallError as error:
            return error.code

    def trace(self, cycles: int) -> list[tuple[float, ...]]:
        """Run cycle by cycle and return the command joints after each."""
        joints = []
        for _ in range(cycles):
            self.clock.advance(PERIOD)
            joints.append(self.arm.queue.joints)
        return joints

    def cycles(self, result: Any, most: int = 10_000) -> int:
        """Return after how many cycles a promise is kept; its error is raised."""
        for count in range(most):
            if result.done():
                result.result()
                return count
            self.clock.advance(PERIOD)
        raise AssertionError("still not done")

    def put(self, name: str, value: Any) -> None:
        """Write a variable of the controller."""
        self.controller.get_variable(name, "").put_value(variant(value))

    def stand(self, *joints: float) -> Cell:
        """Put the arm somewhere else, at once."""
        self.arm.place(joints)
        return self

    @property
    def tip(self) -> Any:
        """The frame (4, 4) of the tool that the command is at, in the base."""
        return self.arm.space.tcp(self.arm.queue.joints)

    def close(self) -> None:
        """End."""
        self.rc8.close()
