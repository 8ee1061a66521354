"""Virtual RC8s one of whose threads is occupied until :attr:`going` is set: the one for planning, or for loading programs."""

from __future__ import annotations

import threading
from typing import Any

import orinkit
from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import Deferred
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.rc8 import VirtualRC8
from support.cell import Cell
from support.peers import RawClient
from support.waiting import PATIENCE, until


def occupy(lane: Lane, going: threading.Event) -> None:
    """Occupy the thread of a lane until ``going`` is set; return as soon as the thread waits."""
    begun = threading.Event()
    lane.submit(lambda: begun.set() or going.wait(PATIENCE), Deferred())
    assert begun.wait(PATIENCE)


def finish(lane: Lane, going: threading.Event, client: object = None) -> None:
    """Set ``going``, and return as soon as the thread of a lane has done all work of ``client`` and of earlier ones."""
    last = lane.submit(lambda: None, Deferred(), client)
    going.set()
    until(last.done)


class BusyCell(Cell):
    """A cell with the event ``going``, which :meth:`close` sets."""

    def __init__(self) -> None:
        super().__init__(samples=False)
        self.going = threading.Event()

    def close(self) -> None:
        self.going.set()
        super().close()


class BusyServer:
    """A server of a virtual RC8 with the event ``going``, and a client."""

    def __init__(self, *urls: str) -> None:
        self.rc8 = VirtualRC8(motor=True, samples=False)
        self.server = orinkit.serve(self.rc8, *urls)
        self.going = threading.Event()
        self.client = RawClient(self.server.url)

    def ask(self, function: str, *arguments: Any) -> Any:
        """Make a call and return its result."""
        return self.client.ask(BY_NAME[function].id, *arguments)

    def request(self, function: str, *arguments: Any) -> int:
        """Send a request and return its serial."""
        return self.client.request(BY_NAME[function].id, *arguments)

    def close(self) -> None:
        self.going.set()
        self.client.close()
        self.server.close()
