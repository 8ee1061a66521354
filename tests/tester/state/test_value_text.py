"""Values as text with a type."""

from __future__ import annotations

import pytest

from orinkit.core.errors import InvalidValue, NotationError
from orinkit.tester.state.value_text import LONGEST_TEXT, TYPES, describe, read_value, value_text
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType

R8S = VarType.R8 | ARRAY
POSE = [Variant(R8S, [0, 0, 0, 0, 0, 0, 5]), Variant(VarType.I4, 0), Variant(VarType.I4, -2)]


@pytest.mark.parametrize(
    ("vt", "text", "value", "description"),
    [
        (VarType.EMPTY, "", Variant(VarType.EMPTY), "VT_EMPTY"),
        (VarType.I4, "513", Variant(VarType.I4, 513), "VT_I4"),
        (VarType.BSTR, "@E P(1,2,3)", Variant(VarType.BSTR, "@E P(1,2,3)"), "VT_BSTR, 11 characters"),
        (VarType.BSTR, "", Variant(VarType.BSTR, ""), "VT_BSTR, 0 characters"),
        (R8S, "1,2.5,1E-14", Variant(R8S, [1, 2.5, 1e-14]), "VT_R8|VT_ARRAY, 3 elements"),
        (VARIANT_ARRAY, "(8197, 0, 0, 0, 0, 0, 0, 5),(3, 0),(3, -2)", Variant(VARIANT_ARRAY, POSE), "VT_VARIANT|VT_ARRAY, 3 elements"),
        (VARIANT_ARRAY, "8204,(3,1)", Variant(VARIANT_ARRAY, [1]), "VT_VARIANT|VT_ARRAY, 1 element"),
        (VARIANT_ARRAY, "", Variant(VARIANT_ARRAY, []), "VT_VARIANT|VT_ARRAY, 0 elements"),
        (VarType.VARIANT, "8194,100,200", Variant(VarType.I2 | ARRAY, [100, 200]), "VT_I2|VT_ARRAY, 2 elements"),
        (VarType.VARIANT, "(3,1),(8,x)", Variant(VARIANT_ARRAY, [1, "x"]), "VT_VARIANT|VT_ARRAY, 2 elements"),
    ],
)  # fmt: skip
def test_a_text_is_read_by_its_type(vt, text, value, description):
    assert read_value(vt, text) == value
    assert describe(value) == description


@pytest.mark.parametrize(
    ("vt", "text", "problem"),
    [
        (VarType.I2, "40000", "column 1: expected a whole number from -32768 to 32767"),
        (VarType.I4, "", "the text ends here"),
        (R8S, "1,x", "column 3: "),
        (R8S, " ", "the array is empty"),
        (VARIANT_ARRAY, "3,5", "is a value of type VT_I4, not VT_VARIANT|VT_ARRAY"),
        (VARIANT_ARRAY, "(3,5", 'expected ")"'),
        (VarType.EMPTY, "x", "expected the end"),
        (VarType.BSTR, "x" * (LONGEST_TEXT + 1), "more than 100000"),
    ],
)
def test_an_invalid_text_is_refused_with_its_place(vt, text, problem):
    with pytest.raises((NotationError, InvalidValue)) as caught:
        read_value(vt, text)
    assert problem in f"{caught.value}"


def test_all_types_can_be_chosen_by_the_names_of_the_manufacturers_tester():
    assert {"EMPTY", "I2", "I4", "R4", "R8", "BSTR", "BOOL", "ARRAY | R8", "ARRAY | VARIANT"} <= set(TYPES.values())
    assert len(set(TYPES.values())) == len(TYPES)


@pytest.mark.parametrize(
    "value",
    [Variant(R8S, [1.5, -2]), Variant(VarType.BOOL, True), Variant(VARIANT_ARRAY, POSE), Variant(VarType.BSTR, "a,b")],
)
def test_a_displayed_value_can_be_entered_again(value):
    assert read_value(value.type, value_text(value)) == value


def test_values_without_data_are_named_and_long_ones_are_cut():
    assert value_text(Variant(VarType.EMPTY)) == "(EMPTY)"
    assert value_text(Variant(VarType.NULL)) == "(NULL)"
    assert value_text(Variant(VarType.BSTR, "x" * 10_000)).endswith("x…")
    long = value_text(Variant(VarType.I4 | ARRAY, range(1000)))
    assert long.startswith("0,1,2")
    assert long.endswith(",399,…")
