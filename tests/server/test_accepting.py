"""A server that runs out of descriptors: one line in the log, those who are there are served, and it goes on afterwards."""

from __future__ import annotations

import asyncio
import gc
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
    scheme, _, place = server.url.partition("://")
    host, port = place.rsplit(":", 1)
    with orinkit.connect(server.url) as there:
        there.variable("I1").value = 5
        resource.setrlimit(resource.RLIMIT_NOFILE, (100, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        flood = []
        while True:
            try:
                made = socket.socket()
            except OSError:
                break
            made.connect((host, int(port)))
            flood.append(made)
        time.sleep(2.5)
        assert there.variable("I1").value == 5
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
def test_out_of_descriptors_is_one_line_and_over_when_there_are_some(url):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, url], capture_output=True, text=True, encoding="utf-8", timeout=120, check=False
    )
    assert (done.returncode, done.stdout) == (0, "served\n"), done.stderr[-2000:]
    said = [line for line in done.stderr.splitlines() if "cannot accept connections" in line]
    assert 1 <= len(said) <= 12
    assert all("Too many open files" in line for line in said if "suppressed" not in line)
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 20_000


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scheme", ["tcp", "http"])
@pytest.mark.parametrize("turns", range(8))
def test_connections_that_are_being_accepted_while_the_server_is_closed(
    scheme: str, turns: int, caplog: pytest.LogCaptureFixture
) -> None:
    """asyncio takes several turns of the loop to accept one; wherever it is then, it is closed."""

    async def run() -> None:
        server = AsyncServer(Workshop(), f"{scheme}://127.0.0.1:0")
        await server.start()
        place = ("127.0.0.1", int(server.url.rpartition(":")[2].strip("/")))
        clients = [socket.create_connection(place) for _ in range(100)]
        for _ in range(turns):
            await asyncio.sleep(0)
        await server.close()
        for client in clients:
            client.close()

    asyncio.run(run())
    gc.collect()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []
