"""The page Connections."""

from __future__ import annotations

from support.browser import needs_browser

pytestmark = needs_browser


def test_the_connection_of_the_command_line_is_open(page, bench):
    page.goto(bench.tester.url)
    row = page.get_by_test_id(f"connection-{bench.server.url.removeprefix('tcp://')}")
    row.get_by_text("connected", exact=True).wait_for()
    assert bench.server.clients >= 1
