"""``orinkit`` with a Tester whose log of packets is full from the start: ``python -m support.filled_tester tester ...``

The packets are the printed ones of the documents, over and over, and a few special ones at the end. The environment
variable ``FILLED_PACKETS`` contains their number. With ``FILLED_LIVE``, packets are added all the time, that many per s.
While the Tester runs, the longest delay of its event loop in s is written into the file ``FILLED_DELAY``.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from itertools import cycle
from pathlib import Path
from time import perf_counter, time_ns
from typing import Any

from orinkit.bcap import packet as bcap
from orinkit.cli.app import main
from orinkit.core import hresult
from orinkit.tester import server
from orinkit.tester.state.packet_log import PacketLog
from orinkit.tester.state.workspace import Workspace
from orinkit.values.variant import Variant, VarType
from support import paths

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
COUNT = int(os.environ.get("FILLED_PACKETS", "1000"))
LIVE = float(os.environ.get("FILLED_LIVE", "0"))
DELAY = Path(os.environ["FILLED_DELAY"]) if "FILLED_DELAY" in os.environ else None
_TICK = 0.001  # s


def special() -> list[tuple[str, str, str, bytes]]:
    """Return packets that the documents do not contain: scheme, connection, direction, bytes."""
    get = bcap.Packet(7, 101, [Variant(VarType.I4, 3)], 7)
    again = bcap.Packet(8, 101, [Variant(VarType.I4, 3)], 7)
    large = Variant(VarType.ARRAY | VarType.UI1, bytes(range(256)) * 16 * 1024)
    return [
        ("udp", "udp", ">", bcap.encode(get)),
        ("udp", "udp", ">", bcap.encode(again)),
        ("udp", "udp", "<", bcap.encode(bcap.Packet(8, hresult.S_EXECUTING))),
        ("udp", "udp", "<", bcap.encode(bcap.Packet(8, 0x83201483))),
        ("http", "e-CAP", ">", b"Func=101,Arg1=3,Arg2=,Arg3=,Arg4=,Arg5="),
        ("http", "e-CAP", "<", b"0x00000000,8,IO150"),
        ("tcp", "tcp", ">", bcap.encode(bcap.Packet(9, 102, [Variant(VarType.I4, 3), large]))),
        ("tcp", "tcp", "<", bcap.encode(bcap.Packet(9, 0))[:-1] + b"\x05"),
    ]


class FilledWorkspace(Workspace):
    """A workspace with a full log."""

    def __init__(self, profiles: Path | None = None) -> None:
        super().__init__(profiles)
        fill(self.packets, COUNT)
        self._longest, self._started = 0.0, perf_counter()
        self._task = asyncio.ensure_future(self._add())
        if DELAY is not None:
            self._measure()

    def _measure(self) -> None:
        assert DELAY is not None
        now = perf_counter()
        delay, self._started = now - self._started - _TICK, now
        if not DELAY.exists():  # the test has removed the file, to begin a new measurement
            self._longest = 0.0
        if delay > self._longest:
            self._longest = delay
            DELAY.write_text(f"{delay}")
        asyncio.get_running_loop().call_later(_TICK, self._measure)

    async def _add(self) -> None:
        packets = cycle(PRINTED)
        while LIVE:
            for _ in range(max(int(LIVE / 50), 1)):
                add(self.packets, next(packets))
            await asyncio.sleep(0.02)


def add(log: PacketLog, printed: dict[str, Any], time: int | None = None) -> None:
    """Add a packet of the documents."""
    scheme = "tcp" if printed["transport"] == "tcp" else "udp" if printed["transport"] == "udp" else "serial"
    log.add(scheme, scheme, ">" if printed["kind"] == "request" else "<", bytes.fromhex(printed["hex"]), time)


def fill(log: PacketLog, count: int) -> None:
    """Add packets until the log contains ``count``."""
    last = special()
    packets, now = cycle(PRINTED), time_ns()
    for index in range(count - len(last)):
        add(log, next(packets), now - (count - index) * 1_000_000)
    for scheme, name, direction, data in last:
        log.add(name, scheme, direction, data)  # type: ignore[arg-type]  # one of the two


if __name__ == "__main__":
    server.Workspace = FilledWorkspace  # type: ignore[misc]  # replaced by the test
    sys.exit(main(sys.argv[1:]))
