"""A restart of the virtual RC8 closes the connections of its clients; they can connect again at once."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest

import orinkit
from orinkit.core.errors import CallError, ConnectionLost, OrinError
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.peers import Gone, RawClient
from support.waiting import until


@pytest.fixture
def rc8() -> Any:
    device = VirtualRC8(motor=True)
    yield device
    device.close()


def test_clients_lose_their_connections(both: Both, rc8: VirtualRC8, listen_at: str) -> None:
    with orinkit.serve(rc8, listen_at) as server:
        controller = both.connect(server.url, timeout=30.0)
        robot = both.run(controller.robot())
        both.run(robot.execute("TakeArm"))
        rc8.pendant.restart()
        with pytest.raises((ConnectionLost, CallError)):
            both.run(robot.execute("CurJnt"))
        assert rc8.pendant.status()["arm_holder"] == ""
        with contextlib.suppress(OrinError):
            both.run(controller.close())
        again = both.connect(server.url, timeout=30.0)
        assert both.run(again.execute("GetCurErrorCount")) == 0
        both.run(again.close())
        until(lambda: not rc8.state.connections)


def test_a_tcp_connection_is_closed(rc8: VirtualRC8) -> None:
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server, RawClient(server.url) as client:
        assert client.ask(3, "", "CaoProv.DENSO.VRC", "", "")
        rc8.pendant.restart()
        with pytest.raises((Gone, OSError)):
            client.packet()
        until(lambda: server.clients == 0)


def test_connections_of_a_device_that_does_not_restart_stay(rc8: VirtualRC8) -> None:
    other = VirtualRC8()
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server, orinkit.connect(server.url) as controller:
        other.pendant.restart()
        assert controller.variable("I1").value == 0
    other.close()
