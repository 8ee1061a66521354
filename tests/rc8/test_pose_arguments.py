"""Pose arguments: the forms of the documents, of real clients, and invalid ones."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.rc8.pose_arguments import MAX_TARGETS, Parts, line_type_as_position, read_parts, read_targets
from orinkit.values.notation import parse_elements
from orinkit.values.pose_text import MAX_LENGTH
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PASSING, Extra, J, P, PassMark, T, Target, V
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant
from support.strategies import same, variants

pytestmark = pytest.mark.core

I4, R4, R8, BSTR = VarType.I4, VarType.R4, VarType.R8, VarType.BSTR
POSE = (190.0, -22.0, 180.0, 145.0, 0.0, 0.0, 261.0)
JOINTS = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0)
TRANS = (364.0, 0.0, 278.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 5.0)


def form(*parts):
    return Variant(VARIANT_ARRAY, list(parts))


def r4(*numbers):
    return Variant(R4 | ARRAY, numbers)


@pytest.mark.parametrize(
    ("argument", "targets"),
    [
        # string
        ("P1", [Target("P", 1)]),
        ("@E P1", [Target("P", 1, AT_ENCODER)]),
        ("P1,@E P2", [Target("P", 1), Target("P", 2, AT_ENCODER)]),
        (["P1", "@E P2"], [Target("P", 1), Target("P", 2, AT_ENCODER)]),
        (form("P1", "J2,J3"), [Target("P", 1), Target("J", 2), Target("J", 3)]),
        ("@E (1, 2, 3, 4, 5, 6)", [Target("P", (1, 2, 3, 4, 5, 6), AT_ENCODER)]),
        ("(1, 2, 3, 4, 5, 6, 5)", [Target("", (1, 2, 3, 4, 5, 6, 5))]),
        # as written in Python by real clients
        ([list(POSE), "P", "@E"], [Target("P", POSE, AT_ENCODER)]),
        ([[190, -40.0, 230.0, 168, 0, 0], "P", "@E"], [Target("P", (190, -40, 230, 168, 0, 0), AT_ENCODER)]),
        ([2, "P", "@0"], [Target("P", 2, AT_COMMAND)]),
        ([1, 0, -1], [Target("P", 1, PASSING)]),
        ([P(*POSE), "P", "@P"], [Target("P", POSE, PASSING)]),
        ([J(*JOINTS), "j", " @p "], [Target("J", JOINTS, PASSING)]),
        # as sent by DENSO's ROS driver
        (form(r4(*JOINTS), Variant(I4, 2), Variant(I4, -2)), [Target("J", JOINTS, AT_ENCODER)]),
        (
            form(r4(*POSE), 0, -1, form(1, form(7, Variant(R4, 30.5)), form(8, Variant(R4, -1)))),
            [Target("P", POSE, PASSING, Extra(absolute=False, joints=((7, 30.5), (8, -1))))],
        ),
        # the parts of a target
        (form(3), [Target("P", 3)]),
        ([3], [Target("P", 3)]),
        (form(3, 1), [Target("T", 3)]),
        (form(Variant(R4, 3)), [Target("P", 3)]),
        (form(3, -1, -2), [Target("P", 3, AT_ENCODER)]),
        (form(3, "", ""), [Target("P", 3)]),
        (form(Variant(VarType.UI1, 3), Variant(VarType.I2, 2), Variant(R4, 0)), [Target("J", 3, AT_COMMAND)]),
        (form(5.0, "V"), [Target("V", 5)]),
        (form(Decimal(5), "V"), [Target("V", 5)]),
        (form(3, None, None, None), [Target("P", 3)]),
        (form(3, Variant(VarType.NULL), "", None), [Target("P", 3)]),
        (form(3, "", 10), [Target("P", 3, PassMark("n", 10))]),
        (form(3, "T", 2.5), [Target("T", 3, PassMark("n", 2.5))]),
        (form(3, "T", "@2.5"), [Target("T", 3, PassMark("n", 2.5))]),
        (form(r4(1, 2, 3, 4, 5, 6), "J"), [Target("J", (1, 2, 3, 4, 5, 6))]),
        (form(r4(1, 2), -1, 0), [Target("", (1, 2), AT_COMMAND)]),
        (form(Variant(I4 | ARRAY, [1, 2]), "J"), [Target("J", (1, 2))]),
        (form(Variant(VarType.CY | ARRAY, [Decimal("1.5"), 2]), "J"), [Target("J", (1.5, 2))]),
        (form(b"\1\2", "J"), [Target("J", (1, 2))]),
        (form(form(1, Decimal("1.5"), Variant(VarType.UI8, 3)), "V"), [Target("V", (1, 1.5, 3))]),
        (form(3, "P", "@E", form(2, r4(7, 1))), [Target("P", 3, AT_ENCODER, Extra(absolute=True, joints=((7, 1),)))]),
        (form(3, "P", "@E", form("exa", r4(8, 1))), [Target("P", 3, AT_ENCODER, Extra(absolute=True, joints=((8, 1),)))]),
        (form(3, "P", "@E", form("EX", [7, 1])), [Target("P", 3, AT_ENCODER, Extra(absolute=False, joints=((7, 1),)))]),
        (form(3, "P", "@E", form(0, [7, 1])), [Target("P", 3, AT_ENCODER)]),
        (form(3, "P", "@E", [0]), [Target("P", 3, AT_ENCODER)]),
        (form(3, "P", "@E", 0), [Target("P", 3, AT_ENCODER)]),
        (form(3, "P", "@E", ""), [Target("P", 3, AT_ENCODER)]),
        (form(r4(*POSE), "@E", "P"), [Target("P", POSE, AT_ENCODER)]),
        (form(3, "@E", "T"), [Target("T", 3, AT_ENCODER)]),
        (form(3, "@P"), [Target("P", 3, PASSING)]),
        (form(Variant(R4, 3.0), 2, -1), [Target("J", 3, PASSING)]),
        # without a type: a VT_R4 array is a position, otherwise by count
        (form(r4(*POSE), None, "@E"), [Target("P", POSE, AT_ENCODER)]),
        (form(r4(*JOINTS), "", "@E"), [Target("P", JOINTS[:7], AT_ENCODER)]),
        (r4(*POSE), [Target("P", POSE)]),
        (r4(*POSE[:6]), [Target("P", POSE[:6])]),
        (r4(*JOINTS), [Target("P", JOINTS[:7])]),
        (form(r4(*TRANS)), [Target("T", TRANS)]),
        (Variant(R8 | ARRAY, POSE), [Target("P", POSE)]),
        (Variant(R8 | ARRAY, POSE[:6]), [Target("", POSE[:6])]),
        (Variant(R8 | ARRAY, JOINTS), [Target("J", JOINTS)]),
        (Variant(R8 | ARRAY, TRANS), [Target("T", TRANS)]),
        (Variant(R8 | ARRAY, TRANS[:9]), [Target("T", TRANS[:9])]),
        (V(1, 2, 3), [Target("V", (1, 2, 3))]),
        (T(*TRANS), [Target("T", TRANS)]),
        ([1, 2, 3, 4, 5, 6], [Target("", (1, 2, 3, 4, 5, 6))]),
        ([1.5, 2, 3], [Target("V", (1.5, 2, 3))]),
        ([190, -40.0, 230.0, 168, 0, 0], [Target("", (190, -40, 230, 168, 0, 0))]),
        # several targets
        ([list(POSE), list(JOINTS)], [Target("P", POSE), Target("J", JOINTS)]),
        ([list(POSE), "@E P2"], [Target("P", POSE), Target("P", 2, AT_ENCODER)]),
        ([[1, "P", "@P"], [2, "P", "@E"]], [Target("P", 1, PASSING), Target("P", 2, AT_ENCODER)]),
        ([[1, 0, -1], [2, 0, -2]], [Target("P", 1, PASSING), Target("P", 2, AT_ENCODER)]),
        ([[list(POSE), "P"], "P2", list(JOINTS)], [Target("P", POSE), Target("P", 2), Target("J", JOINTS)]),
        ([[list(POSE), "P"]], [Target("P", POSE)]),
        ([[list(POSE)]], [Target("P", POSE)]),
        (["P1"] * MAX_TARGETS, [Target("P", 1)] * MAX_TARGETS),
    ],
)  # fmt: skip
def test_forms(argument, targets):
    assert read_targets(variant(argument)) == tuple(targets)


def test_the_tester_s_text():
    """RC8 5.3 prints the elements of a pose like this."""
    elements = parse_elements("(8197, 0, 0, 0, 0, 0, 0, 5), (3, 0), (3, -2)")
    assert read_targets(form(*elements)) == (Target("P", (0, 0, 0, 0, 0, 0, 5), AT_ENCODER),)


BAD, TYPE = hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH
MISMATCH = "expected a pose (VT_BSTR, an array of numbers or a VARIANT array)"


@pytest.mark.parametrize(
    ("argument", "code", "detail"),
    [
        (None, TYPE, f"got VT_EMPTY, {MISMATCH}"),
        (1, TYPE, f"got VT_I4, {MISMATCH}"),
        ([True, False], TYPE, f"got VT_BOOL|VT_ARRAY, {MISMATCH}"),
        (form(True, "P"), TYPE, f"got VT_BOOL, {MISMATCH}"),
        (form(None, "P"), TYPE, f"got VT_EMPTY, {MISMATCH}"),
        (form(["1", "2"], "P"), TYPE, f"got VT_BSTR|VT_ARRAY, {MISMATCH}"),
        (form(form("1", 2.0), "P"), TYPE, "got VT_BSTR, expected a number in a pose"),
        (form(form([1, 2], [3, 4]), "P"), TYPE, "got VT_I4|VT_ARRAY, expected a number in a pose"),
        (form(1, [1, 2]), TYPE, "got VT_I4|VT_ARRAY, expected a pose type"),
        (form(1, "P", True), TYPE, "got VT_BOOL, expected a pass mark"),
        (form(1, "P", "@E", "EX((7,1))"), TYPE, f"got VT_BSTR, {MISMATCH}"),
        (form(1, "P", "@E", form(None, [7, 1])), BAD, "mode '' with 1 extended joints is not valid"),
        (form(1, "P", "@E", form([7, 1])), TYPE, "got VT_I4|VT_ARRAY, expected the mode of extended joints"),
        (form(1, "P", "@E", form(1, 7, 30.5)), TYPE, f"got VT_I4, {MISMATCH}"),
        (["P1", "P"], BAD, "pose 2: column 2: expected the number of a variable P"),
        ("", BAD, "column 1: expected a pose like P1"),
        ("P1" + " " * 4095, BAD, "column 4097: the text is longer than 4096 characters"),
        ("P" * 1_000_000, BAD, "column 4097: the text is longer than 4096 characters"),
        ([], BAD, "an empty array is not a pose"),
        (Variant(BSTR | ARRAY, []), BAD, "the array contains no pose"),
        (Variant(R8 | ARRAY, []), BAD, "an empty array is not a pose"),
        (form([]), BAD, "pose 1: an empty array is not a pose"),
        ([1.0, 2.0], BAD, "the pose type of 2 numbers is unknown; expected 7 (P), 8 (J), 9 or 10 (T) or 3 (V)"),
        ([1, 2, 3, 4, 5], BAD, "the pose type of 5 numbers is unknown"),
        ([1.0] * 100_000, BAD, "more than 10 numbers"),
        (form(*[1.0] * 50, 2), BAD, "more than 10 numbers"),
        (form(form(*[1.0] * 50, 2), "P"), BAD, "more than 10 numbers"),
        (form([1.0] * 11, "J"), BAD, "more than 10 numbers"),
        (form([1.0] * 9, "J"), BAD, "J: got more than 8 values, expected 1 to 8"),
        (form([1.0] * 5, "P"), BAD, "P: got 5 values, expected 6 or 7"),
        (form([*POSE[:6], 5.5], "P"), BAD, "P: fig must be a whole number of 32 bits, not 5.5"),
        (form([math.nan] * 6, "P"), BAD, "P: x must be a finite number, not nan"),
        (Variant(R8 | ARRAY, [0, math.inf, 0, 0, 0, 0, 0]), BAD, "P: y must be a finite number, not inf"),
        (form(-1, "P"), BAD, "invalid variable of kind 'P' and number -1"),
        (form(1.5, "P"), BAD, "1.5 is not a whole number"),
        (form(math.nan, "P"), BAD, "nan is not a whole number"),
        (form(Variant(VarType.UI8, 2**64 - 1), "P"), BAD, "18446744073709551615 is out of range"),
        (form(1, 4), BAD, "4 is not a pose type"),
        (form(1, "X"), BAD, "'X' is not a pose type"),
        (form(1, "P2"), BAD, "'P2' is not a pose type"),
        (form(1, "x" * 1000), BAD, "'XXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXXX…' is not a pose type"),
        (form(1, 0.5), BAD, "0.5 is not a whole number"),
        (form(1, "P", -3), BAD, "-3 is not a pass mark. Try: -1 (@P)"),
        (form(1, "P", -1.5), BAD, "-1.5 is not a pass mark"),
        (form(1, "P", math.inf), BAD, "inf is not a finite number"),
        (form(1, "P", "E"), BAD, 'column 1: expected a pass mark ("@P", "@E", "@0", or "@10" for 10 mm), found \'E\''),
        (form(1, "P", "@E", []), BAD, "mode '' with 0 extended joints is not valid"),
        (form(1, "P", "@E", [3, 3]), BAD, "mode 3 with 1 extended joints is not valid"),
        (form(1, "P", "@E", form("EXB", [7, 1])), BAD, "mode 'EXB' with 1 extended joints is not valid"),
        (form(1, "P", "@E", form(1, *[[7, 1]] * 100)), BAD, "mode 1 with 100 extended joints is not valid"),
        (form(1, "P", "@E", [1]), BAD, "the extended joints must be 7, 8 or both, not []"),
        (form(1, "P", "@E", form(1, [6, 1])), BAD, "the extended joints must be 7, 8 or both, not [6]"),
        (form(1, "P", "@E", form(1, [7, 1], [7, 2])), BAD, "the extended joints must be 7, 8 or both, not [7, 7]"),
        (form(1, "P", "@E", form(1, [7, 1, 2])), BAD, "expected an extended joint as [number, value], for example [7, 30.5]"),
        (form(1, "P", "@E", form(1, [7.5, 1.0])), BAD, "expected an extended joint as [number, value]"),
        (form(1, "P", "@E", form(1, [7.0, math.nan])), BAD, "Extra: J7 must be a finite number, not nan"),
        (form(1, "P", "@E", None, None), BAD, "pose of 5 elements; expected at most 4"),
        (["P1"] * (MAX_TARGETS + 1), BAD, "more than 16 poses"),
        ([[1, "P"]] * 20_000, BAD, "more than 16 poses"),
        (",".join(["P1"] * (MAX_TARGETS + 1)), BAD, "more than 16 poses"),
        ([[list(POSE), "P"], 5], BAD, "5 is not a pose type"),
        ([[list(POSE), "P"], None], TYPE, "got VT_R8|VT_ARRAY, expected a number in a pose"),
        (["P1", 2], TYPE, f"pose 2: got VT_I4, {MISMATCH}"),
        ([list(POSE), [1.5]], BAD, "pose 2: the pose type of 1 numbers is unknown"),
        ([[[list(POSE), "P"]]], TYPE, "pose 1: got VT_R8|VT_ARRAY, expected a number in a pose"),
    ],
)  # fmt: skip
def test_invalid_poses(argument, code, detail):
    with pytest.raises(CallError) as caught:
        read_targets(variant(argument))
    assert caught.value.code == code
    assert detail in caught.value.detail


def test_the_pose_type_l_of_some_clients_is_a_position():
    """An array of targets has two levels of arrays; deeper ones, and texts within values, are unchanged."""
    target = variant([list(POSE), "L", "@E"])
    with pytest.raises(CallError, match="not a pose type"):
        read_targets(target)
    for pose in (target, variant([list(POSE), "l", "@E"])):
        assert read_targets(line_type_as_position(pose)) == (Target("P", POSE, AT_ENCODER),)
    several = variant([[list(POSE), "L"], [list(JOINTS), "J"]])
    assert read_targets(line_type_as_position(several)) == (Target("P", POSE), Target("J", JOINTS))


@pytest.mark.parametrize(
    "given",
    [
        variant("P1"), variant("LL"), variant(5), variant(list(POSE)), variant([list(POSE), "P"]), variant([[[["L"]]]]),
        variant([["L"]] * (MAX_TARGETS + 1)),
    ],
)  # fmt: skip
def test_all_else_than_the_pose_type_l_is_unchanged(given):
    assert same(line_type_as_position(given), given)


def test_the_parts_of_a_length_are_those_of_a_target():
    """Robot_Rotate and the commands Approach and Depart have a length or an angle in this form."""
    found = read_parts([variant(5.0), variant("P"), variant("@P")])
    assert found == Parts(variant(5.0), "P", PASSING, None)
    assert read_parts([variant(5.0), variant("@P")]) == Parts(variant(5.0), None, PASSING, None)
    assert read_parts([variant(5.0)]) == Parts(variant(5.0), None, None, None)


@pytest.mark.parametrize(
    ("parts", "code", "detail"),
    [
        ([], BAD, "pose of 0 elements; expected at most 4"),
        ([5, 9], BAD, "9 is not a pose type"),
        ([5, "", "@X"], BAD, "column 2: expected P, E, C, 0 or a radius"),
        ([5, [1.5]], TYPE, "expected a pose type"),
    ],
)
def test_invalid_parts_of_a_length(parts, code, detail):
    with pytest.raises(CallError) as caught:
        read_parts([variant(each) for each in parts])
    assert caught.value.code == code
    assert detail in caught.value.detail


def test_details_in_japanese():
    i18n.use("ja")
    for argument, detail in [
        (1, "ポーズ (VT_BSTR、数値の配列、VARIANT の配列)が必要ですが VT_I4 です"),
        (["P1", "P("], "2 番目のポーズ: 3 文字目: 数値 (x) が必要ですが、ここで終わっています"),
        ([1.5], "型の指定がない数値が 1 個あります。P は 7 個、J は 8 個、T は 9 または 10 個、V は 3 個です"),
    ]:  # fmt: skip
        with pytest.raises(CallError) as caught:
            read_targets(variant(argument))
        assert caught.value.detail == detail


@given(variants())
def test_any_variant_is_a_pose_or_a_call_error(argument):
    _is_read_or_refused(argument)


plain_numbers = st.integers(-3, 10) | st.floats(width=32) | st.sampled_from(["P", "@E", "P1", "", None])
parts = st.recursive(
    plain_numbers, lambda inner: st.lists(inner, max_size=8) | st.lists(st.floats(-9, 9), max_size=10), max_leaves=20
)


@given(st.lists(parts, max_size=5))
def test_anything_like_a_pose_is_one_or_a_call_error(argument):
    _is_read_or_refused(variant(argument))


def _is_read_or_refused(argument):
    targets, code = (), 0
    try:
        targets = read_targets(argument)
    except CallError as error:
        code = error.code
    assert code in ((0,) if targets else (BAD, TYPE))
    assert len(targets) <= MAX_TARGETS
    text = ", ".join(map(str, targets))
    if targets and len(text) <= MAX_LENGTH:
        assert read_targets(variant(text)) == tuple(map(_as_text, targets))


def _as_text(target):
    """Six values without a type are a position in a string, and of no type in an array."""
    unlettered = not target.kind and isinstance(target.value, tuple) and len(target.value) == 6
    return replace(target, kind="P") if unlettered else target
