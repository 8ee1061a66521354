"""Clients that request large files and do not read them: memory stays limited, and is returned to the system."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from orinkit.cao.functions import BY_NAME
from orinkit.server.capacity import CALL_MEMORY
from support.attacked import Served, served
from support.peers import RawClient
from support.waiting import until

CLIENTS, ROUNDS = 60, 4
TEXT = 7 * 1024 * 1024  # characters; the reply has 14 MB
PEAK = 3 * CALL_MEMORY // 1024  # KiB; one file that is being read and one reply that is being encoded do not count
KEPT = 32 * 1024  # KiB

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is read from /proc"),
]


def call(name: str) -> int:
    return BY_NAME[name].id


def peak(server: Served) -> int:
    """Return the largest resident memory so far, KiB."""
    status = Path(f"/proc/{server.process.pid}/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0])


def attacker(server: Served) -> tuple[RawClient, int]:
    client = RawClient(server.bcap)
    client.socket.settimeout(60.0)
    handle = client.ask(call("Controller_Connect"), "", "CaoProv.DENSO.VRC", "", "")
    return client, int(client.ask(call("Controller_GetFile"), handle, "large.txt", "@Create=1"))


def test_replies_that_are_not_read(tmp_path: Path) -> None:
    with served(tmp_path) as server:
        client, file = attacker(server)
        assert client.ask(call("File_PutValue"), file, "x" * TEXT) is None
        before, kept = peak(server), []
        for _ in range(ROUNDS):
            attackers = [attacker(server) for _ in range(CLIENTS)]
            for each, its in attackers:
                each.request(call("File_GetValue"), its)
            until(lambda: server.figures()[2] < CLIENTS // 2, 60.0)  # every file has been read
            for each, _its in attackers:
                each.close()
            assert client.ask(call("File_GetValue"), file) == "x" * TEXT
            until(lambda: server.figures()[1] < CLIENTS // 2, 60.0)
            kept.append(server.figures()[0])
        assert peak(server) < before + PEAK, kept
        assert kept[-1] < kept[0] + KEPT, kept
        client.close()
