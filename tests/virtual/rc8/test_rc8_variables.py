from __future__ import annotations

import struct
from datetime import datetime, timedelta
from decimal import Decimal

import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.rc8 import VirtualRC8

R4 = int(VarType.R4)
R4S, R8S, I4S = R4 | ARRAY, VarType.R8 | ARRAY, VarType.I4 | ARRAY
ZEROS = [0.0] * 10

# class -> type, initial value, a value to write
CLASSES = {
    "I": (VarType.I4, 0, -(2**31)),
    "F": (VarType.R4, 0.0, -1.5),
    "D": (VarType.R8, 0.0, 0.1),
    "S": (VarType.BSTR, "", "ロボット robot"),
    "V": (R4S, ZEROS[:3], [1.0, 2.0, 3.0]),
    "P": (R4S, [*ZEROS[:6], -1.0], [500.0, 0.5, 300.25, 180.0, -90.0, 45.0, 5.0]),
    "J": (R4S, ZEROS[:8], [0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 7.0]),
    "T": (R4S, [*ZEROS[:9], -1.0], [500.0, 0.0, 300.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 5.0]),
    "IO": (VarType.BOOL, False, True),
    "IOB": (VarType.I1, 0, 0xA5 - 256),
    "IOW": (VarType.I2, 0, -1),
    "IOD": (VarType.I4, 0, -(2**31)),
    "IOF": (VarType.R4, 0.0, 2.5),
}
WIDTHS = {"IO": 1, "IOB": 8, "IOW": 16, "IOD": 32, "IOF": 32}


@pytest.mark.parametrize("name", CLASSES)
def test_each_class_has_its_type_default_and_bounds(name, controller, refused):
    vt, default, value = CLASSES[name]
    count = 512 - WIDTHS[name] + 1 if name in WIDTHS else 100
    for index in (0, count - 1):
        one = controller.get_variable(f"{name}{index}", "")
        assert one.get_value() == Variant(vt, default)
        assert one.put_value(Variant(vt, value)) is None
        assert one.get_value() == Variant(vt, value)
        one.put_value(Variant(vt, default))
    for index in (count, 10**9, "9" * 11, "9" * 5000):
        assert refused(controller.get_variable, f"{name}{index}", "") == 0x81500053


@pytest.mark.parametrize("name", CLASSES)
def test_another_client_sees_what_was_written(name, connect):
    vt, _, value = CLASSES[name]
    connect("one").get_variable(f"{name}10", "").put_value(Variant(vt, value))
    assert connect("two").get_variable(f"{name.lower()}10", "").get_value() == Variant(vt, value)
    assert connect("two").get_variable(f" {name}0010 ", "").get_value() == Variant(vt, value)


def test_a_read_value_is_a_copy(controller):
    p1 = controller.get_variable("P1", "")
    p1.get_value().value[0] = 99.0
    assert p1.get_value().value[0] == 0.0


@pytest.mark.parametrize(
    "name", ["", "I", "I-1", "I1x", "X1", "I*1", "IO", "IOX1", "I１", "I 1", "@", "@NONE", "@MODE ?", "TOOL", "I1\n2"]
)
def test_unknown_names(name, controller, refused):
    assert refused(controller.get_variable, name, "") == hresult.E_CAO_OBJECT_NOTFOUND


ACCEPTED = [
    ("I", Variant(VarType.I2, -5), -5),
    ("I", Variant(VarType.UI1, 255), 255),
    ("I", Variant(VarType.UI4, 2**31 - 1), 2**31 - 1),
    ("I", Variant(VarType.I8, -(2**31)), -(2**31)),
    ("I", Variant(VarType.R4, 7.0), 7),
    ("I", Variant(VarType.R8, -7.0), -7),
    ("I", Variant(VarType.BSTR, " 12 "), 12),
    ("I", Variant(VarType.BSTR, "-3.0"), -3),
    ("I", Variant(VarType.BOOL, True), -1),
    ("I", Variant(I4S, [9]), 9),
    ("I", Variant(VarType.UI1 | ARRAY, b"\x09"), 9),
    ("I", variant([Variant(VarType.I2, 9)]), 9),
    ("F", Variant(VarType.R8, 0.1), struct.unpack("<f", struct.pack("<f", 0.1))[0]),
    ("F", Variant(VarType.I4, 3), 3.0),
    ("F", Variant(VarType.BSTR, "1.5"), 1.5),
    ("D", Variant(VarType.R4, 1.5), 1.5),
    ("D", Variant(VarType.BOOL, False), 0.0),
    ("D", Variant(R8S, [2.5]), 2.5),
    ("S", Variant(VarType.BSTR | ARRAY, ["x"]), "x"),
    ("S", Variant(VarType.BSTR, "a" * 255), "a" * 255),
    ("S", Variant(VarType.BSTR, "漢" * 127), "漢" * 127),
    ("S", Variant(VarType.BSTR, "😀" * 255), "😀" * 255),
    ("V", Variant(R8S, [1, 2, 3.5]), [1.0, 2.0, 3.5]),
    ("V", Variant(I4S, [1, 2, 3]), [1.0, 2.0, 3.0]),
    ("V", Variant(VarType.UI1 | ARRAY, b"\x01\x02\x03"), [1.0, 2.0, 3.0]),
    ("V", variant([1, 2.5, "3"]), [1.0, 2.5, 3.0]),
    ("P", Variant(R8S, [0.1, 0, 0, 0, 0, 0, 5]), [struct.unpack("<f", struct.pack("<f", 0.1))[0], *ZEROS[:5], 5.0]),
    ("IO", Variant(VarType.I4, -1), True),
    ("IO", Variant(VarType.I4, 1), True),
    ("IO", Variant(VarType.I4, 0), False),
    ("IO", Variant(VarType.BSTR, "1"), True),
    ("IO", variant([True]), True),
    ("IOB", Variant(VarType.I4, 255), -1),
    ("IOB", Variant(VarType.I4, -128), -128),
    ("IOW", Variant(VarType.I4, -1), -1),
    ("IOD", Variant(VarType.R8, 5.0), 5),
    ("IOF", Variant(VarType.I4, 1), 1.0),
]


@pytest.mark.parametrize(("name", "given", "kept"), ACCEPTED)
def test_convertible_values_are_accepted(name, given, kept, controller):
    one = controller.get_variable(f"{name}1", "")
    one.put_value(given)
    assert one.get_value() == Variant(CLASSES[name][0], kept)


MISMATCH, OVERFLOW, INVALID = 0x80020005, 0x8002000A, 0x80070057
NAN, INFINITY = float("nan"), float("inf")
REFUSED = [
    ("I", Variant(VarType.EMPTY), MISMATCH),
    ("I", Variant(VarType.NULL), MISMATCH),
    ("I", Variant(VarType.BSTR, "one"), MISMATCH),
    ("I", Variant(VarType.BSTR, ""), MISMATCH),
    ("I", Variant(VarType.BSTR, "9" * 5000), MISMATCH),
    ("I", Variant(VarType.DATE, 1.0), MISMATCH),
    ("I", Variant(VarType.ERROR, 1), MISMATCH),
    ("I", Variant(VarType.CY, Decimal("1.5")), hresult.E_INVALIDARG),
    ("I", Variant(I4S, [1, 2]), MISMATCH),
    ("I", Variant(I4S, []), MISMATCH),
    ("I", variant([[1]]), MISMATCH),
    ("I", Variant(VarType.I8, 2**31), OVERFLOW),
    ("I", Variant(VarType.UI4, 2**32 - 1), OVERFLOW),
    ("I", Variant(VarType.R8, 1e300), OVERFLOW),
    ("I", Variant(VarType.BSTR, "9" * 400), OVERFLOW),
    ("I", Variant(VarType.R8, 1.5), INVALID),
    ("I", Variant(VarType.R8, NAN), INVALID),
    ("I", Variant(VarType.R8, INFINITY), INVALID),
    ("F", Variant(VarType.R8, 1e39), OVERFLOW),
    ("F", Variant(VarType.R4, NAN), INVALID),
    ("F", Variant(VarType.R4, -INFINITY), INVALID),
    ("F", Variant(VarType.BSTR, "nan"), INVALID),
    ("F", Variant(R4S, [1.0, 2.0]), MISMATCH),
    ("D", Variant(VarType.R8, NAN), INVALID),
    ("D", Variant(VarType.R8, INFINITY), INVALID),
    ("D", Variant(VarType.BSTR, "1e999"), INVALID),
    ("D", Variant(VarType.BSTR, "9" * 400), OVERFLOW),
    ("D", Variant(VarType.EMPTY), MISMATCH),
    ("S", Variant(VarType.I4, 1), MISMATCH),
    ("S", Variant(VarType.EMPTY), MISMATCH),
    ("S", Variant(VarType.BSTR | ARRAY, ["a", "b"]), MISMATCH),
    ("S", Variant(VarType.BSTR, "a" * 256), 0x81500041),
    ("S", Variant(VarType.BSTR, "漢" * 128), 0x81500041),
    ("V", Variant(R4S, [1.0, 2.0]), INVALID),
    ("V", Variant(R4S, ZEROS[:4]), INVALID),
    ("V", Variant(R4S, [1.0, 2.0, NAN]), INVALID),
    ("V", Variant(R8S, [1.0, 2.0, 1e39]), OVERFLOW),
    ("V", variant([1, 2.5, "x"]), MISMATCH),
    ("V", variant([]), INVALID),
    ("V", Variant(VarType.R4, 1.0), MISMATCH),
    ("V", Variant(VarType.BSTR, "V(1,2,3)"), MISMATCH),
    ("V", Variant(VarType.BSTR | ARRAY, ["1", "2", "3"]), MISMATCH),
    ("P", Variant(R4S, ZEROS[:6]), INVALID),
    ("J", Variant(R8S, ZEROS[:7]), INVALID),
    ("T", Variant(I4S, [0] * 9), INVALID),
    ("IO", Variant(VarType.I4, 2), OVERFLOW),
    ("IO", Variant(VarType.BSTR, "True"), MISMATCH),
    ("IO", Variant(VarType.EMPTY), MISMATCH),
    ("IOB", Variant(VarType.I4, 256), OVERFLOW),
    ("IOB", Variant(VarType.I4, -129), OVERFLOW),
    ("IOW", Variant(VarType.I4, 32768), OVERFLOW),
    ("IOD", Variant(VarType.UI4, 2**31), OVERFLOW),
    ("IOF", Variant(VarType.R4, NAN), INVALID),
]


@pytest.mark.parametrize(("name", "given", "code"), REFUSED)
def test_other_values_are_rejected_and_change_nothing(name, given, code, controller, refused):
    vt, _, value = CLASSES[name]
    one = controller.get_variable(f"{name}1", "")
    one.put_value(Variant(vt, value))
    assert refused(one.put_value, given) == code
    assert one.get_value() == Variant(vt, value)


def test_groups_of_points_begin_at_their_index(controller):
    def point(name):
        return controller.get_variable(name, "")

    point("IOB131").put_value(Variant(VarType.UI1, 0b1000_0001))
    assert [n for n in range(512) if point(f"IO{n}").get_value().value] == [131, 138]
    assert point("IOW128").get_value() == Variant(VarType.I2, 0b100_0000_1000)
    assert point("IOD130").get_value() == Variant(VarType.I4, 0b1_0000_0010)
    point("IOF200").put_value(Variant(VarType.R4, -1.5))
    assert point("IOD200").get_value().value == struct.unpack("<i", struct.pack("<f", -1.5))[0]
    point("IOW480").put_value(Variant(VarType.I2, -1))
    point("IOW488").put_value(Variant(VarType.I2, 0))
    assert point("IOD480").get_value().value == 0xFF


def test_the_id_selects_the_index(controller, refused):
    any_i = controller.get_variable("i*", "")
    assert (any_i.get_id(), any_i.get_name()) == (Variant(VarType.I4, 0), "i*")
    any_i.put_value(Variant(VarType.I4, 10))
    for given, index in [
        (Variant(VarType.I4, 5), 5),
        (Variant(VarType.I2, 6), 6),
        (Variant(VarType.UI8, 7), 7),
        (Variant(VarType.BSTR, "8"), 8),
        (Variant(VarType.R8, 9.0), 9),
    ]:
        any_i.put_id(given)
        assert any_i.get_id() == given
        any_i.put_value(Variant(VarType.I4, 10 + index))
        assert controller.get_variable(f"I{index}", "").get_value().value == 10 + index
    for given, code in [
        (Variant(VarType.I4, 100), 0x81500053),
        (Variant(VarType.I4, -1), 0x81500053),
        (Variant(VarType.BSTR, "x"), MISMATCH),
        (Variant(VarType.EMPTY), MISMATCH),
        (Variant(VarType.R8, 0.5), INVALID),
    ]:
        assert refused(any_i.put_id, given) == code
        assert any_i.get_value().value == 19
    assert controller.get_variable("I0", "").get_value().value == 10


def test_the_id_of_a_fixed_variable_has_no_effect(controller):
    i1 = controller.get_variable("I1", "")
    assert i1.get_id() == Variant(VarType.EMPTY)
    i1.put_id(Variant(VarType.BSTR, "anything"))
    i1.put_value(Variant(VarType.I4, 4))
    assert (i1.get_id().value, controller.get_variable("I1", "").get_value().value) == ("anything", 4)


def test_a_group_of_points_by_id(controller, refused):
    any_w = controller.get_variable("IOW*", "")
    any_w.put_id(Variant(VarType.I4, 496))
    any_w.put_value(Variant(VarType.I2, -1))
    assert controller.get_variable("IO511", "").get_value().value is True
    assert refused(any_w.put_id, Variant(VarType.I4, 497)) == 0x81500053


def test_counts_can_be_configured(connect, refused):
    device = VirtualRC8(counts={"i": 3, "P": 0, "S": 2**31 - 1}, io_points=10)
    controller = connect(device=device)
    assert controller.get_variable("I2", "").get_value().value == 0
    assert controller.get_variable("S2147483646", "").get_value().value == ""
    for name in ("I3", "P0", "IO10", "IOB3", "IOW0", "S2147483647"):
        assert refused(controller.get_variable, name, "") == 0x81500053
    none = controller.get_variable("P*", "")
    for call in (none.get_value, none.get_date_time, none.get_microsecond):
        assert refused(call) == 0x81500053
    assert refused(none.put_value, Variant(R4S, ZEROS[:7])) == 0x81500053
    lengths = {"I": 3, "F": 100, "P": 0, "IO": 10, "S": 2**31 - 1}
    for name, count in lengths.items():
        assert controller.get_variable(f"@VAR_{name}_LEN", "").get_value() == Variant(VarType.I4, count)


@pytest.mark.parametrize(
    "wrong",
    [
        {"counts": {"I": -1}},
        {"counts": {"I": 2**31}},
        {"counts": {"X": 1}},
        {"counts": {"IO": 1}},
        {"io_points": -1},
        {"io_points": 65537},
    ],
)
def test_invalid_counts(wrong):
    with pytest.raises(ValueError, match=r"count|class"):
        VirtualRC8(**wrong)


def test_time_stamps_are_those_of_the_last_write(controller, clock):
    start = clock.wall()
    i1, io129 = controller.get_variable("I1", ""), controller.get_variable("IO129", "")
    assert (i1.get_date_time(), io129.get_date_time(), i1.get_microsecond()) == (start, start, start.microsecond)
    clock.advance(1.25)
    i1.put_value(Variant(VarType.I4, 1))
    controller.get_variable("IOB128", "").put_value(Variant(VarType.UI1, 0))
    clock.advance(1)
    controller.get_variable("IO130", "").put_value(Variant(VarType.BOOL, False))
    clock.advance(10)
    i1.get_value()
    assert i1.get_date_time() == start + timedelta(seconds=1.25)
    assert i1.get_microsecond() == 250_000
    assert io129.get_date_time() == start + timedelta(seconds=1.25)
    assert controller.get_variable("IOB125", "").get_date_time() == start + timedelta(seconds=2.25)
    assert controller.get_variable("I2", "").get_date_time() == start


def test_time_stamps_use_the_controllers_calendar(controller, rc8):
    rc8.pendant.set_time(datetime(2040, 2, 29, 1, 2, 3))
    d5 = controller.get_variable("D5", "")
    d5.put_value(variant(1.0))
    assert d5.get_date_time() == datetime(2040, 2, 29, 1, 2, 3)


def test_names_of_all_variables(controller):
    names = controller.get_variable_names("")
    assert len(set(names)) == len(names)
    assert {name.rstrip("*") for name in names if not name.startswith("@")} == set(CLASSES)
    for name in names:
        one = controller.get_variable(name, "@IfNotMember")
        assert one.get_name() == name
        assert name in one.get_help() or one.get_help()
        assert one.get_attribute() in (1, 3)
        one.get_value()
        one.put_tag(variant("mine"))
        assert one.get_tag() == variant("mine")
        one.release()


def test_help_has_class_type_and_area(controller):
    def help_of(name):
        return controller.get_variable(name, "").get_help()

    assert help_of("i1") == "I1: integer (VT_I4)"
    assert help_of("P*").startswith("P*: position")
    for point, area in [(0, "input"), (31, "output"), (32, "reserved"), (50, "hand input"), (64, "hand output"),
                        (127, "reserved"), (128, "user"), (511, "user")]:  # fmt: skip
        assert help_of(f"IO{point}") == f"IO{point}: I/O point (VT_BOOL) ({area})"
