"""``kill -9`` of the served virtual RC8 during writes: every acknowledged write exists after a restart."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit.core.errors import CallTimeout, TransportError

PATIENT = 30.0
KILLS = 3
WRITES = 5000

# The value of each write, from a running number; no two clients share a variable.
CLIENTS: dict[str, Callable[[int], Any]] = {
    "I": lambda number: number,
    "S": lambda number: f"書き込み {number}",
    "P": lambda number: [number + axis / 8 for axis in range(7)],
    "IO": lambda number: number % 3 == 0,
}


@contextmanager
def served(state: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run ``orinkit serve rc8`` on a free port; killed at the end if it is still running."""
    command = [sys.executable, "-m", "orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0", "--state", str(state)]
    environment = os.environ | {"PYTHONPATH": str(Path(orinkit.__file__).parent.parent)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as server:
        watchdog = threading.Timer(100.0, server.kill)  # the test must not wait forever
        watchdog.start()
        try:
            assert server.stdout is not None
            ready, url = server.stdout.readline().split()
            assert ready == "ready"
            yield server, url
        finally:
            watchdog.cancel()
            server.kill()


class Writer:
    """A client that writes its class of variables repeatedly, and records the acknowledged writes."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind = kind
        self.count = 0
        self.acknowledged: dict[int, Any] = {}
        self.attempted: tuple[int, Any] | None = None
        self._chance = random.Random(seed)

    def write(self, url: str, count: Callable[[], bool]) -> None:
        """Write until ``count()``, called after every acknowledged write, returns True, or the server is killed."""
        index = 0
        try:
            with orinkit.connect(url, timeout=PATIENT) as controller:
                variables = [controller.variable(f"{self.kind}{index}") for index in range(100)]
                while True:
                    index, value = self._chance.randrange(100), CLIENTS[self.kind](self.count)
                    self.attempted = index, value
                    variables[index].value = value
                    self.attempted = None
                    self.acknowledged[index] = value
                    self.count += 1
                    if count():
                        return
        except CallTimeout:
            raise
        except TransportError:
            return

    def check(self, url: str) -> None:
        """Check that every acknowledged value exists; of an unacknowledged last write, the old or the new one."""
        with orinkit.connect(url, timeout=PATIENT) as controller:
            found = {index: controller.variable(f"{self.kind}{index}").value for index in self.acknowledged}
            if self.attempted is not None:
                index, value = self.attempted
                if index not in found:
                    return
                assert found[index] in (self.acknowledged[index], value)
                self.acknowledged[index] = found[index]
                self.attempted = None
        assert found == self.acknowledged


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_no_acknowledged_write_is_lost(tmp_path: Path, seed: int) -> None:
    """5,000 writes by four clients; the server is killed three times meanwhile at random moments."""
    chance = random.Random(seed)
    moments = sorted(chance.sample(range(500, WRITES - 500), KILLS))
    writers = [Writer(kind, seed) for kind in CLIENTS]
    for moment in [*moments, WRITES]:
        with served(tmp_path) as (server, url):
            for writer in writers:
                writer.check(url)
            reached = threading.Event()

            def enough(moment: int = moment, reached: threading.Event = reached) -> bool:
                if sum(writer.count for writer in writers) >= moment:
                    reached.set()
                return moment == WRITES and reached.is_set()

            with ThreadPoolExecutor(len(writers)) as pool:
                work = [pool.submit(writer.write, url, enough) for writer in writers]
                assert reached.wait(PATIENT * 2)
                if moment < WRITES:
                    server.kill()  # while the clients continue to write
                for each in work:
                    each.result(PATIENT)
            if moment < WRITES:
                assert server.wait(PATIENT) < 0
    assert sum(writer.count for writer in writers) >= WRITES
    with served(tmp_path) as (server, url):
        for writer in writers:
            writer.check(url)
            assert len(writer.acknowledged) == 100
        server.terminate()
        assert server.wait(PATIENT) == 0


def test_a_server_killed_while_idle_keeps_everything(tmp_path: Path) -> None:
    with served(tmp_path) as (server, url):
        with orinkit.connect(url, timeout=PATIENT) as controller:
            controller.variable("D7").value = 0.1
            controller.variable("S7").value = "最後"
        server.kill()
        server.wait(PATIENT)
    with served(tmp_path) as (_, url), orinkit.connect(url, timeout=PATIENT) as controller:
        assert (controller.variable("D7").value, controller.variable("S7").value) == (0.1, "最後")
