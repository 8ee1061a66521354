"""Checks of numbers that programs pass as arguments."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.core.validation import (
    brief,
    check_amount,
    check_finite,
    check_positive,
    check_range,
    check_seconds,
    check_whole,
    is_number,
    real,
    rounded_to_single,
    whole,
)

pytestmark = pytest.mark.core

NO_NUMBERS = [
    True,
    "1",
    b"1",
    None,
    [1],
    1j,
    math.nan,
    math.inf,
    -math.inf,
    10**400,
    10**5000,
    np.array([1, 2]),
]
IDS = [brief(value) for value in NO_NUMBERS]
SOME = [1, 1.0, np.int16(1), np.float32(1), Decimal(1), Fraction(1)]


@pytest.mark.parametrize("value", SOME, ids=repr)
def test_any_numeric_type(value):
    for found in (
        real(value), check_finite("x", value), check_positive("x", value), check_amount("x", value, 1),
        check_seconds("x", value), check_range("x", value, 1, 1),
    ):  # fmt: skip
        assert (type(found), found) == (float, 1.0)


@pytest.mark.parametrize("value", NO_NUMBERS, ids=IDS)
def test_no_numbers(value):
    assert real(value) is None
    for check in (
        lambda: check_finite("x", value), lambda: check_positive("x", value), lambda: check_amount("x", value, 9),
        lambda: check_seconds("x", value), lambda: check_range("x", value, -9, 9), lambda: check_whole("x", value, 9),
    ):  # fmt: skip
        with pytest.raises(InvalidValue, match=r"^x must be ") as caught:
            check()
        assert len(str(caught.value)) < 120


@pytest.mark.parametrize("value", [3, np.int64(3), np.uint8(3)], ids=repr)
def test_whole_numbers(value):
    assert (type(whole(value)), whole(value), check_whole("x", value, 3)) == (int, 3, 3)


@pytest.mark.parametrize("value", [True, np.True_, 3.0, "3", None, Decimal(3)], ids=repr)
def test_no_whole_numbers(value):
    assert whole(value) is None


def test_numbers():
    assert is_number(1)
    assert is_number(math.nan)
    assert not is_number(True)
    assert not is_number("1")


def test_single_precision():
    assert rounded_to_single(0.1) == float(np.float32(0.1))
    assert math.isnan(rounded_to_single(math.nan))
    with pytest.raises(OverflowError):
        rounded_to_single(1e39)


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: check_finite("x", "1", "P"), "P: x must be a finite number, not '1'"),
        (lambda: check_positive("x", 0, "P"), "P: x must be greater than 0, not 0"),
        (lambda: check_positive("x", -1.5), "x must be greater than 0, not -1.5"),
        (lambda: check_amount("x", 101, 100), "x must be above 0 and at most 100, not 101"),
        (lambda: check_amount("x", 0, 3600000), "x must be above 0 and at most 3600000, not 0"),
        (lambda: check_seconds("x", 0), "x must be a number of seconds above 0 and up to 3600, not 0"),
        (lambda: check_seconds("x", 11, 10), "x must be a number of seconds above 0 and up to 10, not 11"),
        (lambda: check_range("x", 1, 2.0, 7200.0, seconds=True), "x must be 2 to 7200 s, not 1"),
        (lambda: check_range("x", 1.5, 0, 1), "x must be 0 to 1, not 1.5"),
        (lambda: check_whole("x", 2**32, 2**32 - 1), "x must be 0 to 4294967295, not 4294967296"),
        (lambda: check_whole("x", 0, 7, 1), "x must be 1 to 7, not 0"),
    ],
)
def test_messages(check, message):
    with pytest.raises(InvalidValue) as caught:
        check()
    assert str(caught.value) == message
    i18n.use("ja")
    with pytest.raises(InvalidValue) as caught:
        check()
    assert str(caught.value) not in (message, "")


def test_ranges_in_japanese():
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=re.escape("alive は 0.3～3600 秒の範囲で指定してください (指定値: 0.1)")):
        check_range("alive", 0.1, 0.3, 3600, seconds=True)
    with pytest.raises(InvalidValue, match=re.escape("speed は 0.1～100 の範囲で指定してください (指定値: 0)")):
        check_range("speed", 0, 0.1, 100)


def test_a_value_in_a_message():
    class Awkward:
        def __repr__(self) -> str:
            raise RuntimeError

    assert brief("x" * 50) == f"'{'x' * 36}..."
    assert brief(10**5000).startswith("0x")
    assert brief(Awkward()) == "<Awkward>"
