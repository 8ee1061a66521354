"""A client that calls a virtual RC8 with exact types, as over the wire; time is that of a manual clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import ClientInfo
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core.errors import CallError
from orinkit.values.codec import decode, encode_variant
from orinkit.values.variant import Variant, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8

IDS: Final[Mapping[str, int]] = {function.name: number for number, function in FUNCTIONS.items()}


class GuideClient:
    """A virtual RC8 and a client of it; the motor is on.

    Attributes:
        clock: the clock of the controller.
        rc8: the controller.
        controller: handle of the controller.
        robot: handle of the robot.
    """

    def __init__(self, rc8: VirtualRC8 | None = None, address: str = "192.168.0.7", **settings: Any) -> None:
        self.clock = ManualClock() if rc8 is None else rc8.state.clock
        self.rc8 = rc8 or VirtualRC8(clock=self.clock, **{"motor": True, "samples": False, **settings})
        self._session = Session(ProviderRegistry(self.rc8), ClientInfo(address, "tcp"))
        self.controller = self.value("Controller_Connect", "", "CaoProv.DENSO.VRC", "localhost", "")
        self.robot = self.value("Controller_GetRobot", self.controller, "Arm", "")

    def begin(self, name: str, *arguments: Any) -> CallReply | Pending:
        """Begin a call; return its reply if it is complete."""
        given = [each if isinstance(each, Variant) else variant(each) for each in arguments]
        sent = [_over_the_wire(each) for each in given]
        return self._session.invoke(IDS[name], sent)

    def end(self, outcome: CallReply | Pending, seconds: float = 60.0) -> CallReply:
        """Let time pass until a call is complete, and return its reply."""
        for _ in range(round(seconds / PERIOD)):
            if isinstance(outcome, CallReply):
                return outcome
            if outcome.work.done():
                try:
                    outcome = self._session.complete(outcome, outcome.work.result())
                except CallError as error:
                    outcome = self._session.fail(outcome, error)
            else:
                self.clock.advance(PERIOD)
        raise AssertionError("still not done")

    def call(self, name: str, *arguments: Any) -> Variant | None:
        """Make a call and return its result, with its exact type."""
        reply = self.end(self.begin(name, *arguments))
        assert reply.code == 0, (name, f"{reply.code:08X}", reply.detail)
        return None if reply.result is None else _over_the_wire(reply.result)

    def value(self, name: str, *arguments: Any) -> Any:
        """Make a call and return the plain value of its result."""
        result = self.call(name, *arguments)
        return None if result is None else result.plain

    def code(self, name: str, *arguments: Any) -> int:
        """Make a call and return its return code."""
        return self.end(self.begin(name, *arguments)).code

    # --- shorter forms ------------------------------------------------------------------------------------------

    def execute(self, command: str, parameter: Any = None) -> Variant:
        """Return the result of Controller_Execute."""
        result = self.call("Controller_Execute", self.controller, command, parameter)
        assert result is not None
        return result

    def robot_execute(self, command: str, parameter: Any = None) -> Variant:
        """Return the result of Robot_Execute."""
        result = self.call("Robot_Execute", self.robot, command, parameter)
        assert result is not None
        return result

    def variable(self, name: str) -> int:
        """Return the handle of a variable of the controller."""
        return int(self.value("Controller_GetVariable", self.controller, name, ""))

    def get(self, name: str) -> Variant:
        """Return the value of a variable of the controller."""
        result = self.call("Variable_GetValue", self.variable(name))
        assert result is not None
        return result

    def put(self, name: str, value: Any) -> int:
        """Write a variable of the controller; return the return code."""
        return self.code("Variable_PutValue", self.variable(name), value)

    def robot_get(self, name: str) -> Variant:
        """Return the value of a variable of the robot."""
        result = self.call("Variable_GetValue", self.value("Robot_GetVariable", self.robot, name, ""))
        assert result is not None
        return result

    def robot_put(self, name: str, value: Any) -> int:
        """Write a variable of the robot; return the return code."""
        return self.code("Variable_PutValue", self.value("Robot_GetVariable", self.robot, name, ""), value)

    def program(self, name: str, text: str) -> int:
        """Store a program; return the handle of its task."""
        path = name.rpartition("\\")
        if path[0] and not self.rc8.state.files.exists(f"{path[0]}\\"):
            self.rc8.state.files.make_folder(f"{path[0]}\\")
        self.rc8.state.files.write(f"{name}.pcs", text.encode())
        return int(self.value("Controller_GetTask", self.controller, name, ""))

    def take(self) -> GuideClient:
        """Take the arm."""
        self.robot_execute("TakeArm", [0, 0])
        return self

    def close(self) -> None:
        """Disconnect, and switch the controller off."""
        self._session.close()
        self.rc8.close()


def _over_the_wire(value: Variant) -> Variant:
    found: Variant = decode(encode_variant(value), exact=True)[0]
    return found
