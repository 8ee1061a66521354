"""The page Objects: tree, forms, results, and invalid input."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.cao import functions as f
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from support.browser import TesterProcess, needs_browser, user
from support.objects_page import add, choose, choose_type, expect, fill, open_objects, open_tab
from support.received import ReceivedPackets, received_packets
from support.waiting import until

pytestmark = [needs_browser, pytest.mark.soak]


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


def test_the_stop_button_stops_a_move_in_progress(objects, bench, received):
    add(objects, "Robot", "Arm")
    open_tab(objects, "Execute")
    fill(objects, "command", "TakeArm")
    objects.get_by_test_id("command-hint").filter(has_text=": ").wait_for()
    fill(objects, "parameter", "0,1")
    objects.get_by_test_id("execute").click()
    expect(objects.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
    open_tab(objects, "Move")
    fill(objects, "pose", "@E J(90,0,90,0,90,0)")
    fill(objects, "move-option", "SPEED=1")
    objects.get_by_test_id("move").click()
    until(lambda: bench.rc8.state.arm.busy)
    objects.get_by_test_id("stop-all").click()
    expect(objects.get_by_test_id("result-error")).to_contain_text("0x8")
    until(lambda: not bench.rc8.state.arm.busy)
    assert received.of(f.robot_halt)


def execute(page: Any, command: str, parameter: str = "") -> None:
    """Execute a command of the selected object with its usual type."""
    open_tab(page, "Execute")
    fill(page, "command", command)
    page.get_by_test_id("command-hint").filter(has_text=re.compile(".")).wait_for()
    if parameter:
        fill(page, "parameter", parameter)
    page.get_by_test_id("execute").click()


@pytest.mark.soak
def test_a_command_of_the_controller_is_executed(objects, bench, received):
    execute(objects, "GetErrorDescription", "-2147467259")
    expect(objects.get_by_test_id("result-type")).to_contain_text("VT_BSTR")
    assert received.wait_for(f.controller_execute).arguments[1:] == [
        Variant(VarType.BSTR, "GetErrorDescription"), Variant(VarType.I4, -2147467259),
    ]  # fmt: skip
    bench.rc8.raise_error(0x83204071)
    until(lambda: bench.rc8.state.faults.code)
    execute(objects, "ClearError")
    expect(objects.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
    until(lambda: not bench.rc8.state.faults.code)


@pytest.mark.soak
def test_the_id_selects_the_element_of_a_variable_with_a_wildcard(objects, bench, received):
    with orinkit.connect(bench.server.url) as client:
        client.variable("I12").value = 1212
    add(objects, "Variable", "I*")
    fill(objects, "id", "12")
    objects.get_by_test_id("put-id").click()
    assert received.wait_for(f.variable_put_id).arguments[1] == Variant(VarType.I4, 12)
    objects.get_by_test_id("get-id").click()
    expect(objects.get_by_test_id("id-result-value")).to_have_text("12")
    objects.get_by_test_id("get").click()
    expect(objects.get_by_test_id("value-result-value")).to_have_text("1212")


@pytest.mark.soak
def test_a_robot_is_added_with_an_option_and_released(objects, bench, received):
    objects.get_by_test_id("kind").get_by_role("button", name="Robot", exact=True).click()
    fill(objects, "add-Robot-name", "Arm")
    fill(objects, "add-Robot-option", "$IsIDHandle$")
    objects.get_by_test_id("add-Robot").click()
    assert [each.value for each in received.wait_for(f.controller_get_robot).arguments[1:]] == ["Arm", "$IsIDHandle$"]
    objects.get_by_test_id("object").get_by_text("Arm", exact=True).first.wait_for()
    handle = objects.get_by_test_id("object-handle").inner_text().split()[1]
    objects.get_by_role("button", name="Release Arm").last.click()
    assert received.wait_for(f.robot_release).arguments[0] == Variant(VarType.I4, int(handle))


@pytest.mark.soak
def test_a_robot_changes_its_tool_and_reads_its_variables(objects, bench, received):
    add(objects, "Robot", "Arm")
    objects.get_by_test_id("get-Variable").click()
    objects.get_by_test_id("names").get_by_role("button", name="@CURRENT_ANGLE", exact=True).wait_for()
    execute(objects, "TakeArm", "0,1")
    expect(objects.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
    open_tab(objects, "Change")
    fill(objects, "change-name", "Tool1")
    objects.get_by_test_id("change").click()
    assert received.wait_for(f.robot_change).arguments[1] == Variant(VarType.BSTR, "Tool1")
    until(lambda: bench.rc8.state.arm.space.tools.current == 1)
    fill(objects, "change-name", "Tool0")
    objects.get_by_test_id("change").click()
    until(lambda: bench.rc8.state.arm.space.tools.current == 0)
    execute(objects, "GiveArm")
    expect(objects.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
    add(objects, "Variable", "@CURRENT_ANGLE")
    objects.get_by_test_id("get").click()
    expect(objects.get_by_test_id("value-result-type")).to_have_text("VT_R8|VT_ARRAY, 8 elements")
    fill(objects, "value", "1")  # of type I4; the variable is read-only
    objects.get_by_test_id("put").click()
    received.wait_for(f.variable_put_value)
    expect(objects.get_by_test_id("value-result-error")).to_contain_text("0x8")


@pytest.mark.soak
def test_performance_reads_at_least_500_values_a_second(objects, bench, received):
    add(objects, "Variable", "I11")
    open_tab(objects, "Performance")
    fill(objects, "performance-calls", "0")
    objects.get_by_test_id("performance-start").click()
    expect(objects.get_by_test_id("performance-error")).to_contain_text("1 to 1000000")
    fill(objects, "performance-calls", "3000")
    fill(objects, "performance-seconds", "60")
    figures, rates = objects.get_by_test_id("performance-figures"), []
    while max(rates, default=0) < 500 and len(rates) < 5:  # the machine may be busy
        objects.get_by_test_id("performance-start").click()
        received.wait_for(f.variable_get_value, 3000 * (len(rates) + 1))
        expect(objects.get_by_test_id("performance-start")).to_be_enabled()
        expect(figures).to_contain_text("3000")
        rates.append(int(re.search(r"calls/s\s*(\d+)", figures.inner_text())[1]))
    assert max(rates) >= 500
    assert len(received.of(f.variable_get_value)) == 3000 * len(rates)
    fill(objects, "performance-calls", "1000000")
    objects.get_by_test_id("performance-start").click()
    received.wait_for(f.variable_get_value, 3000 * len(rates) + 100)
    objects.get_by_test_id("performance-stop").click()
    expect(objects.get_by_test_id("performance-start")).to_be_enabled()


@pytest.mark.soak
def test_invalid_input_is_reported_beside_the_field_and_nothing_is_sent(objects, bench, received):
    add(objects, "Robot", "Arm")
    open_tab(objects, "Functions")
    objects.get_by_test_id("function-Robot_Drive").click()
    fill(objects, "argument-axis", "one")
    fill(objects, "argument-value", "1e99")
    expect(objects.get_by_test_id("form-Robot_Drive")).to_contain_text("to 2147483647 (VT_I4), found 'one'")
    objects.get_by_test_id("call-Robot_Drive").click()
    expect(objects.get_by_test_id("form-Robot_Drive")).to_contain_text("(VT_R4), found '1e99'")
    objects.get_by_test_id("function-Robot_Move").click()
    fill(objects, "argument-interpolation", "1")
    choose_type(objects, "argument-pose", "ARRAY | VARIANT")
    for text, problem in (("(5,1", '")"'), ("(99,1)", "the number of a type"), ("5,1", "is a value of type VT_R8")):
        fill(objects, "argument-pose", text)
        expect(objects.get_by_test_id("form-Robot_Move")).to_contain_text(problem)
        objects.get_by_test_id("call-Robot_Move").click()
    pose = objects.get_by_test_id("argument-pose")
    pose.fill("")
    pose.focus()
    objects.keyboard.insert_text("(3,1)," * 1_700_000)  # 10 MB, pasted
    expect(objects.get_by_test_id("form-Robot_Move")).to_contain_text("more than 100000")
    objects.get_by_test_id("call-Robot_Move").click()
    fill(objects, "argument-pose", "(5,1)")
    expect(objects.get_by_test_id("argument-pose-description")).to_have_text("VT_VARIANT|VT_ARRAY, 1 element")
    assert not received.of(f.robot_drive)
    assert not received.of(f.robot_move)
    objects.get_by_test_id("call-Robot_Move").click()
    assert received.wait_for(f.robot_move).arguments[2] == Variant(VARIANT_ARRAY, [Variant(VarType.R8, 1.0)])


@pytest.mark.soak
def test_a_vanished_controller_is_reported_and_the_page_goes_on(browser, tmp_path):
    first = orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0")
    with TesterProcess(first.url, folder=tmp_path) as tester, user(browser) as page:
        open_objects(page, tester.url)
        add(page, "Variable", "I1")
        first.close()
        expect(page.get_by_test_id("no-controller")).to_contain_text("is not connected")
        expect(page.get_by_test_id("connection-error")).to_be_visible()
        with orinkit.serve(VirtualRC8(), first.url):
            page.get_by_role("link", name="Open the page Connections").click()
            page.get_by_role("button", name="Connect").first.click()
            page.get_by_test_id("state").get_by_text("connected", exact=True).wait_for()
            open_objects(page, tester.url)
            add(page, "Variable", "I1")
            page.get_by_test_id("get").click()
            expect(page.get_by_test_id("value-result-value")).to_have_text("0")
