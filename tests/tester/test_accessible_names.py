"""Every interactive element of every page has a name for screen readers, in the language of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.core.i18n import translate
from orinkit.tester.pages import PAGES
from orinkit.tester.state.simulators import KINDS
from support.browser import TesterProcess, needs_browser, user

pytestmark = [needs_browser, pytest.mark.soak]

SETTLE = 1_500  # ms
INTERACTIVE = {
    "button", "checkbox", "combobox", "link", "listbox", "menuitem", "radio", "searchbox", "slider", "spinbutton", "switch",
    "tab", "textbox", "treeitem",
}  # fmt: skip
UNFOLD = "document.querySelectorAll('.q-expansion-item [aria-expanded=false]').forEach(each => each.click())"
JAPANESE = re.compile("[\u3040-\u30ff\u4e00-\u9fff]")


@pytest.fixture(scope="module")
def tester(tmp_path_factory: Any) -> Iterator[TesterProcess]:
    virtual = [word for key in KINDS for word in ("--virtual", key)]
    with TesterProcess(*virtual, folder=tmp_path_factory.mktemp("tester")) as running:
        yield running


@pytest.fixture(params=["en", "ja"])
def page(request: Any, browser: Any) -> Iterator[Any]:
    with user(browser, language=request.param) as opened:
        yield opened


def controls(page: Any) -> list[tuple[str, str, str]]:
    """Return role, name and HTML of every element that can be operated or focused, as the browser reports them."""
    session = page.context.new_cdp_session(page)
    found = []
    for node in session.send("Accessibility.getFullAXTree")["nodes"]:
        role = node.get("role", {}).get("value", "")
        focusable = any(each["name"] == "focusable" and each["value"]["value"] for each in node.get("properties", []))
        if node["ignored"] or role == "RootWebArea" or not (role in INTERACTIVE or focusable):
            continue
        name, html = node.get("name", {}).get("value", "").strip(), ""
        if not name:
            place = {"backendNodeId": node["backendDOMNodeId"]}
            html = session.send("DOM.getOuterHTML", place)["outerHTML"].partition(">")[0]
            if role not in INTERACTIVE and 'tabindex="-1"' in html:  # only scripts can focus it
                continue
        found.append((role, name, html))
    session.detach()
    return found


def test_every_interactive_element_has_a_name(page, tester):
    language = page.evaluate("navigator.language")[:2]
    connection = translate("en", KINDS["rc8"].label)
    sliders, nameless = 0, []
    for row in PAGES:
        chosen = translate("en", KINDS["abh3"].label) if "abh3" in row.path else connection
        page.goto(f"{tester.url}{row.path}?lang={language}&connection={chosen}")
        page.locator(".ok-page-title").wait_for()
        page.wait_for_timeout(SETTLE)
        page.evaluate(UNFOLD)
        page.wait_for_timeout(SETTLE // 3)
        found = controls(page)
        assert len(found) > len(PAGES), row.path  # the navigation, and the elements of the page
        nameless += [(row.path, role, html) for role, name, html in found if not name]
        names = [name for role, name, _ in found if role == "slider"]
        assert all(bool(JAPANESE.search(name)) == (language == "ja") for name in names), names
        sliders += len(names)
    assert not nameless
    assert sliders >= 3  # jogging, poses, external speed
