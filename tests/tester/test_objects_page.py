"""The page Objects: tree, forms, results, and invalid input."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import expect

from orinkit.cao import functions as f
from orinkit.values.variant import Variant, VarType
from support.browser import needs_browser, user
from support.objects_page import add, choose, fill, open_objects
from support.received import ReceivedPackets, received_packets

pytestmark = needs_browser


@pytest.fixture
def received() -> Iterator[ReceivedPackets]:
    with received_packets() as recorded:
        yield recorded


@pytest.fixture(scope="module")
def person(browser: Any) -> Iterator[Any]:
    """One user for all tests, because only one user can hold the controls."""
    with user(browser) as opened:
        yield opened


@pytest.fixture
def objects(person: Any, bench: Any) -> Any:
    """The page Objects, with the controller selected."""
    return open_objects(person, bench.tester.url)


def test_a_variable_is_added_written_and_read(objects, bench, received):
    objects.get_by_test_id("get-Variable").click()
    objects.get_by_test_id("names").get_by_role("button", name="@MODE", exact=True).wait_for()
    add(objects, "Variable", "I10")
    fill(objects, "value", "4x")
    expect(objects.get_by_test_id("object")).to_contain_text("column 1: expected a whole number")
    objects.get_by_test_id("put").click()
    fill(objects, "value", "4711")
    expect(objects.get_by_test_id("value-description")).to_have_text("VT_I4")
    objects.get_by_test_id("put").click()
    expect(objects.get_by_test_id("value-result-code")).to_have_text("0x00000000 S_OK")
    assert [each.arguments[1] for each in received.of(f.variable_put_value)] == [Variant(VarType.I4, 4711)]
    objects.get_by_test_id("get").click()
    expect(objects.get_by_test_id("value-result-value")).to_have_text("4711")
    expect(objects.get_by_test_id("value-result-type")).to_have_text("VT_I4")
    choose(objects, "I10")
    objects.get_by_role("button", name="Release I10").click()
    received.wait_for(f.variable_release)
    expect(objects.get_by_test_id("tree")).not_to_contain_text("I10")
