"""Operation of the page Objects in a browser."""

from __future__ import annotations

from typing import Any

from support.waiting import PATIENCE


def expect(locator: Any) -> Any:
    """Return Playwright's assertions for a locator, with a time-out for a busy machine."""
    from playwright.sync_api import expect as assertions

    assertions.set_options(timeout=PATIENCE * 1000)
    return assertions(locator)


def fill(page: Any, marker: str, text: str) -> None:
    """Enter a text."""
    page.get_by_test_id(marker).fill(text)


def choose_type(page: Any, marker: str, name: str) -> None:
    """Select the type of a value."""
    page.get_by_test_id(f"{marker}-type").click()
    page.get_by_role("option", name=name, exact=True).click()


def add(page: Any, kind: str, name: str) -> None:
    """Add an object below the selected one; it is then selected."""
    page.get_by_test_id("kind").get_by_role("button", name=kind, exact=True).click()
    if kind != "Message":
        fill(page, f"add-{kind}-name", name)
    page.get_by_test_id(f"add-{kind}").click()
    page.get_by_test_id("object").get_by_text(name, exact=True).first.wait_for()


def open_tab(page: Any, name: str) -> None:
    """Open a tab of the selected object."""
    page.get_by_test_id(f"tab-{name}").click()


def choose(page: Any, label: str) -> None:
    """Select an object in the tree."""
    row = page.get_by_test_id("tree").get_by_role("treeitem").filter(has_text=label).last
    row.click()


def open_objects(page: Any, url: str) -> Any:
    """Open the page; the controller is selected."""
    page.goto(f"{url}/objects")
    page.get_by_test_id("object-handle").wait_for()
    return page
