"""Conversion of Python values to VARIANTs: types, contents, and errors."""

from __future__ import annotations

import array
import collections
import copy
import enum
import math
import pickle
import time
from datetime import UTC, date, datetime, timedelta, timezone
from decimal import ROUND_DOWN, Decimal, Inexact, getcontext, localcontext
from fractions import Fraction
from math import inf, nan
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.values.conversions import lossless_datetime, ole_datetime, ole_days, to_datetime
from orinkit.values.types import SIZES
from orinkit.values.variant import (
    ARRAY,
    R8_ARRAY,
    VARIANT_ARRAY,
    Variant,
    VarType,
    plain,
    type_name,
    unwrapped,
    variant,
)
from support.strategies import same, variants

pytestmark = pytest.mark.core

WHOLE = {
    VarType.I1: (-(2**7), 2**7 - 1),
    VarType.I2: (-(2**15), 2**15 - 1),
    VarType.I4: (-(2**31), 2**31 - 1),
    VarType.I8: (-(2**63), 2**63 - 1),
    VarType.UI1: (0, 2**8 - 1),
    VarType.UI2: (0, 2**16 - 1),
    VarType.UI4: (0, 2**32 - 1),
    VarType.UI8: (0, 2**64 - 1),
    VarType.ERROR: (0, 2**32 - 1),
}
MOMENT = datetime(2026, 11, 21, 10, 30, 0, 123456)


class Axis(enum.IntEnum):
    X = 1
    Y = 2


class Colour(str, enum.Enum):  # noqa: UP042 - users have such
    RED = "red"

    def __str__(self) -> str:
        return "the colour red"


class Text(str):
    """A subclass of str with an attribute."""

    __slots__ = ()


class Point(NamedTuple):
    x: float
    y: float


class Grumpy:
    """Raises an exception in every operation, even repr()."""

    def __repr__(self) -> str:
        raise ArithmeticError("no")


def contains_itself() -> list:
    endless: list = []
    endless.append(endless)
    return endless


# --- types ------------------------------------------------------------------------------------------------------------


def test_type_numbers_and_sizes_are_those_of_the_table():
    """VE026A table 3-1; VT_ERROR has 4 bytes on all controllers except the VE026A."""
    table = {
        "EMPTY": 0, "NULL": 1, "ERROR": 10, "UI1": 17, "I2": 2, "UI2": 18, "I4": 3, "UI4": 19, "R4": 4, "R8": 5,
        "CY": 6, "DATE": 7, "BOOL": 11, "BSTR": 8, "VARIANT": 12, "ARRAY": 0x2000, "I1": 16, "I8": 20, "UI8": 21,
    }  # fmt: skip
    assert {vt.name: vt.value for vt in VarType} == table
    sizes = {1: "I1 UI1", 2: "I2 UI2 BOOL", 4: "I4 UI4 R4 ERROR", 8: "R8 CY DATE I8 UI8"}
    assert dict(SIZES) == {VarType[name]: size for size, names in sizes.items() for name in names.split()}
    assert (ARRAY, VARIANT_ARRAY, R8_ARRAY) == (0x2000, 8204, 8197)


@pytest.mark.parametrize(
    ("vt", "name"),
    [
        (VarType.I4, "VT_I4"),
        (8197, "VT_R8|VT_ARRAY"),
        (0x2000, "VT_EMPTY|VT_ARRAY"),
        (99, "VT_99?"),
        (0x2063, "VT_99?|VT_ARRAY"),
    ],
)
def test_type_names(vt, name):
    assert type_name(vt) == name


# --- what a Python value becomes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "vt", "kept"),
    [
        (None, VarType.EMPTY, None),
        (True, VarType.BOOL, True),
        (7, VarType.I4, 7),
        (-(2**31), VarType.I4, -(2**31)),
        (1.5, VarType.R8, 1.5),
        ("P1", VarType.BSTR, "P1"),
        ("ロボット\U0001f916", VarType.BSTR, "ロボット\U0001f916"),
        (MOMENT, VarType.DATE, MOMENT),
        (Decimal("12.3456"), VarType.CY, Decimal("12.3456")),
        (b"\x00\xff", VarType.UI1 | ARRAY, b"\x00\xff"),
        (bytearray(b"ab"), VarType.UI1 | ARRAY, b"ab"),
        (memoryview(b"abc")[::2], VarType.UI1 | ARRAY, b"ac"),
        (b"", VarType.UI1 | ARRAY, b""),
        ([1, 2], VarType.I4 | ARRAY, [1, 2]),
        ((1, 2), VarType.I4 | ARRAY, [1, 2]),
        ([True, False], VarType.BOOL | ARRAY, [True, False]),
        ([1.0, nan], R8_ARRAY, [1.0, nan]),
        (["a", ""], VarType.BSTR | ARRAY, ["a", ""]),
        ([MOMENT], VarType.DATE | ARRAY, [MOMENT]),
        ([Decimal(1)], VarType.CY | ARRAY, [Decimal(1)]),
        ([], VARIANT_ARRAY, []),
        ((), VARIANT_ARRAY, []),
        (range(3), VarType.I4 | ARRAY, [0, 1, 2]),
        (collections.deque([1.0]), R8_ARRAY, [1.0]),
        (array.array("d", [1.0, 2.0]), R8_ARRAY, [1.0, 2.0]),
        (Point(1.0, 2.0), R8_ARRAY, [1.0, 2.0]),
        # Subclasses have the type of their base class.
        (Axis.Y, VarType.I4, 2),
        ([Axis.X, Axis.Y], VarType.I4 | ARRAY, [1, 2]),
        ([Axis.X, 5], VarType.I4 | ARRAY, [1, 5]),
        (Colour.RED, VarType.BSTR, "red"),
        (Text("x"), VarType.BSTR, "x"),
        ([Text("x"), "y"], VarType.BSTR | ARRAY, ["x", "y"]),
    ],
)
def test_type_and_content_of_python_values(value, vt, kept):
    made = variant(value)
    assert made.type == vt
    assert same(made.value, kept)
    assert type(made.type) is int or isinstance(made.type, VarType)


@pytest.mark.parametrize(
    ("items", "types"),
    [
        ([1, 2.0], [VarType.I4, VarType.R8]),
        ([1, True], [VarType.I4, VarType.BOOL]),
        ([None], [VarType.EMPTY]),
        ([None, None], [VarType.EMPTY, VarType.EMPTY]),
        ([[1.0], "J"], [R8_ARRAY, VarType.BSTR]),
        ([[], []], [VARIANT_ARRAY, VARIANT_ARRAY]),
        ([b"a", b"b"], [VarType.UI1 | ARRAY] * 2),
        ([Variant(VarType.I2, 1), Variant(VarType.I2, 2)], [VarType.I2, VarType.I2]),
        ([Variant(VarType.NULL)], [VarType.NULL]),
        ([np.array([1, 2]), np.array(3)], [VarType.I4 | ARRAY, VarType.I4]),
        ([np.float32(1), 1.0], [VarType.R4, VarType.R8]),
    ],
)
def test_a_mixed_list_is_a_variant_array(items, types):
    made = variant(items)
    assert made.type == VARIANT_ARRAY
    assert [element.type for element in made.value] == types


def test_a_variant_stays_itself():
    made = Variant(VarType.UI2, 5)
    assert variant(made) is made


@pytest.mark.parametrize(
    "value", [2**31, -(2**31) - 1, 2**63, 2**64, 10**400, 10**5000, -(10**5000)], ids=lambda value: value.bit_length()
)
def test_an_int_beyond_vt_i4_is_refused_never_wrapped(value):
    with pytest.raises(InvalidValue, match=r"does not fit VT_I4 \(-2147483648 to 2147483647\).*VarType.I8"):
        variant(value)
    with pytest.raises(InvalidValue, match="does not fit VT_I4"):
        variant([1, value])


@pytest.mark.parametrize(
    "value",
    [
        object(), {1: 2}, {1, 2}, frozenset(), (i for i in range(3)), 1j, date(2026, 1, 1), timedelta(1), Fraction(1, 2),
        int, np.float64, len, Ellipsis, iter([1]), Grumpy(),
    ],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
@pytest.mark.parametrize("wrap", [lambda x: x, lambda x: [x], lambda x: [1, [x]]])
def test_values_that_cannot_be_converted(value, wrap):
    with pytest.raises(
        InvalidValue, match=f"a {type(value).__name__} cannot be converted to a VARIANT.*Try: None, bool, int"
    ):
        variant(wrap(value))
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="VARIANT にできません"):
        variant(wrap(value))


def test_long_values_are_shortened_in_messages():
    with pytest.raises(InvalidValue) as caught:
        variant({"key": "x" * 100_000})
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("wrap", [variant, lambda value: Variant(VARIANT_ARRAY, value)])
def test_a_list_that_contains_itself_or_is_nested_without_end(wrap):
    with pytest.raises(InvalidValue, match="nested too deep for a VARIANT, or contains itself"):
        wrap(contains_itself())
    twice: list = []
    twice += [twice, twice]
    with pytest.raises(InvalidValue, match="nested too deep"):
        wrap(twice)
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    with pytest.raises(InvalidValue, match="nested too deep"):
        wrap(deep)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="入れ子"):
        wrap([twice])


def test_a_list_in_a_list_many_times_is_fine():
    nested: object = 1
    for _ in range(100):
        nested = [nested, None]
    made = variant(nested)
    assert made.plain == nested


# --- numpy, which is never imported by the library --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "vt", "kept"),
    [
        (np.bool_(True), VarType.BOOL, True),
        (np.int8(-1), VarType.I1, -1),
        (np.int16(-1), VarType.I2, -1),
        (np.int32(-1), VarType.I4, -1),
        (np.int64(-1), VarType.I4, -1),
        (np.uint8(255), VarType.UI1, 255),
        (np.uint16(65535), VarType.UI2, 65535),
        (np.uint32(2**32 - 1), VarType.UI4, 2**32 - 1),
        (np.uint64(5), VarType.I4, 5),
        (np.float32(0.5), VarType.R4, 0.5),
        (np.float64(0.1), VarType.R8, 0.1),
        (np.str_("あ"), VarType.BSTR, "あ"),
        (np.array(5), VarType.I4, 5),
        (np.array("あ"), VarType.BSTR, "あ"),
        (np.array([1.0, 2.0]), R8_ARRAY, [1.0, 2.0]),
        (np.array([1.0, 2.0])[::-1], R8_ARRAY, [2.0, 1.0]),
        (np.array([1, 2], ">i2"), VarType.I2 | ARRAY, [1, 2]),
        (np.array([1.5], ">f8"), R8_ARRAY, [1.5]),
        (np.array([1.5, 2], np.float32), VarType.R4 | ARRAY, [1.5, 2.0]),
        (np.array([True, False]), VarType.BOOL | ARRAY, [True, False]),
        (np.array([1, 255], np.uint8), VarType.UI1 | ARRAY, b"\x01\xff"),
        (np.array(["P1", "長い名前"]), VarType.BSTR | ARRAY, ["P1", "長い名前"]),
        (np.array([], float), R8_ARRAY, []),
        ([np.float64(1), np.float64(2)], R8_ARRAY, [1.0, 2.0]),
        ([np.float64(1), 2.0], R8_ARRAY, [1.0, 2.0]),
        ([np.int64(1), 2, Axis.X], VarType.I4 | ARRAY, [1, 2, 1]),
        ([np.bool_(True), False], VarType.BOOL | ARRAY, [True, False]),
        ([np.str_("a"), "b"], VarType.BSTR | ARRAY, ["a", "b"]),
        (list(np.array([1, 2], np.float32)), VarType.R4 | ARRAY, [1.0, 2.0]),
    ],
)
def test_numpy_by_dtype(value, vt, kept):
    made = variant(value)
    assert made.type == vt
    assert same(made.value, kept)
    if isinstance(kept, list):
        assert [type(item) for item in made.value] == [type(item) for item in kept]


@pytest.mark.parametrize(
    "value",
    [
        np.zeros((2, 3)), np.array(1j), np.array([1 + 2j]), np.float16(1), np.array(["2026-01-01"], "M8[D]"),
        np.datetime64("2026-01-01"), np.timedelta64(1), np.array([None, 1], object), np.array([b"ab"]), np.bytes_(b"ab"),
        np.zeros(2, [("x", "i4")]), np.zeros(2, [("x", "i4")])[0],
    ],
    ids=lambda value: f"{value.dtype}-{value.ndim}",
)  # fmt: skip
def test_numpy_without_a_variant_type(value):
    with pytest.raises(InvalidValue, match=r"a numpy value of dtype .* dimensions cannot be converted to a VARIANT"):
        variant(value)


def test_numpy_integers_that_do_not_fit():
    with pytest.raises(InvalidValue, match="does not fit VT_I4"):
        variant(np.array([2**31]))
    with pytest.raises(InvalidValue, match="does not fit VT_I4"):
        variant(np.uint64(2**63))
    assert Variant(VarType.I8 | ARRAY, np.array([2**62])).value == [2**62]


def test_rows_of_a_numpy_matrix_as_a_list():
    made = variant(list(np.array([[1.0, 2.0], [3.0, 4.0]])))
    assert made.type == VARIANT_ARRAY
    assert made.plain == [[1.0, 2.0], [3.0, 4.0]]
    assert Variant(VARIANT_ARRAY, np.array([[1.0, 2.0], [3.0, 4.0]])) == made


def test_arrays_of_other_libraries_are_refused_with_a_message():
    class Dtype:
        def __repr__(self) -> str:
            return "torch.float32"

    class Tensor:
        dtype = Dtype()
        ndim = 1

        def tolist(self) -> list:
            return [1.0]

    with pytest.raises(InvalidValue, match=r"dtype torch\.float32 with 1 dimensions cannot be converted to a VARIANT"):
        variant(Tensor())
    assert Variant(R8_ARRAY, Tensor()).value == [1.0]


# --- explicit types: whole numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("vt", "bounds"), WHOLE.items(), ids=[vt.name for vt in WHOLE])
def test_whole_numbers_to_their_bounds_and_not_beyond(vt, bounds):
    low, high = bounds
    for value in (low, high, 0, 1):
        assert same(Variant(vt, value).value, value)
        assert list(Variant(vt | ARRAY, [value]).value) == [value]
    for value in (high + 1, -(2**31) - 1 if vt == VarType.ERROR else low - 1, 10**5000):
        with pytest.raises(InvalidValue, match=f"does not fit VT_{vt.name} "):
            Variant(vt, value)
        with pytest.raises(InvalidValue, match=f"does not fit VT_{vt.name} "):
            Variant(vt | ARRAY, [0, value])


def test_only_vt_i4_points_to_the_wider_type():
    with pytest.raises(InvalidValue, match=r"VarType\.I8"):
        Variant(VarType.I4, 2**31)
    with pytest.raises(InvalidValue) as caught:
        Variant(VarType.I2, 2**31)
    assert "I8" not in str(caught.value)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=r"範囲.*VarType\.I8"):
        Variant(VarType.I4, 2**31)


def test_an_error_code_may_be_written_signed():
    assert Variant(VarType.ERROR, -2147467259).value == 0x80004005
    assert Variant(VarType.ERROR, -1).value == 0xFFFFFFFF


@pytest.mark.parametrize("value", [3, True + 2, 3.0, np.int8(3), np.float64(3.0), np.array(3), Axis.Y + 1])
def test_valid_whole_numbers(value):
    assert same(Variant(VarType.I2, value).value, 3)


def test_a_bool_is_one_or_zero():
    assert same(Variant(VarType.I4, True).value, 1)


@pytest.mark.parametrize(
    "value",
    [
        1.5,
        nan,
        inf,
        "1",
        None,
        b"\x01",
        [1],
        np.array([1]),
        np.array([1, 2]),
        np.bool_(True),
        Decimal(1),
        int,
        Grumpy(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_invalid_whole_numbers(value):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_I4"):
        Variant(VarType.I4, value)


# --- explicit types: real numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("vt", [VarType.R4, VarType.R8])
@pytest.mark.parametrize("value", [1, 1.5, Decimal("1.5"), Fraction(3, 2), np.float32(1.5), -0.0, nan, inf, -inf])
def test_real_numbers(vt, value):
    kept = Variant(vt, value).value
    assert type(kept) is float
    assert kept == value or (kept != kept and value != value)
    assert math.copysign(1, kept) == math.copysign(1, value)


@pytest.mark.parametrize("vt", [VarType.R4, VarType.R8, VarType.DATE])
@pytest.mark.parametrize(
    "value",
    [
        True, "1.5", b"1", bytearray(b"1.5"), memoryview(b"1"), None, [1.0], np.array([1.0]), 1j, date(2026, 1, 1),
        10**400, 10**5000, Decimal("1E+400"), Decimal("-1E+999999"), Decimal("sNaN"), Grumpy(),
    ],
    ids=lambda value: f"{type(value).__name__}",
)  # fmt: skip
def test_invalid_real_numbers(vt, value):
    with pytest.raises(InvalidValue, match=f"is not a valid value for VT_{vt.name}"):
        Variant(vt, value)


def test_single_precision_has_its_own_range():
    largest = 3.4028234663852886e38
    assert Variant(VarType.R4, largest).value == largest
    assert Variant(VarType.R4, 1e-60).value == 1e-60
    for value in (3.5e38, -1e39, 1e300):
        with pytest.raises(InvalidValue, match="is not a valid value for VT_R4"):
            Variant(VarType.R4, value)


# --- explicit types: bool, text, nothing ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "kept"),
    [(True, True), (0, False), (-1, True), (2.0, True), (np.bool_(False), False), (np.array(1), True), (Axis.X, True)],
)
def test_valid_bools(value, kept):
    assert same(Variant(VarType.BOOL, value).value, kept)


@pytest.mark.parametrize(
    "value",
    [
        None, "True", "", np.str_("x"), b"", [], [True], (), {}, set(), object(), np.array([True]), np.array([1, 2]),
        Variant(VarType.BOOL, False),
    ],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_invalid_bools(value):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_BOOL"):
        Variant(VarType.BOOL, value)


@pytest.mark.parametrize("value", [None, 1, b"a", ["a"], object()])
def test_invalid_strings(value):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_BSTR"):
        Variant(VarType.BSTR, value)


def test_a_subclass_of_str_becomes_a_plain_str():
    for value in (Colour.RED, Text("red"), np.str_("red")):
        assert same(Variant(VarType.BSTR, value).value, "red")


@pytest.mark.parametrize("vt", [VarType.EMPTY, VarType.NULL])
def test_nothing_has_no_value(vt):
    assert Variant(vt).value is None
    assert Variant(vt, None).value is None
    with pytest.raises(InvalidValue, match=f"0 is not a valid value for VT_{vt.name}"):
        Variant(vt, 0)


# --- explicit types: arrays -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        ([1, 2], [1, 2]),
        ((1, 2), [1, 2]),
        ((i for i in (1, 2)), [1, 2]),
        (range(1, 3), [1, 2]),
        (np.array([1, 2]), [1, 2]),
        (array.array("h", [1, 2]), [1, 2]),
        ([Variant(VarType.I4, 1), 2.0], [1, 2]),
        ({1: "a", 2: "b"}, [1, 2]),
        ([], []),
    ],
)
def test_an_explicit_array_takes_anything_one_by_one(value, kept):
    assert same(Variant(VarType.I2 | ARRAY, value).value, kept)


@pytest.mark.parametrize("value", [5, 2**40, None, "12", b"12", np.array(5), Grumpy()], ids=lambda v: type(v).__name__)
def test_invalid_arrays(value):
    with pytest.raises(InvalidValue, match=r"is not a valid value for VT_I4\|VT_ARRAY"):
        Variant(VarType.I4 | ARRAY, value)


def test_bytes_are_kept_as_bytes():
    for value in (b"\x01\x02", bytearray(b"\x01\x02"), memoryview(b"\x01\x02"), [1, 2], np.array([1, 2], np.uint8)):
        assert same(Variant(VarType.UI1 | ARRAY, value).value, b"\x01\x02")
    with pytest.raises(InvalidValue, match="256 does not fit VT_UI1"):
        Variant(VarType.UI1 | ARRAY, [256])
    with pytest.raises(InvalidValue, match="is not a valid value for"):
        Variant(VarType.UI1 | ARRAY, "ab")


def test_elements_of_a_variant_array_keep_their_types():
    made = Variant(VARIANT_ARRAY, [Variant(VarType.I2, 1), 1, [Variant(VarType.R4, 0.5)], None])
    assert [element.type for element in made.value] == [VarType.I2, VarType.I4, VARIANT_ARRAY, VarType.EMPTY]
    assert made.plain == [1, 1, [0.5], None]


@pytest.mark.parametrize("vt", [-1, 9, 13, 14, 15, 22, 99, 0x4003, ARRAY, VarType.NULL | ARRAY])
def test_invalid_types(vt):
    with pytest.raises(InvalidValue, match="is not a valid type of a value"):
        Variant(vt, None)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="値の型として使えません"):
        Variant(vt, [])


# --- VT_CY ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    ["0", "-0", "0.0001", "-0.0001", "1.5", "1.50000000", "922337203685477.5807", "-922337203685477.5808", "0E+50", "1E+14",
     "0E-99", "123E-2"],
)  # fmt: skip
def test_currency_that_fits(text):
    assert Variant(VarType.CY, Decimal(text)).value == Decimal(text)


def test_currency_from_whole_numbers():
    assert same(Variant(VarType.CY, 5).value, Decimal(5))
    assert same(Variant(VarType.CY, -(10**14)).value, Decimal(-(10**14)))


@pytest.mark.parametrize(
    "value",
    [
        Decimal("0.00001"), Decimal("922337203685477.5808"), Decimal("-922337203685477.5809"), Decimal("1E+15"),
        Decimal("NaN"), Decimal("sNaN"), Decimal("Infinity"), Decimal("-Infinity"), Decimal("1E+999999999"),
        Decimal("1E-999999999"), Decimal("1.00000000000000000000000000001"), Decimal("0." + "0" * 400 + "1"),
        Decimal("9" * 5000), 10**15, 10**5000,
    ],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_currency_that_does_not_fit_is_never_rounded(value):
    with pytest.raises(InvalidValue, match="does not fit VT_CY: at most four decimals"):
        Variant(VarType.CY, value)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="VT_CY に入りません"):
        Variant(VarType.CY, value)


@pytest.mark.parametrize("value", [True, 1.5, "1.5", None, b"1", Fraction(1, 2)])
def test_invalid_currency(value):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_CY"):
        Variant(VarType.CY, value)


def test_the_callers_decimal_context_has_no_effect():
    with localcontext() as context:
        context.prec = 3
        context.rounding = ROUND_DOWN
        context.traps[Inexact] = True
        assert str(Variant(VarType.CY, Decimal("123456.7891")).value) == "123456.7891"
        with pytest.raises(InvalidValue, match="does not fit VT_CY"):
            Variant(VarType.CY, Decimal("0.00001"))
    assert getcontext().prec == 28


@given(st.decimals(allow_nan=True, allow_infinity=True))
def test_any_decimal_fits_exactly_or_is_refused(value):
    try:
        kept = Variant(VarType.CY, value).value
    except InvalidValue:
        if value.is_finite():
            units = Fraction(value) * 10000
            assert units.denominator != 1 or not -(2**63) <= units < 2**63
    else:
        assert kept == value


# --- VT_DATE ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("moment", "days"),
    [
        (datetime(1899, 12, 30), 0.0),
        (datetime(1899, 12, 31), 1.0),
        (datetime(1900, 1, 1), 2.0),
        (datetime(1970, 1, 1), 25569.0),
        (datetime(2000, 1, 1, 12), 36526.5),
        (datetime(1899, 12, 30, 6), 0.25),
        (datetime(1899, 12, 29), -1.0),
        (datetime(1899, 12, 29, 6), -1.25),
        (datetime(1899, 12, 28, 18), -2.75),
        (datetime(1, 1, 1), -693593.0),
        (datetime(9999, 12, 31), 2958465.0),
    ],
)
def test_ole_days_both_ways(moment, days):
    """Before day 0 the integer part is negative, and the fraction is still the time of day."""
    assert ole_days(moment) == days
    assert ole_datetime(days) == moment


def test_the_day_before_the_first_has_two_spellings_of_noon():
    assert ole_datetime(-0.5) == ole_datetime(0.5) == datetime(1899, 12, 30, 12)
    assert lossless_datetime(0.5) == datetime(1899, 12, 30, 12)
    assert same(lossless_datetime(-0.5), -0.5)
    assert same(lossless_datetime(-0.0), -0.0)
    assert lossless_datetime(0.0) == datetime(1899, 12, 30)


@given(st.datetimes(datetime(1721, 1, 1), datetime(2079, 6, 5)))
@example(datetime(1899, 12, 29, 23, 59, 59, 999999))
@example(datetime(2026, 11, 21, 23, 59, 59, 999999))
def test_a_microsecond_survives_until_2079(moment):
    """A double has 53 bits: up to 65536 days the resolution is better than a microsecond."""
    assert ole_datetime(ole_days(moment)) == moment


@given(st.datetimes())
def test_any_datetime_survives_to_40_microseconds(moment):
    try:
        again = ole_datetime(ole_days(moment))
    except OverflowError:
        assert moment > datetime(9999, 12, 31, 23, 59, 59, 999900)
    else:
        assert abs(again - moment) <= timedelta(microseconds=40)


def test_rounding_is_to_the_nearest_microsecond():
    moment = datetime(2026, 11, 21, 10, 0, 0, 500000)
    step = 1 / 86_400_000_000
    assert ole_datetime(ole_days(moment) + 0.4 * step) - moment <= timedelta(microseconds=1)
    assert ole_datetime(-1.9999999999999) == datetime(1899, 12, 30)
    assert ole_datetime(1.9999999999999) == datetime(1900, 1, 1)


@pytest.mark.parametrize("days", [inf, -inf, nan, 1e308, -1e308, 2958466.0, -693594.0, 5e9])
def test_days_outside_the_range_of_datetime(days):
    with pytest.raises(OverflowError):
        ole_datetime(days)
    assert same(to_datetime(days), days)
    assert same(lossless_datetime(days), days)
    assert same(Variant(VarType.DATE, days).plain, days)


@given(st.floats())
def test_any_days_give_a_datetime_or_stay_days(days):
    moment = lossless_datetime(days)
    if isinstance(moment, datetime):
        assert same(ole_days(moment), days)
    else:
        assert same(moment, days)


def test_plain_returns_datetimes_within_their_range():
    assert Variant(VarType.DATE, 36526.5).plain == datetime(2000, 1, 1, 12)
    assert Variant(VarType.DATE | ARRAY, [36526.5, inf, MOMENT]).plain == [datetime(2000, 1, 1, 12), inf, MOMENT]
    assert Variant(VARIANT_ARRAY, [Variant(VarType.DATE, 1.0)]).plain == [datetime(1899, 12, 31)]


@pytest.fixture
def tokyo(monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("tokyo")
def test_an_aware_datetime_is_converted_to_local_time():
    assert same(variant(datetime(2026, 1, 1, 0, 0, tzinfo=UTC)).value, datetime(2026, 1, 1, 9, 0))
    assert variant([datetime(2026, 1, 1, 0, 0, tzinfo=UTC)]).value[0].tzinfo is None


@pytest.mark.usefixtures("tokyo")
@pytest.mark.parametrize(
    "moment",
    [
        datetime.max.replace(tzinfo=UTC),
        datetime.max.replace(tzinfo=timezone(timedelta(hours=-12))),
        datetime.min.replace(tzinfo=timezone(timedelta(hours=12))),
    ],
)
def test_an_aware_datetime_that_is_outside_the_calendar_in_local_time(moment):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_DATE"):
        variant(moment)


def test_a_naive_datetime_at_either_end():
    for moment in (datetime(1, 1, 1), datetime(9999, 12, 31, 23, 59, 59, 999999)):
        assert variant(moment).plain == moment


# --- the object itself ------------------------------------------------------------------------------------------------


def test_equality_repr_and_immutability():
    one = Variant(VarType.I2, 1)
    assert one == Variant(2, 1)
    assert one != Variant(VarType.I4, 1)
    assert one != 1
    assert repr(one) == "Variant(VT_I2, 1)"
    assert repr(variant([1.0])) == "Variant(VT_R8|VT_ARRAY, [1.0])"
    assert repr(variant([1, "a"])) == "Variant(VT_VARIANT|VT_ARRAY, [Variant(VT_I4, 1), Variant(VT_BSTR, 'a')])"
    assert hash(one) == hash(Variant(VarType.I2, 1))
    with pytest.raises(AttributeError):
        one.value = 2


def test_plain_of_anything():
    assert plain(Variant(VarType.I2, 1)) == 1
    assert plain("P1") == "P1"


@given(variants())
def test_pickle_copy_and_a_second_construction_keep_everything(item):
    assert same(pickle.loads(pickle.dumps(item)), item)
    assert same(copy.deepcopy(item), item)
    assert same(Variant(item.type, item.value), item)


SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**31), 2**31 - 1),
    st.floats(),
    st.text(),
    st.binary(),
    st.datetimes(),
    st.integers(-(2**63), 2**63 - 1).map(lambda units: Decimal(units).scaleb(-4)),
)


@given(st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=5), max_leaves=20))
def test_every_python_value_is_given_back(value):
    assert same(variant(value).plain, value)


ANYTHING = st.one_of(
    SCALARS, st.integers(), st.decimals(), st.fractions(), st.complex_numbers(), st.dates(), st.timedeltas(), st.times(),
    st.datetimes(timezones=st.timezones()), st.sets(st.integers()), st.dictionaries(st.text(), st.integers()),
    st.builds(object), st.just(int), st.just(np.float64), st.builds(contains_itself),
    st.sampled_from([np.zeros((2, 2)), np.array(1), np.array([1.0]), np.datetime64("NaT"), np.array([None])]),
)  # fmt: skip


@given(st.recursive(ANYTHING, lambda inner: st.lists(inner) | st.tuples(inner, inner), max_leaves=8))
def test_anything_becomes_a_variant_or_an_invalid_value(value):
    try:
        made: object = variant(value)
    except InvalidValue as error:
        made = str(error)
    assert made
    assert isinstance(made, Variant | str)


@given(st.sampled_from([*VarType, *(vt | ARRAY for vt in VarType)]), ANYTHING)
def test_anything_with_an_explicit_type_becomes_a_variant_or_an_invalid_value(vt, value):
    try:
        made = Variant(vt, value)
    except InvalidValue:
        return
    assert same(Variant(vt, made.value), made)


def test_values_of_vt_variant_are_unwrapped():
    inner = Variant(VarType.VARIANT, Variant(VarType.VARIANT, variant(1)))
    assert same(unwrapped(inner), variant(1))
    assert same(
        unwrapped(Variant(VARIANT_ARRAY, [inner, variant("x"), [inner]])),
        Variant(VARIANT_ARRAY, [1, "x", Variant(VARIANT_ARRAY, [1])]),
    )
    for unchanged in (variant([1.5, 2.5]), variant([1, "x"]), variant("x")):
        assert unwrapped(unchanged) is unchanged
