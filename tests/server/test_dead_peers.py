"""A peer that disappears without notice (cable unplugged, machine off): the arm stops and is free within seconds."""

from __future__ import annotations

import math
import socket
from typing import Any

import pytest

import orinkit
from orinkit.core.errors import InvalidValue
from orinkit.gateway import RemoteProvider, Upstream
from orinkit.server.threaded import Server
from orinkit.transport import tcp_keepalive
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.devices import Workshop
from support.namespaces import cable
from support.waiting import until

SOON = 2.0
MOVING = """
import orinkit, sys
with orinkit.connect(sys.argv[1]) as rc8:
    robot = rc8.robot("Arm")
    robot.execute("TakeArm", [0, 0])
    robot.execute("ExtSpeed", 1)
    for angle in (150, -150) * 3:
        robot.move(1, orinkit.J(angle, 45, 90, 0, 45, 0), "NEXT")
    print("moving", flush=True)
    sys.stdin.read()
"""
needs_linux = pytest.mark.skipif(
    not hasattr(socket, "TCP_USER_TIMEOUT"), reason="these socket options exist on Linux only"
)


@pytest.mark.parametrize("path", ["directly", "over http", "through a gateway"])
def test_a_cable_is_unplugged_while_motions_are_queued(path: str) -> None:
    listen = "http://10.199.7.1:0" if path == "over http" else "tcp://10.199.7.1:0"
    with cable() as laid:
        device = VirtualRC8(motor=True)
        servers = [laid.at_one_end(lambda: orinkit.serve(device, listen, dead_after=SOON))]
        if path == "through a gateway":
            remote = RemoteProvider(servers[0].url)
            servers.append(laid.at_one_end(lambda: orinkit.serve(remote, listen, dead_after=SOON)))
        program = laid.far_program(MOVING, servers[-1].url)
        try:
            assert program.stdout is not None
            assert program.stdout.readline() == "moving\n"
            arm = device.state.arm
            until(lambda: arm.queue.joints[0] > 0.5)
            laid.pull()
            if path != "over http":  # HTTP: the arm is released at the end of the session
                until(lambda: arm.holder is None and not arm.busy)
                assert arm.queue.joints[0] < 140
            until(lambda: not _connections(servers[-1]))
        finally:
            program.kill()
            program.communicate()
            for server in reversed(servers):
                server.close()


def _connections(server: Server) -> list[Any]:
    return [
        each for each in list(server._server._context.all) if hasattr(each, "is_closed") or hasattr(each, "_transport")
    ]


def watched(connection: Any) -> tuple[int, ...]:
    """Return the keep-alive options of a socket: on, s until the first probe, s between probes, probes, time-out in ms."""
    tcp = socket.IPPROTO_TCP
    return (
        connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE),
        connection.getsockopt(tcp, socket.TCP_KEEPIDLE),
        connection.getsockopt(tcp, socket.TCP_KEEPINTVL),
        connection.getsockopt(tcp, socket.TCP_KEEPCNT),
        connection.getsockopt(tcp, socket.TCP_USER_TIMEOUT),
    )


@needs_linux
@only("tcp", "http", because="only TCP has connections that can be broken without notice")
@pytest.mark.parametrize(("seconds", "options"), [(None, (1, 4, 2, 3, 10_000)), (3.5, (1, 1, 1, 3, 3_500))])
def test_both_ends_of_a_connection_are_watched(
    both: Both, listen_at: str, seconds: float | None, options: tuple[int, ...]
) -> None:
    arguments: dict[str, Any] = {} if seconds is None else {"dead_after": seconds}
    with orinkit.serve(Workshop(), listen_at, **arguments) as server:
        rc8 = both.connect(server.url, provider="Test.Workshop", **arguments)
        try:
            (peer,) = (each for each in server._server._context.all if hasattr(each, "connection_lost"))
            transport: Any = getattr(peer, "transport", None) or getattr(peer, "_transport", None)
            assert watched(transport.get_extra_info("socket")) == options
            assert watched(_socket_of(rc8.client._link)) == options
        finally:
            both.run(rc8.close())


def _socket_of(link: Any) -> Any:
    """Return the socket of a client's link."""
    if hasattr(link, "_socket"):
        return link._socket
    inner = link._transport
    if hasattr(inner, "get_extra_info"):
        return inner.get_extra_info("socket")
    if getattr(inner, "_socket", None) is not None:
        return inner._socket
    return inner._stream._wire._transport.get_extra_info("socket")


@needs_linux
def test_a_gateway_watches_its_controller() -> None:
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server:
        remote = RemoteProvider(Upstream(server.url, dead_after=5))
        with orinkit.serve(remote, "tcp://127.0.0.1:0") as gateway, orinkit.connect(gateway.url):
            (connection,) = remote._connections
            assert watched(_socket_of(connection._client._link)) == (1, 2, 1, 3, 5_000)


@pytest.mark.parametrize("seconds", [0, 1.9, -1, math.nan, math.inf, 7201, "10", None, True])
def test_invalid_seconds(both: Both, seconds: Any) -> None:
    with pytest.raises(InvalidValue, match="dead_after"):
        orinkit.serve(Workshop(), "tcp://127.0.0.1:0", dead_after=seconds)
    with pytest.raises(InvalidValue, match="dead_after"):
        both.connect("tcp://127.0.0.1:1", dead_after=seconds)
    with pytest.raises(InvalidValue, match="dead_after"):
        Upstream("tcp://127.0.0.1:1", dead_after=seconds)


class ForeignSocket:
    """A socket of another operating system, which records the options set and rejects some of them."""

    def __init__(self, refused: tuple[int, ...] = ()) -> None:
        self.options: dict[int, int] = {}
        self._refused = refused

    def setsockopt(self, _level: int, option: int, value: int, /) -> None:
        if option in self._refused:
            raise OSError(22, "Invalid argument")
        self.options[option] = value


@pytest.mark.parametrize(("platform", "option"), [("darwin", 0x80), ("win32", 5)])
def test_the_option_names_of_other_systems(monkeypatch: pytest.MonkeyPatch, platform: str, option: int) -> None:
    monkeypatch.setattr(tcp_keepalive.sys, "platform", platform)
    monkeypatch.delattr(socket, "TCP_USER_TIMEOUT", raising=False)
    if platform == "darwin":
        monkeypatch.delattr(socket, "TCP_KEEPIDLE", raising=False)
        monkeypatch.setattr(socket, "TCP_KEEPALIVE", 0x10, raising=False)
    connection = ForeignSocket()
    tcp_keepalive.prepare(connection, 10.0)
    assert connection.options[option] == 10
    assert connection.options[0x10 if platform == "darwin" else socket.TCP_KEEPIDLE] == 4


def test_a_connection_that_rejects_all_options_is_used_unchanged() -> None:
    connection = ForeignSocket(refused=(socket.TCP_NODELAY, socket.SO_KEEPALIVE))
    tcp_keepalive.prepare(connection, 10.0)
    assert socket.TCP_NODELAY not in connection.options
