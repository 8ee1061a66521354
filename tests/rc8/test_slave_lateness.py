"""slvGetLateness: how virtual controllers report late set-points."""

from __future__ import annotations

import pytest

from orinkit.core import i18n
from orinkit.rc8.slave_lateness import COMMAND, Lateness, build_lateness, read_lateness
from orinkit.values.variant import R8_ARRAY, Variant

pytestmark = pytest.mark.core


def test_what_is_built_can_be_read():
    late = Lateness(3, 0.1, 0.17)
    answer = build_lateness(late)
    assert answer == Variant(R8_ARRAY, [3.0, 0.1, 0.17])
    assert read_lateness(answer.plain) == late
    assert read_lateness([0.0, 0.0, 0.0]) == Lateness()


@pytest.mark.parametrize(
    "answer",
    [None, 0, "", [], [1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [1, 2.0, 3.0], ["1", 2.0, 3.0], [float("nan"), 0.0, 0.0],
     [float("inf"), 0.0, 0.0], [1.0, -0.1, 0.0], (1.0, 0.1, 0.1)],
)  # fmt: skip
def test_another_answer_is_that_of_a_controller_without_the_command(answer):
    assert read_lateness(answer) is None


@pytest.mark.parametrize(
    ("late", "en", "ja"),
    [
        (Lateness(), "no late set-points", "目標値の遅延なし"),
        (Lateness(1, 0.0634, 0.0634), "1 late set-point, by 63 ms", "遅延した目標値 1 個 (63 ms)"),
        (Lateness(3, 0.1004, 0.17), "3 late set-points, by up to 100 ms", "遅延した目標値 3 個 (最大 100 ms)"),
    ],
)
def test_messages_in_both_languages(late, en, ja):
    assert str(late) == en
    i18n.use("ja")
    assert str(late) == ja


def test_the_name_is_one_of_the_commands_of_slave_mode():
    assert COMMAND.startswith("slv")
