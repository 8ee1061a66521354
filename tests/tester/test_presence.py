"""Presence of a user: heartbeats, and gaps between them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from orinkit.tester.ui import presence
from orinkit.tester.ui.presence import Presence

LIMIT = 0.5


class Page:
    """A page whose heartbeats and clock a test controls."""

    def __init__(self) -> None:
        self.now = 100.0
        self.beat: Any = None
        self.is_deleted = False
        self.scripts: list[str] = []
        self.run_javascript = self.scripts.append

    def after(self, seconds: float, *, hidden: bool = False) -> None:
        """Let time pass, then send a heartbeat."""
        self.now += seconds
        self.beat(SimpleNamespace(args={"hidden": hidden}))


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    page = Page()
    monkeypatch.setattr(presence, "monotonic", lambda: page.now)
    monkeypatch.setattr(presence.ui, "on", lambda _event, handler, _keys: setattr(page, "beat", handler))
    return page


def begun(page: Page) -> Presence:
    made = Presence(SimpleNamespace(client=page), LIMIT)  # type: ignore[arg-type]  # the part that is used
    page.now += 60.0
    made.begin()
    return made


def test_a_user_is_present_while_heartbeats_arrive(page):
    user = begun(page)
    for _ in range(10):
        page.after(0.4)
        assert user.reason == ""
    page.now += 0.6
    assert "0.5 s" in user.reason


def test_a_gap_counts_although_heartbeats_follow(page):
    """After the Tester was blocked, the heartbeats of that time arrive before the next check."""
    user = begun(page)
    page.after(3.0)
    page.after(0.0)
    assert "0.5 s" in user.reason
    user.begin()
    assert user.reason == ""


def test_a_hidden_or_closed_page(page):
    user = begun(page)
    page.after(0.1, hidden=True)
    assert "hidden" in user.reason
    user.begin()
    page.is_deleted = True
    assert "closed" in user.reason
