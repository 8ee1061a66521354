"""The page Monitor."""

from __future__ import annotations

import pytest

import orinkit
from support.browser import needs_browser, user

pytestmark = [needs_browser, pytest.mark.soak]


@pytest.fixture(scope="module")
def context(browser, bench):
    """The context of one user: the controls are free only 5 s after the last page of another user."""
    with user(browser) as opened:
        yield opened.context


@pytest.fixture
def page(context):
    opened = context.new_page()
    yield opened
    opened.close()


IS_BEFORE = """() => {
  const [second, first] = ['I2', 'I1'].map(name => document.querySelector(`[data-testid=watch-${name}]`));
  return first && second && first.compareDocumentPosition(second) & Node.DOCUMENT_POSITION_PRECEDING;
}"""


def read(bench, name):
    with orinkit.connect(bench.server.url) as controller:
        return controller.variable(name).value


def add(page, names):
    page.get_by_test_id("watch-name").fill(names)
    page.get_by_test_id("watch-add").click()


def open_monitor(page, bench):
    page.goto(bench.tester.url + "/monitor")
    page.get_by_test_id("watch-card").wait_for()


def test_a_variable_is_watched_and_written_in_place(page, bench):
    open_monitor(page, bench)
    add(page, "I10, IO200")
    row = page.get_by_test_id("watch-I10")
    row.get_by_test_id("value").get_by_text("0", exact=True).wait_for()
    row.get_by_test_id("edit").click()
    row.get_by_test_id("new-value").fill("1.5")
    row.get_by_test_id("write").click()
    row.get_by_test_id("error-write").get_by_text("not a whole number").wait_for()
    assert read(bench, "I10") == 0
    row.get_by_test_id("new-value").fill("42")
    row.get_by_test_id("write").click()
    row.get_by_test_id("value").get_by_text("42", exact=True).wait_for()
    assert read(bench, "I10") == 42
    assert row.get_by_test_id("minimum").inner_text() == "0"
    assert row.get_by_test_id("maximum").inner_text() == "42"


def test_errors_are_shown_with_their_remedy_and_cleared(page, bench):
    open_monitor(page, bench)
    page.get_by_test_id("event-log-empty").get_by_text("No message has been received.").wait_for()
    bench.rc8.raise_error(0x83204071)
    page.get_by_test_id("current-errors").get_by_text("SOFT_LIMIT_OVER_AXIS1").wait_for()
    page.get_by_test_id("current-errors").get_by_text("Try: ").first.wait_for()
    page.get_by_test_id("event-log").get_by_text("83204071").first.wait_for()
    page.get_by_test_id("event-log-empty").wait_for(state="hidden")
    page.get_by_test_id("error-log").get_by_text("83204071").first.click()
    page.get_by_test_id("description").get_by_text("Axis 1: soft limit").wait_for()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Close").click()
    page.get_by_test_id("clear-errors").click()
    page.get_by_test_id("error-count").get_by_text("none present").wait_for()
    assert bench.rc8.state.faults.code == 0


@pytest.mark.soak
def test_the_plot_and_the_csv_file_contain_the_values(page, bench):
    open_monitor(page, bench)
    add(page, "F1 J1")
    row = page.get_by_test_id("watch-F1")
    row.get_by_test_id("value").get_by_text("0", exact=True).wait_for()
    row.get_by_test_id("plot").click()
    page.get_by_test_id("plot-lines").get_by_text("F1").wait_for()
    assert row.get_by_test_id("plot").get_attribute("aria-pressed") == "true"
    with page.expect_download() as download:
        page.get_by_test_id("csv").click()
    lines = download.value.path().read_text("utf-8-sig").splitlines()
    assert lines[0].startswith("time,")
    assert lines[0].endswith("F1," + ",".join(f"J1[{index}]" for index in range(8)))
    assert {line.count(",") for line in lines} == {lines[0].count(",")}


PRESS = """([button, state]) => new Promise(resolve => {
  const begin = performance.now();
  new MutationObserver((_, observer) => {
    if (button.ariaPressed !== state) return;
    observer.disconnect();
    resolve(performance.now() - begin);
  }).observe(button, {attributes: true});
  button.click();
})"""


def test_the_watch_list_reacts_without_waiting_for_the_next_refresh(page, bench):
    """Each click follows the reaction to the one before; if that was a refresh, the next one is 250 ms away."""
    open_monitor(page, bench)
    add(page, "I31 I32")
    plot = page.get_by_test_id("watch-I32").get_by_test_id("plot")
    plot.wait_for()
    page.wait_for_timeout(500)
    times = [page.evaluate(PRESS, [plot.element_handle(), state]) for state in ("true", "false") * 6]
    assert sorted(times)[len(times) // 2] < 125  # ms
    for name in ("I31", "I32"):
        page.get_by_test_id(f"watch-{name}").get_by_test_id("remove").click()
        page.get_by_test_id(f"watch-{name}").wait_for(state="detached")


def test_the_plot_is_paused_before_the_tester_reacts(page, bench):
    open_monitor(page, bench)
    button = page.get_by_test_id("pause")
    assert button.get_attribute("aria-label") == "Pause"
    for label in ("Continue", "Pause"):
        with bench.tester.suspended():
            button.click()
            page.locator(f'[data-testid="pause"][aria-label="{label}"]').wait_for()
        page.wait_for_timeout(300)
        assert button.get_attribute("aria-label") == label


@pytest.mark.soak
def test_invalid_names_and_a_megabyte_are_refused_and_the_page_goes_on(page, bench):
    open_monitor(page, bench)
    add(page, "I*")
    page.get_by_test_id("error-watch").get_by_text("many variables").wait_for()
    page.get_by_test_id("watch-name").fill("")
    page.keyboard.insert_text("x" * 1_000_000)
    page.get_by_test_id("watch-add").click()
    page.get_by_test_id("error-watch").get_by_text("too long").wait_for()
    add(page, "I10")
    page.get_by_test_id("watch-I10").wait_for()


@pytest.mark.soak
def test_the_list_of_a_user_is_kept_ordered_and_not_shown_to_others(page, bench, browser):
    open_monitor(page, bench)
    add(page, "I1 I2")
    page.get_by_test_id("watch-I2").get_by_test_id("up").click()
    page.wait_for_function(IS_BEFORE)
    page.reload()
    page.wait_for_function(IS_BEFORE)
    page.get_by_test_id("watch-I2").get_by_test_id("remove").click()
    page.get_by_test_id("watch-I2").wait_for(state="detached")
    with user(browser) as other:
        open_monitor(other, bench)
        assert other.get_by_test_id("watch-I1").count() == 0


@pytest.mark.soak
def test_a_user_without_the_controls_writes_nothing(page, bench, browser):
    open_monitor(page, bench)
    with user(browser) as other:
        open_monitor(other, bench)
        add(other, "I20")
        row = other.get_by_test_id("watch-I20")
        row.get_by_test_id("value").get_by_text("0", exact=True).wait_for()
        row.get_by_test_id("edit").click()
        row.get_by_test_id("new-value").fill("7")
        row.get_by_test_id("write").click()
        row.get_by_test_id("error-write").get_by_text("another user holds the controls").wait_for()
        assert read(bench, "I20") == 0


@pytest.mark.soak
def test_nothing_is_loaded_from_elsewhere(page, bench):
    foreign = []
    page.on("request", lambda request: foreign.append(request.url))
    for path in ("/monitor", "/programs"):
        page.goto(bench.tester.url + path)
        page.wait_for_load_state("networkidle")
    own = (bench.tester.url, "data:", "blob:")
    assert foreign
    assert [url for url in foreign if not url.startswith(own)] == []
