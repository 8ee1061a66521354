"""A controller whose texts contain HTML and JavaScript, and one that does not answer: the pages remain usable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.tester.pages import PAGES
from support.browser import TesterProcess, needs_browser, user
from support.hostile import EVIL, Hostile
from support.objects_page import add, expect, fill, open_objects, open_tab

pytestmark = needs_browser

NAME = """O'Neil; "セル" 5 % " innerHTML="<img src=x onerror=k()>"""


@pytest.fixture(scope="module")
def tester(tmp_path_factory: Any) -> Iterator[TesterProcess]:
    with (
        orinkit.serve(Hostile(), "tcp://127.0.0.1:0") as server,
        TesterProcess(server.url, folder=tmp_path_factory.mktemp("tester")) as running,
    ):
        yield running


@pytest.fixture(scope="module")
def context(browser: Any) -> Iterator[Any]:
    with user(browser) as page:
        yield page.context


@pytest.fixture
def page(context: Any) -> Iterator[Any]:
    """A page on which nothing is executed and nothing fails."""
    opened = context.new_page()
    problems: list[str] = []
    opened.on("pageerror", lambda error: problems.append(f"{error}"))
    yield opened
    assert opened.evaluate("window.okBroken") is None
    assert opened.locator('img[src="x"]').count() == 0
    assert opened.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert not problems
    opened.close()


def test_names_values_and_errors_are_shown_as_text(page, tester):
    open_objects(page, tester.url)
    page.get_by_test_id("get-Variable").click()
    page.get_by_test_id("names").get_by_text(EVIL, exact=True).wait_for()
    add(page, "Variable", EVIL)
    page.get_by_test_id("get").click()
    expect(page.get_by_test_id("value-result-value")).to_contain_text("<script>window.okBroken=1</script>")
    page.get_by_test_id("tree").get_by_role("treeitem").nth(1).click()
    open_tab(page, "Execute")
    fill(page, "command", "Get")
    page.get_by_test_id("execute").click()
    expect(page.get_by_test_id("result-value")).to_contain_text("<script>window.okBroken=1</script>")


def test_watched_values_and_messages_are_shown_as_text(page, tester):
    page.goto(f"{tester.url}/monitor")
    page.get_by_test_id("watch-name").fill("I1")
    page.get_by_test_id("watch-add").click()
    page.get_by_test_id("watch-I1").get_by_test_id("value").filter(has_text="<script>window.okBroken=1").wait_for()
    page.get_by_test_id("event-log").get_by_text("<script>window.okBroken=1").first.wait_for()
    page.get_by_text("GetCurErrorCount returned an unexpected value").wait_for()


def test_files_and_tasks_are_shown_as_text(page, tester):
    page.goto(f"{tester.url}/programs")
    page.get_by_test_id("task-list").get_by_text(EVIL, exact=True).wait_for()
    page.get_by_test_id("file-list").get_by_text(EVIL, exact=True).click()
    page.locator(".cm-content").filter(has_text="<script>window.okBroken=1").wait_for()


@pytest.mark.parametrize("path", [each.path for each in PAGES])
def test_each_page_is_shown(page, tester, path):
    page.goto(tester.url + path)
    page.locator(".ok-page-title").wait_for()
    page.wait_for_timeout(500)  # some cycles of polling


def test_the_name_of_a_connection_is_only_a_text_and_does_not_hide_the_user(page, context, tester):
    """The name is stored in a cookie: it must not make the cookie of the user unreadable."""
    page.goto(tester.url)
    page.get_by_test_id("controls").get_by_text("You hold the controls").wait_for()
    page.get_by_test_id("name").fill(NAME)
    with orinkit.serve(Hostile(), "tcp://127.0.0.1:0") as server:
        page.get_by_test_id("url").fill(server.url)
        page.get_by_test_id("connect").click()
        page.locator(".ok-chooser").get_by_text(NAME).wait_for()
        context.add_cookies([{"name": "other", "value": '{"program": 日本}', "url": tester.url}])
        page.goto(f"{tester.url}/packets")
        page.get_by_test_id("controls").get_by_text("You hold the controls").wait_for()
        page.locator(".ok-chooser").get_by_text(NAME).wait_for()
        page.get_by_test_id("packet-tabs").get_by_text("Last sent and received").click()
        page.locator(".ok-card-title").get_by_text(NAME).wait_for()
        page.goto(tester.url)
        row = page.get_by_test_id(f"connection-{NAME}")
        row.get_by_role("button", name="Remove").click()
        row.wait_for(state="detached")
