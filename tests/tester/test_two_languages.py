"""Pages in both languages at the same time: errors that the Tester notices itself appear in the language of each page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

import orinkit
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.browser import TesterProcess, needs_browser, user

pytestmark = [needs_browser, pytest.mark.soak]

NOT_CONNECTED = {"en": "is not connected. Try: Connect on the page Connections", "ja": "は接続されていません"}
LOST = {"en": "connection lost", "ja": "接続が失われました"}
REFUSED = {
    "en": "no program listens at this address. Try: check the address",
    "ja": "このアドレスで待ち受けているプログラムがありません",
}


@pytest.fixture
def server() -> Iterator[Server]:
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as running:
        yield running


@pytest.fixture
def pages(browser: Any, server: Server, tmp_path: Any) -> Iterator[dict[str, Any]]:
    """A page Monitor and a page Connections of one user in English and one in Japanese, by language and path."""
    with ExitStack() as stack:
        tester = stack.enter_context(TesterProcess(server.url, folder=tmp_path))  # its process has the language English
        opened = {}
        for language in ("ja", "en"):
            monitor = stack.enter_context(user(browser, language=language))
            opened[language, "monitor"] = monitor
            opened[language, "connections"] = monitor.context.new_page()
            monitor.goto(f"{tester.url}/monitor?lang={language}")
            monitor.get_by_test_id("watch-name").fill("I10, NoSuchVariable")
            monitor.get_by_test_id("watch-add").click()
            monitor.get_by_test_id("watch-I10").get_by_test_id("value").get_by_text("0", exact=True).wait_for()
            opened[language, "connections"].goto(f"{tester.url}/?lang={language}")
        yield opened


def test_errors_of_polling_appear_in_the_language_of_each_page(pages, server):
    name = server.url.removeprefix("tcp://")
    server.close()
    for language in ("en", "ja"):
        watched = pages[language, "monitor"].get_by_test_id("watch-I10").get_by_test_id("value")
        watched.filter(has_text=NOT_CONNECTED[language]).wait_for()
        row = pages[language, "connections"].get_by_test_id(f"connection-{name}")
        row.filter(has_text=LOST[language]).wait_for()
        assert LOST["ja" if language == "en" else "en"] not in row.inner_text()
    row.get_by_role("button", name="接続", exact=True).click()  # of the Japanese user
    for language in ("en", "ja"):
        row = pages[language, "connections"].get_by_test_id(f"connection-{name}")
        row.filter(has_text=REFUSED[language]).wait_for()
        assert "Errno" not in row.inner_text()
