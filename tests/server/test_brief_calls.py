"""Calls whose result another thread computes (``Deferred(brief=True)``): order of requests, time limit, disconnection."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import closing

import pytest

from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from support.busy import BusyServer, occupy
from support.peers import RawClient
from support.waiting import PATIENCE, until

CURVE = "P(330, 0, 300, 180, 0, 180)"


class Planning(BusyServer):
    """A server whose controller plans no motion until :attr:`going` is set, and a client that holds the arm."""

    def __init__(self) -> None:
        super().__init__("tcp://127.0.0.1:0")
        occupy(self.rc8.state.planning, self.going)
        self.controller = self.ask("Controller_Connect", "", "CaoProv.DENSO.VRC", "", "")
        self.robot = self.ask("Controller_GetRobot", self.controller, "Arm", "")
        self.variable = self.ask("Controller_GetVariable", self.controller, "I1", "")
        assert self.ask("Robot_Execute", self.robot, "TakeArm", [0, 0]) is None

    def replies(self, count: int) -> list[tuple[int, int]]:
        """Return the serials and the codes of the next replies."""
        packets = [self.client.packet() for _ in range(count)]
        return [(each.serial, each.code) for each in packets]

    def move(self) -> int:
        """Request a motion, and return as soon as the server has begun to plan it."""
        serial = self.request("Robot_Move", self.robot, 4, CURVE, "NEXT")
        until(lambda: self.rc8.state.arm.planning)
        return serial


@pytest.fixture
def planning() -> Iterator[Planning]:
    with closing(Planning()) as made:
        yield made


def test_further_requests_are_executed_after_the_computation(planning):
    move = planning.move()
    reads = [planning.request("Variable_GetValue", planning.variable) for _ in range(3)]
    planning.going.set()
    assert planning.replies(4) == [(serial, hresult.S_OK) for serial in (move, *reads)]


def test_a_stop_does_not_wait_for_the_computation(planning):
    """Robot_Halt ends the call that is being planned; the motions that wait are refused."""
    move = planning.move()
    waiting = planning.request("Robot_Move", planning.robot, 4, CURVE, "NEXT")
    halt = planning.request("Robot_Halt", planning.robot, "")
    answers = dict(planning.replies(2))
    assert answers.pop(waiting) == hresult.E_ABORT
    assert set(answers) <= {move, halt}
    planning.going.set()
    answers.update(planning.replies(1))
    assert answers[halt] == hresult.S_OK
    assert answers[move] != hresult.S_OK


def test_a_client_that_disconnects_meanwhile_moves_nothing(planning):
    planning.move()
    planning.client.close()
    until(lambda: not planning.rc8.state.arm.planning)
    last = planning.rc8.state.planning.submit(lambda: None, Deferred())
    planning.going.set()
    until(last.done)
    with planning.rc8.guard:
        assert not planning.rc8.state.arm.queue.tickets
        assert planning.rc8.state.arm.holder is None


@pytest.mark.parametrize("how", ["closes", "closes its side", "resets"])
def test_the_arm_stops_if_the_client_is_lost_while_requests_wait(planning, how):
    """The end of a connection is detected although requests of the client wait."""
    assert planning.ask("Robot_Move", planning.robot, 1, "@E J(170, 45, 90, 0, 45, 0)", "NEXT,S=1") is None
    arm = planning.rc8.state.arm
    until(lambda: arm.queue.joints[0] > 0)
    planning.move()
    for _ in range(100):
        planning.request("Robot_Move", planning.robot, 4, CURVE, "NEXT")
    connection = planning.client.socket
    if how == "closes its side":
        connection.shutdown(socket.SHUT_WR)
    else:
        if how == "resets":
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()
    until(lambda: not arm.busy, PATIENCE / 2)
    assert arm.holder is None
    assert arm.queue.joints[0] < 90  # the motion to 170 deg takes longer than the test


def test_a_stop_of_another_client_completes_the_call(planning):
    move = planning.move()
    planning.rc8.pendant.emergency_stop()
    assert planning.replies(1) == [(move, hresult.EMERGENCY_STOP_ON)]
    planning.going.set()
    assert planning.ask("Variable_GetValue", planning.variable) == 0


def test_other_clients_are_served_meanwhile(planning):
    planning.move()
    with RawClient(planning.server.url) as other:
        assert other.ask(BY_NAME["Controller_Connect"].id, "", "CaoProv.DENSO.VRC", "", "") > 0
