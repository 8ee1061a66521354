"""The trace of a bus: every frame that is sent or received."""

from __future__ import annotations

from orinkit.abh3.table import ids
from orinkit.can.frame import CanFrame
from orinkit.can.server import PSEUDO_TERMINAL, serve_can
from orinkit.virtual.abh3 import VirtualABH3


def test_all_frames_are_traced(hosts, both):
    traced: list[tuple[str, CanFrame]] = []
    with serve_can(VirtualABH3(), at=PSEUDO_TERMINAL) as server:
        driver = hosts.connect(server.url)
        driver.bus.trace = lambda direction, frame: traced.append((direction, frame))
        both.run(driver.command(ay=1.0))
        both.run(driver.errors())
        driver.bus.trace = None
        both.run(driver.command())
    assert [(direction, frame.id) for direction, frame in traced] == [
        (">", ids.single(1, 2)),
        ("<", ids.single(2, 1)),
        (">", ids.request(1, 2)),
        ("<", ids.broadcast(5, 0, 1)),
    ]
    assert traced[0][1].data == bytes.fromhex("0500000000000000")
