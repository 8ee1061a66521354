"""The page Connections."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from orinkit.cao import functions as f
from orinkit.values.variant import Variant, VarType
from support.browser import needs_browser, user
from support.objects_page import expect, fill
from support.received import received_packets

pytestmark = [needs_browser, pytest.mark.soak]


@pytest.fixture(scope="module")
def context(browser: Any) -> Iterator[Any]:
    """The context of one user: the controls are free only 5 s after the last page of another user."""
    with user(browser) as opened:
        yield opened.context


@pytest.fixture
def page(context: Any, bench: Any) -> Iterator[Any]:
    opened = context.new_page()
    opened.goto(bench.tester.url)
    yield opened
    opened.close()


def open_parameters(page: Any) -> None:
    page.get_by_text("More parameters").click()
    page.get_by_test_id("field-machine").wait_for()


def test_the_connection_of_the_command_line_is_open(page, bench):
    row = page.get_by_test_id(f"connection-{bench.server.url.removeprefix('tcp://')}")
    row.get_by_text("connected", exact=True).wait_for()
    assert bench.server.clients >= 1


@pytest.mark.parametrize("width", [1360, 1000, 400])
def test_the_buttons_do_not_move_when_the_string_appears(page, bench, width):
    page.set_viewport_size({"width": width, "height": 900})
    button = page.get_by_test_id("connect")
    button.wait_for()
    page.evaluate("document.fonts.ready")
    before = button.bounding_box()
    page.get_by_test_id("url").fill("tcp://192.168.100.100:65000")
    expect(page.get_by_test_id("string")).to_have_value(re.compile("192.168.100.100"))
    assert button.bounding_box() == before  # a click that has begun is not lost


def test_string_and_fields_follow_each_other_and_the_string_can_be_chosen_again(page, bench):
    server = bench.server.url.removeprefix("tcp://")
    open_parameters(page)
    fill(
        page,
        "string",
        f'Server={server}, UDP=0, Timeout=8000, TORetry=9, Machine=here, Option="@EventDisable=False,Wpj=*", Message=0',
    )
    expect(page.get_by_test_id("url")).to_have_value(bench.server.url)
    expect(page.get_by_test_id("field-timeout")).to_have_value("8000")
    expect(page.get_by_test_id("field-tries")).to_have_value("7")
    expect(page.get_by_test_id("field-messages")).to_have_attribute("aria-checked", "false")
    fill(page, "field-machine", "there")
    page.get_by_test_id("field-debug").click()
    string = (
        f"Server={server}, UDP=False, Timeout=8000, TORetry=7, Provider=CaoProv.DENSO.VRC, Machine=there, "
        'Option="@EventDisable=False,Wpj=*", Message=False, Debug=True'
    )
    expect(page.get_by_test_id("string")).to_have_value(string)
    fill(page, "name", "by string")
    with received_packets() as received:
        page.get_by_test_id("connect").click()
        arguments = received.wait_for(f.controller_connect).arguments
    assert [
        Variant(VarType.BSTR, text) for text in ("CaoProv.DENSO.VRC", "there", "@EventDisable=False,Wpj=*")
    ] == arguments[1:4]
    page.get_by_test_id("connection-by string").get_by_text("connected", exact=True).wait_for()
    page.reload()
    page.get_by_test_id("string-history").click()
    page.get_by_test_id("string-0").get_by_text(string).click()
    expect(page.get_by_test_id("url")).to_have_value(bench.server.url)
    expect(page.get_by_test_id("string")).to_have_value(string)


@pytest.mark.soak
def test_connect_and_disconnect(page, bench):
    fill(page, "url", bench.server.url)
    fill(page, "name", "twice")
    row = page.get_by_test_id("connection-twice")
    with received_packets() as received:
        page.get_by_test_id("connect").click()
        row.get_by_text("connected", exact=True).wait_for()
        row.get_by_role("button", name="Disconnect").click()
        row.get_by_text("not connected", exact=True).wait_for()
        received.wait_for(f.controller_disconnect)
        row.get_by_role("button", name="Connect", exact=True).click()
        row.get_by_text("connected", exact=True).wait_for()
        row.get_by_role("button", name="Remove").click()
        row.wait_for(state="detached")
        received.wait_for(f.controller_disconnect, 2)
        assert len(received.of(f.controller_connect)) >= 2


@pytest.mark.soak
def test_an_invalid_string_is_reported_beside_the_field_and_nothing_is_sent(page, bench):
    form = page.get_by_test_id("connection-form")
    with received_packets() as received:
        for text, problem in (
            ("Server=a, Timout=3", "unknown option 'Timout=3'"), ("Timeout=3", "Server is missing"),
            ('Server=a, Option="x', "is missing after"), ("Server=a, UDP=2", "True or False"),
        ):  # fmt: skip
            fill(page, "string", text)
            expect(form.locator(".q-field__messages [role=alert]").last).to_contain_text(problem)
            page.get_by_test_id("connect").click()
            expect(page.get_by_test_id("error-form")).to_contain_text(problem)
        expect(page.get_by_test_id("url")).to_have_value("")
        page.get_by_test_id("string").fill("")
        page.get_by_test_id("string").focus()
        page.keyboard.insert_text("Server=a, " * 1_000_000)  # 10 MB, pasted
        expect(form).to_contain_text("exceeds the limit of 4096 characters")
        fill(page, "url", bench.server.url)  # the string follows the fields again
        expect(page.get_by_test_id("string")).to_have_value(f"Server={bench.server.url[6:]}, UDP=False, Timeout=3000, "
            "TORetry=5, Provider=CaoProv.DENSO.VRC, Machine=localhost, Option=, Message=True, Debug=False")  # fmt: skip
        assert not received.of(f.controller_connect)


@pytest.mark.soak
def test_the_address_follows_the_transport(page):
    fill(page, "url", "tcp://192.168.0.1:5007")
    page.get_by_test_id("scheme").get_by_text("UDP").click()
    expect(page.get_by_test_id("url")).to_have_value("udp://192.168.0.1:5007")
    expect(page.get_by_test_id("string")).to_have_value("Server=192.168.0.1:5007, UDP=True, Timeout=500, TORetry=5, "
        "Provider=CaoProv.DENSO.VRC, Machine=localhost, Option=, Message=True, Debug=False")  # fmt: skip
    fill(page, "url", "serial:///dev/ttyUSB0")
    expect(page.get_by_test_id("scheme").get_by_role("button", name="Serial")).to_have_attribute("aria-pressed", "true")
    page.get_by_test_id("scheme").get_by_text("CAN").click()
    expect(page.get_by_test_id("url")).to_have_value("")
    expect(page.get_by_test_id("string")).to_be_hidden()
    fill(page, "url", "tcp://a:b")
    expect(page.get_by_test_id("connection-form")).to_contain_text("tcp://a:b")
