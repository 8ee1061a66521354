"""A lost client of a controller with two robots: both arms stop within their limits, and are free."""

from __future__ import annotations

import contextlib

import pytest

import orinkit
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8 import VirtualRC8
from support.arm_log import logged
from support.leaping import leap, take_turns
from support.peers import RawClient
from support.waiting import until
from support.web import Web

CONNECT, GET_ROBOT, EXECUTE, MOVE = 3, 7, 64, 72
FAR = ("J(120, 20, 110, 40, 30, 90)", "J(-60, 30, 100, 20, 40, 30)")


class TcpClient:
    """A client over b-CAP."""

    def __init__(self, server: Server) -> None:
        self._raw = RawClient(server.urls[0])

    def call(self, function: int, *arguments: object) -> object:
        return self._raw.ask(function, *arguments)

    def lose(self, server: Server) -> None:
        self._raw.close()


class HttpClient:
    """A client over e-CAP; a lost connection ends it after the idle time."""

    def __init__(self, server: Server) -> None:
        self._web = Web(server.urls[1], keeps_cookies=True)

    def call(self, function: int, *arguments: object) -> object:
        answer = self._web.call(function, *arguments)
        assert answer.code == 0
        return answer.handle if function in (CONNECT, GET_ROBOT) else None

    def lose(self, server: Server) -> None:
        self._web.close()
        leap(server, HttpOptions().idle)


@pytest.mark.parametrize("kind", [TcpClient, HttpClient])
@pytest.mark.parametrize("what", ["motions", "a cooperative motion", "collected motions"])
def test_both_arms_stop(kind: type[TcpClient | HttpClient], what: str) -> None:
    clock = ManualClock()
    rc8 = VirtualRC8(clock=clock, motor=True, second_model="VS-060")
    rc8.pendant.teach("V", 1, [0.0, 150.0, 0.0])
    arms = [robot.arm for robot in rc8.state.robots]
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0", "http://127.0.0.1:0") as server,
        contextlib.ExitStack() as stack,
    ):
        logs = [stack.enter_context(logged(rc8, robot)) for robot in (0, 1)]
        client = kind(server)
        controller = client.call(CONNECT, "", "CaoProv.DENSO.VRC", "", "")
        robots = [client.call(GET_ROBOT, controller, "Arm", f"ID={number}") for number in (0, 1)]
        taking, following, line = ("8195,0,0", "8195,1", "8204,(3,2),(8,V1)")
        if kind is TcpClient:
            taking, following, line = [0, 0], [1], [2, "V1"]
        for robot in robots:
            client.call(EXECUTE, robot, "TakeArm", taking)
        if what == "a cooperative motion":
            client.call(EXECUTE, robots[0], "SyncMoveStart", following)
            client.call(EXECUTE, robots[0], "Draw", line)
            client.call(EXECUTE, robots[0], "SyncMoveEnd", 1 if kind is TcpClient else "3,1")
        else:
            if what == "collected motions":
                client.call(EXECUTE, robots[0], "SyncTimeStart", "")
            for robot, pose in zip(robots, FAR, strict=True):
                client.call(MOVE, robot, 1, pose if kind is TcpClient else f"8,{pose}", "NEXT")
        for _ in range(12):
            clock.advance(PERIOD)
        assert all(arm.busy for arm in arms) is (what != "collected motions")
        client.lose(server)
        until(lambda: server.clients == 0)
        take_turns(server)
        for _ in range(200):
            clock.advance(PERIOD)
        for arm, log in zip(arms, logs, strict=True):
            log.check_limits()
            assert log.moved is (what != "collected motions")
            assert arm.holder is None
            assert not arm.companions
    rc8.close()
