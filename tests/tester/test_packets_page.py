"""The page Packets."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import pytest

import orinkit
from orinkit.bcap.dissect import split
from orinkit.virtual.rc8 import VirtualRC8
from support.browser import TesterProcess, needs_browser, user
from support.recording_relay import Relay
from support.waiting import PATIENCE, until

pytestmark = [needs_browser, pytest.mark.soak]

FILLED = 1000
GET_VARIABLE = (  # the table of RC8 3.1.2: the arguments of Controller_GetVariable(2, "IO150", "")
    ("handle", "0A 00 00 00 03 00 01 00 00 00 02 00 00 00"),
    ("name", "14 00 00 00 08 00 01 00 00 00 0A 00 00 00 49 00 4F 00 31 00 35 00 30 00"),
    ("option", "0A 00 00 00 08 00 01 00 00 00 00 00 00 00"),
)


class PacketBench(NamedTuple):
    """A Tester whose log is filled, connected to a virtual RC8 of this process through a relay that records."""

    relay: Relay
    tester: TesterProcess
    delay: Path


def run(folder: Path, packets: int, live: int = 0) -> Iterator[PacketBench]:
    delay = folder / "delay"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FILLED_PACKETS", f"{packets}")
        patch.setenv("FILLED_LIVE", f"{live}")
        patch.setenv("FILLED_DELAY", f"{delay}")
        patch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]))
        rc8 = VirtualRC8(motor=True)
        with (
            orinkit.serve(rc8, "tcp://127.0.0.1:0") as server,
            Relay(int(server.url.rpartition(":")[2])) as relay,
            TesterProcess(relay.url, folder=folder, module="support.filled_tester") as tester,
        ):
            yield PacketBench(relay, tester, delay)


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PacketBench]:
    yield from run(tmp_path_factory.mktemp("packets"), FILLED)


@pytest.fixture
def packets(browser: Any, filled: PacketBench) -> Iterator[Any]:
    with user(browser, permissions=["clipboard-read", "clipboard-write"]) as page:
        page.goto(f"{filled.tester.url}/packets")
        page.locator("[data-number]").first.wait_for()
        yield page


def row(page: Any, number: int) -> Any:
    return page.locator(f'[data-number="{number}"]')


def select(page: Any, number: int) -> None:
    row(page, number).click()
    page.get_by_test_id("packet-title").filter(has_text=f"#{number} ").wait_for()
    page.locator(f'[data-number="{number}"][aria-selected="true"]').wait_for()


def field(page: Any, index: int) -> Any:
    return page.locator(f'[data-testid="packet-bytes"] [data-field="{index}"]')


def shown_bytes(page: Any) -> bytes:
    return bytes.fromhex(" ".join(page.locator('[data-testid="packet-bytes"] .ok-byte[data-byte]').all_text_contents()))


def marked_bytes(page: Any) -> bytes:
    return bytes.fromhex(" ".join(page.locator('[data-testid="packet-bytes"] .ok-byte.ok-on').all_text_contents()))


def wait_for_count(page: Any, pattern: str) -> int:
    label = page.get_by_test_id("packet-count")
    label.filter(has_text=re.compile(pattern)).wait_for()
    return int(label.text_content().split()[0].replace(",", ""))


def fill_in(page: Any, marker: str, text: str) -> None:
    page.get_by_test_id(f"filter-{marker}").fill(text)


def test_the_packets_that_the_controller_received_are_displayed(packets, filled):
    sent, received = filled.relay.streams[0]
    for offset, data in enumerate(split(bytes(sent))[:2]):
        select(packets, FILLED + 1 + 2 * offset)
        packets.wait_for_function(
            "size => document.querySelectorAll('.ok-byte[data-byte]').length === size", arg=len(data)
        )
        assert shown_bytes(packets) == data
    assert packets.get_by_test_id("packet-summary").text_content().startswith("Controller_Connect(")
    packets.get_by_test_id("packet-partner").click()
    packets.get_by_test_id("packet-title").filter(has_text=f"#{FILLED + 4} received").wait_for()
    reply = split(bytes(received))[1]
    packets.wait_for_function(
        "size => document.querySelectorAll('.ok-byte[data-byte]').length === size", arg=len(reply)
    )
    assert shown_bytes(packets) == reply


def test_pointing_at_a_field_marks_the_bytes_of_the_table_in_the_document(packets):
    fill_in(packets, "text", 'GetVariable(2, "IO150", "")')
    assert wait_for_count(packets, r"^\d+ of [\d,]+ packets$") < FILLED
    packets.locator("[data-number]").first.click()
    field(packets, 6).wait_for()
    names = packets.locator('[data-testid="packet-bytes"] .ok-field-name').all_text_contents()
    for argument, expected in GET_VARIABLE:
        marked = b""
        for index, name in enumerate(names):
            if name.partition(":")[0] == argument:
                field(packets, index).hover()
                field(packets, index).and_(packets.locator(".ok-on")).wait_for()
                marked += marked_bytes(packets)
        assert marked == bytes.fromhex(expected)
    packets.locator('.ok-byte[data-byte="9"]').hover()
    packets.locator(".ok-field.ok-on").filter(has_text="function id").wait_for()
    assert marked_bytes(packets) == bytes.fromhex("09 00 00 00")
    field(packets, 2).focus()
    packets.keyboard.press("ArrowUp")
    packets.locator(".ok-field.ok-on").filter(has_text="length").first.wait_for()
    assert marked_bytes(packets) == bytes.fromhex("44 00 00 00")


def test_filters_and_invalid_input(packets):
    fill_in(packets, "hex", "01 1")
    packets.get_by_text("the number of hex digits is odd. Try: 01 10 00").wait_for()
    assert wait_for_count(packets, r"^1,0\d\d of 1,0\d\d packets$") > FILLED
    fill_in(packets, "hex", "")
    packets.get_by_test_id("filter-errors").click()
    wait_for_count(packets, "^2 of ")
    packets.locator(f'.ok-bad[data-number="{FILLED}"]').filter(has_text="malformed").wait_for()
    row(packets, FILLED - 4).filter(has_text="E_BUF_FULL").wait_for()
    packets.get_by_test_id("filter-errors").click()
    for number, mark in ((FILLED - 6, "retry"), (FILLED - 5, "executing")):
        row(packets, number).filter(has_text=mark).wait_for()


def test_copies(packets):
    fill_in(packets, "text", 'GetVariable(2, "IO150", "")')
    wait_for_count(packets, r"^\d+ of 1,0")
    packets.locator("[data-number]").first.click()
    field(packets, 6).wait_for()
    data = shown_bytes(packets)
    for marker, read in (("hex", bytes.fromhex), ("python", eval)):
        assert read(copied(packets, marker)) == data
    assert copied(packets, "call") == "client.call(functions.controller_get_variable, 2, 'IO150', '')"


def copied(page: Any, marker: str) -> str:
    page.evaluate("navigator.clipboard.writeText('')")
    page.get_by_test_id(f"copy-{marker}").click()
    until(lambda: page.evaluate("navigator.clipboard.readText()"))
    return str(page.evaluate("navigator.clipboard.readText()"))


@pytest.mark.soak
def test_large_packets_are_shown_in_part_and_not_copied(packets):
    select(packets, FILLED - 1)
    packets.get_by_text("Only the first 4,096 of 4,194,344 bytes are shown.").wait_for()
    packets.get_by_test_id("copy-hex").click()
    packets.get_by_test_id("error-copy").filter(has_text="save as pcapng").wait_for()


@pytest.mark.soak
def test_ten_megabytes_pasted(packets):
    packets.get_by_test_id("filter-hex").focus()
    packets.keyboard.insert_text("01" * 5_000_000)
    packets.get_by_text("at most 256 bytes can be searched for").wait_for()
    fill_in(packets, "hex", "")
    wait_for_count(packets, r"^1,0\d\d of 1,0\d\d packets$")


@pytest.mark.soak
def test_the_last_packets_of_each_connection(packets, filled):
    packets.get_by_text("Last sent and received").click()
    name = filled.relay.url.removeprefix("tcp://")
    card = packets.get_by_test_id(f"last-{name}")
    sent = split(bytes(filled.relay.streams[0][0]))[-1]
    cells = card.get_by_test_id("last-sent").locator(".ok-byte[data-byte]")
    cells.nth(len(sent) - 1).wait_for()
    assert bytes.fromhex(" ".join(cells.all_text_contents())) == sent
    card.get_by_test_id("last-received").locator("[data-field]").first.wait_for()


ONE_IS_HIDDEN = "ids => ids.map(id => document.getElementById(id).classList.contains('hidden')).join() === 'false,true'"


def test_a_tab_is_displayed_before_the_tester_reacts(packets, filled):
    tabs, last, parts = (packets.get_by_test_id(name) for name in ("packet-tabs", "last-packets", "all-packets"))
    for text, shown, hidden in (("Last sent and received", last, parts), ("All packets", parts, last)):
        with filled.tester.suspended():
            tabs.get_by_text(text).click()
            packets.wait_for_function(ONE_IS_HIDDEN, arg=[shown.get_attribute("id"), hidden.get_attribute("id")])
        packets.get_by_test_id("last-sent").first.wait_for(state="attached")
        assert shown.is_visible()
        assert not hidden.is_visible()


@pytest.mark.soak
def test_keyboard(packets):
    packets.get_by_test_id("packet-list").focus()
    packets.keyboard.press("Home")
    packets.get_by_test_id("packet-title").filter(has_text="#1 ").wait_for()
    packets.locator('[data-number="1"][aria-selected="true"]').wait_for()
    packets.keyboard.press("ArrowDown")
    packets.locator('[data-number="2"][aria-selected="true"]').wait_for()
    newest = wait_for_count(packets, " of ")
    packets.keyboard.press("End")
    packets.locator(f'[data-number="{newest}"][aria-selected="true"]').wait_for()


@pytest.fixture
def live(browser: Any, tmp_path: Path) -> Iterator[Any]:
    for bench in run(tmp_path, 500, live=200):
        with user(browser) as page:
            page.goto(f"{bench.tester.url}/packets")
            page.locator("[data-number]").first.wait_for()
            yield page


COUNT_CHANGES = """
window.okCreated = window.okSchemes = 0;
new MutationObserver(found => window.okCreated += found.flatMap(each => [...each.addedNodes])
  .filter(node => node.classList?.contains('ok-packet')).length
).observe(document.querySelector('.ok-packets'), {childList: true, subtree: true});
new MutationObserver(found => window.okSchemes += found.length)
  .observe(document.head, {attributes: true, subtree: true, attributeFilter: ['content']});
"""


@pytest.mark.soak
def test_new_packets_change_only_the_texts_of_the_rows(live):
    live.wait_for_function("document.querySelectorAll('[data-number]').length > 5")
    live.wait_for_timeout(1000)  # the size of the window is known to the Tester
    live.evaluate(COUNT_CHANGES)
    first = live.evaluate("Number(document.querySelector('[data-number]').dataset.number)")
    live.wait_for_function(
        "first => Number(document.querySelector('[data-number]').dataset.number) > first + 300", arg=first
    )
    assert live.evaluate("window.okCreated") == 0  # creating a row takes longer than changing it
    assert live.evaluate("window.okSchemes") == 0  # each change computes the styles of all elements again


@pytest.mark.soak
def test_follow_overwrite_pause_and_clear(live):
    newest = "Math.max(...Array.from(document.querySelectorAll('[data-number]'), each => Number(each.dataset.number)))"
    first = live.evaluate(newest)
    live.wait_for_function(f"first => {newest} > first + 100", arg=first)
    scroller = live.locator(".ok-packets-scroll")
    scroller.hover()
    live.mouse.wheel(0, -2000)
    live.locator('[data-testid="follow"][aria-checked="false"]').wait_for()
    top = live.evaluate("document.querySelector('.ok-packets-scroll').scrollTop")
    shown = wait_for_count(live, " of ")
    live.wait_for_function(
        "shown => Number(document.querySelector('[data-testid=packet-count]').textContent.split(' ')[0].replace(',', '')) > shown + 100",
        arg=shown,
    )
    assert live.evaluate("document.querySelector('.ok-packets-scroll').scrollTop") == top
    live.get_by_test_id("record").click()
    live.get_by_text("Record", exact=True).wait_for()
    live.get_by_test_id("overwrite").click()
    live.get_by_test_id("packet-count").filter(has_text=re.compile("^(9|10) of")).wait_for()
    live.get_by_test_id("clear").click()
    live.get_by_test_id("packet-count").filter(has_text="0 of 0 packets").wait_for()
    live.get_by_test_id("record").click()
    live.get_by_test_id("overwrite").click()
    live.locator("[data-number]").first.wait_for()


@pytest.fixture
def full(browser: Any, tmp_path: Path) -> Iterator[tuple[Any, PacketBench]]:
    for bench in run(tmp_path, 100_000, live=1000):
        with user(browser) as page:
            page.goto(f"{bench.tester.url}/packets")
            page.locator("[data-number]").first.wait_for()
            yield page, bench


@pytest.mark.soak
def test_100000_packets_do_not_slow_the_page(full):
    page, bench = full
    bench.delay.unlink(missing_ok=True)
    wait_for_count(page, "^100,000 of 100,000")
    fill_in(page, "text", "IO150")
    label = page.get_by_test_id("packet-count")
    label.filter(has_text=re.compile(r"^[\d,]{3,6} of 100,000 packets")).wait_for()
    start = perf_counter()
    page.locator("[data-number]").nth(2).click()
    page.locator("[data-selected], [aria-selected=true]").wait_for()
    elapsed = perf_counter() - start
    label.filter(has_not_text="searching").wait_for()
    assert 1000 < wait_for_count(page, "of 100,000 packets$") < 10_000
    print(f"click: {elapsed:.3f} s, longest delay of the event loop: {bench.delay.read_text()} s")
    assert elapsed < PATIENCE / 4
    assert float(bench.delay.read_text()) < 2


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["pcapng", "txt"])
def test_saved_files(packets, tmp_path, kind):
    count = wait_for_count(packets, " of ")
    packets.get_by_test_id("save").click()
    with packets.expect_download() as download:
        packets.get_by_test_id(f"save-{kind}").click()
    path = tmp_path / f"packets.{kind}"
    download.value.save_as(path)
    if kind == "txt":
        assert sum(line.startswith("#") for line in path.read_text("utf-8").splitlines()) == count
        return
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("requires tshark (Debian, Ubuntu: apt-get install tshark)")
    done = subprocess.run(
        [tshark, "-n", "-r", path, "-T", "fields", "-e", "frame.number"], capture_output=True, text=True, timeout=PATIENCE,
        check=True,
    )  # fmt: skip
    assert len(done.stdout.splitlines()) >= count


@pytest.mark.soak
@pytest.mark.parametrize(("width", "language"), [(1360, "ja"), (400, "en")])
def test_nothing_is_wider_than_the_window(browser, filled, width, language):
    with user(browser, language=language, viewport={"width": width, "height": 800}) as page:
        page.goto(f"{filled.tester.url}/packets")
        select(page, FILLED + 1)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
