"""A hundred moving arms in one process, each polled at 25 Hz: ``orinkit serve rc8 --count 100``.

If this version has no ``--count``, one process serves as many providers, each on a port of its own
(``python bench/arms.py COUNT``).
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import orinkit
from orinkit import functions
from orinkit.virtual.rc8 import VirtualRC8
from packets import encode_request
from results import Results, Row, judged
from server_load import opened, poll

FREQUENCY = 25.0
ANGLES = (-160, 160)  # deg of J1: at 5 % of the speed, the second motion alone takes longer than the measurement
REQUESTS = (
    (functions.service_start, ()),
    (functions.controller_connect, ("", "CaoProv.DENSO.VRC", "localhost", "")),
    (functions.controller_get_robot, (2, "Arm", "")),
    (functions.robot_execute, (3, "TakeArm", [0, 0])),
    (functions.robot_execute, (3, "ExtSpeed", [5.0])),
    *((functions.robot_move, (3, 1, f"J({angle}, 45, 90, 0, 45, 0)", "NEXT")) for angle in ANGLES),
)
SETUP = tuple(encode_request(function, arguments, number) for number, (function, arguments) in enumerate(REQUESTS, 1))  # type: ignore[arg-type]  # one table for all calls
POLL = encode_request(functions.robot_execute, (3, "CurJnt"), 1)
CPU_GOAL = 45.0  # % of a core
MEMORY_GOAL = 0.5  # MB per arm


def free_ports(count: int) -> int:
    """Return a port after which ``count - 1`` further ports are free."""
    for first in range(21_000, 60_000, count):
        with ExitStack() as stack:
            try:
                for port in range(first, first + count):
                    taken = stack.enter_context(socket.socket())
                    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    taken.bind(("127.0.0.1", port))
            except OSError:
                continue
            return first
    raise RuntimeError(f"there are no {count} consecutive free ports")


@contextmanager
def served(count: int) -> Iterator[tuple[int, list[int], bool]]:
    """Serve many arms in one process; yield its process ID, the ports, and whether the option ``--count`` was used."""
    at = f"127.0.0.1:{free_ports(count)}"
    command = [sys.executable, "-m", "orinkit", "serve", "rc8", "--tcp", at, "--motor-on", "--count", str(count)]
    for arguments, optional in ((command, True), ([sys.executable, __file__, str(count)], False)):
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
            assert server.stdout is not None
            try:
                lines = [line for line in (server.stdout.readline() for _ in range(count)) if line]
                if len(lines) == count:
                    yield server.pid, [int(line.rpartition(":")[2]) for line in lines], optional
                    return
            finally:
                server.terminate()
    raise RuntimeError("the server has not started")


def resident(pid: int) -> float:
    """Return the resident memory of a process in MB."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) * 1024 / 1e6


def arms(count: int, seconds: float, results: Results) -> None:
    """Measure CPU time and memory of many moving arms in one process."""
    if not Path("/proc/self/stat").exists():
        print("Many arms: not measured, because this system has no /proc.")
        return
    with served(1) as (pid, ports, _), opened(ports, SETUP) as peers:
        poll(peers, pid, FREQUENCY, 0.2, POLL)
        alone = resident(pid)
    with served(count) as (pid, ports, optional), opened(ports, SETUP) as peers:
        polled = poll(peers, pid, FREQUENCY, seconds, POLL)
        each = (resident(pid) - alone) / max(1, count - 1)
    how = "" if optional else "; without --count: a server and a thread for each arm"
    what = f"{count} moving arms in one process, polled at {FREQUENCY:.0f} Hz"
    met = polled.complete and polled.share <= CPU_GOAL
    results.add(Row(f"{what}: CPU", polled.share, "% of a core", goal=f"<= {CPU_GOAL:.0f} %", met=judged(met),
                    note=polled.note() + how))  # fmt: skip
    results.limited(f"{what}: memory of each", each, "MB", MEMORY_GOAL)


def main() -> None:
    """Serve many arms until this process is terminated."""
    with ExitStack() as stack:
        for _ in range(int(sys.argv[1])):
            server = stack.enter_context(orinkit.serve(VirtualRC8(motor=True, samples=False), "tcp://127.0.0.1:0"))
            print("ready", server.url, flush=True)
        threading.Event().wait()


if __name__ == "__main__":
    main()
