"""A virtual VE026A on a clock that a test moves, and clients that call the served objects themselves."""

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
    """One client."""

    def __init__(self, arm: VirtualVE026A, client: ClientInfo | None = None) -> None:
        self.controller: Any = arm.connect("", "", "", client or ClientInfo("", "serial"))
        self.robot: Any = self.controller.get_robot("VE026A", "")

    def __call__(self, command: str, parameter: Any = None) -> Any:
        """Execute a command of the robot; returns what the method returns."""
        return self.robot.execute(command, variant(parameter))

    def leave(self) -> None:
        """Release what it holds."""
        self.robot.release()
        self.controller.release()


class VeCell:
    """One virtual VE026A and its first client; the motor is on."""

    def __init__(self, **options: Any) -> None:
        self.clock = ManualClock()
        self.arm = VirtualVE026A(clock=self.clock, **{"motor": True, "strict_time": True, **options})
        self.client = Person(self.arm)
        self.path = [self.arm.joints]

    def run(self, result: Any, seconds: float = 10.0) -> Any:
        """Let cycles pass until a promise is kept, and return what it gives."""
        if isinstance(result, Deferred):
            self.cycles(result, round(seconds / PERIOD))
            result = result.result()
        return getattr(result, "plain", result)

    def cycles(self, promise: Deferred[Any], most: int = 2000) -> int:
        """Return after how many cycles a promise is done."""
        for count in range(most):
            if promise.done():
                return count
            self.cycle()
        raise AssertionError("still not done")

    def cycle(self, count: int = 1) -> None:
        """Let cycles pass, one by one, and keep where the encoders are."""
        for _ in range(count):
            self.clock.advance(PERIOD)
            self.path.append(self.arm.joints)

    def code(self, call: Callable[[], Any]) -> int:
        """Return the code that a call is refused with at once, or ends with; 0 if it succeeds."""
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
        """Call ClearError; returns its code."""
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
        """Let the arm come to rest; returns after how many cycles it stood."""
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
    """Return set-points from the home pose on, a step apart."""
    return [turned(step * (number + 1), axis) for number in range(count)]
