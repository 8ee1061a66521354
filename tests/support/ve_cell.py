"""A virtual VE026A with a manual clock, and clients that call the served objects directly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.ve026a import VirtualVE026A

HOME = (0.0, 30.0, 120.0, 0.0, 30.0, 0.0, 0.0)
SYNC, ASYNC = 0x002, 0x102
R4 = int(VarType.R4) | ARRAY


class Person:
    """A client of the controller and the robot."""

    def __init__(self, arm: VirtualVE026A, client: ClientInfo | None = None) -> None:
        self.controller: Any = arm.connect("", "", "", client or ClientInfo("", "serial"))
        self.robot: Any = self.controller.get_robot("VE026A", "")

    def __call__(self, command: str, parameter: Any = None) -> Any:
        """Execute a command of the robot and return the result of the method."""
        return self.robot.execute(command, variant(parameter))

    def leave(self) -> None:
        """Release the robot and the controller."""
        self.robot.release()
        self.controller.release()


class VeCell:
    """A virtual VE026A and its first client; the motor is on."""

    def __init__(self, **options: Any) -> None:
        self.clock = ManualClock()
        self.arm = VirtualVE026A(clock=self.clock, **{"motor": True, "strict_time": True, **options})
        self.client = Person(self.arm)
        self.path = [self.arm.joints]

    def run(self, result: Any, seconds: float = 10.0) -> Any:
        """Run until a deferred result is available, and return its value."""
        if isinstance(result, Deferred):
            self.cycles(result, round(seconds / PERIOD))
            result = result.result()
        return getattr(result, "plain", result)

    def cycles(self, deferred: Deferred[Any], most: int = 2000) -> int:
        """Return the number of cycles until a deferred result is available."""
        for count in range(most):
            if deferred.done():
                return count
            self.cycle()
        raise AssertionError("still not done")

    def cycle(self, count: int = 1) -> None:
        """Run cycles one by one and record the encoder positions."""
        for _ in range(count):
            self.clock.advance(PERIOD)
            self.path.append(self.arm.joints)

    def code(self, call: Callable[[], Any]) -> int:
        """Make a call and return its return code, immediate or final; 0 if it succeeds."""
        try:
            self.run(call())
        except CallError as error:
            return error.code
        return 0

    def execute(self, command: str, parameter: Any = None) -> Any:
        """Execute a command of the first client to its end."""
        return self.run(self.client(command, parameter))

    def on(self, mode: int = ASYNC) -> VeCell:
        """Enter slave mode."""
        assert self.execute("slvChangeMode", mode) is None
        assert self.arm.slave_mode == mode
        return self

    def clear(self) -> int:
        """Call ClearError and return its return code."""
        return self.code(lambda: self.client.controller.execute("ClearError", Variant(VarType.I2, 0)))

    def send(self, pose: Sequence[float]) -> Any:
        """Call slvMove with an array of R4."""
        return self.client("slvMove", Variant(R4, list(pose)))

    def stream(self, poses: Sequence[Sequence[float]]) -> None:
        """Send a set-point for each cycle."""
        for pose in poses:
            self.run(self.send(pose))
            self.cycle()

    def rest(self, most: int = 200) -> int:
        """Run until the arm is at standstill; return the number of cycles."""
        self.cycle(5)
        for count in range(most):
            if self.path[-1] == self.path[-5]:
                return count
            self.cycle()
        raise AssertionError("it still moves")


def turned(angle: float, axis: int = 0) -> tuple[float, ...]:
    """Return the home pose with one axis turned by an angle."""
    return (*HOME[:axis], HOME[axis] + angle, *HOME[axis + 1 :])


def ramp(step: float, count: int, axis: int = 0) -> list[tuple[float, ...]]:
    """Return set-points that start at the home pose, with a distance of ``step`` deg."""
    return [turned(step * (number + 1), axis) for number in range(count)]
