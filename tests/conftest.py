"""Fixtures of all tests. The presence of this file puts ``tests`` on the path: ``from support import peers``."""

from __future__ import annotations

import gc
import logging
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from orinkit.core import i18n
from orinkit.server.log_limiter import LOG_LIMITER
from orinkit.virtual.engine import elastic_time
from support import bare
from support.both import LISTEN_AT, Both

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # inherited by background jobs of a shell; some tests send SIGINT
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run in CI, new ones elsewhere; no deadline, because some machines are slow.
settings.register_profile("orinkit", deadline=None, max_examples=100, derandomize="CI" in os.environ)
settings.load_profile("orinkit")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--no-extras", action="store_true", help="skip tests that require an extra (see support/bare.py)")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--no-extras"):
        config.pluginmanager.register(bare)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the slow tests first, so that no worker starts one at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Exempt the test items from garbage collection: a pass over them takes 0.4 s, and many tests collect garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _english() -> Iterator[None]:
    """Set the language to English, regardless of the machine's language."""
    before = i18n.current()
    i18n.use("en")
    yield
    i18n.use(before)


@pytest.fixture(autouse=True)
def _log_of_its_own() -> Iterator[None]:
    """Reset the log limiter, so that the log of one test does not count for the next."""
    LOG_LIMITER.forget()
    yield
    LOG_LIMITER.forget()


@pytest.fixture(autouse=True)
def _patient_controllers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make controllers wait 5 s for a late set-point: a busy machine holds up a process for longer than 250 ms.

    Tests of the 250 ms themselves have the marker ``longest_wait``; a clock that the test moves is theirs.
    """
    if request.node.get_closest_marker("longest_wait") is None:
        monkeypatch.setattr(elastic_time, "LONGEST_WAIT", 5.0)


@pytest.fixture
def no_errors_are_logged(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Fail if the library or asyncio logs an error; a test that expects errors must clear the log."""
    yield
    # not caplog.records, which by now contains the records of the teardown
    assert [record.getMessage() for record in caplog.get_records("call") if record.levelno >= logging.ERROR] == []


@pytest.fixture(params=["sync", "async"])
def both(request: pytest.FixtureRequest) -> Iterator[Both]:
    """The synchronous and the asynchronous client in turn."""
    client = Both(request.param)
    yield client
    client.close()


@pytest.fixture(params=list(LISTEN_AT))
def listen_at(request: pytest.FixtureRequest) -> str:
    """The listen addresses of a server for TCP, UDP, a serial line and HTTP, in turn."""
    return LISTEN_AT[request.param]
