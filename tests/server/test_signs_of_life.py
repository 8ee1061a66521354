"""A client without a connection must send signs of life while its motions run; if it is killed, its arm stops."""

from __future__ import annotations

import asyncio
import http.client
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import orinkit
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.gateway import AccessRules, RemoteProvider, RestrictedProvider
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both, only
from support.leaping import leap, take_turns
from support.waiting import PATIENCE, until

WITHOUT = only("udp", "serial", "http", because="TCP detects the end of a client by itself")
FAR = orinkit.J(150, 45, 90, 0, 45, 0)


class Arm:
    """The arm of a served controller."""

    def __init__(self, device: VirtualRC8, server: Server) -> None:
        self.arm = device.state.arm
        self.server = server

    @property
    def moving(self) -> bool:
        return self.arm.busy and self.arm.holder is not None

    def free(self) -> bool:
        """Return True if the arm is at standstill and no client has taken it."""
        return not self.arm.busy and self.arm.holder is None

    def after(self, seconds: float) -> bool:
        """Return True if the arm still moves after so much time without a sign of life."""
        leap(self.server, seconds)
        take_turns(self.server)
        return self.moving


@contextmanager
def cell(listen_at: str, **options: Any) -> Iterator[Arm]:
    device = VirtualRC8(motor=True)
    with orinkit.serve(device, listen_at, **options) as server:
        yield Arm(device, server)


def begin(both: Both, url: str, **options: Any) -> Any:
    """Connect, and queue six motions, which take minutes."""
    rc8 = both.connect(url, **options)
    robot = both.run(rc8.robot("Arm"))
    both.run(robot.execute("TakeArm", [0, 0]))
    both.run(robot.execute("ExtSpeed", 1))
    for angle in (150, -150) * 3:
        both.run(robot.move(1, orinkit.J(angle, 45, 90, 0, 45, 0), "NEXT"))
    return rc8


def fall_silent(both: Both, rc8: Any) -> None:
    """Stop a client's signs of life, as if it had been killed."""
    rc8.client._pulse.end()
    both.run(_nothing() if both.loop is not None else None)


async def _nothing() -> None:
    return None


PROGRAM = """
import orinkit, sys, time
rc8 = orinkit.connect(sys.argv[1], dialect="rc8")
robot = rc8.robot("Arm")
robot.execute("TakeArm", [0, 0])
robot.execute("ExtSpeed", 1)
for angle in (150, -150) * 3:
    robot.move(1, orinkit.J(angle, 45, 90, 0, 45, 0), "NEXT")
print("moving", flush=True)
time.sleep(600)
"""


@WITHOUT
def test_a_program_is_killed(listen_at: str) -> None:
    with cell(listen_at) as arm:
        process = subprocess.Popen([sys.executable, "-c", PROGRAM, arm.server.url], stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "moving\n"
            assert arm.moving
        finally:
            process.kill()
            process.communicate()
        until(arm.free)


@pytest.mark.parametrize("moving", [True, False])
def test_a_killed_client_is_logged(listen_at: str, caplog: pytest.LogCaptureFixture, moving: bool) -> None:
    """An operator learns from the log that an arm was stopped because its client was lost."""
    caplog.set_level("INFO", "orinkit.server")
    source = PROGRAM if moving else PROGRAM.replace("(150, -150) * 3", "()")
    with cell(listen_at) as arm:
        process = subprocess.Popen([sys.executable, "-c", source, arm.server.url], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "moving\n"
        process.kill()
        process.communicate()
        if moving:
            until(arm.free)
    logged = [(record.levelname, record.getMessage()) for record in caplog.records]
    told = [level for level, text in logged if " disconnected while its arm moved" in text and "arm is stopped" in text]
    assert told == (["WARNING"] if moving else [])


@only("udp", "serial", because="over HTTP the connection ends")
def test_silence_ends_a_client_whose_arm_moves(both: Both, listen_at: str) -> None:
    udp = listen_at.startswith("udp")
    with cell(listen_at, alive=8.0 if udp else 100.0) as arm:
        rc8 = begin(both, arm.server.url)
        fall_silent(both, rc8)
        if udp:  # a client that is silent for 10 s is dropped in any case
            assert not arm.after(8.5)
        else:
            assert arm.after(50)
            assert not arm.after(51)
        until(arm.free)
        assert arm.server.clients == 0
        with pytest.raises(OrinError):
            both.run(rc8.execute("GetErrorCount"))
        both.run(rc8.client.close())


@WITHOUT
def test_silence_while_nothing_moves(both: Both, listen_at: str) -> None:
    with cell(listen_at) as arm:
        rc8 = both.connect(arm.server.url)
        robot = both.run(rc8.robot("Arm"))
        both.run(robot.execute("TakeArm", [0, 0]))
        fall_silent(both, rc8)
        leap(arm.server, 5)
        assert arm.server.clients == 1
        assert arm.arm.holder is not None
        both.run(rc8.close())


@WITHOUT
def test_a_running_client_sends_signs_of_life(both: Both, listen_at: str) -> None:
    """It sends them even if its program makes no calls."""
    received: list[bytes] = []
    with cell(listen_at, alive=100.0) as arm:
        rc8 = begin(
            both, arm.server.url, trace=lambda direction, data: received.append(data) if direction == "<" else None
        )
        for _ in range(3):
            before = len(received)
            if both.loop is None:
                until(lambda count=before: len(received) > count)
            else:
                both.run(_more_than(received, before))
            assert arm.after(60 if listen_at.startswith("pty") else 6)
        assert arm.moving
        both.run(rc8.close())
        until(arm.free)


async def _more_than(received: list[bytes], count: int) -> None:
    async with asyncio.timeout(PATIENCE):
        while len(received) <= count:  # noqa: ASYNC110 - the test polls
            await asyncio.sleep(0.01)  # the trace is called in this loop, too


@WITHOUT
def test_a_call_in_progress_is_a_sign_of_life(listen_at: str) -> None:
    with cell(listen_at) as arm, orinkit.connect(arm.server.url, dialect="rc8") as rc8:
        robot = rc8.robot("Arm")
        robot.execute("TakeArm", [0, 0])
        robot.execute("ExtSpeed", 1)
        ended: list[Any] = []

        def move() -> None:
            try:
                robot.move(1, FAR)
            except OrinError as error:
                ended.append(error)

        thread = threading.Thread(target=move, daemon=True)
        thread.start()
        until(lambda: arm.arm.queue.joints[0] > 0.1)
        assert arm.after(1.9)
        assert arm.after(1.9)
        assert arm.after(1.9)
        rc8.client.close()
        thread.join()
        assert ended


# --- HTTP ---------------------------------------------------------------------------------------------------------------


class Web:
    """An e-CAP client that does not use orinkit.

    Args:
        cookies: whether it stores cookies.
        kept: whether it keeps its connection open.
        headers: further headers of every request.
    """

    def __init__(self, url: str, *, cookies: bool, kept: bool, headers: dict[str, str] | None = None) -> None:
        self._place = url.rpartition("/")[2]
        self._headers = headers or {}
        self._cookies, self._kept = cookies, kept
        self._cookie = ""
        self._connection: http.client.HTTPConnection | None = None

    def ask(self, body: str) -> str:
        connection = self._connection or http.client.HTTPConnection(self._place)
        headers = {**self._headers, **({"Cookie": self._cookie} if self._cookie else {})}
        connection.request("POST", "/", body, headers)
        answer = connection.getresponse()
        given = answer.getheader("Set-Cookie")
        if given and self._cookies:
            self._cookie = given.partition(";")[0]
        text = answer.read().decode()
        if self._kept:
            self._connection = connection
        else:
            connection.close()
        assert text.startswith("0x00000000"), text
        return text.rpartition(",")[2].strip()

    def begin(self) -> None:
        self.ask("Func=1,Arg1=")
        controller = self.ask("Func=3,Arg1=,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=")
        robot = self.ask(f"Func=7,Arg1={controller},Arg2=Arm,Arg3=")
        self.ask(f"Func=64,Arg1={robot},Arg2=TakeArm")
        self.ask(f"Func=64,Arg1={robot},Arg2=ExtSpeed,Arg3=3,1")
        self.ask(f"Func=72,Arg1={robot},Arg2=1,Arg3=8,J(150, 45, 90, 0, 45, 0),Arg4=NEXT")

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()


def lost_after_silence(*, cookies: bool = True, kept: bool = True, headers: dict[str, str] | None = None) -> None:
    """Check that only silence ends the motions of a client, regardless of its connections."""
    idle = HttpOptions(idle=3600.0)  # a client without requests for this time is dropped in any case
    with cell("http://127.0.0.1:0", alive=100.0, http=idle) as arm:
        web = Web(arm.server.url, cookies=cookies, kept=kept, headers=headers)
        web.begin()
        assert arm.moving
        assert arm.after(40.0)
        assert not arm.after(61.0)
        until(arm.free)
        web.close()


@pytest.mark.parametrize(("cookies", "kept"), [(False, False), (False, True), (True, False)])
def test_http_without_cookie_or_kept_connection(cookies: bool, kept: bool) -> None:
    """A client like curl or a PLC is dropped after a time without requests, regardless of its connections."""
    lost_after_silence(cookies=cookies, kept=kept)


def test_http_with_cookie_and_kept_connection() -> None:
    """A client like a web page is kept exactly as long as one of its connections is open."""
    with cell("http://127.0.0.1:0") as arm:
        web = Web(arm.server.url, cookies=True, kept=True)
        web.begin()
        assert arm.after(30.0)
        web.close()
        until(arm.free)
        assert arm.server.clients == 0


@pytest.mark.parametrize(
    "header", ["Via: 1.1 proxy", "Forwarded: for=192.0.2.7", "X-Forwarded-For: 192.0.2.7", "x-forwarded-proto: https"]
)
def test_http_behind_a_proxy(header: str) -> None:
    """The attack: a proxy keeps its connection to the server after its client has been killed."""
    name, _, value = header.partition(": ")
    lost_after_silence(headers={name: value})


def test_a_client_of_orinkit_behind_a_proxy_that_adds_no_header() -> None:
    """Clients of orinkit send signs of life, so the server need not rely on the end of their connections."""
    lost_after_silence(headers={"Orinkit-Executing": "400"})


def test_a_client_behind_a_proxy_may_change_its_connection() -> None:
    """A proxy may close its connections at any time; only silence shows that a client is lost."""
    with cell("http://127.0.0.1:0", alive=100.0) as arm:
        web = Web(arm.server.url, cookies=True, kept=True, headers={"Via": "1.1 proxy"})
        web.begin()
        web.close()
        assert arm.after(50.0)
        web._connection = None
        web.ask("Func=1,Arg1=")
        assert arm.after(55.0)
        assert not arm.after(50.0)
        web.close()


def test_http_whose_last_connection_ends_while_nothing_moves() -> None:
    with cell("http://127.0.0.1:0") as arm:
        web = Web(arm.server.url, cookies=True, kept=True)
        web.ask("Func=1,Arg1=")
        controller = web.ask("Func=3,Arg1=,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=")
        web.close()
        web._connection = None
        assert web.ask(f"Func=21,Arg1={controller}") == "Controller1"
        assert arm.server.clients == 1
        web.close()


# --- sources of the motion state ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restricted", [False, True])
def test_behind_a_gateway(restricted: bool) -> None:
    with cell("tcp://127.0.0.1:0") as arm:
        remote: Any = RemoteProvider(arm.server.url)
        if restricted:
            remote = RestrictedProvider(remote, AccessRules(commands=("*",)))
        both = Both("sync")
        with orinkit.serve(remote, "udp://127.0.0.1:0") as gateway:
            rc8 = begin(both, gateway.url)
            fall_silent(both, rc8)
            leap(gateway, 1.0)
            assert arm.moving
            leap(gateway, 2.0)
            take_turns(gateway)
            assert gateway.clients == 0  # not later, when a client over UDP is dropped in any case
            until(arm.free)
            rc8.client.close()


@pytest.mark.parametrize("seconds", [0, 0.4, 3601, float("nan"), "2", None, True])
def test_invalid_seconds(seconds: Any) -> None:
    with pytest.raises(InvalidValue, match="alive"):
        orinkit.serve(VirtualRC8(), "udp://127.0.0.1:0", alive=seconds)


def test_a_paused_motion_counts_too() -> None:
    """It could continue at any moment, as a pause is ended at the pendant."""
    with cell("udp://127.0.0.1:0") as arm:
        both = Both("sync")
        rc8 = begin(both, arm.server.url)
        fall_silent(both, rc8)
        with arm.arm._cycles:
            arm.arm.hold()
        until(lambda: arm.arm.queue.standing)
        assert not arm.after(2.5)
        until(arm.free)
        rc8.client.close()
