"""A page of a user: present while at least one connection of the browser is open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from orinkit.tester.state.workspace import Workspace
from orinkit.tester.ui.session import PageSession


class Page:
    """NiceGUI's side of a page: the connections of the browser."""

    def __init__(self) -> None:
        self.connections = 0

    @property
    def has_socket_connection(self) -> bool:
        return self.connections > 0

    def safe_invoke(self, callback: Any) -> None:
        callback()


class Browser:
    """A browser that opens and closes connections to a page, and the events that the page has had."""

    def __init__(self, folder: Path) -> None:
        self.page = Page()
        self.workspace = Workspace(folder / "connections.json")
        self.session = PageSession(self.workspace, self.page, "me", "en", False)  # type: ignore[arg-type]  # a page without NiceGUI
        self.events: list[str] = []
        self.session.while_connected(lambda: self.events.append("enter"), lambda: self.events.append("leave"))

    def open(self) -> None:
        self.page.connections += 1
        self.session.connected()

    def close(self) -> None:
        self.page.connections -= 1
        self.session.disconnected()


def test_a_user_who_connects_again_before_the_old_connection_ends_remains_present(tmp_path):
    browser = Browser(tmp_path)
    browser.open()
    browser.open()
    browser.close()
    assert browser.session.is_present
    assert browser.workspace.controls.has_page("me")
    assert browser.events == ["enter"]
    browser.close()
    assert not browser.session.is_present
    assert not browser.workspace.controls.has_page("me")
    browser.open()
    assert browser.workspace.controls.has_page("me")
    assert browser.events == ["enter", "leave", "enter"]


def test_a_connection_that_ends_before_the_page_knows_it_does_not_count(tmp_path):
    browser = Browser(tmp_path)
    browser.session.disconnected()
    browser.open()
    assert browser.workspace.controls.has_page("me")
    browser.close()
    assert not browser.workspace.controls.has_page("me")
