"""The tables of slave mode: each number, each layout, each form that clients send, and invalid ones."""

from __future__ import annotations

import math
from decimal import Decimal

import pytest

from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, InvalidArgument, InvalidValue, ProtocolError
from orinkit.rc8 import slave_feedback
from orinkit.rc8 import slave_formats as sf
from orinkit.rc8.slave_fields import FieldType, SlaveField
from orinkit.rc8.slave_formats import ReceiveBits, ReceiveFormat, SendBits, SetPoint, SlaveMode, SlaveReply, UserWindow
from orinkit.values.codec import decode, encode, encode_variant
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Variant, VarType, plain, variant
from support.strategies import same

pytestmark = pytest.mark.core

I4, R4, R8, BSTR, UI1 = VarType.I4, VarType.R4, VarType.R8, VarType.BSTR, VarType.UI1
POSES = {
    "P": (364.16, 0.0, 278.5355, 180.0, 0.0, 180.0, 5.0),
    "J": (0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 1.5, -2.5),
    "T": (364.0, 0.0, 278.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 5.0),
}
P, J, T = POSES.values()
KINDS = ["P", "J", "T"]
POSE_ONLY = (SendBits(0), ReceiveFormat())
WITH_USER = ReceiveFormat(0x202)
MINI_HAND = SendBits.MINI | SendBits.HAND
HUGE = 20_000


def form(*parts):
    return Variant(VARIANT_ARRAY, list(parts))


def r8(*numbers):
    return Variant(R8 | ARRAY, numbers)


def ui1(*numbers):
    return Variant(UI1 | ARRAY, bytes(numbers))


def refused(code: int, match: str, function, *arguments) -> CallError:
    with pytest.raises(CallError, match=match) as caught:
        function(*arguments)
    assert caught.value.code == code
    assert isinstance(caught.value, InvalidArgument)
    assert len(str(caught.value)) < 600
    return caught.value


def invalid(match: str, function, *arguments) -> CallError:
    return refused(hresult.E_INVALIDARG, match, function, *arguments)


def mismatch(match: str, function, *arguments) -> CallError:
    return refused(hresult.DISP_E_TYPEMISMATCH, match, function, *arguments)


def label(value) -> str | None:
    """Return an id for values of which some are huge."""
    return f"{type(value).__name__}-{len(value)}" if hasattr(value, "__len__") else None


def on_the_wire(value) -> Variant:
    """Return a value as received by the peer."""
    return decode(encode(value), exact=True)[0]


# --- modes ------------------------------------------------------------------------------------------------------------


def test_the_nine_modes_of_table_4_1():
    assert {(mode.number, mode.kind, mode.buffering) for mode in sf.SLAVE_MODES.values()} == {
        (0x001, "P", 0), (0x002, "J", 0), (0x003, "T", 0),
        (0x101, "P", 1), (0x102, "J", 1), (0x103, "T", 1),
        (0x201, "P", 2), (0x202, "J", 2), (0x203, "T", 2),
    }  # fmt: skip
    for number, mode in sf.SLAVE_MODES.items():
        assert sf.mode_of(number) is mode
        assert sf.mode_number(mode.buffering, mode.kind) == number == mode.number


def test_off_is_not_a_mode():
    assert sf.OFF == 0
    assert sf.mode_of(sf.OFF) is None


@pytest.mark.parametrize("number", [4, 0x100, 0x104, 0x200, 0x301, -1, 2**31 - 1, 2**300])
def test_other_numbers_are_no_mode(number):
    error = invalid("slave mode .* does not exist; valid values: 0x0000, 0x0001, .*, 0x0203", sf.mode_of, number)
    i18n.use("ja")
    assert "スレーブモード" in invalid("はありません", sf.mode_of, number).detail
    assert len(error.detail) < 200


def test_the_message_writes_the_number_as_the_document_does():
    invalid("^[^;]*slave mode 0x0104 does not exist; valid values: 0x0000, 0x0001", sf.mode_of, 0x104)


@pytest.mark.parametrize(("buffering", "kind"), [(3, "P"), (-1, "J"), (0, "V"), (0, "p"), (0, ""), (None, None)])
def test_what_no_mode_has(buffering, kind):
    with pytest.raises(InvalidValue, match='with pose type "P", "J" or "T"'):
        sf.mode_number(buffering, kind)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="はありません。対処: モードは 0、1、2"):
        sf.mode_number(buffering, kind)


def test_a_mode_does_not_change():
    with pytest.raises(AttributeError):
        sf.SLAVE_MODES[1].number = 2
    assert sf.SLAVE_MODES[0x102] == SlaveMode(0x102, "J", 1)


# --- formats ----------------------------------------------------------------------------------------------------------


def test_the_six_send_formats_of_table_4_1():
    assert sf.SEND_FORMATS == (0, 0x20, 0x100, 0x120, 0x200, 0x220)
    for number in sf.SEND_FORMATS:
        assert isinstance(sf.send_format(number), SendBits)
        assert sf.send_format(number) == number
    assert sf.send_format(0x120) == MINI_HAND
    assert sf.send_format(0x220) == SendBits.USER | SendBits.HAND


@pytest.mark.parametrize("number", [1, 0x10, 0x21, 0x40, 0x300, 0x320, 0x400, -0x20, 2**31 - 1])
def test_other_numbers_are_no_send_format(number):
    invalid(
        "send format .* does not exist; valid values: 0x0000, 0x0020, 0x0100, 0x0120, 0x0200, 0x0220",
        sf.send_format,
        number,
    )
    i18n.use("ja")
    invalid("送信フォーマット .* はありません", sf.send_format, number)


@pytest.mark.parametrize(
    ("number", "kinds"),
    [(0, ("J",)), (1, ("P",)), (2, ("J",)), (3, ("T",)), (4, ("P", "J")), (5, ("T", "J"))],
)
def test_what_the_pose_of_an_answer_is(number, kinds):
    plain = sf.receive_format(number)
    assert plain == ReceiveFormat(number, microseconds=False)
    assert plain.kinds == kinds
    assert plain.pose_only
    full = sf.receive_format(number | 0x370, 1)
    assert full.kinds == kinds
    assert full.microseconds
    assert not full.pose_only


@pytest.mark.parametrize("flag", list(ReceiveBits))
def test_flags_of_a_receive_format(flag):
    receive = sf.receive_format(2 | flag)
    assert [other for other in ReceiveBits if receive.has(other)] == [flag]
    assert not receive.pose_only
    assert {int(each) for each in ReceiveBits} == {0x10, 0x20, 0x40, 0x100, 0x200}


@pytest.mark.parametrize("number", [6, 7, 0x0F, 0x16, 0x80, 0x82, 0x400, 0x1002, -1, 2**31 - 1])
def test_other_numbers_are_no_receive_format(number):
    invalid("receive format .* is not valid; expected 0 to 5 for the pose", sf.receive_format, number)
    i18n.use("ja")
    invalid("受信フォーマット .* は使えません", sf.receive_format, number)


@pytest.mark.parametrize("unit", [2, -1, 1000])
def test_other_units_of_timestamps(unit):
    invalid(f"unit {unit} of timestamps is not valid; expected 0 .ms. or 1 .µs.", sf.receive_format, 0x11, unit)
    i18n.use("ja")
    invalid(f"タイムスタンプの単位 {unit} は使えません", sf.receive_format, 0x11, unit)


@pytest.mark.parametrize(
    ("parameter", "number", "microseconds"),
    [
        (17, 17, False),
        ([17], 17, False),
        ([17, 0], 17, False),
        ([17, 1], 17, True),
        ([17.0, 1.0], 17, True),
        (form(17, 1.0), 17, True),
        (form(Variant(VarType.I2, 17), "1"), 17, True),
        (form([17, 1]), 17, True),
        (form([17], [1]), 17, True),
        (b"\x11\x01", 17, True),
        (17.0, 17, False),
        (0, 0, False),
        (Variant(VarType.UI4, 0x374), 0x374, False),
        ("17", 17, False),
        ("0x11,1", 17, True),
        (" 0X11 , 0 ", 17, False),
        (["0x11", "1"], 17, True),
        (["0x11,1"], 17, True),
        ("0x374", 0x374, False),
    ],
)
def test_forms_of_slv_recv_formats_parameter(parameter, number, microseconds):
    assert sf.read_receive_parameter(variant(parameter)) == ReceiveFormat(number, microseconds)


@pytest.mark.parametrize(
    "parameter",
    [None, Variant(VarType.NULL), "", [], [17, 1, 0], form(17, 1, 0), "17,1,0", "," * HUGE, [1] * HUGE, b"\1" * HUGE],
    ids=label,
)
def test_too_few_and_too_many_numbers_for_slv_recv_format(parameter):
    invalid("expected 1 or 2 values", sf.read_receive_parameter, variant(parameter))
    i18n.use("ja")
    invalid("値は 1 個または 2 個必要です", sf.read_receive_parameter, variant(parameter))


@pytest.mark.parametrize(
    ("parameter", "match"),
    [
        ("P1", "receive format: got VT_BSTR, expected a number, not 'P1'"),
        ("0x", "receive format: .*'0x'"),
        ("0x123456789", "receive format: .*'0x123456789'"),
        ("17,", "unit of timestamps: .*not ''"),
        (["x", "1"], "receive format: .*'x'"),
        (form(17, None), "unit of timestamps: got VT_EMPTY, expected a number"),
        (form(17, [1, 2]), r"unit of timestamps: got VT_I4\|VT_ARRAY, expected a number"),
        (Variant(VarType.DATE, 1.0), "receive format: got VT_DATE, expected a number"),
        ("x" * HUGE, "receive format: .*not 'xxx"),
    ],
    ids=label,
)
def test_invalid_numbers_for_slv_recv_format(parameter, match):
    mismatch(match, sf.read_receive_parameter, variant(parameter))
    i18n.use("ja")
    mismatch("受信フォーマット: |タイムスタンプの単位: ", sf.read_receive_parameter, variant(parameter))


@pytest.mark.parametrize(
    ("parameter", "match"),
    [
        (17.5, "receive format: 17.5 is not a whole number"),
        ([17.0, math.nan], "unit of timestamps: nan is not a whole number"),
        (2.0**31, "receive format: 2147483648.0 is out of range"),
        (7, "receive format 0x0007 is not valid; expected 0 to 5"),
        ("0xFFFFFFFF", "receive format -1 is not valid; expected 0 to 5"),
        ([17, 2], "unit 2 of timestamps"),
        (True, "receive format -1"),
    ],
)
def test_numbers_that_slv_recv_format_cannot_mean(parameter, match):
    invalid(match, sf.read_receive_parameter, variant(parameter))


# --- slvMove's parameter: the pose alone ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_pose_alone_is_a_bare_array(kind):
    parameter = sf.encode_set_point(kind, SetPoint(POSES[kind]), *POSE_ONLY)
    assert same(parameter, list(POSES[kind]))
    assert sf.read_set_point(kind, on_the_wire(parameter), *POSE_ONLY) == SetPoint(POSES[kind])


def test_the_set_point_that_the_document_shows():
    """RC8 4.6.3: the parameter of the request and the result of the reply, as printed."""
    sent = bytes.fromhex(
        "3E000000052007000000C3F5285C8FC276400000000000000000"
        "21B07268916871400000000000806640808A864ADCA50C3D00000000008066400000000000001440"
    )
    point = sf.read_set_point("P", decode(sent, exact=True)[0], *POSE_ONLY)
    assert point.pose == pytest.approx((364.16, 0, 278.5355, 180, 0, 180, 5), abs=1e-4)
    assert encode(sf.encode_set_point("P", point, *POSE_ONLY)) == sent
    answered = bytes.fromhex(
        "46000000052008000000C10BB20DEB4BD8BCF0D12537008046400D97E5F5FF7F5640"
        "26BC9E961A58063DF6FF0EDDFF7F464096B00642EC4BD8BC0F00000089114000FEFFFFFF10000000"
    )
    answer = sf.read_reply(ReceiveFormat(), decode(answered)[0])
    assert answer.joints is not None
    assert answer.joints[:6] == pytest.approx((0, 45, 90, 0, 45, 0), abs=1e-4)
    assert encode_variant(sf.build_reply(ReceiveFormat(), answer)) == answered


@pytest.mark.parametrize(
    ("kind", "parameter", "pose"),
    [
        # omitted values
        ("J", r8(*J[:6]), (*J[:6], 0.0, 0.0)),
        ("J", r8(*J[:7]), (*J[:7], 0.0)),
        ("P", r8(*P[:6]), (*P[:6], -1.0)),
        ("T", r8(*T[:9]), (*T[:9], -1.0)),
        # zeros after the pose: as sent by ROS, and arrays of a fixed length
        ("J", r8(*J, 0), J),
        ("P", r8(*P, 0), P),
        ("P", r8(*P, 0, 0), P),
        ("P", r8(*P, 0, -0.0, 0), P),
        ("T", r8(*T, 0), T),
        ("T", r8(*T, 0, 0), T),
        ("T", r8(*T, 0, 0, 0), T),
        # flags without an axis
        ("J", r8(*J, 0x400000), J),
        ("P", r8(*P, 0x400000), P),
        # numbers of other types
        ("J", Variant(R4 | ARRAY, (0, 45, 90, 0, 45, 0, 1.5, -2.5)), J),
        ("J", variant([1, 2, 3, 4, 5, 6]), (1, 2, 3, 4, 5, 6, 0, 0)),
        ("J", variant(b"\1\2\3\4\5\6"), (1, 2, 3, 4, 5, 6, 0, 0)),
        ("J", variant([0, 45, 90.0, 0, 45, 0, 1.5, -2.5]), J),
        ("J", form(*J), J),
        ("P", form(1, 2.5, Variant(R4, 3), Variant(VarType.I2, -4), Variant(VarType.UI8, 5), Decimal("6.5")),
         (1, 2.5, 3, -4, 5, 6.5, -1)),
        ("J", Variant(VarType.CY | ARRAY, [Decimal("1.5")] * 6), (*[1.5] * 6, 0, 0)),
        # in an array of one
        ("J", form(r8(*J)), J),
        ("J", form(r8(*J, 0)), J),
        ("J", form(form(*J)), J),
        ("J", form(Variant(R4 | ARRAY, J)), J),
        # the figure may be any whole number
        ("P", r8(1, 2, 3, 4, 5, 6, -3), (1, 2, 3, 4, 5, 6, -3)),
        ("P", r8(1, 2, 3, 4, 5, 6, 261), (1, 2, 3, 4, 5, 6, 261)),
        # up to the bounds
        ("J", r8(1e6, -1e6, 0, 0, 0, 0, 0, 0), (1e6, -1e6, 0, 0, 0, 0, 0, 0)),
    ],
)  # fmt: skip
def test_forms_of_a_pose(kind, parameter, pose):
    point = sf.read_set_point(kind, parameter, *POSE_ONLY)
    assert point == SetPoint(pose)
    assert {type(value) for value in point.pose} == {float}


@pytest.mark.parametrize(
    ("kind", "parameter", "extra"),
    [
        ("P", r8(*P, 0x400040, 10), ((7, 10.0),)),
        ("P", r8(*P, 0x400080, -20), ((8, -20.0),)),
        ("P", r8(*P, 0x4000C0, 10, -20), ((7, 10.0), (8, -20.0))),
        ("J", r8(*J, 0x400040), ((7, 1.5),)),
        ("J", r8(*J, 0x400080), ((8, -2.5),)),
        ("J", r8(*J, 0x4000C0), ((7, 1.5), (8, -2.5))),
        ("T", r8(*T, 0x400040, 10), ((7, 10.0),)),
        ("T", r8(*T, 0x400080, -20), ((8, -20.0),)),
        ("T", r8(*T, 0x4000C0, 10, -20), ((7, 10.0), (8, -20.0))),
    ],
)
def test_the_nine_rows_of_table_4_5(kind, parameter, extra):
    point = sf.read_set_point(kind, parameter, *POSE_ONLY)
    assert point == SetPoint(POSES[kind], extra)
    assert same(sf.encode_set_point(kind, point, *POSE_ONLY), parameter.value)
    single = Variant(R4 | ARRAY, parameter.value)
    assert sf.read_set_point(kind, on_the_wire(single), *POSE_ONLY).extra == extra, "the flags fit a VT_R4"


@pytest.mark.parametrize(
    ("kind", "numbers", "match"),
    [
        ("P", (), "0 numbers for a P; expected 6 to 7, or up to 10 with extended joints"),
        ("P", P[:5], "5 numbers for a P"),
        ("P", (*P, 0x4000C0, 1, 2, 0), "11 numbers for a P"),
        ("J", J[:5], "5 numbers for a J; expected 6 to 8, or up to 9 with extended joints"),
        ("J", (*J, 0x400040, 1), "10 numbers for a J"),
        ("T", T[:8], "8 numbers for a T; expected 9 to 10, or up to 13 with extended joints"),
        ("T", (*T, 0x4000C0, 1, 2, 0), "14 numbers for a T"),
    ],
)
def test_counts_that_no_pose_has(kind, numbers, match):
    for parameter in (r8(*numbers), Variant(R4 | ARRAY, numbers), form(*map(float, numbers)), form(r8(*numbers))):
        invalid(match, sf.read_set_point, kind, parameter, *POSE_ONLY)
    i18n.use("ja")
    invalid(f"{kind} 型の値が {len(numbers)} 個あります", sf.read_set_point, kind, r8(*numbers), *POSE_ONLY)


@pytest.mark.parametrize("value", [[1.0] * HUGE, [1] * HUGE, ["x"] * HUGE, [None] * HUGE, b"1" * HUGE], ids=label)
@pytest.mark.parametrize("kind", KINDS)
def test_giant_arrays_are_refused_by_their_length(kind, value):
    match = f"{HUGE} numbers for a {kind}"
    invalid(match, sf.read_set_point, kind, variant(value), *POSE_ONLY)
    invalid(match, sf.read_set_point, kind, form(value), *POSE_ONLY)
    invalid(match, sf.read_set_point, kind, form(value, 1), SendBits.HAND, ReceiveFormat())


@pytest.mark.parametrize(
    ("kind", "behind", "match"),
    [
        ("P", (0x40, 1), "value 8 of a P is 0x0040; expected a flag of extended joints: 0x400040"),
        ("P", (0x400041, 1), "value 8 of a P is 0x400041;"),
        ("P", (0x400100, 1), "value 8 of a P is 0x400100;"),
        ("P", (0x400040 + 0.5, 1), "value 8 of a P is 4194368.5;"),
        ("P", (-0x400040, 1), "value 8 of a P is -4194368;"),
        ("P", (math.nan, 1), "value 8 of a P is nan;"),
        ("P", (math.inf,), "value 8 of a P is inf;"),
        ("P", (1e300,), "value 8 of a P is 1000000.*;"),
        ("P", (0, 1), "value 8 of a P is 0x0000;"),
        ("P", (0, 0, 1), "value 8 of a P is 0x0000;"),
        ("P", (0, math.nan), "value 8 of a P is 0x0000;"),
        ("J", (1,), "value 9 of a J is 0x0001;"),
        ("P", (0x400001,), "value 8 of a P is 0x400001;"),
        ("J", (0x400101,), "value 9 of a J is 0x400101;"),
        ("T", (0x20, 1), "value 11 of a T is 0x0020;"),
        ("P", (0x400040,), "flags 0x400040 of extended joints require 1 values after them, got 0"),
        ("P", (0x400040, 1, 0), "flags 0x400040 of extended joints require 1 values after them, got 2"),
        ("P", (0x400080, 1, 2), "flags 0x400080 of extended joints require 1 .* got 2"),
        ("P", (0x4000C0, 1), "flags 0x4000C0 of extended joints require 2 .* got 1"),
        ("P", (0x400000, 1), "flags 0x400000 of extended joints require 0 .* got 1"),
        ("T", (0x4000C0, 1), "flags 0x4000C0 of extended joints require 2 .* got 1"),
    ],
)
def test_invalid_flags_and_flags_that_do_not_match(kind, behind, match):
    numbers = r8(*POSES[kind], *behind)
    invalid(match, sf.read_set_point, kind, numbers, *POSE_ONLY)
    i18n.use("ja")
    invalid("番目の値が|の後には値が", sf.read_set_point, kind, numbers, *POSE_ONLY)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, 1000000.1, -1000001])
@pytest.mark.parametrize(
    ("kind", "place", "name"),
    [("J", 1, "J1"), ("J", 8, "J8"), ("P", 1, "x"), ("P", 6, "rz"), ("P", 7, "fig"), ("T", 9, "az"), ("T", 10, "fig")],
)
def test_numbers_that_are_not_finite_or_too_large(kind, place, name, value):
    numbers = list(POSES[kind])
    numbers[place - 1] = value
    match = rf"{name} \(value {place}\) of a {kind} is .*; expected a finite number of at most 1000000"
    error = invalid(match, sf.read_set_point, kind, r8(*numbers), *POSE_ONLY)
    assert str(float(value)) in error.detail
    with pytest.raises(InvalidValue, match=match):
        sf.encode_set_point(kind, SetPoint(tuple(numbers)), *POSE_ONLY)
    i18n.use("ja")
    invalid(rf"{kind} 型の {name} \({place} 番目の値\) が", sf.read_set_point, kind, r8(*numbers), *POSE_ONLY)


@pytest.mark.parametrize(
    ("behind", "match"),
    [
        ((0x400040, math.nan), r"J7 \(value 9\) of a P is nan"),
        ((0x400080, 2e6), r"J8 \(value 9\) of a P is 2000000.0"),
        ((0x4000C0, 1, math.inf), r"J8 \(value 10\) of a P is inf"),
    ],
)
def test_values_of_extra_axes_that_cannot_be(behind, match):
    invalid(match, sf.read_set_point, "P", r8(*P, *behind), *POSE_ONLY)


@pytest.mark.parametrize(("kind", "place"), [("P", 7), ("T", 10)])
def test_a_figure_is_a_whole_number(kind, place):
    numbers = (*POSES[kind][:-1], 5.5)
    match = rf"fig \(value {place}\) of a {kind} is 5.5; expected a whole number"
    invalid(match, sf.read_set_point, kind, r8(*numbers), *POSE_ONLY)
    with pytest.raises(InvalidValue, match=match):
        sf.encode_set_point(kind, SetPoint(numbers), *POSE_ONLY)
    i18n.use("ja")
    invalid("fig .*整数にしてください", sf.read_set_point, kind, r8(*numbers), *POSE_ONLY)


def test_a_figure_that_is_no_whole_number_with_extra_axes():
    invalid("fig .value 7. of a P is 0.5", sf.read_set_point, "P", r8(*P[:6], 0.5, 0x400040, 1), *POSE_ONLY)


@pytest.mark.parametrize(
    ("parameter", "name"),
    [
        (Variant(VarType.EMPTY), "VT_EMPTY"),
        (Variant(VarType.NULL), "VT_NULL"),
        (variant("J(0,45,90,0,45,0)"), "VT_BSTR"),
        (variant(1.0), "VT_R8"),
        (variant(["0"] * 8), "VT_BSTR"),
        (variant([True] * 8), "VT_BOOL"),
        (Variant(VarType.DATE | ARRAY, [1.0] * 8), "VT_DATE"),
        (form(*J[:7], "0"), "VT_BSTR"),
        (form(*J[:7], None), "VT_EMPTY"),
        (form(*J[:7], r8(1)), r"VT_R8\|VT_ARRAY"),
        (form(r8(), *J[:7]), "elements"),
        (form(form(*J[:7], "0")), "VT_BSTR"),
    ],
)
def test_invalid_poses(parameter, name):
    if name == "elements":
        invalid(
            "slvMove has 8 elements, the current formats require 1: pose", sf.read_set_point, "J", parameter, *POSE_ONLY
        )
        return
    mismatch(f"pose: got {name}, expected an array of numbers", sf.read_set_point, "J", parameter, *POSE_ONLY)
    i18n.use("ja")
    mismatch(f"ポーズには数値の配列が必要ですが {name} です", sf.read_set_point, "J", parameter, *POSE_ONLY)


# --- slvMove's parameter: with other parts ----------------------------------------------------------------------------

PARTS = {"mini": 0x8001, "hand": 3, "user": (128, b"\1\xff"), "window": UserWindow(24, 4)}
ELEMENTS = {
    "mini": [Variant(I4, 0x8001)],
    "hand": [Variant(I4, 3)],
    "user": [Variant(I4, 128), Variant(I4, 2), ui1(1, 255)],
    "window": [Variant(I4, 24), Variant(I4, 4)],
}
LAYOUTS = {  # table 4-2: send format, receive format -> the parts after the pose
    (0x000, 0x002): (),
    (0x000, 0x202): ("window",),
    (0x020, 0x002): ("hand",),
    (0x020, 0x202): ("window", "hand"),
    (0x100, 0x002): ("mini",),
    (0x100, 0x202): ("mini", "window"),
    (0x120, 0x002): ("mini", "hand"),
    (0x120, 0x202): ("mini", "window", "hand"),
    (0x200, 0x002): ("user",),
    (0x200, 0x202): ("user", "window"),
    (0x220, 0x002): ("user", "hand"),
    (0x220, 0x202): ("user", "window", "hand"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("formats", "parts"), LAYOUTS.items(), ids=str)
def test_the_layouts_of_table_4_2(kind, formats, parts):
    send, receive = sf.send_format(formats[0]), sf.receive_format(formats[1])
    point = SetPoint(POSES[kind], **{part: PARTS[part] for part in parts})
    parameter = sf.encode_set_point(kind, point, send, receive)
    pose = r8(*POSES[kind])
    expected = form(pose, *[element for part in parts for element in ELEMENTS[part]]) if parts else pose
    assert same(variant(parameter), expected)
    assert sf.read_set_point(kind, on_the_wire(parameter), send, receive) == point


def test_other_bits_of_a_receive_format_change_no_parameter():
    receive = sf.receive_format(0x175)
    assert sf.encode_set_point("J", SetPoint(J), SendBits(0), receive) == list(J)
    assert sf.read_set_point("J", r8(*J), SendBits(0), receive) == SetPoint(J)


def test_extra_axes_beside_other_parts():
    point = SetPoint(P, ((7, 10.0),), hand=1)
    parameter = sf.encode_set_point("P", point, SendBits.HAND, ReceiveFormat())
    assert same(parameter, form(r8(*P, 0x400040, 10), Variant(I4, 1)))
    assert sf.read_set_point("P", parameter, SendBits.HAND, ReceiveFormat()) == point


@pytest.mark.parametrize(
    "parameter",
    [
        form(r8(*J), 1, 2),
        form(Variant(R4 | ARRAY, J), Variant(VarType.I2, 1), Variant(UI1, 2)),
        form(form(*J), 1.0, "2"),
        form(list(J), "0x1", Variant(R4, 2)),
        form(r8(*J, 0), [1], Variant(VarType.UI4, 2)),
    ],
)
def test_states_and_poses_of_other_types(parameter):
    assert sf.read_set_point("J", parameter, MINI_HAND, ReceiveFormat()) == SetPoint(J, mini=1, hand=2)


@pytest.mark.parametrize(
    ("parameter", "match"),
    [
        (r8(*J), "slvMove has 1 elements, the current formats require 3: pose, mini I/O, hand I/O"),
        (form(*J), "slvMove has 1 elements"),
        (form(), "slvMove has 1 elements"),
        (form(r8(*J)), "slvMove has 1 elements"),
        (form(r8(*J), 1), "slvMove has 2 elements"),
        (form(r8(*J), 1, 2, 3), "slvMove has 4 elements"),
        (Variant(VARIANT_ARRAY, [r8(*J)] * HUGE), f"slvMove has {HUGE} elements"),
        (form(r8(*J), 1.5, 2), "mini I/O: 1.5 is not a whole number"),
        (form(r8(*J), 1, math.nan), "hand I/O: nan is not a whole number"),
        (form(r8(*J), 1, Variant(VarType.UI4, 2**31)), "hand I/O: 2147483648 is out of range"),
        (form(r8(1, 2), 1, 2), "2 numbers for a J"),
    ],
    ids=label,
)
def test_set_points_that_are_not_as_the_formats_say(parameter, match):
    invalid(match, sf.read_set_point, "J", parameter, MINI_HAND, ReceiveFormat())
    i18n.use("ja")
    invalid("個|整数|範囲外", sf.read_set_point, "J", parameter, MINI_HAND, ReceiveFormat())


@pytest.mark.parametrize(
    ("parameter", "match"),
    [
        (variant(None), "pose: got VT_EMPTY"),
        (variant("x"), "pose: got VT_BSTR"),
        (form("J(1,2,3)", 1, 2), "pose: got VT_BSTR"),
        (form(1.0, 2.0, 3.0), "pose: got VT_R8"),
        (form(["x"] * 8, 1, 2), "pose: got VT_BSTR"),
        (form(r8(*J), "x", 2), "mini I/O: got VT_BSTR, expected a number"),
        (form(r8(*J), 1, None), "hand I/O: got VT_EMPTY, expected a number"),
        (form(r8(*J), 1, [1, 2]), r"hand I/O: got VT_I4\|VT_ARRAY, expected a number"),
    ],
)
def test_parts_of_a_wrong_type(parameter, match):
    mismatch(match, sf.read_set_point, "J", parameter, MINI_HAND, ReceiveFormat())
    i18n.use("ja")
    mismatch("ポーズには|MiniIO 状態: |HandIO 状態: ", sf.read_set_point, "J", parameter, MINI_HAND, ReceiveFormat())


def test_bits_of_a_state_as_hexadecimal_text():
    point = sf.read_set_point("J", form(r8(*J), "0xFFFFFFFF"), SendBits.HAND, ReceiveFormat())
    assert point.hand == -1


def test_a_part_of_no_format_in_force():
    invalid(
        "slvMove has 2 elements, the current formats require 1: pose",
        sf.read_set_point,
        "J",
        form(r8(*J), 1),
        *POSE_ONLY,
    )
    i18n.use("ja")
    error = invalid("slvMove の要素が 2 個", sf.read_set_point, "J", form(r8(*J), 1), *POSE_ONLY)
    assert error.detail.endswith("1 個必要です (ポーズ)")


# --- user I/O ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("offset", "size", "states", "user"),
    [
        (0, 1, ui1(7), (0, b"\7")),
        (8, 2, ui1(1, 2, 3), (8, b"\1\2")),
        (128, 64, ui1(*range(64)), (128, bytes(range(64)))),
        (128.0, "2", [1, 255], (128, b"\1\xff")),
        (128, 2, form(1, 2.0, "x"), (128, b"\1\2")),
        (128, 2, Variant(VarType.I2 | ARRAY, [0, 255]), (128, b"\0\xff")),
        (128, 1, 9, (128, b"\x09")),
        (128, 1, ui1(*[5] * 100_000), (128, b"\5")),
    ],
    ids=label,
)
def test_forms_of_user_io(offset, size, states, user):
    parameter = form(r8(*J), offset, size, states)
    assert sf.read_set_point("J", parameter, SendBits.USER, ReceiveFormat()) == SetPoint(J, user=user)


@pytest.mark.parametrize(
    ("offset", "size", "match"),
    [
        (-8, 1, "offset of user I/O to {} is -8, expected a multiple of 8"),
        (1, 1, "offset of user I/O to {} is 1, expected a multiple of 8"),
        (12, 1, "offset of user I/O to {} is 12, expected a multiple of 8"),
        (8, 0, "size of user I/O to {} is 0, expected 1 to 64 bytes"),
        (8, -1, "size of user I/O to {} is -1, expected 1 to 64 bytes"),
        (8, 65, "size of user I/O to {} is 65, expected 1 to 64 bytes"),
        (8, 2**31 - 1, "size of user I/O to {} is 2147483647, expected 1 to 64 bytes"),
        (0.5, 1, "offset of user I/O to {}: 0.5 is not a whole number"),
        (8, 1.5, "size of user I/O to {}: 1.5 is not a whole number"),
    ],
)
def test_user_io_beyond_its_bounds(offset, size, match):
    sent, asked = form(r8(*J), offset, size, ui1(*[0] * 100)), form(r8(*J), offset, size)
    invalid(match.format("send"), sf.read_set_point, "J", sent, SendBits.USER, ReceiveFormat())
    invalid(match.format("receive"), sf.read_set_point, "J", asked, SendBits(0), WITH_USER)
    i18n.use("ja")
    invalid("送信汎用 IO の", sf.read_set_point, "J", sent, SendBits.USER, ReceiveFormat())
    invalid("受信汎用 IO の", sf.read_set_point, "J", asked, SendBits(0), WITH_USER)


@pytest.mark.parametrize(
    ("states", "match"),
    [
        (ui1(1), "user I/O to send: got 1 bytes, expected 2"),
        (ui1(), "user I/O to send: got 0 bytes"),
        (5, "user I/O to send: got 1 bytes"),
        ([1, 256], "user I/O to send: byte 2 is 256, expected 0 to 255"),
        ([-1, 0], "user I/O to send: byte 1 is -1"),
        ([0.5, 1.0], "user I/O to send: 0.5 is not a whole number"),
    ],
)
def test_states_of_user_io_that_cannot_be_sent(states, match):
    parameter = form(r8(*J), 8, 2, states)
    invalid(match, sf.read_set_point, "J", parameter, SendBits.USER, ReceiveFormat())
    i18n.use("ja")
    invalid("送信汎用 IO 状態: ", sf.read_set_point, "J", parameter, SendBits.USER, ReceiveFormat())


@pytest.mark.parametrize(
    ("elements", "match"),
    [
        (("x", 1, b"\1"), "offset of user I/O to send: got VT_BSTR"),
        ((8, None, b"\1"), "size of user I/O to send: got VT_EMPTY"),
        ((8, 1, ["x"]), "user I/O to send: got VT_BSTR"),
        ((8, 1, None), "user I/O to send: got VT_EMPTY"),
    ],
)
def test_user_io_of_a_wrong_type(elements, match):
    mismatch(match, sf.read_set_point, "J", form(r8(*J), *elements), SendBits.USER, ReceiveFormat())


# --- what a client can build ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "pose", "numbers"),
    [
        ("J", (1, 2, 3, 4, 5, 6), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0]),
        ("J", (1, 2, 3, 4, 5, 6, 7), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0]),
        ("J", [Decimal(1)] * 8, [1.0] * 8),
        ("P", (1, 2, 3, 4, 5, 6), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -1.0]),
        ("T", T[:9], [*T[:9], -1.0]),
    ],
)
def test_what_may_be_left_out_of_a_pose_to_send(kind, pose, numbers):
    assert same(sf.encode_set_point(kind, SetPoint(pose), *POSE_ONLY), numbers)


def test_extra_axes_of_joints_are_those_of_the_pose():
    point = SetPoint((1, 2, 3, 4, 5, 6), ((7, 70), (8, 80)))
    expected = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 70.0, 80.0, float(0x4000C0)]
    assert same(sf.encode_set_point("J", point, *POSE_ONLY), expected)
    assert point.pose == (1, 2, 3, 4, 5, 6)
    with pytest.raises(InvalidValue, match=r"J7 \(value 7\) of a J is nan"):
        sf.encode_set_point("J", SetPoint(J, ((7, math.nan),)), *POSE_ONLY)
    with pytest.raises(InvalidValue, match=r"J8 \(value 12\) of a T is inf"):
        sf.encode_set_point("T", SetPoint(T, ((8, math.inf),)), *POSE_ONLY)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axes", [(6,), (9,), (8, 7), (7, 7), (7, 8, 9), (0,), (99,)])
def test_axes_that_are_no_extra_axes(kind, axes):
    point = SetPoint(POSES[kind], tuple((axis, 1.0) for axis in axes))
    with pytest.raises(
        InvalidValue, match=r"extended joints .* are not valid; expected 7, 8, or 7 and 8 in this order"
    ):
        sf.encode_set_point(kind, point, *POSE_ONLY)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=r"付加軸 .* は指定できません"):
        sf.encode_set_point(kind, point, *POSE_ONLY)


@pytest.mark.parametrize(
    ("kind", "pose", "match"),
    [
        ("J", J[:5], "5 numbers for a J"),
        ("J", (*J, 0), "9 numbers for a J"),
        ("P", P[:5], "5 numbers for a P"),
        ("P", (*P, 0), "8 numbers for a P"),
        ("T", (*T, 0), "11 numbers for a T"),
        ("J", (), "0 numbers for a J"),
        ("J", (*J[:7], None), "not all values are numbers"),
        ("J", (*J[:7], "x"), "not all values are numbers"),
        ("J", (*J[:7], 10**400), "not all values are numbers"),
        ("J", None, "not all values are numbers"),
        ("J", "x" * HUGE, "not all values are numbers"),
    ],
    ids=label,
)
def test_poses_that_cannot_be_sent(kind, pose, match):
    with pytest.raises(InvalidValue, match=match) as caught:
        sf.encode_set_point(kind, SetPoint(pose), *POSE_ONLY)
    assert len(str(caught.value)) < 300
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=r"個あります|数値でない値があります"):
        sf.encode_set_point(kind, SetPoint(pose), *POSE_ONLY)


def test_an_extended_joint_without_a_value():
    with pytest.raises(InvalidValue, match=r"extended joints \(\(7, None\),\): not all values are numbers"):
        sf.encode_set_point("P", SetPoint(P, ((7, None),)), *POSE_ONLY)


NAMES = {
    "mini": "mini I/O",
    "hand": "hand I/O",
    "user": "user I/O to send",
    "window": "user I/O to receive",
}
WANTING = {
    "mini": (SendBits.MINI, ReceiveFormat()),
    "hand": (SendBits.HAND, ReceiveFormat()),
    "user": (SendBits.USER, ReceiveFormat()),
    "window": (SendBits(0), WITH_USER),
}


@pytest.mark.parametrize("part", list(PARTS))
def test_a_part_that_is_missing(part):
    with pytest.raises(InvalidValue, match=f"{NAMES[part]}: required by the current formats"):
        sf.encode_set_point("J", SetPoint(J), *WANTING[part])
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="現在のフォーマットでは指定が必要です"):
        sf.encode_set_point("J", SetPoint(J), *WANTING[part])


@pytest.mark.parametrize("part", list(PARTS))
def test_a_part_that_the_formats_have_no_place_for(part):
    """Nothing is dropped silently: an output that was never set would be worse."""
    for formats in (POSE_ONLY, *(WANTING[other] for other in PARTS if other != part)):
        given = {other: PARTS[other] for other in PARTS if WANTING[other] == formats}
        point = SetPoint(J, **given, **{part: PARTS[part]})
        with pytest.raises(InvalidValue, match=f"{NAMES[part]}: not included in the current formats"):
            sf.encode_set_point("J", point, *formats)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="現在のフォーマットでは送信できません"):
        sf.encode_set_point("J", SetPoint(J, **{part: PARTS[part]}), *POSE_ONLY)


@pytest.mark.parametrize(
    ("state", "sent"),
    [(0, 0), (-1, -1), (2**32 - 1, -1), (2**31, -(2**31)), (-(2**31), -(2**31)), (2**31 - 1, 2**31 - 1)],
)
def test_states_are_32_bits(state, sent):
    parameter = sf.encode_set_point("J", SetPoint(J, hand=state), SendBits.HAND, ReceiveFormat())
    assert same(on_the_wire(parameter), form(r8(*J), Variant(I4, sent)))


@pytest.mark.parametrize("state", [2**32, -(2**31) - 1, 2**300])
def test_states_of_more_than_32_bits(state):
    with pytest.raises(InvalidValue, match=r"mini I/O: .* has more than 32 bits"):
        sf.encode_set_point("J", SetPoint(J, mini=state), SendBits.MINI, ReceiveFormat())
    i18n.use("ja")
    with pytest.raises(InvalidValue, match=r"MiniIO 状態: .* は 32 ビットを超えています"):
        sf.encode_set_point("J", SetPoint(J, mini=state), SendBits.MINI, ReceiveFormat())


@pytest.mark.parametrize(
    ("offset", "size", "match"),
    [
        (1, 1, "offset .* is 1"),
        (-8, 1, "offset .* is -8"),
        (8, 0, "size .* is 0"),
        (8, 65, "size .* is 65"),
        (2**31, 1, "VT_I4"),
    ],
)
def test_user_io_that_cannot_be_sent_or_asked_for(offset, size, match):
    with pytest.raises(InvalidValue, match=match):
        sf.encode_set_point("J", SetPoint(J, user=(offset, bytes(size))), SendBits.USER, ReceiveFormat())
    with pytest.raises(InvalidValue, match=match):
        sf.encode_set_point("J", SetPoint(J, window=UserWindow(offset, size)), SendBits(0), WITH_USER)


def test_states_of_user_io_are_bytes():
    point = SetPoint(J, user=(8, bytearray(b"\1\2")))
    parameter = sf.encode_set_point("J", point, SendBits.USER, ReceiveFormat())
    assert same(parameter, form(r8(*J), Variant(I4, 8), Variant(I4, 2), ui1(1, 2)))
    with pytest.raises(InvalidValue, match="VT_UI1"):
        sf.encode_set_point("J", SetPoint(J, user=(8, "ab")), SendBits.USER, ReceiveFormat())


# --- slvMove's answer -------------------------------------------------------------------------------------------------

CURRENT = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0)
FULL = SlaveReply(J, P, T, 1234, 0x8001, 3, b"\1\xff", CURRENT)
ANSWERS = [  # table 4-3: flags, and the order of the parts
    (0x000, ("pose",)),
    (0x100, ("pose", "mini")),
    (0x010, ("timestamp", "pose")),
    (0x110, ("timestamp", "pose", "mini")),
    (0x020, ("pose", "hand")),
    (0x120, ("pose", "mini", "hand")),
    (0x030, ("timestamp", "pose", "hand")),
    (0x130, ("timestamp", "pose", "mini", "hand")),
    (0x200, ("pose", "user")),
    (0x210, ("timestamp", "pose", "user")),
    (0x220, ("pose", "user", "hand")),
    (0x230, ("timestamp", "pose", "user", "hand")),
    (0x040, ("pose", "current")),
    (0x140, ("pose", "mini", "current")),
    (0x150, ("timestamp", "pose", "mini", "current")),
    (0x060, ("pose", "hand", "current")),
    (0x160, ("pose", "mini", "hand", "current")),
    (0x070, ("timestamp", "pose", "hand", "current")),
    (0x170, ("timestamp", "pose", "mini", "hand", "current")),
    (0x240, ("pose", "user", "current")),
    (0x250, ("timestamp", "pose", "user", "current")),
    (0x340, ("pose", "mini", "user", "current")),
    (0x270, ("timestamp", "pose", "user", "hand", "current")),
    (0x370, ("timestamp", "pose", "mini", "user", "hand", "current")),
]
ANSWER_ELEMENTS = {
    "timestamp": Variant(I4, 1234),
    "mini": Variant(I4, 0x8001),
    "user": ui1(1, 255),
    "hand": Variant(I4, 3),
    "current": r8(*CURRENT),
}
ANSWER_POSES = {0: J, 1: P, 2: J, 3: T, 4: P + J, 5: T + J}


@pytest.mark.parametrize("number", ANSWER_POSES)
@pytest.mark.parametrize(("flags", "parts"), ANSWERS, ids=str)
def test_the_layouts_of_table_4_3(number, flags, parts):
    receive = sf.receive_format(number | flags)
    answer = sf.build_reply(receive, FULL)
    elements = {**ANSWER_ELEMENTS, "pose": r8(*ANSWER_POSES[number])}
    expected = form(*(elements[part] for part in parts)) if flags else elements["pose"]
    assert same(answer, expected)
    has_poses = {"joints": "J" in receive.kinds, "position": "P" in receive.kinds, "trans": "T" in receive.kinds}
    read = sf.read_reply(receive, decode(encode_variant(answer))[0])
    for name in ("joints", "position", "trans", "timestamp", "mini", "hand", "user", "current"):
        is_there = has_poses.get(name, name in parts)
        assert same(getattr(read, name), getattr(FULL, name) if is_there else None), name


def test_two_poses_are_15_and_18_numbers():
    assert len(sf.build_reply(ReceiveFormat(4), FULL).value) == 15
    assert len(sf.build_reply(ReceiveFormat(5), FULL).value) == 18


def test_what_the_format_does_not_have_need_not_be_there():
    assert sf.build_reply(ReceiveFormat(), SlaveReply(J)) == Variant(R8_ARRAY, list(J))
    assert sf.read_reply(ReceiveFormat(), list(J)) == SlaveReply(J)


@pytest.mark.parametrize(
    ("time", "sent"),
    [(0, 0), (2**31 - 1, 2**31 - 1), (2**31, -(2**31)), (2**32 + 5, 5), (3 * 2**31, -(2**31)), (-1, -1)],
)
def test_a_timestamp_begins_again_where_a_vt_i4_ends(time, sent):
    receive = sf.receive_format(0x12, 1)
    answer = sf.build_reply(receive, SlaveReply(J, timestamp=time))
    assert sf.read_reply(receive, decode(encode_variant(answer))[0]).timestamp == sent


@pytest.mark.parametrize(
    ("number", "answer", "name"),
    [
        (0, SlaveReply(), "pose of type J"),
        (0, SlaveReply(J[:6]), "pose of type J"),
        (1, SlaveReply(J), "pose of type P"),
        (1, SlaveReply(position=P[:6]), "pose of type P"),
        (3, SlaveReply(trans=P), "pose of type T"),
        (4, SlaveReply(position=P), "pose of type J"),
        (0x10, SlaveReply(J), "timestamp"),
        (0x100, SlaveReply(J), "mini I/O"),
        (0x20, SlaveReply(J), "hand I/O"),
        (0x200, SlaveReply(J), "user I/O"),
        (0x40, SlaveReply(J), "motor currents"),
        (0x40, SlaveReply(J, current=J[:6]), "motor currents"),
    ],
)
def test_results_without_a_field_of_the_format(number, answer, name):
    with pytest.raises(InvalidValue, match=f"{name}: required by the receive format, but missing or of another length"):
        sf.build_reply(ReceiveFormat(number), answer)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="値がないか要素数が異なります"):
        sf.build_reply(ReceiveFormat(number), answer)


def test_a_client_also_reads_whole_numbers_and_fewer_currents():
    answer = sf.read_reply(ReceiveFormat(0x42), ([1, 2, 3, 4, 5, 6, 7, 8.5], [1, 2.5]))
    assert same(answer.joints, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.5))
    assert same(answer.current, (1.0, 2.5))


@pytest.mark.parametrize(
    ("number", "value", "match"),
    [
        (0, None, "pose is None, expected 8 finite numbers"),
        (0, "J1", "pose is 'J1', expected 8"),
        (0, 1.0, "pose is 1.0, expected 8"),
        (0, list(J[:7]), r"pose is 7 values, \[0.0, 45.0, .*, expected 8"),
        (0, [*J, 0.0], "pose is 9 values, .*, expected 8"),
        (0, [1.0] * HUGE, f"pose is {HUGE} values"),
        (0, "x" * HUGE, "pose is 'xxxxx"),
        (0, b"x" * HUGE, f"pose is {HUGE} values, b'xxx"),
        (0, [*J[:7], None], "pose is 8 values"),
        (0, [*J[:7], True], "pose is 8 values"),
        (0, [*J[:7], "1"], "pose is 8 values"),
        (0, [*J[:7], math.nan], "expected 8 finite numbers"),
        (0, [*J[:7], -math.inf], "expected 8 finite numbers"),
        (0, [*J[:7], 10**400], "expected 8 finite numbers"),
        (0, [list(J)], "pose is 1 values"),
        (1, list(J), "receive format 0x0001: pose is 8 values, .*, expected 7"),
        (3, list(J), "expected 10"),
        (4, list(J), "expected 15"),
        (5, list(J), "expected 18"),
        (0x12, list(J), "receive format 0x0012: the whole result is 8 values, .*, expected 2 values"),
        (0x12, None, "the whole result is None, expected 2 values"),
        (0x12, b"ab", "the whole result is 2 values, b'ab', expected 2 values"),
        (0x12, [1], "the whole result is 1 values"),
        (0x12, [1, list(J), 3], "the whole result is 3 values"),
        (0x12, [list(J), 1], r"pose is 1, expected 8"),
        (0x12, [1.0, list(J)], "timestamp is 1.0, expected a whole number"),
        (0x12, [None, list(J)], "timestamp is None, expected a whole number"),
        (0x12, [True, list(J)], "timestamp is True, expected a whole number"),
        (0x102, [list(J), "1"], "mini I/O is '1', expected a whole number"),
        (0x22, [list(J), [1]], r"hand I/O is 1 values, \[1\], expected a whole number"),
        (0x202, [list(J), [1, 2]], r"user I/O is 2 values, \[1, 2\], expected an array of VT_UI1"),
        (0x202, [list(J), None], "user I/O is None, expected an array of VT_UI1"),
        (0x42, [list(J), []], r"motor currents is 0 values, \[\], expected 1..8 finite numbers"),
        (0x42, [list(J), [1.0] * 9], "motor currents is 9 values"),
        (0x42, [list(J), 1.0], "motor currents is 1.0"),
    ],
    ids=label,
)
def test_results_that_do_not_match_the_format(number, value, match):
    with pytest.raises(ProtocolError, match=match) as caught:
        sf.read_reply(ReceiveFormat(number), value)
    assert len(str(caught.value)) < 300
    assert not caught.value.fatal
    i18n.use("ja")
    with pytest.raises(
        ProtocolError, match=r"slvMove の応答 \(受信フォーマット 0x0.*\): .*には.*が必要ですが、.* です"
    ):
        sf.read_reply(ReceiveFormat(number), value)


# --- a field that has no attribute ------------------------------------------------------------------------------------


@pytest.fixture
def temperature(monkeypatch) -> SlaveField:
    """An additional row; tests/streaming/test_slave_field.py has one in the table itself."""
    row = SlaveField(name="temperature", label="temperature", form=FieldType.REAL, place=7, receive=0x400)
    plan = (0, ((1, row, "", slave_feedback._READERS[row.form], slave_feedback._WRITERS[row.form]),))
    monkeypatch.setattr(slave_feedback, "_plan_of_reply", lambda _: plan)
    monkeypatch.setitem(slave_feedback._ATTRIBUTES, row.name, "")
    return row


WARM = ReceiveFormat(0x402)


def test_a_field_without_an_attribute_survives_a_round_trip(temperature):
    given = SlaveReply.of({"joints": J, temperature.name: 36.5})
    assert given == SlaveReply(J, more={"temperature": 36.5})
    assert given.values() == {"joints": J, "temperature": 36.5}
    answer = on_the_wire(sf.build_reply(WARM, given))
    assert [element.type for element in answer.value] == [R8_ARRAY, VarType.R8]
    assert sf.read_reply(WARM, plain(answer)) == given
    assert hash(given) == hash(SlaveReply(J))


@pytest.mark.usefixtures("temperature")
def test_a_field_without_an_attribute_that_is_missing():
    with pytest.raises(InvalidValue, match=r"^temperature: required by the receive format, but missing"):
        sf.build_reply(WARM, SlaveReply(J))


@pytest.mark.usefixtures("temperature")
@pytest.mark.parametrize("value", [None, "1", [1.0], True, math.nan, math.inf, -math.inf])
def test_invalid_numbers(value):
    with pytest.raises(ProtocolError, match=r"0x0402: temperature is .*, expected a finite number$"):
        sf.read_reply(WARM, [list(J), value])
    i18n.use("ja")
    with pytest.raises(ProtocolError, match="temperatureには有限の数値が必要ですが"):
        sf.read_reply(WARM, [list(J), value])


def test_a_whole_number_is_a_number(temperature):
    found = sf.read_reply(WARM, [list(J), 36]).more[temperature.name]
    assert (found, type(found)) == (36.0, float)
