"""Fixtures for tests of the pages: a virtual RC8 of this process, a Tester connected to it, and a browser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

import orinkit
from orinkit.server.threaded import Server
from support.browser import TesterProcess, open_browser, user

if TYPE_CHECKING:
    from orinkit.virtual.rc8 import VirtualRC8


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless browser; while it is open, asyncio.run cannot be used in this thread."""
    with open_browser() as opened:
        yield opened


class Bench(NamedTuple):
    """A virtual RC8 of this process, whose state tests can examine, and a Tester that is connected to it."""

    rc8: VirtualRC8
    server: Server
    tester: TesterProcess


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    # pytest imports this file before it collects tests, also without the extras: the folder is named test...
    from orinkit.virtual.rc8 import VirtualRC8

    rc8 = VirtualRC8(motor=True)
    with (
        orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
        TesterProcess(server.url, folder=tmp_path_factory.mktemp("tester")) as tester,
    ):
        yield Bench(rc8, server, tester)


@pytest.fixture
def page(browser: Any, bench: Bench) -> Iterator[Any]:
    with user(browser) as opened:
        yield opened
