"""Memory and CPU time of a process and of the pages of a browser (Linux)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

MB = 1e6


def resident(pid: int) -> float:
    """Return the resident memory of a process in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MB


def cpu_time(pid: int) -> float:
    """Return the CPU time of a process without its children, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class PageFootprint(NamedTuple):
    """The heap of the scripts of a page in MB, its elements and event listeners, after its garbage has been collected."""

    heap: float
    nodes: int
    listeners: int


def footprint(page: Any) -> PageFootprint:
    """Return the footprint of a page of Playwright (Chromium)."""
    session = page.context.new_cdp_session(page)
    try:
        session.send("HeapProfiler.collectGarbage")
        used = session.send("Runtime.getHeapUsage")["usedSize"]
        counted = session.send("Memory.getDOMCounters")
    finally:
        session.detach()
    return PageFootprint(used / MB, counted["nodes"], counted["jsEventListeners"])
