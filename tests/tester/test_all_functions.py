"""Every function of the table is called through its form, and the received packet is the one that was entered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.cao.table import INTERFACES, Argument, Function
from orinkit.tester.state.objects import functions_of
from orinkit.values.variant import Variant, VarType
from support.browser import needs_browser, user
from support.objects_page import add, choose_type, fill, open_objects, open_tab
from support.received import ReceivedPackets, received_packets

SAMPLES = {VarType.I4: "3", VarType.R4: "1.5", VarType.BSTR: "text", VarType.VARIANT: "5"}
OBJECTS = {
    "Extension": "Hand0", "File": "TEST.PCS", "Robot": "Arm", "Task": "TEST2", "Variable": "I10", "Command": "ClearError",
    "Message": "Message",
}  # fmt: skip
LAST = ("Controller_Disconnect", "Service_Start", "Service_Stop")


def test_each_of_the_137_functions_has_a_form_at_the_objects_of_its_interface():
    offered = [each.id for interface in INTERFACES for each in functions_of(interface)]
    assert sorted(offered) == list(FUNCTIONS) == list(range(1, 138))
    entered = {each.vt for function in FUNCTIONS.values() for each in function.arguments if not each.is_handle}
    assert entered == set(SAMPLES)  # the types for which there are fields


@pytest.fixture
def received() -> Iterator[ReceivedPackets]:
    with received_packets() as recorded:
        yield recorded


def expected(argument: Argument) -> Variant:
    if argument.vt is VarType.VARIANT:
        return Variant(VarType.I4, 5)
    return Variant(argument.vt, {VarType.I4: 3, VarType.R4: 1.5, VarType.BSTR: "text"}[argument.vt])


def call(page: Any, function: Function[..., Any], received: ReceivedPackets) -> None:
    """Fill in the form of a function and call it; compare the packet."""
    page.get_by_test_id(f"function-{function.name}").click()
    form = page.get_by_test_id(f"form-{function.name}")
    form.wait_for()
    given = [each for each in function.arguments if not each.is_handle]
    for argument in given:
        if argument.vt is VarType.VARIANT:
            choose_type(page, f"argument-{argument.name}", "I4")
        fill(form, f"argument-{argument.name}", SAMPLES[argument.vt])
    shown = [int(form.get_by_test_id("handle").inner_text())] if len(given) < len(function.arguments) else []
    before = len(received.of(function))
    page.get_by_test_id(f"call-{function.name}").click()
    got = received.wait_for(function, before + 1)
    if function.name != "Controller_GetName":  # the Tester itself checks with it whether the connection exists
        assert got.arguments == [*(Variant(VarType.I4, each) for each in shown), *map(expected, given)], function.name
    if function.releases:
        form.wait_for(state="hidden")  # the object has disappeared from the page
    else:
        form.get_by_test_id("result-code").or_(form.get_by_test_id("result-error")).filter(
            visible=True
        ).first.wait_for()


def call_all(page: Any, functions: list[Function[..., Any]], received: ReceivedPackets) -> set[int]:
    """Call functions of the selected object; return their IDs."""
    if page.get_by_test_id("tab-Functions").count():
        open_tab(page, "Functions")
    for function in functions:
        call(page, function, received)
    return {each.id for each in functions}


def select(page: Any, number: int) -> None:
    """Select a row of the tree, and wait until the page shows its object."""
    row = page.get_by_test_id("tree").get_by_role("treeitem").nth(number)
    row.click()
    row.and_(page.locator('[aria-selected="true"]')).wait_for()


@pytest.mark.soak
@needs_browser
def test_every_function_is_called_through_the_page(browser: Any, bench: Any, received: ReceivedPackets) -> None:
    with orinkit.connect(bench.server.url) as client:
        for name in ("TEST.PCS", "TEST2.PCS"):
            client.file(name, create=True).text = "Sub Main\nEnd Sub\n"
    with user(browser) as page:
        open_objects(page, bench.tester.url)
        bench.rc8.emergency_stop(True)  # creates a message
        bench.rc8.emergency_stop(False)
        done: set[int] = set()
        for interface in ("Controller", *OBJECTS):
            select(page, 1)
            if interface != "Controller":
                add(page, interface, OBJECTS[interface])
            ordered = sorted(functions_of(interface), key=lambda each: (each.releases, each.id))
            done |= call_all(page, [each for each in ordered if each.name not in LAST], received)
        select(page, 0)
        done |= call_all(page, [BY_NAME["Controller_Connect"]], received)
        select(page, 1)
        done |= call_all(page, [BY_NAME["Controller_Disconnect"]], received)
        select(page, 0)
        done |= call_all(page, [BY_NAME[name] for name in LAST[1:]], received)
        assert len(done) == 137
