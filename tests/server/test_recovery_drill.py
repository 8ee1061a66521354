"""Recovery drill: after every fault, the documented sequence works for every kind of client.

The sequence is ManualReset, ClearError, TakeArm, Motor on three times in a row, and a move (docs/howto/robot-client.md).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import pytest

import orinkit
from orinkit import functions as f
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, OrinError
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.both import LISTEN_AT, Both
from support.cables import cable
from support.peers import Gone, RawClient
from support.waiting import until

SPEED = 20
HOME = [0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0]
FAR = "J(90, 45, 90, 0, 45, 0)"
J2 = 0x202


class Client:
    """A client of any kind, connected, with its handles."""

    def __init__(self, kind: str, url: str) -> None:
        self._both = Both("async" if kind == "async" else "sync")
        self._raw = RawClient(url) if kind == "raw" else None
        self._client = None if self._raw else self._both.client(url, timeout=30.0)
        self.call(f.service_start, ",WDT=400" if self._raw else "")
        self.controller = self.call(f.controller_connect, "", "CaoProv.DENSO.VRC", "localhost", "")
        self.robot = self.call(f.controller_get_robot, self.controller, "Arm", "ID=0")

    def call(self, function: Function[..., Any], *arguments: Any) -> Any:
        """Call a function; raise CallError for an error code."""
        if self._raw is None:
            return self._both.run(self._client.call(function, *arguments))
        serial = self._raw.request(function.id, *arguments)
        answer = self._raw.packet()
        while answer.code == hresult.S_EXECUTING:
            answer = self._raw.packet()
        assert answer.serial == serial
        if answer.code < 0 or answer.code >= 0x8000_0000:
            raise CallError(hresult.unsigned(answer.code))
        return answer.arguments[0] if answer.arguments else None

    def execute(self, command: str, parameter: Any = None) -> Any:
        return self.call(f.robot_execute, self.robot, command, parameter)

    def code(self, command: str, parameter: Any = None) -> int:
        """Execute a command of the robot and return its code, 0 for success."""
        try:
            self.execute(command, parameter)
        except CallError as error:
            return error.code
        return 0

    def move(self, pose: str, option: str) -> int:
        """Move the arm; return the code, 0 for success."""
        try:
            self.call(f.robot_move, self.robot, 1, Variant(VarType.BSTR, pose), option)
        except CallError as error:
            return error.code
        return 0

    def slave_move(self, first: float) -> int:
        return self.code("slvMove", Variant(VarType.R8 | ARRAY, [first, *HOME[1:]]))

    def close(self) -> None:
        """Close the client, which may have lost its connection."""
        with contextlib.suppress(OrinError, OSError):
            if self._raw is not None:
                self._raw.close()
            else:
                self._both.run(self._client.close())
        self._both.close()


class Drill:
    """A virtual RC8, its server, a cable, and a client that has taken the arm."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.device = self._controller(motor=True)
        self.server = self._serve(LISTEN_AT.get(kind, LISTEN_AT["tcp"]))
        self.link = cable(self.server.url)
        self.link.__enter__()
        self.client = Client(kind, self.link.url)
        self.client.execute("TakeArm", [0, 0])

    @property
    def arm(self) -> Any:
        return self.device.state.arm

    @property
    def error(self) -> int:
        return self.device.state.faults.code

    def _controller(self, *, motor: bool) -> VirtualRC8:
        return VirtualRC8(clock=Clock(SPEED), motor=motor, strict_time=True)

    def _serve(self, url: str) -> Any:
        return orinkit.serve(self.device, url, alive=0.5)

    def go(self) -> None:
        """Start a slow motion."""
        assert self.client.move(FAR, "SPEED=1,NEXT") == 0
        assert self.arm.busy

    def reconnect(self) -> None:
        """Replace the client by one that has a new connection."""
        self.client.close()
        self.client = Client(self.kind, self.link.url)

    def restart(self) -> None:
        """Restart the controller: all connections are closed, and the server listens again afterwards."""
        url = self.server.url
        self.server.close()
        self.link.cut()
        self.device = self._controller(motor=False)  # closing the server has switched the first one off
        if self.kind == "serial":  # the pseudo-terminal has gone with the server
            self.link.__exit__()
            self.server = self._serve(LISTEN_AT["serial"])
            self.link = cable(self.server.url)
            self.link.__enter__()
        else:
            self.server = self._serve(url)
            self.link.mend()

    def recover(self) -> None:
        """Execute the documented sequence at once, and check that the arm is at its home pose, ready."""
        client = self.client
        client.call(f.controller_execute, client.controller, "ManualReset", None)
        client.call(f.controller_execute, client.controller, "ClearError", None)
        assert client.code("TakeArm", [0, 0]) == 0
        assert [client.code("Motor", [1, 0]) for _ in range(3)] == [0, 0, 0]
        assert client.move("@E J(0, 45, 90, 0, 45, 0)", "") == 0
        assert list(client.execute("CurJnt")) == pytest.approx(HOME, abs=1e-6)
        with self.device.guard:
            assert (self.error, self.arm.motor.on, self.arm.busy, self.arm.slave.on) == (0, True, False, False)

    def close(self) -> None:
        self.client.close()
        self.link.__exit__(None, None, None)
        self.server.close()
        self.device.close()


def emergency_stop(drill: Drill) -> None:
    drill.go()
    drill.device.emergency_stop(True)
    assert drill.client.move(FAR, "NEXT") == hresult.EMERGENCY_STOP_ON
    drill.device.emergency_stop(False)


def soft_limit(drill: Drill) -> None:
    drill.go()
    code = hresult.TARGET_OVER_SOFT_LIMIT_AXIS1
    assert drill.client.move("J(171, 45, 90, 0, 45, 0)", "NEXT") == code
    assert drill.error == code


def acceleration_error(drill: Drill) -> None:
    code = hresult.COMMAND_ACCELERATION_OVER_AXIS1
    assert drill.client.code("slvChangeMode", J2) == 0
    assert drill.client.slave_move(0.9) in (0, code)
    until(lambda: drill.error == code)
    assert drill.client.slave_move(0.0) in (code, hresult.SLAVE_MODE_OFF)


def starvation(drill: Drill) -> None:
    assert drill.client.code("slvChangeMode", J2) == 0
    assert drill.client.slave_move(0.2) == 0
    until(lambda: drill.error == hresult.COMMAND_DELAY)
    assert [drill.client.slave_move(0.0) for _ in range(2)] == [hresult.COMMAND_DELAY, hresult.SLAVE_MODE_OFF]


def cable_cut(drill: Drill) -> None:
    drill.go()
    drill.link.cut()
    until(lambda: drill.arm.holder is None)
    assert drill.error == 0
    drill.link.mend()
    drill.reconnect()


def controller_restart(drill: Drill) -> None:
    drill.go()
    drill.restart()
    assert gone(drill.client)
    drill.reconnect()


def restart_by_pendant(drill: Drill) -> None:
    """Restart the controller without its server: the server closes the connections of all clients."""
    drill.go()
    drill.device.pendant.restart()
    assert gone(drill.client)
    drill.reconnect()


def gone(client: Client) -> bool:
    """Return True if the client has lost its connection or its session."""
    try:
        client.execute("CurJnt")
    except (OrinError, OSError, Gone):
        return True
    return False


FAULTS: dict[str, Callable[[Drill], None]] = {
    each.__name__: each
    for each in (
        emergency_stop, soft_limit, acceleration_error, starvation, cable_cut, controller_restart, restart_by_pendant,
    )
}  # fmt: skip
KINDS = ("sync", "async", "udp", "serial", "http", "raw")


def drilled(kind: str, fault: str, times: int) -> None:
    """Cause a fault, and recover from it, several times."""
    drill = Drill(kind)
    try:
        for _ in range(times):
            FAULTS[fault](drill)
            drill.recover()
    finally:
        drill.close()


@pytest.mark.field("1.5")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_recovery(kind: str, fault: str) -> None:
    drilled(kind, fault, 1)


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_recovery_fifty_times(kind: str, fault: str) -> None:
    drilled(kind, fault, 50)
