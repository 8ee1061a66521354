"""What all tests share. This file being here puts ``tests`` on the path: ``import peers``, ``import devices``."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from orinkit.core import i18n
from orinkit.server.log_limiter import THROTTLE
from orinkit.virtual.engine import elastic_time
from support.both import LISTEN_AT, Both

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a background job of a shell: Ctrl-C is tested too
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run in CI, new ones elsewhere; no deadline, as other people's machines are slow.
settings.register_profile("orinkit", deadline=None, max_examples=100, derandomize="CI" in os.environ)
settings.load_profile("orinkit")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that wait longest, so that no worker is left with one of them at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(autouse=True)
def _english() -> Iterator[None]:
    """Texts are in English unless a test says otherwise, whatever the machine's language is."""
    before = i18n.current()
    i18n.use("en")
    yield
    i18n.use(before)


@pytest.fixture(autouse=True)
def _log_of_its_own() -> Iterator[None]:
    """What one test has logged does not count against the next one."""
    THROTTLE.forget()
    yield
    THROTTLE.forget()


@pytest.fixture(autouse=True)
def _patient_controllers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make controllers wait 5 s for a late set-point: a busy machine holds up a process for longer than 250 ms.

    Tests of the 250 ms themselves have the marker ``longest_wait``; a clock that the test moves is theirs.
    """
    if request.node.get_closest_marker("longest_wait") is None:
        monkeypatch.setattr(elastic_time, "LONGEST_WAIT", 5.0)


@pytest.fixture
def no_errors_are_logged(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Neither by the library nor by asyncio: an error in the log is a bug, or a device's, which a test clears away."""
    yield
    # not caplog.records, which are those of the ending itself by now
    assert [record.getMessage() for record in caplog.get_records("call") if record.levelno >= logging.ERROR] == []


@pytest.fixture(params=["sync", "async"])
def both(request: pytest.FixtureRequest) -> Iterator[Both]:
    """Either client, one after the other."""
    client = Both(request.param)
    yield client
    client.close()


@pytest.fixture(params=list(LISTEN_AT))
def listen_at(request: pytest.FixtureRequest) -> str:
    """Where a server is to listen: over TCP, UDP, a serial line, and HTTP."""
    return LISTEN_AT[request.param]
