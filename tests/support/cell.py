"""A virtual RC8 with a manual clock, and clients that call the served objects directly."""

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
    """A virtual RC8 and its first client; the motor is on, and ``robot`` has not taken the arm."""

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
        """Start a motion."""
        return self.robot.move(interpolation, variant(pose), option)

    def run(self, result: Any, seconds: float = 30.0) -> Any:
        """Let time pass until a deferred result is available, and return its value."""
        if isinstance(result, Deferred):
            for _ in range(round(seconds / PERIOD)):
                if result.done():
                    break
                self.clock.advance(PERIOD)
            assert result.done(), "still not done"
            result = result.result()
        return getattr(result, "plain", result)

    def code(self, result: Any, seconds: float = 30.0) -> int:
        """Return the final return code of a call, 0 if it succeeds."""
        try:
            self.run(result, seconds)
        except CallError as error:
            return error.code
        return 0

    def code_of(self, call: Callable[[], Any]) -> int:
        """Make a call and return its return code, immediate or final; 0 if it succeeds."""
        try:
            return self.code(call())
        except CallError as error:
            return error.code

    def trace(self, cycles: int) -> list[tuple[float, ...]]:
        """Run for a number of cycles and return the command joints after each."""
        joints = []
        for _ in range(cycles):
            self.clock.advance(PERIOD)
            joints.append(self.arm.queue.joints)
        return joints

    def cycles(self, result: Any, most: int = 10_000) -> int:
        """Return the number of cycles until a deferred result is available; its error is raised."""
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
        """Place the arm at joints immediately, without a motion."""
        self.arm.place(joints)
        return self

    @property
    def tip(self) -> Any:
        """The tool frame (4, 4) at the command position, in base coordinates."""
        return self.arm.space.tcp(self.arm.queue.joints)

    def close(self) -> None:
        """Close the controller."""
        self.rc8.close()
