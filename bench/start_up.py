"""Start-up: importing the package, the help of the command line, and a virtual RC8 until it is ready."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

from results import Results

SERVE = ("-m", "orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0")


def completed(*arguments: str) -> float:
    """Return the time in ms that a Python process takes."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return (time.perf_counter() - begin) * 1e3


def ready() -> float:
    """Return the time in ms until a virtual RC8 prints that it is ready."""
    begin = time.perf_counter()
    with subprocess.Popen([sys.executable, *SERVE], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        assert server.stdout is not None
        line = server.stdout.readline()
        spent = (time.perf_counter() - begin) * 1e3
        server.terminate()
    if not line.startswith(b"ready"):
        raise RuntimeError("orinkit serve rc8 has not started")
    return spent


STARTS: dict[str, tuple[Callable[[], float], float]] = {
    "import orinkit": (lambda: completed("-c", "import orinkit"), 50.0),
    "orinkit --help": (lambda: completed("-m", "orinkit", "--help"), 200.0),
    "orinkit serve rc8 until ready": (ready, 350.0),
}


def start_up(runs: int, results: Results) -> None:
    """Measure whole processes, in turn with a bare interpreter."""
    times: dict[str, list[float]] = {name: [] for name in ("", *STARTS)}
    for _ in range(runs):
        times[""].append(completed("-c", "pass"))
        for name, (measure, _) in STARTS.items():
            times[name].append(measure())
    bare = statistics.median(times[""])
    for name, (_, most) in STARTS.items():
        mine = statistics.median(times[name])
        results.compared(f"{name} (bare: python -c pass)", mine, bare, "ms", goal=f"< {most:.0f} ms", met=mine < most)
