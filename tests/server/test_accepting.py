"""A server that runs out of descriptors logs one line, serves its connected clients, and accepts new ones afterwards."""

from __future__ import annotations

import asyncio
import gc
import itertools
import logging
import socket
import subprocess
import sys

import pytest

from orinkit.server.aio_server import AsyncServer
from support.devices import Workshop

PROGRAM = """
import logging, resource, socket, sys, threading, time
import orinkit
from orinkit.virtual.rc8 import VirtualRC8

url = sys.argv[1]
logging.basicConfig(stream=sys.stderr, level=logging.INFO)
with orinkit.serve(VirtualRC8(), url, clients=2000) as server:
    scheme, _, location = server.url.partition("://")
    host, port = location.rsplit(":", 1)
    with orinkit.connect(server.url) as connected:
        connected.variable("I1").value = 5
        resource.setrlimit(resource.RLIMIT_NOFILE, (100, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        flood = []
        while True:
            try:
                opened = socket.socket()
            except OSError:
                break
            opened.connect((host, int(port)))
            flood.append(opened)
        time.sleep(2.5)
        assert connected.variable("I1").value == 5
        for each in flood:
            each.close()
        end = time.monotonic() + 30
        while True:
            try:
                with orinkit.connect(server.url) as late:
                    assert late.variable("I1").value == 5
                break
            except (orinkit.OrinError, OSError):
                assert time.monotonic() < end
                time.sleep(0.1)
print("served", flush=True)
"""


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:0", "http://127.0.0.1:0"])
def test_running_out_of_descriptors_is_logged_once_and_accepting_resumes(url):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, url], capture_output=True, text=True, encoding="utf-8", timeout=120, check=False
    )
    assert (done.returncode, done.stdout) == (0, "served\n"), done.stderr[-2000:]
    logged = [line for line in done.stderr.splitlines() if "cannot accept connections" in line]
    assert 1 <= len(logged) <= 12
    assert all("Too many open files" in line for line in logged if "suppressed" not in line)
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 20_000


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scheme", ["tcp", "http"])
@pytest.mark.parametrize("turn_count", range(8))
def test_connections_that_are_being_accepted_while_the_server_closes(
    scheme: str, turn_count: int, caplog: pytest.LogCaptureFixture
) -> None:
    """asyncio needs several turns of the loop to accept a connection; it is closed at any of these steps."""

    async def run() -> None:
        server = AsyncServer(Workshop(), f"{scheme}://127.0.0.1:0")
        await server.start()
        location = ("127.0.0.1", int(server.url.rpartition(":")[2].strip("/")))
        clients = [socket.create_connection(location) for _ in range(100)]
        for _ in range(turn_count):
            await asyncio.sleep(0)
        await server.close()
        for client in clients:
            client.close()

    asyncio.run(run())
    gc.collect()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


@pytest.mark.parametrize("scheme", ["tcp", "http"])
def test_a_start_that_is_cancelled_leaves_no_socket_open(scheme):
    """The start is cancelled in each turn of the event loop; then the address must be free."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        address = probe.getsockname()

    async def cancelled(turns: int) -> bool:
        server = AsyncServer(Workshop(), f"{scheme}://127.0.0.1:{address[1]}")
        starting = asyncio.create_task(server.start())
        for _ in range(turns):
            await asyncio.sleep(0)
        if starting.done():
            await server.close()
            return False
        starting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await starting
        socket.create_server(address).close()
        return True

    assert asyncio.run(cancelled(1))
    for turns in itertools.takewhile(lambda turns: asyncio.run(cancelled(turns)), itertools.count(2)):
        assert turns < 100
