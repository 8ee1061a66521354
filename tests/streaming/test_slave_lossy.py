"""Streaming over UDP and serial lines: they are handed over like TCP connections, and lost packets are sent again."""

from __future__ import annotations

import select
import socket
import threading
from typing import Any

import pytest

import orinkit
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.streams import HOME, Arm, sine
from support.waiting import PATIENCE


class Relay:
    """A relay of datagrams between a client and a server that drops some of them."""

    def __init__(self, url: str, every: int) -> None:
        host, _, port = url.removeprefix("udp://").rpartition(":")
        self._server = (host, int(port))
        self._every = every
        self._client: Any = None
        self.lost = 0
        self._count = 0
        self._front = socket.socket(type=socket.SOCK_DGRAM)
        self._front.bind(("127.0.0.1", 0))
        self._back = socket.socket(type=socket.SOCK_DGRAM)
        self._back.connect(self._server)
        self._running = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self.losing = False

    @property
    def url(self) -> str:
        return f"udp://127.0.0.1:{self._front.getsockname()[1]}"

    def _run(self) -> None:
        while self._running:
            for ready in select.select([self._front, self._back], [], [], 0.05)[0]:
                data, sender = ready.recvfrom(65536)
                if ready is self._front:
                    self._client = sender
                self._count += 1
                if self.losing and self._count % self._every == 0:
                    self.lost += 1
                elif ready is self._front:
                    self._back.send(data)
                else:
                    self._front.sendto(data, self._client)

    def close(self) -> None:
        self._running = False
        self._thread.join()
        self._front.close()
        self._back.close()


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("url", ["udp://127.0.0.1:0", "pty://"])
def test_streaming(both: Both, url: str, mode: int) -> None:
    device = VirtualRC8(motor=True, joints=HOME)
    with orinkit.serve(
        device, url, alive=PATIENCE
    ) as server:  # a busy machine may delay the client for longer than 2 s
        controller = both.connect(server.url)
        robot = both.run(controller.robot("Arm"))
        points = sine(0.4, 1.0 if mode == 1 else 2.0)  # in mode 1, a repeated set-point stops the arm for a cycle
        arm = Arm(device, server.url)

        def body(_: object) -> None:
            both.within(robot.slave_mode(mode), lambda stream: both.run(stream.run(points)))

        both.within(robot.arm(), body)
        assert arm.carried_out(points) or mode == 1
        assert arm.commands[-1] == pytest.approx(HOME)
        assert not arm.errors
        assert both.run(both.run(controller.variable("I1")).get_value()) == 0  # the connection was handed back
        both.run(controller.close())


@pytest.mark.parametrize("mode", [0, 2])
def test_streaming_while_datagrams_are_lost(mode: int) -> None:
    """A lost set-point is sent again in time, and none is executed twice."""
    device = VirtualRC8(motor=True, joints=HOME)
    with orinkit.serve(device, "udp://127.0.0.1:0") as server:
        relay = Relay(server.url, every=23)
        try:
            with orinkit.connect(relay.url) as controller, controller.robot("Arm") as robot:
                points = sine(0.6, 2.0)
                arm = Arm(device, server.url)
                with robot.arm(), robot.slave_mode(mode) as stream:
                    relay.losing = True
                    stream.run(points)
                    relay.losing = False
                assert relay.lost > 3
                assert arm.carried_out(points)
                assert not arm.errors
        finally:
            relay.close()
