"""ABH3 over real python-can buses: hosts, virtual drivers, and scripted peers."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("can")
pytest.importorskip("msgpack")
pytest.importorskip("serial")
if not hasattr(os, "openpty"):
    pytest.skip("this system has no pseudo-terminals", allow_module_level=True)

from orinkit.abh3.session.multipacket import exchange
from support.abh3_wires import KINDS, Hosts, Peer, Place, place, raw_bus, served
from support.both import Both

_LEFT = 10.0


@pytest.fixture(scope="module", autouse=True)
def _nothing_is_left() -> Iterator[None]:
    """Check that no threads and files are left behind."""
    threads, files = set(threading.enumerate()), _files()
    yield
    end = time.monotonic() + _LEFT
    while time.monotonic() < end:
        gc.collect()
        left = [thread.name for thread in set(threading.enumerate()) - threads if thread.is_alive()]
        if not left and _files() <= files:
            return
        time.sleep(0.02)
    assert left == []
    assert _files() <= files


def _files() -> int:
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.exists() else 0


@pytest.fixture(scope="module", params=KINDS)
def world(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """Provide a bus of every kind, with the drivers 1, 7, 3 and 9."""
    with served(request.param, tmp_path_factory.mktemp("world")) as found:
        yield found


@pytest.fixture(params=KINDS)
def bare(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Place]:
    """Provide a bus of every kind without drivers."""
    with place(request.param, tmp_path) as found:
        yield found


@pytest.fixture
def peer(bare: Place) -> Iterator[Peer]:
    """Provide the peer at the other end of :func:`bare`."""
    found = Peer(raw_bus(bare.far))
    yield found
    found.close()


@pytest.fixture
def hosts(both: Both) -> Iterator[Hosts]:
    """Provide hosts of either client, which are closed at the end."""
    found = Hosts(both)
    yield found
    found.close()


@pytest.fixture(autouse=True)
def _patient_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep multi-packet messages from timing out on a busy machine."""
    for name in ("_sync", "_async"):
        monkeypatch.setattr(f"orinkit.abh3.api.{name}.shared.exchange", partial(exchange, seconds=5.0))


@pytest.fixture(autouse=True)
def _errors_are_bugs(no_errors_are_logged: None) -> None:
    """Check that nothing is logged as an error."""
