"""The page Programs."""

from __future__ import annotations

import pytest

from orinkit.rc8.task_modes import StopMode, TaskStatus
from support.browser import needs_browser, user
from support.waiting import until

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


ENDLESS = "Sub Main\n  Do While True\n    I[1] = I[1] + 1\n    Delay 10\n  Loop\nEnd Sub\n"


def put(bench, name, text):
    files = bench.rc8.state.files
    if not files.exists(name):
        files.create(name)
    files.write(name, text.encode())


def status(bench, name):
    return bench.rc8.state.tasks.get_or_create(name).status


def open_programs(page, bench):
    page.goto(bench.tester.url + "/programs")
    page.get_by_test_id("file-Pro1.pcs").wait_for()


def edit(page, name):
    page.get_by_test_id(f"file-{name}").click()
    page.get_by_test_id("editor-title").get_by_text(name).wait_for()


def type_text(page, text):
    page.locator(".cm-content").click()
    page.keyboard.press("Control+A")
    page.keyboard.insert_text(text)
    page.get_by_test_id("unsaved").wait_for()


def test_a_file_is_edited_and_saved_and_an_error_is_marked_at_its_line(page, bench):
    put(bench, "Wrong.pcs", "Sub Main\nEnd Sub\n")
    open_programs(page, bench)
    edit(page, "Wrong.pcs")
    text = "Sub Main\n  ' 動作\n  Suspend\nEnd Sub\n"
    type_text(page, text)
    page.keyboard.press("Control+S")
    page.get_by_test_id("unsaved").wait_for(state="hidden")
    assert bench.rc8.state.files.read("Wrong.pcs").decode() == text
    page.get_by_test_id("task-Wrong").get_by_test_id("start").click()
    page.get_by_test_id("program-error").get_by_text("Line 3: Suspend is not supported").wait_for()
    assert page.locator(".cm-line.ok-line-error").inner_text().strip() == "Suspend"
    page.get_by_test_id("error-tasks").get_by_text("SYNTAX_ERROR").first.wait_for()


def test_a_task_is_started_and_stopped_and_its_line_is_highlighted(page, bench):
    put(bench, "Endless.pcs", ENDLESS)
    open_programs(page, bench)
    edit(page, "Endless.pcs")
    row = page.get_by_test_id("task-Endless")
    row.get_by_test_id("start").click()
    row.get_by_test_id("status").get_by_text("running").wait_for()
    assert status(bench, "Endless") is TaskStatus.RUNNING
    page.locator(".cm-line.ok-line-running").wait_for()
    row.get_by_test_id("stop").click()
    row.get_by_test_id("status").get_by_text("suspended").wait_for()
    assert status(bench, "Endless") is TaskStatus.SUSPENDED


@pytest.mark.soak
def test_the_stop_button_stops_a_program(page, bench):
    put(bench, "Endless.pcs", ENDLESS)
    open_programs(page, bench)
    page.get_by_test_id("task-Endless").get_by_test_id("start").click()
    until(lambda: status(bench, "Endless") is TaskStatus.RUNNING)
    page.get_by_test_id("stop-all").click()
    until(lambda: status(bench, "Endless") is not TaskStatus.RUNNING)


@pytest.mark.soak
@pytest.mark.parametrize("stops", [True, False])
def test_closing_the_page_stops_a_program_if_this_is_chosen(page, bench, stops):
    put(bench, "Endless.pcs", ENDLESS)
    open_programs(page, bench)
    if not stops:
        page.get_by_test_id("stop-when-leaving").click()
    row = page.get_by_test_id("task-Endless")
    row.get_by_test_id("start").click()
    until(lambda: status(bench, "Endless") is TaskStatus.RUNNING)
    page.wait_for_timeout(3000)  # longer than the time without a heartbeat: the program runs while the page is open
    assert status(bench, "Endless") is TaskStatus.RUNNING
    page.close()
    if stops:
        until(lambda: status(bench, "Endless") is not TaskStatus.RUNNING)
    else:
        cycles = bench.rc8.state.seconds + 4
        until(lambda: bench.rc8.state.seconds > cycles)
        assert status(bench, "Endless") is TaskStatus.RUNNING
        with bench.rc8.state.cycles:
            bench.rc8.state.tasks.get_or_create("Endless").stop(StopMode.INSTANT)


@pytest.mark.soak
def test_an_error_of_a_running_program_is_marked(page, bench):
    put(bench, "Fault.pcs", "Sub Main\n  I1 = 1\n  Delay 500\n  I[100000] = 1\nEnd Sub\n")
    open_programs(page, bench)
    page.get_by_test_id("task-Fault").get_by_test_id("start").click()
    page.get_by_test_id("program-error").get_by_text("Line 4:").wait_for()
    assert page.locator(".cm-line.ok-line-error").inner_text().strip() == "I[100000] = 1"
    page.get_by_test_id("clear-errors").click()
    until(lambda: bench.rc8.state.faults.code == 0)


@pytest.mark.soak
def test_files_are_created_copied_renamed_deleted_uploaded_and_downloaded(page, bench):
    files = bench.rc8.state.files
    open_programs(page, bench)
    page.get_by_test_id("new-file").click()
    page.get_by_test_id("dialog-text").fill("New.pcs")
    page.get_by_test_id("dialog-ok").click()
    page.get_by_test_id("editor-title").get_by_text("New.pcs").wait_for()
    assert files.exists("New.pcs")
    page.get_by_test_id("copy").click()
    page.get_by_test_id("dialog-text").fill("Second.pcs")
    page.get_by_test_id("dialog-ok").click()
    page.get_by_test_id("file-Second.pcs").wait_for()
    page.get_by_test_id("rename").click()
    page.get_by_test_id("dialog-text").fill("Third.pcs")
    page.get_by_test_id("dialog-ok").click()
    page.get_by_test_id("file-Third.pcs").wait_for()
    assert (files.exists("Second.pcs"), files.exists("Third.pcs")) == (False, True)
    edit(page, "Third.pcs")
    page.get_by_test_id("delete").click()
    page.get_by_test_id("cancel").click()
    page.get_by_test_id("dialog").wait_for(state="detached")
    assert files.exists("Third.pcs")
    page.get_by_test_id("delete").click()
    page.get_by_test_id("choose-delete").click()
    page.get_by_test_id("file-Third.pcs").wait_for(state="detached")
    assert not files.exists("Third.pcs")
    data = "' 動作\r\n".encode("cp932")
    page.locator("input[type=file]").set_input_files({"name": "Up.txt", "mimeType": "text/plain", "buffer": data})
    page.get_by_test_id("file-Up.txt").wait_for()
    assert files.read("Up.txt") == data
    edit(page, "Up.txt")
    page.locator(".cm-content").get_by_text("動作").wait_for()
    with page.expect_download() as download:
        page.get_by_test_id("download").click()
    assert download.value.suggested_filename == "Up.txt"


@pytest.mark.soak
def test_unsaved_changes_are_not_discarded_without_a_question(page, bench):
    put(bench, "One.pcs", "Sub Main\nEnd Sub\n")
    open_programs(page, bench)
    edit(page, "One.pcs")
    type_text(page, "Sub Main\n  I1 = 2\nEnd Sub\n")
    page.get_by_test_id("file-Pro1.pcs").click()
    page.get_by_test_id("cancel").click()
    assert page.get_by_test_id("editor-title").inner_text() == "One.pcs"
    page.get_by_test_id("task-One").get_by_test_id("start").click()
    page.get_by_test_id("choose-save").click()
    until(lambda: b"I1 = 2" in bench.rc8.state.files.read("One.pcs"))
    page.get_by_test_id("file-Pro1.pcs").click()
    page.get_by_test_id("editor-title").get_by_text("Pro1.pcs").wait_for()


@pytest.mark.soak
def test_typing_while_a_program_runs_loses_no_character(page, bench):
    put(bench, "Endless.pcs", ENDLESS)
    open_programs(page, bench)
    edit(page, "Endless.pcs")
    page.get_by_test_id("task-Endless").get_by_test_id("start").click()
    page.locator(".cm-line.ok-line-running").wait_for()
    page.locator(".cm-content").click()
    page.keyboard.press("Control+End")
    page.keyboard.type("' abcdefghijklmnopqrstuvwxyz 0123456789", delay=20)
    page.keyboard.press("Control+S")
    page.get_by_test_id("unsaved").wait_for(state="hidden")
    text = bench.rc8.state.files.read("Endless.pcs").decode()
    assert text == ENDLESS + "' abcdefghijklmnopqrstuvwxyz 0123456789"
    page.get_by_test_id("task-Endless").get_by_test_id("stop").click()
    until(lambda: status(bench, "Endless") is not TaskStatus.RUNNING)
