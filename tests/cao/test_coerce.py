"""Arguments in all forms that real clients send, and return codes for invalid ones."""

from __future__ import annotations

from datetime import datetime
from decimal import Decimal
from math import inf, nan

import pytest
from hypothesis import given

from orinkit.cao.coerce import to_handle, to_integer, to_number, to_real, to_text, to_values, unwrap_single, wrong_type
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, InvalidArgument, PacketError
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant
from support.strategies import same, variants

pytestmark = pytest.mark.core

WHOLE = [VarType.I1, VarType.I2, VarType.I4, VarType.I8, VarType.UI1, VarType.UI2, VarType.UI4, VarType.UI8]
READERS = [to_number, to_integer, to_real, to_handle, to_text]
NO_NUMBER = [
    Variant(VarType.EMPTY), Variant(VarType.NULL), variant("P1"), variant(""), variant("1,2"), variant("0x10"),
    variant("+-5"), variant(datetime(2026, 1, 1)), Variant(VarType.DATE, 1.0), variant("５"), variant("1_0"), variant([1, 2]),
    variant([]), variant([1.0, 2.0]), variant(b"ab"), variant(b""), variant([[1]]), variant(["x"]), variant([None]),
]  # fmt: skip


def bstr(text: str) -> Variant:
    return Variant(VarType.BSTR, text)


def refused(read, given: Variant, code: int, match: str) -> CallError:
    with pytest.raises(CallError, match=match) as caught:
        read(given)
    assert caught.value.code == code
    return caught.value


# --- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vt", [*WHOLE, VarType.R4, VarType.R8])
def test_a_number_of_any_type_alone_or_in_an_array(vt):
    for number in (Variant(vt, 5), Variant(vt | ARRAY, [5]), Variant(VARIANT_ARRAY, [Variant(vt, 5)])):
        assert same(to_integer(number), 5)
        assert same(to_real(number), 5.0)
        assert to_number(number) == 5


@pytest.mark.parametrize(
    ("given", "number"),
    [
        (variant(True), -1),
        (variant(False), 0),
        (variant([True]), -1),
        (bstr("5"), 5),
        (bstr(" 5 "), 5),
        (bstr("-5"), -5),
        (bstr("+5"), 5),
        (bstr("1.5"), 1.5),
        (bstr("1e3"), 1000.0),
        (Variant(VarType.CY, Decimal(2)), 2),
        (Variant(VarType.CY, Decimal("2.5")), 2.5),
        (variant(["7"]), 7),
        (variant([[7]]), None),
        (Variant(VarType.ERROR, 5), 5),
        (Variant(VarType.I8, 2**40), 2**40),
    ],
)
def test_numbers(given, number):
    if number is None:
        refused(to_number, given, hresult.E_INVALIDARGTYPE, "expected a number")
    else:
        assert same(to_number(given), number)


@pytest.mark.parametrize("read", [to_number, to_integer, to_real])
@pytest.mark.parametrize("given", NO_NUMBER, ids=repr)
def test_invalid_numbers(read, given):
    error = refused(read, given, hresult.E_INVALIDARGTYPE, "expected ")
    assert isinstance(error, PacketError)
    i18n.use("ja")
    refused(read, given, hresult.E_INVALIDARGTYPE, "数値.*が必要ですが VT_")


def test_the_message_shows_an_invalid_number():
    refused(to_integer, bstr("P1"), hresult.E_INVALIDARGTYPE, "got VT_BSTR, expected a number, not 'P1'")
    assert len(str(refused(to_integer, bstr("x" * 100_000), hresult.E_INVALIDARGTYPE, "not 'xxx"))) < 300


@pytest.mark.parametrize(
    ("given", "match"),
    [
        (variant(1.5), "1.5 is not a whole number"),
        (variant(nan), "nan is not a whole number"),
        (variant(inf), "inf is not a whole number"),
        (variant(-inf), "-inf is not a whole number"),
        (bstr("nan"), "nan is not a whole number"),
        (bstr("1e999"), "inf is not a whole number"),
        (bstr("0.1"), "0.1 is not a whole number"),
        (variant(2.0**31), "2147483648.0 is out of range"),
        (variant(1e300), r"1e\+300 is out of range"),
        (Variant(VarType.UI4, 2**31), "2147483648 is out of range"),
        (Variant(VarType.I8, -(2**31) - 1), "-2147483649 is out of range"),
        (bstr("9" * 400), "9999 is out of range"),
    ],
)
def test_invalid_values_of_vt_i4(given, match):
    assert isinstance(refused(to_integer, given, hresult.E_INVALIDARG, match), InvalidArgument)
    i18n.use("ja")
    refused(to_integer, given, hresult.E_INVALIDARG, "整数ではありません|範囲外です")


def test_the_range_of_vt_i4():
    for number in (-(2**31), 2**31 - 1):
        assert same(to_integer(variant(float(number))), number)
        assert same(to_integer(bstr(str(number))), number)


def test_a_number_of_thousands_of_digits():
    refused(to_integer, bstr("9" * 4000), hresult.E_INVALIDARG, "is out of range")
    refused(to_integer, bstr("9" * 5000), hresult.E_INVALIDARGTYPE, "a number, not '9999")


@pytest.mark.parametrize(
    "given", [variant(nan), variant(inf), variant(-inf), bstr("nan"), bstr("inf"), bstr("9" * 400)]
)
def test_invalid_real_numbers(given):
    refused(to_real, given, hresult.E_INVALIDARG, "is not a finite number")
    i18n.use("ja")
    refused(to_real, given, hresult.E_INVALIDARG, "は有限の数値ではありません")


# --- handles and texts ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vt", [VarType.I4, VarType.UI4, VarType.I2, VarType.UI2])
def test_handles_of_integer_types(vt):
    assert same(to_handle(Variant(vt, 2)), 2)


@pytest.mark.parametrize(
    "given", [variant("2"), variant(2.0), variant(True), variant(None), variant([2]), variant(b"2")]
)
def test_invalid_handles(given):
    refused(to_handle, given, hresult.E_INVALIDARGTYPE, ", expected VT_I4")


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (variant("P1"), "P1"),
        (variant(["P1"]), "P1"),
        (Variant(VARIANT_ARRAY, ["P1"]), "P1"),
        (variant(None), ""),
        (Variant(VarType.NULL), ""),
        (variant([None]), ""),
        (variant(""), ""),
    ],
)
def test_texts(given, text):
    assert same(to_text(given), text)


@pytest.mark.parametrize("given", [variant(1), variant(["a", "b"]), variant([]), variant(b"a"), variant([["a"]])])
def test_invalid_texts(given):
    refused(to_text, given, hresult.E_INVALIDARGTYPE, "expected VT_BSTR")


# --- arrays -----------------------------------------------------------------------------------------------------------


def test_single():
    assert same(unwrap_single(variant([1.5])), variant(1.5))
    assert same(unwrap_single(variant(b"\5")), Variant(VarType.UI1, 5))
    assert same(unwrap_single(Variant(VARIANT_ARRAY, [Variant(VarType.I2, 1)])), Variant(VarType.I2, 1))
    for other in (variant([1, 2]), variant([]), variant(5), variant(None)):
        assert unwrap_single(other) is other


@pytest.mark.parametrize(
    ("given", "values"),
    [
        (variant(None), []),
        (Variant(VarType.NULL), []),
        (variant([]), []),
        (variant(1), [1]),
        (variant("ab"), ["ab"]),
        (variant([1.0, 2.0]), [1.0, 2.0]),
        (variant([1, [2.0], None]), [1, [2.0], None]),
        (variant(b"\1\2"), [1, 2]),
        (Variant(VarType.DATE | ARRAY, [1.0]), [datetime(1899, 12, 31)]),
    ],
)
def test_values(given, values):
    assert same(to_values(given), values)


def test_the_error_of_a_wrong_type_names_both():
    assert wrong_type(variant([1.0]), "VT_BSTR").detail == "got VT_R8|VT_ARRAY, expected VT_BSTR"


@given(variants())
def test_any_variant_is_converted_or_refused_with_a_code(item):
    codes = set()
    for read in READERS:
        try:
            read(item)
        except CallError as error:
            codes.add(error.code)
    assert codes <= {hresult.E_INVALIDARG, hresult.E_INVALIDARGTYPE}
    assert isinstance(to_values(item), list)


def test_a_long_text_that_is_nearly_a_number_is_refused_quickly():
    """A pattern that tried all ways to split the digits would take hours for this text."""
    refused(to_number, bstr("9" * 200_000 + "x"), hresult.E_INVALIDARGTYPE, "number")
