"""A server that runs out of descriptors: one line in the log, those who are there are served, and it goes on afterwards."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
    said = [line for line in done.stderr.splitlines() if "no connection can be accepted" in line]
    assert 1 <= len(said) <= 12
    assert all("Too many open files" in line for line in said if "suppressed" not in line)
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 20_000
