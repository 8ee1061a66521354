"""Histories, watch lists and entered values of the page Monitor."""

from __future__ import annotations

from datetime import datetime

import pytest

from orinkit.core.errors import InvalidValue
from orinkit.tester.pages.monitor.watches import csv_text
from orinkit.tester.state.controller_log import logged_entry
from orinkit.tester.state.history import History
from orinkit.tester.state.poller import VariableRef
from orinkit.tester.state.watch_list import MAX_WATCHED, WatchList, WatchLists, entered_refs
from orinkit.tester.state.watched_value import LONGEST_ENTRY, entered_value, value_text
from orinkit.values.types import ARRAY, VarType
from orinkit.values.variant import Variant


def filled(count: int, capacity: int = 6000) -> History:
    history = History(capacity)
    for number in range(count):
        history.add(number * 0.1, [float(number)])
    return history


def test_a_history_keeps_its_capacity_of_the_latest_values():
    history = filled(10_000, 1000)
    assert 1000 <= len(history) <= 1250
    assert history.columns[0][-1] == 9999


def test_a_plot_has_few_points_and_keeps_a_single_peak():
    history = History()
    for number in range(5000):
        history.add(number * 0.1, [100.0 if number == 3210 else 0.0])
    points = history.plot(0, 0.0, 200)
    assert len(points) <= 202
    assert max(value for _, value in points if value is not None) == 100.0
    assert points == sorted(points)


def test_the_points_of_a_plot_do_not_move_when_values_are_added():
    history = filled(5000)
    before = history.plot(0, 0.0, 200)
    history.add(500.0, [0.0])
    assert history.plot(0, 0.0, 200)[: len(before) - 2] == before[:-2]


def test_a_plot_has_a_gap_for_a_pause_and_for_a_value_that_is_not_finite():
    history = History()
    for time, value in ((0.0, 1.0), (0.1, float("nan")), (60.0, 2.0)):
        history.add(time, [value])
    assert history.plot(0, 0.0, 100) == [(0.0, 1.0), (0.1, None), (0.1, None), (60.0, 2.0)]


def test_another_number_of_elements_begins_a_new_history():
    history = filled(10)
    history.add(2.0, [1.0, 2.0])
    assert (len(history), len(history.columns)) == (1, 2)


def test_csv_has_one_column_for_each_number_and_empty_cells_for_missing_values():
    pose, number = History(), History()
    pose.add(0.0, [1.5, 2.0])
    number.add(0.0, [7.0])
    number.add(1.0, [8.0])
    lines = csv_text([("P1", pose), ("I1", number)]).splitlines()
    assert lines[0] == "time,P1[0],P1[1],I1"
    assert [line.partition(",")[2] for line in lines[1:]] == ["1.5,2,7", ",,8"]


@pytest.mark.parametrize(
    ("text", "vt", "value"),
    [
        ("12", VarType.I4, 12), ("-0x10", VarType.I4, -16), ("1.5", VarType.R8, 1.5), ("on", VarType.BOOL, True),
        ("Off", VarType.BOOL, False), (" a, b ", VarType.BSTR, " a, b "), ("1, 2.5", VarType.R4 | ARRAY, [1.0, 2.5]),
        ("1 2 3", VarType.I2 | ARRAY, [1, 2, 3]), ("1 255", VarType.UI1 | ARRAY, b"\x01\xff"),
    ],
)  # fmt: skip
def test_an_entered_value_has_the_type_of_the_variable(text, vt, value):
    entered = entered_value(text, vt)
    assert (entered.type, entered.value) == (vt, value)


def test_an_entered_date_is_a_date():
    assert entered_value("2026-11-24 10:00:00", VarType.DATE).plain == datetime(2026, 11, 24, 10)


@pytest.mark.parametrize(
    ("text", "vt"),
    [
        ("1.5", VarType.I4), ("maybe", VarType.BOOL), ("x", VarType.R8), ("", VarType.I4), ("70000", VarType.I2),
        ("1,,2", VarType.R8 | ARRAY), ("tomorrow", VarType.DATE), ("300", VarType.UI1 | ARRAY),
        ("x" * (LONGEST_ENTRY + 1), VarType.BSTR),
    ],
)  # fmt: skip
def test_an_invalid_value_is_refused(text, vt):
    with pytest.raises(InvalidValue):
        entered_value(text, vt)


def test_values_are_short_text_in_one_line():
    assert value_text(Variant(VarType.R4, 0.1)) == "0.1"
    assert value_text(Variant(VarType.BSTR, "a\nb")) == "a\\nb"
    assert value_text(Variant(VarType.BOOL | ARRAY, [True, False])) == "true, false"
    assert len(value_text(Variant(VarType.BSTR, "x" * 1_000_000))) <= 300


def test_names_are_entered_as_a_list():
    refs = entered_refs("controller", "ignored", "I1, P2  @MODE")
    assert refs == [VariableRef("controller", "", name) for name in ("I1", "P2", "@MODE")]
    assert entered_refs("task", "Pro1", "@STATUS")[0].label == "Pro1.@STATUS"


@pytest.mark.parametrize(
    ("kind", "owner", "text"),
    [("controller", "", ""), ("task", "", "@STATUS"), ("controller", "", "I*"), ("controller", "", "x" * 10_000_000),
     ("controller", "", "x" * 200)],
)  # fmt: skip
def test_invalid_names_are_refused(kind, owner, text):
    with pytest.raises(InvalidValue):
        entered_refs(kind, owner, text)


def test_a_watch_list_is_ordered_and_limited():
    chosen, (a, b, c) = WatchList(), entered_refs("controller", "", "I1 I2 I3")
    chosen.add([a, b, a, c])
    chosen.move(c, -1)
    chosen.move(a, 99)
    assert list(chosen) == [c, b, a]
    chosen.remove(b)
    assert list(chosen) == [c, a]
    with pytest.raises(InvalidValue):
        chosen.add(entered_refs("controller", "", " ".join(f"F{number}" for number in range(MAX_WATCHED))))
    assert len(chosen) == 2


def test_each_user_has_a_list():
    lists = WatchLists()
    lists.of("a").add(entered_refs("controller", "", "I1"))
    assert (len(lists.of("a")), len(lists.of("b"))) == (1, 0)


def test_an_unknown_form_of_a_record_is_ignored():
    assert logged_entry([1, 2]) is None
    assert logged_entry("text") is None
    entry = logged_entry([-1, 0, 0, 0, 0, 0, 0, 0, 0])
    assert entry is not None
    assert entry.time is None
